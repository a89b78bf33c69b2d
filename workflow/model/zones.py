# SPDX-License-Identifier: LGPL-3.0-or-later
"""Zones of bodies that may yield: which cells of a mesh they are, and those at their border."""

from collections.abc import Iterator

import numpy as np

from meshes.arrays import Array, Flags
from meshes.hexmesh import HexMesh
from workflow.model.geometry import mesh_of
from workflow.scene import Scene, SceneError


def zone(scene: Scene, mesh: HexMesh, name: str) -> Flags:
    """Return which cells of a mesh are those of a body that may yield, shape ``(c,)``.

    Args:
        scene: The scene.
        mesh: Its mesh.
        name: Name of the body, whose ``yielding`` says where; the whole body if it does not.

    Raises:
        SceneError: if no cell is.
    """
    body = scene.bodies[name]
    own = np.isin(mesh.regions, mesh.tags(body.regions))
    limits = body.yielding
    if limits is None:
        return own
    inside, key = own.copy(), f"bodies.{name}.yielding"
    centres = mesh.points[mesh.cells[own]].mean(axis=1)
    if limits.box is not None:
        least, most = map(np.array, limits.box)
        inside[own] &= ((centres >= least) & (centres <= most)).all(axis=1)
        if not inside.any():
            raise SceneError(
                f"{key}.box = {[*map(list, limits.box)]}: no centre of a cell is in it; the body "
                f"reaches from {_place(centres.min(axis=0))} to {_place(centres.max(axis=0))} m"
            )
    if limits.depth is not None:
        from scipy.spatial import cKDTree  # half a second that others need not wait for

        distance, _ = cKDTree(_touched(scene, mesh, name)).query(centres)
        inside[own] &= distance <= limits.depth
        if not inside.any():
            raise SceneError(
                f"{key}.depth = {limits.depth:g}: no centre of a cell is as near; expected more "
                f"than {distance.min():.3g} m" + ", or a box at the surface" * bool(limits.box)
            )
    return inside


def _touched(scene: Scene, mesh: HexMesh, name: str) -> Array:
    """Return nodes and middles of the facets of a body that contacts name, shape ``(n, 3)`` [m].

    Raises:
        SceneError: if there are none.
    """
    sides = [side for c in scene.contacts.values() for side in (c.contactor, c.target)]
    facets = mesh.surface(*mesh.tags(side for side in sides if isinstance(side, str)))
    nodes = mesh.nodes(*mesh.tags(scene.bodies[name].regions))
    facets = facets[np.isin(facets, nodes).all(axis=1)]
    if not len(facets):
        raise SceneError(f"bodies.{name}.yielding.depth: expected a contact of the body, got none")
    return np.vstack([mesh.points[np.unique(facets)], mesh.points[facets].mean(axis=1)])


def _place(x: Array) -> str:
    return f"({', '.join(f'{c:.4g}' for c in x)})"


def border(mesh: HexMesh, inside: Flags, whole: Flags) -> Flags:
    """Return which cells inside a zone share a node with cells outside of it, shape ``(c,)``.

    Args:
        mesh: The mesh.
        inside: Cells of the zone, shape ``(c,)``.
        whole: Cells of its body, shape ``(c,)``.
    """
    shared = np.zeros(len(mesh.points), dtype=bool)
    shared[mesh.cells[whole & ~inside]] = True
    return inside & shared[mesh.cells].any(axis=1)


def zones_in_words(scene: Scene, mesh: HexMesh | None) -> Iterator[str]:
    """Yield how many cells of each body with a zone may yield; the mesh is made if need be.

    Raises:
        SceneError: as :func:`zone`.
    """
    names = [name for name, body in scene.bodies.items() if body.yielding is not None]
    mesh = mesh_of(scene)[0] if mesh is None and names else mesh
    for name in names:
        assert mesh is not None
        of = int(np.isin(mesh.regions, mesh.tags(scene.bodies[name].regions)).sum())
        yield f"bodies.{name}: {int(zone(scene, mesh, name).sum())} of {of} cells may yield"
