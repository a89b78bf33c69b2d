# SPDX-License-Identifier: LGPL-3.0-or-later
"""View of a run: its mesh as it moves, with the footprints, in a window or as pictures.

A body that turns is drawn where it is; what a scale makes larger is its deformation alone.
"""

import os
import sys
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from meshes.arrays import Array, Index
from meshes.rotation import nearest_rotation
from workflow.figures import style
from workflow.figures.view3d import EDGE, plotter, volume
from workflow.results.footprints import Facets, read
from workflow.results.record import Body, Record
from workflow.scene.scene import SceneError

LIFT = 2e-3  # of the size of a footprint, that it is drawn over its body
FROM = (0.75, -1.0, 0.5)  # where the eye is
ABOVE = (0.35, -0.6, 1.0)
PIXELS = (1600, 1000)
GLASS = 0.06  # opacity of a body that is looked through
QUANTITIES = {"displacement": "m", "velocity": "m/s"}


@dataclass(frozen=True)
class View:
    """What is shown of a run.

    Attributes:
        record: The run, with fields.
        quantity: ``displacement`` or ``velocity``, whose size colours the bodies.
        scale: Factor on deformations [-].
        close: Look at the contact through the bodies that touch the others.
    """

    record: Record
    quantity: str
    scale: float
    close: bool

    @cached_property
    def body(self) -> Body:
        """The mesh."""
        body = self.record.body
        if body is None:
            raise SceneError(
                f"folder = {str(self.record.folder)!r}: expected fields.vtkhdf to view, as it is "
                "unless output.fields = false; found none"
            )
        return body

    @cached_property
    def times(self) -> list[float]:
        """Time of each output that has fields [s]."""
        return [t for t, _ in self.record.series("displacement")]

    @cached_property
    def feet(self) -> list[list[Facets]]:
        """Contact of each output; nothing where the run has none, or no facets of it."""
        try:
            return list(read(self.record.folder))
        except SceneError:
            return []

    @cached_property
    def cells(self) -> dict[str, Index]:
        """Cells of each body by its name."""
        body, found = self.body, {}
        numbers = {name: tag for tag, name in body.names.items()}
        for name, table in self.record.scene["bodies"].items():
            tags = [numbers[region] for region in table["regions"] if region in numbers]
            found[name] = body.cells[np.isin(body.regions, tags)]
        return found

    @cached_property
    def parts(self) -> dict[str, Index]:
        """Nodes of each body by its name."""
        return {name: np.unique(cells) for name, cells in self.cells.items()}

    @cached_property
    def largest(self) -> float:
        """Largest pressure of all outputs [Pa]."""
        every = (f.nodal["pressure"] for found in self.feet for f in found)
        return max((float(p.max()) for p in every if len(p)), default=1.0)

    @cached_property
    def surfaces(self) -> dict[str, tuple[Any, Index]]:
        """Surface of each body and the mesh nodes of its points."""
        body, found = self.body, {}
        for name, cells in self.cells.items():
            skin = volume(cells, body.points).extract_surface(algorithm="dataset_surface")
            found[name] = skin, np.unique(cells)[skin["vtkOriginalPointIds"]]
        return found

    def at(self, k: int) -> tuple[Array, Array]:
        """Return where the nodes are drawn at output ``k``, ``(n, 3)`` [m], and their values."""
        t, X = self.times[k], self.body.points
        u = self.record.displacement(t)
        values = u if self.quantity == "displacement" else self.record.velocity(t)
        x = X + u
        if self.scale != 1:
            for nodes in self.parts.values():
                rigid = carried(X[nodes], x[nodes])
                x[nodes] = rigid + self.scale * (x[nodes] - rigid)
        return x, np.linalg.norm(values, axis=1)

    def feet_at(self, k: int, x: Array) -> list[tuple[Facets, Array]]:
        """Return the contact at output ``k`` and where its nodes are drawn, over their bodies."""
        near = [f for f in self._nearest(self.times[k]) if len(f.facets)]
        if self.close:  # of the two on each other, that on the body that is seen
            near = [f for f in near if f.side == "target"] or near
        return [(f, x[f.node] + _lift(f)) for f in near]

    def _nearest(self, t: float) -> list[Facets]:
        return min(self.feet, key=lambda found: abs(found[0].t - t), default=[])

    @cached_property
    def glass(self) -> list[str]:
        """Bodies that are looked through: those of the contactors, if the view is close."""
        first = {int(f.node[0]) for found in self.feet for f in found if _is_upper(f)}
        inside = {name for name, nodes in self.parts.items() if first & set(nodes.tolist())}
        return sorted(inside) if self.close else []


def _is_upper(foot: Facets) -> bool:
    return foot.side == "contactor" and len(foot.node) > 0


def _lift(foot: Facets) -> Array:
    """Return by how much a footprint is drawn over its body, against its forces, (n, 3) [m]."""
    size = float(np.ptp(foot.position, axis=0).max())
    return np.asarray(-LIFT * size * foot.nodal["normal"])


def carried(X: Array, x: Array) -> Array:
    """Return points ``X`` moved by the rigid motion that is nearest to ``x``, ``(n, 3)`` [m]."""
    return np.asarray((X - X.mean(axis=0)) @ nearest_rotation(X, x).T + x.mean(axis=0))


def open_window(view: View) -> None:
    """Show a run in a window with a slider over its outputs, until it is closed.

    Raises:
        SceneError: if there is no display.
    """
    if sys.platform == "linux" and not (os.getenv("DISPLAY") or os.getenv("WAYLAND_DISPLAY")):
        raise SceneError(
            "view: expected a display to open a window on; found none: --pictures DIR draws files"
        )
    window = drawn(view, 0, off_screen=False)
    window.add_slider_widget(
        lambda value: fill(window, view, round(value)),
        (0, len(view.times) - 1),
        title="output",
        fmt="%.0f",
    )
    window.show()


def write_pictures(view: View, folder: Path) -> list[Path]:
    """Draw a picture for each output into a folder and return their paths.

    Raises:
        SceneError: if they cannot be written.
    """
    paths = []
    window = drawn(view, 0, off_screen=True)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for k in range(len(view.times)):
            fill(window, view, k)
            paths.append(folder / f"view-{k:04d}.png")
            window.screenshot(str(paths[-1]))
    except OSError as error:
        why = error.strerror or str(error)
        raise SceneError(
            f"--pictures {str(folder)!r}: expected a folder that can be written: {why}"
        ) from None
    finally:
        window.close()
    return paths


def drawn(view: View, k: int, *, off_screen: bool) -> Any:
    """Return a plotter with an output drawn and the camera set."""
    window = plotter(PIXELS, off_screen=off_screen)
    window.add_axes()
    fill(window, view, k)
    if view.close and (feet := view.feet_at(k, view.at(k)[0]) or _first(view)):
        points = np.concatenate([x for _, x in feet])
        window.camera.focal_point = points.mean(axis=0)
        window.camera.position = points.mean(axis=0) + np.array(ABOVE)
        window.camera.up = (0.0, 0.0, 1.0)
        window.camera.parallel_scale = 1.2 * float(np.ptp(points, axis=0).max())
    else:
        window.view_vector(FROM, viewup=(0.0, 0.0, 1.0))
        window.camera.zoom(1.4)
    window.reset_camera_clipping_range()
    return window


def _first(view: View) -> list[tuple[Facets, Array]]:
    """Return the first contact that there is."""
    found = (view.feet_at(k, view.at(k)[0]) for k in range(len(view.times)))
    return next(filter(None, found), [])


def fill(window: Any, view: View, k: int) -> None:
    """Put output ``k`` in the place of what a plotter shows."""
    x, values = view.at(k)
    top = float(values.max()) or 1.0
    for name, (skin, nodes) in view.surfaces.items():
        skin.points, skin["size"] = x[nodes], values[nodes]
        window.add_mesh(
            skin,
            name=f"body {name}",
            scalars="size",
            clim=(0.0, top),
            cmap=style.COLOUR_MAP[view.quantity],
            show_edges=True,
            edge_color=EDGE,
            edge_opacity=0.4,
            opacity=GLASS if name in view.glass else 1.0,
            scalar_bar_args=bar(f"{view.quantity} [{QUANTITIES[view.quantity]}]", 0.8),
            reset_camera=False,
        )
    there = view.feet_at(k, x)
    shown = {f"foot {foot.pair} {foot.side}" for foot, _ in there}
    for name in {f"foot {f.pair} {f.side}" for found in view.feet for f in found} - shown:
        window.remove_actor(name, reset_camera=False)
    for foot, points in there:
        add_foot(window, view, foot, points)
    window.add_text(f"t = {view.times[k] * 1e3:.4g} ms", name="time", font_size=12)


def add_foot(window: Any, view: View, foot: Facets, points: Array) -> None:
    """Draw a footprint, coloured by pressure."""
    import pyvista

    corners = np.column_stack([np.full(len(foot.facets), 4), foot.facets])
    mesh = pyvista.PolyData(points, faces=corners.ravel())
    mesh["pressure"] = foot.nodal["pressure"] * 1e-6
    window.add_mesh(
        mesh,
        name=f"foot {foot.pair} {foot.side}",
        scalars="pressure",
        clim=(0.0, view.largest * 1e-6),
        cmap=style.COLOUR_MAP["pressure"],
        scalar_bar_args=bar("pressure [MPa]", 0.91),
        reset_camera=False,
    )


def bar(title: str, place: float) -> dict[str, Any]:
    """Return how the scale of a colour is drawn, upright, at a share of the width."""
    return {
        "title": title,
        "vertical": True,
        "position_x": place,
        "position_y": 0.2,
        "width": 0.04,
        "height": 0.6,
        "title_font_size": 16,
        "label_font_size": 14,
        "fmt": "%.3g",
        "color": "black",
        "fill": True,
        "background_color": "white",
    }
