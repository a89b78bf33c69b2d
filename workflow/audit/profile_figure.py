# SPDX-License-Identifier: LGPL-3.0-or-later
"""Figure of a profile file: outline with origin and corners, angle, curvature, a close-up."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from meshes.arrays import Array
from meshes.profiles.measured import OPEN, Reading
from meshes.profiles.orientation import Axes
from workflow.audit.profile import smooth_part
from workflow.figures import style
from workflow.scene.scene import SceneError

if TYPE_CHECKING:
    from matplotlib.axes import Axes as Panel
    from matplotlib.figure import Figure

MM = 1e3
MANY = 150  # points that can be told apart in the outline
BESIDE = 14  # room for a name beside the head of a rail [mm]
ROUND = 1.15  # the scale of curvature reaches this far beyond all but the sharpest hundredth


def draw(found: Reading, axes: Axes, path: Path) -> Path:
    """Write the figure and return its path.

    Raises:
        SceneError: if it cannot be written.
    """
    with style.style():
        fig = figure(found, axes)
        try:
            return style.save(fig, path)
        except (OSError, ValueError) as error:  # ValueError: a format that cannot be drawn
            raise SceneError(f"--figure {str(path)!r}: expected a .png to write: {error}") from None


def figure(found: Reading, axes: Axes) -> "Figure":
    """Return the figure of a reading."""
    fig = style.figure(style.PAGE, 6.2)
    panels = fig.subplot_mosaic("aa;bc;dc", height_ratios=(1.35, 1, 1))
    _outline(panels["a"], found, axes)
    _close_up(panels["c"], found)
    s, smooth = found.profile.s * MM, smooth_part(found)
    _along(panels["b"], found, s, np.degrees(found.profile.angles))
    panels["b"].set(ylabel="angle [°]")
    style.letter(panels["b"], "b", "direction of the curve")
    curvature = np.where(smooth, found.profile.curvatures, np.nan)
    _along(panels["d"], found, s, curvature)
    high = ROUND * max(np.nanpercentile(np.abs(curvature), 99), 1.0) if smooth.any() else 1.0
    panels["d"].set(ylim=(-high, high), ylabel="curvature [1/m]", xlabel="arc length [mm]")
    style.letter(panels["d"], "d", "curvature, negative where convex")
    panels["b"].sharex(panels["d"])
    panels["b"].tick_params(labelbottom=False)
    return fig


def _outline(panel: "Panel", found: Reading, axes: Axes) -> None:
    """Draw the outline with its material, points, corners, and what the origin is measured by."""
    y, z = found.profile.points.T * MM
    wheel = found.kind == "wheel"
    low = min(y.min(), -axes.flange_back * MM) if wheel else y.min()
    right = y.max() if wheel else y.max() + BESIDE
    floor, ceiling = z.min() - 0.12 * np.ptp(z) - 4, z.max() + 0.1 * np.ptp(z) + 3
    colour = style.WHEEL if wheel else style.RAIL
    panel.fill([*y, y[-1], y[0]], [*z, floor, floor], lw=0, color=colour)
    panel.plot(y, z, color=style.INK, lw=0.9)
    if len(found.points) <= MANY:
        panel.plot(*found.points.T * MM, ".", color=style.INK, ms=3)
    _corners(panel, found)
    panel.plot(0, 0, "+", color=style.ONE_POINT, ms=11, mew=1.3)
    panel.axvline(0, color=style.ONE_POINT, lw=0.7)
    _named(panel, (0.0, floor), "tape circle" if wheel else "rail axis")
    if wheel:
        panel.axvline(-axes.flange_back * MM, color=style.ONE_POINT, lw=0.7, ls="--")
        _named(panel, (-axes.flange_back * MM, floor), "flange back")
    else:
        depth = z.max() - axes.gauge_depth * MM
        panel.axhline(depth, color=style.ONE_POINT, lw=0.7, ls="--")
        _named(panel, (y.max(), depth), "gauge line")
    panel.set(aspect="equal", xlim=(low - 4, right + 4), ylim=(floor, ceiling))
    panel.set(xlabel="lateral, to the field side [mm]", ylabel="outward [mm]")
    style.letter(panel, "a", _title(found))


def _title(found: Reading) -> str:
    """Return what the file is, and below how its coordinates were taken."""
    at, name = found.oriented, found.path.name
    name = name if len(name) <= 40 else f"{name[:37]}..."
    side = "flange" if found.kind == "wheel" else "gauge side"
    return (
        f"{name}: a {found.kind} of {len(found.points)} points; {found.file.format}\n"
        f"in the file: {at.unit}, origin at the {at.origin.replace('-', ' ')}, {side} {at.inner}, "
        f"outward {at.outward}"
    ).replace("$", r"\$")


def _corners(panel: "Panel", found: Reading) -> None:
    if len(found.corners):
        corners = found.profile.at(found.corners).T * MM
        panel.plot(*corners, "o", color=style.TWO_POINT, ms=5, mfc="none", label="corners")


def _named(panel: "Panel", at: tuple[float, float], text: str) -> None:
    """Name a line at a point of it."""
    note = panel.annotate(text, at, xytext=(3, 3), textcoords="offset points", fontsize=6.5)
    note.set_color(style.ONE_POINT)


def _along(panel: "Panel", found: Reading, s: Array, values: Array) -> None:
    panel.plot(s, values, color=style.INK, lw=0.9)
    for corner in found.corners * MM:
        panel.axvline(corner, color=style.TWO_POINT, lw=0.6)
    panel.set_xlim(s[0], s[-1])


def _close_up(panel: "Panel", found: Reading) -> None:
    """Draw points and curve where the points leave most open, or lie farthest off it."""
    if found.gaps.max() > OPEN:
        k, why = int(np.argmax(found.gaps)), "where the points leave the curve most open"
    elif found.smoothing:
        k, why = int(np.argmax(found.residuals)), "where the points lie farthest off"
    else:
        k, why = int(np.argmax(found.turns)) + 1, "where chords turn most"
    near = found.points[max(k - 6, 0) : k + 7]
    centre = (near.min(axis=0) + near.max(axis=0)) / 2 * MM
    half = 0.6 * np.ptp(near, axis=0).max() * MM
    panel.plot(*found.profile.points.T * MM, color=style.INK, lw=1.0, label="curve")
    panel.plot(*found.points.T * MM, "o", color=style.ONE_POINT, ms=3, label="points")
    _corners(panel, found)
    panel.set(xlim=(centre[0] - half, centre[0] + half), ylim=(centre[1] - half, centre[1] + half))
    panel.set(aspect="equal", xlabel="lateral [mm]")
    panel.legend(loc="best")
    style.letter(panel, "c", why)
