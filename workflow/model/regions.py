# SPDX-License-Identifier: LGPL-3.0-or-later
"""Regions and surfaces of a domain by name: their nodes, facets and areas."""

import numpy as np
import numpy.typing as npt

from meshes.domain import Domain
from workflow.scene import Scene

Index = npt.NDArray[np.int64]
Dofs = npt.NDArray[np.int32]


def facets(domain: Domain, surface: str) -> Index:
    """Return the facets of a surface, shape ``(q, 4)``."""
    return domain.source.surface(domain.source.tag(surface))


def surface_nodes(domain: Domain, surface: str) -> Index:
    """Return the mesh nodes of a surface, ascending."""
    return np.unique(facets(domain, surface))


def nodes_of(domain: Domain, names: list[str]) -> Dofs:
    """Return the owned dof blocks of the cells in the regions called ``names``."""
    cells = np.isin(domain.source.regions, domain.source.tags(names))
    dofs = domain.local_dofs(np.unique(domain.source.cells[cells]))
    return dofs[dofs >= 0]


def place(domain: Domain, scene: Scene, dof: int) -> str:
    """Return in words which body and node an owned dof block belongs to, and where it is."""
    node = int(domain.nodes[dof])
    cell = int(np.flatnonzero((domain.source.cells == node).any(axis=1))[0])
    region = domain.source.name(int(domain.source.regions[cell]))
    bodies = scene.bodies.items()
    body = next((name for name, b in bodies if region in [r.lower() for r in b.regions]), region)
    x, y, z = domain.source.points[node]
    return f"body {body!r} ({region}), node {node}, at x = {x:.5f}, y = {y:.5f}, z = {z:.5f} m"
