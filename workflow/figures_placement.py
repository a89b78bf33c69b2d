# SPDX-License-Identifier: LGPL-3.0-or-later
"""Wheel on rail in the track position, as placed before any load: whole, at the tread, at the gap.

The wheel is drawn by the points of it that can touch the rail, seen along the rail: a yawed flange
comes ahead of the tread and reaches further than a section of it shows.
"""

from typing import TYPE_CHECKING, Any

import numpy as np

from workflow import theme
from workflow.recorded import Record
from workflow.theme import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MM = 1e3
SPACING = 5e-5  # of the points of the wheel's outline [m]
STEEPEST = 0.5  # cosine of the circumferential angle beyond which the outline is left out
WINDOWS = (0.060, 0.006, 0.003)  # half widths of the three panels [m]


def placement(record: Record) -> "Figure | None":
    """Outlines of wheel and rail in the track, with windows on tread contact and flange gap."""
    if not record.wheel_on_rail:
        return None
    from meshes.placement import rail_in_track
    from workflow.geometry import placement_of
    from workflow.scene import Scene

    scene = Scene.check(record.scene)
    at, mesh = placement_of(scene), record.scene["mesh"]
    rail = rail_in_track(inclination=mesh["inclination"], gauge=mesh["gauge"])
    wheel = trace(at, mesh["wheel_radius"])
    tread, flange = at.tread_point[1:], at.flange_point[1:]
    nearest = rail.at(at.flange_rail_s)
    fig = theme.figure(theme.PAGE, 2.95)
    panels = fig.subplots(1, 3)
    centres = (tread + np.array([0.010, 0.0]), tread, (flange + nearest) / 2)
    titles = ("in the track, no load", "tread contact", "flange gap")
    for axes, mark, title, centre, half in zip(
        panels, "abc", titles, centres, WINDOWS, strict=True
    ):
        outlines(axes, wheel, rail.points, centre, half)
        theme.letter(axes, mark, title)
    _window(panels[0], tread, "b", theme.PATCH[1], WINDOWS[1])
    _window(panels[0], centres[2], "c", theme.PATCH[2], WINDOWS[2])
    panels[0].set_ylabel("height z [mm]")
    panels[1].plot(*tread * MM, "o", color=theme.PATCH[1], ms=4)
    panels[2].plot(*np.array([flange, nearest]).T * MM, "o-", color=theme.PATCH[2], ms=3)
    said = (
        f"contact angle {np.degrees(at.tread_angle):.1f}°\nradius {at.rolling_radius * MM:.1f} mm"
    )
    _note(panels[1], said, theme.PATCH[1])
    said = f"gap {at.flange_gap * MM:.2f} mm\nangle {np.degrees(at.flange_angle):.1f}°"
    ahead = (at.flange_point[0] - at.tread_point[0]) * MM
    _note(panels[2], f"{said}\n{ahead:.1f} mm ahead of b", theme.PATCH[2])
    said = f"yaw {at.yaw * 1e3:.0f} mrad\nshift {at.shift * MM:.2f} mm"
    _note(panels[0], said, theme.INK)
    _legend(fig)
    return fig


def trace(at: Any, radius: float) -> Array:
    """Return the outline of the wheel seen along the rail, (y, z), shape ``(n, 2)`` [m]."""
    from meshes.placement import outline
    from meshes.profiles import s1002

    wheel = s1002()
    s = np.arange(0, wheel.length, SPACING)
    points = outline(wheel, s, radius, at.yaw)
    with np.errstate(invalid="ignore"):
        kept = -points[:, 2] > STEEPEST * (radius + wheel.at(s)[:, 1])
    return np.asarray((points[kept] + at.centre)[:, 1:])


def outlines(axes: "Axes", wheel: Array, rail: Array, centre: Array, half: float) -> None:
    """Fill wheel and rail in a window of half width ``half`` about ``centre`` [m]."""
    for points, colour, above in ((wheel, theme.WHEEL, True), (rail, theme.RAIL, False)):
        closed = np.vstack([points, points[[-1, 0]]])
        if above:
            closed[-2:, 1] = centre[1] + 3 * half
        axes.fill(*closed.T * MM, color=colour, lw=0)
        axes.plot(*points.T * MM, color=theme.INK, lw=0.8)
    (y, z), reach = centre * MM, half * MM
    axes.set(xlim=(y - reach, y + reach), ylim=(z - reach, z + reach))
    axes.set(xlabel="lateral y [mm]", aspect="equal")
    axes.grid(False)


def _window(axes: "Axes", centre: Array, mark: str, colour: str, half: float) -> None:
    from matplotlib.patches import Rectangle

    corner = (centre - half) * MM
    size = 2 * half * MM
    axes.add_patch(Rectangle(tuple(corner), size, size, fill=False, ec=colour, lw=1))
    way = 1 if mark == "b" else -1
    axes.annotate(
        mark, tuple((centre + way * half) * MM), xytext=(6 * way, 6 * way),
        textcoords="offset points", color=colour, weight="bold", ha="center", va="center",
    )  # fmt: skip


def _note(axes: "Axes", text: str, colour: str) -> None:
    box = {"boxstyle": "square", "fc": "white", "ec": colour, "lw": 0.7, "alpha": 0.9}
    axes.text(
        0.97, 0.04, text, transform=axes.transAxes, ha="right", va="bottom", fontsize=6.5, bbox=box
    )


def _legend(fig: "Figure") -> None:
    from matplotlib.patches import Patch

    keys = [
        Patch(fc=colour, ec=theme.INK, lw=0.6, label=label)
        for colour, label in (
            (theme.WHEEL, "wheel: what can touch, seen along the rail"),
            (theme.RAIL, "rail"),
        )
    ]
    fig.legend(handles=keys, loc="outside lower center", ncols=2)
