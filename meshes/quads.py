# SPDX-License-Identifier: LGPL-3.0-or-later
"""Integrals over bilinear quads: areas, normals, and the shares of nodes in them.

A quad with corners x₁ … x₄, counter-clockwise from outside, is ``x(ξ, η) = Σ Nᵢ(ξ, η) xᵢ`` over the
reference square [-1, 1]². Integrals are taken by 2 × 2 Gauss points.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from meshes.arrays import Array, Index

Quads = npt.NDArray[np.integer[Any]]

CORNERS = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])  # of the reference square
GAUSS = np.array([-1.0, 1.0]) / np.sqrt(3)


def bilinear(xi: npt.ArrayLike, eta: npt.ArrayLike) -> tuple[Array, Array, Array]:
    """Return the shape functions and their derivatives by ξ and η, each of shape ``(..., 4)``.

    Args:
        xi: First reference coordinate, shape ``(...)`` [-].
        eta: Second reference coordinate, shape ``(...)`` [-].
    """
    a = 1 + np.multiply.outer(xi, CORNERS[:, 0])
    b = 1 + np.multiply.outer(eta, CORNERS[:, 1])
    return a * b / 4, CORNERS[:, 0] * b / 4, CORNERS[:, 1] * a / 4


def gauss_points(x: Array) -> Iterator[tuple[Array, Array]]:
    """Yield shape functions ``(4,)`` and area vectors ``(q, 3)`` [m²] at each Gauss point.

    Args:
        x: Corners of the quads, shape ``(q, 4, 3)`` [m].
    """
    for xi, eta in CORNERS / np.sqrt(3):
        N, along, across = bilinear(xi, eta)
        yield N, np.cross(np.einsum("i,qid->qd", along, x), np.einsum("i,qid->qd", across, x))


def area_vectors(points: Array, quads: Quads) -> Array:
    """Return the area times the mean normal of each quad, shape ``(q, 3)`` [m²].

    Half the cross product of the diagonals, which is exact for warped quads too.
    """
    x = points[quads]
    return np.asarray(0.5 * np.cross(x[:, 2] - x[:, 0], x[:, 3] - x[:, 1]))


def corner_areas(points: Array, quads: Quads) -> Array:
    """Return the area that belongs to each corner of each quad, ``∫ N dA``, ``(q, 4)`` [m²]."""
    first, second, third, fourth = _parts(points, quads)
    # summed along η first: springs of contact depend on these areas, runs repeat to the last bit
    return np.asarray(first + fourth + second + third)


def nodal_areas(points: Array, quads: Quads) -> Array:
    """Return the area that belongs to each node, ``∫ N dA``, shape ``(n,)`` [m²]."""
    parts = _parts(points, quads)
    area = np.bincount(np.tile(quads.ravel(), 4), parts.ravel(), minlength=len(points))
    return np.asarray(area, dtype=np.float64)


def _parts(points: Array, quads: Quads) -> Array:
    """Return what each Gauss point adds to the areas of the corners, shape ``(4, q, 4)`` [m²]."""
    at = gauss_points(points[quads])
    return np.stack([np.linalg.norm(vector, axis=1)[:, None] * N for N, vector in at])


def area_shares(points: Array, quads: Index) -> tuple[Index, Array]:
    """Return the nodes of quads and their shares of the area, which sum to 1, both ``(k,)``.

    A uniform pressure has nodal forces in proportion to them.
    """
    area = nodal_areas(points, quads)
    nodes = np.unique(quads)
    return nodes, np.asarray(area[nodes] / area.sum())


def enclosed_volume(points: Array, quads: Quads) -> float:
    """Return the volume within a closed surface by the divergence theorem, ``∫ x · n dA / 3`` [m³].

    Args:
        points: Node positions, shape ``(n, 3)`` [m].
        quads: Quads of the surface, counter-clockwise from outside, shape ``(q, 4)``.
    """
    x = points[quads]
    return sum(
        float(np.sum(np.einsum("i,qid->qd", N, x) * vector)) / 3 for N, vector in gauss_points(x)
    )
