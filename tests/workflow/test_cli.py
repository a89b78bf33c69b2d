# SPDX-License-Identifier: LGPL-3.0-or-later
"""The command line: what it prints, its exit codes, what it imports, and runs on ranks."""

import json
import subprocess
import sys
import tomllib

import h5py
import numpy as np
import pytest

from workflow import Scene
from workflow.cli import main
from workflow.cli.options import value_of
from workflow.scene.scene import names

SHORT = ("--set", "time.end=2e-6", "--set", "mesh.size=0.0025")


@pytest.fixture
def squealx(monkeypatch, capfd, tmp_path):
    """Run the command in this process from an empty folder: exit code, stdout, stderr."""
    monkeypatch.chdir(tmp_path)

    def call(*words) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["squealx", *map(str, words)])
        capfd.readouterr()
        try:
            main()
            code = 0
        except SystemExit as stop:
            code = int(stop.code or 0)
        return code, *capfd.readouterr()

    return call


def only_json(out: str) -> dict:
    """The one object that stdout holds; fails if there is anything else."""
    found = json.loads(out)
    assert isinstance(found, dict) and out.count("\n") == 1
    return found


def history(folder) -> dict:
    with h5py.File(folder / "results.h5") as file:
        return {name: data[:] for name, data in file["history"].items()}


def test_scenes_are_listed(squealx):
    """Every built-in scene with its title, as a table and as JSON."""
    code, out, _ = squealx("scenes")
    assert code == 0 and all(name in out for name in names())
    code, out, _ = squealx("scenes", "--json")
    listed = only_json(out)
    assert code == 0 and list(listed) == names()
    assert listed["bar-wave"]["title"] == Scene.load("bar-wave").title


@pytest.mark.parametrize("name", names())
def test_validate_accepts_built_in_scenes(squealx, name):
    """Valid without doubt, with what it costs, also with a change."""
    code, out, err = squealx("validate", name)
    valid, cost, *more = out.splitlines()
    assert (code, valid, err) == (0, f"{name}: valid", "") and cost.startswith("cost: ")
    assert not any("doubt" in line for line in more)
    code, out, _ = squealx("validate", name, "--set", "mesh.size=3e-3", "--json")
    found = only_json(out)
    assert code == 0 and found["scene"] == name and found["valid"] and found["cost"]["cells"] > 0


@pytest.mark.parametrize(
    ("key", "text", "value"),
    [
        ("mesh.rail_profile", "60E1", "60E1"),
        ("mesh.rail_base", "54E1", "54E1"),
        ("name", "7", "7"),
        ("title", '"7"', "7"),
        ("track.sleeper_top", "1e3", "1e3"),
        ("bodies.rail.element", "true", "true"),
        ("mesh.size", "1E-3", 1e-3),
        ("mesh.size", "2mm", "2mm"),
        ("mesh.roll", "-1e-2", -0.01),
        ("contacts.c.friction", "0.5", 0.5),
        ("contacts.c.target", "7", 7),  # text or a table: 7 is neither, and told as it was meant
        ("bodies.rail.regions", '["web"]', ["web"]),
        ("equilibrium.approach.rail", "[0.0, 0.0, 1.0]", [0.0, 0.0, 1.0]),
        ("no.such.key", "1", 1),
    ],
)
def test_text_stays_text_where_a_scene_takes_nothing_else(key, text, value):
    """A rail may be called 54E1, which is 540 in TOML; where numbers are taken it stays one."""
    found = value_of(key, text)
    assert found == value and type(found) is type(value)


def test_names_that_look_like_numbers(squealx):
    """60E1 is a rail, and no wheel; the message has it as it was written."""
    name, rail, wheel = "flange-transition", "mesh.rail_profile=60E1", "mesh.wheel_profile=54E1"
    assert squealx("validate", name, "--set", rail)[0] == 0
    code, out, err = squealx("validate", name, "--set", wheel)
    assert (code, out) == (2, "") and "mesh.wheel_profile = '54E1': " in err


def test_version_names_squealx_and_dolfinx(squealx):
    """Versions of the program and of what it stands on."""
    code, out, _ = squealx("version", "--json")
    found = only_json(out)
    assert code == 0 and found["squealx"] and any("dolfinx" in name for name in found)
    assert f"squealx {found['squealx']}" in squealx("version")[1]


def test_run_prints_its_summary_and_leaves_its_results(squealx, tmp_path):
    """``run --json``: one object on stdout, the same as summary.json; the folder by name."""
    code, out, err = squealx("run", "bar-wave", "--json", *SHORT)
    folder = tmp_path / "runs" / "bar-wave"
    assert code == 0 and "stepping" in err
    summary = only_json(out)
    assert summary == json.loads((folder / "summary.json").read_text())
    assert summary["status"] == "done" and summary["cells"] == 2 * 2 * 40
    assert {p.name for p in folder.iterdir()} == {
        *("scene.toml", "summary.json", "results.h5", "fields.vtkhdf", "run.log", "checkpoint")
    }
    with h5py.File(folder / "results.h5") as file:
        units = {name: data.attrs["units"] for name, data in file["history"].items()}
    np.testing.assert_allclose(history(folder)["t"], [0, 1e-6, 2e-6], rtol=1e-9)
    assert units["t"] == "s" and units["kinetic"] == "J" and units["balance_error"] == "1"


def test_summary_holds_what_is_promised(squealx):
    """The keys of design section 4."""
    _, out, _ = squealx("run", "bar-wave", "--json", *SHORT)
    summary = only_json(out)
    promised = "scene version status cells nodes dofs ranks steps dt dt_bound wall_seconds"
    assert set(promised.split()) <= set(summary)
    assert {"seconds_per_phase", "element_updates_per_second", "contacts"} <= set(summary)
    phases = "mesh compile equilibrium internal_force contact update output"
    assert set(phases.split()) <= set(summary["seconds_per_phase"])
    energies = "kinetic internal hourglass contact friction_dissipation damping external_work"
    assert {*energies.split(), "balance_error"} <= set(summary["energy"])
    assert summary["dofs"] == 3 * summary["nodes"] and summary["dt"] <= 0.9 * summary["dt_bound"]


def test_a_run_can_be_repeated_from_its_own_scene(squealx, tmp_path):
    """``run scene.toml`` of a changed run gives the same scene and, on one rank, the same bits."""
    squealx("run", "bar-wave", "--out", "first", *SHORT)
    assert squealx("run", "first/scene.toml", "--out", "second")[0] == 0
    first, second = (tmp_path / f / "scene.toml" for f in ("first", "second"))
    assert first.read_text() == second.read_text()
    assert Scene.load(first) == Scene.load("bar-wave", **{"time.end": 2e-6, "mesh.size": 0.0025})
    again = history(tmp_path / "second")
    for name, column in history(tmp_path / "first").items():
        np.testing.assert_array_equal(again[name], column)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("bar-wavy",), "'bar-wavy': expected a TOML file or one of ball-on-block, bar-impact"),
        (("bar-wave", "--set", "mesh.size"), "--set 'mesh.size': expected key.path=value"),
        (("bar-wave", "--set", "mesh.sise=1"), "mesh.sise = 1: unknown key"),
        (("bar-wave", "--set", "mesh.size=-1"), "mesh.size = -1: expected greater than 0 [m]"),
        (("bar-wave", "--set", "mesh.size=2mm"), "mesh.size = '2mm': expected a valid number [m]"),
        (("bar-wave", "--set", "mesh.size.x=1"), "mesh.size is not a table"),
        (("bar-wave", "--set", 'bodies.bar.regions=["web"]'), "expected one of ['bar']"),
        (("flange-transition", "--set", "rolling.angle_of_attack=0.3"), "= 0.3: expected less"),
        (("hertz", "--set", "contacts.touch.target=floor"), "target = 'floor': expected one of"),
        (("broken.toml",), "broken.toml: not valid TOML"),
        (("bar-wave", "--out", "file"), "out = 'file': expected a folder that can be written"),
        (("bar-wave", "--out", "file/below"), "out = 'file/below': expected a folder"),
        (("bar-wave", "--out", "old"), "out = 'old': already holds a run; expected a new folder"),
        (("bar-wave", "--ranks", "2", "--set", "mesh.size=-1"), "mesh.size = -1: expected"),
        (("bar-wave", "--ranks", "2", "--out", "old"), "out = 'old': already holds a run"),
        (("bar-wave", "--ranks", "0"), "--ranks"),
        (("bar-wave", "--rank", "2"), "--rank"),
        ((), "Missing argument"),
    ],
)
def test_bad_input_exits_with_2_and_leaves_nothing(squealx, tmp_path, words, message):
    """A message on stderr that names the key; nothing on stdout, no folder or file made."""
    (tmp_path / "broken.toml").write_text("name = [")
    (tmp_path / "file").write_text("")
    (tmp_path / "old").mkdir()
    (tmp_path / "old" / "scene.toml").write_text("")
    before = {p: p.stat().st_mtime_ns for p in tmp_path.rglob("*")}
    code, out, err = squealx("run", *words, *(["--json"] if words else []))
    assert (code, out) == (2, "")
    assert message in err and "Traceback" not in err
    assert {p: p.stat().st_mtime_ns for p in tmp_path.rglob("*")} == before


def test_unknown_commands_exit_with_2(squealx):
    """Neither a traceback nor success."""
    code, out, err = squealx("jump")
    assert (code, out) == (2, "") and "jump" in err and "Traceback" not in err


UNSTABLE = ("--set", "time.safety=1.2")


@pytest.mark.parametrize("ranks", [(), pytest.param(("--ranks", "2"), marks=pytest.mark.mpi)])
def test_a_blow_up_exits_with_3_and_keeps_its_results(squealx, tmp_path, ranks):
    """A step 4 % over the limit: the guard's reason on stderr once, and in summary.json."""
    code, out, err = squealx("run", "bar-wave", "--json", "--out", "out", *UNSTABLE, *ranks)
    assert (code, out) == (3, "")
    assert err.count("likely an unstable step") == 1 and "Traceback" not in err
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["status"].startswith("stopped: energy balance error")
    assert 0 < summary["steps"] < 100
    assert len(history(tmp_path / "out")["t"]) > 1
    assert tomllib.loads((tmp_path / "out" / "scene.toml").read_text())["time"]["safety"] == 1.2


@pytest.mark.mpi
@pytest.mark.parametrize("ranks", [2, 3])
def test_row_23_ranks_give_the_same_history(squealx, tmp_path, ranks):
    """bar-wave, 200 steps, serial and on ranks: every column within 1e-9 of its scale.

    Energies sum in another order, over the kinetic energy, reactions over the largest; the fields
    are kept as float32.
    """
    words = ("run", "bar-wave", "--set", "time.end=40e-6", "--json", "--out")
    assert squealx(*words, "one")[0] == 0
    code, out, _ = squealx(*words, "more", "--ranks", ranks)
    assert code == 0 and only_json(out)["ranks"] == ranks
    one, more = history(tmp_path / "one"), history(tmp_path / "more")
    assert one.keys() == more.keys() and len(one["t"]) == 41
    scale = {"t": 40e-6, "balance_error": 1.0}
    for name in one:
        own = np.abs(one[name]).max() if "_force" in name else one["kinetic"].max()
        atol = 1e-9 * scale.get(name, own)
        np.testing.assert_allclose(more[name], one[name], rtol=0, atol=atol, err_msg=name)
    u, v = (last_fields(tmp_path / folder) for folder in ("one", "more"))
    np.testing.assert_allclose(v, u, rtol=0, atol=1e-6 * np.abs(u).max())


def last_fields(folder) -> np.ndarray:
    """Displacement and velocity [m, scaled by m/s] at the last output, in mesh order."""
    pv = pytest.importorskip("pyvista")
    reader = pv.get_reader(folder / "fields.vtkhdf")
    grid = reader.read()
    return np.hstack([grid["displacement"], 1e-5 * grid["velocity"]])


def test_a_run_imports_only_what_it_needs(tmp_path):
    """No meshing, plotting, eigenvalue or contact package for a bar without contact."""
    command = [
        sys.executable,
        "-X",
        "importtime",
        "-m",
        "workflow.cli",
        "run",
        "bar-wave",
    ]
    done = subprocess.run(
        [*command, "--out", "out", *SHORT],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    lines = [x for x in done.stderr.splitlines() if x.startswith("import time:")]
    loaded = {line.rsplit("|", 1)[1].strip() for line in lines}
    assert "dolfinx" in loaded and "workflow.simulation.stepping" in loaded
    unwanted = {"gmsh", "pyvista", "vtk", "matplotlib", "slepc4py", "meshio", "contact"}
    assert not unwanted & {name.split(".")[0] for name in loaded}
