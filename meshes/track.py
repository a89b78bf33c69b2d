# SPDX-License-Identifier: LGPL-3.0-or-later
"""The rail as hexahedra, in the track and fine under the running surface of a zone."""

import numpy as np
import numpy.typing as npt

from meshes.hexmesh import HexMesh, boundary
from meshes.placement import GAUGE, INCLINATION, track_offset
from meshes.profiles import inclined, rail_54e1
from meshes.relax import relaxed
from meshes.section import Section, assembled, coons, divided, spaced, straight
from meshes.sweep import (
    D,
    Swept,
    X,
    Z,
    Zone,
    columns_for,
    extrude,
    levels_for,
    refine,
    stretched,
)
from meshes.tags import Tag

Array = npt.NDArray[np.float64]

HEIGHT = 0.159
SHALLOW = 0.009  # first row of a head refined once: deeper columns grow thin under the corner
UPRIGHT = 5.0  # weight of columns at right angles to the running surface, if refined twice
WEB_COLUMNS = 4
WEB_ROWS = 5
FOOT_ROWS = 2
WING_COLUMNS = 4
FIELD = 0.010  # the fine part of the rail top ends this far on the field side of the rail centre
COARSEST = 0.014  # of columns and rows in the unrefined head
REGIONS = (Tag.RAIL_HEAD, Tag.RAIL_HEAD, Tag.RAIL_WEB, Tag.RAIL_FOOT, Tag.RAIL_FOOT, Tag.RAIL_FOOT)


def rail(
    length: float = 10.0,
    x0: float = -5.0,
    *,
    size: float = 4e-3,
    zone: tuple[float, float] = (-0.1, 0.1),
    inclination: float = INCLINATION,
    gauge: float = GAUGE,
    largest: float = 0.1,
) -> HexMesh:
    """Return a 54E1 rail in the track.

    The rail is turned about its own axis by ``inclination`` towards the track centre; its highest
    point lies at z = 0 and its gauge face, 14 mm below, at y = gauge / 2. Cells of about ``size``
    lie in the zone from 10 mm on the field side of the rail centre to the foot of the gauge corner.

    Args:
        length: Length of the rail [m].
        x0: Start of the rail [m].
        size: Length of edges on the running surface of the zone [m].
        zone: Stretch along the rail that is fine [m].
        inclination: Slope of the rail towards the track centre.
        gauge: Distance of the gauge faces [m].
        largest: Largest length of cells along the rail [m].

    Raises:
        ValueError: if the size is out of range or the zone, with its transitions, not on the rail.
    """
    levels = levels_for(size)
    section, first, last = rail_section(size, levels)
    spacing = size * 3**levels
    fine = Zone(levels, section.band.stations, first, last, *zone, spacing, size)
    even = fine.along(1, 3)
    if not x0 <= even[0] < even[1] <= x0 + length:
        raise ValueError(
            f"zone: expected a stretch that leaves {zone[0] - even[0]:.3f} m to the rail ends at "
            f"{x0} and {x0 + length} m, got {zone}"
        )
    stations = stretched(x0, x0 + length, even, spacing, largest=largest)
    swept = refine(extrude(section, stations), fine, section.band, _space)
    return _in_track(swept, x0, x0 + length, inclination, gauge)


def rail_section(size: float, levels: int) -> tuple[Section, int, int]:
    """Return the upright section, rail top at (0, 0), and the columns that the zone refines.

    Args:
        size: Length of edges after refinement [m].
        levels: Number of 3:1 refinements.
    """
    head, outline = rail_54e1(), rail_54e1("outline")
    stations, first, last = _stations(head.joints, size, levels)
    joints = outline.joints
    row, upright = ((SHALLOW, 1.0), (min(COARSEST, size * 3**levels), UPRIGHT))[levels > 1]
    flank = outline.at(np.linspace(joints[4], joints[7], 400))
    length = np.hypot(*np.diff(flank, axis=0).T).sum()
    depth = np.array([0.0, row, (row + length) / 2, length]) / length
    right = spaced(flank, depth)
    left = right * [-1, 1]
    side = (len(stations) - 1 - WEB_COLUMNS) // 2
    shoulder = [0.0115, -min(1.8 * row, 0.030)]
    rise = straight(right[-1], shoulder, side)
    roof = straight(shoulder * np.array([-1, 1]), shoulder, WEB_COLUMNS)
    inner = np.vstack([rise * [-1, 1], roof[1:-1], rise[::-1]])
    neck = straight(left[-1], right[-1], WEB_COLUMNS)
    blocks = [
        coons(inner, right[::-1], head.at(stations), left[::-1]),
        coons(neck, rise, roof, rise * [-1, 1]),
        *_web_and_foot(neck),
    ]
    return assembled(blocks, head, stations, row, upright=upright), first, last


def _stations(joints: Array, size: float, levels: int) -> tuple[Array, int, int]:
    """Return the columns of the running surface and between which of them the zone is fine."""
    centre = joints[-1] / 2
    corner = columns_for(joints[2] - joints[1], size, levels, curved=True)
    crown = round((centre + FIELD - joints[2]) / min(COARSEST, size * 3**levels))
    field = 2 + (corner + crown) % 2  # the core below needs an even number of columns
    pieces = [
        (joints[0], joints[1], 2),
        (joints[1], joints[2], corner),
        (joints[2], centre + FIELD, crown),
        (centre + FIELD, joints[-3], field),
        (joints[-3], joints[-2], 2),
        (joints[-2], joints[-1], 2),
    ]
    stations = np.concatenate([np.linspace(a, b, n + 1)[:-1] for a, b, n in pieces])
    return np.append(stations, joints[-1]), 2, 2 + corner + crown


def _web_and_foot(neck: Array) -> list[Array]:
    outline = rail_54e1("outline")
    joints = outline.joints
    fillet = (joints[8] + joints[9]) / 2
    right = divided(outline, joints[7], fillet, WEB_ROWS)[::-1]
    top = straight(right[0] * [-1, 1], right[0], WEB_COLUMNS)
    centre = [0.016, -HEIGHT]
    inner = straight(centre, right[0], FOOT_ROWS)
    under = straight([-centre[0], -HEIGHT], centre, WEB_COLUMNS)
    toe = straight(outline.at(joints[14]), outline.at(joints[13]), FOOT_ROWS)
    toe[0] = [0.070, -HEIGHT]
    slope = divided(outline, fillet, joints[13], WING_COLUMNS)
    wing = coons(straight(centre, toe[0], WING_COLUMNS), toe, slope, inner)
    return [
        coons(top, right, neck, right * [-1, 1]),
        coons(under, inner, top, inner * [-1, 1]),
        wing,
        wing[:, ::-1] * [-1, 1],
    ]


def _space(params: Array) -> Array:
    return params[:, [X, 0, Z]]


def _in_track(swept: Swept, start: float, end: float, inclination: float, gauge: float) -> HexMesh:
    facets = boundary(swept.cells)
    at = swept.params[facets]
    along = at[:, :, X]
    surfaces = np.full(len(facets), Tag.RAIL_SKIN, dtype=np.int32)
    surfaces[(at[:, :, D] == 0).all(axis=1)] = Tag.RAILHEAD
    surfaces[(at[:, :, Z] < -HEIGHT + 1e-9).all(axis=1)] = Tag.FOOT_UNDERSIDE
    surfaces[(along == along[:, :1]).all(axis=1) & np.isin(along[:, 0], (start, end))] = (
        Tag.RAIL_ENDS
    )
    turn = np.arctan(inclination)
    c, s = np.cos(turn), np.sin(turn)
    offset = track_offset(inclined(rail_54e1(), inclination), gauge)
    x, y, z = relaxed(_space(swept.params), swept.cells).T
    points = np.column_stack([x, c * y - s * z + offset[0], s * y + c * z + offset[1]])
    regions = np.array(REGIONS, dtype=np.int32)[swept.blocks]
    return HexMesh(points, swept.cells, regions, facets, surfaces)
