# SPDX-License-Identifier: LGPL-3.0-or-later
"""Three-dimensional pictures for the panels of a figure: pyvista draws, matplotlib letters."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from meshes.arrays import Array
from workflow.figures import style
from workflow.results.record import Body

if TYPE_CHECKING:
    from matplotlib.axes import Axes

EDGE = "#22303a"


@dataclass(frozen=True)
class Frame:
    """Parallel projection onto a rectangle; lengths in the picture are true in its plane.

    Attributes:
        right, up, toward: Axes of the picture, the last one points to the eye, shape ``(3,)``.
        middle: Point in the middle of the picture, shape ``(3,)`` [m].
        width, height: Size of the picture [m].
    """

    right: Array
    up: Array
    toward: Array
    middle: Array
    width: float
    height: float

    @staticmethod
    def around(points: Array, direction: tuple[float, float, float], pad: float = 0.01) -> "Frame":
        """Return the frame that just holds ``points``, shape ``(n, 3)`` [m].

        Args:
            points: What to show.
            direction: From where it is seen.
            pad: Margin as part of the larger side.
        """
        toward = np.array(direction) / np.linalg.norm(direction)
        right = np.cross([0.0, 0.0, 1.0], toward)
        right /= np.linalg.norm(right)
        up = np.cross(toward, right)
        seen = points @ np.column_stack([right, up, toward])
        low, high = seen.min(axis=0), seen.max(axis=0)
        middle = np.column_stack([right, up, toward]) @ ((low + high) / 2)
        width, height, _ = high - low
        margin = 2 * pad * max(width, height)
        return Frame(right, up, toward, middle, float(width + margin), float(height + margin))

    def flat(self, points: Array) -> Array:
        """Return where points lie in the picture, middle at 0, shape ``(n, 2)`` [m]."""
        return np.asarray((points - self.middle) @ np.column_stack([self.right, self.up]))

    def render(self, width: int, fill: Callable[[Any], None]) -> npt.NDArray[np.uint8]:
        """Return the picture, ``width`` pixels wide, of what ``fill`` adds to a plotter."""
        view = plotter((width, round(width * self.height / self.width)))
        fill(view)
        view.camera.focal_point = self.middle
        view.camera.position = self.middle + 20 * (self.width + self.height) * self.toward
        view.camera.up = self.up
        view.camera.parallel_scale = self.height / 2
        view.reset_camera_clipping_range()
        image = np.asarray(view.screenshot(None, return_img=True))
        view.close()
        return image

    def show(self, axes: "Axes", image: npt.NDArray[np.uint8]) -> None:
        """Put a picture into a panel without axes; data coordinates are those of ``flat``."""
        w, h = self.width / 2, self.height / 2
        axes.imshow(image, extent=(-w, w, -h, h), interpolation="antialiased")
        axes.set_axis_off()


def plotter(pixels: tuple[int, int], *, off_screen: bool = True) -> Any:
    """Return a pyvista plotter with white ground and parallel projection."""
    import pyvista
    from vtkmodules.vtkCommonCore import vtkLogger

    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_ERROR)  # VTK looks for a screen aloud
    view: Any = pyvista.Plotter(
        off_screen=off_screen, window_size=list(pixels), lighting="light kit"
    )
    view.set_background("white")
    view.enable_parallel_projection()
    view.enable_anti_aliasing("msaa")  # ssaa takes three times as long in software
    return view


def volume(cells: npt.NDArray[np.int64], points: Array) -> Any:
    """Return hexahedra ``(c, 8)`` as pyvista grid without the nodes that they do not use."""
    import pyvista

    nodes, local = np.unique(cells, return_inverse=True)
    return pyvista.UnstructuredGrid(
        {pyvista.CellType.HEXAHEDRON: local.reshape(-1, 8)}, points[nodes]
    )


def surface(body: Body) -> Any:
    """Return the outer surface as pyvista mesh with cell data ``region``."""
    return _with_regions(body).extract_surface(algorithm="dataset_surface")


def halved(body: Body, *planes: tuple[Array, Array]) -> Any:
    """Return the surface of what lies behind planes, each cut closed by the sections of its cells.

    Args:
        body: Mesh.
        planes: Point and normal of each, the normal away from what is kept; they must not meet
            inside the mesh.
    """
    grid = _with_regions(body)
    half = surface(body)
    for origin, normal in planes:
        half = half.clip(normal=normal, origin=origin)
    for origin, normal in planes:
        face = grid.slice(normal=normal, origin=origin, generate_triangles=False)
        half = half.append_polydata(face)
    return half


def _with_regions(body: Body) -> Any:
    grid = volume(body.cells, body.points)
    grid.cell_data["region"] = body.regions
    return grid


def add_regions(view: Any, mesh: Any, *, edges: bool = True) -> None:
    """Add a surface to a plotter, each region in its colour."""
    for region in np.unique(mesh["region"]):
        view.add_mesh(
            mesh.extract_cells(mesh["region"] == region),
            color=style.region(int(region)),
            show_edges=edges,
            edge_color=EDGE,
            edge_opacity=0.8,
            line_width=1.4,
            ambient=0.22,
            specular=0.0,
        )


def mesh_picture(
    body: Body, direction: tuple[float, float, float], width: int, *, edges: bool = True
) -> tuple[Frame, npt.NDArray[np.uint8]]:
    """Return frame and picture of a mesh coloured by region.

    Args:
        body: Mesh.
        direction: From where it is seen.
        width: Width of the picture in pixels.
        edges: Draw the edges of the cells.
    """
    mesh = surface(body)
    frame = Frame.around(np.asarray(mesh.points), direction)
    return frame, frame.render(width, lambda view: add_regions(view, mesh, edges=edges))
