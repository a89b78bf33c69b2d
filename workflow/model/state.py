# SPDX-License-Identifier: LGPL-3.0-or-later
"""State of motion of a model, and the items that act on it in a step."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import dolfinx

Load = Callable[["State", dolfinx.la.Vector], None]


@dataclass
class State:
    """Motion of all bodies; mutated by the stepping, copy what you keep.

    Attributes:
        u: Displacement at t [m].
        v: Velocity at t − dt/2 [m/s] (at the start: at t).
        a: Acceleration at t [m/s²]; the nodal force while the loads add to it [N].
        t: Time [s].
        step: Steps done.
        not_finite: How many accelerations of this rank are not finite.
    """

    u: dolfinx.fem.Function
    v: dolfinx.fem.Function
    a: dolfinx.la.Vector
    t: float = 0.0
    step: int = 0
    not_finite: int = 0


class Item(Protocol):
    """What acts on the bodies in a step: internal force, load, spring, contact, or a user's own.

    ``add`` is all that is asked for. An item may have besides

    - ``energy() -> dict[str, float]``: its terms of the ledger [J], the same on all ranks;
      collective. A name that ends in ``work`` counts against the others; terms of one name add up.
    - ``memory() -> dict[str, array]`` and ``restore(arrays)``: what a checkpoint keeps, the same on
      all ranks; collective.
    - ``phase``: the phase of a run that its time counts to, ``update`` if it has none.
    - ``last = True``: it reads the sum of all other forces, complete on owned dofs, and adds to
      these only.
    - ``rest(state, force)``: its force in statics, where velocities mean nothing; ``add`` if it has
      none, and no force if it is None. ``settle_memory(state)``: takes what it remembers on to a
      state at rest, between two increments of the loads.
    - ``columns() -> dict[str, float]``: its columns of the history, the same on all ranks;
      collective. ``cell_fields``, names, and ``cell_means(name)``, an array of all cells on rank 0:
      its fields of cells in ``fields.vtkhdf``; collective.
    - ``notices() -> Iterator[str]``: lines for the log at an output, the same on all ranks.
    - ``back(dt)`` and ``step(dt)``: motion of its own beside the mesh, as point masses have it.
    - ``retime(dt)``: takes another step, if it keeps one.
    """

    def add(self, state: State, force: dolfinx.la.Vector) -> None:
        """Add the forces of the present state on this rank [N]."""
