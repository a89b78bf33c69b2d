# SPDX-License-Identifier: LGPL-3.0-or-later
"""Where a patch ends: the cells of its nodes as rectangles, and the line around them."""

import numpy as np

from workflow.theme import Array

STEPS = 8  # raster points along half a cell
ROUND = 6.0  # exponent of the rounded rectangle around a node: 2 an ellipse, more a box
REACH = 0.57  # half size of that rectangle in cells, so that those of neighbours overlap


def cell_sizes(at: Array, areas: Array) -> Array:
    """Return length and width of the rectangle that stands for each node, shape ``(n, 2)`` [m].

    The length is how far columns of nodes are apart, the width makes up the area.

    Args:
        at: Longitudinal and lateral position of the nodes, shape ``(n, 2)`` [m].
        areas: Tributary areas, shape ``(n,)`` [m2].
    """
    x = at[:, 0]
    apart = np.abs(x[:, None] - x)
    apart[apart < 0.5 * np.sqrt(areas)] = np.inf  # same column, or the node itself
    near = apart.min(axis=1)
    alone = not np.isfinite(near).any()
    length = np.sqrt(np.median(areas)) if alone else np.median(near[np.isfinite(near)])
    length = min(max(length, 0.5 * np.sqrt(areas.max())), 2 * np.sqrt(areas.min()))
    return np.column_stack([np.full(len(x), length), areas / length])


def boxes(at: Array, areas: Array) -> Array:
    """Return the corners of the rectangle of each node, shape ``(n, 4, 2)`` [m]."""
    corners = 0.5 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    return at[:, None] + cell_sizes(at, areas)[:, None] * corners


def outlines(at: Array, areas: Array) -> list[Array]:
    """Return the closed lines around the cells of a patch, one for each part of it.

    The cells are rounded rectangles drawn on a raster; the lines are its contour.

    Args:
        at: Longitudinal and lateral position of the nodes, shape ``(n, 2)`` [m].
        areas: Tributary areas, shape ``(n,)`` [m2].

    Returns:
        Lines of shape ``(k, 2)`` [m], the first point repeated as the last.
    """
    from contourpy import contour_generator

    half = REACH * cell_sizes(at, areas)
    low, high = (at - 1.3 * half).min(axis=0), (at + 1.3 * half).max(axis=0)
    step = half.min(axis=0) / STEPS
    x, y = (np.arange(a, b + d, d) for a, b, d in zip(low, high, step, strict=True))
    depth = np.full((len(y), len(x)), -1.0)
    for (cx, cy), (hx, hy) in zip(at, half, strict=True):
        i, j = (slice(*np.searchsorted(line, (c - 1.3 * h, c + 1.3 * h)))
                for line, c, h in ((x, cx, hx), (y, cy, hy)))  # fmt: skip
        off = np.abs((x[i] - cx) / hx) ** ROUND + np.abs((y[j, None] - cy) / hy) ** ROUND
        depth[j, i] = np.maximum(depth[j, i], 1.0 - off ** (1 / ROUND))
    return [np.asarray(line) for line in contour_generator(x, y, depth).lines(0.0)]
