# SPDX-License-Identifier: LGPL-3.0-or-later
"""Regions and surfaces by name: the body of each region, facets and nodes of a surface."""

import numpy as np

from meshes.arrays import Index
from meshes.domain import Domain
from meshes.hexmesh import HexMesh
from workflow.scene import Scene


def owners(scene: Scene) -> dict[str, str]:
    """Return the body of each region of a scene, by the region's name in lower case."""
    return {r.lower(): name for name, body in scene.bodies.items() for r in body.regions}


def body_at(scene: Scene, mesh: HexMesh, node: int) -> str:
    """Return the name of the body that a mesh node belongs to."""
    return owners(scene)[mesh.region_at(node)]


def place(domain: Domain, scene: Scene, dof: int) -> str:
    """Return in words which body and node an owned dof block belongs to, and where it is."""
    mesh, node = domain.source, int(domain.nodes[dof])
    region = mesh.region_at(node)
    x, y, z = mesh.points[node]
    return (
        f"body {owners(scene)[region]!r} ({region}), node {node}, at x = {x:.5f}, y = {y:.5f}, "
        f"z = {z:.5f} m"
    )


def facets(domain: Domain, surface: str) -> Index:
    """Return the facets of a surface, shape ``(q, 4)``."""
    return domain.source.surface(domain.source.tag(surface))


def surface_nodes(domain: Domain, surface: str) -> Index:
    """Return the mesh nodes of a surface, ascending."""
    return np.unique(facets(domain, surface))
