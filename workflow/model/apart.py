# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact surfaces as they are meshed: bodies apart, walls in front, contactors fine enough.

A node is too deep where it lies in a cell of the target's body, or behind a wall, and is farther
from the target than :data:`workflow.model.geometry.OVERLAP` of a cell. The far sides of whole skins
are no overlap, nor are nodes flush with a neighbour.
"""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from meshes.arrays import Array, Index
from meshes.hexmesh import HexMesh
from meshes.inside import distance_to_quads, inside
from workflow.model.cost import Cost
from workflow.model.geometry import OVERLAP, cell_size, mesh_of
from workflow.model.regions import owners
from workflow.scene import Scene, SceneError
from workflow.scene.settings import RigidWall

if TYPE_CHECKING:
    from contact.surface import Surface

EASY = 300_000  # cells of a shape that is meshed to be looked at: a second
COARSE = 1.5  # cells of the contactor over those of the target, from which on it is told


def check_contacts(scene: Scene, cost: Cost, mesh: HexMesh | None) -> Iterator[str]:
    """Yield what is doubtful about the contacts of a scene before there is a model.

    Shapes that are quickly meshed are, to be looked at; a wheel stands on its rail without gap or
    overlap.

    Args:
        scene: The scene.
        cost: What its run takes.
        mesh: Its mesh, if it is there already.

    Raises:
        SceneError: as :func:`check_surfaces`.
    """
    if mesh is None and scene.mesh.kind != "wheel-on-rail" and cost.cells <= EASY:
        mesh, _ = mesh_of(scene)
    if mesh is None or not scene.contacts:
        return
    from contact.surface import meshed, rigid_plane  # for scenes with contact

    for name, contact in scene.contacts.items():
        contactor, target = meshed(mesh, mesh.tag(contact.contactor)), contact.target
        if isinstance(target, RigidWall):
            other = rigid_plane(target.origin, target.normal, target.half_width)
        else:
            other = meshed(mesh, mesh.tag(target))
        sides = [(contactor, other), (other, contactor)]
        yield from check_surfaces(scene, mesh, name, sides[: 1 + contact.two_pass])


def check_surfaces(
    scene: Scene, mesh: HexMesh, name: str, sides: list[tuple["Surface", "Surface"]]
) -> Iterator[str]:
    """Yield what is doubtful about the surfaces of a contact.

    Args:
        scene: The scene.
        mesh: Its mesh.
        name: Name of the contact.
        sides: Contactor and target of each pass.

    Raises:
        SceneError: if bodies overlap or share nodes, or the contactor cannot meet the target.
    """
    for contactor, target in sides:
        _check_apart(scene, mesh, name, contactor, target)
    nodes_touch = scene.contacts[name].points == "nodes"
    if len(sides) == 1 and nodes_touch and not sides[0][1].rigid:
        yield from _coarse(name, *sides[0])


def _check_apart(
    scene: Scene, mesh: HexMesh, name: str, contactor: "Surface", target: "Surface"
) -> None:
    """Raise SceneError for nodes that two surfaces share, and for the deepest that overlaps."""
    limit = OVERLAP * cell_size(scene, mesh)
    key = f"contacts.{name}"
    if len(shared := np.intersect1d(contactor.nodes, target.nodes)):
        x, y, z = mesh.points[shared[0]]
        raise SceneError(
            f"{key}: contactor and target share {len(shared)} nodes, the first is {shared[0]} "
            f"(x = {x:.5f}, y = {y:.5f}, z = {z:.5f} m); expected surfaces that can part"
        )
    depth = _behind(contactor, target) if target.rigid else _within(scene, mesh, contactor, target)
    worst = int(np.argmax(depth))
    if depth[worst] > limit:
        x, y, z = contactor.reference[worst]
        raise SceneError(
            f"{key}: bodies overlap at the start by {depth[worst]:.3e} m at node "
            f"{contactor.nodes[worst]} (x = {x:.5f}, y = {y:.5f}, z = {z:.5f} m); expected at most "
            f"{limit:.1e} m"
        )


def _behind(contactor: "Surface", wall: "Surface") -> Array:
    """Return how far nodes are behind a wall, within its edges, shape ``(n,)`` [m]."""
    corner = wall.reference[wall.facets[0]]
    along, up = corner[1] - corner[0], corner[3] - corner[0]
    normal = np.cross(along, up)
    way = contactor.reference - corner[0]
    over = np.ones(len(way), dtype=bool)
    for side in (along, up):
        share = way @ side / (side @ side)
        over &= (share >= 0) & (share <= 1)
    return np.where(over, -way @ normal / np.linalg.norm(normal), -np.inf)


def _within(scene: Scene, mesh: HexMesh, contactor: "Surface", target: "Surface") -> Array:
    """Return how deep nodes are in the cells behind a target, shape ``(n,)`` [m]."""
    depth = np.full(len(contactor.nodes), -np.inf)
    deep = inside(mesh.points, _behind_facets(scene, mesh, target), contactor.nodes)
    if deep.any():
        corners = target.reference[target.facets]
        depth[deep] = distance_to_quads(contactor.reference[deep], corners)
    return depth


def _behind_facets(scene: Scene, mesh: HexMesh, target: "Surface") -> Index:
    """Return the cells of the bodies that a target belongs to, shape ``(c, 8)``."""
    touched = np.isin(mesh.cells, target.nodes).any(axis=1)
    owner = owners(scene)
    bodies = {owner[mesh.name(int(tag))] for tag in np.unique(mesh.regions[touched])}
    tags = [tag for body in bodies for tag in mesh.tags(scene.bodies[body].regions)]
    return mesh.cells[np.isin(mesh.regions, tags)]


def _coarse(name: str, contactor: "Surface", target: "Surface") -> Iterator[str]:
    """Yield a line if nodes of the contactor are so far apart that the target is not felt between.

    Raises:
        SceneError: if the target as a whole fits between two of them.
    """
    from contact.search import typical_edge  # for scenes with contact of two bodies

    mine, its = typical_edge(contactor), typical_edge(target)
    across = np.sort(np.ptp(target.reference, axis=0))[1]
    remedy = f"expected them the other way round, or contacts.{name}.two_pass = true"
    if mine > across:
        raise SceneError(
            f"contacts.{name}.contactor: its nodes are {mine:.2e} m apart, the target is "
            f"{across:.2e} m wide and falls through between them; {remedy}"
        )
    if mine > COARSE * its:
        yield (
            f"contacts.{name}.contactor: cells of {mine:.2e} m on a target with cells of "
            f"{its:.2e} m; only nodes of the contactor touch, the target's go through between "
            f"them; {remedy}"
        )
