# SPDX-License-Identifier: LGPL-3.0-or-later
"""Half sleepers under a rail, a few hexahedra each, the rail seat parallel to the rail's foot.

A sleeper is a box from the track centre outwards. Its upper nodes beside the rail are moved so that
the facets under the foot lie at the thickness of the pad below it, inclined as the rail is.
"""

import numpy as np

from meshes.arrays import Array
from meshes.hexmesh import HexMesh, join
from meshes.shapes.blocks import grid
from meshes.tags import Tag

SURFACES = {
    Tag.ZMAX: Tag.SLEEPER_TOP,
    Tag.ZMIN: Tag.SLEEPER_BOTTOM,
    Tag.YMIN: Tag.SLEEPER_INNER,
    Tag.YMAX: Tag.SLEEPER_SKIN,
    Tag.XMIN: Tag.SLEEPER_SKIN,
    Tag.XMAX: Tag.SLEEPER_SKIN,
}


def sleepers(
    foot: Array,
    *,
    spacing: float,
    length: float,
    width: float,
    height: float,
    pad: float,
    cells: tuple[int, int, int] = (2, 6, 1),
) -> HexMesh:
    """Return half sleepers under a rail, counted from its middle.

    Args:
        foot: Points of the underside of the rail's foot, a plane along x, shape ``(n, 3)`` [m].
        spacing: Distance of the sleepers [m].
        length: Length of the half sleeper, from y = 0 outwards [m].
        width: Width, along the rail [m].
        height: Height at the middle of the rail seat and beside it [m].
        pad: Thickness of the pad between foot and seat [m].
        cells: Cells along x, y and z.

    Raises:
        ValueError: if the foot does not lie over the sleeper or there are too few cells.
    """
    start, end = foot[:, 0].min(), foot[:, 0].max()
    y, z, slope = _foot(foot)
    stations, seat = _stations((y[0], y[1]), length, cells[1])
    if width >= spacing:
        raise ValueError(f"width: expected less than the spacing of {spacing} m, got {width} m")
    x = np.linspace(-width / 2, width / 2, cells[0] + 1)
    middle = z.mean() - pad * np.hypot(1, slope)  # the pad is measured square to the foot
    box = grid(
        x,
        stations,
        np.linspace(middle - height, middle, cells[2] + 1),
        region=Tag.SLEEPER,
        surfaces=SURFACES,
    )
    rise = np.zeros(len(stations))
    rise[seat : seat + 2] = slope * (stations[seat : seat + 2] - y.mean())
    points = box.points.copy()
    up = (points[:, 2] - middle + height) / height
    points[:, 2] += up * np.interp(points[:, 1], stations, rise)
    along = np.array([1.0, 0.0, 0.0])
    return join(*(box.moved(points + at * along) for at in places(start, end, spacing)))


def places(start: float, end: float, spacing: float) -> Array:
    """Return where sleepers lie under a rail from ``start`` to ``end``, from its middle [m]."""
    count = int(((end - start) / 2 - 1e-9) / spacing)
    return np.asarray((start + end) / 2 + np.arange(-count, count + 1) * spacing)


def _foot(foot: Array) -> tuple[Array, Array, float]:
    """Return y and z of the two edges of the underside, inner one first, and its slope."""
    edges = foot[[np.argmin(foot[:, 1]), np.argmax(foot[:, 1])]]
    y, z = edges[:, 1], edges[:, 2]
    slope = float((z[1] - z[0]) / (y[1] - y[0]))
    off = np.abs(foot[:, 2] - z[0] - slope * (foot[:, 1] - y[0])).max()
    if off > 1e-6:
        raise ValueError(f"foot: expected a plane along x, got points {off:.1e} m off")
    return y, z, slope


def _stations(foot: tuple[float, float], length: float, count: int) -> tuple[Array, int]:
    """Return lateral stations and the first of the cell under the foot, in whose middle it lies."""
    middle, breadth = (foot[0] + foot[1]) / 2, foot[1] - foot[0]
    cell = max(length / count, 1.2 * breadth)
    low, high = middle - cell / 2, middle + cell / 2
    inside = round((count - 1) * low / (length - cell))
    outside = count - 1 - inside
    if not (0 < low and high < length and inside > 0 and outside > 0):
        raise ValueError(
            f"length: expected a half sleeper of 3 or more cells that ends beyond {high:.3f} m, "
            f"got {length} m with {count} cells"
        )
    stations = [np.linspace(0, low, inside + 1), np.linspace(high, length, outside + 1)]
    return np.concatenate(stations), inside
