# SPDX-License-Identifier: LGPL-3.0-or-later
"""The patch at rest against Hertz and the half-space: outline, and pressure along two lines."""

from typing import TYPE_CHECKING, Any

import numpy as np

from workflow import theme
from workflow.recorded import Record
from workflow.theme import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from workflow.at_rest import AtRest

MM, MPA = 1e3, 1e-6
HALF_SPACE, HERTZ = theme.CLOSED_FORMS[1], theme.CLOSED_FORM
LINES: dict[str, Any] = {
    "half-space": {"color": HALF_SPACE, "lw": 3.5},
    "layer": {"color": theme.PATCH[2], "lw": 1.0},
    "Hertz": {"color": HERTZ, "lw": 1.5, "ls": "--"},
}
NODES: dict[str, Any] = {"color": theme.PATCH[1], "ms": 4.5, "ls": "", "marker": "o"}
MEANS: dict[str, Any] = {"mfc": "none", "mec": theme.PATCH[2], "ms": 6.5, "ls": "", "marker": "s"}
AXES = ("longitudinal [mm]", "lateral [mm]")


def at_rest(record: Record) -> "Figure | None":
    """Outline and pressure of the patch at rest, Hertz and the half-space under the same force."""
    from workflow.at_rest import at_rest as contact_at_rest

    try:
        rest = contact_at_rest(record)
    except RuntimeError:  # too large a patch: a flange that lies in the gauge corner
        return None
    if rest is None:
        return None
    fig = theme.figure(theme.PAGE, 3.1)
    plan, *panels = fig.subplots(1, 3)
    at = rest.at
    middle = at[np.argmax(rest.pressure)]
    _plan(plan, rest, at, middle)
    for axes, k, mark in zip(panels, (0, 1), "bc", strict=True):
        _line(axes, rest, at, middle, k)
        theme.letter(axes, mark, f"{AXES[k].split()[0]} line")
    top = 1.05 * max(axes.get_ylim()[1] for axes in panels)
    for axes in panels:
        axes.set_ylim(0, top)
    panels[0].set_ylabel("pressure [MPa]")
    _legend(fig, rest)
    return fig


def _plan(axes: "Axes", rest: "AtRest", at: Array, middle: Array) -> None:
    """Draw the outlines, and the nodes with the areas they stand for, dark under pressure."""
    from matplotlib.collections import PolyCollection

    e, half = rest.expected, np.sqrt(rest.patch.areas)[:, None, None] / 2
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    cells = PolyCollection(list((at[:, None] + half * corners) * MM), alpha=0.8, lw=0)
    cells.set_array(rest.pressure * MPA)
    cells.set_cmap(theme.COLOUR_MAP["pressure"])
    axes.add_collection(cells)
    touching = (e.half_space.pressure > 0).T.astype(float)
    axes.contour(e.x * MM, e.y * MM, touching, [0.5], colors=HALF_SPACE, linewidths=2)
    if e.hertz:
        turn = np.linspace(0, 2 * np.pi, 200)
        ring = np.array([e.hertz.a * np.cos(turn), e.hertz.b * np.sin(turn)])
        axes.plot(*ring * MM, **LINES["Hertz"])
    axes.plot(*at.T * MM, ".", color=theme.INK, ms=2)
    axes.axhline(middle[1] * MM, color=theme.FAINT, lw=0.6)
    axes.axvline(middle[0] * MM, color=theme.FAINT, lw=0.6)
    axes.set(xlabel=AXES[0], ylabel=AXES[1], aspect="equal")
    axes.autoscale_view()
    axes.grid(False)
    axes.figure.colorbar(cells, ax=axes, location="top", label="nodal pressure [MPa]", shrink=0.9)
    theme.letter(axes, "a", f"{rest.patch.normal_force / 1e3:.1f} kN, {rest.patch.angle:.1f}°")


def _line(axes: "Axes", rest: "AtRest", at: Array, middle: Array, k: int) -> None:
    """Draw the pressures along axis ``k`` of the frame through a node."""
    e = rest.expected
    other = 1 - k
    row = np.abs(at[:, other] - middle[other]) < 0.4 * np.sqrt(np.median(rest.patch.areas))
    touching = (e.half_space.pressure > 0).any(axis=other)
    reach = np.append((e.x, e.y)[k][touching], at[row, k])
    line = np.zeros((400, 2))
    line[:, k] = np.linspace(reach.min() - 1e-3, reach.max() + 1e-3, len(line))
    line[:, other] = np.mean(at[row, other])
    axes.plot(line[:, k] * MM, e.pressure(line) * MPA, **LINES["half-space"])
    axes.plot(line[:, k] * MM, rest.softened.pressure(line) * MPA, **LINES["layer"])
    if e.hertz:
        axes.plot(line[:, k] * MM, e.hertz.pressure(*line.T) * MPA, **LINES["Hertz"])
    means = e.pressure(at[row], rest.patch.areas[row])
    axes.plot(at[row, k] * MM, means * MPA, **MEANS)
    axes.plot(at[row, k] * MM, rest.pressure[row] * MPA, **NODES)
    axes.set_xlabel(AXES[k])


def _legend(fig: "Figure", rest: "AtRest") -> None:
    from matplotlib.lines import Line2D

    keys = [
        Line2D([], [], label=f"contact nodes, {rest.error:.1%} rms off", **NODES),
        Line2D([], [], label="half-space, mean over a node's area", **MEANS),
        Line2D([], [], label="half-space, profiles as drawn", **LINES["half-space"]),
        Line2D([], [], label=f"with a soft layer as the penalty: {rest.softened_error:.1%} rms",
               **LINES["layer"]),
        Line2D([], [], label="Hertz", **LINES["Hertz"]),
    ]  # fmt: skip
    keys = keys if rest.expected.hertz else keys[:-1]
    fig.legend(handles=keys, loc="outside lower center", ncols=3, columnspacing=1.2)
