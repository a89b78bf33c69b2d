# SPDX-License-Identifier: LGPL-3.0-or-later
"""Figure of the stability matrix: every cell with its verdict and number, and the limits."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from workflow.figures import style
from workflow.stability.run import KINDS, counts

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Rows = Sequence[dict[str, Any]]

COLOUR = {
    "accurate": "#8fd0c4",
    "model": "#a9c4ec",
    "wrong": "#f7cf7f",
    "refused": "#d5d5d5",
    "caught": "#d98ca4",
    "unseen": "#222222",
}
WORDS = {
    "accurate": "stable and accurate",
    "model": "the model itself is unstable",
    "wrong": "stable but wrong",
    "refused": "refused",
    "caught": "stopped by a guard",
    "unseen": "blew up unseen",
}
LETTER = {
    "normal force": "N",
    "change of speed": "v",
    "tangential force": "T",
    "ripple": "r",
    "depth / cell": "d",
    "pressure": "p",
    "elongation": "l",
    "energy": "e",
    "contact energy": "c",
}
MARKS = {"step": ("o", "#0072b2"), "penalty": ("s", "#d55e00"), "damping": ("D", "#7a5195")}


def draw(rows: Rows, limits: Rows, path: Path) -> Path:
    """Draw the verdicts of a matrix and the limits found; return the path of the PNG.

    Args:
        rows: Rows of ``cells.csv``.
        limits: Rows of ``limits.csv``; may be empty.
        path: File to write.
    """
    panels = {row["panel"]: [r for r in rows if r["panel"] == row["panel"]] for row in rows}
    strips = {k: v for k, v in panels.items() if not v[0]["y"]}
    grids = {k: v for k, v in panels.items() if v[0]["y"]}
    with style.style():
        fig = style.figure(style.PAGE, 9.6)
        parts: Any = fig.subfigures(3, 1, height_ratios=[4.4, 3.6, 1.75])
        top, middle, bottom = parts
        half = (len(strips) + 1) // 2
        columns = top.subplots(1, 2)
        names = list(strips)
        for axes, part in zip(columns, (names[:half], names[half:]), strict=True):
            _strips(axes, {name: strips[name] for name in part}, half)
        style.letter(columns[0], "a", _title(rows))
        places = middle.subplots(2, 4).ravel()
        for axes, (name, group) in zip(places, grids.items(), strict=False):
            _grid(axes, name, group)
        for axes in places[len(grids) :]:
            axes.set_axis_off()
        left, right = bottom.subplots(1, 2, width_ratios=[1, 1.5])
        _legend(left)
        _limits(right, limits)
        return style.save(fig, path)


def _title(rows: Rows) -> str:
    number = counts(rows)
    told = ", ".join(f"{number[k]} {WORDS[k]}" for k in KINDS if number[k])
    return f"{len(rows)} runs: {told}"


def text(row: dict[str, Any]) -> str:
    """Return what stands in a cell: letter and size of the worst measure, or the last step."""
    if row["kind"] == "refused":
        return "–"
    if row["kind"] in ("caught", "unseen"):
        return f"†{row['steps']}"
    value = row["value"]
    size = f"{100 * value:.0f}" if value >= 0.0095 else f"{100 * value:.1g}"
    if value < 1e-4:
        size = "0"
    return f"{LETTER[row['measure']]} {size if value < 10 else '>999'}"


def _cell(axes: "Axes", row: dict[str, Any], x: float, y: float, width: float, high: float) -> None:
    """Draw one cell with its lower left corner at (x, y)."""
    from matplotlib.patches import Rectangle

    face = COLOUR[row["kind"]]
    axes.add_patch(Rectangle((x, y), width, high, fc=face, ec="white", lw=0.8))
    ink = "white" if row["kind"] == "unseen" else style.INK
    axes.text(
        x + width / 2,
        y + high / 2,
        text(row),
        ha="center",
        va="center_baseline",
        fontsize=4.6,
        color=ink,
    )


def _strips(axes: "Axes", strips: dict[str, list[dict[str, Any]]], most: int) -> None:
    """Draw axes one below the other: title, values, cells."""
    for k, (name, group) in enumerate(strips.items()):
        y, width = -k, 1 / len(group)
        axes.text(0, y + 0.83, name, fontsize=6, va="center", weight="bold")
        for i, row in enumerate(group):
            _cell(axes, row, i * width, y, width, 0.42)
            axes.text((i + 0.5) * width, y + 0.55, row["x"], ha="center", va="center", fontsize=5)
    axes.set_xlim(0, 1)
    axes.set_ylim(1 - most - 0.05, 1)
    axes.set_axis_off()


def _grid(axes: "Axes", name: str, group: list[dict[str, Any]]) -> None:
    """Draw a pair: values of the second key along x, of the first along y."""
    xs = list(dict.fromkeys(row["x"] for row in group))
    ys = list(dict.fromkeys(row["y"] for row in group))
    for row in group:
        _cell(axes, row, xs.index(row["x"]), ys.index(row["y"]), 1, 1)
    first, second = name.split(" × ")
    axes.set_xlim(0, len(xs))
    axes.set_ylim(0, len(ys))
    short = [x.replace("0.", ".") if len(x) > 3 else x for x in xs]
    axes.set_xticks(np.arange(len(xs)) + 0.5, short, fontsize=5.5)
    axes.set_yticks(np.arange(len(ys)) + 0.5, ys, fontsize=5.5)
    axes.tick_params(length=0)
    axes.grid(False)
    for spine in axes.spines.values():
        spine.set_visible(False)
    axes.set_xlabel(second, fontsize=6, labelpad=1)
    axes.set_ylabel(first, fontsize=6, labelpad=1)


def _legend(axes: "Axes") -> None:
    """Say what colours and letters mean."""
    from matplotlib.patches import Patch

    axes.set_axis_off()
    handles = [Patch(fc=COLOUR[k], label=WORDS[k]) for k in KINDS]
    axes.legend(handles=handles, loc="upper left", fontsize=6, borderaxespad=0)
    axes.text(
        0.0,
        0.3,
        "number: the worst measure in %\n"
        "N normal force, v change of speed, T tangential force,\n"
        "p largest pressure, l elongation, against closed forms;\n"
        "r ripple of the normal force, rms;\n"
        "d penetration over the cell; over the work of the contact: e energy balance,\n"
        "c energy given or taken by the contact; † step at which a guard stopped it",
        transform=axes.transAxes,
        va="top",
        fontsize=5.5,
        linespacing=1.4,
    )


def _limits(axes: "Axes", limits: Rows) -> None:
    """Draw predicted over found limits; right of 1 the audit is optimistic."""
    cases = list(dict.fromkeys(row["case"] for row in limits))
    for key, (marker, colour) in MARKS.items():
        mine = [r for r in limits if r["key"] == key and 0 < r["ratio"] < np.inf]
        at = [-cases.index(r["case"]) for r in mine]
        axes.plot([r["ratio"] for r in mine], at, marker, color=colour, ms=3.5, label=key)
    for row in limits:
        if not 0 < row["ratio"] < np.inf:
            colour, y = MARKS[row["key"]][1], -cases.index(row["case"])
            axes.plot(0.415, y, "<", color=colour, ms=3.5)
            axes.text(0.435, y, "none found", va="center_baseline", fontsize=5, color=colour)
    axes.axvline(1, color=style.INK, lw=0.7, zorder=0)
    axes.set_yticks([-k for k in range(len(cases))], cases, fontsize=5.5)
    axes.set_xscale("log")
    ticks = (0.5, 0.7, 1.0, 1.4, 2.0)
    axes.set_xticks(ticks, [f"{t:g}" for t in ticks])
    axes.set_xticks([], minor=True)
    axes.set_xlim(0.4, 2.5)
    axes.set_xlabel("limit predicted by squealx audit over limit found by runs", fontsize=6)
    axes.legend(loc="upper right", fontsize=6, ncols=1)
    style.letter(axes, "b", "limits of stability")
