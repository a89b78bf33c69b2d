# SPDX-License-Identifier: LGPL-3.0-or-later
"""Logs of a run: text, and with ``output.log = "json"`` an object a line for machines."""

import json
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from workflow import Scene, read_run, run
from workflow.simulation.guards import GuardError

BAR = {"mesh.size": 5e-3, "output.log": "json", "output.fields": False}


def objects(folder: Path) -> list[dict[str, Any]]:
    """The lines of ``run.jsonl``, each an object."""
    return [json.loads(line) for line in (folder / "run.jsonl").read_text("utf-8").splitlines()]


def test_every_line_of_the_log_is_an_object(run_scene):
    """The same messages in the same order; times in UTC; the phases of a run; the end of it."""
    folder, now = run_scene("bar-impact", **BAR), datetime.now(UTC)
    lines, text = objects(folder), (folder / "run.log").read_text("utf-8").splitlines()
    assert [line["message"] for line in lines] == [line[9:] for line in text]
    times = [datetime.fromisoformat(line["time"]) for line in lines]
    assert times == sorted(times) and now - timedelta(hours=1) < times[0] <= times[-1] <= now
    phases = list(dict.fromkeys(line["phase"] for line in lines))
    assert phases[:2] == ["start", "mesh"] and phases[-1] == "stepping"
    assert lines[-1]["message"] == "done" and {line["level"] for line in lines} == {"info"}


def test_outputs_carry_their_numbers(run_scene):
    """At each output step, time, rate, time remaining and the row of the history."""
    folder = run_scene("bar-impact", **BAR)
    history = read_run(folder).history
    outputs = [line for line in objects(folder) if "balance_error" in line]
    assert len(outputs) == len(history["t"])
    for name, column in history.items():
        np.testing.assert_array_equal([line[name] for line in outputs], column)
    last = outputs[-1]
    assert last["step"] == last["steps"] and last["seconds_left"] == 0
    assert last["t"] == pytest.approx(last["step"] * last["dt"])


def test_lines_are_there_while_it_runs(tmp_path):
    """Each is flushed at once: in the middle of a run the file has whole lines up to then."""
    seen = []

    def watch(model):
        if model.state.step == 20:
            seen.extend(objects(tmp_path / "run"))

    scene = Scene.load("bar-impact", **BAR | {"time.end": 1e-5})
    run(scene, tmp_path / "run", quiet=True, watch=watch)
    steps = [line["step"] for line in seen if "step" in line]
    assert steps and 10 < max(steps) <= 20 and len(seen) < len(objects(tmp_path / "run"))


def test_run_that_is_stopped_ends_with_an_error(tmp_path):
    """A guard: the last line has its reason and the level of an error, in both logs."""
    scene = Scene.load("bar-impact", **BAR, **{"guards.penetration": 1e-9})
    with pytest.raises(GuardError, match="penetration"):
        run(scene, tmp_path / "run", quiet=True)
    last = objects(tmp_path / "run")[-1]
    assert last["level"] == "error" and "guards.penetration" in last["message"]
    assert "guards.penetration" in (tmp_path / "run" / "run.log").read_text().splitlines()[-1]


def test_resumed_run_goes_on_below(tmp_path):
    """Lines of both runs; a run without the key leaves the file alone."""
    scene = Scene.load("bar-impact", **BAR)
    run(scene.with_(**{"time.end": 1e-5}), tmp_path / "run", quiet=True)
    first = objects(tmp_path / "run")
    run(scene.with_(**{"time.end": 2e-5}), tmp_path / "run", quiet=True, resume=True)
    lines = objects(tmp_path / "run")
    assert lines[: len(first)] == first and any("resumed" in line["message"] for line in lines)
    plain = scene.with_(**{"time.end": 3e-5, "output.log": "text"})
    run(plain, tmp_path / "run", quiet=True, resume=True)
    assert objects(tmp_path / "run") == lines


def test_only_where_it_is_asked_for(run_scene):
    """Without the key there is no such file."""
    changes = {"mesh.size": 5e-3, "output.fields": False}
    assert not (run_scene("bar-impact", **changes) / "run.jsonl").exists()


@pytest.mark.slow
@pytest.mark.mpi
def test_one_log_of_two_ranks(squealx, tmp_path):
    """Rank 0 writes each line once."""
    words = [f"--set={key}={str(value).lower()}" for key, value in BAR.items()]
    squealx(
        "run", "bar-impact", *words, "--set=time.end=1e-5", "--ranks", 2, "--out", tmp_path / "r"
    )
    messages = [line["message"] for line in objects(tmp_path / "r")]
    assert len([m for m in messages if m.startswith("stepping:")]) == 1 and messages[-1] == "done"
