# SPDX-License-Identifier: LGPL-3.0-or-later
"""Explicit central difference: the step of every dynamic run.

Conventions: ``u`` is at t, ``v`` at t − dt/2. When a state is yielded, ``a`` is the acceleration at
t, so the velocity at t is ``v + dt/2 a``: the mean of the two half-step velocities.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any

from petsc4py import PETSc

import dolfinx
import numpy as np
import numpy.typing as npt

from forms.springs.point_masses import PointMasses

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
    """

    u: dolfinx.fem.Function
    v: dolfinx.fem.Function
    a: dolfinx.la.Vector
    t: float = 0.0
    step: int = 0


def central_difference(
    state: State,
    mass: PETSc.Vec,
    loads: Iterable[Load],
    hold: Callable[[dolfinx.la.Vector], None],
    dt: float,
    t_end: float,
    points: PointMasses | None = None,
    dead: npt.NDArray[np.float64] | None = None,
    resumed: bool = False,
    last: Iterable[Load] = (),
) -> Iterator[State]:
    """Yield the state at every step from now to ``t_end``, forces and acceleration in place.

    Args:
        state: Start, with ``v`` at the same time as ``u``.
        mass: Lumped mass of the owned dofs [kg].
        loads: Callables that add their nodal forces.
        hold: Removes the held components from an acceleration.
        dt: Step [s].
        t_end: Last time [s].
        points: Point masses that move with the bodies.
        dead: Constant force on the owned dofs that every step starts from [N]; none: zero.
        last: Loads that read the sum of all others, complete on owned dofs, and add to these only.
        resumed: The state is one that was yielded, acceleration included: go on with its kick.
    """
    u, v, a = state.u.x.petsc_vec, state.v.x.petsc_vec, state.a.petsc_vec
    per_mass = 1.0 / mass.array_r  # a product costs a fifth of a quotient
    owned = state.a.array[: len(per_mass)]
    constant = np.zeros_like(state.a.array)
    if dead is not None:
        constant[: len(dead)] = dead
    start, known = not resumed, resumed
    while True:
        if not known:
            state.a.array[:] = constant
            for add in loads:
                add(state, state.a)
            state.a.scatter_reverse(dolfinx.la.InsertMode.add)
            for add in last:
                add(state, state.a)
            owned *= per_mass
            hold(state.a)
            if start:
                v.axpy(-dt / 2, a)  # from v at t to v at t - dt/2
                if points is not None:
                    points.back(dt / 2)
                start = False
            yield state
        known = False
        if state.t > t_end - dt / 2:
            return
        v.axpy(dt, a)  # kick
        u.axpy(dt, v)  # drift
        if points is not None:
            points.step(dt)
        state.u.x.scatter_forward()
        state.v.x.scatter_forward()
        state.t += dt
        state.step += 1


def no_hold(a: Any) -> None:
    """Hold nothing."""
