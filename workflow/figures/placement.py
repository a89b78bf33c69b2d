# SPDX-License-Identifier: LGPL-3.0-or-later
"""Wheel on rail as placed before any load: whole, at the tread, at the flange, and their gap.

The wheel is drawn by the points of it that can touch the rail, seen along the rail: a yawed flange
comes ahead of the tread and reaches further than a section of it shows.
"""

from typing import TYPE_CHECKING, Any

import numpy as np

from meshes.arrays import Array
from workflow.figures import style
from workflow.results.record import Record

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from meshes.profiles.outline import Gap
    from meshes.profiles.placement import Placement
    from meshes.profiles.profiles import Profile

MM = 1e3
SPACING = 5e-5  # of the points of the wheel's outline [m]
STEEPEST = 0.5  # cosine of the circumferential angle beyond which the outline is left out
TALLEST = 3.0  # of the gap that is drawn [mm]
WINDOWS = (0.060, 0.006, 0.003)  # half widths of the three panels [m]


def placement(record: Record) -> "Figure | None":
    """Wheel and rail as placed in the track before any load.

    The wheel is drawn by the points of it that can touch the rail, seen along the rail: with an
    angle of attack the flange comes ahead of the tread. (d) is the distance between the two,
    vertical and along the normal of the wheel, from the exact profiles.
    """
    if not record.wheel_on_rail:
        return None
    from meshes.profiles.outline import gap_function
    from workflow.model.geometry import in_track, placement_of, profiles_of
    from workflow.scene.mesh import WheelRailMesh
    from workflow.scene.scene import Scene

    scene = Scene.check(record.scene)
    at, mesh = placement_of(scene), scene.mesh
    assert isinstance(mesh, WheelRailMesh)
    wheel, head, _ = profiles_of(mesh)
    rail = in_track(mesh, head)
    gap = gap_function(
        wheel, rail, at.centre, radius=mesh.wheel_radius, yaw=at.yaw, roll=at.roll, spacing=SPACING
    )
    fig = style.figure(style.PAGE, 4.9)
    parts: Any = fig.subfigures(2, 1, height_ratios=(1.25, 1.0))
    kept = gap.points[:, 2] < at.centre[2] - STEEPEST * (mesh.wheel_radius + wheel.at(gap.s)[:, 1])
    _windows(parts[0], at, gap.points[kept, 1:], rail)
    _gap(parts[1].subplots(), at, gap)
    _legend(fig)
    return fig


def _windows(part: Any, at: "Placement", wheel: Array, rail: "Profile") -> None:
    tread = at.tread_point[1:]
    panels = part.subplots(1, 2 if at.flange_point is None else 3)
    views = [(tread + np.array([0.010, 0.0]), "in the track, no load")]
    views.append((tread, "tread contact"))
    if at.flange_point is not None:
        nearest = rail.at(at.flange_rail_s or 0.0)
        views.append(((at.flange_point[1:] + nearest) / 2, "flange gap"))
    for axes, mark, (centre, title), half in zip(panels, "abc", views, WINDOWS, strict=False):
        outlines(axes, wheel, rail.points, centre, half)
        style.letter(axes, mark, title)
    panels[0].set_ylabel("height z [mm]")
    panels[1].plot(*tread * MM, "o", color=style.PATCH[1], ms=4)
    _window(panels[0], tread, "b", style.PATCH[1], WINDOWS[1])
    said = f"contact angle {np.degrees(at.tread_angle):.1f}°"
    _note(panels[1], f"{said}\nradius {at.rolling_radius * MM:.1f} mm", style.PATCH[1])
    _note(panels[0], f"yaw {at.yaw * 1e3:.0f} mrad\nshift {at.shift * MM:.2f} mm", style.INK)
    if at.flange_point is None or at.flange_gap is None or at.flange_angle is None:
        return
    ends = np.array([at.flange_point[1:], nearest])
    panels[2].plot(*ends.T * MM, "o-", color=style.PATCH[2], ms=3)
    _window(panels[0], views[2][0], "c", style.PATCH[2], WINDOWS[2])
    said = f"gap {at.flange_gap * MM:.2f} mm\nangle {np.degrees(at.flange_angle):.1f}°"
    ahead = (at.flange_point[0] - at.tread_point[0]) * MM
    _note(panels[2], f"{said}\n{ahead:.1f} mm ahead of b", style.PATCH[2])


def _gap(axes: "Axes", at: "Placement", gap: "Gap") -> None:
    """Draw the gap function: height over the rail and normal distance against lateral position."""
    y = gap.points[:, 1] * MM
    near = np.isfinite(gap.vertical)
    axes.plot(y[near], gap.vertical[near] * MM, color=style.INK, lw=1.2, label="vertical")
    axes.plot(y[near], gap.normal[near] * MM, "--", color=style.INK, lw=0.9, label="normal")
    axes.axvline(at.tread_point[1] * MM, color=style.PATCH[1], lw=0.8)
    axes.plot(at.tread_point[1] * MM, 0.0, "o", color=style.PATCH[1], ms=4, label="tread contact")
    if at.flange_point is not None and at.flange_gap is not None:
        axes.axvline(at.flange_point[1] * MM, color=style.PATCH[2], lw=0.8)
        point = at.flange_point[1] * MM, at.flange_gap * MM
        axes.plot(*point, "o", color=style.PATCH[2], ms=4, label="flange")
    axes.set(xlim=(y[near].min(), y[near].max()), ylim=(-0.15, TALLEST))
    axes.set(xlabel="lateral y [mm]", ylabel="gap [mm]")
    axes.legend(loc="upper center", ncols=2)
    style.letter(axes, "c" if at.flange_point is None else "d", "gap between wheel and rail")


def outlines(axes: "Axes", wheel: Array, rail: Array, centre: Array, half: float) -> None:
    """Fill wheel and rail in a window of half width ``half`` about ``centre`` [m]."""
    for points, colour, above in ((wheel, style.WHEEL, True), (rail, style.RAIL, False)):
        closed = np.vstack([points, points[[-1, 0]]])
        if above:
            closed[-2:, 1] = centre[1] + 3 * half
        axes.fill(*closed.T * MM, color=colour, lw=0)
        axes.plot(*points.T * MM, color=style.INK, lw=0.8)
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
        mark,
        tuple((centre + way * half) * MM),
        xytext=(6 * way, 6 * way),
        textcoords="offset points",
        color=colour,
        weight="bold",
        ha="center",
        va="center",
    )


def _note(axes: "Axes", text: str, colour: str) -> None:
    box = {"boxstyle": "square", "fc": "white", "ec": colour, "lw": 0.7, "alpha": 0.9}
    axes.text(
        0.97, 0.04, text, transform=axes.transAxes, ha="right", va="bottom", fontsize=6.5, bbox=box
    )


def _legend(fig: "Figure") -> None:
    from matplotlib.patches import Patch

    keys = [
        Patch(fc=colour, ec=style.INK, lw=0.6, label=label)
        for colour, label in (
            (style.WHEEL, "wheel: what can touch, seen along the rail"),
            (style.RAIL, "rail"),
        )
    ]
    fig.legend(handles=keys, loc="outside lower center", ncols=2)
