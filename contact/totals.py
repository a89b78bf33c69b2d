# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a contact pair has summed up over its nodes."""

import numpy as np
import numpy.typing as npt

from contact.history import History

Array = npt.NDArray[np.float64]


class Totals:
    """Energies and resultants of a pair, read from its history."""

    history: History

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
