# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a contact pair remembers of each contactor node from step to step."""

from typing import Any

import numpy as np
import numpy.typing as npt

from contact.arrays import view

Array = npt.NDArray[np.float64]

# lasting state, in the order of a checkpoint; the rest is found again each step
_SAVED = (
    "facet",
    "xi",
    "gap",
    "normal",
    "stiffness",
    "damper",
    "offset",
    "normal_force",
    "damping_force",
    "approach",
    "tangential_force",
    "slip",
    "friction",
    "touching",
    "total",
)


class ContactState:
    """Arrays over the ``nc`` contactor nodes; what they hold is told in ``kernel.h``.

    ``ratio`` is the tangential over the normal stiffness, infinite without such springs.

    Attributes:
        c: Their memory for the kernel, by name.
    """

    def __init__(self, nc: int, ratio: float = 1.0) -> None:
        self._ratio = ratio
        self._offsets = 0, 0.0
        self.facet = np.zeros(nc, dtype=np.int32)
        self.xi = np.zeros((nc, 2))
        self.gap = np.zeros(nc)
        self.normal = np.zeros((nc, 3))
        self.stiffness = np.zeros(nc)
        self.damper = np.zeros(nc)
        self.offset = np.zeros(nc)
        self.normal_force = np.zeros(nc)
        self.damping_force = np.zeros(nc)
        self.approach = np.zeros(nc)
        self.tangential_force = np.zeros((nc, 3))
        self.slip = np.zeros((nc, 3))
        self.friction = np.zeros(nc)
        self.touching = np.zeros(nc, dtype=np.int32)
        self.total = np.zeros(12)
        self.started = np.full(1, np.nan)  # time of the first step
        self.c: dict[str, Any] = {
            name: view(name, a, a.shape, a.dtype, out=True)
            for name, a in vars(self).items()
            if name[0] != "_"
        }

    def clear(self, nodes: npt.NDArray[np.int64] | slice = slice(None)) -> None:
        """Forget the contact of ``nodes`` (all if left out)."""
        for a in (
            self.stiffness,
            self.damper,
            self.offset,
            self.normal_force,
            self.damping_force,
            self.approach,
            self.tangential_force,
            self.slip,
        ):
            a[nodes] = 0.0

    @property
    def offsets(self) -> tuple[int, float]:
        """Nodes that got an offset at the first step, and the deepest [m]."""
        return self._offsets

    def faded(
        self, item: npt.NDArray[np.int32], t: float, over: float, always: bool, rest: bool
    ) -> float:
        """Set offsets at the first step; return which part of them is left at time ``t`` [s].

        Args:
            item: Candidates.
            t: Time [s].
            over: Time over which they fade, 0: they last [s].
            always: Nodes that just overlap get one, so that this does not count.
            rest: So do nodes that a static solve has pressed together.
        """
        if np.isnan(self.started[0]):
            self.started[0] = t
            new = item[self.gap[item] < 0.0]
            pressed = self.stiffness[new] > 0.0
            new = new[(pressed & rest) | (~pressed & always)]
            self.offset[new] = -self.gap[new]
            deepest = float(self.offset[new].max(initial=0.0))
            self._offsets = len(new), deepest
        return max(0.0, 1.0 - (t - self.started[0]) / over) if over > 0.0 else 1.0

    def release(self, nodes: npt.NDArray[np.int64]) -> None:
        """Let go of ``nodes``; the energy of their tangential springs turns into heat."""
        kt = self._ratio * self.stiffness[nodes]
        self.total[0] += float((0.5 * (self.tangential_force[nodes] ** 2).sum(axis=1) / kt).sum())
        self.clear(nodes)

    def saved(self) -> dict[str, npt.NDArray[Any]]:
        """Return copies of the lasting arrays by name."""
        return {name: getattr(self, name).copy() for name in _SAVED}

    def load(self, memory: dict[str, npt.NDArray[Any]]) -> None:
        """Take over what :meth:`saved` returned.

        Raises:
            ValueError: if an array is missing or has another shape.
        """
        for name in _SAVED:
            mine = getattr(self, name)
            if name not in memory or memory[name].shape != mine.shape:
                got = memory[name].shape if name in memory else "nothing"
                raise ValueError(f"contact memory {name}: expected {mine.shape}, got {got}")
            mine[:] = memory[name]
