# SPDX-License-Identifier: LGPL-3.0-or-later
"""Central difference: the explicit step of every dynamic run.

Conventions: ``u`` is at t, ``v`` at t − dt/2. When a state is yielded, ``a`` is the acceleration at
t, so the velocity at t is ``v + dt/2 a``: the mean of the two half-step velocities.
"""

import time
from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING, Any

from petsc4py import PETSc

import dolfinx
import numpy as np
import numpy.typing as npt

from forms.loads import DeadLoad
from forms.nodal import lib, pointer
from workflow.model.state import Load, State
from workflow.model.supports import Withheld

if TYPE_CHECKING:
    from workflow.model.model import Model
    from workflow.simulation.progress import Clock


def steps(
    model: "Model",
    t_end: float,
    clock: "Clock | None" = None,
    *,
    hold: Callable[[dolfinx.la.Vector], None] | None = None,
    resumed: bool = False,
) -> Iterator[State]:
    """Yield the state of a model at every step from now to ``t_end``.

    Args:
        model: The model.
        t_end: Last time [s].
        clock: Takes the time of every item as its phase, and what is left as ``update``.
        hold: Imposes supports and prescribed motion; ``model.hold`` if left out.
        resumed: As for :func:`central_difference`.
    """
    dead = [item for item in model.items if isinstance(item, DeadLoad)]
    acting = [item for item in model.items if not isinstance(item, DeadLoad)]
    last = [item for item in acting if getattr(item, "last", False)]
    withheld = Withheld(model.supports) if last and model.supports.dofs else None

    def timed(item: Any) -> Load:
        phase = getattr(item, "phase", "update")
        return item.add if clock is None else clock.timed(phase, item.add)

    began, busy = time.perf_counter(), sum(clock.seconds.values()) if clock else 0.0
    yield from central_difference(
        model.state,
        model.mass.petsc_vec,
        [timed(item) for item in acting if item not in last],
        model.hold if hold is None else hold,
        model.dt,
        t_end,
        moving=[item for item in acting if hasattr(item, "back")],
        dead=sum((item.nodal for item in dead), np.zeros(3 * model.domain.owned)),
        last=around(withheld, [timed(item) for item in last]),
        resumed=resumed,
        step=None if model.span is None else lambda: model.dt,
    )
    if clock is not None:
        others = sum(clock.seconds.values()) - busy
        clock.seconds["update"] += time.perf_counter() - began - others


def around(withheld: Withheld | None, loads: list[Load]) -> list[Load]:
    """Return loads with what supports bear taken away before them and given back behind them."""
    return loads if withheld is None else [withheld.take, *loads, withheld.give]


def central_difference(
    state: State,
    mass: PETSc.Vec,
    loads: Iterable[Load],
    hold: Callable[[dolfinx.la.Vector], None],
    dt: float,
    t_end: float,
    moving: Iterable[Any] = (),
    dead: npt.NDArray[np.float64] | None = None,
    resumed: bool = False,
    last: Iterable[Load] = (),
    step: Callable[[], float] | None = None,
) -> Iterator[State]:
    """Yield the state at every step from now to ``t_end``, forces and acceleration in place.

    Args:
        state: Start, with ``v`` at the same time as ``u``.
        mass: Lumped mass of the owned dofs [kg].
        loads: Callables that add their nodal forces.
        hold: Removes the held components from an acceleration.
        dt: Step [s].
        t_end: Last time [s].
        moving: What moves beside the mesh by ``back(dt)`` and ``step(dt)``, as point masses do.
        dead: Constant force on the owned dofs that every step starts from [N]; none: zero.
        last: Loads that read the sum of all others, complete on owned dofs, and add to these only.
        step: The step from the state that was yielded last, if it changes (:func:`retime`) [s].
        resumed: The state is one that was yielded, acceleration included: go on with its kick.
    """
    per_mass = 1.0 / mass.array_r  # a product costs a fifth of a quotient
    n = len(per_mass)
    constant = np.zeros(n) if dead is None else dead
    vectors = state.a, state.v.x, state.u.x
    owned = [pointer(x.array[:n]) for x in vectors]
    start, known = not resumed, resumed
    if not resumed:
        state.a.array[:n] = constant
    while True:
        if not known:
            state.a.array[n:] = 0.0
            for add in loads:
                add(state, state.a)
            state.a.scatter_reverse(dolfinx.la.InsertMode.add)
            for add in last:
                add(state, state.a)
            state.not_finite = lib.nd_accelerate(n, pointer(per_mass), owned[0])
            hold(state.a)
            if start:
                state.v.x.array[:n] -= dt / 2 * state.a.array[:n]  # from v at t to v at t - dt/2
                for item in moving:
                    item.back(dt / 2)
                start = False
            yield state
        known = False
        if step is not None:
            dt = step()
        if state.t > t_end - dt / 2:
            return
        lib.nd_advance(n, dt, pointer(constant), *owned)  # kick, drift, and a = constant
        for item in moving:
            item.step(dt)
        for x in vectors:
            x.petsc_vec.stateIncrease()  # PETSc remembers norms
        state.u.x.scatter_forward()
        state.v.x.scatter_forward()
        state.t += dt
        state.step += 1


def retime(model: "Model", dt: float) -> None:
    """Let a model go on with another step from the state that was yielded, in place.

    The velocity is brought from half an old step before t to half a new one, so that the kick over
    the new step brings it on by the mean of both: the velocity at t, and with it momentum and
    kinetic energy there, stay what they are.

    Args:
        model: The model, its acceleration in place.
        dt: The new step [s].
    """
    state, shift = model.state, (model.dt - dt) / 2
    n = 3 * model.domain.owned
    state.v.x.array[:n] += shift * state.a.array[:n]
    state.v.x.scatter_forward()
    model.dt = dt
    for item in (*model.items, model.hold):
        if hasattr(item, "back"):
            item.back(-shift)
        if hasattr(item, "retime"):
            item.retime(dt)


def due(t: float, interval: float, dt: float) -> bool:
    """Tell whether a time of the steps, of which some fall on its multiples, ends an interval.

    Args:
        t: The time [s].
        interval: The interval [s].
        dt: The step that led to it, or the one that follows [s].
    """
    return abs(t - round(t / interval) * interval) < dt / 2


def no_hold(a: Any) -> None:
    """Hold nothing."""
