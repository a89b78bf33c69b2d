# SPDX-License-Identifier: LGPL-3.0-or-later
"""Figures of a run, drawn from its result folder alone; what the run does not have is not drawn.

Each public function draws one figure of a record and returns it, or None if there is nothing to
draw. matplotlib and pyvista are imported only here and below, when a figure is made.
"""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from workflow import theme
from workflow.figures_curves import energy, history, patch_forces, patch_means
from workflow.figures_footprint import footprints
from workflow.figures_model import model
from workflow.figures_nodes import contact_nodes
from workflow.figures_placement import placement
from workflow.figures_pressure import pressure
from workflow.figures_section import cross_section
from workflow.figures_shear import adhesion, centre_line, shear_vectors
from workflow.recorded import Record

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = [
    "adhesion",
    "centre_line",
    "contact_nodes",
    "cross_section",
    "draw",
    "energy",
    "footprints",
    "history",
    "model",
    "patch_forces",
    "patch_means",
    "placement",
    "pressure",
    "shear_vectors",
]

FIGURES: tuple[Callable[[Record], "Figure | None"], ...] = (
    model,
    placement,
    footprints,
    cross_section,
    contact_nodes,
    patch_forces,
    patch_means,
    adhesion,
    centre_line,
    shear_vectors,
    energy,
    history,
    pressure,
)


def draw(folder: str | Path) -> list[Path]:
    """Draw all figures of a result folder into its ``figures/`` and return their paths."""
    record, paths = Record(folder), []
    with theme.style():
        for figure in FIGURES:
            fig = figure(record)
            if fig is not None:
                path = record.folder / "figures" / f"{figure.__name__}.png"
                paths.append(theme.save(fig, path))
    return paths
