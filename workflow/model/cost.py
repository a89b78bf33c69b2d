# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cost of a run before its mesh is made: cells, steps, outputs, memory, disk and time.

Cells of boxes, caps and rollers are counted, those of a wheel on a rail within 10 % by refining
short zones, those of a file in the file. The step is that of the shortest edge and the fastest
wave, within a third; memory and disk are good to a factor of 2, time to one of 3.
"""

import os
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from meshes.hexmesh import HexMesh
from meshes.quality import edge_lengths
from meshes.spacing import graded_cells
from workflow.model import geometry
from workflow.scene.bodies import MEMORY, Body, Orthotropic
from workflow.scene.mesh import (
    BarMesh,
    BlocksMesh,
    CapMesh,
    CurvedMesh,
    Foreign,
    HollowSphereMesh,
    RailMesh,
    WheelRailMesh,
)
from workflow.scene.scene import Scene, SceneError

WITHIN = 0.1  # of the cells of a wheel on a rail
EDGE = 0.95  # step of a cell over edge per wave speed, in uniform meshes of hexahedra
NARROW = 0.5  # shortest edge over wanted size on wheel and rail
SHORTEST, PART = 2e-3, 0.3  # shortest edge of a rail without wheel: at most, m; over wanted size
BASE, PER_CELL, AT_REST = 160e6, 1.9e3, 25e3  # bytes; of them the last in the static solve
STARTS, MESHED, REST = 2.0, 1.5e-4, 5e-4  # s; s per cell that is generated, brought to rest
STEP, UPDATE, OUTPUT = 1e-4, 1.5e-7, 5e-3  # s per step, per cell and step, per output
FIRST, HISTORY, RECORD = 5e5, 2e3, 1e4  # bytes of results: at once, per output, and contact


@dataclass(frozen=True)
class Cost:
    """What a run takes.

    Attributes:
        cells, nodes: Of the mesh.
        cells_within: Relative error of both; 0 if they are counted.
        edge: Shortest edge [m].
        step: Time step [s].
        steps, outputs, samples: How many there are.
        memory, disk: At most, on one rank [bytes].
        seconds: On one core [s].
    """

    cells: int
    nodes: int
    cells_within: float
    edge: float
    step: float
    steps: float
    outputs: int
    samples: int
    memory: float
    disk: float
    seconds: float

    def table(self) -> dict[str, Any]:
        """Return it as a table for JSON."""
        return asdict(self)

    def __str__(self) -> str:
        """Return it in words."""
        about = "" if self.cells_within == 0 else "about "
        samples = f", {self.samples} samples" if self.samples else ""
        return (
            f"{about}{self.cells} cells, about {self.steps:.3g} steps of "
            f"{self.step * 1e9:.3g} ns, {self.outputs} outputs{samples}; about "
            f"{size_in_words(self.memory)} of memory, {size_in_words(self.disk)} on disk, "
            f"{time_in_words(self.seconds)} on one core"
        )


@dataclass(frozen=True)
class Extent:
    """Size of a mesh.

    Attributes:
        cells, nodes: How many there are.
        edge: Shortest edge [m].
        within: Relative error of the numbers.
    """

    cells: int
    nodes: int
    edge: float
    within: float = 0.0


def size_in_words(count: float) -> str:
    """Return a number of bytes in words."""
    for unit, size in (("TB", 1e12), ("GB", 1e9)):
        if count >= size:
            return f"{count / size:.3g} {unit}"
    return f"{count / 1e6:.2g} MB" if count < 1e8 else f"{count / 1e6:.0f} MB"


def time_in_words(seconds: float) -> str:
    """Return a time in words."""
    for unit, size in (("days", 2 * 86400.0), ("hours", 2 * 3600.0), ("minutes", 2 * 60.0)):
        if seconds >= size:
            return f"{seconds / size * 2:.3g} {unit}"
    return f"{seconds:.2g} s"


def host_memory() -> float:
    """Return the memory of this machine, or the part that its control group may have [bytes]."""
    found = float(os.sysconf("SC_PHYS_PAGES")) * os.sysconf("SC_PAGE_SIZE")
    limit = Path("/sys/fs/cgroup/memory.max")
    text = limit.read_text().strip() if limit.is_file() else "max"
    return min(found, float(text)) if text.isdigit() else found


def room_for(folder: Path) -> float:
    """Return the room for results in a folder, made or not: what is free, and what they replace.

    A run that goes on has a part of its results already.

    Args:
        folder: Result folder.

    Returns:
        Bytes; infinite where the disk does not tell.
    """
    there = next(p for p in (folder, *folder.absolute().parents) if p.exists())
    try:
        taken = sum(path.stat().st_size for path in folder.glob("*.*") if path.is_file())
        return float(shutil.disk_usage(there).free + taken)
    except OSError:
        return float("inf")


def cost_of(scene: Scene, mesh: HexMesh | None = None) -> Cost:
    """Return what a run of a scene takes.

    Args:
        scene: The scene.
        mesh: Its mesh if it is there already; one from a file is read if not.

    Raises:
        SceneError: if the mesh cannot be made.
    """
    extent = extent_of(scene, mesh)
    bound = bound_of(scene, extent.edge)
    time = scene.time
    per_output = max(1.0, float(np.ceil(time.output_interval / (time.safety * bound))))
    step = time.output_interval / per_output
    steps = time.end / step
    outputs = int(time.end / time.output_interval * (1 + 1e-9)) + 1
    interval = scene.output.sample_interval
    samples = 0 if interval is None else int(min(time.end / interval, steps))
    rest = scene.equilibrium is not None
    made = isinstance(scene.mesh, WheelRailMesh)
    seconds = STARTS + extent.cells * (MESHED * made + REST * rest) + outputs * OUTPUT
    seconds += steps * (STEP + UPDATE * extent.cells)
    runs = scene.passes.number if scene.passes else 1
    return Cost(
        cells=extent.cells,
        nodes=extent.nodes,
        cells_within=extent.within,
        edge=extent.edge,
        step=step,
        steps=steps,
        outputs=outputs,
        samples=samples,
        memory=BASE + extent.cells * (PER_CELL + AT_REST * rest),
        disk=runs * _disk(scene, extent.nodes, outputs, samples),
        seconds=runs * seconds,
    )


def _disk(scene: Scene, nodes: int, outputs: int, samples: int) -> float:
    """Return what results and fields take [bytes]; fields are two vectors of single precision.

    A checkpoint has a copy of the results. Where steel yields, there are plastic strain and von
    Mises' stress of each cell besides, and stresses if asked for; about as many cells as nodes.
    """
    yields = any(body.material.law in MEMORY for body in scene.bodies.values())
    fields = (
        nodes * (100.0 + (24.0 + yields * (8.0 + 48.0 * scene.output.stress)) * outputs)
        if scene.output.fields
        else 0.0
    )
    channels = 8 + 24 * len(scene.probes) + 48 * len(scene.contacts)
    results = FIRST + outputs * (HISTORY + RECORD * len(scene.contacts)) + float(samples) * channels
    kept = scene.output.checkpoint_minutes > 0 or scene.output.checkpoint_steps is not None
    return fields + results + (results + (900.0 if yields else 400.0) * nodes) * kept


def extent_of(scene: Scene, mesh: HexMesh | None = None) -> Extent:
    """Return the size of the mesh of a scene; arguments and errors as for :func:`cost_of`."""
    if mesh is None and isinstance(scene.mesh, Foreign):
        mesh = geometry.read_mesh(scene, lambda line: None)
    if mesh is not None:
        edge = float(edge_lengths(mesh.points, mesh.cells).min())
        return Extent(len(mesh.cells), len(mesh.points), edge)
    if isinstance(scene.mesh, WheelRailMesh):
        return _wheel_on_rail(scene, scene.mesh)
    if isinstance(scene.mesh, RailMesh):
        edge = min(SHORTEST, PART * scene.mesh.size)
        return Extent(*geometry.rail_alone_extent(scene.mesh), edge)
    if isinstance(scene.mesh, HollowSphereMesh):
        return _hollow_sphere(scene.mesh)
    try:
        boxes = list(_boxes(scene.mesh))
    except ValueError as error:
        raise SceneError(f"mesh.{error}") from None
    cells = sum(nx * ny * nz for (nx, ny, nz), _ in boxes)
    nodes = sum((nx + 1) * (ny + 1) * (nz + 1) for (nx, ny, nz), _ in boxes)
    return Extent(cells, nodes, min(edge for _, edge in boxes))


def _boxes(mesh: Any) -> Iterator[tuple[Sequence[int], float]]:
    """Yield cells along the axes and the shortest edge [m] of each body of a shape."""
    if isinstance(mesh, BarMesh):
        yield _box((mesh.length, mesh.width, mesh.width), mesh.size)
    elif isinstance(mesh, BlocksMesh):
        yield _box(mesh.block, mesh.size)
        yield _box(mesh.base, mesh.base_size)
    elif isinstance(mesh, CapMesh):
        yield from 2 * [_box(3 * (mesh.extent,), mesh.size, mesh.growth)]
    else:
        assert isinstance(mesh, CurvedMesh)
        for plan in geometry.footings(mesh):
            n = plan.cells()
            thin = (plan.y[1] - plan.y[0]) / n[1] if plan.layers else plan.size
            yield n, min(thin, first_edge(plan.depth, n[2], plan.growth), plan.size)


def _hollow_sphere(mesh: HollowSphereMesh) -> Extent:
    wall, n = mesh.outer_radius - mesh.inner_radius, mesh.across
    (layers,), edge = _box((wall,), mesh.size, mesh.growth)
    arc = np.pi / 4 * np.cos(np.pi / 4) * mesh.inner_radius / n  # where two patches meet
    nodes = (3 * (n + 1) ** 2 - 3 * (n + 1) + 1) * (layers + 1)
    return Extent(3 * n**2 * layers, nodes, min(edge, float(arc)))


def _box(
    lengths: Sequence[float], size: float, growth: float = 1.0
) -> tuple[tuple[int, ...], float]:
    n = tuple(graded_cells(length, size, growth) for length in lengths)
    return n, min(first_edge(s, k, growth) for s, k in zip(lengths, n, strict=True))


def first_edge(length: float, cells: int, growth: float) -> float:
    """Return the first edge of a graded line [m]."""
    return length / cells if growth == 1 else length * (growth - 1) / (growth**cells - 1)


def _wheel_on_rail(scene: Scene, mesh: WheelRailMesh) -> Extent:
    cells = geometry.wheel_on_rail_cells(scene, mesh)
    narrow = mesh.size if mesh.strip is None else min(mesh.size, mesh.strip.size)
    return Extent(cells, round(1.17 * cells), NARROW * narrow, WITHIN)


def bound_of(scene: Scene, edge: float) -> float:
    """Return the largest stable step for a shortest edge, about [s].

    Args:
        scene: The scene.
        edge: The shortest edge [m].
    """
    if scene.mass_scaling is not None:
        return scene.mass_scaling.step
    bodies = scene.bodies.values()
    omega = max(2 * wave_speed(body) / (EDGE * edge) for body in bodies)
    stiffness = max(body.stiffness_damping for body in bodies)
    mass = max(body.mass_damping for body in bodies)
    following = [c for c in scene.contacts.values() if c.method == "penalty"]
    room = 1 - sum(c.penalty / 4 + c.damping * c.penalty**0.5 for c in following)
    share = room**0.5 if room > 0 and scene.time.bound == "assembled" else 0.7
    xi = stiffness * omega / 2 + mass / (2 * omega)
    return share * 2 / (omega * (np.hypot(1.0, xi) + xi))


def wave_speed(body: Body) -> float:
    """Return the speed of pressure waves in a body, of an orthotropic one about [m/s]."""
    m = body.material
    if isinstance(m, Orthotropic):
        return float((1.35 * max(m.youngs_moduli) / m.density) ** 0.5)
    nu = m.poisson_ratio
    stiff = m.youngs_modulus * (1 - nu) / ((1 + nu) * (1 - 2 * nu))
    return float((stiff / m.density) ** 0.5)
