# SPDX-License-Identifier: LGPL-3.0-or-later
"""Plane quadrilateral sections: structured blocks, joined and smoothed, with a surface band.

The band is the block under a running surface. Its nodes carry the arc length ``s`` along the
profile and the row ``d`` (0 on the surface, counted in rows of the block), so that a refinement
can place new nodes on the exact profile.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from meshes.arrays import Array, Index
from meshes.generate.smooth import smoothed
from meshes.profiles.profiles import Profile


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


def _respaced(lines: Array, first: float) -> Array:
    """Return the nodes of a band moved along its columns until the first row is ``first`` high."""
    moved = lines.copy()
    for k in range(lines.shape[1]):
        t = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(lines[:, k], axis=0).T))])
        low = min(first, 0.5 * t[-1])
        new = low + (t[1:] - t[1]) * (t[-1] - low) / (t[-1] - t[1])
        moved[1:, k] = np.column_stack([np.interp(new, t, lines[:, k, j]) for j in range(2)])
    return moved


def _share(first: Array, second: Array) -> Array:
    """Return the mean share of length at the nodes of two opposite edges."""
    shares = []
    for edge in (first, second):
        t = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(edge, axis=0).T))])
        shares.append(t / t[-1])
    return np.asarray((shares[0] + shares[1]) / 2)
