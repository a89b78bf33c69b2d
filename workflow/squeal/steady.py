# SPDX-License-Identifier: LGPL-3.0-or-later
"""Steady sliding of a scene: at rest under its loads and its friction, with the slip of its start.

Friction presses as well as pulls: a block leans forward on it. So the normal forces are found with
it. Bodies that nothing resists in some rigid motion accelerate; their inertia balances the forces,
not ``equilibrium.hold``, which a run does not have either. A wheelset that rolls at constant speed
is driven by what holds its axle.
"""

from collections.abc import Collection

import numpy as np
from dolfinx import la
from scipy.linalg import eigh

from contact.friction import LawState, coefficients
from contact.one_pass import Pass
from contact.tangent import RestSprings
from meshes.arrays import Array
from workflow.model import Model
from workflow.model.state import State
from workflow.scene.settings import Equilibrium
from workflow.simulation import rolling
from workflow.simulation.at_rest import AtRest, Log
from workflow.simulation.elastic import Free
from workflow.simulation.guards import GuardError
from workflow.simulation.initial import rest
from workflow.squeal.pencil import pencil, times
from workflow.squeal.sliding import Face, faces, friction_of, in_motion

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
    settle(model, slip, sticking, log)
    return faces(model, slip, sticking)


def settle(model: Model, slip: Array | None, sticking: Collection[str], log: Log) -> None:
    """Let normal forces and friction come to rest together, in place.

    The method is that of a model at rest, whose contacts push along their normals: here they push
    aslant, by their friction.

    Args:
        model: The model at rest without friction, with the velocities of its bodies.
        slip: Velocity of contactors against targets, instead of theirs [m/s].
        sticking: Contacts that stick.
        log: Called with lines of progress.

    Raises:
        GuardError: if they do not.
    """
    # the solver of statics is imported where something slides
    from workflow.simulation.equilibrium import equilibrium

    settings, always, free = model.scene.equilibrium or Equilibrium(), np.zeros(0), None
    settings = settings.model_copy(update={"increments": 1})
    if model.scene.rolling is not None:  # at constant speed: what holds the axle drives it
        always = rolling.centrifugal(model)
    else:
        settings = settings.model_copy(update={"hold": []})
        free = free_motions(model, faces(model, slip, sticking))
    owned = 3 * model.domain.owned

    def resting() -> list[Face]:
        """Return the contacts that slide; the forces of springs in stick are not known at rest."""
        return [face for face in faces(model, slip, sticking) if not face.sticks]

    def friction(state: State, force: la.Vector) -> None:
        """Add the friction of what touches at present."""
        force.array[:owned] += friction_of(model, resting())

    stuck = [side for name in sticking for side in model.pairs[name].passes]

    def pushing(side: Pass, springs: RestSprings) -> Array:
        """Return the force of contacts per normal force."""
        if side in stuck:
            return springs.normal
        return slanted(side, springs, model, slip)

    problem = AtRest(model, settings, always, friction, free)
    try:
        equilibrium(problem, lambda line: log(f"sliding, {line}"), pushing)(False)
    except GuardError as error:
        raise GuardError(
            f"squeal: no steady sliding ({error}); does friction wedge the bodies, or lift them "
            "off? Try a smaller coefficient"
        ) from None


def slanted(side: Pass, springs: RestSprings, model: Model, slip: Array | None) -> Array:
    """Return normal less friction of contacts near touch, shape ``(m, 3)``; collective."""
    n, c = springs.normal, springs.number
    w = side.velocity(c, model.state) if slip is None else np.broadcast_to(slip, n.shape)
    w = w - np.einsum("ma,ma->m", w, n)[:, None] * n
    speed = np.linalg.norm(w, axis=1)
    pressure = springs.stiffness * np.maximum(0.0, -springs.gap) / side.stack.area[c]
    state = LawState(model.scene.time.end, 1e-9, side.stack.node[c], np.full(len(c), np.nan))
    friction = coefficients(side.options.law, speed, pressure, state)
    along = w / np.maximum(speed, 1e-300)[:, None]
    return np.asarray(n - friction[:, None] * along)


def free_motions(model: Model, found: list[Face]) -> Free:
    """Return the rigid motions of bodies that contacts, springs and supports leave alone."""
    comm, small = model.domain.msh.comm, pencil(model, found)
    n = 3 * model.domain.owned
    mass = model.mass.array[:n]
    moves = np.concatenate([rigid(model, name) for name in model.scene.bodies])
    moves /= np.sqrt(comm.allreduce((moves**2 * mass).sum(axis=1)))[:, None]
    y = (moves * mass) @ small.T[:n]  # what supports leave of them
    whole = moves * mass @ moves.T
    stiff, held = y @ times(small.K, y).T, whole - y @ y.T
    stiff, held, whole = comm.allreduce(np.array([stiff, held, whole]))
    stiff = (stiff + stiff.T) / 2 + (HELD * 2 * np.pi * LOOSE) ** 2 * held
    values, vectors = comm.bcast(eigh(stiff, whole))
    return Free(comm, mass, moves.T @ vectors[:, values < (2 * np.pi * LOOSE) ** 2])


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
