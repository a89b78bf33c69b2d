# SPDX-License-Identifier: LGPL-3.0-or-later
"""Smoothing of the poorest hexahedra of a mesh; nodes on its surface stay where they are."""

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize

from meshes.hexmesh import boundary
from meshes.quality import NEIGHBOURS, scaled_jacobians

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.int64]

POWER = 4  # of the distortion that is summed; the higher, the more the poorest corners count
FLOOR = 0.03  # of the regularised determinant


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
    result = minimize(
        _distortion,
        x[free].ravel(),
        args=(x, free, corners, scale),
        jac=True,
        method="L-BFGS-B",
        options={"maxiter": steps},
    )
    x = x.copy()
    x[free] = result.x.reshape(-1, 3)
    better = points.copy()
    better[nodes] = x
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


def _distortion(
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
