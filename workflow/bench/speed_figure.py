# SPDX-License-Identifier: LGPL-3.0-or-later
"""Figure of ``squealx bench``: kernels, roofline, whole steps and contact."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from workflow.figures import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# assemble_vector, tuned, native float64, native float32, MatMult: in the order of the table
COLOURS = ("#9a9a9a", "#56b4e9", "#0072b2", "#009e73", "#d55e00")
MARKERS = ("o", "s", "D", "^", "v", "P")  # of the forms


def draw(found: dict[str, Any], path: Path) -> Path:
    """Draw kernels, roofline, whole steps and contact of a bench; return the path of the PNG."""
    with style.style():
        fig = style.figure(style.PAGE, 7.6)
        panels = fig.subplot_mosaic([["a", "b"], ["a", "c"], ["a", "d"]])
        _kernels(panels["a"], found)
        _roofline(panels["b"], found)
        _steps(panels["c"], found)
        _contact(panels["d"], found)
        return style.save(fig, path)


def _kernels(axes: "Axes", found: dict[str, Any]) -> None:
    """Bars of every engine, form below form, each form with its marker of the roofline."""
    forms = found["kernels"]["forms"]
    most = max(row["rate"] for engines in forms.values() for row in engines.values()) / 1e6
    for k, (title, engines) in enumerate(forms.items()):
        top = k * (len(engines) + 1.6)
        at = top + np.arange(len(engines))
        rates = [row["rate"] / 1e6 for row in engines.values()]
        bars = axes.barh(at, rates, 0.85, color=COLOURS, label=list(engines) if k == 0 else None)
        labels = [
            f"{row['rate'] / 1e6:.1f} ({row['ratio_reference']:.1f}×)" for row in engines.values()
        ]
        axes.bar_label(bars, labels, padding=2, fontsize=5.5)
        axes.text(0.02 * most, top - 0.7, title, va="bottom", fontsize=6.5)
        axes.plot(0, top - 0.9, MARKERS[k], color=style.INK, ms=4, clip_on=False)
    axes.set_yticks([])
    axes.set_ylim(top + len(engines) + 2.5, -1.8)  # downwards, with room for the legend
    axes.grid(False, axis="y")
    axes.set_xlim(0, 1.35 * most)
    axes.set_xlabel("million element updates per second\n(× stock St. Venant-Kirchhoff, full)")
    axes.legend(loc="lower right", fontsize=6, ncols=2)
    style.letter(axes, "a", "kernels on one core")


def _roofline(axes: "Axes", found: dict[str, Any]) -> None:
    """Speed against intensity: colours are the engines of panel a, markers its forms."""
    core, forms = found["roofline"]["core"], found["roofline"]["forms"]
    x = np.geomspace(0.05, 100, 200)
    for peak, dashes in (("peak_float64", "-"), ("peak_float32", "--")):
        roof = np.minimum(core[peak], x * core["bandwidth"]) / 1e9
        axes.loglog(x, roof, color=style.INK, ls=dashes, lw=1)
        axes.text(95, core[peak] / 1e9 * 1.08, peak[5:], ha="right", va="bottom", fontsize=6)
    for engines, marker in zip(forms.values(), MARKERS, strict=True):
        for load, colour in zip(engines.values(), COLOURS, strict=True):
            speed = load["speed"] / 1e9
            axes.plot(load["intensity"], speed, marker, color=colour, ms=4, mew=0.4, mec="white")
    axes.set_xlim(0.05, 100)
    axes.set_ylim(1, 2 * core["peak_float32"] / 1e9)
    axes.set_xlabel("operations per byte, estimated [-]")
    axes.set_ylabel("speed [Gflop/s]")
    style.letter(axes, "b", "roofline of one core, markers as in (a)")


def _steps(axes: "Axes", found: dict[str, Any]) -> None:
    cells = [row["cells"] for row in found["steps"]]
    for key, label, colour in (
        ("kernel_rate", "its kernel alone", COLOURS[1]),
        ("rate", "whole step", COLOURS[2]),
    ):
        rates = [row[key] / 1e6 for row in found["steps"]]
        axes.semilogx(cells, rates, "o-", ms=3, color=colour, label=label)
    both = found["ranks"]
    if both is not None:
        axes.plot(both["cells"], both["two"] / 1e6, "*", ms=8, color=COLOURS[4], label="2 ranks")
    axes.set_ylim(bottom=0)
    axes.set_xlabel("cells")
    axes.set_ylabel("million element updates\nper second")
    axes.legend(loc="lower left")
    style.letter(axes, "c", "whole step of a block")


def _contact(axes: "Axes", found: dict[str, Any]) -> None:
    nodes = np.array([row["nodes"] for row in found["contact"]["sizes"]])
    seconds = np.array([row["seconds"] for row in found["contact"]["sizes"]])
    fixed = np.array([row["fixed"] for row in found["contact"]["sizes"]])
    axes.loglog(nodes, 1e6 * seconds, "o-", ms=3, color=COLOURS[2], label="pressed, sliding")
    axes.loglog(nodes, 1e6 * fixed, "s-", ms=3, color=COLOURS[0], label="apart: none in reach")
    x = np.array([nodes[0], nodes[-1]])
    guide = 1e6 * found["contact"]["per_node"] * x
    label = f"{found['contact']['per_node'] * 1e6:.2f} µs per node"
    axes.loglog(x, guide, color=style.CLOSED_FORM, lw=3, zorder=1, label=label)
    axes.set_xticks(nodes, map(str, nodes))
    axes.set_xticks([], minor=True)
    axes.set_ylim(top=8e6 * seconds.max())  # for the legend
    axes.set_xlabel("contactor nodes")
    axes.set_ylabel("time per step [µs]")
    axes.legend(loc="upper left")
    style.letter(axes, "d", "contact with friction")
