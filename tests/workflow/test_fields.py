# SPDX-License-Identifier: LGPL-3.0-or-later
"""``fields.vtkhdf`` opens in VTK with the right mesh, times and values, also while it grows."""

from pathlib import Path

import numpy as np
import pytest

from meshes.hexmesh import HexMesh, join
from meshes.shapes import blocks, caps
from meshes.tags import Tag
from workflow.results.fields import FieldWriter

pv = pytest.importorskip("pyvista")
Pipeline = pytest.importorskip(
    "vtkmodules.vtkCommonExecutionModel"
).vtkStreamingDemandDrivenPipeline


@pytest.fixture
def mesh() -> HexMesh:
    box = blocks.block((0, 0, 0.1), (1, 1, 1), cells=(2, 3, 4))
    return join(box, caps.base(1.0, size=0.5))


def fields(mesh: HexMesh, t: float) -> tuple[np.ndarray, np.ndarray]:
    """Displacement t·x and velocity x at every node."""
    return t * mesh.points, mesh.points


def write(path: Path, mesh: HexMesh, times) -> FieldWriter:
    writer = FieldWriter(path, mesh)
    for t in times:
        writer.append(t, *fields(mesh, t))
    return writer


def times_of(reader) -> list[float]:
    """Time steps that VTK sees (pyvista's HDFReader has no ``time_values`` of its own)."""
    reader.reader.UpdateInformation()
    return list(reader.reader.GetOutputInformation(0).Get(Pipeline.TIME_STEPS()))


def test_file_opens_with_times_and_values(tmp_path, mesh):
    """u = t·x, v = x at uneven times comes back in node order at each time."""
    times = [0.0, 1e-6, 3e-6]
    write(tmp_path / "fields.vtkhdf", mesh, times)
    reader = pv.get_reader(tmp_path / "fields.vtkhdf")
    assert times_of(reader) == times
    for t in reversed(times):
        reader.reader.UpdateTimeStep(t)
        grid = reader.read()
        u, v = fields(mesh, t)
        np.testing.assert_array_equal(grid["displacement"], u.astype(np.float32))
        np.testing.assert_array_equal(grid["velocity"], v.astype(np.float32))
        np.testing.assert_array_equal(grid["region"], mesh.regions)
        np.testing.assert_array_equal(grid.points, mesh.points)


def test_read_gives_the_hexahedra(tmp_path, mesh):
    """``pyvista.read``: cells as in the mesh, volume of box and base 0.9 + 1."""
    write(tmp_path / "fields.vtkhdf", mesh, [0.0])
    grid = pv.read(tmp_path / "fields.vtkhdf")
    np.testing.assert_array_equal(grid.cells_dict[pv.CellType.HEXAHEDRON], mesh.cells)
    sizes = grid.compute_cell_sizes()["Volume"]
    assert sizes.min() > 0 and sizes.sum() == pytest.approx(1.9)
    assert set(grid["region"]) == {Tag.BLOCK, Tag.BASE}


def test_growing_file_can_be_read_and_written_at_once(tmp_path, mesh):
    """A reader that keeps the file open does not stop the run, a new one sees all steps."""
    path = tmp_path / "fields.vtkhdf"
    writer = write(path, mesh, [0.0, 0.5])
    early = pv.get_reader(path)
    early.read()
    writer.append(1.0, *fields(mesh, 1.0))
    assert times_of(early) == [0.0, 0.5]
    assert times_of(pv.get_reader(path)) == [0.0, 0.5, 1.0]


def test_file_without_outputs_shows_the_mesh(tmp_path, mesh):
    """Before the first output, and after resuming from there, the file opens."""
    path = tmp_path / "fields.vtkhdf"
    FieldWriter(path, mesh)
    FieldWriter(path, mesh, resume_at=0.0)
    assert pv.read(path).n_cells == len(mesh.cells)


def test_resume_keeps_earlier_outputs_only(tmp_path, mesh):
    """Resuming at t = 1 drops the output at t = 2 and goes on from there."""
    path = tmp_path / "fields.vtkhdf"
    write(path, mesh, [0.0, 1.0, 2.0])
    FieldWriter(path, mesh, resume_at=1.0).append(1.5, *fields(mesh, 1.5))
    reader = pv.get_reader(path)
    assert times_of(reader) == [0.0, 1.0, 1.5]
    reader.reader.UpdateTimeStep(1.5)
    np.testing.assert_allclose(reader.read()["displacement"], 1.5 * mesh.points, rtol=1e-6)


def test_bad_arguments_are_named(tmp_path, mesh):
    """Wrong shape, time that does not advance, another mesh; nothing is written."""
    path = tmp_path / "fields.vtkhdf"
    writer = write(path, mesh, [-1.0, 0.0])
    u, v = fields(mesh, 1.0)
    with pytest.raises(ValueError, match=r"velocity: expected \(\d+, 3\), got \(5, 3\)"):
        writer.append(1.0, u, v[:5])
    with pytest.raises(ValueError, match=r"t: expected later .* got 0.0 s"):
        writer.append(0.0, u, v)
    with pytest.raises(ValueError, match="expected 27 nodes"):
        FieldWriter(path, caps.base(1.0, size=0.5), resume_at=0.0)
    assert times_of(pv.get_reader(path)) == [-1.0, 0.0]
