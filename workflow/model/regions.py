# SPDX-License-Identifier: LGPL-3.0-or-later
"""Regions and surfaces by name: the body of each region, facets and nodes of a surface."""

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from workflow.scene.scene import Scene

if TYPE_CHECKING:
    from meshes.domain import Domain
    from meshes.hexmesh import HexMesh

Index = npt.NDArray[np.int64]


def owners(scene: Scene) -> dict[str, str]:
    """Return the body of each region of a scene, by the region's name in lower case."""
    return {r.lower(): name for name, body in scene.bodies.items() for r in body.regions}


def body_at(scene: Scene, mesh: "HexMesh", node: int) -> str:
    """Return the name of the body that a mesh node belongs to."""
    return owners(scene)[mesh.region_at(node)]


def facets(domain: "Domain", surface: str) -> Index:
    """Return the facets of a surface, shape ``(q, 4)``."""
    return domain.source.surface(domain.source.tag(surface))


def surface_nodes(domain: "Domain", surface: str) -> Index:
    """Return the mesh nodes of a surface, ascending."""
    return np.unique(facets(domain, surface))
