# SPDX-License-Identifier: LGPL-3.0-or-later
"""Two small blocks of hexahedra, one on the other, whose grids do not match."""

import numpy as np

from meshes.hexmesh import HexMesh, boundary, join
from meshes.tags import Tag


def block(n, low, high, first):
    """A block of hexahedra whose top and bottom are tagged ``first`` and ``first + 1``."""
    axes = [np.linspace(a, b, k + 1) for a, b, k in zip(low, high, n, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), 3).reshape(-1, 3)
    ids = np.arange(len(points)).reshape([k + 1 for k in n])
    i, j = slice(None, -1), slice(1, None)
    corners = [
        (i, i, i),
        (j, i, i),
        (j, j, i),
        (i, j, i),
        (i, i, j),
        (j, i, j),
        (j, j, j),
        (i, j, j),
    ]
    cells = np.stack([ids[c] for c in corners], 3).reshape(-1, 8)
    quads = boundary(cells)
    z = points[quads][:, :, 2]
    top, bottom = (z == high[2]).all(axis=1), (z == low[2]).all(axis=1)
    tags = np.concatenate([np.full(top.sum(), first), np.full(bottom.sum(), first + 1)])
    return HexMesh(
        points, cells, np.full(len(cells), Tag.BLOCK, dtype=np.int32),
        np.vstack([quads[top], quads[bottom]]), tags.astype(np.int32),
    )  # fmt: skip


def two_blocks():
    lower = block((6, 5, 2), (0, 0, -0.02), (0.06, 0.05, 0.0), 111)
    upper = block((7, 6, 2), (0.008, 0.007, 0.0), (0.05, 0.04, 0.015), 113)
    lower.points[:, 2] += 4e-5 * np.sin(100 * lower.points[:, 0])
    return join(lower, upper)
