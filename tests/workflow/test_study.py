# SPDX-License-Identifier: LGPL-3.0-or-later
"""Studies: what is refused, what is run, what is kept when it is killed, and what is compared."""

import csv
import json
import os
import signal
import subprocess
import sys

import numpy as np
import pytest
import tomli_w

from tests.processes import below, until
from workflow import Scene
from workflow.results.lock import locked
from workflow.results.record import Record
from workflow.scene.scene import SceneError
from workflow.simulation.ranks import tie
from workflow.study import folder, jobs, study
from workflow.study.figures import COMPARISONS
from workflow.study.table import worst_of_patches

pytest.importorskip("snakemake")

# bar-wave in a second or less
QUICK = {"time": {"end": 4e-6, "output_interval": 1e-6}, "mesh": {"size": 2.5e-3}}


@pytest.fixture
def told(command):
    """Run the command in this process: exit code, stdout, stderr."""

    def call(*words):
        done = command(*words, check=False)
        return done.returncode, done.stdout, done.stderr

    return call


@pytest.fixture
def written(tmp_path):
    """Write the tables of a study and return the path."""

    def write(**tables):
        path = tmp_path / "small.toml"
        whole = {"name": "small", "title": "A small study", "figures": False} | tables
        path.write_text(tomli_w.dumps(whole), encoding="utf-8")
        return path

    return write


def test_rows_and_grid_make_the_runs(written):
    """Every row at every point of the grid; keys of a row belong together."""
    path = written(
        scene="bar-wave",
        set=QUICK,
        runs=[
            {"name": "coarse one", "mesh": {"size": 5e-3}},
            {"name": "fine", "mesh.size": 2.5e-3, "ranks": 2},
        ],
        vary={"time": {"safety": [0.5, 0.9], "precision": ["float64", "float32"]}},
    )
    runs = study.runs_of(study.load(path), {"time.end": 2e-6})
    assert len(runs) == 8 and len({run.name for run in runs}) == 8
    assert runs[0].name == "coarse-one_safety=0.5_precision=float64"
    assert [run.scene.mesh.size for run in runs] == [5e-3] * 4 + [2.5e-3] * 4
    assert [run.ranks for run in runs] == [1] * 4 + [2] * 4
    assert [run.scene.time.safety for run in runs] == [0.5, 0.5, 0.9, 0.9] * 2
    assert {run.scene.time.end for run in runs} == {2e-6}
    assert runs[-1].changes == {
        "ranks": 2,
        "mesh.size": 2.5e-3,
        "time.safety": 0.9,
        "time.precision": "float32",
    }


def test_groups_share_what_is_set(written, tmp_path):
    """Each group has its scenes, built in or beside the file; ``set`` of the study holds in all."""
    own = Scene.load("sliding-block", **{"contacts.face.friction": 0.1}).tables()
    (tmp_path / "own.toml").write_text(tomli_w.dumps(own), encoding="utf-8")
    path = written(
        set={"time": {"safety": 0.4}},
        groups=[
            {"name": "bar", "scene": "bar-wave", "set": QUICK, "runs": [{"name": "plain"}]},
            {"name": "block", "vary": {"scene": ["sliding-block", "own.toml"]}},
        ],
    )
    bar, *blocks = study.runs_of(study.load(path))
    assert (bar.name, bar.group, bar.changes) == ("bar_plain", "bar", {})
    assert bar.scene.time.end == QUICK["time"]["end"]
    assert [block.name for block in blocks] == ["block_scene=sliding-block", "block_scene=own"]
    assert [block.scene.contacts["face"].friction for block in blocks] == [0.3, 0.1]
    assert {run.scene.time.safety for run in (bar, *blocks)} == {0.4}


def test_a_table_takes_the_place_of_a_value(written):
    """A law of friction instead of a coefficient."""
    law = {"law": "exponential", "static": 0.4, "kinetic": 0.2, "decay": 3.0}
    path = written(scene="sliding-block", vary={"contacts.face.friction": [0.3, law]})
    plain, exponential = study.runs_of(study.load(path))
    assert plain.scene.contacts["face"].friction == 0.3
    assert exponential.scene.contacts["face"].friction.law == "exponential"


BAD = {
    "unknown key": ({"colour": 1, "vary": {}}, "colour = 1: unknown key"),
    "no runs": ({"scene": "bar-wave"}, "runs: missing"),
    "no scene": ({"vary": {"mesh.size": [1e-3]}}, "scene: missing"),
    "other scene": ({"scene": "nowhere", "vary": {"mesh.size": [1e-3]}}, "scene 'nowhere'"),
    "not a list": ({"scene": "bar-wave", "vary": {"mesh.size": 1e-3}}, "vary.mesh.size = 0.001"),
    "bad value": (
        {"scene": "bar-wave", "vary": {"mesh.size": [1e-3, -1.0]}},
        "run size=-1.0: mesh.size = -1.0: expected greater than 0 [m]",
    ),
    "bad key": ({"scene": "bar-wave", "runs": [{"name": "a", "m.n": 1}]}, "run a: m"),
    "twice": ({"scene": "bar-wave", "runs": [{"name": "a"}] * 2}, "run a: expected one of"),
    "row and grid": (
        {"scene": "bar-wave", "runs": [{"mesh.size": 1e-3}], "vary": {"mesh.size": [2e-3]}},
        "vary.mesh.size",
    ),
    "ranks": ({"scene": "bar-wave", "runs": [{"name": "a", "ranks": 0}]}, "ranks = 0"),
    "figure": ({"vary": {"mesh.size": [1e-3]}, "compare": ["colours"]}, "compare.0 = 'colours'"),
    "too many": (
        {"scene": "bar-wave", "vary": {"mesh.size": [1e-3] * 1000, "time.end": [1e-5] * 10**6}},
        "vary: 1e+09 runs (1000 of mesh.size times 1000000 of time.end); expected at most 10000",
    ),
    "name": ({"name": "a/b", "vary": {"mesh.size": [1e-3]}}, "name = 'a/b'"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_studies_are_refused(written, case):
    """The message names the key, what it got and what it expects."""
    tables, message = BAD[case]
    with pytest.raises(SceneError) as caught:
        study.runs_of(study.load(written(**tables)))
    assert message in str(caught.value)


def test_a_set_key_may_not_be_varied(written):
    """``--set`` of what the runs differ in would make them alike."""
    path = written(scene="bar-wave", vary={"mesh.size": [5e-3, 2.5e-3]})
    with pytest.raises(SceneError, match=r"--set mesh\.size: expected a key that the study does"):
        study.runs_of(study.load(path), {"mesh.size": 1e-3})


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(n, marks=pytest.mark.long if n == "patches-against-time" else ())
        for n in study.names()
    ],
)
def test_built_in_studies_are_valid(name):
    """Every run of theirs, and every comparison they ask for."""
    asked = study.load(name)
    assert len(study.runs_of(asked)) >= 3 and asked.name == name and asked.about
    assert set(asked.compare) <= set(COMPARISONS)


def test_bad_input_exits_with_two_and_writes_nothing(told, written, tmp_path):
    """All scenes are checked before anything is done; an unknown study names those that are."""
    path = written(scene="bar-wave", set=QUICK, vary={"mesh.size": [5e-3, 0.0]})
    code, out, err = told("study", path, "--out", tmp_path / "out")
    assert (code, out) == (2, "") and "run size=0.0: mesh.size = 0.0" in err
    assert not (tmp_path / "out").exists()
    code, _, err = told("study", "nowhere")
    assert code == 2 and all(name in err for name in study.names())


def test_dry_run_lists_and_writes_nothing(told, written, tmp_path):
    """Names, parameters and state of every run."""
    path = written(scene="bar-wave", set=QUICK, vary={"time.safety": [0.5, 0.9]})
    code, out, _ = told("study", path, "--out", tmp_path / "out", "--dry-run", "--json")
    found = json.loads(out)
    assert code == 0 and not (tmp_path / "out").exists()
    assert [run["run"] for run in found["runs"]] == ["safety=0.5", "safety=0.9"]
    assert found["runs"][0]["changes"] == {"time.safety": 0.5}
    assert {run["state"] for run in found["runs"]} == {"to do"}


def test_studies_are_listed(told):
    """As JSON, with their titles."""
    code, out, _ = told("studies", "--json")
    assert code == 0 and list(json.loads(out)) == study.names()


@pytest.mark.slow
def test_a_failing_run_does_not_stop_the_others_and_is_told(told, written, tmp_path):
    """Exit 3; the others are done and compared; done again, only what is missing is tried.

    A penalty far over the limit blows the bar up, which the guards find.
    """
    wall = {"contacts": {"wall": {"penalty": 60.0}}}
    path = written(
        scene="bar-impact",
        set={"time": {"end": 10e-6}, "mesh": {"size": 2.5e-3}, "output": {"fields": False}},
        runs=[{"name": "wild", "time": {"safety": 1.1}} | wall, {"name": "fine"}],
        compare=["error_against_time"],
    )
    code, out, err = told("study", path, "--out", tmp_path / "out", "--json")
    found = json.loads(out)
    by_name = {run["run"]: run for run in found["runs"]}
    assert code == 3 and out.count("\n") == 1
    assert "1 of 2 runs did not finish" in err and "wild: stopped: " in err
    assert by_name["wild"]["status"].startswith("stopped: ")
    assert by_name["fine"]["status"] == "done" and by_name["fine"]["cells"] == 160
    with (tmp_path / "out" / "table.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["run"] for row in rows] == ["wild", "fine"]
    assert float(rows[1]["steps"]) == by_name["fine"]["steps"]
    made = (tmp_path / "out" / "runs" / "fine" / "summary.json").stat().st_mtime_ns
    code, _, err = told("study", path, "--out", tmp_path / "out")
    assert code == 3 and "2 runs, 1 done before, 1 to do" in err
    assert (tmp_path / "out" / "runs" / "fine" / "summary.json").stat().st_mtime_ns == made


@pytest.mark.slow
def test_a_killed_study_goes_on(told, written, tmp_path):
    """Killed with its runs in the middle of one; started again it goes on from the checkpoint.

    The history is bitwise that of the same scene run alone.
    """
    slow = {"time": {"end": 400e-6, "output_interval": 2e-5}, "output": {"checkpoint_steps": 100}}
    path = written(
        scene="bar-wave", set=slow | {"mesh": {"size": 2.5e-3}}, vary={"time.safety": [0.4]}
    )
    out = tmp_path / "out"
    run = out / "runs" / "safety=0.4"
    command = [
        sys.executable,
        "-m",
        "workflow.cli",
        "study",
        str(path),
        "--out",
        str(out),
    ]
    process = subprocess.Popen(
        command, stderr=subprocess.PIPE, stdout=subprocess.PIPE, preexec_fn=tie()
    )
    try:
        until(lambda: (run / "checkpoint" / "state.npz").exists())
        with pytest.raises(SceneError, match="another squealx study"), locked(out, "a test"):
            pass
    finally:
        for pid in [process.pid, *below(process.pid)]:
            os.kill(pid, signal.SIGKILL)
        process.communicate()
    assert not folder.done(out, "safety=0.4")
    assert folder.state(out, "safety=0.4") == "begun"
    code, _, err = told("study", path, "--out", out)
    assert code == 0 and "1 runs, 0 done before, 1 to do" in err
    assert "resumed at step" in (run / "run.log").read_text(encoding="utf-8")
    alone = tmp_path / "alone"
    assert told("run", out / "scenes" / "safety=0.4.toml", "--out", alone)[0] == 0
    for name, column in Record(alone).history.items():
        np.testing.assert_array_equal(column, Record(run).history[name])


@pytest.mark.slow
def test_an_interrupted_study_leaves_nothing_behind(written, tmp_path):
    """SIGTERM, as a queue or a time limit sends it: Snakemake and its jobs end too."""
    slow = {"time": {"end": 1.0, "output_interval": 4e-5}, "mesh": {"size": 2.5e-3}}
    path = written(scene="bar-wave", set=slow, vary={"time.safety": [0.4]})
    out = tmp_path / "out"
    command = [
        sys.executable,
        "-m",
        "workflow.cli",
        "study",
        str(path),
        "--out",
        str(out),
    ]
    process = subprocess.Popen(
        command, stderr=subprocess.PIPE, stdout=subprocess.PIPE, preexec_fn=tie()
    )
    try:
        until(lambda: folder.share(out, "safety=0.4") > 0)
        family = below(process.pid)
    finally:
        process.terminate()
        process.communicate(timeout=200)
    assert process.returncode == 130 and len(family) >= 2
    assert not [pid for pid in family if os.path.exists(f"/proc/{pid}")]
    with locked(out, "a test"):
        assert folder.state(out, "safety=0.4") != "done"


def test_another_scene_in_the_folder_is_refused(written, tmp_path):
    """A run that was made with other settings is not taken for this one; the key is named."""
    path = written(scene="bar-wave", set=QUICK, vary={"time.safety": [0.5]})
    runs = study.runs_of(study.load(path))
    made = tmp_path / "out" / "runs" / runs[0].name
    made.mkdir(parents=True)
    scene = runs[0].scene.with_(**{"time.end": 5e-6})
    (made / "scene.toml").write_text(tomli_w.dumps(scene.tables()), encoding="utf-8")
    with pytest.raises(SceneError, match=r"made with another time\.end"):
        folder.check(runs, tmp_path / "out")


def test_what_snakemake_cannot_do_is_refused(written, tmp_path, monkeypatch):
    """More ranks than cores without a cluster, no such profile, no Snakemake."""
    path = written(scene="bar-wave", ranks=64, vary={"time.safety": [0.5]})
    runs = study.runs_of(study.load(path))
    with pytest.raises(SceneError, match=r"ranks = 64: expected at most 2 cores"):
        jobs.check(runs, 2, None)
    with pytest.raises(SceneError, match=r"--profile .*expected the folder of a Snakemake profile"):
        jobs.check(runs, None, tmp_path)
    (tmp_path / "config.yaml").write_text("jobs: 2\n", encoding="utf-8")
    jobs.check(runs, None, tmp_path)
    monkeypatch.setattr(jobs, "find_spec", lambda name: None)
    with pytest.raises(SceneError, match=r"pip install 'squealx\[study\]'"):
        jobs.check(runs, None, tmp_path)


def test_error_of_a_wheel_is_that_of_its_worst_patch():
    """Areas and peaks, while it rolls rather than at rest; the first answer if none is there."""

    def answer(quantity, error):
        return {"quantity": quantity, "error": error}

    weight, rest = answer("vertical force at rest", 1e-3), answer("patch 1 at rest: area", -0.3)
    assert worst_of_patches([weight]) is weight
    assert worst_of_patches([weight, rest, answer("patch 2 at rest: half axis along", 1.0)]) is rest
    area = answer("patch 1 rolling, mean of 6 outputs: area", 0.05)
    peak = answer("patch 2 rolling, mean of 6 outputs: peak pressure", -0.1)
    assert worst_of_patches([weight, rest, area, peak]) is peak
