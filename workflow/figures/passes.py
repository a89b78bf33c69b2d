# SPDX-License-Identifier: LGPL-3.0-or-later
"""Figure of passes over the same steel: what each leaves with depth, and what it adds."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from meshes.arrays import Array
from workflow.figures import style
from workflow.model.residual import passes_in
from workflow.results.passes import read_section, rows_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NOTHING = 1e-9  # plastic strain below which a pass has added none


def passes(folder: Path) -> "Figure | None":
    """Passes over the same steel: plastic strain, plastic shear and residual stress with depth.

    All are means over the cells below one place of the surface, without loads, after each pass.
    Panel (d) has the most that a pass has added to them anywhere in that section, and its plastic
    work over that of the first pass. Where steel shakes down, these fall to nothing; where it
    ratchets, shear grows by as much in every pass; plastic strain that goes on while shear does not
    is alternating plasticity. What is less than 1e-9 is drawn there.
    """
    rows = rows_of(folder)
    if not rows:
        return None
    sections = [read_section(path) for path in passes_in(folder)[: len(rows)]]
    fig = style.figure(style.PAGE, 5.0)
    strain, shear, stress, added = fig.subplots(2, 2).ravel()
    _profiles(strain, sections, "equivalent_plastic_strain", 100)
    _profiles(shear, sections, "plastic_shear_xz", 100)
    _stresses(stress, sections)
    _added(added, rows)
    titles = ("equivalent plastic strain", "plastic shear", "residual stress", "added by each pass")
    for axes, mark, title in zip((strain, shear, stress, added), "abcd", titles, strict=True):
        style.letter(axes, mark, title)
    strain.set_xlabel("equivalent plastic strain [%]")
    shear.set_xlabel("plastic shear γxz [%]")
    stress.set_xlabel("residual stress [MPa]")
    return fig


def _profiles(axes: Any, sections: Sequence[Mapping[str, Array]], name: str, factor: float) -> None:
    """Draw a column of all sections over depth, the first pass light and the last dark."""
    from matplotlib import colormaps

    for k, section in enumerate(sections, 1):
        colour = colormaps["viridis_r"](0.15 + 0.85 * (k - 1) / max(len(sections) - 1, 1))
        told = f"pass {k}" if k in (1, len(sections)) else None
        axes.plot(factor * section[name], 1e3 * section["depth"], color=colour, label=told)
    _depth(axes, sections)
    axes.legend()


def _stresses(axes: Any, sections: Sequence[Mapping[str, Array]]) -> None:
    """Draw residual stresses along and across the way, after the first pass and the last."""
    shown = {1: sections[0], len(sections): sections[-1]}
    for name, colour, word in (("xx", style.PATCH[1], "x"), ("yy", style.PATCH[2], "y")):
        for (k, section), line in zip(shown.items(), ("--", "-")[2 - len(shown) :], strict=True):
            values, told = 1e-6 * section[f"stress_{name}"], f"σ{word}, pass {k}"
            axes.plot(values, 1e3 * section["depth"], line, color=colour, label=told)
    _depth(axes, sections)
    axes.legend()


def _depth(axes: Any, sections: Sequence[Mapping[str, Array]]) -> None:
    """Turn the axis of depth down, to a little below what has strained."""
    depth = sections[-1]["depth"]
    strained = depth[sections[-1]["equivalent_plastic_strain"] > NOTHING]
    axes.set_ylim(1e3 * min(1.6 * strained.max(initial=0.0) or depth.max(), depth.max()), 0)
    axes.set_ylabel("depth [mm]")


def _added(axes: Any, rows: Sequence[Mapping[str, Any]]) -> None:
    """Draw what each pass has added, on a scale of powers of ten."""
    number = [row["pass"] for row in rows]
    first = abs(rows[0]["plastic_work"]) or 1.0
    curves = {
        "plastic strain": ([row["added_plastic_strain"] for row in rows], style.PATCH[1], "o"),
        "plastic shear": ([row["added_section_shear"] for row in rows], style.PATCH[2], "s"),
        "work, over the first": ([row["plastic_work"] / first for row in rows], style.FAINT, "^"),
    }
    for name, (values, colour, mark) in curves.items():
        sizes = np.maximum(np.abs(values), NOTHING)
        axes.semilogy(number, sizes, mark, ls="-", ms=4, color=colour, label=name)
    axes.set_xticks(number)
    axes.set_xlabel("pass")
    axes.set_ylabel("added [-]")
    axes.legend()
