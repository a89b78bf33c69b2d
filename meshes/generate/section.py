# SPDX-License-Identifier: LGPL-3.0-or-later
"""Plane quadrilateral sections: structured blocks, joined and smoothed, with a surface band.

The band is the block under a running surface. Its nodes carry the arc length ``s`` along the
profile and the row ``d`` (0 on the surface, counted in rows of the block), so that a refinement
can place new nodes on the exact profile.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize

from meshes.profiles.profiles import Profile

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Band:
    """Map from (s, d) to the plane.

    Attributes:
        profile: The exact running surface, d = 0.
        stations: Arc length of the columns of nodes, shape ``(m,)`` [m].
        lines: Nodes row by row, the first on the profile, shape ``(rows + 1, m, 2)`` [m].
    """

    profile: Profile
    stations: Array
    lines: Array

    def at(self, s: Array, d: Array) -> Array:
        """Return the points at arc length ``s`` [m] and row ``d``, shape ``(n, 2)`` [m]."""
        row = np.clip(np.floor(d), 0, len(self.lines) - 2).astype(int)
        col = np.clip(
            np.searchsorted(self.stations, s, side="right") - 1, 0, len(self.stations) - 2
        )
        u = (s - self.stations[col]) / np.diff(self.stations)[col]
        upper, lower = (
            (1 - u)[:, None] * self.lines[r, col] + u[:, None] * self.lines[r, col + 1]
            for r in (row, row + 1)
        )
        upper[row == 0] = self.profile.at(s[row == 0])
        t = (d - row)[:, None]
        return np.asarray((1 - t) * upper + t * lower)


@dataclass(frozen=True)
class Section:
    """A conforming quadrilateral mesh of a plane section.

    Attributes:
        points: Node positions, shape ``(n, 2)`` [m].
        quads: Nodes of each quad, counter-clockwise, shape ``(q, 4)``.
        blocks: Block number of each quad, in the order given, shape ``(q,)``.
        s: Arc length of the nodes of the band, NaN elsewhere, shape ``(n,)`` [m].
        d: Row of the nodes of the band, NaN elsewhere, shape ``(n,)``.
        band: Map from (s, d) to the plane.
    """

    points: Array
    quads: Index
    blocks: Index
    s: Array
    d: Array
    band: Band


def coons(bottom: Array, right: Array, top: Array, left: Array) -> Array:
    """Return the nodes of a block between four edges, shape ``(rows + 1, columns + 1, 2)`` [m].

    Bottom and top run left to right, left and right bottom to top.

    Raises:
        ValueError: if opposite edges differ in their number of nodes or corners do not meet.
    """
    if len(bottom) != len(top) or len(left) != len(right):
        raise ValueError(
            f"block: expected as many nodes on opposite edges, got bottom {len(bottom)}, top "
            f"{len(top)}, left {len(left)}, right {len(right)}"
        )
    corners = ((bottom[0], left[0]), (bottom[-1], right[0]), (top[0], left[-1]))
    if not all(np.allclose(p, q, atol=1e-9) for p, q in (*corners, (top[-1], right[-1]))):
        raise ValueError("block: expected edges that meet in the corners")
    u = _share(bottom, top)[None, :, None]
    v = _share(left, right)[:, None, None]
    return np.asarray(
        (1 - v) * bottom
        + v * top
        + (1 - u) * left[:, None]
        + u * right[:, None]
        - (1 - v) * ((1 - u) * bottom[0] + u * bottom[-1])
        - v * ((1 - u) * top[0] + u * top[-1])
    )


def divided(profile: Profile, start: float, end: float, cells: int) -> Array:
    """Return equally spaced points of a profile from ``start`` to ``end`` arc length [m]."""
    return profile.at(np.linspace(start, end, cells + 1))


def straight(start: npt.ArrayLike, end: npt.ArrayLike, cells: int) -> Array:
    """Return equally spaced points on a line, shape ``(cells + 1, 2)`` [m]."""
    t = np.linspace(0, 1, cells + 1)[:, None]
    return np.asarray((1 - t) * np.asarray(start) + t * np.asarray(end))


def spaced(polyline: Array, at: Array) -> Array:
    """Return points of a polyline at given shares of its length, shape ``(len(at), 2)`` [m]."""
    t = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(polyline, axis=0).T))])
    return np.column_stack([np.interp(at * t[-1], t, polyline[:, k]) for k in range(2)])


def assembled(
    blocks: list[Array],
    profile: Profile,
    stations: Array,
    first_row: float,
    *,
    upright: float = 1.0,
) -> Section:
    """Return the blocks joined and smoothed; the last row of the first block is the band's top.

    Args:
        blocks: Nodes of each block, shape ``(rows + 1, columns + 1, 2)`` [m].
        profile: Exact running surface under which the first block lies.
        stations: Arc length of the columns of the first block [m].
        first_row: Wanted height of the row under the surface [m].
        upright: Weight of that row in the smoothing; the larger, the nearer to right angles do
            columns meet the surface.
    """
    shapes = [b.shape[:2] for b in blocks]
    raw = np.vstack([b.reshape(-1, 2) for b in blocks])
    _, first, inverse = np.unique(
        np.round(raw / 1e-8).astype(np.int64), axis=0, return_index=True, return_inverse=True
    )
    start = np.cumsum([0, *(m * n for m, n in shapes)])
    numbers = [
        inverse[a : a + m * n].reshape(m, n) for a, (m, n) in zip(start, shapes, strict=False)
    ]
    quads = [numbered(number) for number in numbers]
    points = raw[first]
    band = numbers[0][::-1]
    weights = np.ones(len(np.vstack(quads)))
    weights[: len(quads[0])].reshape(len(band) - 1, -1)[-1] = upright
    points = smoothed(points, np.vstack(quads))
    points[band[1:-1, 1:-1]] = _respaced(points[band], first_row)[1:-1, 1:-1]
    points = smoothed(points, np.vstack(quads), weights)
    points[band[1:-1, 1:-1]] = _respaced(points[band], first_row)[1:-1, 1:-1]
    s, d = np.full(len(points), np.nan), np.full(len(points), np.nan)
    s[band] = stations
    d[band] = np.arange(len(band))[:, None]
    block = np.repeat(np.arange(len(quads)), [len(q) for q in quads])
    return Section(points, np.vstack(quads), block, s, d, Band(profile, stations, points[band]))


def numbered(numbers: Index) -> Index:
    """Return the quads of a block, given the numbers of its nodes row by row, shape ``(q, 4)``."""
    quads = [numbers[:-1, :-1], numbers[:-1, 1:], numbers[1:, 1:], numbers[1:, :-1]]
    return np.stack([q.ravel() for q in quads], axis=1)


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
        result = minimize(
            _distortion,
            x[free].ravel(),
            args=(x, free, corners, wanted, weight, delta),
            jac=True,
            method="L-BFGS-B",
            options={"maxiter": 400},
        )
        x[free] = result.x.reshape(-1, 2)
    return x


def _respaced(lines: Array, first: float) -> Array:
    """Return the nodes of a band moved along its columns until the first row is ``first`` high."""
    moved = lines.copy()
    for k in range(lines.shape[1]):
        t = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(lines[:, k], axis=0).T))])
        low = min(first, 0.5 * t[-1])
        new = low + (t[1:] - t[1]) * (t[-1] - low) / (t[-1] - t[1])
        moved[1:, k] = np.column_stack([np.interp(new, t, lines[:, k, j]) for j in range(2)])
    return moved


def _distortion(
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


def _share(first: Array, second: Array) -> Array:
    """Return the mean share of length at the nodes of two opposite edges."""
    shares = []
    for edge in (first, second):
        t = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(edge, axis=0).T))])
        shares.append(t / t[-1])
    return np.asarray((shares[0] + shares[1]) / 2)
