# SPDX-License-Identifier: LGPL-3.0-or-later
"""Smoothing of plane quads and of poor hexahedra by the mean ratio of their corners.

Nodes on the boundary stay where they are. The determinant of a corner is regularised,
``(det + √(det² + 4 δ²)) / 2``, so that folded cells unfold.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.optimize import minimize

from meshes.arrays import Array, Index
from meshes.hexmesh import boundary
from meshes.quality import NEIGHBOURS, scaled_jacobians

POWER = 4  # of the distortion that is summed; the higher, the more the poorest corners count
FLOOR = 0.03  # of the regularised determinant


def smoothed(points: Array, quads: Index, weights: Array | None = None) -> Array:
    """Return the nodes with those inside moved so that corners are right and spacing is kept.

    Minimises over all corners the mean ratio ``(|a|²/α² + |b|²/β²) / 2 det(a/α, b/β)`` of the two
    edges; the wanted lengths α, β are the mean ones of each quad before smoothing. The determinant
    is regularised and the regularisation then withdrawn, so that folded quads unfold.
    """
    edges = np.sort(np.stack([quads, np.roll(quads, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    pairs, count = np.unique(edges, axis=0, return_counts=True)
    free = np.setdiff1d(np.arange(len(points)), pairs[count == 1])
    corners = np.concatenate([np.roll(quads, -k, axis=1)[:, [0, 1, 3]] for k in range(4)])
    sides = np.linalg.norm(points[quads] - points[np.roll(quads, -1, axis=1)], axis=2)
    lengths = np.stack([sides[:, [0, 2]].mean(axis=1), sides[:, [1, 3]].mean(axis=1)])
    wanted = np.concatenate([lengths[::-1] if k % 2 else lengths for k in range(4)], axis=1)
    weight = np.ones(len(corners)) if weights is None else np.tile(weights, 4)
    x = points.copy()
    for delta in (0.3, 0.1, 0.03, 0.0):
        x = _minimised(_distortion_of_quads, x, free, (corners, wanted, weight, delta), 400)
    return x


def relaxed(points: Array, cells: Index, *, below: float = 0.5, steps: int = 60) -> Array:
    """Return the nodes with those of poor cells moved to better places, shape ``(n, 3)`` [m].

    Minimises the fourth power of the inverse mean ratio ``((|a|² + |b|² + |c|²) / 3)^(3/2) / det``
    over the corners of all cells that touch a moving node. Edges are measured in the mean lengths
    of their cell before smoothing, so that flat cells stay flat and no edge collapses.

    Args:
        points: Node positions, shape ``(n, 3)`` [m].
        cells: Nodes of each hexahedron, shape ``(c, 8)``.
        below: Scaled Jacobian under which a cell counts as poor.
        steps: Largest number of steps of the minimiser.
    """
    moving = np.zeros(len(points), dtype=bool)
    moving[cells[scaled_jacobians(points, cells) < below]] = True
    moving[boundary(cells)] = False
    if not moving.any():
        return points
    patch = cells[moving[cells].any(axis=1)]
    nodes, local = np.unique(patch, return_inverse=True)
    patch, x = local.reshape(-1, 8), points[nodes]
    free = np.flatnonzero(moving[nodes])
    corners = np.concatenate([patch[:, [k, *NEIGHBOURS[k]]] for k in range(8)])
    scale = _lengths(x, patch)
    x = _minimised(_distortion_of_hexahedra, x, free, (corners, scale), steps)
    better = points.copy()
    better[nodes] = x
    return better


def _minimised(
    distortion: Callable[..., tuple[float, Array]],
    points: Array,
    free: Index,
    args: tuple[Any, ...],
    steps: int,
) -> Array:
    """Return the nodes with the free ones where a distortion is smallest, ``(n, dim)`` [m].

    Args:
        distortion: Its value and gradient for the free coordinates, ``points``, ``free``, ``args``.
        points: Where to begin, shape ``(n, dim)`` [m].
        free: Nodes that may move.
        args: What else it takes.
        steps: Largest number of steps of L-BFGS.
    """
    result = minimize(
        distortion,
        points[free].ravel(),
        args=(points, free, *args),
        jac=True,
        method="L-BFGS-B",
        options={"maxiter": steps},
    )
    better = points.copy()
    better[free] = result.x.reshape(-1, points.shape[1])
    return better


def _lengths(x: Array, cells: Index) -> Array:
    """Return the lengths in which the edges of each corner are measured, ``(8 c, 3)`` [m]."""
    edges = np.linalg.norm(x[cells[:, NEIGHBOURS]] - x[cells][:, :, None], axis=3)
    axis = np.array([[0, 1, 2], [1, 0, 2]] * 2 + [[1, 0, 2], [0, 1, 2]] * 2)
    mean = np.stack(
        [
            np.mean([edges[:, k, axis[k].tolist().index(a)] for k in range(8)], axis=0)
            for a in range(3)
        ],
        axis=1,
    )
    return np.concatenate([mean[:, axis[k]] for k in range(8)])


def _distortion_of_hexahedra(
    moved: Array, points: Array, free: Index, corners: Index, scale: Array
) -> tuple[float, Array]:
    """Return the summed distortion and its gradient for the free nodes at ``moved``."""
    x = points.copy()
    x[free] = moved.reshape(-1, 3)
    a, b, c = ((x[corners[:, k]] - x[corners[:, 0]]) / scale[:, k - 1, None] for k in (1, 2, 3))
    bc, ca, ab = np.cross(b, c), np.cross(c, a), np.cross(a, b)
    det = (a * bc).sum(axis=1)
    root = np.sqrt(det**2 + 4 * FLOOR**2)
    positive = (det + root) / 2
    size = (a**2 + b**2 + c**2).sum(axis=1)
    value = (size / 3) ** 1.5 / positive
    weight = POWER * value**POWER
    radial, volumetric = (weight * 3 / size)[:, None], (weight / root)[:, None]
    gradient = np.zeros_like(x)
    for k, (edge, area) in enumerate(((a, bc), (b, ca), (c, ab))):
        part = (radial * edge - volumetric * area) / scale[:, k, None]
        for j in range(3):
            gradient[:, j] += np.bincount(corners[:, k + 1], part[:, j], len(x))
            gradient[:, j] -= np.bincount(corners[:, 0], part[:, j], len(x))
    return float((value**POWER).sum()), gradient[free].ravel()


def _distortion_of_quads(
    moved: Array,
    points: Array,
    free: Index,
    corners: Index,
    wanted: Array,
    weight: Array,
    delta: float,
) -> tuple[float, Array]:
    x = points.copy()
    x[free] = moved.reshape(-1, 2)
    alpha, beta = wanted[:, :, None]
    o, p, q = corners.T
    a, b = (x[p] - x[o]) / alpha, (x[q] - x[o]) / beta
    det = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    root = np.sqrt(det**2 + 4 * max(delta, 1e-3) ** 2)
    positive = (det + root) / 2
    shape = (a**2 + b**2).sum(axis=1) / 2
    slope = (1 + det / root) / 2
    value = shape / positive
    d_det = -(shape / positive**2 * slope)[:, None]
    d_a = a / positive[:, None] + d_det * np.column_stack([b[:, 1], -b[:, 0]])
    d_b = b / positive[:, None] + d_det * np.column_stack([-a[:, 1], a[:, 0]])
    gradient = np.zeros_like(x)
    # squared, the worst corners count most
    for node, part in ((p, d_a / alpha), (q, d_b / beta), (o, -d_a / alpha - d_b / beta)):
        for k in range(2):
            gradient[:, k] += np.bincount(node, 2 * weight * value * part[:, k], minlength=len(x))
    return float((weight * value**2).sum()), gradient[free].ravel()
