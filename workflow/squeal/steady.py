# SPDX-License-Identifier: LGPL-3.0-or-later
"""Steady sliding of a scene: at rest under its loads and its friction, with the slip of its start.

Friction presses as well as pulls: a block leans forward on it. So the normal forces are found with
it. Bodies that nothing resists in some rigid motion accelerate; their inertia balances the forces,
not ``equilibrium.hold``, which a run does not have either. A wheelset that rolls at constant speed
is driven by what holds its axle.
"""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from dolfinx import la
from scipy.linalg import eigh

from contact.friction import LawState, coefficients
from contact.one_pass import Pass
from contact.sliding import slips
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
    rubbing = Rubbing(model, slip, frozenset(sticking))
    problem = AtRest(model, settings, always, rubbing.friction, free)
    try:
        equilibrium(problem, lambda line: log(f"sliding, {line}"), rubbing.pushing)(False)
    except GuardError as error:
        raise GuardError(
            f"squeal: no steady sliding ({error}); does friction wedge the bodies, or lift them "
            "off? Try a smaller coefficient"
        ) from None


@dataclass(frozen=True, eq=False)
class Rubbing:
    """Friction of contacts that slide, as statics takes it.

    Attributes:
        model: The model, with the velocities of its bodies.
        slip: Velocity of contactors against targets, instead of theirs [m/s].
        sticking: Contacts that stick: the forces of their springs are not known at rest.
    """

    model: Model
    slip: Array | None
    sticking: frozenset[str]

    def friction(self, state: State, force: la.Vector) -> None:
        """Add the friction of what touches at present."""
        slide = [f for f in faces(self.model, self.slip, self.sticking) if not f.sticks]
        force.array[: 3 * self.model.domain.owned] += friction_of(self.model, slide)

    def pushing(self, side: Pass, springs: RestSprings) -> Array:
        """Return what contacts near touch push with per normal force, ``(m, 3)``; collective."""
        n, c = springs.normal, springs.number
        if any(side in self.model.pairs[name].passes for name in self.sticking):
            return n
        along, speed = slips(side, c, n, self.model.state, self.slip)
        pressure = springs.stiffness * np.maximum(0.0, -springs.gap) / side.stack.area[c]
        t, node = self.model.scene.time.end, side.stack.node[c]
        state = LawState(t, 1e-9, node, np.full(len(c), np.nan))
        friction = coefficients(side.options.law, speed, pressure, state)
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
