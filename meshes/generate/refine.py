# SPDX-License-Identifier: LGPL-3.0-or-later
"""Directional 3:1 refinement of hexahedra: marked edges are cut in three, without hanging nodes.

In a cell all marked edges belong to one family of four parallel edges. None, one, two adjacent or
all four of them may be marked: the cell becomes 1, 5, 4 or 3 hexahedra. Other patterns (two
opposite, three) are promoted to four.
"""

from dataclasses import dataclass

import numpy as np

from meshes.arrays import Array, Flags, Index
from meshes.hexmesh import FAMILIES

CUTS = (1 / 3, 2 / 3)
SHALLOW, DEEP = 0.5, 0.8  # bounds on the depth of a transition within its cell


@dataclass(frozen=True)
class Cut:
    """Cells and nodes after a refinement.

    Attributes:
        cells: Nodes of each hexahedron, shape ``(c, 8)``.
        parents: Cell it was cut from, shape ``(c,)``.
        sources: Nodes each new node is interpolated from, shape ``(m, 8)``.
        weights: Their weights, shape ``(m, 8)``.
    """

    cells: Index
    parents: Index
    sources: Index
    weights: Array


def trisect(points: Array, cells: Index, edges: Index, of_cell: Index, marked: Flags) -> Cut:
    """Cut the marked edges in three.

    Args:
        points: Node positions, shape ``(n, 3)``; they only set how deep transitions reach.
        cells: Nodes of each hexahedron, shape ``(c, 8)``.
        edges: The edges, lower node first, shape ``(e, 2)``.
        of_cell: Edges of each cell by family, shape ``(c, 3, 4)``.
        marked: Whether each edge shall be cut, shape ``(e,)``.

    Raises:
        ValueError: if in some cell edges of two families are marked.
    """
    marked = closure(of_cell, marked)
    hit = marked[of_cell]
    family = np.argmax(hit.any(axis=2), axis=1)
    pattern = hit[np.arange(len(cells)), family]
    count = pattern.sum(axis=1)
    # turn each cell so that its marked edges come first in the cyclic order
    start = np.argmax(pattern & ~np.roll(pattern, 1, axis=1), axis=1)
    order = (start[:, None] + np.arange(4)) % 4
    ends = cells[np.arange(len(cells))[:, None, None], FAMILIES[family[:, None], order]]
    new = _Nodes(points, len(points))
    groups = {n: np.flatnonzero(count == n) for n in (0, 1, 2, 4)}
    new.add_edges(edges[marked])
    new.add_faces(ends, groups[1], groups[2])
    made = [
        cells[groups[0]][:, None],
        _four(ends[groups[4]], new),
        _two(ends[groups[2]], new),
        _one(ends[groups[1]], new),
    ]
    parents = [np.repeat(groups[n], m.shape[1]) for n, m in zip((0, 4, 2, 1), made, strict=True)]
    result = np.vstack([m.reshape(-1, 8) for m in made])
    by_parent = np.argsort(np.concatenate(parents), kind="stable")
    sources, weights = new.interpolation()
    return Cut(result[by_parent], np.concatenate(parents)[by_parent], sources, weights)


def closure(of_cell: Index, marked: Flags) -> Flags:
    """Return ``marked`` with patterns that no template fits promoted to all four edges."""
    marked = marked.copy()
    while True:
        hit = marked[of_cell]
        count = hit.sum(axis=2)
        opposite = (hit[..., 0] & hit[..., 2]) | (hit[..., 1] & hit[..., 3])
        bad = opposite & (count < 4)
        if not bad.any():
            break
        marked[of_cell[bad]] = True
    if ((count > 0).sum(axis=1) > 1).any():
        raise ValueError("refinement: expected one direction per cell, got marked edges of two")
    return marked


class _Nodes:
    """Numbers and interpolation weights of the nodes that one refinement adds."""

    def __init__(self, points: Array, start: int) -> None:
        self.points, self.next = points, start
        self.sources: list[Index] = []
        self.weights: list[Array] = []
        self.edge_keys = self.face_keys = np.zeros(0, dtype=np.int64)
        self.edge_start = self.face_start = start

    def add(self, corners: Index, weights: Array) -> Index:
        """Add one node per row of ``corners`` (m, k), interpolated by ``weights`` (m, k)."""
        m, k = corners.shape
        self.sources.append(np.hstack([corners, np.repeat(corners[:, :1], 8 - k, axis=1)]))
        self.weights.append(np.hstack([weights, np.zeros((m, 8 - k))]))
        self.next += m
        return np.arange(self.next - m, self.next)

    def add_edges(self, edges: Index) -> None:
        """Add two nodes on every edge; edges are sorted by their key."""
        self.edge_start = self.next
        self.edge_keys = self._key(edges)
        for t in CUTS:
            self.add(edges, np.tile([1 - t, t], (len(edges), 1)))

    def add_faces(self, ends: Index, one: Index, two: Index) -> None:
        """Add two nodes on every face with one marked edge: (marked, opposite) edge rows."""
        pairs = np.concatenate(
            [ends[one][:, [0, 1]], ends[one][:, [0, 3]], ends[two][:, [0, 3]], ends[two][:, [1, 2]]]
        )
        # both cells at a face must see the same start of the marked edge
        turned = pairs[:, 0, 0] > pairs[:, 0, 1]
        pairs[turned] = pairs[turned][:, :, ::-1]
        keys = self._face_key(pairs)
        self.face_keys, first = np.unique(keys, return_index=True)
        faces = pairs[first]
        depth = self.depth(faces)
        self.face_start = self.next
        for t in CUTS:
            self.add(faces.reshape(-1, 4), _bilinear(t, depth))

    def depth(self, faces: Index) -> Array:
        """Return how deep the transition reaches into each face, as a share of its height.

        The slanted edges run at 45° where the shape of the face allows it.
        """
        p = self.points[faces]
        width = np.linalg.norm(p[:, 0, 1] - p[:, 0, 0], axis=1)
        height = np.linalg.norm(p[:, 1].mean(axis=1) - p[:, 0].mean(axis=1), axis=1)
        return np.clip(1 - width / (3 * height), SHALLOW, DEEP)

    def on_edge(self, edges: Index) -> Index:
        """Return the two nodes on each edge, in its direction, shape ``(m, 2)``."""
        turned = edges[:, 0] > edges[:, 1]
        k = np.searchsorted(self.edge_keys, self._key(np.sort(edges, axis=1)))
        nodes = self.edge_start + k[:, None] + len(self.edge_keys) * np.arange(2)
        nodes[turned] = nodes[turned][:, ::-1]
        return nodes

    def on_face(self, marked: Index, opposite: Index) -> Index:
        """Return the two nodes on each face, along its marked edge, shape ``(m, 2)``."""
        pairs = np.stack([marked, opposite], axis=1)
        turned = marked[:, 0] > marked[:, 1]
        pairs[turned] = pairs[turned][:, :, ::-1]
        k = np.searchsorted(self.face_keys, self._face_key(pairs))
        nodes = self.face_start + k[:, None] + len(self.face_keys) * np.arange(2)
        nodes[turned] = nodes[turned][:, ::-1]
        return nodes

    def interpolation(self) -> tuple[Index, Array]:
        """Return sources and weights of all new nodes, shape ``(m, 8)`` each."""
        return np.vstack(self.sources), np.vstack(self.weights)

    def _key(self, edges: Index) -> Index:
        return np.asarray(edges[:, 0] * len(self.points) + edges[:, 1])

    def _face_key(self, pairs: Index) -> Index:
        # a marked edge and one node across name the face
        return np.asarray(
            np.searchsorted(self.edge_keys, self._key(pairs[:, 0])) * len(self.points)
            + pairs[:, 1, 0]
        )


def _bilinear(t: float, depth: Array) -> Array:
    return np.column_stack([(1 - t) * (1 - depth), t * (1 - depth), (1 - t) * depth, t * depth])


def _four(ends: Index, new: _Nodes) -> Index:
    """Three slices across the marked edges."""
    a, b = ends[:, :, 0], ends[:, :, 1]
    nodes = np.stack([new.on_edge(ends[:, k]) for k in range(4)], axis=1)
    p, q = nodes[:, :, 0], nodes[:, :, 1]
    slices = [np.stack([u, v], axis=2) for u, v in ((a, p), (p, q), (q, b))]
    return np.stack([_hexahedron(s) for s in slices], axis=1)


def _hexahedron(ends: Index) -> Index:
    """Return hexahedra whose first axis runs along four edges in cyclic order, ``(m, 4, 2)``."""
    return ends.reshape(-1, 8)[:, [0, 1, 3, 2, 6, 7, 5, 4]]


def _two(ends: Index, new: _Nodes) -> Index:
    """A plane transition, extruded from edge 0 to edge 1; edges 3 and 2 stay whole."""
    layers = []
    for near, far in ((0, 3), (1, 2)):
        p, q = new.on_edge(ends[:, near]).T
        u, v = new.on_face(ends[:, near], ends[:, far]).T
        (a, b), (c, d) = ends[:, near].T, ends[:, far].T
        layers.append([[a, p, u, c], [p, q, v, u], [q, b, d, v], [u, v, d, c]])
    quads = np.array(layers)  # (layer, quad, corner, cell)
    rows = [
        np.stack([n[0], n[1], m[1], m[0], n[3], n[2], m[2], m[3]], axis=1)
        for n, m in zip(quads[0], quads[1], strict=True)
    ]
    return np.stack(rows, axis=1)


def _one(ends: Index, new: _Nodes) -> Index:
    """A transition from one edge: a small cell at the edge, two at its ends, two across."""
    (a0, b0), (a1, b1), (a2, b2), (a3, b3) = (ends[:, k].T for k in range(4))
    p, q = new.on_edge(ends[:, 0]).T
    a, b = new.on_face(ends[:, 0], ends[:, 1]).T
    e, f = new.on_face(ends[:, 0], ends[:, 3]).T
    first, second = (new.depth(ends[:, [0, k]]) for k in (1, 3))
    corners = ends.reshape(-1, 8)
    c, d = (new.add(corners, _trilinear(t, first, second)) for t in CUTS)
    rows = [
        [p, q, b, a, e, f, d, c],
        [a0, p, a, a1, a3, e, c, a2],
        [q, b0, b1, b, f, b3, b2, d],
        [a, b, b1, a1, c, d, b2, a2],
        [e, f, d, c, a3, b3, b2, a2],
    ]
    return np.stack([np.stack(row, axis=1) for row in rows], axis=1)


def _trilinear(t: float, first: Array, second: Array) -> Array:
    across = [(1 - first) * (1 - second), first * (1 - second), first * second]
    across.append((1 - first) * second)
    return np.stack([w * u for w in across for u in (1 - t, t)], axis=1)
