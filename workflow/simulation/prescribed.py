# SPDX-License-Identifier: LGPL-3.0-or-later
"""Prescribed motion: bodies carried by a surface in steady rigid motion, supports that move.

A way that changes is followed exactly: the acceleration of a step is the difference of the places
around it, so that nodes are on their way at every step and have its speed at the end of a ramp.
"""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import la

from forms.loads import smooth_step
from forms.rank_sums import gathered, own_part
from meshes.arrays import Array
from workflow.model import Model
from workflow.model.regions import surface_nodes
from workflow.model.state import State
from workflow.model.supports import Supports, supports
from workflow.scene.settings import Driven, Support
from workflow.simulation.rolling import convected

NOWHERE = np.zeros(3)


def difference[T: (float, Array)](place: Callable[[float], T], t: float, dt: float) -> T:
    """Return the acceleration that keeps central differences on a way from rest [m/s²].

    Args:
        place: The way by time [m].
        t: A time of the steps, which begin with 0 [s].
        dt: Step [s].
    """
    if t < dt / 2:  # the first step: at rest before it
        return 2.0 / dt**2 * (place(dt) - place(0.0))
    return (place(t + dt) - 2.0 * place(t) + place(t - dt)) / dt**2


class Carried:
    """A surface that keeps to a rigid motion, and the work of the forces that keep it there.

    Attributes:
        work: Work of this rank's nodes since the first step [J].
    """

    def __init__(self, model: Model, body: str, entry: Driven) -> None:
        self.body, self.entry, self.dt, self.work = body, entry, model.dt, 0.0
        domain = model.domain
        local = domain.local_dofs(surface_nodes(domain, entry.surface))
        self.dofs = local[local >= 0]
        self.velocity, self.spin = np.array(entry.velocity), np.array(entry.spin)
        self.mass = model.mass.array[::3][self.dofs, None]
        self.reference = domain.V.tabulate_dof_coordinates()
        # the whole body was moved by the static solve, its axis with it
        u = model.state.u.x.array.reshape(-1, 3)[self.dofs]
        comm = domain.msh.comm
        shift = comm.allreduce(u.sum(axis=0)) / comm.allreduce(len(self.dofs))
        self.centre = np.array(entry.centre) + shift
        self.state = model.state
        self.index = 3 * self.dofs.astype(np.int64)[:, None] + np.arange(3)
        self.arm = self.reference[self.dofs] - self.centre
        wx, wy, wz = self.spin
        skew = np.array([[0, -wz, wy], [wz, 0, -wx], [-wy, wx, 0]])
        self.turn, self.spins = (skew @ skew).T, bool(self.spin.any())
        self.still = not self.entry.shift_time
        self.reaction: Array | None = None

    def rigid(self, dofs: npt.NDArray[np.int32]) -> Array:
        """Return the velocity of the rigid motion at nodes at the start, ``(n, 3)`` [m/s].

        Material that flows through the pattern is where it would be without it.
        """
        if self.entry.steady_start:
            arm = self.reference[dofs] - self.entry.centre
        else:
            arm = self.places(dofs) - self.centre
        return np.asarray(self.velocity + np.cross(self.spin, arm))

    def flow(self, x: Any) -> Any:
        """Return the same at the reference places ``x``, as a UFL vector."""
        V, omega, centre = map(
            ufl.as_vector, (self.entry.velocity, self.entry.spin, self.entry.centre)
        )
        return V + ufl.cross(omega, x - centre)

    def places(self, dofs: npt.NDArray[np.int32]) -> Array:
        """Return the present places of nodes, shape ``(n, 3)`` [m]."""
        return np.asarray(self.reference[dofs] + self.state.u.x.array.reshape(-1, 3)[dofs])

    def shift(self, t: float) -> Array:
        """Return what of the shift is done: a quintic from rest to rest, shape ``(3,)`` [m]."""
        return np.asarray(np.array(self.entry.shift) * smooth_step(t / self.entry.shift_time))

    def steer(self, a: la.Vector, free: Array) -> None:
        """Set the acceleration of the rigid motion, in place, and count the work so far.

        It is ``ω × (ω × r)`` and that of the shift; the reaction, mass times what it differs from
        the free acceleration, does the work ``(R₋ + R) / 2 · dt v`` on the way from the last step.
        """
        state, index = self.state, self.index
        moved, pull = NOWHERE, NOWHERE
        if not self.still:
            moved, pull = self.shift(state.t), difference(self.shift, state.t, self.dt)
        if self.spins:
            held = state.u.x.array[index]
            held += self.arm - (self.velocity * state.t + moved)
            held = held @ self.turn + pull
        else:
            held = np.broadcast_to(pull, index.shape)
        a.array[index] = held
        reaction = held - free
        reaction *= self.mass
        if self.reaction is not None:
            both = np.add(self.reaction, reaction, out=self.reaction)
            self.work += self.dt / 2 * float(np.vdot(both, state.v.x.array[index]))
        self.reaction = reaction


class Hold:
    """The supports of a scene with prescribed motion: a callable in place of ``model.supports``.

    Attributes:
        carried: The driven surfaces.
        moved: The supports that move.
    """

    def __init__(self, model: Model) -> None:
        self.supports, self.domain = model.supports, model.domain
        self.carried = [Carried(model, *entry) for entry in model.scene.driven.items()]
        self.moved = moved(model)

    def __call__(self, a: la.Vector) -> None:
        """Impose all held and driven components of an acceleration, in place."""
        free = [a.array[c.index] for c in self.carried]
        loose = [m.free(a) for m in self.moved]
        self.supports(a)
        for mover, along in zip(self.moved, loose, strict=True):
            mover.steer(a, along)
        for carried, before in zip(self.carried, free, strict=True):
            carried.steer(a, before)

    def retime(self, dt: float) -> None:
        """Go on with another step [s].

        The way of a moved surface is then off by the third derivative of its place times a sixth
        of the difference of the squares of both steps in speed.
        """
        for carried in self.carried:
            carried.dt = dt
        for mover in self.moved:
            mover.dt = dt

    def energy(self, state: State) -> dict[str, float]:
        """Return the work of what holds the nodes on their way [J]; collective."""
        work = sum(c.work for c in self.carried) + sum(m.work for m in self.moved)
        return {"external_work": self.domain.msh.comm.allreduce(work)}

    def memory(self) -> dict[str, Array]:
        """Return works, reactions and centres; collective."""
        comm, arrays = self.domain.msh.comm, {}
        for i, carried in enumerate(self.carried):
            local = np.zeros(3 * self.domain.owned)
            local.reshape(-1, 3)[carried.dofs] = carried.reaction
            arrays[f"driven/{i}/reaction"] = self.domain.gather(local)
            arrays[f"driven/{i}/centre"] = carried.centre
            arrays[f"driven/{i}/work"] = gathered(comm, carried.work)
        for i, mover in enumerate(self.moved):
            arrays[f"moved/{i}/work"] = gathered(comm, mover.work)
            arrays[f"moved/{i}/reaction"] = gathered(comm, mover.reaction)
        return arrays

    def restore(self, memory: Mapping[str, Array]) -> None:
        """Go on from what :meth:`memory` returned."""
        comm = self.domain.msh.comm
        for i, carried in enumerate(self.carried):
            carried.centre = memory[f"driven/{i}/centre"]
            carried.arm = carried.reference[carried.dofs] - carried.centre
            nodes = self.domain.nodes[carried.dofs]
            carried.reaction = memory[f"driven/{i}/reaction"][nodes]
            carried.work = own_part(comm, memory[f"driven/{i}/work"])
        for i, mover in enumerate(self.moved):
            mover.work = own_part(comm, memory[f"moved/{i}/work"])
            mover.reaction = own_part(comm, memory[f"moved/{i}/reaction"])


def hold_of(model: Model) -> Supports | Hold:
    """Return what holds a model from time zero on: its supports, and prescribed motion if any."""
    scene = model.scene
    moving = scene.driven or any(entry.velocity for entry in scene.supports)
    return Hold(model) if moving else model.supports


def start(model: Model) -> None:
    """Set the velocities of driven bodies at time zero and what holds them from now on."""
    model.hold = hold = hold_of(model)
    if not isinstance(hold, Hold):
        return
    v = model.state.v.x.array.reshape(-1, 3)
    flows, x = {}, ufl.SpatialCoordinate(model.domain.msh)
    for carried in hold.carried:
        dofs = model.bodies.dofs(carried.body)
        v[dofs] = carried.rigid(dofs)
        if carried.entry.steady_start:
            flows[carried.body] = carried.flow(x)
    if flows:
        v[: model.domain.owned] += convected(model, flows)
    model.supports(model.state.v.x)
    for carried in hold.carried:
        v[carried.dofs] = carried.rigid(carried.dofs)


def way(entry: Support, t: float) -> float:
    """Return how far a moved support has come at a time [m]."""
    s = (t - entry.begin) / entry.ramp
    if s >= 1:
        return entry.velocity * entry.ramp * (s - 0.5)
    return entry.velocity * entry.ramp * max(s, 0.0) ** 4 * (2.5 - 3 * s + s**2)


class Moved:
    """Nodes held along a direction whose speed there changes once, and the work of what does it.

    From ``begin`` on and within ``ramp`` the speed goes from 0 to ``velocity`` as
    ``s³ (10 - 15 s + 6 s²)``, so that acceleration and jerk are continuous.

    Attributes:
        work: Work of this rank's nodes since the first step [J].
        reaction: Force that holds them along the direction, of this rank [N].
    """

    def __init__(self, model: Model, entry: Support) -> None:
        found = supports([entry], model.scene, model.domain)
        self.entry, self.state, self.dt = entry, model.state, model.dt
        self.dofs, self.direction = found.dofs[0], found.directions[0]
        self.mass = model.mass.array[::3][self.dofs]
        self.work, self.reaction = 0.0, float("nan")

    def acceleration(self, t: float) -> float:
        """Return the prescribed acceleration at a step [m/s²]; none off the ramp."""
        begin, dt = self.entry.begin, self.dt
        on = begin - dt < t < begin + self.entry.ramp + dt
        return difference(partial(way, self.entry), t, dt) if on else 0.0

    def free(self, a: la.Vector) -> Array:
        """Return the acceleration that the other forces give the nodes, shape ``(n,)`` [m/s²]."""
        return np.asarray(a.array.reshape(-1, 3)[self.dofs] @ self.direction)

    def steer(self, a: la.Vector, free: Array) -> None:
        """Add the prescribed acceleration where the supports have left none, and count the work.

        Args:
            a: Acceleration, its held component gone, in place [m/s²].
            free: What :meth:`free` returned before.
        """
        held = self.acceleration(self.state.t)
        if held:
            a.array.reshape(-1, 3)[self.dofs] += held * self.direction
        reaction = float(self.mass @ (held - free))
        if len(self.dofs) and not np.isnan(self.reaction):
            speed = self.state.v.x.array[3 * self.dofs[0] :][:3] @ self.direction
            self.work += self.dt / 2 * (self.reaction + reaction) * float(speed)
        self.reaction = reaction


def moved(model: Model) -> list[Moved]:
    """Return the supports of a scene that move."""
    return [Moved(model, entry) for entry in model.scene.supports if entry.velocity]
