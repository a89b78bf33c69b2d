# SPDX-License-Identifier: LGPL-3.0-or-later
"""Tags and names of the regions (cells) and surfaces (facets) of meshes made here."""

from enum import IntEnum


class Tag(IntEnum):
    """Region and surface tags; regions are below 100, surfaces from 100 on."""

    # regions
    TYRE = 1
    WEB = 2
    HUB = 3
    AXLE = 4
    RAIL_HEAD = 5
    RAIL_WEB = 6
    RAIL_FOOT = 7
    SLEEPER = 8
    BAR = 20
    BLOCK = 21
    BASE = 22
    SPHERE = 23
    ROLLER = 24  # the upper of two curved bodies

    # surfaces
    TREAD = 101  # running surface of the wheel, tread and flange
    RAILHEAD = 102  # running surface of the rail, rail top and gauge corner to the lower corners
    FOOT_UNDERSIDE = 103
    RAIL_ENDS = 104
    AXLE_INNER = 105  # end of the half axle at the track centre
    AXLE_OUTER = 106
    JOURNAL = 107  # skin of the axle that carries the axle box
    WHEELSET_SKIN = 108  # the rest of its surface, free
    RAIL_SKIN = 109  # the rest of its surface, free
    WHEEL_BORE = 110  # seat of the axle in a wheel without one
    XMIN = 111
    XMAX = 112
    YMIN = 113
    YMAX = 114
    ZMIN = 115
    ZMAX = 116
    CAP = 117  # curved surface of a sphere or roller
    BLOCK_BOTTOM = 118
    BLOCK_TOP = 119
    BASE_BOTTOM = 120
    BASE_TOP = 121
    SLEEPER_TOP = 122
    SLEEPER_BOTTOM = 123
    SLEEPER_INNER = 124  # end of the half sleeper at the track centre
    SLEEPER_SKIN = 125  # the rest of its surface, free
    INSIDE = 126  # of a hollow sphere
    OUTSIDE = 127


def tag(name: str) -> Tag:
    """Return the tag called ``name`` (any case).

    Raises:
        ValueError: if no region or surface has that name.
    """
    try:
        return Tag[name.upper()]
    except KeyError:
        known = ", ".join(Tag.__members__)
        raise ValueError(f"unknown region or surface {name!r}; known: {known}") from None


NAMES = {t.name.lower(): int(t) for t in Tag}  # of the meshes that squealx makes
