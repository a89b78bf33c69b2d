# SPDX-License-Identifier: LGPL-3.0-or-later
"""Zones of bodies that may yield."""

import json

import h5py
import numpy as np
import pytest

from workflow import Scene, run

NEAR = {"box": [[-1.0, -1.0, -1.0], [0.05, 1.0, 1.0]]}  # the half of the bar at the wall
SLOW = {"mesh.size": 2.5e-3, "bodies.bar.velocity": [-10.0, 0.0, 0.0]}

KINDS = [("full", "small-strain"), ("selective", "total-lagrangian")]
KINDS += [pytest.param("one-point", "total-lagrangian", marks=pytest.mark.slow)]


def history(folder):
    """Return the history of a run."""
    with h5py.File(folder / "results.h5") as file:
        return {name: data[:] for name, data in file["history"].items()}


@pytest.mark.parametrize(("element", "kinematics"), KINDS)
def test_what_does_not_yield_is_one_body(run_scene, element, kinematics):
    """A wave through the border of a zone, nothing yields: the whole body's run to round-off."""
    keys = SLOW | {"bodies.bar.element": element, "bodies.bar.kinematics": kinematics}
    whole, zoned = (
        history(run_scene("plastic-bar", **keys, **zone))
        for zone in ({}, {"bodies.bar.yielding": NEAR})
    )
    assert whole["internal"][-1] > 0.1 * whole["kinetic"][0]
    for name in ("kinetic", "internal", "wall_normal_force"):
        largest = np.abs(whole[name]).max()
        np.testing.assert_allclose(zoned[name], whole[name], rtol=0, atol=1e-12 * largest)


def test_yielding_inside_a_zone_is_that_of_the_whole_body(resting):
    """A ball pressed far into yield: 3.5 mm below the contact do for what 20 mm give, to 1e-11."""
    steel = {"law": "j2", "youngs_modulus": 210e9, "poisson_ratio": 0.3, "density": 7800.0}
    steel |= {"yield_stress": 294e6, "hardening_modulus": 2e9}
    keys = {"mesh.size": 1e-3} | {f"bodies.{n}.material": steel for n in ("sphere", "flat")}
    zone = {f"bodies.{name}.yielding": {"depth": 3.5e-3} for name in ("sphere", "flat")}
    found = []
    for model in (resting("hertz", **keys, fresh=True), resting("hertz", **keys, **zone)):
        force, strain = model.state.a.array.copy(), []
        memories = [item for item in model.items if hasattr(item, "cell_means")]
        for item in memories:
            item.points.force(model.state.u).add(force, renew=True)
            strain.append(item.cell_means("equivalent_plastic_strain"))
        counts = [item.yielding["cells"] for item in memories]
        found.append((model.state.u.x.array, np.sum(strain, axis=0), counts))
    (u, strain, whole), (zoned_u, zoned_strain, cells) = found
    assert whole == [729, 729] and cells == [243, 243]
    assert strain.max() > 1e-3
    np.testing.assert_allclose(zoned_u, u, rtol=0, atol=1e-11 * np.abs(u).max())
    np.testing.assert_allclose(zoned_strain, strain, rtol=0, atol=1e-9 * strain.max())


def test_what_yields_at_the_border_is_told(tmp_path):
    """At 20 m/s the plastic wave runs 13 mm into a zone of 10 mm: four cells, in log and summary.

    The same bar with a zone of 50 mm has none; of its 160 cells, 80 have a memory, half the bytes.
    """
    found = {}
    for name, end in (("narrow", 0.01), ("wide", 0.05)):
        keys = {"bodies.bar.yielding": {"box": [[-1.0, -1.0, -1.0], [end, 1.0, 1.0]]}}
        scene = Scene.load("plastic-bar", **keys, **{"mesh.size": 2.5e-3, "time.end": 8e-6})
        folder = run(scene, tmp_path / name, quiet=True).folder
        table = json.loads((folder / "summary.json").read_text())["yielding"]["bar"]
        found[name] = table, (folder / "run.log").read_text()
    table, log = found["narrow"]
    assert (table["cells"], table["cells_of_body"], table["yielded_at_border"]) == (16, 160, 4)
    assert log.count("4 cells at the border of the zone have yielded") == 1
    assert "bodies.bar: 16 of 160 cells may yield" in log
    table, log = found["wide"]
    assert (table["cells"], table["yielded_at_border"]) == (80, 0)
    assert table["bytes"] == 80 * 8 * 7 * 8  # 8 points with 7 numbers of 8 bytes
    assert "border" not in log


@pytest.mark.parametrize(
    ("scene", "keys", "words"),
    [
        ("plastic-bar", {"yielding": {}}, "yielding: expected depth, box or both, got neither"),
        ("plastic-bar", {"yielding": {"depth": 1e-4}}, "yielding.depth = 0.0001: no centre"),
        (
            "plastic-bar",
            {"yielding": {"box": [[1, 0, 0], [0, 1, 1]]}},
            "yielding.box = [[1.0, 0.0, 0.0], [0.0",
        ),
        (
            "plastic-bar",
            {"yielding": {"box": [[1.0, 0.0, 0.0], [2.0, 1.0, 1.0]]}},
            "yielding.box = [[1.0, 0.0, 0.0], [2.0, 1.0, 1.0]]: no centre of a cell is in it",
        ),
        ("bar-wave", {"yielding": NEAR}, "yielding: expected material.law = 'j2', got 'hooke'"),
        ("bar-wave", "steel", "yielding.depth: expected a contact of the body, got none"),
    ],
)
def test_zones_without_cells_are_refused(command, tmp_path, scene, keys, words):
    """Empty, upside down, without contact or memory: `validate` and `run` name the key, code 2."""
    if keys == "steel":
        material = Scene.load("plastic-bar").tables()["bodies"]["bar"]["material"]
        keys = {"yielding": {"depth": 1e-3}, "material": material}
    table = Scene.load(scene).tables()
    table["bodies"]["bar"] |= keys
    path = tmp_path / "scene.toml"
    path.write_text(as_toml(table))
    for words_of in (("validate", path), ("run", path, "--out", tmp_path / "out")):
        done = command(*words_of, check=False)
        assert done.returncode == 2, done.stdout
        assert f"bodies.bar.{words}" in done.stderr


def as_toml(table):
    """Return nested tables as TOML."""
    from workflow.scene.reference import toml

    return "\n".join(f"{key} = {toml(value)}" for key, value in table.items())
