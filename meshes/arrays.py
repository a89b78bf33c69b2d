# SPDX-License-Identifier: LGPL-3.0-or-later
"""Types of the arrays in this package."""

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.int64]  # of nodes, cells or facets
Flags = npt.NDArray[np.bool_]
