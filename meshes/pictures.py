# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pictures of a mesh, drawn off screen."""

from pathlib import Path
from typing import Any

import numpy as np

from meshes.hexmesh import HexMesh


def draw(
    mesh: HexMesh,
    path: str | Path,
    *,
    focus: tuple[float, float, float] | None = None,
    reach: float = 0.1,
    seen_from: tuple[float, float, float] = (1.0, -1.5, 1.0),
    section: float | None = None,
) -> None:
    """Draw the cells of a mesh, coloured by region, in parallel projection.

    Args:
        mesh: The mesh.
        path: PNG file to write.
        focus: Point in the middle of the picture, shape ``(3,)`` [m]; the whole mesh by default.
        reach: Half the height of the picture about the focus [m].
        seen_from: Direction towards the viewer, shape ``(3,)``.
        section: If given, only cells whose centre lies at a smaller x are drawn [m].
    """
    import pyvista

    cells = mesh.cells
    regions = mesh.regions
    if section is not None:
        kept = mesh.points[cells].mean(axis=1)[:, 0] < section
        cells, regions = cells[kept], regions[kept]
    grid = pyvista.UnstructuredGrid({pyvista.CellType.HEXAHEDRON: cells}, mesh.points)
    grid.cell_data["region"] = regions
    plotter: Any = pyvista.Plotter(off_screen=True, window_size=[1400, 1000])
    plotter.set_background("white")
    plotter.add_mesh(grid, scalars="region", cmap="Pastel1", show_edges=True, show_scalar_bar=False)
    target = np.array(grid.center if focus is None else focus)
    up = (0.0, 0.0, 1.0) if abs(seen_from[2]) < 10 * max(np.abs(seen_from[:2])) else (1.0, 0.0, 0.0)
    plotter.camera_position = [target + 5 * np.array(seen_from), target, up]
    plotter.enable_parallel_projection()
    if focus is None:
        plotter.reset_camera()
    else:
        plotter.camera.parallel_scale = reach
    plotter.screenshot(path)
    plotter.close()
