# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sliding states: how they come to rest, damping, springs, roads, files, ranks, errors."""

import json
import sys
from types import SimpleNamespace

from mpi4py import MPI

import numpy as np
import pytest

from workflow import Scene, SceneError, build
from workflow.cli import main
from workflow.squeal.pencil import pencil
from workflow.squeal.sliding import drift_at
from workflow.squeal.solve import projection
from workflow.squeal.squeal import squeal
from workflow.squeal.steady import steady

COARSE = {"mesh.size": 0.005, "mesh.base_size": 0.0062, "contacts.face.friction": 0.6}
BLOCK = [word for key, value in COARSE.items() for word in ("--set", f"{key}={value}")]
TOP = 80e3


def block(**changes):
    return Scene.load("sliding-block", **{**COARSE, **changes})


def test_block_leans_on_its_friction():
    """A block of 4 kN that slides is slowed down by f g: its pressure leans forward.

    Friction acts on its sole, its inertia at its centre h / 2 above: the moment of the normal
    forces about the middle of the sole is f N h / 2, of the friction across it none.
    """
    model = build(block(), MPI.COMM_SELF)
    (face,) = steady(model)
    on = face.contacts
    x = model.domain.source.points[on.nodes[:, 0]]
    middle = (x.min(axis=0) + x.max(axis=0)) / 2
    assert on.normal_force.sum() == pytest.approx(4000.0, rel=1e-4)
    moment = on.normal_force @ (x - middle)
    assert moment[0] == pytest.approx(0.6 * 4000.0 * 0.01 / 2, rel=5e-3)
    assert moment[1] == pytest.approx(0.0, abs=1e-3 * moment[0])
    assert on.speed == pytest.approx(2.0)


def test_two_roads():
    """Full matrices and projection find the same flutter of the block, to the ninth digit.

    What grows in the projection is brought to convergence on the full matrices; without that it is
    off by 0.2 %. All of the growth is friction's.
    """
    rows = {}
    for road in ("full", "projection"):
        found = squeal(block(), comm=MPI.COMM_SELF, top=TOP, road=road).summary
        (rows[road],) = [mode for mode in found["modes"] if mode["kind"] != "stable"]
    full, few = rows["full"], rows["projection"]
    assert full["residual"] < 1e-8 and few["residual"] < 1e-8
    assert few["frequency"] == pytest.approx(full["frequency"], rel=1e-9)
    assert few["growth_rate"] == pytest.approx(full["growth_rate"], rel=1e-8)
    assert full["fed_by"]["face"] == pytest.approx(full["growth_rate"], rel=1e-6)


def test_friction_of_shapes_is_that_of_the_matrices():
    """In few shapes the rows of the contacts give the friction that the full matrices give."""
    model = build(block(), MPI.COMM_SELF)
    found = steady(model)
    few = projection(pencil(model, found), TOP)
    again = few.rubbed(found)
    for name in ("K_f", "C_f"):
        whole = getattr(few, name)
        assert np.abs(whole).max() > 0
        np.testing.assert_allclose(getattr(again, name), whole, atol=1e-9 * np.abs(whole).max())


def test_angle_of_attack_is_a_drift():
    """A wheel led along the rail at 20 mrad slides at V tan(0.02) already; at 40 mrad twice."""
    scene = Scene.load("steady-curving")
    model = SimpleNamespace(scene=scene)
    speed = scene.rolling.speed * np.tan(0.02)
    assert np.linalg.norm(drift_at(model, 0.02)) < 1e-3 * speed
    more = drift_at(model, 0.04)
    assert np.linalg.norm(more) == pytest.approx(speed, rel=2e-3)
    assert more[1] < 0  # with the support that takes the drift away


def test_angles_need_a_wheel(command):
    """A map over angles of attack of a block ends with code 2, as do angles of a right corner."""
    done = command("squeal", "sliding-block", "--angles", "0.02", check=False)
    assert done.returncode == 2 and "[rolling]" in done.stderr
    done = command("squeal", "steady-curving", "--angles", "1.5", check=False)
    assert done.returncode == 2 and "0.2 rad" in done.stderr


def test_stick_is_symmetric():
    """A block that sticks has no complex eigenvalue: springs all round, and nothing is lost."""
    found = squeal(block(), comm=MPI.COMM_SELF, top=TOP, sticking=["face"]).summary
    assert found["unstable"] == 0 and found["contacts"]["face"]["state"] == "sticking"
    for mode in found["modes"]:
        assert abs(mode["growth_rate"]) < 1e-6 * mode["frequency"]


def test_damping_of_all_kinds():
    """Damping β of stiffness and α of mass take ``(α + β ω²) / 2`` off the growth of a stuck block.

    The contact springs are not damped by β; stiff ones hold 0.3 % of the energy.
    """
    alpha, beta = 800.0, 2e-8
    keys = {
        f"bodies.{name}.{key}": value
        for name in ("block", "base")
        for key, value in (("stiffness_damping", beta), ("mass_damping", alpha))
    }
    keys |= {"contacts.face.method": "implicit-penalty", "contacts.face.penalty": 100.0}
    found = squeal(block(**keys), comm=MPI.COMM_SELF, top=TOP, sticking=["face"]).summary
    assert len(found["modes"]) > 1
    for mode in found["modes"]:
        square = (2 * np.pi * mode["frequency"]) ** 2
        assert mode["growth_rate"] == pytest.approx(-(alpha + beta * square) / 2, rel=5e-3)


def test_sprung_mass_is_a_motion_of_its_own():
    """A mass on a belt whose spring has a damper: ``λ² m + λ c + k = 0`` without slope."""
    spring = {"surface": "zmin", "stiffness": [1e4, 0.0, 0.0], "damping": [20.0, 0.0, 0.0]}
    scene = Scene.load("mass-on-belt", springs=[spring])
    (mode,) = squeal(scene, comm=MPI.COMM_SELF, top=1e3).summary["modes"]
    assert mode["growth_rate"] == pytest.approx(-10.0, rel=1e-4)
    assert mode["frequency"] == pytest.approx(np.sqrt(1e4 - 100.0) / (2 * np.pi), rel=1e-4)
    assert mode["damping"] == pytest.approx(-10.0, rel=1e-4)


def test_files_and_locus(tmp_path, capsys, monkeypatch):
    """The folder has table, shapes and figure; the locus meets the modes of the scene."""
    out = tmp_path / "out"
    words = ["squealx", "squeal", "mode-coupling", "--to", "5000", "--out", str(out)]
    monkeypatch.setattr(sys, "argv", [*words, "--friction", "0.2,0.3", "--json"])
    with pytest.raises(SystemExit) as stop:
        main()
    assert stop.value.code == 0
    found = json.loads(capsys.readouterr().out)
    assert found == json.loads((out / "squeal.json").read_text())
    assert (out / "figures" / "root_locus.png").stat().st_size > 10_000
    assert (out / "squeal.vtkhdf").exists() and Scene.load(str(out / "scene.toml"))
    below, own = found["locus"]
    assert [row["friction"] for row in found["locus"]] == [0.2, 0.3]
    assert max(mode["growth_rate"] for mode in below["modes"]) < 1e-3
    most = max(mode["growth_rate"] for mode in found["modes"])
    assert max(mode["growth_rate"] for mode in own["modes"]) == pytest.approx(most, rel=1e-4)


@pytest.mark.parametrize(
    ("scene", "words", "message"),
    [
        ("bar-wave", [], "bar-wave: no contacts; expected one with friction"),
        ("contact-patch", [], "contacts.face.friction = 0: nothing that could squeal"),
        ("sliding-block", ["--to", "-1"], "--to -1: expected a frequency above 0 Hz"),
        ("sliding-block", ["--road", "short"], "--road 'short': expected full or projection"),
        ("sliding-block", ["--stick", "sole"], r"--stick sole: expected some of ['face']"),
        ("sliding-block", ["--slip", "1,2"], "--slip '1,2': expected three velocities, got 2"),
        ("sliding-block", ["--friction", "a"], "--friction 'a': expected numbers parted by"),
        ("sliding-block", [*BLOCK, "--to", "2e5"], "expected 4 or more, up to 1.34e+05 Hz"),
        (
            "sliding-block",
            [*BLOCK, "--set", "bodies.block.velocity=[0.0, 0.0, 0.0]"],
            "25 of 25 contacts do not slide at the start of the run; expected a velocity",
        ),
        ("sliding-block", [*BLOCK, "--to", "80000", "--most", "3"], "11 modes up to 80000 Hz"),
    ],
)
def test_errors_name_what_is_expected(scene, words, message, tmp_path, capsys, monkeypatch):
    """Bad input ends with code 2 and one line that names option or key."""
    out = ["--out", str(tmp_path / "out")]
    monkeypatch.setattr(sys, "argv", ["squealx", "squeal", scene, *words, *out])
    with pytest.raises(SystemExit) as stop:
        main()
    assert stop.value.code == 2
    assert message in capsys.readouterr().err.replace("\n", " ")


def test_bodies_apart_do_not_squeal():
    """A load off the wall takes the block away from it, to rest on its springs alone."""
    load = {"surface": "top", "traction": [0.9e5, 0.0, 3.8e5]}
    scene = Scene.load("mode-coupling", loads=[load])
    with pytest.raises(SceneError, match="none of the contacts sole touches at rest"):
        squeal(scene, comm=MPI.COMM_SELF, top=5e3)
    with pytest.raises(SceneError, match=r"sliding-block: no \[equilibrium\]; expected one"):
        squeal(block(equilibrium=None), comm=MPI.COMM_SELF, top=TOP)


@pytest.mark.slow
@pytest.mark.mpi
def test_two_ranks_find_the_same(mpirun, tmp_path):
    """The sliding block on two ranks: modes, what feeds them and locus are those of one rank."""
    found = []
    for ranks in (1, 2):
        out = tmp_path / str(ranks)
        words = ["squeal", "sliding-block", *BLOCK, "--to", str(TOP), "--friction", "0.5,0.6"]
        done = mpirun(ranks, "-m", "workflow.cli", *words, "--out", str(out))
        assert done.returncode == 0, done.stderr
        found.append(json.loads((out / "squeal.json").read_text()))
    one, two = found
    assert (one["ranks"], two["ranks"]) == (1, 2)
    for a, b in zip(one["modes"], two["modes"], strict=True):
        assert b["frequency"] == pytest.approx(a["frequency"], rel=1e-5)
        assert b["growth_rate"] == pytest.approx(a["growth_rate"], rel=1e-3, abs=1.0)
        assert b["fed_by"] == pytest.approx(a["fed_by"], rel=1e-3, abs=1.0)
    for a, b in zip(one["locus"], two["locus"], strict=True):
        rates = [[mode["growth_rate"] for mode in row["modes"]] for row in (a, b)]
        assert rates[1] == pytest.approx(rates[0], rel=1e-3, abs=1.0)
