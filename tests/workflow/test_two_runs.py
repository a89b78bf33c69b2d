# SPDX-License-Identifier: LGPL-3.0-or-later
"""Two runs side by side: what differs is told, what does not is not; equal runs differ by zero."""

import json

import pytest

from workflow.report.comparison import compare, tables
from workflow.results.record import Record, whole

pytest.importorskip("matplotlib")

SHORT = {"time.end": 1e-5, "time.output_interval": 2e-6, "output.fields": False}


@pytest.fixture(scope="module")
def runs(run_scene) -> tuple[Record, Record]:
    """A bar of coarse and of fine cells on a wall."""
    return tuple(
        whole(run_scene("bar-impact", **SHORT, **{"mesh.size": h})) for h in (5e-3, 2.5e-3)
    )


def test_two_sizes(runs):
    """Twice as fine: one key differs, the step is half but for rounding, ρ c v A in both."""
    found = compare(*runs)
    assert [(row["key"], row["a"], row["b"]) for row in found["settings"]] == [
        ("mesh.size", 5e-3, 2.5e-3)
    ]
    cost = {row["quantity"]: row for row in found["cost"]}
    assert cost["dt"]["ratio"] == pytest.approx(0.5, rel=0.15)
    assert cost["steps"]["ratio"] == pytest.approx(1 / cost["dt"]["ratio"])
    forces = next(r for r in found["history"] if r["quantity"] == "wall_normal_force")
    exact = (210e9 * 7800) ** 0.5 * 25e-6  # ρ c v A at 1 m/s
    assert forces["a"] == pytest.approx(exact, rel=0.12)  # as the bar rings
    assert forces["b"] == pytest.approx(exact, rel=0.12)  # as the bar rings
    assert 0 < forces["rms"] <= forces["largest"] < 0.3


def test_a_run_and_itself(runs):
    """No key differs, nothing is apart, every ratio is one."""
    found = compare(runs[0], runs[0])
    assert found["settings"] == []
    assert {row["largest"] for row in found["history"]} == {0.0}
    assert {row["ratio"] for row in found["cost"]} <= {1.0, None}
    assert next(t.heads[0] for t in tables(found)) == "cost"  # no table without a row


def test_command(runs, command, tmp_path):
    """Prints what ``compare`` finds and draws a picture; a name of no picture ends with code 2."""
    folders = [run.folder for run in runs]
    picture = tmp_path / "both.png"
    done = command("compare", *folders, "--figure", picture, "--json")
    found = json.loads(done.stdout)
    assert found["settings"][0]["key"] == "mesh.size"
    assert found["figure"] == str(picture)
    assert picture.read_bytes().startswith(b"\x89PNG")
    done = command("compare", *folders, "--figure", tmp_path / "both.doc", check=False)
    assert done.returncode == 2
    assert "--figure" in done.stderr
    done = command("compare", folders[0], tmp_path, check=False)
    assert done.returncode == 2
    assert "scene.toml" in done.stderr
