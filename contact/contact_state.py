# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact state: forces, slip and closest points of the contactor nodes from step to step."""

from typing import Any

import numpy as np
import numpy.typing as npt

from contact._kernel import ffi
from contact.arrays import Index32, struct
from meshes.arrays import Index


class ContactState:
    """Arrays over the ``nc`` contactor nodes; what they hold is told in ``kernel.h``.

    ``ratio`` is the tangential over the normal stiffness, infinite without such springs.

    Attributes:
        totals: Sums over the nodes, by name as in ``kernel.h``.
        started: Time of the first step, NaN before [s].
        offsets: Nodes that got an offset at the first step, and the deepest [m].
        c: All of it for the kernel.
    """

    def __init__(self, nc: int, ratio: float = 1.0) -> None:
        self.facet = np.zeros(nc, dtype=np.int32)
        self.xi = np.zeros((nc, 2))
        self.gap = np.zeros(nc)
        self.normal = np.zeros((nc, 3))
        self.offset = np.zeros(nc)
        self.stiffness = np.zeros(nc)
        self.damper = np.zeros(nc)
        self.normal_force = np.zeros(nc)
        self.damping_force = np.zeros(nc)
        self.tangential_force = np.zeros((nc, 3))
        self.slip = np.zeros((nc, 3))
        self.friction = np.zeros(nc)
        self.touching = np.zeros(nc, dtype=np.int32)
        arrays: dict[str, npt.NDArray[Any]] = dict(vars(self))
        self.totals = ffi.new("wr_totals *")
        self.c = struct("wr_state", totals=self.totals, **arrays)
        self._lasting = arrays | {"totals": np.frombuffer(ffi.buffer(self.totals))}
        self._ratio = ratio
        self.started, self.offsets = np.nan, (0, 0.0)

    def reset(self, friction: float) -> None:
        """Forget all contact; ``friction`` is the coefficient of nodes that begin."""
        self.clear()
        self._lasting["totals"][:] = 0.0
        self.friction[:] = friction
        self.started = np.nan

    def clear(self, nodes: Index | slice = slice(None)) -> None:
        """Forget the contact of ``nodes`` (all if left out)."""
        self.stiffness[nodes] = self.damper[nodes] = self.offset[nodes] = 0.0
        self.normal_force[nodes] = self.damping_force[nodes] = 0.0
        self.tangential_force[nodes] = self.slip[nodes] = 0.0

    def faded(self, item: Index32, t: float, over: float, always: bool, rest: bool) -> float:
        """Set offsets at the first step; return which part of them is left at time ``t`` [s].

        Args:
            item: Candidates.
            t: Time [s].
            over: Time over which they fade, 0: they last [s].
            always: Nodes that just overlap get one, so that this does not count.
            rest: So do nodes that a static solve has pressed together.
        """
        if np.isnan(self.started):
            self.started = t
            new = item[self.gap[item] < 0.0]
            pressed = self.stiffness[new] > 0.0
            new = new[(pressed & rest) | (~pressed & always)]
            self.offset[new] = -self.gap[new]
            self.offsets = len(new), float(self.offset[new].max(initial=0.0))
        return max(0.0, 1.0 - (t - self.started) / over) if over > 0.0 else 1.0

    def release(self, nodes: Index) -> None:
        """Let go of ``nodes``; the energy of their tangential springs turns into heat."""
        kt = self._ratio * self.stiffness[nodes]
        energy = 0.5 * (self.tangential_force[nodes] ** 2).sum(axis=1) / kt
        self.totals.friction_dissipation += float(energy.sum())
        self.clear(nodes)

    def saved(self) -> dict[str, npt.NDArray[Any]]:
        """Return copies of the lasting arrays by name."""
        copies = {name: a.copy() for name, a in self._lasting.items()}
        return copies | {"started": np.array([self.started])}

    def load(self, memory: dict[str, npt.NDArray[Any]]) -> None:
        """Take over what :meth:`saved` returned.

        Raises:
            ValueError: if an array is missing or has another shape.
        """
        for name, mine in self._lasting.items():
            if name not in memory or memory[name].shape != mine.shape:
                got = memory[name].shape if name in memory else "nothing"
                raise ValueError(f"contact memory {name}: expected {mine.shape}, got {got}")
            mine[:] = memory[name]
        self.started = float(memory["started"][0])
