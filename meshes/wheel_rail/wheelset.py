# SPDX-License-Identifier: LGPL-3.0-or-later
"""Half a wheelset as hexahedra: rim under any profile, web, hub and a solid half axle.

The section is drawn with y along the axle from the tape circle and the radius r outward (in the
place of z); the sweep coordinate is the angle from the bottom. Hub and axle share their nodes.
"""

import numpy as np

from meshes.arrays import Array
from meshes.generate.section import Section, assembled, coons, spaced
from meshes.generate.smooth import relaxed
from meshes.generate.stations import fine_tread, stations
from meshes.generate.sweep import (
    D,
    Strip,
    Swept,
    X,
    Y,
    Z,
    Zone,
    cut,
    levels_for,
    refine,
    refined_cells,
    revolve,
)
from meshes.hexmesh import HexMesh, boundary
from meshes.profiles.features import flange_of
from meshes.profiles.placement import RADIUS, TAPE
from meshes.profiles.profiles import Profile, s1002, shifted
from meshes.tags import Tag
from meshes.wheel_rail.axle import Axle, with_axle
from meshes.wheel_rail.web import filleted, hub_blocks, web_block, wheel_design

UPRIGHT = 10.0  # weight of columns at right angles to the running surface
WEB_COLUMNS = 4
WEB_ROWS = 8
HUB_ROWS = 3
HUB_COLUMN = 0.020  # length of cells along the axle
RIM_ROWS = 5
WEB_SPLIT = 0.160  # radius outside of which there are three times as many sectors
COARSEST = 0.014  # of columns and rows in the unrefined rim
REGIONS = (Tag.TYRE, Tag.WEB, Tag.HUB, Tag.HUB, Tag.HUB, Tag.AXLE)


def wheelset(
    *,
    size: float = 4e-3,
    zone: tuple[float, float] = (-0.1, 0.1),
    design: str = "D_curved_web",
    radius: float = RADIUS,
    tape: float = TAPE,
    axle: Axle | None = None,
    profile: Profile | None = None,
    touch: float | None = None,
    strip: Strip | None = None,
) -> HexMesh:
    """Return half a wheelset in wheel axes, its tape circle centred at (0, tape, 0).

    The axle lies along y; the wheel is fine round its bottom, at z = -radius. The tread tag covers
    the profile from the flange tip, or from its start, to its end.

    Args:
        size: Length of edges on the running surface of the zone [m].
        zone: Arc about the bottom that is fine, positive towards +x [m].
        design: Wheel of ``wheel_ns_intercity.json``.
        radius: Radius of the tape circle [m].
        tape: Lateral position of the tape circle [m].
        axle: Measures of the axle.
        profile: Profile of the wheel, from back to field side; S1002 by default.
        touch: Arc length of its first touch with the rail [m]; the tread is fine there too.
        strip: Part of the profile with narrower cells.

    Raises:
        ValueError: if the size, zone, design, profile or strip is out of range.
    """
    axle = Axle() if axle is None else axle
    section, swept, fine, extra = _coarse(
        size, zone, design, radius, tape, axle, profile, touch, strip
    )
    if extra:
        swept = cut(swept, X, _rim_box(fine), section.band, _space)
    swept = refine(swept, fine, section.band, _space)
    return _tagged(swept, axle, tape)


def wheelset_cells(
    *,
    size: float,
    zone: tuple[float, float],
    design: str,
    radius: float,
    profile: Profile,
    touch: float | None = None,
    strip: Strip | None = None,
) -> int:
    """Return about how many cells :func:`wheelset` makes; it raises as that."""
    section, swept, fine, extra = _coarse(
        size, zone, design, radius, TAPE, Axle(), profile, touch, strip
    )
    if extra:
        swept = cut(swept, X, _rim_box(fine), section.band, _space)
    return len(swept.cells) + refined_cells(section, fine)


def _coarse(
    size: float,
    zone: tuple[float, float],
    design: str,
    radius: float,
    tape: float,
    axle: Axle,
    profile: Profile | None,
    touch: float | None,
    strip: Strip | None,
) -> tuple[Section, Swept, Zone, int]:
    """Return section and unrefined wheelset, the zone, and how often its rim is cut before."""
    levels = levels_for(size)
    sectors, extra = sectors_for(size, radius, levels)
    section, first, last = wheel_section(size, levels, design, radius, profile, touch)
    bore = float(section.points[:, 1].min())
    swept = with_axle(revolve(section, sectors), axle, bore, tape)
    swept = cut(swept, X, {"z": (WEB_SPLIT, np.inf)}, section.band, _space)
    angle = 2 * np.pi / sectors / 3 ** (1 + extra)
    bottom = (zone[0] / radius, zone[1] / radius)
    fine = Zone(levels, section.band.stations, first, last, *bottom, angle, size, strip)
    if fine.along(1, 6)[1] - fine.along(1, 6)[0] > 2 * np.pi:
        raise ValueError(
            f"zone: expected less than the circumference, got {zone[0]:.3f} to {zone[1]:.3f} m"
        )
    return section, swept, fine, extra


def _rim_box(fine: Zone) -> dict[str, tuple[float, float]]:
    """Return where the rim of a large wheel is cut once more."""
    return {"d": (0.0, 3.0), "x": fine.along(1, 6)}


def sectors_for(size: float, radius: float, levels: int) -> tuple[int, int]:
    """Return the sectors of the hub and how often the rim is cut before the zone's refinements.

    The sectors, a multiple of four, are cut in three in the web, again at the rim if need be, and
    at each level of the zone; the arcs at the rim are then near ``size``.
    """
    around = 2 * np.pi * radius / size / 3 ** (levels + 1)
    extra = 1 if around > 48 else 0
    return int(np.clip(4 * round(around / 3**extra / 4), 20, 48)), extra


def wheel_section(
    size: float,
    levels: int,
    design: str,
    radius: float,
    profile: Profile | None = None,
    touch: float | None = None,
) -> tuple[Section, int, int]:
    """Return the section of rim, web and hub, and the columns that the zone refines.

    Args:
        size: Length of edges after refinement [m].
        levels: Number of 3:1 refinements.
        design: Name of the wheel.
        radius: Radius of the tape circle [m].
        profile: Profile of the wheel; S1002 by default.
        touch: Arc length of its first touch with the rail [m].
    """
    wheel = wheel_design(design, radius)
    profile = shifted(s1002() if profile is None else profile, [0.0, radius])
    flange = flange_of(profile)
    start = 0.0 if flange is None else flange[0]
    fine = fine_tread(profile, touch)
    columns = stations(profile, start, profile.length, fine, size, levels)
    web = web_block(wheel, WEB_ROWS, WEB_COLUMNS)
    _check_rim(profile, web, float(wheel["rim_ir"]))
    row = min(COARSEST, size * 3**levels)
    rim = _rim(profile, columns.s, web, float(wheel["rim_ir"]), row)
    blocks = [rim, web, *hub_blocks(wheel, web, HUB_ROWS, HUB_COLUMN)]
    section = assembled(blocks, profile, columns.s, row, upright=UPRIGHT)
    return section, columns.first, columns.last


def _check_rim(profile: Profile, web: Array, inside: float) -> None:
    """Raise ``ValueError`` where a profile cannot be the outside of the rim."""
    y, r = profile.points.T
    low, high = float(web[-1, 0, 0]), float(web[-1, -1, 0])
    if y[0] > low - 0.01 or y[-1] < high + 0.01:
        raise ValueError(
            f"wheel profile: expected a rim from {low - 0.01:.3f} m or less to {high + 0.01:.3f} m "
            f"or more, 10 mm beyond the web, got {y[0]:.3f} to {y[-1]:.3f} m; lateral 0 is the "
            "tape circle"
        )
    if r.min() < inside + 0.02:
        raise ValueError(
            f"wheel profile: expected 20 mm of rim outside {inside:.3f} m, got {r.min():.3f} m"
        )


def _rim(profile: Profile, columns: Array, web: Array, inside: float, row: float) -> Array:
    """Return the block between running surface, rim faces, rim underside and web."""
    under_rim = len(columns) - 1 - WEB_COLUMNS
    back = profile.at(np.linspace(0.0, columns[0], 60 if columns[0] > 0 else 1))
    end = profile.at(columns[-1])
    left = np.vstack([[back[0, 0], inside], back])
    right = np.array([[end[0], inside], end])
    under = [web[-1, 0], web[-1, -1]]
    left_under = filleted(left[0], under[0], under_rim // 2)
    right_under = filleted(right[0], under[1], under_rim - under_rim // 2)[::-1]
    bottom = np.vstack([left_under, web[-1, 1:-1], right_under])
    sides = [spaced(edge, 1 - _rows(edge, k * row)) for edge, k in ((left, 1.5), (right, 1.0))]
    return coons(bottom, sides[1], profile.at(columns), sides[0])


def _rows(edge: Array, first: float) -> Array:
    """Return the depths of the rim's rows on a side face as shares of its length, descending."""
    length = np.hypot(*np.diff(edge, axis=0).T).sum()
    depth = np.concatenate([[0.0], np.linspace(first, length, RIM_ROWS)])
    return np.asarray(depth[::-1] / length)


def _space(params: Array) -> Array:
    y, r, angle = params[:, Y], params[:, Z], params[:, X]
    return np.column_stack([r * np.sin(angle), y, -r * np.cos(angle)])


def _tagged(swept: Swept, axle: Axle, tape: float) -> HexMesh:
    facets = boundary(swept.cells)
    at = swept.params[facets]
    y, r = at[:, :, Y], at[:, :, Z]
    surfaces = np.full(len(facets), Tag.WHEELSET_SKIN, dtype=np.int32)
    surfaces[(at[:, :, D] == 0).all(axis=1)] = Tag.TREAD
    journal = (np.abs(r - axle.journal) < 1e-9) & (y > 0)
    surfaces[journal.all(axis=1)] = Tag.JOURNAL
    surfaces[(np.abs(y - axle.inner + tape) < 1e-9).all(axis=1)] = Tag.AXLE_INNER
    surfaces[(np.abs(y - axle.outer + tape) < 1e-9).all(axis=1)] = Tag.AXLE_OUTER
    points = relaxed(_space(swept.params), swept.cells) + np.array([0.0, tape, 0.0])
    regions = np.array(REGIONS, dtype=np.int32)[swept.blocks]
    return HexMesh(points, swept.cells, regions, facets, surfaces)
