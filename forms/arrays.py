# SPDX-License-Identifier: LGPL-3.0-or-later
"""Types of the arrays of nodes and dofs."""

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.int64]
Dofs = npt.NDArray[np.int32]
