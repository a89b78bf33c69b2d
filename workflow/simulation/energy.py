# SPDX-License-Identifier: LGPL-3.0-or-later
"""The energy ledger: where the energy of a run is, and how far the balance is off."""

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from workflow.model.model import Model


@dataclass(frozen=True)
class Energy:
    """Energies at one time, all in joules.

    ``kinetic`` is ``m v₋ · v₊ / 2`` with the velocities half a step before and after: together with
    the strain energy it is what central difference keeps exactly in a linear problem (the square of
    their mean is larger by ``m (dt a)² / 8`` and rings by that much).
    ``contact`` is stored in contact springs, normal and tangential ones, ``spring`` in connections
    (weight of point masses included). Dissipations and works are sums since time zero.
    ``external_work`` is that of dead loads, drive torque and
    of all that moves at a given speed. ``hourglass`` is that of the control
    of one-point cells.
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

    @property
    def total(self) -> float:
        """What an exact integration would keep at its first value."""
        stored = self.kinetic + self.internal + self.hourglass + self.contact + self.spring
        return stored + self.friction_dissipation + self.damping - self.external_work


class Ledger:
    """Energies of a model against those at its start.

    The balance error is the change of the total over the *reference energy*: the largest kinetic
    plus stored energy seen so far, less the kinetic energy of a rigid ride, which does not take
    part in the exchange (a wheelset at 80 km/h carries 100 kJ and exchanges 100 J).

    Central difference closes this balance even while it blows up: the stored energy grows, and
    ``m v₋ · v₊ / 2`` as much below zero, because the velocity changes sign at every step. A kinetic
    energy that far below zero is therefore counted as the error.
    """

    def __init__(self, model: "Model") -> None:
        self.model = model
        self.ride = 0.0
        self.start: Energy | None = None
        self.reference = 0.0
        self.internal_start = 0.0

    def measure(self) -> tuple[Energy, float]:
        """Return the energies now and the relative balance error."""
        if self.start is None:
            self.internal_start = sum(self._elastic())
        energy = self._now()
        if self.start is None:
            self.start, scene = energy, self.model.scene
            self.ride = energy.kinetic if scene.rolling or scene.driven else 0.0
        self.reference = max(self.reference, exchanged(energy, self.ride))
        error = energy.total - self.start.total
        if blown_up(energy, self.start):
            error = energy.kinetic
        return energy, error / self.reference if self.reference > 0 else 0.0

    def _elastic(self) -> tuple[float, float]:
        """Strain energy and that of hourglass control."""
        control = self.model.hourglass_energy
        return self.model.strain_energy(), control() if control is not None else 0.0

    def _now(self) -> Energy:
        m, state = self.model, self.model.state
        n = 3 * m.domain.owned
        before = state.v.x.array[:n]
        after = before + m.dt * state.a.array[:n]
        comm = m.domain.msh.comm
        kinetic = comm.allreduce(float((m.mass.array[:n] * before) @ after) / 2)
        u = state.u.x.array
        internal, hourglass = self._elastic()
        damping = 0.0
        if m.internal.damped:
            stored = internal + hourglass - self.internal_start
            damping += comm.allreduce(m.internal.work) - stored
        if m.viscosity is not None:
            damping += comm.allreduce(m.viscosity.work)
        if m.damping is not None:
            damping += comm.allreduce(m.damping.dissipation)
        spring, work = 0.0, m.dead.work(u)
        if m.connections is not None:
            spring = m.connections.stored_energy(u)
            damping += m.connections.dissipation()
            work += m.connections.masses.work
            kinetic += m.connections.masses.kinetic_energy(m.dt)
        if m.drive is not None:
            work += comm.allreduce(m.drive.work)
        if m.drives is not None:
            work += comm.allreduce(m.drives.work)
        pairs = m.pairs.values()
        return Energy(
            kinetic=float(kinetic),
            internal=internal,
            hourglass=hourglass,
            contact=float(sum(p.stored_energy for p in pairs)),
            spring=float(spring),
            friction_dissipation=float(sum(p.friction_dissipation for p in pairs)),
            damping=float(damping + sum(p.damping_dissipation for p in pairs)),
            external_work=float(work),
            contact_normal=float(sum(p.normal_energy for p in pairs)),
            contact_tangential=float(sum(p.tangential_energy for p in pairs)),
        )


def exchanged(energy: Energy, ride: float) -> float:
    """Kinetic energy beyond the rigid ride plus stored and dissipated energy [J]."""
    return (
        max(energy.kinetic - ride, 0.0)
        + energy.internal
        + energy.hourglass
        + energy.contact
        + energy.friction_dissipation
        + energy.damping
    )


def blown_up(energy: Energy, start: Energy) -> bool:
    """Tell whether the kinetic energy is as negative as only an unstable step makes it.

    A stable oscillation of ``x = ω dt / 2 < 1`` stays above ``−x²`` of its stored energy, and one
    that is damped above minus the kinetic energy it began with.
    """
    stored = energy.internal + energy.hourglass + energy.contact + energy.spring
    given = start.kinetic + start.internal + start.hourglass + start.contact
    given += abs(energy.external_work)
    return -energy.kinetic > max(0.99 * stored, given)


def columns(energy: Energy, error: float) -> dict[str, float]:
    """Return the energies and the balance error by name."""
    return {**asdict(energy), "balance_error": error}
