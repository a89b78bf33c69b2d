# SPDX-License-Identifier: LGPL-3.0-or-later
"""Shakedown map: pressure and traction of a run or of passes against the limits of rolling."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from workflow.figures import style
from workflow.model.residual import passes_in
from workflow.results.record import Record
from workflow.results.shakedown import Trail, trails

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDEST, LEAST = 1.0, 0.6  # of the axis of traction
ROOM = 1.15  # above the highest point
LOWEST = 6.0  # of the upper end of the axis of pressure
MARKS = ("o", "s", "D", "^", "v", "P")


def shakedown_map(record: Record) -> "Figure | None":
    """Points of patches and travelling loads on the shakedown map, of every pass so far.

    Large marks are where the pressure of a patch is largest, thin lines its way over the outputs. k
    is the yield stress in shear of the weaker body, without hardening. Curves: a line contact in
    full slip along the way, first yield after von Mises and the limit of shakedown after Melan,
    computed from the elastic stresses with Poisson's ratio 0.3; beyond the latter steel without
    hardening flows in every pass. On the left axis: circular contact without traction, first yield
    at 2.8 k and shakedown at 4.7 k (Johnson, 1985, as quoted).
    """
    folders = passes_in(record.folder.parent)
    if record.folder in folders:
        folders = folders[: folders.index(record.folder) + 1]
    else:
        folders = [record.folder]
    found = [trails(folder, record.checked) for folder in folders]
    if not any(found):
        return None
    fig = style.figure(style.COLUMN, 3.6)
    axes = fig.subplots()
    _limits(axes, max(float(t.pressure.max()) for trails in found for t in trails))
    _points(axes, found)
    axes.set_xlabel("tangential over normal force T/N [-]")
    axes.set_ylabel("largest pressure over yield in shear p₀/k [-]")
    axes.legend(loc="upper right", fontsize=6)
    return fig


def _limits(axes: "Axes", highest: float) -> None:
    """Draw the curves of line contact and the marks of point contact."""
    from contact.theory import shakedown

    friction = np.linspace(0, WIDEST, 41)
    first = [shakedown.line_first_yield(float(f)) for f in friction]
    last = [shakedown.line_shakedown(float(f)) for f in friction]
    axes.fill_between(friction, 0, first, color=style.CLOSED_FORM, alpha=0.25, lw=0)
    axes.plot(friction, first, "--", color=style.INK, lw=1, label="line contact: first yield")
    axes.plot(friction, last, "-", color=style.INK, lw=1.3, label="line contact: shakedown")
    for height, mark, word in (
        (shakedown.POINT_FIRST_YIELD, "<", "first yield"),
        (shakedown.POINT_SHAKEDOWN, ">", "shakedown"),
    ):
        axes.plot(
            0, height, mark, color=style.FAINT, ms=6, clip_on=False, label=f"circle, T = 0: {word}"
        )
    axes.set_ylim(0, max(LOWEST, ROOM * highest))


def _points(axes: "Axes", found: Sequence[Sequence[Trail]]) -> None:
    """Draw trails and their heaviest points, the first pass light and the last dark."""
    from matplotlib import colormaps

    widest = LEAST
    for k, own in enumerate(found, 1):
        share = (k - 1) / max(len(found) - 1, 1)
        colour = colormaps["viridis_r"](0.25 + 0.75 * share if len(found) > 1 else 0.7)
        for mark, trail in zip(MARKS * (1 + len(own) // len(MARKS)), own, strict=False):
            row = trail.heaviest
            word = trail.of if len(found) == 1 else f"{trail.of}, pass {k}"
            told = word if k in (1, len(found)) else None
            axes.plot(trail.traction, trail.pressure, "-", lw=0.5, color=colour, alpha=0.6)
            at = row["traction_coefficient"], row["pressure_over_k"]
            size = 9 - 4 * share if len(found) > 1 else 6
            (point,) = axes.plot(*at, mark, ms=size, color=colour, zorder=5, label=told)
            point.set(mec="white", mew=0.5, clip_on=False)
            widest = max(widest, 1.1 * at[0])
    axes.set_xlim(0, min(widest, WIDEST))
