# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a mesh is worth to an explicit run: sizes, shapes, masses, and which cells set the step."""

import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from forms.time_step import cell_frequencies
from meshes.hexmesh import HexMesh, boundary
from meshes.quads import enclosed_volume
from meshes.quality import cell_volumes, edge_lengths, scaled_jacobians
from workflow.model.bodies import Bodies, step_bound
from workflow.model.geometry import domain_of
from workflow.model.track import connections
from workflow.scene.scene import Scene, SceneError

if TYPE_CHECKING:
    from rich.console import Console

Array = npt.NDArray[np.float64]

STIFFEST = 8  # cells that are listed
EDGES = np.array(
    [[0, 1], [1, 2], [2, 3], [3, 0], [4, 5], [5, 6], [6, 7], [7, 4], [0, 4], [1, 5], [2, 6], [3, 7]]
)


@dataclass(frozen=True)
class MeshReport:
    """A mesh, cell by cell.

    Attributes:
        scene: The scene.
        mesh: Its mesh.
        steps: Critical step of each cell by itself, shape ``(c,)`` [s].
        assembled: Critical step of the assembled system with springs and contact [s].
        jacobians: Smallest scaled Jacobian of each cell, shape ``(c,)``.
        bodies: Cells and mass [kg] of each body.
        volume, enclosed: Sum over the cells, and within the outer surface [m³].
        seconds: Time to make the mesh [s].
        told: What the mesher had to say.
    """

    scene: Scene
    mesh: HexMesh
    steps: Array
    assembled: float
    jacobians: Array
    bodies: dict[str, tuple[int, float]]
    volume: float
    enclosed: float
    seconds: float
    told: list[str]

    @property
    def edges(self) -> Array:
        """Lengths of all edges, shape ``(e,)`` [m]."""
        return edge_lengths(self.mesh.points, self.mesh.cells)

    @property
    def stiffest(self) -> npt.NDArray[np.int64]:
        """The cells with the smallest steps, the worst first."""
        return np.argsort(self.steps)[:STIFFEST]


def report(scene: Scene, log: Callable[[str], Any] = lambda line: None) -> MeshReport:
    """Return the report of a scene's mesh, made on this process alone.

    Args:
        scene: The scene.
        log: Called with a line at each stage.

    Raises:
        SceneError: if the mesh cannot be made.
    """
    told: list[str] = []
    begin = time.perf_counter()
    domain, _ = domain_of(scene, MPI.COMM_SELF, told.append)
    seconds, mesh = time.perf_counter() - begin, domain.source
    log(f"{len(mesh.cells)} cells in {seconds:.1f} s; now the step of each of them")
    bodies = Bodies(scene, domain)
    frequencies = np.empty(len(mesh.cells))
    own = cell_frequencies(domain.V, bodies.internal_work, bodies.mass)
    frequencies[domain.msh.topology.original_cell_index[: len(own)]] = own
    mass = bodies.lumped_mass()
    volume = cell_volumes(mesh.points, mesh.cells)
    counted = {}
    for name, body in scene.bodies.items():
        mine = np.isin(mesh.regions, bodies.tags(body))
        counted[name] = int(mine.sum()), float(body.material.density * volume[mine].sum())
    return MeshReport(
        scene=scene,
        mesh=mesh,
        steps=2 / frequencies,
        assembled=step_bound(bodies, mass, connections(scene, domain), log),
        jacobians=scaled_jacobians(mesh.points, mesh.cells),
        bodies=counted,
        volume=float(volume.sum()),
        enclosed=enclosed_volume(mesh.points, boundary(mesh.cells)),
        seconds=seconds,
        told=told,
    )


def summary(found: MeshReport) -> dict[str, Any]:
    """Return the report as plain numbers, all in SI."""
    edges, steps, shapes = found.edges, found.steps, found.jacobians
    return {
        "scene": found.scene.name,
        "cells": len(found.mesh.cells),
        "nodes": len(found.mesh.points),
        "bodies": {n: {"cells": c, "mass": m} for n, (c, m) in found.bodies.items()},
        "regions": found.mesh.counts(found.mesh.regions),
        "edges": {"shortest": float(edges.min()), "longest": float(edges.max())},
        "scaled_jacobian": {
            "smallest": float(shapes.min()),
            "share_below": {str(x): float((shapes < x).mean()) for x in (0.35, 0.5, 0.7)},
        },
        "volume": found.volume,
        "volume_within_surface": found.enclosed,
        "step": {
            "cell": float(steps.min()),
            "bound": found.assembled,
            "run": found.scene.time.safety * found.assembled,
            "cells_within_10_percent": int((steps < 1.1 * steps.min()).sum()),
        },
        "stiffest_cells": [_cell(found, int(c)) for c in found.stiffest],
        "seconds": found.seconds,
    }


def _cell(found: MeshReport, cell: int) -> dict[str, Any]:
    """Return what is to be known of one cell."""
    x = found.mesh.points[found.mesh.cells[cell]]
    length = np.linalg.norm(x[EDGES[:, 1]] - x[EDGES[:, 0]], axis=1)
    return {
        "cell": cell,
        "region": found.mesh.name(int(found.mesh.regions[cell])),
        "centre": x.mean(axis=0).tolist(),
        "step": float(found.steps[cell]),
        "edges": [float(length.min()), float(length.max())],
        "scaled_jacobian": float(found.jacobians[cell]),
    }


def write(found: MeshReport, folder: Path) -> list[Path]:
    """Write ``mesh.json`` and ``mesh.png`` into a folder and return their paths."""
    from workflow.audit.figures import mesh_quality
    from workflow.figures import style

    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "mesh.json").write_text(json.dumps(summary(found), indent=1), "utf-8")
    except OSError as error:
        raise SceneError(f"--out {folder}: expected a folder to write to: {error}") from None
    with style.style():
        return [folder / "mesh.json", style.save(mesh_quality(found), folder / "mesh.png")]


def show(found: MeshReport, console: "Console") -> None:
    """Print the report: bodies, sizes and shapes, and the cells that set the step."""
    from rich.table import Table

    s = summary(found)
    for line in found.told:
        console.print(line, highlight=False)
    parts = Table("body", "cells", "mass [kg]")
    for name, body in s["bodies"].items():
        parts.add_row(name, str(body["cells"]), f"{body['mass']:.4g}")
    console.print(parts)
    _print_histograms(found, console)
    step, shape = s["step"], s["scaled_jacobian"]["share_below"]
    console.print(
        f"scaled Jacobian from {s['scaled_jacobian']['smallest']:.2f}; below 0.35: "
        f"{shape['0.35']:.2%}, below 0.5: {shape['0.5']:.2%} of the cells\n"
        f"volume {s['volume']:.6e} m³, within the surface {s['volume_within_surface']:.6e} m³\n"
        f"step of the stiffest cell {step['cell'] * 1e9:.1f} ns; stable step "
        f"{step['bound'] * 1e9:.1f} ns, of which the run takes {found.scene.time.safety:.2g}; "
        f"{step['cells_within_10_percent']} cells are within 10 % of the stiffest\n"
        f"made in {s['seconds']:.1f} s",
        highlight=False,
    )
    worst = Table("cell", "region", "x, y, z [m]", "step [ns]", "edges [mm]", "scaled Jacobian")
    for c in s["stiffest_cells"]:
        worst.add_row(
            str(c["cell"]),
            c["region"],
            ", ".join(f"{x:.4f}" for x in c["centre"]),
            f"{c['step'] * 1e9:.1f}",
            " to ".join(f"{e * 1e3:.2f}" for e in c["edges"]),
            f"{c['scaled_jacobian']:.2f}",
        )
    console.print(worst)


def _print_histograms(found: MeshReport, console: "Console", bins: int = 10) -> None:
    """Print how many edges and cells there are of each size and of each step."""
    from rich.table import Table

    table = Table("edges [mm]", "edges", "step of a cell [ns]", "cells")
    (edges, at), (cells, step) = (
        np.histogram(values, np.geomspace(values.min(), values.max() * (1 + 1e-9), bins + 1))
        for values in (found.edges, found.steps)
    )
    for i in range(bins):
        table.add_row(
            f"{at[i] * 1e3:.3g} to {at[i + 1] * 1e3:.3g}",
            str(edges[i]),
            f"{step[i] * 1e9:.4g} to {step[i + 1] * 1e9:.4g}",
            str(cells[i]),
        )
    console.print(table)
