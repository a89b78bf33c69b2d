# SPDX-License-Identifier: LGPL-3.0-or-later
"""Steady sliding of a scene: at rest under its loads and its friction, with the slip of its start.

Friction presses as well as pulls: a block leans forward on it. So the normal forces are found with
it, by static solves between which the friction follows them. What only ``equilibrium.hold`` keeps
in place accelerates in a run; its inertia takes the place of those supports.
"""

from collections.abc import Callable, Collection
from dataclasses import dataclass

import numpy as np

from contact.one_pass import Pass
from contact.sliding import Sliding, sliding
from meshes.arrays import Array, Index
from workflow.model import Model
from workflow.model.regions import body_at, surface_nodes
from workflow.model.supports import supports
from workflow.scene.scene import SceneError
from workflow.scene.settings import Equilibrium
from workflow.simulation import rolling
from workflow.simulation.at_rest import AtRest, Log, held_dofs
from workflow.simulation.equilibrium import equilibrium
from workflow.simulation.guards import GuardError
from workflow.simulation.initial import rest, set_in_motion
from workflow.simulation.secants import Secants

ROUNDS = 40  # of friction and normal forces; few are needed while friction is below one
SETTLED = 1e-5  # change of friction and inertia over themselves


@dataclass(frozen=True, eq=False)
class Face:
    """One pass of a contact in steady sliding.

    Attributes:
        name: Contact of the scene.
        contacts: Its contacts.
        patch: Patch of each, from 0, shape ``(m,)``.
        sticks: Whether it was told to stick.
    """

    name: str
    contacts: Sliding
    patch: Index
    sticks: bool

    @property
    def patches(self) -> int:
        """Number of its patches."""
        return int(self.patch.max(initial=-1)) + 1


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

    def find() -> list[Face]:
        return faces(model, slip, sticking)

    settle(model, find, log)
    return find()


def in_motion(model: Model) -> None:
    """Set the velocities of the start, bodies on moved supports with the speed they come to."""
    set_in_motion(model)
    v = model.state.v.x
    for entry in model.scene.supports:
        if entry.velocity:
            node = int(surface_nodes(model.domain, entry.surface)[0])
            n = supports([entry], model.scene, model.domain).directions[0]
            dofs = model.bodies.dofs(body_at(model.scene, model.domain.source, node))
            v.array.reshape(-1, 3)[dofs] += entry.velocity * n
    v.scatter_forward()


def faces(model: Model, slip: Array | None, sticking: Collection[str]) -> list[Face]:
    """Return the contacts of the present state that bear forces; collective.

    Raises:
        SceneError: if nothing touches or slides.
    """
    found = []
    for name, pair in model.pairs.items():
        for side in pair.passes:
            try:
                on = sliding(side, model.state, model.scene.time.end, slip)
            except ValueError as error:
                raise SceneError(
                    f"contacts.{name}: {error} at the start of the run; expected a velocity of "
                    "bodies.NAME or driven.NAME, or a slip by --slip VX,VY,VZ"
                ) from error
            if name in sticking:
                on = on.stuck(side.options.tangential)
            if len(on.number):
                found.append(Face(name, on, patches_of(side, on.number), name in sticking))
    if not found:
        raise SceneError(
            f"squeal: none of the contacts {', '.join(model.pairs)} touches at rest; expected "
            "loads, or an equilibrium.approach, that press the bodies together"
        )
    return found


def patches_of(side: Pass, number: Index) -> Index:
    """Return the patch of each contact of a pass, shape ``(m,)``."""
    foot, on = side.footprint(), side.pressed().c
    patch = np.zeros(len(side.contactor.nodes), dtype=np.int64)
    patch[on] = foot.patch
    return patch[side.stack.nearest[number]]


def settle(model: Model, find: Callable[[], list[Face]], log: Log) -> None:
    """Let normal forces and friction come to rest together, in place.

    Args:
        model: The model at rest without friction.
        find: Returns its contacts.
        log: Called with lines of progress.

    Raises:
        GuardError: if they do not.
    """
    n, comm = 3 * model.domain.owned, model.domain.msh.comm
    settings = model.scene.equilibrium or Equilibrium()
    always = rolling.centrifugal(model) if model.scene.rolling is not None else np.zeros(n)
    own, load, secants = np.zeros((2, n)), always.copy(), Secants(comm)  # friction, inertia
    problem = AtRest(model, settings, load)
    solve = equilibrium(problem, log)
    for _ in range(ROUNDS):
        step = np.array([friction_of(model, find()) - own[0], -unborne(model, problem, settings)])
        size = [float(np.sqrt(comm.allreduce((x**2).sum()))) for x in (step, own + step)]
        if size[0] <= SETTLED * size[1]:
            return
        log(f"sliding: friction and inertia change by {size[0] / size[1]:.1e} of themselves")
        own += secants.improved(own.ravel(), step.ravel()).reshape(2, n)
        load[:] = always + own.sum(axis=0)
        solve(False)
    raise GuardError(
        f"squeal: friction and normal forces do not settle within {ROUNDS} rounds; does the "
        "friction wedge the bodies, or lift them off? Try a smaller coefficient"
    )


def friction_of(model: Model, found: list[Face]) -> Array:
    """Return the friction of sliding contacts on the owned dofs, shape ``(3 owned,)`` [N]."""
    force = np.zeros((model.domain.owned, 3))
    for c in (face.contacts for face in found):
        pull = -(c.friction * c.normal_force)[:, None] * c.along
        nodes = c.nodes.ravel()
        dofs = np.where(nodes >= 0, model.domain.local_dofs(nodes), -1)
        share = (c.weight[:, :, None] * pull[:, None]).reshape(-1, 3)
        np.add.at(force, dofs[dofs >= 0], share[dofs >= 0])
    return force.ravel()


def unborne(model: Model, problem: AtRest, settings: Equilibrium) -> Array:
    """Return what ``equilibrium.hold`` bears, spread over each body as its inertia would be [N].

    Args:
        model: The model.
        problem: It at rest.
        settings: With those supports.
    """
    held = problem.held
    problem.held = held_dofs(model, settings.model_copy(update={"hold": []}))
    only = np.setdiff1d(held, problem.held)
    borne = np.zeros(3 * model.domain.owned)
    borne[only] = problem.out_of_balance().array[only]
    problem.held = held
    spread, comm = np.zeros((model.domain.owned, 3)), model.domain.msh.comm
    mass = model.mass.array.reshape(-1, 3)
    for name in model.scene.bodies:
        dofs = model.bodies.dofs(name)
        force = comm.allreduce(borne.reshape(-1, 3)[dofs].sum(axis=0))
        spread[dofs] = mass[dofs] * force / comm.allreduce(mass[dofs].sum(axis=0))
    return spread.ravel()
