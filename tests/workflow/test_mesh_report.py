# SPDX-License-Identifier: LGPL-3.0-or-later
"""The report of a mesh: steps against closed forms, sizes, masses, what it writes."""

import json

import numpy as np
import pytest

from workflow import Scene
from workflow.audit.figures import write
from workflow.audit.mesh import report, summary


def test_step_of_a_cube():
    """A cube of edge h by itself, ν = 0: half its mass on each face, ω = 2 c / h, dt = h / c."""
    h, speed = 1.25e-3, (210e9 / 7800) ** 0.5
    found = report(Scene.load("bar-wave"))
    assert np.ptp(found.steps) < 1e-9 * found.steps.min()
    assert found.steps[0] == pytest.approx(h / speed, rel=1e-9)
    assert found.assembled == pytest.approx(h / speed, rel=5e-3)


def test_sizes_masses_and_the_cells_that_set_the_step():
    """sliding-block: masses from the sides, the block's small cells are the stiffest."""
    found = summary(report(Scene.load("sliding-block")))
    assert found["bodies"]["block"]["mass"] == pytest.approx(7800 * 0.02**2 * 0.01, rel=1e-12)
    assert found["bodies"]["base"]["mass"] == pytest.approx(7800 * 0.04 * 0.03 * 0.01, rel=1e-12)
    assert found["volume"] == pytest.approx(found["volume_within_surface"], rel=1e-12)
    assert {cell["region"] for cell in found["stiffest_cells"]} == {"block"}
    assert found["step"]["cell"] <= found["stiffest_cells"][-1]["step"]
    assert found["cells"] == sum(body["cells"] for body in found["bodies"].values())
    assert found["scaled_jacobian"]["smallest"] == pytest.approx(1.0)


def test_figure_and_numbers_are_written(tmp_path):
    """mesh.json holds the summary, mesh.png is a picture."""
    found = report(Scene.load("sliding-block"))
    numbers, picture = write(found, tmp_path / "out")
    assert json.loads(numbers.read_text()) == summary(found)
    assert picture.read_bytes()[:4] == b"\x89PNG" and picture.stat().st_size > 50_000


def test_command(command, tmp_path, monkeypatch):
    """``squealx mesh --json`` prints one object; a bad key leaves with 2 before any meshing."""
    monkeypatch.chdir(tmp_path)
    words = ("mesh", "sliding-block", "--json")
    assert json.loads(command(*words, "--out", tmp_path / "m").stdout)["cells"] == 776
    wrong = command(*words, "--set", "mesh.size=-1", check=False)
    assert wrong.returncode == 2 and "mesh.size = -1" in wrong.stderr
