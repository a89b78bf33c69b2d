# SPDX-License-Identifier: LGPL-3.0-or-later
"""Mesh quality as a file and a figure: cells by step and shape, and where the stiffest are."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from meshes.arrays import Array
from workflow.audit.mesh import MeshReport, summary
from workflow.figures import style
from workflow.figures.view3d import EDGE, Frame, volume
from workflow.scene import SceneError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

STIFF = style.TWO_POINT
NEAR = 6.0  # half width of the close-up, in edges of the stiffest cell's longest
LIMIT = 1.1  # cells within this factor of the smallest step are marked


def write(found: MeshReport, folder: Path) -> list[Path]:
    """Write ``mesh.json`` and ``mesh.png`` into a folder and return their paths."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "mesh.json").write_text(json.dumps(summary(found), indent=1), "utf-8")
    except OSError as error:
        raise SceneError(f"--out {folder}: expected a folder to write to: {error}") from None
    with style.style():
        return [folder / "mesh.json", style.save(mesh_quality(found), folder / "mesh.png")]


def mesh_quality(found: MeshReport) -> "Figure":
    """Return histograms of step and shape, the mesh with its stiffest cells, and a close-up."""
    fig = style.figure(style.PAGE, 6.6)
    panels = fig.subplot_mosaic("ab;cd", height_ratios=(1, 1.9))
    _steps(panels["a"], found)
    _shapes(panels["b"], found)
    stiff = found.steps < LIMIT * found.steps.min()
    cells, points = found.mesh.cells, found.mesh.points
    _picture(panels["c"], _around(found, stiff, 12), cells, points, stiff)
    style.letter(panels["c"], "c", "cells within 10 % of the stiffest, red")
    worst = points[cells[found.stiffest[0]]]
    size = np.ptp(worst, axis=0).max()
    box = worst.mean(axis=0) + NEAR * size * np.array([[-1.0, -1, -1], [1, 1, 1]])
    _picture(panels["d"], box, cells, points, stiff)
    style.letter(panels["d"], "d", f"round the stiffest cell, {2 * NEAR * size * 1e3:.3g} mm wide")
    return fig


def _steps(axes: "Axes", found: MeshReport) -> None:
    """Cells by their own step, with the steps that a run can take."""
    from matplotlib.ticker import NullFormatter, ScalarFormatter

    steps, bound = found.steps * 1e9, found.assembled * 1e9
    low, high = 0.9 * min(steps.min(), bound), 1.1 * max(steps.max(), bound)
    axes.hist(steps, np.geomspace(low, high, 60).tolist(), color=style.WHEEL)
    if high > 5 * low:
        axes.set_xscale("log")
        axes.set_xticks([t for t in (10, 20, 50, 100, 200, 500, 1e3, 2e3, 5e3) if low < t < high])
        axes.xaxis.set_major_formatter(ScalarFormatter())
        axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_yscale("log")
    axes.set_ylim(0.5, 30 * len(steps) / 10)
    axes.axvline(steps.min(), color=STIFF, lw=1.0, label=f"stiffest cell {steps.min():.1f} ns")
    axes.axvline(bound, color=style.INK, lw=1.0, ls="--", label=f"stable step {bound:.1f} ns")
    axes.legend(loc="upper right")
    axes.set_xlabel("critical step of a cell by itself [ns]")
    axes.set_ylabel("cells")
    style.letter(axes, "a", f"{len(steps)} cells")


def _shapes(axes: "Axes", found: MeshReport) -> None:
    """Cells by their scaled Jacobian."""
    worst = found.jacobians.min()
    axes.hist(found.jacobians, np.linspace(min(0.0, worst), 1.0, 51).tolist(), color=style.RAIL)
    axes.set_yscale("log")
    axes.set_ylim(bottom=0.5)
    axes.axvline(worst, color=STIFF, lw=1.0)
    axes.set_xlabel("scaled Jacobian")
    axes.set_ylabel("cells")
    style.letter(axes, "b", f"smallest {worst:.2f}")


def _around(found: MeshReport, stiff: npt.NDArray[np.bool_], reach: float) -> Array:
    """Return a box about the marked cells of the worst one's neighbourhood, shape ``(2, 3)``."""
    centres = found.mesh.points[found.mesh.cells].mean(axis=1)
    focus = centres[found.stiffest[0]]
    near = np.linalg.norm(centres - focus, axis=1) < 0.3
    x = found.mesh.points[found.mesh.cells[stiff & near]].reshape(-1, 3)
    low, high = x.min(axis=0), x.max(axis=0)
    half = max(np.ptp(x, axis=0).max() / 2, reach * found.edges.min()) * 1.15
    return np.asarray((low + high) / 2 + half * np.array([[-1.0, -1, -1], [1, 1, 1]]))


def _picture(
    axes: "Axes",
    box: Array,
    cells: npt.NDArray[np.int64],
    points: Array,
    stiff: npt.NDArray[np.bool_],
) -> None:
    """Show the cells in a box with their edges, cut open at the nearest marked cell."""
    centres = points[cells].mean(axis=1)
    middle, half = box.mean(axis=0), (box[1] - box[0]) / 2
    inside = (np.abs(centres - middle) < half).all(axis=1)
    front = centres[inside & stiff][:, 0] if (inside & stiff).any() else centres[inside][:, 0]
    cut = np.median(front)
    behind = inside & (centres[:, 0] <= cut + 1e-9)
    corners = middle + half * np.array([[0, -1, -1], [0, 1, 1]])
    frame = Frame.around(corners, (1.0, -0.25, 0.2))

    def fill(view: Any) -> None:
        for mark, colour in ((False, "#dfe5ea"), (True, STIFF)):
            part = behind & (stiff == mark)
            if part.any():
                view.add_mesh(
                    volume(cells[part], points),
                    color=colour,
                    show_edges=True,
                    edge_color=EDGE,
                    line_width=1.3,
                    ambient=0.25,
                    specular=0.0,
                )

    frame.show(axes, frame.render(1500, fill))
