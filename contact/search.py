# SPDX-License-Identifier: LGPL-3.0-or-later
"""Search for contactor nodes near the target: bucket grid, candidates, tracking.

Ranks share the work and have the same result, see :mod:`contact.sharing`.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from contact._kernel import ffi, lib
from contact.arrays import Index32, struct, view
from contact.contact_state import ContactState
from contact.sharing import Parts, Shared, parted
from contact.smooth import Corners, Smooth
from contact.stack import Stack
from contact.surface import Surface
from meshes.arrays import Array
from meshes.quads import area_vectors

if TYPE_CHECKING:
    from mpi4py import MPI

SHARP = lib.WR_SHARP
_SHARP_COSINE = np.cos(np.radians(40.0))  # beyond it the projection alone cannot be trusted


def node_facets(quad: Index32, n: int) -> tuple[Index32, Index32]:
    """Return the facets round each of ``n`` nodes as (offsets ``(n + 1,)``, facets)."""
    order = np.argsort(quad.ravel(), kind="stable")
    around = np.zeros(n + 1, dtype=np.int32)
    np.cumsum(np.bincount(quad.ravel(), minlength=n), out=around[1:])
    return around, (order // 4).astype(np.int32)


def facet_kinds(
    points: Array, quad: Index32, around: Index32, ring: Index32
) -> npt.NDArray[np.uint8]:
    """Return the bits of each facet: open border edges (0-3), sharp neighbour (4)."""
    ends = np.sort(np.stack([quad, np.roll(quad, -1, axis=1)], axis=2), axis=2).reshape(-1, 2)
    _, edge, count = np.unique(ends, axis=0, return_inverse=True, return_counts=True)
    border = (count[edge.ravel()] == 1).reshape(-1, 4)
    kind = (border << np.arange(4)).sum(axis=1)
    normal = area_vectors(points, quad)
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


def typical_edge(surface: Surface, percentile: float = 5.0) -> float:
    """Return a low percentile of the edge lengths [m]: the size of a cell in the fine zone."""
    p = surface.reference[surface.facets]
    return float(np.percentile(np.linalg.norm(p - np.roll(p, -1, axis=1), axis=2), percentile))


@dataclass(frozen=True, eq=False)
class Found:
    """Result of a search.

    Attributes:
        item: Contactor nodes that may touch, ascending, shape ``(k,)``.
        facet: Closest facet of each, shape ``(k,)``.
        xi: Its local coordinates, shape ``(k, 2)``.
        live: 1 for facets near them, whose nodes are to be kept up to date, shape ``(q,)``.
        outward: Normals of the contactor near the target, shape ``(nc, 3)``.
        nodes: Nodes to keep up to date.
        corners: Normals to keep up to date, of a smooth target.
        c: What tracking takes, for the kernel.
        shared: The part of it that this rank takes, None if each takes all.
    """

    item: Index32
    facet: Index32
    xi: Array
    live: npt.NDArray[np.uint8]
    outward: Array
    nodes: Index32
    corners: Corners | None
    c: Any
    shared: Shared | None


def _bounds(xv: Array, pad: float) -> Array:
    """Return low and high corner of the box round nodes, wider by ``pad`` [m], shape ``(6,)``."""
    box = np.empty(6)
    lib.wr_bounds(len(xv), view("xv", xv, (-1, 6)), view("box", box, (6,), out=True))
    return box + pad * np.array([-1.0, -1.0, -1.0, 1.0, 1.0, 1.0])


def _told(
    parts: Parts,
    item: Index32,
    facet: Index32,
    xi: Array,
    live: npt.NDArray[np.uint8],
    outward: Array,
) -> Index32:
    """Bring what each rank has found to all; return all candidates, ascending."""
    rows = parts.all_of(np.hstack([item[:, None], facet[item, None], xi[item], outward[item]]))
    parts.any_of(live)
    item = rows[:, 0].astype(np.int32)
    facet[item], xi[item], outward[item] = rows[:, 1], rows[:, 2:4], rows[:, 4:]
    return item


class Search:
    """Candidates of a pass.

    Attributes:
        stack: Numbers of its nodes.
        nc, n: Number of contactor nodes, or of the points instead, and of all nodes.
        quad: Target facets in the stacked numbering, shape ``(q, 4)``.
        size: Square root of the facet areas, shape ``(q,)`` [m].
        kind, around, ring: Topology of the target, see ``kernel.h``.
        smooth: Its corner normals, None for bilinear facets.
        points: Points for the kernel, None where nodes touch.
        comm: Ranks that share the work, None for one.
        c: The target for the kernel.
    """

    def __init__(
        self,
        contactor: Surface,
        target: Surface,
        smooth_below: float | None = None,
        points_below: float | None = None,
        comm: "MPI.Comm | None" = None,
    ) -> None:
        """Prepare; facets that meet at less than ``smooth_below`` [rad] form a smooth target.

        With ``points_below`` points in the contactor's facets touch, which it curves. Ranks of
        ``comm`` share the work.
        """
        self.comm = comm
        self.stack = stack = Stack(contactor, target, points_below)
        self.nc, self.n = stack.nc, stack.n
        self.points = stack.for_kernel()
        self.facets = contactor.facets
        self.quad = np.ascontiguousarray(target.facets + self.nc, dtype=np.int32)
        points = stack.reference
        self.around, self.ring = node_facets(self.quad, self.n)
        self.kind = facet_kinds(points, self.quad, self.around, self.ring)
        self.size = np.sqrt(np.linalg.norm(area_vectors(points, self.quad), axis=1))
        self.smooth = None
        curved: dict[str, npt.NDArray[Any]] = {}
        if smooth_below is not None:
            self.smooth = s = Smooth(points, self.quad, smooth_below)
            curved = {"across": s.across, "corner": s.corner, "normals": s.normals}
        self.c = struct(
            "wr_target",
            quad=self.quad,
            kind=self.kind,
            size=self.size,
            around=self.around,
            ring=self.ring,
            **curved,
        )

    def _facets_near(self, xv: Array, item: Index32, pad: float) -> tuple[Index32, Array]:
        """Return the facets that come within ``pad`` [m] of the nodes ``item``, and their boxes."""
        q = len(self.quad)
        pick, box = np.empty(q, dtype=np.int32), np.empty((q, 6))
        round_item = view("box", _bounds(xv[item], pad), (6,))
        c_xv, c_pick = view("xv", xv, (self.n, 6)), view("pick", pick, (q,), np.int32, out=True)
        c_box = view("box", box, (q, 6), out=True)
        m = lib.wr_facets_within(self.c, q, c_xv, pad, round_item, c_pick, c_box)
        return pick[:m].copy(), box[:m].copy()

    def _within(self, xv: Array, box: Array) -> Index32:
        """Return the contactor nodes in a box, ascending."""
        item = np.empty(self.nc, dtype=np.int32)
        c_item = view("item", item, (self.nc,), np.int32, out=True)
        c_xv = view("xv", xv, (self.n, 6))
        return item[: lib.wr_within(self.nc, c_xv, view("box", box, (6,)), c_item)].copy()

    def _grid(self, x: Array, item: Index32, pick: Index32, box: Array) -> Any:
        """Return a grid over the nodes ``item`` with the boxes of the facets ``pick``."""
        low, high = x[item].min(axis=0), x[item].max(axis=0)
        span = np.maximum(high - low, 1e-12)
        edge = float(np.median((box[:, 3:] - box[:, :3]).max(axis=1)))
        edge = max(min(edge, float(span.max())), 1e-3 * float(span.max()))
        while np.prod(np.ceil(span / edge) + 1) > 8 * (len(item) + len(box)) + 64:
            edge *= 1.3
        dims = [int(cells) for cells in np.ceil(span / edge) + 1]
        start = np.zeros(int(np.prod(dims)) + 1, dtype=np.int64)
        shape = {"origin": low.tolist(), "edge": edge, "dims": dims}
        grid = struct("wr_grid", box=box, pick=pick, **shape)
        m = lib.wr_buckets(len(box), grid, view("counts", start[1:], (-1,), np.int64), ffi.NULL)
        np.cumsum(start, out=start)
        entry, cursor = np.empty(m, dtype=np.int32), start[:-1].copy()
        lib.wr_buckets(
            len(box),
            grid,
            view("cursor", cursor, (-1,), np.int64),
            view("entry", entry, (m,), np.int32),
        )
        return struct("wr_grid", box=box, pick=pick, start=start, entry=entry, **shape)

    def _normals(self, xv: Array, item: Index32) -> Array:
        """Return the outward normals of the contactor, right at the nodes ``item``."""
        outward = np.zeros((self.nc, 3))
        if self.stack.points is not None:
            area = area_vectors(xv[:, :3], self.stack.behind(item))
            outward[item] = area / np.linalg.norm(area, axis=1)[:, None]
            return outward
        near = np.zeros(self.nc, dtype=np.uint8)
        near[item] = 1
        lib.wr_outward(
            len(self.facets),
            view("facets", self.facets, (-1, 4), np.int32),
            view("near", near, (self.nc,), np.uint8),
            self.nc,
            view("xv", xv, (self.n, 6)),
            view("outward", outward, (self.nc, 3), out=True),
        )
        return outward

    def candidates(self, xv: Array, above: float, below: float, state: ContactState) -> Found:
        """Return the contactor nodes near the target; collective.

        Args:
            xv: Position and velocity of all nodes, shape ``(n, 6)``.
            above: A node counts up to this distance outside the target [m].
            below: And up to this depth inside it [m]; nodes in contact up to ``above``.
            state: Contact of the nodes; those in contact keep their facet. Only read.
        """
        # facets stay usable while nodes move by ``above``
        pad = 2.0 * max(above, below)
        item = self._within(xv, _bounds(xv[self.stack.target], pad))
        if (parts := parted(self.comm, len(item))) is not None:
            item = item[parts.mine]
        pick, box = self._facets_near(xv, item, pad)
        live, outward = np.zeros(len(self.quad), dtype=np.uint8), self._normals(xv, item)
        facet, xi = state.facet.copy(), state.xi.copy()
        arrays = {"item": item, "outward": outward, "live": live, "facet": facet, "xi": xi}
        near = struct("wr_candidates", k=len(item) if pick.size else 0, **arrays)
        if near.k:
            grid = self._grid(xv[:, :3], item, pick, box)
            stiffness = view("stiffness", state.stiffness, (self.nc,))
            lib.wr_search(self.c, grid, view("xv", xv, (self.n, 6)), above, below, stiffness, near)
        item = item[: near.k].copy()
        if parts is not None:
            item = _told(parts, item, facet, xi, live, outward)
        return self.found(item, facet, xi, live, outward)

    def nothing(self) -> Found:
        """Return the result of a search that finds no node."""
        none, live = np.empty(0, dtype=np.int32), np.zeros(len(self.quad), dtype=np.uint8)
        return self.found(none, none, np.empty((0, 2)), live, np.zeros((self.nc, 3)))

    def found(
        self, item: Index32, facet: Index32, xi: Array, live: npt.NDArray[np.uint8], outward: Array
    ) -> Found:
        """Return a result; ``facet`` and ``xi`` are those of all contactor nodes."""
        c = struct("wr_candidates", k=len(item), item=item, outward=outward, live=live)
        parts = parted(self.comm, len(item))
        corners = self.smooth.corners(live) if self.smooth else None
        facets = corners.facets if corners else live == 1
        of_target = np.zeros(self.n, dtype=bool)
        of_target[self.quad[facets]] = True
        on_contactor = np.unique(self.stack.behind(item)) if self.stack.points else item[:0]
        return Found(
            item,
            facet[item],
            xi[item],
            live,
            outward,
            np.concatenate([item, np.flatnonzero(of_target), on_contactor]).astype(np.int32),
            corners,
            c,
            None if parts is None else Shared(parts, item, outward=outward, live=live),
        )

    def bend(self, found: Found, xv: Any) -> None:
        """Curve a smooth target by its normals at the positions in the view ``xv``."""
        if self.smooth and found.corners:
            self.smooth.update(found.corners, xv)

    def track(self, found: Found, xv: Any, state: ContactState) -> None:
        """Follow the closest points of candidates into ``facet, xi, gap, normal`` of a state.

        Collective.

        Args:
            found: The candidates.
            xv: Positions of all nodes, a view; a smooth target is that of the last :meth:`bend`.
            state: Written.
        """
        mine = found.c if found.shared is None else found.shared.c
        lib.wr_track(self.c, mine, xv, state.c)
        if self.points is not None:
            lib.wr_raise(self.points, mine, state.c)
        if found.shared is not None:
            found.shared.tell(state)
