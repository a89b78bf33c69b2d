# SPDX-License-Identifier: LGPL-3.0-or-later
"""Points inside hexahedra, and their distances to quads."""

import numpy as np

from meshes.arrays import Array, Flags, Index

SQUARE = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
CORNERS = np.array([(x, y, z) for z in (-1, 1) for x, y in SQUARE], dtype=float)
ROUND = 1e-6  # of half a cell, by which a point on a face may be outside
ITERATIONS = 12
PAIRS = 1_000_000  # of points and quads looked at together


def inside(points: Array, cells: Index, wanted: Index) -> Flags:
    """Return which nodes of a mesh lie in hexahedra of which they are no corners.

    Args:
        points: Node positions, shape ``(n, 3)`` [m].
        cells: Nodes of each hexahedron, shape ``(c, 8)``.
        wanted: The nodes that are asked for, shape ``(k,)``.

    Returns:
        Shape ``(k,)``; a node on a face counts as inside.
    """
    found = np.zeros(len(wanted), dtype=bool)
    corners = points[cells]
    low, high = corners.min(axis=1), corners.max(axis=1)
    x = points[wanted]
    near = ((high >= x.min(axis=0)) & (low <= x.max(axis=0))).all(axis=1)
    close = ((x >= low.min(axis=0)) & (x <= high.max(axis=0))).all(axis=1)
    if not (near.any() and close.any()):
        return found
    from scipy.spatial import cKDTree  # slow to import, for scenes whose bodies stand apart

    pick, which = np.flatnonzero(near), np.flatnonzero(close)
    reach = np.linalg.norm(high - low, axis=1)[pick] / 2 * (1 + ROUND)
    lists = cKDTree(x[which]).query_ball_point((low + high)[pick] / 2, reach)
    cell = np.repeat(pick, [len(one) for one in lists])
    item = which[np.concatenate([np.zeros(0), *lists]).astype(np.int64)]
    slack = ROUND * (high - low).max(axis=1)[cell, None]
    boxed = ((x[item] >= low[cell] - slack) & (x[item] <= high[cell] + slack)).all(axis=1)
    other = boxed & (cells[cell] != wanted[item][:, None]).all(axis=1)
    cell, item = cell[other], item[other]
    found[item[_contain(corners[cell], x[item])]] = True
    return found


def _contain(corners: Array, x: Array) -> Flags:
    """Return which points lie in their hexahedron, by Newton's method for the trilinear map."""
    xi = np.zeros_like(x)
    for _ in range(ITERATIONS):
        factor = 1 + xi[:, None, :] * CORNERS
        shape = factor.prod(axis=2) / 8
        slope = np.stack(
            [CORNERS[:, a] * np.delete(factor, a, axis=2).prod(axis=2) / 8 for a in range(3)],
            axis=2,
        )
        away = x - np.einsum("pk,pka->pa", shape, corners)
        jacobian = np.einsum("pkj,pka->paj", slope, corners)
        flat = np.abs(np.linalg.det(jacobian)) < 1e-9 * np.abs(jacobian).max(axis=(1, 2)) ** 3
        jacobian[flat] = np.eye(3)
        step = np.linalg.solve(jacobian, away[:, :, None])[:, :, 0]
        xi = np.clip(xi + step, -2.0, 2.0)
    return np.asarray((np.abs(xi) <= 1 + ROUND).all(axis=1))


def distance_to_quads(x: Array, corners: Array) -> Array:
    """Return the distance of points from the nearest of some quads, shape ``(n,)`` [m].

    Args:
        x: Points, shape ``(n, 3)`` [m].
        corners: Quads, each taken for four triangles round its middle, shape ``(q, 4, 3)`` [m].
    """
    middle = np.broadcast_to(corners.mean(axis=1)[:, None], corners.shape)
    fans = np.stack([corners, np.roll(corners, -1, axis=1), middle], axis=2).reshape(-1, 3, 3)
    nearest = np.full(len(x), np.inf)
    chunk = max(1, PAIRS // max(len(x), 1))
    for k in range(0, len(fans), chunk):
        part = fans[k : k + chunk]
        np.minimum(nearest, _to_triangles(x[:, None], part[None]).min(axis=1), out=nearest)
    return nearest


def _to_triangles(x: Array, corners: Array) -> Array:
    """Return distances of points ``(n, 1, 3)`` from triangles ``(1, t, 3, 3)``, ``(n, t)`` [m]."""
    a, b, c = (corners[..., k, :] for k in range(3))
    normal = np.cross(b - a, c - a)
    size = np.linalg.norm(normal, axis=-1, keepdims=True)
    normal = normal / np.where(size > 0, size, 1.0)
    within = np.ones(np.broadcast_shapes(x.shape[:-1], a.shape[:-1]), dtype=bool)
    nearest = np.full(within.shape, np.inf)
    for start, end in ((a, b), (b, c), (c, a)):
        edge, way = end - start, x - start
        length = (edge * edge).sum(axis=-1)
        t = np.clip((way * edge).sum(axis=-1) / np.where(length > 0, length, 1.0), 0.0, 1.0)
        nearest = np.minimum(nearest, np.linalg.norm(way - t[..., None] * edge, axis=-1))
        within &= (np.cross(edge, way) * normal).sum(axis=-1) >= 0
    height = np.abs(((x - a) * normal).sum(axis=-1))
    return np.where(within, np.minimum(height, nearest), nearest)
