# SPDX-License-Identifier: LGPL-3.0-or-later
"""Which contactor nodes may touch which facets: bucket grid and neighbourhood of the patch."""

from typing import Any

import numpy as np
import numpy.typing as npt

from contact._kernel import ffi, lib
from contact.arrays import view
from contact.smooth import Smooth
from contact.surface import Surface, facet_areas

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.int32]

SHARP = 16
_SHARP_COSINE = np.cos(np.radians(40.0))  # beyond it the projection alone cannot be trusted


def node_facets(quad: Index, n: int) -> tuple[Index, Index]:
    """Return the facets round each of ``n`` nodes as (offsets ``(n + 1,)``, facets)."""
    order = np.argsort(quad.ravel(), kind="stable")
    around = np.zeros(n + 1, dtype=np.int32)
    np.cumsum(np.bincount(quad.ravel(), minlength=n), out=around[1:])
    return around, (order // 4).astype(np.int32)


def facet_kinds(points: Array, quad: Index, around: Index, ring: Index) -> npt.NDArray[np.uint8]:
    """Return the bits of each facet: open border edges (0-3), sharp neighbour (4)."""
    ends = np.sort(np.stack([quad, np.roll(quad, -1, axis=1)], axis=2), axis=2).reshape(-1, 2)
    _, edge, count = np.unique(ends, axis=0, return_inverse=True, return_counts=True)
    border = (count[edge.ravel()] == 1).reshape(-1, 4)
    kind = (border << np.arange(4)).sum(axis=1)
    normal = facet_areas(points, quad)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    corner = quad.ravel()
    valence = np.diff(around)
    for k in range(int(valence.max())):
        has = valence[corner] > k
        mine = np.repeat(np.arange(len(quad)), 4)[has]
        other = ring[around[corner[has]] + k]
        sharp = np.einsum("ia,ia->i", normal[mine], normal[other]) < _SHARP_COSINE
        kind[mine[sharp]] |= SHARP
    return kind.astype(np.uint8)


def typical_edge(surface: Surface) -> float:
    """Return the 5th percentile of the edge lengths [m]: the size of a cell in the fine zone."""
    p = surface.reference[surface.facets]
    return float(np.percentile(np.linalg.norm(p - np.roll(p, -1, axis=1), axis=2), 5))


class Search:
    """Candidates of a pair; nodes are stacked, contactor first.

    Attributes:
        quad: Target facets in the stacked numbering, shape ``(q, 4)``.
        live: 1 for facets of the neighbourhood, whose nodes are kept up to date, ``(q,)``.
        outward: Normals of the contactor near the target, shape ``(nc, 3)``.
        size: Square root of the facet areas, shape ``(q,)`` [m].
        kind, around, ring: Topology of the target, see ``kernel.h``.
        smooth: Its corner normals, None for bilinear facets.
        flat: What the kernel takes for them there.
    """

    def __init__(
        self, contactor: Surface, target: Surface, smooth_below: float | None = None
    ) -> None:
        """Prepare; facets that meet at less than ``smooth_below`` [rad] form a smooth target."""
        self.nc = len(contactor.nodes)
        self.n = self.nc + len(target.nodes)
        self.facets = contactor.facets
        self.quad = np.ascontiguousarray(target.facets + self.nc, dtype=np.int32)
        points = np.vstack([contactor.reference, target.reference])
        self.around, self.ring = node_facets(self.quad, self.n)
        self.kind = facet_kinds(points, self.quad, self.around, self.ring)
        self.size = np.sqrt(np.linalg.norm(facet_areas(points, self.quad), axis=1))
        p = points[self.quad]
        self._longest = float(np.linalg.norm(p[:, [0, 1]] - p[:, [2, 3]], axis=2).max())
        self.live = np.zeros(len(self.quad), dtype=np.uint8)
        self.outward = np.zeros((self.nc, 3))
        self.smooth = None
        if smooth_below is not None:
            self.smooth = Smooth(points, self.quad, smooth_below)
        self.flat = (ffi.NULL,) * 3
        self._c_track = (
            *(
                view(key, a, a.shape, a.dtype)
                for key, a in (
                    ("quad", self.quad),
                    ("kind", self.kind),
                    ("size", self.size),
                    ("around", self.around),
                    ("ring", self.ring),
                    ("live", self.live),
                    ("outward", self.outward),
                )
            ),
            *(self.smooth.c if self.smooth else self.flat),
        )

    def _near(self, x: Array, pad: float) -> tuple[Index, Index, Array]:
        """Return contactor nodes and facets (with boxes) that come within ``pad`` [m]."""
        none = np.empty(0, dtype=np.int32)
        y = x[self.nc :]
        low, high = y.min(axis=0) - pad, y.max(axis=0) + pad
        c = x[: self.nc]
        item = np.flatnonzero(((c >= low) & (c <= high)).all(axis=1)).astype(np.int32)
        if not item.size:
            return item, none, np.empty((0, 6))
        low, high = c[item].min(axis=0) - pad, c[item].max(axis=0) + pad
        # facets stretch with their nodes, hence the factor on the undeformed length
        room = 1.5 * self._longest
        close = ((y >= low - room) & (y <= high + room)).all(axis=1)
        pick = np.flatnonzero(close[self.quad[:, 0] - self.nc])
        corner = x[self.quad[pick]]
        lows, highs = corner.min(axis=1) - pad, corner.max(axis=1) + pad
        meet = ((highs >= low) & (lows <= high)).all(axis=1)
        box = np.ascontiguousarray(np.hstack([lows, highs])[meet])
        return item, pick[meet].astype(np.int32), box

    def _grid(self, x: Array, item: Index, box: Array) -> tuple[Array, npt.NDArray[np.int64]]:
        """Return origin and edge of the grid, and its cells along each axis."""
        low, high = x[item].min(axis=0), x[item].max(axis=0)
        span = np.maximum(high - low, 1e-12)
        edge = float(np.median((box[:, 3:] - box[:, :3]).max(axis=1)))
        edge = max(min(edge, float(span.max())), 1e-3 * float(span.max()))
        while np.prod(np.ceil(span / edge) + 1) > 8 * (len(item) + len(box)) + 64:
            edge *= 1.3
        return np.array([*low, edge]), (np.ceil(span / edge) + 1).astype(np.int64)

    def _normals(self, x: Array, item: Index) -> None:
        """Update the outward normals of the contactor nodes ``item``."""
        near = np.zeros(self.nc, dtype=bool)
        near[item] = True
        quads = self.facets[near[self.facets].any(axis=1)]
        area = np.repeat(facet_areas(x, quads), 4, axis=0)
        for a in range(3):
            self.outward[:, a] = np.bincount(quads.ravel(), area[:, a], minlength=self.nc)
        length = np.linalg.norm(self.outward, axis=1)
        self.outward /= np.where(length > 0.0, length, 1.0)[:, None]

    def candidates(
        self, xv: Array, above: float, below: float, stiffness: Array, facet: Index, xi: Array
    ) -> Index:
        """Return the contactor nodes near the target, ascending, and set facet, xi and live.

        Args:
            xv: Position and velocity of all nodes, shape ``(n, 6)``.
            above: A node counts up to this distance outside the target [m].
            below: And up to this depth inside it [m]; nodes in contact up to ``above``.
            stiffness: Positive for nodes in contact, which keep their facet, ``(nc,)`` [N/m].
            facet: Closest facet, out, shape ``(nc,)``.
            xi: Its local coordinates, out, shape ``(nc, 2)``.
        """
        x = xv[:, :3]
        self.live[:] = 0
        # facets stay usable while nodes move by ``above``
        item, pick, box = self._near(x, 2.0 * max(above, below))
        if not (item.size and pick.size):
            return np.empty(0, dtype=np.int32)
        self._normals(x, item)
        grid, dims = self._grid(x, item, box)
        c_box, c_grid = view("box", box, (-1, 6)), view("grid", grid, (4,))
        c_dims = view("dims", dims, (3,), np.int64)
        start = np.zeros(int(np.prod(dims)) + 1, dtype=np.int64)
        m = lib.wr_buckets(
            len(box), c_box, c_grid, c_dims, view("counts", start[1:], (-1,), np.int64), ffi.NULL
        )
        np.cumsum(start, out=start)
        entry = np.empty(m, dtype=np.int32)
        c_entry = view("entry", entry, (m,), np.int32)
        cursor = start[:-1].copy()
        lib.wr_buckets(
            len(box), c_box, c_grid, c_dims, view("cursor", cursor, (-1,), np.int64), c_entry
        )
        hit = np.zeros(len(item), dtype=np.uint8)
        lib.wr_search(
            len(item),
            view("item", item, (-1,), np.int32),
            view("xv", xv, (self.n, 6)),
            view("outward", self.outward, (self.nc, 3)),
            view("quad", self.quad, (-1, 4), np.int32),
            view("pick", pick, (-1,), np.int32),
            c_box,
            c_grid,
            c_dims,
            view("start", start, (-1,), np.int64),
            c_entry,
            above,
            below,
            view("stiffness", stiffness, (self.nc,)),
            view("facet", facet, (self.nc,), np.int32, out=True),
            view("xi", xi, (self.nc, 2), out=True),
            view("hit", hit, (-1,), np.uint8, out=True),
            view("live", self.live, (-1,), np.uint8, out=True),
        )
        return item[hit == 1]

    def neighbourhood(self, item: Index) -> Index:
        """Return the nodes to keep up to date: ``item`` and those of the live facets.

        A smooth target needs the facets round these as well.
        """
        facets = self.smooth.choose(self.live) if self.smooth else self.live == 1
        return np.concatenate([item, np.unique(self.quad[facets])]).astype(np.int32)

    def track(self, k: int, item: Any, xv: Any, contact_state: dict[str, Any]) -> None:
        """Follow the closest points of ``k`` candidates; all arguments are views.

        Args:
            k: Number of candidates.
            item: Candidates.
            xv: Positions of all nodes.
            contact_state: ``facet, xi, gap, normal``, which are written.
        """
        if self.smooth:
            self.smooth.update(xv)
        out = (contact_state[key] for key in ("facet", "xi", "gap", "normal"))
        lib.wr_track(k, item, xv, *self._c_track, *out)
