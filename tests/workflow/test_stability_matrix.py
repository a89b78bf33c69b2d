# SPDX-License-Identifier: LGPL-3.0-or-later
"""The stability matrix: verdicts, what is kept, its figure; limits found against the audit's."""

import json

from mpi4py import MPI  # noqa: F401

import numpy as np
import pytest

from workflow.model.advice import landing_gain
from workflow.model.checks import check
from workflow.model.model import build
from workflow.scene.scene import Scene, SceneError
from workflow.stability import limits
from workflow.stability import run as stability_run
from workflow.stability.cases import Case, cases
from workflow.stability.figure import draw
from workflow.stability.limits import limit
from workflow.stability.run import (
    counts,
    judge,
    judged_row,
    matrix,
    measures,
    read,
    scene_of,
    went_wild,
)

FACE = "contacts.face."
COARSE = {"mesh.size": 0.005, "mesh.base_size": 0.006}


def small(panel="p", x="1", **changes) -> Case:
    """A slide of the base case on coarse cells."""
    return Case(panel, x, "", "slide", {**COARSE, **changes})


@pytest.mark.parametrize("case, key, slack", [
    ("friction 0", "step", 0.01), ("friction 0", "penalty", 0.02), ("friction 0.3", "step", 0.01),
    ("two-pass, friction 0", "penalty", 0.02), ("modulus-penalty 1, friction 0", "penalty", 0.02),
    ("penalty 2", "step", 0.01), ("implicit-penalty 30", "step", 0.01),
])  # fmt: skip
def test_predicted_limits_are_those_of_runs(case, key, slack):
    """Largest stable step and penalty, bisected to 1 %: never optimistic by more than 1 to 2 %,
    never more than 3 % too careful; the bound of the scene is on the safe side."""
    found = limit(case, key, within=0.01)
    assert 0.97 < found.ratio < 1 + slack
    if key == "step":
        assert found.scene < 1.005 * found.found


def test_scenes_whose_limits_are_sought_can_be_run():
    """None is refused, which would end the command after its matrix."""
    for changes, _ in limits.TRIED.values():
        check(Scene.load("sliding-block", **{**limits.SMALL, **changes}))


def test_damping_limit_is_on_the_safe_side():
    """A damper that cannot pull is borne beyond the linear limit, noisily, and never below it."""
    assert 0.4 < limit("friction 0", "damping", within=0.05).ratio < 1.02


VERDICTS = [
    (small(), "accurate", ""),
    (small(**{FACE + "damping": 2.0, "time.safety": 0.5}), "wrong", ""),
    (small(**{FACE + "penalty": 10.0}), "caught", "energy balance error"),
    (small(**{FACE + "damping": -1.0}), "refused", "contacts.face.damping"),
    (Case("p", "1", "", "slide", COARSE, {"block": (0.0, 0.0, -0.001)}), "refused", "overlap"),
]


@pytest.mark.parametrize("case, kind, message", VERDICTS, ids=[v[1] for v in VERDICTS])
def test_verdicts(case, kind, message):
    """One case of each verdict; stops and refusals say why."""
    found = judge(case)
    assert (found.kind, message in found.message) == (kind, True), found
    assert (found.steps > 0) == (kind != "refused")


def test_a_blow_up_past_blind_guards_is_called_unseen():
    """With guards that look away a bar at 1.1 of its step ends wild, and the matrix says so."""
    linear = {"bodies.bar.kinematics": "small-strain", "time.safety": 1.1}
    blind = {"guards.energy_error": 1e300, **linear}
    found = judge(Case("p", "1", "", "spin", blind, spin=100.0))
    assert found.kind == "unseen" and "energy has grown" in found.message


def test_what_is_wild():
    """Energy many times what was there, or none that is finite."""
    quiet = {k: np.ones(3) for k in ("internal", "hourglass", "contact", "spring", "kinetic")}
    quiet["external_work"] = np.zeros(3)
    assert went_wild(quiet) == ""
    assert "grown" in went_wild({**quiet, "kinetic": np.array([1.0, -200.0, 1.0])})
    assert "finite" in went_wild({**quiet, "internal": np.array([1.0, np.nan, 1.0])})


def test_measures_know_a_wrong_force(tmp_path):
    """A normal force of 0.9 of the load is 10 % off, whatever else is right."""
    case = small()
    scene = scene_of(case, tmp_path)

    class Fake:
        """A block that slows down as it should; its landings take 2 mJ."""

        table = np.column_stack([np.linspace(0, 80e-6, 50), np.full(50, 3600.0),
                                 np.full(50, 1080.0), np.full(50, 1e-6),
                                 np.linspace(0, 2e-3, 50)])  # fmt: skip
        speeds = np.array([10.0, 0, 0]) - np.outer(table[:, 0], [0.3 * 10e6 / (7800 * 0.01), 0, 0])

    history = {"guarded_error": np.full(5, -1e-3), "contact_work": np.linspace(0, 0.5, 5)}
    found = measures(case, scene, Fake(), history)
    assert found["normal force"] == pytest.approx(0.1)
    assert found["change of speed"] == pytest.approx(0.0, abs=1e-9)
    assert found["contact energy"] == pytest.approx(1e-3 + 2e-3 / 0.5)
    damped = scene.with_(**{FACE + "damping": 0.1})  # whose loss is asked for
    assert "contact energy" not in measures(case, damped, Fake(), history)


def test_mesh_of_a_case_is_changed_as_told(tmp_path):
    """Flat cells of 1:5 have the same plan and a fifth of the height."""
    from workflow.model.geometry import mesh_of

    case = Case("p", "5", "", "slide", COARSE, {"scale": (1, 1, 0.2)})
    mesh, _ = mesh_of(scene_of(case, tmp_path))
    np.testing.assert_allclose(np.ptp(mesh.points, axis=0), [0.04, 0.03, 0.004])


def test_axes_span_what_they_should():
    """Every axis of the specification is there from end to end, and keys are unique."""
    found = cases()
    assert len({c.key for c in found}) == len(found)

    def ends(panel: str) -> tuple[str, str]:
        group = [c for c in found if c.panel == panel]
        return group[0].x, group[-1].x

    assert ends("penalty factor") == ("0.001", "10")
    assert ends("modulus-penalty factor") == ("0.1", "100")
    assert ends("implicit-penalty factor") == ("0.1", "1000")
    assert ends("friction") == ("0", "1.5")
    assert ends("sliding speed [m/s]") == ("0", "300")
    assert ends("angle of attack [mrad]") == ("0", "60")
    assert ends("load on a sphere [N]") == ("1", "500 k")
    assert ends("stiffness ratio") == ("1", "1e+06")
    assert ends("cell aspect") == ("1", "50")
    assert ends("step factor") == ("0.1", "1.1")
    assert ends("contact damping / critical") == ("0", "2")
    assert ends("rotation, rolling [rad/s]")[1] == "1000"
    assert ends("initial penetration / cell") == ("0", "1")
    flat = {c.x: c for c in found if c.panel == "cell aspect"}
    assert flat["2"].moved and not flat["1"].moved  # cubes are the base case, through no file
    assert len(cases(quick=True)) < 0.5 * len(found)


def test_matrix_goes_on_where_it_was_left(tmp_path, monkeypatch):
    """A stop in the middle of a line costs that cell only; the rest is not run again."""
    wanted = [small(x="1"), small(x="2", **{FACE + "penalty": 10.0})]
    monkeypatch.setattr(stability_run, "cases", lambda quick: wanted)
    rows = matrix(tmp_path, workers=1, log=lambda line: None)
    assert counts(rows)["accurate"] == counts(rows)["caught"] == 1
    file = tmp_path / "cells.jsonl"
    file.write_text(file.read_text()[:-30])
    assert len(read(file)) == 1
    ran = []
    monkeypatch.setattr(stability_run, "judged_row", lambda c: ran.append(c) or judged_row(c))
    again = matrix(tmp_path, workers=1, log=lambda line: None)
    assert ran == wanted[1:] and counts(again) == counts(rows)
    assert (tmp_path / "cells.csv").read_text().count("\n") == 3


def test_figure_holds_every_cell(tmp_path):
    """Strips, grids and limits of made-up rows: drawn within 400 kB."""
    row = {"kind": "accurate", "measure": "ripple", "value": 0.01, "steps": 5}
    rows = [{"panel": c.panel, "x": c.x, "y": c.y, **row} for c in cases()]
    table = [{"case": "a", "key": "step", "ratio": 0.9}]
    path = draw(rows, table, tmp_path / "s.png")
    assert path.stat().st_size < 400_000
    assert json.dumps(rows)


def ended(penalty: float, friction: float, runs: int, round_off) -> int:
    """How many runs of the sliding block end, each with a round-off of its own."""
    changes = {**limits.SMALL, FACE + "friction": friction}
    dt = build(Scene.load("sliding-block", **changes)).dt
    scene = Scene.load("sliding-block", **changes, **{FACE + "penalty": penalty})
    found = 0
    for seed in range(runs):
        round_off(seed)
        found += bool(limits.blows_up(limits.restepped(build(scene), dt)))
    return found


def test_sliding_ends_where_landings_gain_energy(round_off):
    """Friction makes nodes hop, which no linear limit (3.3 here) knows. A hop takes a chaotic path,
    and from 3.1 on round-off decides whether a run ends. At p = 2, where a landing gains nothing in
    the mean, all go on; at 2.8, where it gains half, most end; frictionless they go on."""
    assert landing_gain(2.0) < 1e-6 < 0.5 < landing_gain(2.8)
    assert ended(2.0, 0.3, 3, round_off) == 0
    assert ended(2.8, 0.3, 5, round_off) >= 3
    assert ended(2.8, 0.0, 1, round_off) == 0


@pytest.mark.parametrize("kind", ["accurate", "unseen"])
def test_command_line(tmp_path, monkeypatch, kind):
    """One JSON object with the counts; a blow-up that no guard saw is an error that names it."""
    from typer.testing import CliRunner

    from workflow.cli.main import app
    from workflow.simulation.guards import GuardError

    row = {"key": "a | 1 | ", "panel": "a", "x": "1", "y": "", "kind": kind, "steps": 5,
           "measure": "ripple", "value": 0.01}  # fmt: skip
    monkeypatch.setattr(stability_run, "matrix", lambda *a, **k: [row])
    monkeypatch.setattr(limits, "limits", lambda *a, **k: [])
    done = CliRunner().invoke(app, ["stability", "--out", str(tmp_path), "--json"])
    found = json.loads(done.stdout)
    assert found["verdicts"][kind] == 1 and (tmp_path / "stability.png").is_file()
    assert isinstance(done.exception, GuardError) == (kind == "unseen")


def test_a_file_in_place_of_the_folder_is_refused(tmp_path):
    """Before any cell is run."""
    from typer.testing import CliRunner

    from workflow.cli.main import app

    (tmp_path / "file").write_text("")
    done = CliRunner().invoke(app, ["stability", "--out", str(tmp_path / "file")])
    assert isinstance(done.exception, SceneError)
    assert "expected a folder that can be written" in str(done.exception)
