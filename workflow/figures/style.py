# SPDX-License-Identifier: LGPL-3.0-or-later
"""Style of all figures: fonts, sizes, one colour or colour map per quantity, unit prefixes."""

import io
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from meshes.tags import Tag
from workflow.results import atomic

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


DPI = 200
DEGREES = float(np.degrees(1.0))  # in a radian
COLUMN, PAGE = 3.5, 7.2  # widths of a journal column and page [inch]

RC = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 8,
    "axes.titlesize": 8,
    "axes.titlelocation": "left",
    "axes.labelsize": 8,
    "axes.linewidth": 0.7,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": "#e4e4e4",
    "grid.linewidth": 0.5,
    "legend.fontsize": 7,
    "legend.frameon": False,
    "lines.linewidth": 1.3,
    "lines.solid_joinstyle": "miter",
    "lines.solid_capstyle": "butt",
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "xtick.direction": "in",
    "ytick.direction": "in",
    "savefig.dpi": DPI,
}

INK = "#222222"
FAINT = "#9a9a9a"
CLOSED_FORM = "#b0b0b0"
CLOSED_FORMS = ("#a9d0e2", "#f7d09b")  # behind the colours of PATCH
ONE_POINT, TWO_POINT = "#1f5fbf", "#d1242f"
PATCH = {1: "#0b6e99", 2: "#e07b00"}
PATCH_NAME = {1: "patch 1, rail top", 2: "patch 2, gauge corner"}
ADHESION, SLIP = "#1b7f79", "#f2a93b"
WHEEL, RAIL = "#a9c1d9", "#d9cdb8"

REGION = {
    Tag.TYRE: "#5b8db8",
    Tag.WEB: "#8fb4d1",
    Tag.HUB: "#b9d3e4",
    Tag.AXLE: "#8c8c8c",
    Tag.RAIL_HEAD: "#c9843d",
    Tag.RAIL_WEB: "#dfb07a",
    Tag.RAIL_FOOT: "#eed5b2",
    Tag.SLEEPER: "#b8b5ad",
    Tag.BAR: "#5b8db8",
    Tag.BLOCK: "#5b8db8",
    Tag.SPHERE: "#5b8db8",
    Tag.ROLLER: "#5b8db8",
    Tag.BASE: "#dfb07a",
}
# of a mesh file, in turn
OTHER_REGIONS = ("#5b8db8", "#dfb07a", "#8fb4d1", "#c9843d", "#b9d3e4", "#eed5b2", "#8c8c8c")

ENERGY = {
    "kinetic": "#0072b2",
    "internal": "#d55e00",
    "hourglass": "#cc79a7",
    "contact": "#009e73",
    "spring": "#7a5195",
    "friction_dissipation": "#c8102e",
    "hardening": "#f0a202",
    "plastic_dissipation": "#3b6e3b",
    "damping": "#8c6d31",
    "external_work": "#56b4e9",
}

COLOUR_MAP = {
    "pressure": "magma_r",
    "shear stress": "viridis_r",
    "slip velocity": "cividis",
    "plastic strain": "YlOrRd",
    "von Mises stress": "magma_r",
    "displacement": "viridis",
    "velocity": "plasma",
}


def style() -> AbstractContextManager[None]:
    """Return a context in which matplotlib draws in this theme."""
    import matplotlib as mpl

    return mpl.rc_context(RC)  # type: ignore[arg-type]


def figure(width: float, height: float) -> "Figure":
    """Return an empty figure of a size in inches that fits its contents in."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def save(fig: "Figure", path: Path) -> Path:
    """Write a figure in the format that its name ends in, whole or not at all; return its path."""
    path.parent.mkdir(parents=True, exist_ok=True)
    drawn = io.BytesIO()
    fig.savefig(drawn, format=path.suffix[1:] or None, dpi=DPI, facecolor="white")
    atomic.replace(path, drawn.getvalue())
    return path


def letter(axes: "Axes", mark: str, text: str) -> None:
    """Title a panel as in a paper: (a) what it shows."""
    axes.set_title(f"({mark}) {text}")


def region(tag: int) -> str:
    """Return the colour of a region."""
    return {int(t): colour for t, colour in REGION.items()}.get(
        tag, OTHER_REGIONS[tag % len(OTHER_REGIONS)]
    )


def prefixed(values: npt.ArrayLike, unit: str) -> tuple[float, str]:
    """Return factor and unit in which the largest value reads as 1 to 1000.

    Args:
        values: Values in the SI unit.
        unit: The SI unit, e.g. ``"N"``.
    """
    numbers = np.abs(np.asarray(values, dtype=np.float64))
    size = float(np.max(numbers[np.isfinite(numbers)], initial=0.0))
    prefixes = {-9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}
    power = 0 if size == 0 else int(np.clip(3 * np.floor(np.log10(size * 1.001) / 3), -9, 9))
    return 10.0**-power, prefixes[power] + unit
