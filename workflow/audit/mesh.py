# SPDX-License-Identifier: LGPL-3.0-or-later
"""Mesh report: sizes, shapes, masses, and the cells that set the stable time step."""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from forms.time_step import cell_frequencies
from meshes.arrays import Array
from meshes.hexmesh import HexMesh, boundary
from meshes.quads import enclosed_volume
from meshes.quality import cell_volumes, edge_lengths, scaled_jacobians
from workflow.model.bodies import Bodies
from workflow.model.geometry import domain_of
from workflow.model.step import step_bound
from workflow.model.track import connections
from workflow.results.table import Column, Table
from workflow.scene.scene import Scene

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
    """Return place, step and shape of one cell."""
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


def printout(found: MeshReport) -> Iterator[str | Table]:
    """Yield what a terminal shows: bodies, sizes and shapes, and the cells that set the step."""
    s = summary(found)
    yield from found.told
    yield Table("", BODIES, [{"name": n} | body for n, body in s["bodies"].items()])
    yield _histograms(found)
    step, shape = s["step"], s["scaled_jacobian"]["share_below"]
    yield (
        f"scaled Jacobian from {s['scaled_jacobian']['smallest']:.2f}; below 0.35: "
        f"{shape['0.35']:.2%}, below 0.5: {shape['0.5']:.2%} of the cells\n"
        f"volume {s['volume']:.6e} m³, within the surface {s['volume_within_surface']:.6e} m³\n"
        f"step of the stiffest cell {step['cell'] * 1e9:.1f} ns; stable step "
        f"{step['bound'] * 1e9:.1f} ns, of which the run takes {found.scene.time.safety:.2g}; "
        f"{step['cells_within_10_percent']} cells are within 10 % of the stiffest\n"
        f"made in {s['seconds']:.1f} s"
    )
    yield Table("", CELLS, s["stiffest_cells"])


BODIES = (
    Column("body", "name", words=True),
    Column("cells", "cells"),
    Column("mass", "mass", ".4g", "kg"),
)
CELLS = (
    Column("cell", "cell"),
    Column("region", "region", words=True),
    Column("x, y, z", lambda c: ", ".join(f"{x:.4f}" for x in c["centre"]), unit="m"),
    Column("step", "step", ".1f", "ns", 1e9),
    Column("edges", lambda c: " to ".join(f"{e * 1e3:.2f}" for e in c["edges"]), unit="mm"),
    Column("scaled Jacobian", "scaled_jacobian", ".2f"),
)


def _histograms(found: MeshReport, bins: int = 10) -> Table:
    """Return how many edges and cells there are of each size and of each step."""
    (edges, at), (cells, step) = (
        np.histogram(values, np.geomspace(values.min(), values.max() * (1 + 1e-9), bins + 1))
        for values in (found.edges, found.steps)
    )
    columns = (
        Column("edges", lambda i: f"{at[i] * 1e3:.3g} to {at[i + 1] * 1e3:.3g}", unit="mm"),
        Column("edges", lambda i: int(edges[i])),
        Column(
            "step of a cell", lambda i: f"{step[i] * 1e9:.4g} to {step[i + 1] * 1e9:.4g}", unit="ns"
        ),
        Column("cells", lambda i: int(cells[i])),
    )
    return Table("", columns, range(bins))
