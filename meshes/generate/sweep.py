# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sections swept into hexahedra along a line or round an axis, and refined in a zone."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from meshes.arrays import Array, Index
from meshes.generate.refine import trisect
from meshes.generate.section import Band, Section
from meshes.hexmesh import edges_of

Place = Callable[[Array], Array]

Y, Z, X, S, D = range(5)
LEAST = 1.3  # an edge is cut while it is longer than this times the wanted size
NARROW = 1.55  # cells of a strip are cut while they are wider than this times the wanted size
CURVED_EDGES = 8  # at least so many edges round the gauge corner and the flange root


@dataclass(frozen=True)
class Swept:
    """Hexahedra whose nodes carry the coordinates of the sweep.

    Attributes:
        params: Section coordinates y, z [m], sweep coordinate x [m or rad], and s [m], d in the
            band (NaN elsewhere), shape ``(n, 5)``.
        cells: Nodes of each hexahedron in VTK order, shape ``(c, 8)``.
        blocks: Section block of each cell, shape ``(c,)``.
        period: Period of x, infinite for an open sweep.
    """

    params: Array
    cells: Index
    blocks: Index
    period: float


@dataclass(frozen=True)
class Strip:
    """Part of a running surface with narrower cells, along all of the refined stretch.

    Attributes:
        start, end: Arc length between which cells are narrow [m].
        size: Wanted width of cells along the profile [m].
    """

    start: float
    end: float
    size: float


@dataclass(frozen=True)
class Zone:
    """Where and how finely a swept mesh is refined under its running surface.

    Attributes:
        levels: Number of nested 3:1 refinements.
        columns: Stations of the band [m].
        first, last: Columns between which the surface is fine at the last level.
        start, end: Sweep coordinate between which it is fine [m or rad].
        spacing: Spacing of the unrefined sweep there [m or rad].
        size: Wanted length of edges along the profile [m].
        strip: Where they are narrower still, if anywhere.
    """

    levels: int
    columns: Array
    first: int
    last: int
    start: float
    end: float
    spacing: float
    size: float
    strip: Strip | None = None

    def along(self, level: int, cells: int = 0) -> tuple[float, float]:
        """Return the refined stretch of a level, widened by ``cells`` cells at either end.

        A level covers the next one with the four cells that its transitions take.
        """
        widen = sum(4 * self.spacing / 3**k for k in range(level, self.levels))
        widen += (cells + 0.999) * self.spacing / 3 ** (level - 1)
        return self.start - widen, self.end + widen

    def across(self, level: int, cells: int = 0) -> tuple[float, float]:
        """Return the refined part of the profile, widened by ``cells`` cells of the level."""
        margin = self.levels - level
        low, high = self.first - margin, self.last + margin
        share = cells / 3 ** (level - 1)
        at = np.arange(len(self.columns))
        low_s, high_s = np.interp([low - share, high + share], at, self.columns)
        return float(low_s), float(high_s)


def extrude(section: Section, stations: Array) -> Swept:
    """Return a section swept along x over ``stations`` [m]."""
    return _swept(section, stations, np.inf)


def revolve(section: Section, sectors: int) -> Swept:
    """Return a section (y, r) swept round the y axis; x is the angle, 0 at the bottom [rad]."""
    return _swept(section, 2 * np.pi * np.arange(sectors) / sectors, 2 * np.pi)


def levels_for(size: float, *, coarsest: float = 8e-3) -> int:
    """Return how many 3:1 refinements lead from a coarse section to ``size`` [m].

    Raises:
        ValueError: if the size is not between 0.5 and 8 mm.
    """
    if not 0.5e-3 <= size <= 8e-3:
        raise ValueError(f"size: expected 0.5e-3 to 8e-3 m, got {size}")
    return max(1, int(np.ceil(np.log(coarsest / size) / np.log(3) - 1e-9)))


def columns_for(
    length: float, size: float, levels: int, *, curved: bool = False, least: int = 1
) -> int:
    """Return the columns of a piece of profile whose 3:1 refinement makes edges of ``size``.

    Args:
        length: Length of the piece [m].
        size: Wanted length of edges [m].
        levels: Largest number of refinements.
        curved: Whether the piece is an arc that needs at least 8 edges.
        least: Smallest number of columns.
    """
    edges = max(length / (LEAST * size), CURVED_EDGES if curved else 1)
    choices = []
    for k in range(1, levels + 1):
        columns = int(np.ceil(edges / 3**k - 1e-9))
        columns = max(columns, least, int(np.ceil(length / 16e-3)))
        choices.append((columns * 3**k, columns))
    return min(choices)[1]


def refine(swept: Swept, zone: Zone, band: Band, place: Place) -> Swept:
    """Return the mesh refined in the zone: at each level first in depth, then along s, then x.

    Each direction reaches one cell further than the next along x, and x one cell further along s
    and d, so that no cell is part of two transitions.
    """
    for level in range(1, zone.levels + 1):
        depth = 1 / 3 ** (level - 1)
        across = zone.across(level)
        box = {"s": across, "d": (0.0, depth), "x": zone.along(level, 2)}
        swept = cut(swept, D, box, band, place)
        box["x"] = zone.along(level, 1)
        least = LEAST * zone.size if level > 1 else 0.0
        swept = cut(swept, S, box, band, place, least=least)
        box = {"s": zone.across(level, 1), "d": (0.0, 2 * depth), "x": zone.along(level)}
        swept = cut(swept, X, box, band, place)
    return swept if zone.strip is None else narrowed(swept, zone, zone.strip, band, place)


def refined_cells(section: Section, zone: Zone) -> int:
    """Return about how many cells :func:`refine` adds to a swept section.

    Short zones of the same levels are refined: the number grows in proportion to their length.

    Args:
        section: The section.
        zone: Where it would be refined.
    """

    def place(params: Array) -> Array:
        return params[:, [X, Y, Z]]

    lengths, added = (4.0, 6.0), []
    for length in lengths:
        short = replace(zone, start=0.0, end=length * zone.spacing)
        low, high = (round(end / zone.spacing) for end in short.along(1, 4))
        at: Array = zone.spacing * np.arange(low - 1.0, high + 2.0)
        coarse = extrude(section, at)
        added.append(len(refine(coarse, short, section.band, place).cells) - len(coarse.cells))
    slope = (added[1] - added[0]) / (lengths[1] - lengths[0])
    return round(added[0] + slope * ((zone.end - zone.start) / zone.spacing - lengths[0]))


def narrowed(swept: Swept, zone: Zone, strip: Strip, band: Band, place: Place) -> Swept:
    """Return the refined mesh with its top cells cut in three, in depth and across, along a strip.

    Cuts are repeated until cells are as narrow as wanted. Each leaves a cell of its own at either
    side and end for the transitions of the next.

    Raises:
        ValueError: if the strip does not lie on the refined part of the profile.
    """
    cell = zone.spacing / 3**zone.levels
    low, high = zone.columns[zone.first], zone.columns[zone.last]
    if not low <= strip.start < strip.end <= high:
        raise ValueError(
            f"strip: expected a part of the fine profile, {low:.4f} to {high:.4f} m of arc length, "
            f"got {strip.start:.4f} to {strip.end:.4f} m"
        )
    cuts = _cuts(_columns(swept, zone, strip.start, strip.end), strip.size)
    for k in range(1, cuts + 1):
        columns = _columns(swept, zone, strip.start, strip.end, beside=cuts - k)
        box = {"s": (columns[0], columns[-1]), "d": (0.0, 1 / 3 ** (zone.levels + k - 1))}
        for axis, cells in ((D, 2 * k - 1), (S, 2 * k)):
            box["x"] = (zone.start + cells * cell, zone.end - cells * cell)
            swept = cut(swept, axis, box, band, place)
    return swept


def _columns(swept: Swept, zone: Zone, start: float, end: float, beside: int = 0) -> Array:
    """Return the columns of the fine surface that enclose a part of it, and some beside [m]."""
    x = _wrapped_to(swept.params[:, X], (zone.start + zone.end) / 2, swept.period)
    middle = (swept.params[:, D] == 0) & (x >= zone.start) & (x <= zone.end)
    s = np.unique(np.round(swept.params[middle, S], 9))
    first = max(0, int(np.searchsorted(s, start + 1e-9, side="right")) - 1 - beside)
    last = min(len(s) - 1, int(np.searchsorted(s, end - 1e-9)) + beside)
    return np.asarray(s[first : last + 1])


def _cuts(columns: Array, size: float) -> int:
    """Return how often columns are cut in three until they are about as wide as wanted."""
    width = float(np.diff(columns).mean())
    return max(0, int(np.ceil(np.log(width / (NARROW * size)) / np.log(3) - 1e-9)))


def cut(
    swept: Swept,
    axis: int,
    box: dict[str, tuple[float, float]],
    band: Band,
    place: Place,
    *,
    least: float = 0.0,
) -> Swept:
    """Return the mesh with all edges along one coordinate in a box cut in three.

    Args:
        swept: The mesh.
        axis: Coordinate along which the edges run: S, D or X.
        box: Smallest and largest coordinate, by name (y, z, x, s, d); others are free.
        band: Map from (s, d) to the section.
        place: Map from sweep coordinates to space.
        least: Edges shorter than this are left [m or rad].
    """
    edges, of_cell = edges_of(swept.cells)
    ends = swept.params[edges]
    step = np.abs(_wrapped(np.diff(ends, axis=1)[:, 0], swept.period))
    fixed = {S: (D, X), D: (S, X), X: (Y, Z)}[axis]
    marked = (step[:, fixed] < 1e-9).all(axis=1) & (step[:, axis] > max(least, 1e-9))
    for name, (low, high) in box.items():
        value = ends[:, :, "yzxsd".index(name)]
        if name == "x":
            value = _wrapped_to(value, (low + high) / 2, swept.period)
        marked &= ((value >= low - 1e-9) & (value <= high + 1e-9)).all(axis=1)
    made = trisect(place(swept.params), swept.cells, edges, of_cell, marked)
    new = _interpolated(swept, made.sources, made.weights)
    known = np.isfinite(new[:, S])
    new[known, :2] = band.at(new[known, S], new[known, D])
    params = np.vstack([swept.params, new])
    return Swept(params, made.cells, swept.blocks[made.parents], swept.period)


def _interpolated(swept: Swept, sources: Index, weights: Array) -> Array:
    values = swept.params[sources]
    values[:, 1:] = values[:, :1] + _wrapped(values[:, 1:] - values[:, :1], swept.period)
    return np.asarray(np.einsum("mk,mkj->mj", weights, values))


def _wrapped_to(x: Array, middle: float, period: float) -> Array:
    """Return sweep coordinates within half a period of ``middle``."""
    if not np.isfinite(period):
        return x
    return np.asarray(middle + (x - middle + period / 2) % period - period / 2)


def _wrapped(step: Array, period: float) -> Array:
    """Return coordinate differences with x taken the short way round."""
    if np.isfinite(period):
        step[..., X] -= period * np.round(step[..., X] / period)
    return step


def _swept(section: Section, stations: Array, period: float) -> Swept:
    n, closed = len(section.points), np.isfinite(period)
    layers = len(stations) if closed else len(stations) - 1
    start = n * np.arange(layers)[:, None, None]
    end = n * ((np.arange(layers) + 1) % len(stations))[:, None, None]
    if closed:  # (y, r, angle) is left-handed
        start, end = end, start
    cells = np.concatenate([section.quads + start, section.quads + end], axis=2).reshape(-1, 8)
    plane = np.column_stack([section.points, np.zeros(n), section.s, section.d])
    params = np.tile(plane, (len(stations), 1))
    params[:, X] = np.repeat(stations, n)
    return Swept(params, cells, np.tile(section.blocks, layers), period)
