# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact of a scene on its own: what ranks compute of it, and what they tell each other.

The pairs of the scene are set up on the cells behind their surfaces alone, and these move as rigid
bodies. They are brought together by half of the approach in ``[equilibrium]``: undeformed bodies
overlap over the area of Hertz's contact at half its approach. No forces act, so what is found is
how much work there is and how many nodes it takes, not a solution.
"""

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any

from mpi4py import MPI

import numpy as np

from contact.one_pass import Pass
from contact.options import IMPLICIT
from meshes.arrays import Array, Flags, Index
from meshes.domain import distribute
from meshes.hexmesh import HexMesh
from meshes.quality import cell_volumes, edge_lengths
from workflow.model.bodies import Bodies, isotropic
from workflow.model.contacts import pair
from workflow.model.supports import axle
from workflow.scene import Scene
from workflow.scene.settings import RigidWall

STEPS = 600  # longer than any interval between two searches
ROUNDS = 3  # of which the least is taken: other work only adds to processor time
SEARCH = ("track", "candidates")  # what ranks share of a search and of an exchange
EXCHANGE = ("update", "predict", "wandered")


@dataclass(frozen=True)
class ContactShare:
    """Contact of one step.

    Attributes:
        seconds: Processor time of it on one rank, searches counted in [s].
        searching: What of it searches take [s].
        shared: What of it ranks share: nodes read, closest points followed and searched for [s].
        tracked: Number of candidates of which they tell each other.
        nodes: HexMesh nodes that ranks tell each other of at every step.
        surface: Number of nodes that they tell of at a search.
        gathers: How often all passes do so in a step.
        searches: Share of the steps that search.
    """

    seconds: float = 0.0
    searching: float = 0.0
    shared: float = 0.0
    tracked: int = 0
    nodes: Index = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    surface: int = 0
    gathers: int = 0
    searches: float = 0.0


def contact_share(scene: Scene, mesh: HexMesh, placement: Any) -> ContactShare:
    """Return what the contact of a scene takes in a step; nothing for a scene without.

    Args:
        scene: The scene.
        mesh: Its mesh.
        placement: Where its wheel stands, None without one.
    """
    if not scene.contacts:
        return ContactShare()
    thin, kept = skin(scene, mesh)
    bodies, dt = Bodies(scene, distribute(thin, MPI.COMM_SELF)), step_of(scene, thin)
    mass = np.repeat(nodal_masses(scene, thin)[bodies.domain.nodes], 3)
    pairs = [pair(bodies, name, mass, dt) for name in scene.contacts]
    moved, velocity = (x[bodies.domain.nodes].ravel() for x in motion(scene, thin, placement))
    rounds = [timed(pairs, moved, velocity, dt) for _ in range(ROUNDS)]
    (spent, shared), searched = np.min([times for times, _ in rounds], axis=0), rounds[-1][1]
    tracking = float(np.median(spent[~searched]))
    sides = [side for one in pairs for side in one.passes]
    near = [
        side.stack.node[nodes[side.stack.dofs[nodes] >= 0]]
        for side in sides
        for nodes in (side.candidates.found.nodes,)
    ]
    return ContactShare(
        seconds=tracking + float((spent - tracking)[searched].sum()) / STEPS,
        searching=float((spent - tracking)[searched].sum()) / STEPS,
        shared=float(shared.mean()),
        tracked=sum(len(side.candidates.item) for side in sides),
        nodes=kept[np.concatenate(near)],
        surface=sum(int((side.stack.dofs >= 0).sum()) for side in sides),
        gathers=sum(2 if side.options.method in IMPLICIT else 1 for side in sides),
        searches=float(searched.mean()),
    )


def skin(scene: Scene, mesh: HexMesh) -> tuple[HexMesh, Index]:
    """Return the cells behind the contact surfaces as a mesh, and which nodes of it these are."""
    names = [entry.contactor for entry in scene.contacts.values()]
    names += [c.target for c in scene.contacts.values() if not isinstance(c.target, RigidWall)]
    tagged = np.isin(mesh.surfaces, mesh.tags(names))
    on = np.zeros(len(mesh.points), dtype=bool)
    on[mesh.facets[tagged]] = True
    behind = on[mesh.cells].any(axis=1)
    kept, cells = np.unique(mesh.cells[behind], return_inverse=True)
    number = np.full(len(mesh.points), -1, dtype=np.int64)
    number[kept] = np.arange(len(kept))
    thin = replace(
        mesh,
        points=mesh.points[kept],
        cells=cells.reshape(-1, 8),
        regions=mesh.regions[behind],
        facets=number[mesh.facets[tagged]],
        surfaces=mesh.surfaces[tagged],
    )
    return thin, kept


def step_of(scene: Scene, mesh: HexMesh) -> float:
    """Return the step that mass scaling asks for, or that of the shortest edge [s]."""
    if scene.mass_scaling is not None:
        return scene.mass_scaling.step
    constants = [isotropic(body.material.constants()) for body in scene.bodies.values()]
    fastest = max(material.dilatational_speed for material in constants)
    shortest = float(edge_lengths(mesh.points, mesh.cells).min())
    return scene.time.safety * shortest / float(fastest)


def nodal_masses(scene: Scene, mesh: HexMesh) -> Array:
    """Return the mass of each node, an eighth of every cell around it, shape ``(n,)`` [kg]."""
    mass = cell_volumes(mesh.points, mesh.cells)
    for body in scene.bodies.values():
        mass[np.isin(mesh.regions, mesh.tags(body.regions))] *= body.material.density
    nodal = np.bincount(mesh.cells.ravel(), np.repeat(mass / 8, 8), len(mesh.points))
    return np.asarray(nodal, dtype=np.float64)


def motion(scene: Scene, mesh: HexMesh, placement: Any) -> tuple[Array, Array]:
    """Return displacement and velocity of all nodes, rigid in each body, ``(n, 3)`` [m, m/s]."""
    u, v = np.zeros_like(mesh.points), np.zeros_like(mesh.points)
    approach = scene.equilibrium.approach if scene.equilibrium else {}
    for name, body in scene.bodies.items():
        nodes = mesh.nodes(*mesh.tags(body.regions))
        u[nodes] = 0.5 * np.array(approach.get(name, (0.0, 0.0, 0.0)))
        v[nodes] = body.velocity or (0.0, 0.0, 0.0)
        rolling = scene.rolling
        if rolling is not None and rolling.body == name:
            along = np.array([np.cos(rolling.travel), np.sin(rolling.travel), 0.0])
            spin = rolling.speed / placement.rolling_radius * axle(scene)
            arm = mesh.points[nodes] - np.array(placement.centre)
            v[nodes] = rolling.speed * along + np.cross(spin, arm)
    return u, v


def timed(pairs: list[Any], u: Array, v: Array, dt: float) -> tuple[Array, Flags]:
    """Return the processor time of each of ``STEPS`` steps [s], and whether it searched.

    Args:
        pairs: The contact pairs.
        u: Displacement at first, flat [m].
        v: Velocity, flat [m/s].
        dt: Step [s].

    Returns:
        Times of the whole contact and of what ranks share, ``(2, STEPS)``, and flags.
    """
    state = SimpleNamespace(t=0.0, step=1, v=SimpleNamespace(x=SimpleNamespace(array=v)))
    force = SimpleNamespace(array=np.zeros(u.size))
    sides = [side for one in pairs for side in one.passes]
    spent, searched, before = [], [], [None] * len(sides)
    with clocked(sides) as shared:
        for side in sides:
            side.reset()  # every round searches at the same steps
        for step in range(STEPS + 1):
            state.t = step * dt
            state.u = SimpleNamespace(x=SimpleNamespace(array=u + state.t * v))
            force.array[:], shared[0] = 0.0, 0.0
            start = time.process_time()
            for one in pairs:
                one.add(state, force)
            spent.append((time.process_time() - start, shared[0]))
            now = [side.candidates.found for side in sides]
            searched.append(any(a is not b for a, b in zip(now, before, strict=True)))
            before = now
    return np.array(spent[1:]).T, np.array(searched[1:])  # a run begins with the first search


@contextmanager
def clocked(sides: list[Pass]) -> Iterator[list[float]]:
    """Add up the processor time of what ranks share of passes, in a list of one number [s]."""
    total = [0.0]

    def clock(work: Callable[..., Any]) -> Callable[..., Any]:
        def during(*args: Any) -> Any:
            start = time.process_time()
            found = work(*args)
            total[0] += time.process_time() - start
            return found

        return during

    with ExitStack() as stack:
        for side in sides:
            search, exchange = side.candidates.search, side.candidates.exchange
            for owner, names in ((search, SEARCH), (exchange, EXCHANGE)):
                for name in names:
                    setattr(owner, name, clock(getattr(owner, name)))  # hides that of the class
                    stack.callback(delattr, owner, name)
        yield total
