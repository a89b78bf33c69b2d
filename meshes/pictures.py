# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pictures of a placement and of a mesh, drawn off screen."""

from pathlib import Path
from typing import Any

import numpy as np

from meshes.hexmesh import HexMesh
from meshes.placement import RADIUS, Placement, outline, rail_in_track
from meshes.profiles import Profile, s1002


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


def draw_placement(
    path: str | Path,
    placement: Placement,
    wheel: Profile | None = None,
    rail: Profile | None = None,
    *,
    radius: float = RADIUS,
) -> None:
    """Draw the wheel's outline on the rail in the track position, with a window on each contact."""
    from matplotlib.figure import Figure

    wheel = s1002() if wheel is None else wheel
    rail = rail_in_track() if rail is None else rail
    trace = outline(wheel, np.arange(0, wheel.length, 1e-4), radius, placement.yaw)
    trace = (trace + placement.centre) * 1e3
    points = rail.points * 1e3
    figure = Figure(figsize=(15, 5), layout="constrained")
    centres = [None, placement.tread_point, placement.flange_point]
    for axes, centre in zip(figure.subplots(1, 3), centres, strict=True):
        axes.plot(*trace[:, 1:].T, label="wheel")
        axes.plot(*points.T, label="rail")
        for point in centres[1:]:
            axes.plot(*point[1:] * 1e3, "k+")  # type: ignore[index]
        axes.set(xlabel="y [mm]", ylabel="z [mm]", aspect="equal")
        if centre is not None:
            y, z = centre[1:] * 1e3
            axes.set(xlim=(y - 5, y + 5), ylim=(z - 5, z + 5))
    figure.axes[0].legend()
    figure.suptitle(
        f"shift {placement.shift * 1e3:.3f} mm, flange gap {placement.flange_gap * 1e3:.3f} mm, "
        f"flange angle {np.degrees(placement.flange_angle):.1f}°"
    )
    figure.savefig(path, dpi=100)
