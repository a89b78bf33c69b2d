# SPDX-License-Identifier: LGPL-3.0-or-later
"""Zones of bodies, that may yield or have another element."""

import json

import h5py
import numpy as np
import pytest

from workflow import Scene, run
from workflow.model.model import build

NEAR = {"box": [[-1.0, -1.0, -1.0], [0.05, 1.0, 1.0]]}  # the half of the bar at the wall
SLOW = {"mesh.size": 2.5e-3, "bodies.bar.velocity": [-10.0, 0.0, 0.0]}

KINDS = [("full", "small-strain"), ("selective", "total-lagrangian")]
KINDS += [pytest.param("one-point", "total-lagrangian", marks=[pytest.mark.slow, pytest.mark.long])]


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


ALL = {"box": [[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]]}
RODS = {"mesh.size": 2.5e-3, "bodies.bar.material.poisson_ratio": 0.3}


@pytest.mark.parametrize("ranks", [1, 2])
def test_a_contact_zone_has_the_element_that_it_names(run_scene, mpirun, tmp_path, ranks):
    """A zone over the whole bar: the histories are those of its element, and not the bulk's.

    Half of it: energy is kept as well as without, 1e-9 of it, on one rank and on two alike.
    """
    one_point, full = (
        history(run_scene("bar-impact", **RODS, **{"bodies.bar.element": element}))
        for element in ("one-point", "full")
    )
    zoned, half = (
        history(
            run_scene(
                "bar-impact",
                **RODS,
                **{"bodies.bar.element": "one-point", "bodies.bar.contact_zone": box},
            )
        )
        for box in (ALL, NEAR)
    )
    force = "wall_normal_force"
    largest = full[force].max()
    np.testing.assert_allclose(zoned[force], full[force], rtol=0, atol=1e-11 * largest)
    assert np.abs(one_point[force] - full[force]).max() > 1e-4 * largest
    between = np.abs(half[force] - full[force]).max() / largest
    assert 1e-6 < between < 0.1
    if ranks == 2:
        words = [f"--set=bodies.bar.contact_zone={{box={NEAR['box']}}}"]
        words += [f"--set={k}={v}" for k, v in (RODS | {"bodies.bar.element": "one-point"}).items()]
        out = tmp_path / "out"
        mpirun(2, "-m", "workflow.cli", "run", "bar-impact", "--out", out, *words)
        np.testing.assert_allclose(history(out)[force], half[force], rtol=0, atol=1e-11 * largest)


@pytest.mark.parametrize("element", ["full", "selective"])
def test_no_force_at_the_border_of_a_contact_zone_in_uniform_strain(element):
    """Patch test over the border between two elements: round-off on all inner nodes."""
    zone = NEAR | {"element": element}
    keys = {"bodies.bar.element": "one-point", "bodies.bar.contact_zone": zone}
    model = build(Scene.load("bar-impact", **RODS, **keys))
    V, u = model.domain.V, model.state.u
    x = V.tabulate_dof_coordinates()
    strain = 1e-4 * np.array([[1.0, 0.3, -0.2], [0.5, -0.4, 0.1], [0.0, 0.7, 0.6]])
    u.x.array[:] = (x @ strain.T).ravel()
    force = np.zeros_like(u.x.array)
    model.internal.kernel.add(force)
    inner = ((x > x.min(axis=0) + 1e-9) & (x < x.max(axis=0) - 1e-9)).all(axis=1)
    assert inner.sum() == 39
    force = np.abs(force.reshape(-1, 3))
    assert force[inner].max() < 1e-13 * force.max()


def test_cells_that_yield_are_of_the_contact_zone(run_scene):
    """Steel that yields in `selective` cells of a `one-point` bar: as if all were selective.

    To 1e-9 of the force, until the wave is back from where the other cells begin.
    """
    keys = {"mesh.size": 2.5e-3, "bodies.bar.kinematics": "total-lagrangian"}
    zoned = {
        "bodies.bar.yielding": NEAR,
        "bodies.bar.contact_zone": NEAR | {"element": "selective"},
    }
    whole = history(run_scene("plastic-bar", **keys, **{"bodies.bar.element": "selective"}))
    near = history(run_scene("plastic-bar", **keys, **zoned, **{"bodies.bar.element": "one-point"}))
    force = whole["wall_normal_force"]
    assert whole["bar_largest_plastic_strain"][-1] > 1e-3
    early = whole["t"] < 0.095 / 5189  # until the wave is back from the border of the zone
    assert early.sum() > 5
    np.testing.assert_allclose(
        near["wall_normal_force"][early], force[early], rtol=0, atol=1e-9 * force.max()
    )


@pytest.mark.parametrize(
    ("scene", "keys", "words"),
    [
        (
            "bar-wave",
            {"contact_zone": NEAR},
            "contact_zone.element = 'full': expected another one than bodies.bar.element",
        ),
        (
            "bar-wave",
            {"contact_zone": {"element": "one-point"}},
            "contact_zone: expected depth, box or both, got neither",
        ),
        (
            "plastic-bar",
            {"contact_zone": NEAR | {"element": "one-point"}},
            "contact_zone: all of the body may yield, and has one element",
        ),
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
