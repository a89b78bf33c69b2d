# SPDX-License-Identifier: LGPL-3.0-or-later
"""Surfaces of a domain by name: their facets, nodes and areas, alike on every rank."""

import numpy as np
import numpy.typing as npt

from meshes.domain import Domain

Index = npt.NDArray[np.int64]


def facets(domain: Domain, surface: str) -> Index:
    """Return the facets of a surface, shape ``(q, 4)``."""
    return domain.source.surface(domain.source.tag(surface))


def surface_nodes(domain: Domain, surface: str) -> Index:
    """Return the mesh nodes of a surface, ascending."""
    return np.unique(facets(domain, surface))
