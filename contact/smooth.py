# SPDX-License-Identifier: LGPL-3.0-or-later
"""Smooth target: facets curved by averaged corner normals.

A facet is curved by the normals at its corners (``kernel/smooth.c``). Facets that meet at less than
an angle share them, so that gap and normal are continuous from one to the next; at sharper edges
each side has its own. The normals are averaged anew at every step from the present positions.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array

from contact._kernel import lib
from contact.arrays import Index32, struct, view
from meshes.arrays import Array
from meshes.quads import area_vectors


def smooth_neighbours(points: Array, quad: Index32, angle: float) -> Index32:
    """Return the facet over each edge that meets it at less than ``angle`` [rad], else -1.

    Args:
        points: Positions, shape ``(n, 3)`` [m].
        quad: Facets, shape ``(q, 4)``; edge e goes from corner e to e + 1.
        angle: Largest angle between the normals of smooth neighbours [rad].

    Returns:
        Shape ``(q, 4)``.
    """
    ends = np.sort(np.stack([quad, np.roll(quad, -1, axis=1)], axis=2), axis=2).reshape(-1, 2)
    _, edge, count = np.unique(ends, axis=0, return_inverse=True, return_counts=True)
    edge = edge.ravel()
    order = np.argsort(edge, kind="stable")
    order = order[count[edge[order]] == 2].reshape(-1, 2)
    normal = area_vectors(points, quad)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    one, two = order[:, 0] // 4, order[:, 1] // 4
    shared = order[np.einsum("ia,ia->i", normal[one], normal[two]) > np.cos(angle)]
    across = np.full(quad.size, -1, dtype=np.int32)
    across[shared[:, 0]], across[shared[:, 1]] = shared[:, 1] // 4, shared[:, 0] // 4
    return across.reshape(-1, 4)


def corner_normals(quad: Index32, across: Index32) -> Index32:
    """Return the number of the normal at each corner, shape ``(q, 4)``.

    Corners at one node have the same one if a way over smooth edges leads from one to the other.
    """
    facet, edge = np.nonzero(across >= 0)
    other = across[facet, edge]
    pairs = []
    for place in (edge, (edge + 1) % 4):  # both ends of the edge
        twin = np.argmax(quad[other] == quad[facet, place][:, None], axis=1)
        pairs.append((4 * facet + place, 4 * other + twin))
    i, j = (np.concatenate(x) for x in zip(*pairs, strict=True))
    from scipy.sparse.csgraph import connected_components  # slow to import, for smooth targets only

    graph = coo_array((np.ones(len(i)), (i, j)), shape=(quad.size, quad.size))
    label = connected_components(graph, directed=False)[1]
    return np.asarray(label, dtype=np.int32).reshape(-1, 4)


def mirrored(quad: Index32, across: Index32, corner: Index32) -> Index32:
    """Return for each normal at a border or sharp edge its inner neighbours, shape ``(b, 4)``.

    Columns: normal, its node, the normal at the inner end of an edge, that end; by normal. The
    average at a border is one-sided, the mirror image of the inner normal is not.
    """
    rim = (across < 0) | (np.roll(across, 1, axis=1) < 0)
    is_open = np.zeros(int(corner.max()) + 1, dtype=bool)
    is_open[corner[rim]] = True
    known = ~is_open
    rows: list[Index32] = []
    for _ in range(2):  # corners of the border look along it, at normals mirrored before
        found = [np.empty((0, 4), dtype=np.int32)]
        for a in range(4):
            for b, edge in (((a + 1) % 4, a), ((a + 3) % 4, (a + 3) % 4)):
                lead = (across[:, edge] >= 0) | bool(rows)
                inward = ~known[corner[:, a]] & known[corner[:, b]] & lead
                ends = np.stack([corner[:, a], quad[:, a], corner[:, b], quad[:, b]], axis=1)
                found.append(ends[inward])
        rows.append(np.unique(np.vstack(found), axis=0))
        known[rows[-1][:, 0]] = True
    return np.ascontiguousarray(np.vstack(rows), dtype=np.int32)


@dataclass(frozen=True)
class Corners:
    """Corner normals near the patch.

    Attributes:
        facets: Facets whose nodes they need, shape ``(m,)``.
        c: What the kernel takes to average them.
    """

    facets: Index32
    c: tuple[Any, ...]


class Smooth:
    """Corner normals of a target.

    Attributes:
        across: Smooth neighbour over each edge, -1: none, shape ``(q, 4)``.
        corner: Number of the normal at each corner, shape ``(q, 4)``.
        normals: The normals, up to date where :meth:`update` was told to, shape ``(m, 3)``.
    """

    def __init__(self, points: Array, quad: Index32, angle: float) -> None:
        """Prepare facets ``quad`` ``(q, 4)`` over points ``(n, 3)`` [m]; ``angle`` in rad."""
        self._quad = quad
        self.across = smooth_neighbours(points, quad, angle)
        self.corner = corner_normals(quad, self.across)
        self._mirror = mirrored(quad, self.across, self.corner)
        self.normals = np.zeros((int(self.corner.max()) + 1, 3))
        self._c = struct("wr_target", quad=quad, corner=self.corner, normals=self.normals)

    def corners(self, live: npt.NDArray[np.uint8]) -> Corners:
        """Return the corners of live facets, which need all facets round them."""
        near = np.zeros(int(self._quad.max()) + 1, dtype=bool)
        near[self._quad[live == 1]] = True
        fresh = np.flatnonzero(near[self._quad].any(axis=1)).astype(np.int32)
        used = np.unique(self.corner[fresh]).astype(np.int32)
        known = np.zeros(len(self.normals), dtype=bool)
        known[used] = True
        mirror = self._mirror[known[self._mirror[:, 0]] & known[self._mirror[:, 2]]]
        parts = {"fresh": fresh, "used": used, "mirror": np.ascontiguousarray(mirror)}
        c = ((len(a), view(key, a, a.shape, np.int32)) for key, a in parts.items())
        return Corners(fresh, tuple(argument for pair in c for argument in pair))

    def update(self, corners: Corners, xv: Any) -> None:
        """Average the normals of corners at the positions in the view ``xv``."""
        lib.wr_normals(self._c, *corners.c, xv)
