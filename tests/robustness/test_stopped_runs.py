# SPDX-License-Identifier: LGPL-3.0-or-later
"""Runs that are refused or go wrong: exit codes, messages and what is left, as users meet them."""

import json

import pytest

from workflow.results.record import Record

BAD = {
    "angle": (
        ("flange-transition", "rolling.angle_of_attack=0.3"),
        "rolling.angle_of_attack = 0.3: expected",
    ),
    "profile": (
        ("flange-transition", "mesh.rail_profile=worn.csv"),
        "mesh.rail_profile = 'worn.csv': profile worn.csv: no such file",
    ),
    "gap": (("flange-transition", "mesh.flange_gap=-1e-3"), "mesh.flange_gap = -0.001: expected"),
    "overlap": (
        ("bar-impact", "contacts.wall.target.origin=[0.01, 0.0, 0.0]"),
        "contacts.wall: bodies overlap at the start by 1.000e-02 m at node",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_exits_with_2(command, tmp_path, case):
    """One line that names the key, what it got and what it expects; no results are left."""
    (scene, change), message = BAD[case]
    done = command("run", scene, "--set", change, "--out", tmp_path / "out", "--json", check=False)
    assert (done.returncode, done.stdout) == (2, "")
    assert message in done.stderr and "Traceback" not in done.stderr
    assert not (tmp_path / "out" / "summary.json").exists()


STOPS = {
    "penalty": ("bar-impact", ["contacts.wall.penalty=400"], ["energy balance error", "penalty"]),
    "no energy guard": (
        "bar-wave",
        [
            *("time.safety=1.2", "guards.energy_error=1e99", "guards.check_interval=100000"),
            *("time.output_interval=1e-3", "time.end=1e-3"),
        ],
        ["non-finite acceleration at step", "body 'bar' (bar), node", "at x = "],
    ),
}


@pytest.mark.parametrize("case", STOPS)
@pytest.mark.parametrize("ranks", [1, pytest.param(2, marks=pytest.mark.mpi)])
def test_a_run_gone_wrong_exits_with_3_and_keeps_its_results(command, tmp_path, case, ranks):
    """A contact spring 2000 times too stiff, and a step 8 % over the limit with the guard off."""
    scene, changes, messages = STOPS[case]
    words = [word for change in changes for word in ("--set", change)]
    out = tmp_path / "out"
    done = command("run", scene, *words, "--ranks", ranks, "--out", out, check=False)
    assert done.returncode == 3 and "Traceback" not in done.stderr
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    for message in messages:
        assert message in done.stderr and message in summary["status"]
    assert summary["status"].startswith("stopped: ") and summary["steps"] > 0
    assert len(Record(tmp_path / "out").history["t"]) >= 1
