# SPDX-License-Identifier: LGPL-3.0-or-later
"""The figure of ``squealx bench``."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from workflow import theme

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# assemble_vector, tuned, native float64, native float32, MatMult: in the order of the table
COLOURS = ("#9a9a9a", "#56b4e9", "#0072b2", "#009e73", "#d55e00")
MARKERS = ("o", "s", "D", "^", "v")


def draw(found: dict[str, Any], path: Path) -> Path:
    """Draw kernels, roofline, whole steps and contact of a bench; return the path of the PNG."""
    with theme.style():
        fig = theme.figure(theme.PAGE, 5.4)
        panels = fig.subplots(2, 2).ravel()
        _kernels(panels[0], found)
        _roofline(panels[1], found)
        _steps(panels[2], found)
        _contact(panels[3], found)
        return theme.save(fig, path)


def _kernels(axes: "Axes", found: dict[str, Any]) -> None:
    forms = found["kernels"]["forms"]
    names = list(next(iter(forms.values())))
    at = np.arange(len(names))
    for k, (title, engines) in enumerate(forms.items()):
        rates = [engines[name]["rate"] / 1e6 for name in names]
        bars = axes.barh(at + 0.4 * k, rates, 0.36, color=COLOURS, alpha=1 - 0.45 * k, label=title)
        labels = [
            f"{r:.1f} ({engines[n]['ratio']:.1f}×)" for n, r in zip(names, rates, strict=True)
        ]
        axes.bar_label(bars, labels, padding=2, fontsize=6)
    axes.set_yticks(at + 0.2, names)
    axes.invert_yaxis()
    axes.grid(False, axis="y")
    axes.set_xlim(0, 1.3 * max(r["rate"] for e in forms.values() for r in e.values()) / 1e6)
    axes.set_xlabel("million element updates per second")
    theme.letter(axes, "a", f"{' (full), '.join(forms)} (pale)")


def _roofline(axes: "Axes", found: dict[str, Any]) -> None:
    core, forms = found["roofline"]["core"], found["roofline"]["forms"]
    x = np.geomspace(0.05, 100, 200)
    for peak, dashes in (("peak_float64", "-"), ("peak_float32", "--")):
        roof = np.minimum(core[peak], x * core["bandwidth"]) / 1e9
        axes.loglog(x, roof, color=theme.INK, ls=dashes, lw=1)
        axes.text(95, core[peak] / 1e9 * 1.08, peak[5:], ha="right", va="bottom", fontsize=6)
    engines = forms[next(iter(forms))]
    for (name, load), colour, marker in zip(engines.items(), COLOURS, MARKERS, strict=True):
        axes.plot(
            load["intensity"], load["speed"] / 1e9, marker, color=colour, ms=5, ls="", label=name
        )
    axes.set_xlim(0.05, 100)
    axes.set_ylim(1, 4 * core["peak_float32"] / 1e9)
    axes.set_xlabel("operations per byte, estimated [-]")
    axes.set_ylabel("speed [Gflop/s]")
    axes.legend(loc="upper left", ncols=2, fontsize=6, columnspacing=1.0, handletextpad=0.2)
    theme.letter(axes, "b", f"roofline of one core, {next(iter(forms))}")


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
    theme.letter(axes, "c", "whole step of a block")


def _contact(axes: "Axes", found: dict[str, Any]) -> None:
    nodes = np.array([row["nodes"] for row in found["contact"]["sizes"]])
    seconds = np.array([row["seconds"] for row in found["contact"]["sizes"]])
    fixed = np.array([row["fixed"] for row in found["contact"]["sizes"]])
    axes.loglog(nodes, 1e6 * seconds, "o-", ms=3, color=COLOURS[2], label="pressed, sliding")
    axes.loglog(nodes, 1e6 * fixed, "s-", ms=3, color=COLOURS[0], label="apart: none in reach")
    x = np.array([nodes[0], nodes[-1]])
    guide = 1e6 * found["contact"]["per_node"] * x
    label = f"{found['contact']['per_node'] * 1e6:.2f} µs per node"
    axes.loglog(x, guide, color=theme.CLOSED_FORM, lw=3, zorder=1, label=label)
    axes.set_xticks(nodes, map(str, nodes))
    axes.set_xticks([], minor=True)
    axes.set_ylim(top=8e6 * seconds.max())  # for the legend
    axes.set_xlabel("contactor nodes")
    axes.set_ylabel("time per step [µs]")
    axes.legend(loc="upper left")
    theme.letter(axes, "d", "contact with friction")
