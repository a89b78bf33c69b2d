# SPDX-License-Identifier: LGPL-3.0-or-later
"""Types of arrays, by what they hold."""

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.int64]  # of nodes, cells or facets
Dofs = npt.NDArray[np.int32]  # of DOLFINx, which numbers in 32 bits
Flags = npt.NDArray[np.bool_]
