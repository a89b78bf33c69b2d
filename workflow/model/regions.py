# SPDX-License-Identifier: LGPL-3.0-or-later
"""Surfaces of a domain by name: their facets, nodes and areas, alike on every rank."""

import numpy as np
import numpy.typing as npt

from forms.loads import nodal_traction
from meshes.domain import Domain

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.int64]


def facets(domain: Domain, surface: str) -> Index:
    """Return the facets of a surface, shape ``(q, 4)``."""
    return domain.source.surface(domain.source.tag(surface))


def surface_nodes(domain: Domain, surface: str) -> Index:
    """Return the mesh nodes of a surface, ascending."""
    return np.unique(facets(domain, surface))


def area_shares(domain: Domain, quads: Index) -> tuple[Index, Array]:
    """Return the nodes of facets and their shares of the area, which sum to 1, shape ``(k,)``."""
    area = nodal_traction(domain.source.points, quads, np.array([1.0, 0.0, 0.0]))[:, 0]
    nodes = np.unique(quads)
    return nodes, np.asarray(area[nodes] / area.sum())
