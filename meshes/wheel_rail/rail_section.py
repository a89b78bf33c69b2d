# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rail sections as quadrilaterals: any head on the web and foot of a standard rail."""

from dataclasses import dataclass

import numpy as np

from meshes.arrays import Array
from meshes.generate.section import Section, assembled, coons, divided, spaced, straight
from meshes.generate.stations import COARSEST, fine_railhead, stations
from meshes.profiles.profiles import MM, Profile, drawing
from meshes.profiles.profiles import RAILS as RAILS
from meshes.profiles.profiles import rail as drawn_rail

WEB_COLUMNS = 4
WEB_ROWS = 6
FOOT_ROWS = 2
WING_COLUMNS = 5
SHALLOW = 0.010  # first row of a head refined once: deeper columns grow thin under the corner
UPRIGHT = 6.0  # weight of columns at right angles to the running surface, if refined twice
THINNEST = 2.2  # of the rows below the first, the next may have this part of what is left
SHOULDER = 0.0115  # half the width of the core of the head
STEEP = np.radians(60.0)  # an end of a head steeper than this is carried on as it is
SIDE = np.arctan(20.0)  # slope of the sides that a head without sides gets
LEAST_SIDE = 0.003  # a head that ends so little above the lower corner is complete


@dataclass(frozen=True)
class Below:
    """Web and foot of a standard rail, right half, upright, rail top at height 0.

    Attributes:
        head: Lower end of the side of the head, shape ``(2,)`` [m].
        under: Underside of the head from there to the web, shape ``(n, 2)`` [m].
        fillet: Where the fillet to the web begins, as arc length of ``under`` [m].
        web: Nodes from head to the middle of the foot's fillet, shape ``(WEB_ROWS + 1, 2)`` [m].
        foot: Nodes from there to the toe, shape ``(WING_COLUMNS + 1, 2)`` [m].
        height: Height of the rail [m].
    """

    head: Array
    under: Array
    fillet: float
    web: Array
    foot: Array
    height: float


def below(design: str) -> Below:
    """Return web and foot of the standard rail ``design``; the toe keeps its area.

    Raises:
        ValueError: if there is no such rail.
    """
    outline = drawn_rail(design, "outline")
    segments = drawing(RAILS[design])["segments"]
    names = [segment["name"] for segment in segments]

    def start(name: str) -> int:
        return next(k for k, n in enumerate(names) if n.startswith(name))

    joints = outline.joints
    side, fillet = joints[start("lower head corner")], joints[start("head/web fillet")]
    web, low = joints[start("head/web fillet") + 1], start("web/foot fillet")
    middle = (joints[low] + joints[low + 1]) / 2
    bend, toe = (joints[low + 2] + joints[low + 3]) / 2, joints[start("toe upper corner") + 1]
    foot = outline.at(
        [middle, joints[low + 1], (joints[low + 1] + bend) / 2, bend, (bend + toe) / 2, toe]
    )
    height = segments[0]["start"][1] * MM
    foot[-1, 1] = _toe(outline, foot[-2], float(foot[-1, 0]), height)
    return Below(
        head=outline.at(side),
        under=outline.at(np.linspace(side, web, 400)),
        fillet=float(fillet - side),
        web=np.vstack([divided(outline, web, joints[low], WEB_ROWS - 1), outline.at(middle)]),
        foot=foot,
        height=height,
    )


def _toe(outline: Profile, before: Array, half: float, height: float) -> float:
    """Return the height of the toe's upper node that keeps the area outside of ``before``."""
    y, z = outline.points[outline.s < outline.length / 2].T
    beyond = slice(int(np.argmax((y >= before[0]) & (z <= before[1] + 1e-9))), len(y))
    y, z = np.append(before[0], y[beyond]), np.append(before[1], z[beyond]) + height
    base = int(np.argmax(z < 1e-9)) + 1
    area = float(np.sum(np.diff(y[:base]) * (z[1:base] + z[: base - 1]) / 2))
    return 2 * area / (half - float(before[0])) - (float(before[1]) + height) - height


def completed(head: Profile, design: str = "54E1") -> Profile:
    """Return a head whose ends lie at the height of the lower head corner of ``design``.

    What lies below is cut off. An end above is carried on along its tangent if that is steeper than
    60 degrees, else along a side of slope 20:1.

    Args:
        head: Running surface, upright, from gauge to field side; its highest point counts as top.
        design: Standard rail whose web and foot it shall get.

    Raises:
        ValueError: if the head cannot stand on the web.
    """
    lower = below(design)
    top = float(head.points[:, 1].max())
    end = top + float(lower.head[1])
    at = int(np.argmax(head.points[:, 1]))
    above = head.points[:, 1] >= end - 1e-9
    first = at - int(np.argmin(np.append(above[: at + 1][::-1], False))) + 1
    last = at + int(np.argmin(np.append(above[at:], False)))
    parts = [
        _side(head, first, end, -1),
        (head.points[first:last], head.angles[first:last], head.curvatures[first:last]),
        _side(head, last - 1, end, 1),
    ]
    points, angles, curvatures = (np.concatenate([part[k] for part in parts]) for k in range(3))
    step = np.hypot(*np.diff(points, axis=0).T)
    half_turn = np.diff(angles) / 2
    arc = np.where(np.abs(half_turn) < 0.1, step / np.sinc(half_turn / np.pi), step)
    s = np.concatenate([[0.0], np.cumsum(arc)])
    offset = s[len(parts[0][0])] - head.s[first]
    inside = (head.joints > head.s[first] + 1e-9) & (head.joints < head.s[last - 1] - 1e-9)
    corners = s[[0, len(parts[0][0]), len(parts[0][0]) + last - first - 1, -1]]
    joints = np.unique(np.concatenate([corners, head.joints[inside] + offset]))
    _check(points, top, lower)
    return Profile(s, points, angles, curvatures, joints)


def _side(head: Profile, at: int, end: float, way: int) -> tuple[Array, Array, Array]:
    """Return the straight side from a point of the head down to ``end``; empty if it is there."""
    y, z = head.points[at]
    empty = np.zeros((0, 2)), np.zeros(0), np.zeros(0)
    if z - end < LEAST_SIDE:
        return empty
    slope = -way * float(head.angles[at])
    slope = slope if slope > STEEP else SIDE
    t = np.linspace(0.0, 1.0, 200)[1:]
    points = np.column_stack([y + way * t * (z - end) / np.tan(slope), z + t * (end - z)])
    order = slice(None, None, way)
    return points[order], np.full(len(t), -way * slope), np.zeros(len(t))


def _check(points: Array, top: float, lower: Below) -> None:
    """Raise ``ValueError`` if a head is too narrow or too wide for its web."""
    ends = np.array([-points[0, 0], points[-1, 0]])
    least, most = float(lower.under[-1, 0]) + 0.005, 2 * float(lower.head[0])
    if (ends < least).any() or (ends > most).any():
        raise ValueError(
            f"rail profile: expected a head that reaches {least:.3f} to {most:.3f} m to either "
            f"side of the rail axis, lateral 0, got {ends[0]:.4f} and {ends[1]:.4f} m"
        )


def rail_section(
    size: float,
    levels: int,
    head: Profile | None = None,
    design: str = "54E1",
    touch: float | None = None,
) -> tuple[Section, int, int, float]:
    """Return the upright section, the columns that the zone refines, and the height of its base.

    Args:
        size: Length of edges after refinement [m].
        levels: Number of 3:1 refinements.
        head: A completed running surface; that of ``design`` by default.
        design: Standard rail whose web and foot are used.
        touch: Arc length of the first touch with the wheel [m]; the head is fine there too.
    """
    head = completed(drawn_rail(design)) if head is None else head
    lower = below(design)
    columns = stations(head, 0.0, head.length, fine_railhead(head, touch), size, levels, even=True)
    row, upright = ((SHALLOW, 1.0), (min(COARSEST, size * 3**levels), UPRIGHT))[levels > 1]
    top = float(head.points[:, 1].max())
    down = np.array([0.0, top])
    left, right = (_under(head.at(s), lower, top, row, k) for s, k in ((0.0, -1), (head.length, 1)))
    side = (len(columns.s) - 1 - WEB_COLUMNS) // 2
    shoulder = np.array([SHOULDER, top - min(1.8 * row, 0.030)])
    rises = [straight(left[-1], shoulder * [-1, 1], side), straight(right[-1], shoulder, side)]
    roof = straight(shoulder * [-1, 1], shoulder, WEB_COLUMNS)
    inner = np.vstack([rises[0], roof[1:-1], rises[1][::-1]])
    neck = straight(left[-1], right[-1], WEB_COLUMNS)
    blocks = [
        coons(inner, right[::-1], head.at(columns.s), left[::-1]),
        coons(neck, rises[1], roof, rises[0]),
        *_web_and_foot(neck, lower, down),
    ]
    section = assembled(blocks, head, columns.s, row, upright=upright)
    return section, columns.first, columns.last, top - lower.height


def _under(end: Array, lower: Below, top: float, row: float, way: int) -> Array:
    """Return the nodes under the head from its end to the web, the standard's scaled to fit."""
    under = lower.under + np.array([[0.0, top]])
    foot = under[-1]
    scale = (np.array([way * end[0], end[1]]) - foot) / (under[0] - foot)
    under = foot + (under - foot) * scale
    length = np.hypot(*np.diff(under, axis=0).T).sum()
    fillet = min(max(lower.fillet, 1.7 * row), row + (length - row) / THINNEST)
    depth = np.array([0.0, row, fillet, (fillet + length) / 2, length]) / length
    return spaced(under, depth) * [way, 1]


def _web_and_foot(neck: Array, lower: Below, down: Array) -> list[Array]:
    right, slope = lower.web[::-1] + down, lower.foot + down
    right[-1] = neck[-1]
    base = float(down[1]) - lower.height
    top = straight(right[0] * [-1, 1], right[0], WEB_COLUMNS)
    centre = np.array([0.016, base])
    inner = straight(centre, right[0], FOOT_ROWS)
    under = straight(centre * [-1, 1], centre, WEB_COLUMNS)
    corner = np.array([slope[-1, 0], base])
    toe = straight(corner, slope[-1], FOOT_ROWS)
    wing = coons(straight(centre, corner, WING_COLUMNS), toe, slope, inner)
    return [
        coons(top, right, neck, right * [-1, 1]),
        coons(under, inner, top, inner * [-1, 1]),
        wing,
        wing[:, ::-1] * [-1, 1],
    ]
