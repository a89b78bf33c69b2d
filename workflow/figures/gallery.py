# SPDX-License-Identifier: LGPL-3.0-or-later
"""Figures of a run, drawn from its result folder alone; what the run does not have is not drawn.

Each function of ``FIGURES`` draws one figure of a record and returns it, or None if there is
nothing to draw. Its name is that of the file, its docstring is the caption. matplotlib and pyvista
are imported when a figure is made, so that the command line starts without them; so is the
geometry of a model, which only a wheel on a rail needs.
"""

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from workflow.figures import style
from workflow.figures.animation import transition
from workflow.figures.footprint import footprints
from workflow.figures.history import energy, history, patch_forces, patch_means
from workflow.figures.mesh import model
from workflow.figures.passes import passes
from workflow.figures.placement import placement
from workflow.figures.plastic import plastic_strain
from workflow.figures.pressure import at_rest, half_spaces, pressure
from workflow.figures.receptance import receptance
from workflow.figures.section import contact_nodes, cross_section
from workflow.figures.shakedown import shakedown_map
from workflow.figures.shear import adhesion, centre_line, shear_vectors
from workflow.figures.spectra import modal_participation, sampled_forces, sampled_spectra
from workflow.model.residual import last_pass
from workflow.results.record import Record, whole

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FIGURES: tuple[Callable[[Record], "Figure | None"], ...] = (
    model,
    placement,
    footprints,
    cross_section,
    contact_nodes,
    at_rest,
    half_spaces,
    patch_forces,
    patch_means,
    adhesion,
    centre_line,
    shear_vectors,
    energy,
    history,
    pressure,
    plastic_strain,
    shakedown_map,
    sampled_forces,
    sampled_spectra,
    receptance,
    modal_participation,
)


def caption(name: str) -> str:
    """Return the caption of a figure by the name of its file: the docstring of its function."""
    every: tuple[Callable[..., Any], ...] = (*FIGURES, transition, passes)
    figure = next(figure for figure in every if figure.__name__ == name)
    return " ".join((inspect.getdoc(figure) or "").split())


def draw(folder: str | Path, modes: Path | None = None) -> list[Path]:
    """Draw all figures of a result folder into its ``figures/`` and return their paths.

    Of several passes it is the figure of all, and those of the last into the folder of that.

    Args:
        folder: Result folder of a run.
        modes: Folder of natural modes that its spectra are drawn with; one beside it if None.

    Raises:
        SceneError: if the folder holds no run, or what it holds cannot be read.
    """
    record, paths = whole(last_pass(Path(folder)), modes), []
    with style.style():
        if record.folder != Path(folder) and (fig := passes(Path(folder))) is not None:
            paths.append(style.save(fig, Path(folder) / "figures" / "passes.png"))
        for figure in FIGURES:
            fig = figure(record)
            if fig is not None:
                path = record.folder / "figures" / f"{figure.__name__}.png"
                paths.append(style.save(fig, path))
        animated = transition(record)
    return paths if animated is None else [*paths, animated]
