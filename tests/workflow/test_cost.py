# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cost before work: cells without a mesh, steps, limits that name their key."""

import json
import re
import shutil

import pytest

from workflow import Scene
from workflow.model import cost as costs
from workflow.model.checks import check
from workflow.model.geometry import mesh_of
from workflow.scene.scene import SceneError, names

SCENES = {name: Scene.load(name) for name in names()}
SHAPES = [name for name, scene in SCENES.items() if scene.mesh.kind != "wheel-on-rail"]
WHEELS = sorted(SCENES.keys() - SHAPES)
ABOUT = {"flange-resolved": 105_000, "flange-transition": 65_500, "steady-curving": 97_000}


@pytest.mark.parametrize("name", SHAPES)
def test_cells_of_shapes_are_counted(name):
    """As many cells and nodes as the mesh then has, to the last."""
    mesh, _ = mesh_of(SCENES[name])
    found = costs.cost_of(SCENES[name])
    assert (found.cells, found.nodes) == (len(mesh.cells), len(mesh.points))
    assert found.cells_within == 0


@pytest.mark.parametrize("name", ABOUT)
def test_cells_of_a_wheel_on_a_rail_are_estimated(name):
    """Within 10 % of what the scene says of itself, which its mesh was counted for."""
    told = int(re.match(r"[\d ]+", SCENES[name].about)[0].replace(" ", ""))
    assert told == pytest.approx(ABOUT[name], rel=0.01)
    assert costs.cost_of(SCENES[name]).cells == pytest.approx(told, rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("change", [{}, {"mesh.size": 8e-3}, {"mesh.strip.size": 4e-3}])
def test_cells_of_a_wheel_on_a_rail_as_meshed(change):
    """Within 10 % of the mesh of wheel and rail, with and without narrow cells."""
    scene = Scene.load("two-patches", **change)
    mesh, _ = mesh_of(scene)
    assert costs.cost_of(scene).cells == pytest.approx(len(mesh.cells), rel=0.1)


def test_step_of_a_bar():
    """Edge over wave speed, 1.25 mm / 5189 m/s = 0.241 µs, less the springs; 540 steps in 60 µs."""
    found = costs.cost_of(SCENES["bar-impact"])
    assert found.step == pytest.approx(1e-6 / 9, rel=0.2)
    assert (found.outputs, found.samples) == (61, 0)
    assert found.steps == pytest.approx(540, rel=0.2)


def test_damping_shortens_the_step():
    """2/ω (√(1 + ξ²) − ξ) with ξ = β ω / 2 = 10, near 2/(β ω²) = 1/20 of 2/ω."""
    bare, edge = SCENES["bar-wave"], 1e-3
    omega = 2 / costs.bound_of(bare, edge)
    damped = bare.with_(**{"bodies.bar.stiffness_damping": 20 / omega})
    assert costs.bound_of(damped, edge) * omega / 2 == pytest.approx(1 / 20, rel=0.01)


LIMITS = {
    "memory": ("bar-wave", {"mesh.size": 1e-6}, r"mesh.size = 1e-06: 2.5e\+12 cells .* or more"),
    "layers": ("carter", {"mesh.layers": 10**12}, "mesh.size = 0.0003: 3.85e"),
    "coarse": ("bar-wave", {"mesh.size": 0.1}, "mesh.size = 0.1: coarser than the body"),
    "base": ("two-bars", {"mesh.base_size": 0.1}, "mesh.base_size = 0.1: coarser than the body"),
    "outputs": ("bar-wave", {"time.output_interval": 1e-15}, "time.output_interval = 1e-15"),
    "samples": ("bar-wave", {"output.sample_interval": 1e-15}, "output.sample_interval = 1e-15"),
    "steps": ("bar-wave", {"bodies.bar.stiffness_damping": 1e9}, "time.end = 8e-05: about"),
    "wheel": ("two-patches", {"mesh.size": 0.01}, "mesh.size = 0.01: expected 0.0005 to 0.008 m"),
    "strip": ("two-patches", {"mesh.strip.size": 1e-9}, "mesh.strip.size = 1e-09"),
    "sleepers": (
        "flange-transition",
        {"mesh.sleepers.cells": [10**9, 10**9, 1]},
        "cells take about .* of memory",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", LIMITS)
def test_too_much_is_refused_with_its_key(case):
    """Before a mesh is made, whatever the size."""
    name, change, told = LIMITS[case]
    with pytest.raises(SceneError, match=told):
        check(Scene.load(name, **change))


def test_the_size_that_fits_does_fit():
    """The message names a size that is accepted, and one a third smaller is not."""
    with pytest.raises(SceneError) as refused:
        check(Scene.load("bar-wave", **{"mesh.size": 1e-6}))
    size = float(re.search(r"expected (\S+) m or more", str(refused.value))[1])
    check(Scene.load("bar-wave", **{"mesh.size": 1.05 * size}))
    with pytest.raises(SceneError):
        check(Scene.load("bar-wave", **{"mesh.size": size / 1.5}))


def test_validate_prints_the_cost(command):
    """In words and as JSON; doubts beside it."""
    done = command("validate", "bar-impact", "--set", "contacts.wall.penalty=5.0", "--json")
    found = json.loads(done.stdout)
    assert found["cost"]["cells"] == 1280 and found["cost"]["memory"] > 1e8
    assert found["doubts"] == ["contacts.wall.penalty = 5.0: leaves no room in the step"]


def test_a_run_logs_what_it_expects_and_doubts(run_scene):
    """Before the mesh: cost and doubts, in run.log."""
    folder = run_scene("bar-impact", **{"mesh.size": 0.005, "time.safety": 1.05})
    lines = (folder / "run.log").read_text().splitlines()
    starts = "cost: 20 cells, about ", "doubt: time.safety = 1.05: beyond", "mesh: 20 cells"
    order = [next(k for k, line in enumerate(lines) if text in line) for text in starts]
    assert order == sorted(order)


@pytest.mark.parametrize("name", ["bar-impact", "sliding-block"])
def test_disk_of_a_run(run_scene, name):
    """Results, fields and checkpoint take what was estimated, to a factor of 2."""
    change = {"mesh.size": 5e-3, "time.end": 4e-5}
    folder = run_scene(name, **change)
    sizes = [path.stat().st_size for path in folder.rglob("*") if path.is_file()]
    estimate = costs.cost_of(Scene.load(name, **change)).disk
    assert sum(sizes) / 2 < estimate < sum(sizes) * 2


def test_room_is_that_of_the_disk_and_of_what_is_there(tmp_path):
    """Free bytes of the disk of the folder that is there; a run that goes on has its results."""
    free = shutil.disk_usage(tmp_path).free
    assert costs.room_for(tmp_path / "a" / "b") == pytest.approx(free, rel=0.1)
    (tmp_path / "a").mkdir()
    with (tmp_path / "a" / "results.h5").open("wb") as file:
        file.truncate(10**12)  # of holes
    assert costs.room_for(tmp_path / "a") == pytest.approx(free + 10**12, rel=1e-2)


@pytest.mark.parametrize(("share", "told"), [(0.4, "refused"), (0.9, "doubted"), (3.0, "")])
def test_a_disk_with_little_room(command, monkeypatch, tmp_path, share, told):
    """Room for 0.4 of the results: refused by validate and run with the key, before the mesh; for
    0.9 doubted, the estimate is good to a factor of 2; for 3, nothing is said.
    """
    words = ("bar-impact", "--set", "mesh.size=5e-3", "--set", "time.end=4e-6")
    need = json.loads(command("validate", *words, "--json").stdout)["cost"]["disk"]
    monkeypatch.setattr("workflow.model.checks.room_for", lambda folder: share * need)
    line = "time.output_interval = 1e-06: 5 outputs of 84 nodes take about .*room for"
    for verb in ("validate", "run"):
        done = command(verb, *words, "--out", tmp_path / verb, check=False)
        assert done.returncode == (2 if told == "refused" else 0)
        assert bool(re.search(line, done.stdout + done.stderr)) == bool(told)
        assert ("mesh: " in done.stderr) == (verb == "run" and told != "refused")
    assert (tmp_path / "run").exists() == (told != "refused")
