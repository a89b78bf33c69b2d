# SPDX-License-Identifier: LGPL-3.0-or-later
"""Plastic strain and von Mises' stress under a patch, and on the surface that was pressed."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from meshes.arrays import Array, Flags, Index
from meshes.hexmesh import boundary
from meshes.quads import area_vectors
from workflow.figures import style
from workflow.figures.view3d import volume
from workflow.results.record import Body, Record

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MM = 1e3
NUDGE = 1e-6  # off the nodes of a body, where cells would be cut along their faces [m]
SHARE = 0.02  # of the largest plastic strain: where it is more, it is shown
EDGE = 0.1  # of that, beyond the end of a body
ROOM = 0.8  # of the width of that place, shown around it
FACES = 0.5  # least cosine between a facet's normal and the side that is shown


@dataclass(frozen=True)
class Zone:
    """The place that has yielded most, and the cells around it.

    Attributes:
        body: The mesh of the cells that may yield.
        points: Deformed positions, shape ``(n, 3)`` [m].
        strain: Equivalent plastic strain of each cell, shape ``(c,)``.
        stress: Von Mises' stress of each cell, shape ``(c,)`` [Pa].
        worst: Middle of the cell with the largest strain, shape ``(3,)`` [m].
        lower, upper: Ends of what is shown, shape ``(3,)`` [m].
        touch: Middle of the nearest patch, or where most has yielded, shape ``(3,)`` [m].
    """

    body: Body
    points: Array
    strain: Array
    stress: Array
    worst: Array
    lower: Array
    upper: Array
    touch: Array


def plastic_strain(record: Record) -> "Figure | None":
    """What has yielded at the last output: cuts through the cell with most plastic strain.

    Above equivalent plastic strain, below von Mises' stress of the cells that may yield, means of
    each; to the right on the surface of that body, by the nearest patch.
    """
    zone = yielded(record)
    if zone is None:
        return None
    fig = style.figure(style.PAGE, 4.4)
    panels = fig.subplots(2, 3)
    factor, unit = style.prefixed(zone.stress, "Pa")
    rows = (
        ("equivalent plastic strain [%]", zone.strain * 100, "plastic strain"),
        (f"von Mises stress [{unit}]", zone.stress * factor, "von Mises stress"),
    )
    for (label, values, quantity), axes, marks in zip(rows, panels, ("abc", "def"), strict=True):
        limits = 0.0, float(np.nanmax(values))
        for axis, panel, mark in zip((0, 1), axes[:2], marks[:2], strict=True):
            _section(panel, zone, values, axis, limits, quantity)
            at = f"{'xyz'[axis]} = {zone.worst[axis] * MM:.2f} mm"
            style.letter(panel, mark, at)
        faces = _surface(axes[2], zone, values, limits, quantity)
        style.letter(axes[2], marks[2], "surface")
        fig.colorbar(faces, ax=list(axes), label=label, shrink=0.9)
    return fig


def yielded(record: Record) -> Zone | None:
    """Return what has yielded at the last output; None if nothing has or no fields are there."""
    body, cells = record.body, record.cells_at_end()
    strain = cells.get("equivalent_plastic_strain")
    stress = cells.get("von_mises_stress")
    if body is None or strain is None or stress is None or not strain.max(initial=0.0) > 0:
        return None
    points = body.points + record.displacement(np.inf)
    own = np.isfinite(stress)
    centres = points[body.cells].mean(axis=1)
    shown = points[body.cells[strain > SHARE * strain.max()]].reshape(-1, 3)
    lower, upper = shown.min(axis=0), shown.max(axis=0)
    room, worst = ROOM * float((upper - lower).max()), centres[int(np.argmax(strain))]
    mine = points[body.cells[own]].reshape(-1, 3)
    return Zone(
        body.part(own),
        points,
        strain[own],
        stress[own],
        worst,
        np.maximum(lower - room, mine.min(axis=0) - EDGE * room),
        np.minimum(upper + room, mine.max(axis=0) + EDGE * room),
        _touch(record, worst),
    )


def _touch(record: Record, place: Array) -> Array:
    """Return the middle of the patch at the last output that is nearest to a place, or that."""
    pairs = record.scene.get("contacts", {})
    patches = [patch for pair in pairs for patch in record.patches_at(pair, -1).values()]
    centres = [patch.centre for patch in patches]
    return min(centres, key=lambda c: float(np.linalg.norm(c - place)), default=place)


def _section(
    axes: "Axes", zone: Zone, values: Array, axis: int, limits: tuple[float, float], quantity: str
) -> None:
    """Fill the cut across an axis with the values of cells."""
    across = [k for k in range(3) if k != axis]
    at = zone.worst.copy()
    at[axis] += NUDGE
    along = zone.points[zone.body.cells, axis]
    hit = (along.min(axis=1) <= at[axis]) & (along.max(axis=1) > at[axis])
    grid = volume(zone.body.cells[hit], zone.points)
    grid.cell_data["values"] = values[hit]
    cut: Any = grid.slice(normal="xyz"[axis], origin=at, generate_triangles=False)
    corners = np.asarray(cut.points)[:, across] * MM
    _fill(
        axes,
        zone,
        [corners[face] for face in cut.irregular_faces],
        cut["values"],
        across,
        limits,
        quantity,
    )


def _surface(
    axes: "Axes", zone: Zone, values: Array, limits: tuple[float, float], quantity: str
) -> Any:
    """Fill the facets of the body that has yielded most on the side of the nearest patch."""
    facets, behind = skin(zone.body)
    vectors = area_vectors(zone.points, facets)
    normals = vectors / np.linalg.norm(vectors, axis=1)[:, None]
    middles = zone.points[facets].mean(axis=1)
    way = zone.touch - zone.worst  # out of the body; nowhere if nothing touches
    faces = normals @ way > FACES * float(np.linalg.norm(way))
    distance = np.linalg.norm(middles - zone.touch, axis=1)
    nearest = int(np.argmin(np.where(faces | ~faces.any(), distance, np.inf)))
    axis = int(np.argmax(np.abs(normals[nearest])))
    side = normals[:, axis] * np.sign(normals[nearest, axis])
    near = np.abs(middles[:, axis] - middles[nearest, axis]) < float(
        zone.upper[axis] - zone.lower[axis]
    )
    shown: Flags = (side > FACES) & near
    across = [k for k in range(3) if k != axis]
    corners = zone.points[facets[shown]][:, :, across] * MM
    return _fill(axes, zone, list(corners), values[behind[shown]], across, limits, quantity)


def skin(body: Body) -> tuple[Index, Index]:
    """Return the facets of a surface, shape ``(q, 4)``, and the cell behind each, ``(q,)``."""
    from meshes.hexmesh import FACES as SIDES

    quads = np.sort(body.cells[:, SIDES].reshape(-1, 4), axis=1)
    facets = boundary(body.cells)
    order = np.lexsort(quads.T[::-1])
    key = np.ascontiguousarray(quads[order]).view([("", quads.dtype)] * 4).ravel()
    wanted = np.ascontiguousarray(np.sort(facets, axis=1)).view(key.dtype).ravel()
    return facets, order[np.searchsorted(key, wanted)] // len(SIDES)


def _fill(
    axes: "Axes",
    zone: Zone,
    faces: list[Array],
    values: Array,
    across: list[int],
    limits: tuple[float, float],
    quantity: str,
) -> Any:
    """Fill polygons with values, over the window of the zone; return them, as coloured."""
    from matplotlib.collections import PolyCollection

    cells = PolyCollection(
        faces, array=values, cmap=style.COLOUR_MAP[quantity], edgecolor="#5a5a5a", lw=0.15
    )
    cells.set_clim(*limits)
    axes.add_collection(cells)
    first, second = across
    axes.set(
        xlabel=f"{'xyz'[first]} [mm]",
        ylabel=f"{'xyz'[second]} [mm]",
        xlim=(zone.lower[first] * MM, zone.upper[first] * MM),
        ylim=(zone.lower[second] * MM, zone.upper[second] * MM),
        aspect="equal",
    )
    axes.locator_params(nbins=4)
    axes.grid(False)
    return cells
