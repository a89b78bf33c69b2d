# SPDX-License-Identifier: LGPL-3.0-or-later
"""Steady sliding of a scene: at rest under its loads and its friction, with the slip of its start.

Friction presses as well as pulls: a block leans forward on it. So the normal forces are found with
it. Bodies that nothing resists in some rigid motion accelerate; their inertia balances the forces,
not ``equilibrium.hold``, which a run does not have either.
"""

from collections.abc import Callable, Collection
from dataclasses import replace

from petsc4py import PETSc

import numpy as np
from dolfinx import la
from scipy.linalg import eigh

from meshes.arrays import Array
from workflow.model import Model
from workflow.model.state import State
from workflow.scene.settings import Equilibrium
from workflow.simulation import rolling
from workflow.simulation.at_rest import AtRest, Log
from workflow.simulation.guards import GuardError
from workflow.simulation.initial import rest
from workflow.squeal.pencil import pencil, summed, times
from workflow.squeal.sliding import Face, faces, friction_of, in_motion

FREED = 20  # solves at most, each of which leaves a hundredth of the free motion or less
SHORTEST = 0.02  # part of a step of Newton's method
LOOSE = 10.0  # Hz: rigid motions that are resisted less are free
HELD = 1e3  # that of held ones over it


def steady(
    model: Model,
    slip: Array | None = None,
    sticking: Collection[str] = (),
    log: Log = lambda line: None,
) -> list[Face]:
    """Bring a model to steady sliding, in place, and return its contacts; collective.

    Args:
        model: The model.
        slip: Velocity of contactors against targets, instead of that of the start [m/s].
        sticking: Contacts that stick.
        log: Called with lines of progress.

    Raises:
        SceneError: if nothing touches or slides.
        GuardError: if there is no such state.
    """
    rest(model, log)
    in_motion(model)

    def resting() -> list[Face]:
        """Return the contacts without springs in stick, whose forces are not known at rest."""
        return [
            replace(face, contacts=face.contacts.stuck(0.0)) if face.sticks else face
            for face in faces(model, slip, sticking)
        ]

    settle(model, resting, log)
    return faces(model, slip, sticking)


def settle(model: Model, find: Callable[[], list[Face]], log: Log) -> None:
    """Let normal forces and friction come to rest together, in place: Newton's method.

    Args:
        model: The model at rest without friction.
        find: Returns its contacts.
        log: Called with lines of progress.

    Raises:
        GuardError: if they do not.
    """
    n, comm, u = 3 * model.domain.owned, model.domain.msh.comm, model.state.u.x
    settings = (model.scene.equilibrium or Equilibrium()).model_copy(update={"hold": []})
    always = rolling.centrifugal(model) if model.scene.rolling is not None else np.zeros(n)
    load, inertia = always.copy(), Inertia(model, find())
    problem = AtRest(model, settings, load, inertia.add)

    def left() -> tuple[list[Face], Array, float]:
        """Return contacts, forces out of balance [N], and their size over the loads."""
        found = find()
        load[:] = always + friction_of(model, found)
        force = problem.out_of_balance().array[:n].copy()
        return found, force, float(np.sqrt(comm.allreduce(force @ force))) / problem.load_size()

    found, force, size = left()
    for k in range(settings.max_iterations + 1):
        log(f"sliding {k}: residual {size:.2e}, {sum(len(f.patch) for f in found)} contacts")
        if size <= settings.tolerance:
            return
        before, step = u.array[:n].copy(), newton_step(model, found, inertia, force)
        share, last = 1.0, size
        while True:
            u.array[:n] = before + share * step
            u.scatter_forward()
            found, force, size = left()
            if size < last or share < SHORTEST:
                break
            share /= 2
    raise GuardError(
        f"squeal: no steady sliding: residual {size:.1e} of the load after "
        f"{settings.max_iterations} iterations, expected {settings.tolerance:.0e}; does friction "
        "wedge the bodies, or lift them off? Try a smaller coefficient"
    )


def newton_step(model: Model, found: list[Face], inertia: "Inertia", force: Array) -> Array:
    """Return the displacements of the owned dofs that forces out of balance ask for [m].

    Friction that changes with the normal forces has another inertia to balance it: what moves the
    bodies freely is taken off the forces, and what is left off the displacements.
    """
    small, n, comm = pencil(model, found), len(force), model.domain.msh.comm
    A, shift = summed(small.K, small.K_f, 1.0), (2 * np.pi * LOOSE) ** 2
    A.shift(shift)
    pc = PETSc.PC().create(A.getComm())
    pc.setOperators(A)
    pc.setType("lu")
    pc.setFactorSolverType("mumps")
    x, y = A.createVecRight(), A.createVecLeft()
    free = (inertia.loose.T * inertia.mass) @ small.T[:n]
    x.array[:] = force @ small.T[:n]
    first = 0.0
    for _ in range(FREED):
        pc.apply(x, y)
        along = comm.allreduce(free @ y.array_r)
        first = max(first, float(np.abs(along).max(initial=0.0)))
        if np.abs(along).max(initial=0.0) <= 1e-12 * first:
            break
        x.array[:] -= shift * (along @ free)
    step = (small.T @ y.array_r)[:n]
    pc.destroy()
    return inertia.without(np.asarray(step))


class Inertia:
    """Inertia of bodies in the rigid motions that nothing resists: it balances all other forces.

    Attributes:
        loose: These motions, orthogonal in mass, shape ``(3 owned, k)`` [kg^-1/2].
        mass: Of each owned dof, shape ``(3 owned,)`` [kg].
    """

    def __init__(self, model: Model, found: list[Face]) -> None:
        """Find them: rigid motions of bodies that contacts, springs and supports leave alone."""
        self.comm, small = model.domain.msh.comm, pencil(model, found)
        n = 3 * model.domain.owned
        self.mass = model.mass.array[:n]
        moves = np.concatenate([rigid(model, name) for name in model.scene.bodies])
        moves /= np.sqrt(self.comm.allreduce((moves**2 * self.mass).sum(axis=1)))[:, None]
        y = (moves * self.mass) @ small.T[:n]  # what supports leave of them
        whole = moves * self.mass @ moves.T
        stiff, held = y @ times(small.K, y).T, whole - y @ y.T
        stiff, held, whole = self.comm.allreduce(np.array([stiff, held, whole]))
        stiff = (stiff + stiff.T) / 2 + (HELD * 2 * np.pi * LOOSE) ** 2 * held
        values, vectors = self.comm.bcast(eigh(stiff, whole))
        self.loose = moves.T @ vectors[:, values < (2 * np.pi * LOOSE) ** 2]

    def add(self, state: State, force: la.Vector) -> None:
        """Take away what accelerates the bodies, from the sum of all other forces."""
        n = len(self.mass)
        along = self.comm.allreduce(self.loose.T @ force.array[:n])
        force.array[:n] -= self.mass * (self.loose @ along)

    def without(self, u: Array) -> Array:
        """Return a displacement of the owned dofs without these motions [m]."""
        return np.asarray(u - self.loose @ self.comm.allreduce(self.loose.T @ (self.mass * u)))


def rigid(model: Model, name: str) -> Array:
    """Return the rigid motions of a body about its centre of mass, shape ``(6, 3 owned)``.

    Three shifts, then three turns.
    """
    comm, dofs = model.domain.msh.comm, model.bodies.dofs(name)
    mass = model.mass.array[::3][dofs, None]
    x = model.domain.V.tabulate_dof_coordinates()[dofs]
    total = comm.allreduce(float(mass.sum()))
    r = x - comm.allreduce((mass * x).sum(axis=0)) / total
    out = np.zeros((6, model.domain.owned, 3))
    for k, axis in enumerate(np.eye(3)):
        out[k, dofs] = axis
        out[3 + k, dofs] = np.cross(axis, r)
    return out.reshape(6, -1)
