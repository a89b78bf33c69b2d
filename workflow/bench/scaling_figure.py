# SPDX-License-Identifier: LGPL-3.0-or-later
"""Figure of ``squealx scaling``: step by term, efficiency, and exchange against ranks."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from workflow.bench.scaling import PAYS, TERMS
from workflow.figures import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# what shrinks with ranks is blue, what every rank does alike is warm, talk is green and grey
COLOURS = {
    "kernel": "#0072b2",
    "update": "#56b4e9",
    "fixed": "#e69f00",
    "contact": "#d55e00",
    "gathers": "#cc79a7",
    "messages": "#009e73",
    "bytes": "#8fd3bd",
    "reductions": "#9a9a9a",
}
LABELS = {"fixed": "calls, on every rank", "contact": "contact, in part on every rank"}


def draw(found: dict[str, Any], path: Path) -> list[Path]:
    """Draw the scaling of a scene; return the paths of PNG and PDF."""
    with style.style():
        fig = style.figure(style.PAGE, 5.2)
        panels = fig.subplot_mosaic([["a", "b"], ["a", "c"]], width_ratios=(1.45, 1))
        _terms(panels["a"], found)
        _gain(panels["b"], found["ranks"])
        _exchange(panels["c"], found["ranks"])
        vector = path.with_suffix(".pdf")
        style.save(fig, path)
        fig.savefig(vector, facecolor="white")
    return [path, vector]


def _terms(axes: "Axes", found: dict[str, Any]) -> None:
    """Terms of the step and their sum; dashed, where a doubling begins to gain too little."""
    rows = found["ranks"]
    ranks = np.array([row["ranks"] for row in rows])
    ideal = 1e6 * rows[0]["step"] / ranks
    axes.loglog(ranks, ideal, color=style.CLOSED_FORM, lw=3, label="step of one rank over ranks")
    for name in TERMS:
        times = np.array([row["terms"][name] for row in rows])
        shown = np.where(times > 0, 1e6 * times, np.nan)
        label = LABELS.get(name, name)
        axes.loglog(ranks, shown, "o-", ms=2.5, lw=1, color=COLOURS[name], label=label)
    step = 1e6 * np.array([row["step"] for row in rows])
    axes.loglog(ranks, step, "s-", ms=3.5, lw=1.8, color=style.INK, label="step")
    if found["pays_until"] is not None:
        axes.axvline(found["pays_until"], ymax=0.8, color=style.FAINT, ls="--", lw=0.8)
    axes.set_ylim(0.1, 60 * step[0])  # room for the legend
    _ranks(axes, ranks)
    axes.set_ylabel("time per step [µs]")
    axes.legend(loc="upper right", ncols=2, fontsize=6.5)
    style.letter(axes, "a", f"{found['scene']}, {found['cells']} cells, predicted")


def _gain(axes: "Axes", rows: list[dict[str, Any]]) -> None:
    """Efficiency and the share of contact, and where a doubling stops paying."""
    ranks = np.array([row["ranks"] for row in rows])
    for key, label, colour in (
        ("efficiency", "efficiency", style.INK),
        ("contact_share", "share of contact", COLOURS["contact"]),
    ):
        values = [100 * row[key] for row in rows]
        axes.semilogx(ranks, values, "o-", ms=2.5, color=colour, label=label)
    gains = [50 * row["gain_of_doubling"] for row in rows[1:]]
    axes.semilogx(
        ranks[1:], gains, "s:", ms=2.5, color=COLOURS["kernel"], label="gain of doubling / 2"
    )
    axes.axhline(50 * PAYS, color=style.FAINT, ls="--", lw=0.8, label=f"a doubling gains {PAYS}")
    axes.set_ylim(0, 140)  # room for the legend
    _ranks(axes, ranks)
    axes.set_ylabel("[%]")
    axes.legend(loc="upper center", ncols=2, fontsize=6.5)
    style.letter(axes, "b", "what ranks gain")


def _exchange(axes: "Axes", rows: list[dict[str, Any]]) -> None:
    """Cells, ghosts and messages of the rank that has most of each."""
    rows = rows[1:]
    ranks = np.array([row["ranks"] for row in rows])
    for key, label, colour in (
        ("cells_per_rank", "cells, mean", COLOURS["kernel"]),
        ("ghosts_max", "ghost nodes", COLOURS["messages"]),
        ("messages_max", "messages in a step", COLOURS["reductions"]),
        ("contact_ranks", "ranks that hold contact", COLOURS["contact"]),
    ):
        values = [row[key] or np.nan for row in rows]
        axes.loglog(ranks, values, "o-", ms=2.5, color=colour, label=label)
    _ranks(axes, ranks)
    axes.set_ylim(1, 30 * max(row["cells_per_rank"] for row in rows))  # room for the legend
    axes.set_ylabel("number")
    axes.legend(loc="upper right", ncols=2, fontsize=6.5)
    style.letter(axes, "c", "partition, the rank with most of each")


def _ranks(axes: "Axes", ranks: Any) -> None:
    axes.set_xticks(ranks, map(str, ranks))
    axes.set_xticks([], minor=True)
    axes.set_xlabel("ranks")
