# SPDX-License-Identifier: LGPL-3.0-or-later
"""Energy ledger of a run: where the energy is, and how far the balance is off."""

from collections.abc import Mapping
from dataclasses import fields

import numpy as np

from meshes.arrays import Array
from workflow.model import Model
from workflow.results.energy import Energy, columns

TERMS = tuple(term.name for term in fields(Energy) if term.name != "own")
FLIGHT = 0.01  # of the exchanged energy, for bodies that fly and have not touched yet


class Ledger:
    """Energies of a model against those at its start.

    The balance error is the change of the total over the *reference energy*: the largest kinetic
    plus stored energy seen so far, less the kinetic energy of a rigid ride, which does not take
    part in the exchange (a wheelset at 80 km/h carries 100 kJ and exchanges 100 J).

    Central difference closes this balance even while it blows up: the stored energy grows, and
    ``m v₋ · v₊ / 2`` as much below zero, because the velocity changes sign at every step. A kinetic
    energy that far below zero is therefore counted as the error.

    A contact that goes wrong makes or takes a share of what passes through it, which is little
    beside the motion of a fast body. The *work of the contact* is what friction, landings, dampers
    of contacts and plastic flow have taken, and the most that contact springs and the strain of the
    bodies have held: contact has pressed it into them, or made it out of their motion. It is the
    same in every moving frame. The *guarded error* is the imbalance over that work, without contact
    over the reference energy.

    Attributes:
        contact_work: Work of the contact so far, 0 without contact [J].
        guarded_error: What :mod:`workflow.simulation.guards` compares with its limit [-].
    """

    def __init__(self, model: Model) -> None:
        self.model = model
        self.ride = 0.0
        self.start: Energy | None = None
        self.reference = self.held = 0.0
        self.contact_work = self.guarded_error = 0.0

    def measure(self) -> tuple[Energy, float]:
        """Return the energies now and the relative balance error."""
        energy = self._now()
        if self.start is None:
            self.start, scene = energy, self.model.scene
            self.ride = energy.kinetic if scene.rolling or scene.driven else 0.0
        self.reference = max(self.reference, exchanged(energy, self.ride))
        error = energy.total - self.start.total
        if blown_up(energy, self.start):
            error = energy.kinetic
        self.guarded_error = over(error, self._guarded(energy))
        return energy, over(error, self.reference)

    def _guarded(self, energy: Energy) -> float:
        """Take in the work of the contact; return what the guarded error is measured against."""
        pairs = self.model.pairs.values()
        if not pairs:
            return self.reference
        self.held = max(self.held, energy.internal + energy.hourglass + energy.contact)
        landings = sum(abs(pair.damping_dissipation) for pair in pairs)
        self.contact_work = self.held + energy.friction_dissipation + landings + taken(energy)
        return max(self.contact_work, FLIGHT * self.reference)

    def memory(self) -> dict[str, Array]:
        """Return the energies at the start and the largest ones so far, for a checkpoint."""
        arrays = {"scalars": np.array([self.ride, self.reference, self.held])}
        if self.start is not None:
            start = columns(self.start, 0.0)
            arrays |= {f"start/{name}": np.array(e) for name, e in start.items()}
        return arrays

    def restore(self, memory: Mapping[str, Array]) -> None:
        """Go on from what :meth:`memory` returned."""
        self.ride, self.reference, self.held = map(float, memory["scalars"])
        start = {k[6:]: float(e) for k, e in memory.items() if k.startswith("start/")}
        start.pop("balance_error", None)
        self.start = named(start) if start else None

    def _now(self) -> Energy:
        m, state = self.model, self.model.state
        n = 3 * m.domain.owned
        before = state.v.x.array[:n]
        after = before + m.dt * state.a.array[:n]
        kinetic = float((m.mass.array[:n] * before) @ after) / 2
        terms = dict.fromkeys(TERMS, 0.0) | {"kinetic": m.domain.msh.comm.allreduce(kinetic)}
        for item in (*m.items, m.hold):
            for name, value in item.energy(state).items() if hasattr(item, "energy") else ():
                terms[name] = terms.get(name, 0.0) + float(value)
        return named(terms)


def named(terms: Mapping[str, float]) -> Energy:
    """Return energies given by name; names that the ledger does not know are a user's own."""
    known = {name: terms[name] for name in TERMS}
    return Energy(**known, own={n: e for n, e in terms.items() if n not in known})


def over(error: float, reference: float) -> float:
    """Return an error as a share, 0 while there is nothing to compare it with [-]."""
    return error / reference if reference > 0 else 0.0


def exchanged(energy: Energy, ride: float) -> float:
    """Kinetic energy beyond the rigid ride plus stored and dissipated energy [J]."""
    return (
        max(energy.kinetic - ride, 0.0)
        + energy.internal
        + energy.hourglass
        + energy.contact
        + energy.friction_dissipation
        + energy.damping
        + taken(energy)
    )


def taken(energy: Energy) -> float:
    """Energy that a law or item beside the ledger's own terms holds or has lost [J]."""
    return sum(abs(e) for name, e in energy.own.items() if not name.endswith("work"))


def blown_up(energy: Energy, start: Energy) -> bool:
    """Tell whether the kinetic energy is as negative as only an unstable step makes it.

    A stable oscillation of ``x = ω dt / 2 < 1`` stays above ``−x²`` of its stored energy, and one
    that is damped above minus the kinetic energy it began with.
    """
    stored = energy.internal + energy.hourglass + energy.contact + energy.spring
    given = start.kinetic + start.internal + start.hourglass + start.contact
    given += abs(energy.external_work)
    return -energy.kinetic > max(0.99 * stored, given)
