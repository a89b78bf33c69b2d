# SPDX-License-Identifier: LGPL-3.0-or-later
"""Terms of the energy ledger at one time."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field


@dataclass(frozen=True)
class Energy:
    """Energies at one time, all in joules.

    ``kinetic`` is ``m v₋ · v₊ / 2`` with the velocities half a step before and after: together with
    the strain energy it is what central difference keeps exactly in a linear problem (the square of
    their mean is larger by ``m (dt a)² / 8`` and rings by that much).
    ``contact`` is stored in contact springs, normal and tangential ones, ``spring`` in connections
    (weight of point masses included). Dissipations and works are sums since time zero.
    ``external_work`` is that of dead loads, drive torque and of all that moves at a given speed.
    ``hourglass`` is that of the control of one-point cells. ``own`` are the terms of a user's items
    under names of theirs: works where the name ends so, else energies stored or taken.
    """

    kinetic: float
    internal: float
    hourglass: float
    contact: float
    spring: float
    friction_dissipation: float
    damping: float
    external_work: float
    contact_normal: float = 0.0
    contact_tangential: float = 0.0
    own: Mapping[str, float] = field(default_factory=dict)

    @property
    def total(self) -> float:
        """What an exact integration would keep at its first value."""
        stored = self.kinetic + self.internal + self.hourglass + self.contact + self.spring
        total = stored + self.friction_dissipation + self.damping - self.external_work
        return total + sum(-e if n.endswith("work") else e for n, e in self.own.items())


def columns(energy: Energy, error: float) -> dict[str, float]:
    """Return the energies and the balance error by name, as a row of the history has them."""
    terms = {**asdict(energy), "balance_error": error}
    own = terms.pop("own")
    return terms | own
