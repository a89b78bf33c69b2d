# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a contact pair reads of the state of a model."""

from typing import Protocol

import numpy as np
import numpy.typing as npt


class Vector(Protocol):
    """A flat local array, block size 3: owned dofs first, then ghosts."""

    @property
    def array(self) -> npt.NDArray[np.float64]: ...  # noqa: D102


class Field(Protocol):
    """A finite-element function."""

    @property
    def x(self) -> Vector: ...  # noqa: D102


class State(Protocol):
    """Displacement ``u`` at t, velocity ``v`` at t - dt/2, time ``t``."""

    @property
    def u(self) -> Field: ...  # noqa: D102
    @property
    def v(self) -> Field: ...  # noqa: D102
    @property
    def t(self) -> float: ...  # noqa: D102
