# SPDX-License-Identifier: LGPL-3.0-or-later
"""Footprints on the facets of both bodies: kept with a run, exported, opened by pyvista."""

import csv
import json
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

from tests.folders import arrays
from workflow import Scene, read_run, run
from workflow.results.footprint_files import export
from workflow.results.footprints import Facets, read
from workflow.results.record import Record

pv = pytest.importorskip("pyvista")

FRICTION, PRESSURE, SPEED = 0.3, 10e6, 2.0
LOAD = PRESSURE * 0.02**2
SLIDING = {"time.end": 20e-6, "time.output_interval": 5e-6}


@pytest.fixture(scope="module")
def folder(run_scene) -> Path:
    """A block that is thrown along a base of another mesh."""
    return run_scene("sliding-block", **SLIDING)


@pytest.fixture(scope="module")
def exported(folder, tmp_path_factory) -> Path:
    """Its footprints as files."""
    out = tmp_path_factory.mktemp("footprints") / "new" / "folder"
    found = export(folder, out, tables=True)
    assert found["outputs"] == len(found["tables"]) == 5
    return out


def resultants(facets: Facets) -> tuple[np.ndarray, float]:
    """Force on a body and friction power, summed from the fields of its nodes."""
    n = facets.nodal
    stress = n["pressure"][:, None] * n["normal"] + n["shear"]
    return n["area"] @ stress, float(n["area"] @ n["friction_power_density"])


VARIANTS = {
    "nodes": {},
    "points": {"contacts.face.points": "quadrature"},
    "two passes": {"contacts.face.two_pass": True},
    "at the end": {"contacts.face.method": "implicit-penalty"},
    "multipliers": {"contacts.face.method": "lagrange"},
}


@pytest.mark.parametrize("kind", VARIANTS)
def test_both_bodies_bear_the_same(kind, run_scene):
    """Forces are equal and opposite and powers equal, to round-off; the force is the history's.

    The block slides: friction heats with μ N times its speed relative to the base.
    """
    folder = run_scene("sliding-block", **SLIDING, **VARIANTS[kind])
    history, mass = read_run(folder).history, 7800 * 0.02 * 0.02 * 0.01
    for k, (contactor, target) in enumerate(read(folder)):
        assert (contactor.side, target.side) == ("contactor", "target")
        assert contactor.t == target.t == history["t"][k]
        (one, power), (two, other) = resultants(contactor), resultants(target)
        np.testing.assert_allclose(two, -one, rtol=0, atol=1e-9 * LOAD)
        assert other == pytest.approx(power, rel=1e-12)
        on_block = [history[f"contact_on_block_{a}_force"][k] for a in "xyz"]
        np.testing.assert_allclose(one, on_block, rtol=0, atol=1e-9 * LOAD)
        if contactor.t > 4e-6:
            speed = SPEED - FRICTION * LOAD / mass * contactor.t
            assert power == pytest.approx(FRICTION * LOAD * speed, rel=0.15)


def test_heat_is_the_power_over_time(run_scene):
    """The integral of the power of the patch is the heat of the ledger, of 20 µs of slide: 1 %.

    A trapezoid of 20 outputs; the power has what tangential springs take up and give back.
    """
    result = read_run(run_scene("sliding-block", **{"time.end": 20e-6}))
    table, heat = result.patches("face"), result.history["friction_dissipation"]
    work = np.trapezoid(table["friction_power"], table["t"])
    assert work == pytest.approx(heat[-1], rel=0.01)
    assert np.isnan(table["t_gamma"]).all()  # nothing rolls


def test_facets_are_those_of_the_mesh_where_it_is(folder):
    """Corners are mesh nodes, moved by the displacement of the fields; no facet is left out."""
    record = Record(folder)
    for k, found in enumerate(read(folder)):
        u = record.displacement(found[0].t)
        for facets in found:
            place = record.body.points[facets.node] + u[facets.node]
            np.testing.assert_allclose(facets.position, place, rtol=0, atol=1e-9)
            assert (np.bincount(facets.facets.ravel(), minlength=len(facets.node)) > 0).all()
        contactor, target = found
        assert contactor.facets.shape == (64, 4)  # all of the block's underside
        assert np.isclose(contactor.nodal["area"].sum(), 0.02**2)
        assert target.nodal["pressure"].min() == 0.0 and (target.nodal["patch"] == -1).any()
        assert set(np.unique(contactor.nodal["patch"])) == {0}, k


def test_series_opens_in_pyvista(folder, exported):
    """All outputs with their times, both bodies as surfaces of quads with the fields that are told.

    The normals of the facets point out of the bodies: towards each other.
    """
    reader = pv.get_reader(exported / "footprints.pvd")
    np.testing.assert_array_equal(reader.time_values, read_run(folder).history["t"])
    for k, found in enumerate(read(folder)):
        reader.set_active_time_point(k)
        for facets, block in zip(found, reader.read(), strict=True):
            assert block.n_cells == len(facets.facets) and block.n_points == len(facets.node)
            np.testing.assert_allclose(block.points, facets.position, rtol=1e-6, atol=1e-9)
            for name, values in facets.nodal.items():
                np.testing.assert_array_equal(block.point_data[name], values)
            assert list(block.field_data["side"]) == [facets.side]
            up = block.compute_normals(cell_normals=True, auto_orient_normals=False)
            size = block.compute_cell_sizes()["Area"] @ up.cell_data["Normals"]
            assert np.sign(size[2]) == (-1 if facets.side == "contactor" else 1)
    assert len(pv.read(exported / "footprints.pvd")) == 2


def test_tables_have_the_nodes_that_bear(folder, exported):
    """A CSV for each output: the same numbers, a vector as three columns."""
    for k, found in enumerate(read(folder)):
        with (exported / f"footprints-{k:05d}.csv").open(newline="") as file:
            rows = list(csv.DictReader(file))
        for facets in found:
            own = [row for row in rows if row["side"] == facets.side]
            bears = facets.nodal["pressure"] > 0
            assert [int(row["node"]) for row in own] == facets.node[bears].tolist()
            shear = [float(row["shear_y"]) for row in own]
            np.testing.assert_array_equal(shear, facets.nodal["shear"][bears, 1])
            assert {float(row["t"]) for row in own} == {facets.t}


def test_contact_that_comes_and_goes(run_scene, command):
    """A bar hits a wall and leaves it: every output has its file, of no facets where it is apart.

    The wall is rigid and has no facets. Files of an older export are replaced.
    """
    folder = run_scene("bar-impact", **{"mesh.size": 5e-3, "time.output_interval": 4e-6})
    for _ in range(2):
        found = json.loads(command("export-footprints", folder, "--json").stdout)
    assert found == {
        "series": str(folder / "footprints" / "footprints.pvd"), "outputs": 16, "tables": [],
    }  # fmt: skip
    cells, reader = [], pv.get_reader(found["series"])
    for k in range(16):
        reader.set_active_time_point(k)
        (block,) = reader.read()
        cells.append(block.n_cells)
        assert "pressure" in block.point_data and block.point_data["shear"].shape[1] == 3
    assert cells[0] == cells[-1] == 0 and cells[4] == 1


def test_what_cannot_be_exported_is_refused(command, run_scene, tmp_path, monkeypatch):
    """No results, no contact, no pyvista: exit code 2 and what is expected, nothing written."""
    bar = run_scene("bar-wave", **{"mesh.size": 5e-3, "time.end": 2e-6})

    def refused(folder) -> str:
        words = "export-footprints", folder, "--out", tmp_path / "out"
        done = command(*words, check=False)
        assert done.returncode == 2 and not (tmp_path / "out").exists()
        return done.stderr

    assert "expected a result folder with" in refused("nowhere")
    assert "bodies have touched" in refused(bar)
    block, full = run_scene("sliding-block", **SLIDING), tmp_path / "file"
    full.write_text("in the way")
    done = command("export-footprints", block, "--out", full, check=False)
    assert done.returncode == 2 and "can be written" in done.stderr
    monkeypatch.setitem(sys.modules, "pyvista", None)
    assert "expected pyvista" in refused(block)


@pytest.mark.slow
@pytest.mark.mpi
def test_ranks_keep_the_same(folder, mpirun, tmp_path):
    """Two ranks: the same nodes and facets, forces to 1e-9 of the load."""
    changes = [f"--set={key}={value}" for key, value in SLIDING.items()]
    mpirun(2, "-m", "workflow.cli", "run", "sliding-block", *changes, "--out", tmp_path / "two")
    for one, two in zip(read(folder), read(tmp_path / "two"), strict=True):
        for a, b in zip(one, two, strict=True):
            np.testing.assert_array_equal(a.node, b.node)
            np.testing.assert_array_equal(a.facets, b.facets)
            np.testing.assert_allclose(a.position, b.position, rtol=0, atol=1e-12)
            (force, power), (other, same) = resultants(a), resultants(b)
            np.testing.assert_allclose(force, other, rtol=0, atol=1e-9 * LOAD)
            assert power == pytest.approx(same, rel=1e-6, abs=1e-6)


def test_resumed_run_keeps_them_bit_by_bit(folder, tmp_path):
    """Stopped half way and gone on with: the same file as a run in one go."""
    scene = Scene.load("sliding-block", **SLIDING)
    run(scene.with_(**{"time.end": 10e-6}), tmp_path / "run", quiet=True)
    run(scene, tmp_path / "run", quiet=True, resume=True)
    whole, parts = arrays(folder / "results.h5"), arrays(tmp_path / "run" / "results.h5")
    assert whole.keys() == parts.keys()
    for name in whole:
        np.testing.assert_array_equal(whole[name], parts[name], err_msg=name)
    with h5py.File(folder / "results.h5") as file:
        assert set(file["surfaces/face"]) == {"contactor", "target"}


def test_folder_that_an_older_version_began(command, tmp_path):
    """Its tables keep their columns, all of one length, and what has no facets is not exported."""
    scene, folder = Scene.load("sliding-block", **SLIDING), tmp_path / "run"
    run(scene.with_(**{"time.end": 10e-6}), folder, quiet=True)
    with h5py.File(folder / "results.h5", "r+") as file:
        del file["surfaces"], file["patches/face/t_gamma"]
        for name in [n for n in file["history"] if n.startswith(("support", "contact_on"))]:
            del file[f"history/{name}"]
        for group in file["contact/face"].values():
            del group["friction_power"], group["target"], group["contactor_position"]
    run(scene, folder, quiet=True, resume=True)
    result = read_run(folder)
    assert {len(column) for column in result.history.values()} == {5}
    assert {len(column) for column in result.patches("face").values()} == {5}
    assert "friction_power" in result.patches("face") and "support" not in str([*result.history])
    done = command("export-footprints", folder, check=False)
    assert done.returncode == 2 and "output 0 was written before" in done.stderr
