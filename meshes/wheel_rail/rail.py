# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rails in the track as hexahedra, fine under the running surface of a zone."""

import numpy as np

from meshes.arrays import Array
from meshes.generate.section import Section
from meshes.generate.smooth import relaxed
from meshes.generate.sweep import (
    D,
    Strip,
    Swept,
    X,
    Z,
    Zone,
    extrude,
    levels_for,
    refine,
    refined_cells,
)
from meshes.hexmesh import HexMesh, boundary
from meshes.profiles.placement import GAUGE, GAUGE_DEPTH, INCLINATION, track_offset
from meshes.profiles.profiles import Profile, inclined
from meshes.profiles.profiles import rail as drawn_rail
from meshes.spacing import zoned
from meshes.tags import Tag
from meshes.wheel_rail.rail_section import completed, rail_section

GROWTH = 1.25  # of cells along the rail outside of the zone
REGIONS = (Tag.RAIL_HEAD, Tag.RAIL_HEAD, Tag.RAIL_WEB, Tag.RAIL_FOOT, Tag.RAIL_FOOT, Tag.RAIL_FOOT)


def rail(
    length: float = 10.0,
    x0: float = -5.0,
    *,
    size: float = 4e-3,
    zone: tuple[float, float] = (-0.1, 0.1),
    inclination: float = INCLINATION,
    gauge: float = GAUGE,
    gauge_depth: float = GAUGE_DEPTH,
    largest: float = 0.1,
    profile: Profile | None = None,
    design: str = "54E1",
    touch: float | None = None,
    strip: Strip | None = None,
) -> HexMesh:
    """Return a rail in the track.

    The rail is turned about its own axis by ``inclination`` towards the track centre; its highest
    point lies at z = 0 and its gauge face, ``gauge_depth`` below, at y = gauge / 2. Cells of about
    ``size`` lie in the zone from 10 mm on the field side of the rail centre to the foot of the
    gauge corner.

    Args:
        length: Length of the rail [m].
        x0: Start of the rail [m].
        size: Length of edges on the running surface of the zone [m].
        zone: Stretch along the rail that is fine [m].
        inclination: Slope of the rail towards the track centre.
        gauge: Distance of the gauge faces [m].
        gauge_depth: How far below the rail top it is measured [m].
        largest: Largest length of cells along the rail [m].
        profile: Its running surface, upright, completed by sides where it has none; that of
            ``design`` by default.
        design: Standard rail whose web and foot are used, 54E1 or 60E1.
        touch: Arc length of the first touch on the completed profile [m]; fine there too.
        strip: Part of the completed profile with narrower cells.

    Raises:
        ValueError: if the size, profile or strip is out of range or the zone, with its
            transitions, not on the rail.
    """
    head = completed(drawn_rail(design) if profile is None else profile, design)
    section, fine, base = _plan(size, zone, head, design, touch, strip)
    stations = _stations(length, x0, fine, largest)
    swept = refine(extrude(section, stations), fine, section.band, _space)
    tagged = _tagged(swept, (x0, x0 + length), base)
    return _in_track(tagged, head, inclination, gauge, gauge_depth)


def coarse_rail(
    length: float = 10.0,
    x0: float = -5.0,
    *,
    size: float = 24e-3,
    zone: tuple[float, float] = (-0.05, 0.05),
    inclination: float = INCLINATION,
    gauge: float = GAUGE,
    gauge_depth: float = GAUGE_DEPTH,
    largest: float = 0.1,
    design: str = "54E1",
) -> HexMesh:
    """Return a rail in the track as :func:`rail`, its section the same all along.

    Args:
        length: Length of the rail [m].
        x0: Start of the rail [m].
        size: Length of cells along the rail in the zone, and on its running surface there and
            elsewhere, 3 to 24 mm [m].
        zone: Stretch along the rail with short cells [m].
        inclination: Slope of the rail towards the track centre.
        gauge: Distance of the gauge faces [m].
        gauge_depth: How far below the rail top it is measured [m].
        largest: Largest length of cells along the rail [m].
        design: Standard rail, 54E1 or 60E1.

    Raises:
        ValueError: if the size is out of range or the zone not on the rail.
    """
    head = completed(drawn_rail(design), design)
    section, stations, base = _coarse(length, x0, size, zone, largest, design)
    tagged = _tagged(extrude(section, stations), (x0, x0 + length), base)
    return _in_track(tagged, head, inclination, gauge, gauge_depth)


def coarse_rail_extent(
    length: float, x0: float, *, size: float, zone: tuple[float, float], largest: float, design: str
) -> tuple[int, int]:
    """Return how many cells and nodes :func:`coarse_rail` makes; it raises as that."""
    section, stations, _ = _coarse(length, x0, size, zone, largest, design)
    return (len(stations) - 1) * len(section.quads), len(stations) * len(section.points)


def _coarse(
    length: float,
    x0: float,
    size: float,
    zone: tuple[float, float],
    largest: float,
    design: str,
) -> tuple[Section, Array, float]:
    """Return the section that a level of refinement begins with, stations, height of the base."""
    if not 3e-3 <= size <= 24e-3:
        raise ValueError(f"size: expected 3e-3 to 24e-3 m, got {size}")
    if not x0 < zone[0] < zone[1] < x0 + length:
        raise ValueError(
            f"zone: expected a stretch between the rail ends at {x0:.3f} and {x0 + length:.3f} m, "
            f"got {zone[0]:.3f} to {zone[1]:.3f} m"
        )
    head = completed(drawn_rail(design), design)
    section, _, _, base = rail_section(size / 3, 1, head, design)
    return section, zoned("x", (x0, x0 + length), zone, size, GROWTH, largest), base


def _in_track(
    upright: HexMesh, head: Profile, inclination: float, gauge: float, gauge_depth: float
) -> HexMesh:
    """Return an upright rail in its place, rail top at height 0."""
    turn = np.arctan(inclination)
    c, s = np.cos(turn), np.sin(turn)
    offset = track_offset(inclined(head, inclination), gauge, gauge_depth)
    x, y, z = upright.points.T
    return upright.moved(np.column_stack([x, c * y - s * z + offset[0], s * y + c * z + offset[1]]))


def rail_cells(
    length: float,
    x0: float,
    *,
    size: float,
    zone: tuple[float, float],
    profile: Profile,
    design: str = "54E1",
    largest: float = 0.1,
    touch: float | None = None,
    strip: Strip | None = None,
    **placed: float,
) -> int:
    """Return about how many cells :func:`rail` makes of a completed profile; it raises as that."""
    section, fine, _ = _plan(size, zone, profile, design, touch, strip)
    stations = _stations(length, x0, fine, largest)
    return (len(stations) - 1) * len(section.quads) + refined_cells(section, fine)


def _plan(
    size: float,
    zone: tuple[float, float],
    head: Profile,
    design: str,
    touch: float | None,
    strip: Strip | None,
) -> tuple[Section, Zone, float]:
    """Return the upright section, the zone that is refined, and the height of the rail's base."""
    levels = levels_for(size)
    section, first, last, base = rail_section(size, levels, head, design, touch)
    columns, spacing = section.band.stations, size * 3**levels
    return section, Zone(levels, columns, first, last, *zone, spacing, size, strip), base


def _stations(length: float, x0: float, fine: Zone, largest: float) -> Array:
    """Return the stations along the rail [m].

    Raises:
        ValueError: if the zone, with its transitions, is not on the rail.
    """
    even = fine.along(1, 3)
    if not x0 <= even[0] < even[1] <= x0 + length:
        raise ValueError(
            f"zone: expected a stretch that leaves {fine.start - even[0]:.3f} m to the rail ends "
            f"at {x0:.3f} and {x0 + length:.3f} m, got {fine.start:.3f} to {fine.end:.3f} m"
        )
    return zoned("x", (x0, x0 + length), even, fine.spacing, GROWTH, largest)


def _space(params: Array) -> Array:
    return params[:, [X, 0, Z]]


def _tagged(swept: Swept, ends: tuple[float, float], base: float) -> HexMesh:
    facets = boundary(swept.cells)
    at = swept.params[facets]
    along = at[:, :, X]
    surfaces = np.full(len(facets), Tag.RAIL_SKIN, dtype=np.int32)
    surfaces[(at[:, :, D] == 0).all(axis=1)] = Tag.RAILHEAD
    surfaces[(at[:, :, Z] < base + 1e-9).all(axis=1)] = Tag.FOOT_UNDERSIDE
    surfaces[(along == along[:, :1]).all(axis=1) & np.isin(along[:, 0], ends)] = Tag.RAIL_ENDS
    points = relaxed(_space(swept.params), swept.cells)
    regions = np.array(REGIONS, dtype=np.int32)[swept.blocks]
    return HexMesh(points, swept.cells, regions, facets, surfaces)
