# SPDX-License-Identifier: LGPL-3.0-or-later
"""Zones of bodies, that may yield or have another element: their cells, and those at a border."""

from collections.abc import Iterator

import numpy as np

from meshes.arrays import Array, Flags
from meshes.hexmesh import HexMesh
from workflow.model.geometry import mesh_of
from workflow.scene import Scene, SceneError


def zone(scene: Scene, mesh: HexMesh, name: str, kind: str) -> Flags:
    """Return which cells of a mesh are in a zone of a body, shape ``(c,)``.

    Args:
        scene: The scene.
        mesh: Its mesh.
        name: Name of the body.
        kind: Key of its zone, ``yielding`` or ``contact_zone``; without it, the whole body.

    Raises:
        SceneError: if no cell is.
    """
    body = scene.bodies[name]
    own = np.isin(mesh.regions, mesh.tags(body.regions))
    limits = getattr(body, kind)
    if limits is None:
        return own
    inside, key = own.copy(), f"bodies.{name}.{kind}"
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

        distance, _ = cKDTree(_touched(scene, mesh, name, key)).query(centres)
        inside[own] &= distance <= limits.depth
        if not inside.any():
            raise SceneError(
                f"{key}.depth = {limits.depth:g}: no centre of a cell is as near; expected more "
                f"than {distance.min():.3g} m" + ", or a box at the surface" * bool(limits.box)
            )
    return inside


def _touched(scene: Scene, mesh: HexMesh, name: str, key: str) -> Array:
    """Return nodes and middles of the facets of a body that contacts name, shape ``(n, 3)`` [m].

    Raises:
        SceneError: if there are none.
    """
    sides = [side for c in scene.contacts.values() for side in (c.contactor, c.target)]
    facets = mesh.surface(*mesh.tags(side for side in sides if isinstance(side, str)))
    nodes = mesh.nodes(*mesh.tags(scene.bodies[name].regions))
    facets = facets[np.isin(facets, nodes).all(axis=1)]
    if not len(facets):
        raise SceneError(f"{key}.depth: expected a contact of the body, got none")
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
    """Yield how many cells of each body are in its zones; the mesh is made if need be.

    Raises:
        SceneError: as :func:`zone`.
    """
    words = {"contact_zone": "cells are in the contact zone", "yielding": "cells may yield"}
    zones = [(n, kind) for n, b in scene.bodies.items() for kind in words if getattr(b, kind)]
    mesh = mesh_of(scene)[0] if mesh is None and zones else mesh
    for name, kind in zones:
        assert mesh is not None
        of = int(np.isin(mesh.regions, mesh.tags(scene.bodies[name].regions)).sum())
        count = int(zone(scene, mesh, name, kind).sum())
        yield f"bodies.{name}: {count} of {of} {words[kind]}"
