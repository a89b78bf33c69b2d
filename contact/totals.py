# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a contact pair has to tell: energies and resultants over its nodes, and its footprint."""

from typing import Any

import numpy as np
import numpy.typing as npt

from contact.footprint import Footprint, footprint_of
from contact.history import History
from contact.neighbourhood import Neighbourhood
from contact.patches import beside, parted
from contact.surface import Surface

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.int64]


class Totals:
    """Energies, resultants and footprint of a pair, read from its history."""

    history: History
    contactor: Surface
    near: Neighbourhood
    area: Array
    dt: float
    active: int
    add: Any

    phase = "contact"

    def energy(self, state: Any) -> dict[str, float]:
        """Return the terms of the ledger [J]."""
        return {
            "contact": self.stored_energy,
            "contact_normal": self.normal_energy,
            "contact_tangential": self.tangential_energy,
            "friction_dissipation": self.friction_dissipation,
            "damping": self.damping_dissipation,
        }

    def rest(self, state: Any, force: Any) -> None:
        """Add the forces in statics."""
        self.add(state, force, friction=False)

    @property
    def friction_dissipation(self) -> float:
        """Work turned into heat by friction since :meth:`reset` [J]."""
        return float(self.history.total[0])

    @property
    def damping_dissipation(self) -> float:
        """Work turned into heat by normal damping since :meth:`reset` [J]."""
        return float(self.history.total[1])

    @property
    def normal_energy(self) -> float:
        """Energy of the normal springs at the last step [J]."""
        return float(self.history.total[2])

    @property
    def tangential_energy(self) -> float:
        """Energy of the tangential springs at the last step [J]."""
        return float(self.history.total[3])

    @property
    def stored_energy(self) -> float:
        """Energy of the normal and tangential springs at the last step [J]."""
        return self.normal_energy + self.tangential_energy

    @property
    def max_penetration(self) -> float:
        """Deepest penetration at the last step [m]."""
        return float(self.history.total[4])

    @property
    def normal_force(self) -> float:
        """Sum of the nodal normal forces at the last step [N]."""
        return float(self.history.total[5])

    @property
    def normal_resultant(self) -> Array:
        """Vector sum of the normal forces on the contactor, shape ``(3,)`` [N]."""
        return self.history.total[6:9].copy()

    @property
    def tangential_force(self) -> Array:
        """Vector sum of the tangential forces on the contactor, shape ``(3,)`` [N]."""
        return self.history.total[9:12].copy()

    @property
    def initial_offsets(self) -> tuple[int, float]:
        """Nodes whose overlap at the start does not count, and the deepest [m]."""
        return self.history.offsets

    def footprint(self, stick_tolerance: float = 0.05) -> Footprint:
        """Return the nodes in contact at the last step and their patches, same on all ranks.

        Args:
            stick_tolerance: A node adheres where ``friction * F_n - |F_t|`` exceeds this
                fraction of the largest tangential nodal force [-].
        """
        h = self.history
        c = np.sort(h.touching[: self.active].astype(np.int64))
        c = c[h.pressing[c] > 0.0]
        return self.footprint_on(c, h.normal[c], h.pressing[c], h.traction[c], stick_tolerance)

    def footprint_on(
        self, c: Index, normal: Array, pressing: Array, traction: Array, stick_tolerance: float
    ) -> Footprint:
        """Return the footprint of contactor nodes ``c`` with these normals and forces."""
        h = self.history
        neighbours = beside(self.contactor.facets, c, len(self.contactor.nodes))
        return footprint_of(
            self.contactor.nodes[c], self.near.exchange.xv[c, :3], normal, pressing, traction,
            self.area[c], h.slip[c] / self.dt, h.friction[c],
            parted(pressing / self.area[c], neighbours), stick_tolerance,
        )  # fmt: skip
