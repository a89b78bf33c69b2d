# SPDX-License-Identifier: LGPL-3.0-or-later
"""A wheel without its axle as a body of revolution with even cells, the same in every sector.

For natural frequencies: no zone of the tread is finer than the rest, so the two modes of a pair
come out alike. The drawing is that of :mod:`meshes.wheel_rail.wheelset`, and so are the axes: y
along the axle from the tape circle, which is centred at the origin.
"""

from typing import Any

import numpy as np

from meshes.arrays import Array
from meshes.generate.section import Section, assembled, coons, spaced
from meshes.generate.sweep import D, X, Y, Z, revolve
from meshes.hexmesh import HexMesh, boundary
from meshes.profiles.features import flange_of
from meshes.profiles.placement import RADIUS
from meshes.profiles.profiles import Profile, s1002, shifted
from meshes.tags import Tag
from meshes.wheel_rail.web import filleted, hub_blocks, web_block, web_ends, wheel_design

ARC = 1.6  # cells at the rim are so many times longer than in the section
REGIONS = (Tag.TYRE, Tag.WEB, Tag.HUB, Tag.HUB, Tag.HUB)


def turned_wheel(
    *,
    size: float = 8e-3,
    design: str = "D_curved_web",
    radius: float = RADIUS,
    profile: Profile | None = None,
) -> HexMesh:
    """Return a wheel of revolution; its bore carries the tag ``WHEEL_BORE``.

    Args:
        size: Length of edges in the section [m].
        design: Wheel of ``wheel_ns_intercity.json``.
        radius: Radius of the tape circle [m].
        profile: Profile of the wheel, from back to field side; S1002 by default.

    Raises:
        ValueError: if the size, radius or design is out of range.
    """
    if not 2e-3 <= size <= 20e-3:
        raise ValueError(f"size: expected 2e-3 to 20e-3 m, got {size}")
    wheel = wheel_design(design, radius)
    bore = float(wheel["bore"])
    running = shifted(s1002() if profile is None else profile, [0.0, radius])
    section = turned_section(wheel, running, size)
    sectors = 4 * round(2 * np.pi * radius / (ARC * size) / 4)
    swept = revolve(section, sectors)
    facets = boundary(swept.cells)
    at = swept.params[facets]
    surfaces = np.full(len(facets), Tag.WHEELSET_SKIN, dtype=np.int32)
    surfaces[(at[:, :, D] == 0).all(axis=1)] = Tag.TREAD
    surfaces[(at[:, :, Z] < bore + 1e-9).all(axis=1)] = Tag.WHEEL_BORE
    y, r, angle = swept.params[:, Y], swept.params[:, Z], swept.params[:, X]
    points = np.column_stack([r * np.sin(angle), y, -r * np.cos(angle)])
    regions = np.array(REGIONS, dtype=np.int32)[swept.blocks]
    return HexMesh(points, swept.cells, regions, facets, surfaces)


def turned_section(wheel: dict[str, Array], profile: Profile, size: float) -> Section:
    """Return the section of rim, web and hub in cells of one size.

    Args:
        wheel: Measures of the design [m].
        profile: Running surface, its second coordinate the radius.
        size: Length of edges [m].
    """
    web = web_block(wheel, *web_cells(wheel, size))
    hub = hub_blocks(wheel, web, _count(wheel["hub_or"] - wheel["bore"], size), size)
    rim, stations = _rim(profile, web, float(wheel["rim_ir"]), size)
    row = float(np.linalg.norm(rim[-1] - rim[-2], axis=1).mean())
    return assembled([rim, web, *hub], profile, stations, row)


def web_cells(wheel: dict[str, Array], size: float) -> tuple[int, int]:
    """Return the cells of the web along the radius and across.

    Args:
        wheel: Measures of the design [m].
        size: Length of edges [m].
    """
    low, high = web_ends(wheel)
    thick = float(wheel["t_hub"] + wheel["t_rim"]) / 2
    return _count(high - low, size), max(2, round(thick / size))


def _rim(profile: Profile, web: Array, inside: float, size: float) -> tuple[Array, Array]:
    """Return the block between running surface and web, and its columns on the surface [m]."""
    flange = flange_of(profile)
    tip = 0.0 if flange is None else flange[0]
    back, end = profile.at(np.linspace(0.0, tip, 60 if tip else 1)), profile.at(profile.length)
    left = np.vstack([[back[0, 0], inside], back])
    right = np.array([[end[0], inside], end])
    ends, across = (web[-1, 0], web[-1, -1]), web.shape[1] - 1
    sides = [_count(abs(c[0] - e[0]), size) for c, e in zip((left[0], right[0]), ends, strict=True)]
    under = [filleted(c, e, n) for c, e, n in zip((left[0], right[0]), ends, sides, strict=True)]
    bottom = np.vstack([under[0], web[-1, 1:-1], under[1][::-1]])
    stations = np.linspace(tip, profile.length, across + sum(sides) + 1)
    rows = _count(0.5 * (_length(left) + _length(right)), size)
    edges = [spaced(side, np.linspace(0, 1, rows + 1)) for side in (left, right)]
    return coons(bottom, edges[1], profile.at(stations), edges[0]), stations


def _count(length: Any, size: float) -> int:
    return max(2, round(float(length) / size))


def _length(line: Array) -> float:
    return float(np.hypot(*np.diff(line, axis=0).T).sum())
