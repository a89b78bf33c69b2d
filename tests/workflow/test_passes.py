# SPDX-License-Identifier: LGPL-3.0-or-later
"""Passes: runs that begin with the steel which another has left."""

import json
import shutil
import signal

import h5py
import numpy as np
import pytest

from tests.folders import assert_same
from tests.processes import started, until
from workflow import Scene, SceneError, run
from workflow.model.model import build
from workflow.results.passes import read_section, rows_of
from workflow.results.result import read_run
from workflow.results.shakedown import heaviest, trails
from workflow.simulation.residual import deformation

# a bar on a wall, which hardens
E, Y, SLOPE, RHO = 210e9, 500e6, 21e9, 7800.0
BAR = {"mesh.size": 2.5e-3}
# a load that rolls, coarse and short
ROLLED = {
    "mesh.size": 2.5e-3, "time.end": 1.6e-4, "time.output_interval": 2e-5, "passes.number": 2,
    "loads": [{
        "surface": "top", "traction": [0.0, 0.0, -1e9],
        "travelling": {"half_width": 5e-3, "start": -0.01, "velocity": 150.0, "ramp": 3e-5,
                       "until": 1.3e-4},
    }],
}  # fmt: skip


def history(folder, name):
    """A column of the history of a run."""
    with h5py.File(folder / "results.h5") as file:
        return file[f"history/{name}"][:]


def test_a_hardened_bar_hits_the_wall_again(run_scene):
    """The second impact at 20 m/s begins to yield at the 597.9 MPa that the first has left: an
    elastic wave of that stress, a plastic one behind it, ``σ₁ + ρ c_p (v − σ₁ / ρc)`` = 664.8 MPa.

    It lasts until the elastic wave is back from where the first plastic wave had ended.
    """
    folder = run_scene("plastic-bar", **BAR, **{"passes.number": 2})
    first = Y + np.sqrt(RHO * SLOPE) * (20.0 - Y / np.sqrt(RHO * E))
    second = first + np.sqrt(RHO * SLOPE) * (20.0 - first / np.sqrt(RHO * E))
    assert (first, second) == pytest.approx((597.9e6, 664.8e6), rel=2e-4)
    for k, stress, window in ((1, first, (8e-6, 25e-6)), (2, second, (12e-6, 20e-6))):
        t = history(folder / f"pass-{k}", "t")
        force = history(folder / f"pass-{k}", "wall_normal_force")
        told = force[(t > window[0]) & (t < window[1])].mean() / 0.005**2
        assert told == pytest.approx(stress, rel=0.015), k
    rows = rows_of(folder)
    assert rows[1]["largest_plastic_strain"] > 1.4 * rows[0]["largest_plastic_strain"]
    assert read_run(folder / "pass-2").summary["expected"] == []  # theory knows virgin steel only


def test_elastic_passes_are_alike(run_scene):
    """Nothing yields: the second pass is the first, and no stress is left, to 1e-9 of the load."""
    steel = {"bodies.block.material.yield_stress": 2e9}
    folder = run_scene("rolling-shakedown", **ROLLED, **steel)
    one, two = (history(folder / f"pass-{k}", "external_work") for k in (1, 2))
    np.testing.assert_allclose(two, one, rtol=0, atol=1e-9 * np.abs(one).max())
    for row in rows_of(folder):
        assert row["largest_plastic_strain"] == row["plastic_work"] == 0.0
        assert abs(row["residual_stress_xx"]) < 1e-9 * 1e9


def test_passes_are_runs_one_after_the_other(run_scene, tmp_path):
    """``passes.after`` another run gives the second of two passes bit by bit."""
    folder = run_scene("rolling-shakedown", **ROLLED)
    keys = {**ROLLED, "passes.number": 1, "passes.after": str(folder / "pass-1")}
    run(Scene.load("rolling-shakedown", **keys), tmp_path / "second", quiet=True)
    assert_same(folder / "pass-2", tmp_path / "second")
    third = Scene.load("rolling-shakedown", **{**keys, "passes.after": str(folder)})
    assert build(third).scene.passes.after == str(folder)  # the last pass of a folder


@pytest.mark.mpi
@pytest.mark.slow
def test_passes_on_two_ranks(run_scene, command, tmp_path):
    """Two ranks give the rows of one."""
    scene, keys = tmp_path / "mine.toml", {k: v for k, v in ROLLED.items() if k != "loads"}
    shutil.copy(run_scene("rolling-shakedown", **ROLLED) / "scene.toml", scene)
    words = [w for key, value in keys.items() for w in ("--set", f"{key}={value}")]
    command("run", scene, *words, "--ranks", 2, "--out", tmp_path / "two")
    serial = rows_of(run_scene("rolling-shakedown", **ROLLED))
    for one, two in zip(serial, rows_of(tmp_path / "two"), strict=True):
        for name, value in one.items():
            other = two[name]
            assert other is value is None or other == pytest.approx(value, rel=1e-6, abs=1e-9), name
    assert serial[1]["section_plastic_strain"] > serial[0]["section_plastic_strain"] > 1e-3


@pytest.mark.slow
def test_a_kill_in_a_pass_loses_nothing(run_scene, tmp_path):
    """Killed in the second pass, resumed, prolonged by a third: as without."""
    keys = ROLLED | {"output.checkpoint_steps": 97}
    made, cut = tmp_path / "mine.toml", tmp_path / "cut"
    shutil.copy(run_scene("rolling-shakedown", **keys) / "scene.toml", made)
    process = started("run", made, "--out", cut)
    until(lambda: (cut / "pass-2" / "checkpoint" / "state.npz").exists())
    process.send_signal(signal.SIGKILL)
    process.communicate(timeout=60)
    scene = Scene.load("rolling-shakedown", **keys)
    with pytest.raises(SceneError, match="already holds a run"):
        run(scene, cut, quiet=True)
    result = run(scene.with_(**{"passes.number": 3}), cut, quiet=True, resume=True)
    assert result.summary["status"] == "done" and len(result.summary["passes"]) == 3
    whole = run_scene("rolling-shakedown", **keys)
    for k in (1, 2):
        assert_same(whole / f"pass-{k}", cut / f"pass-{k}")
    assert json.loads((whole / "summary.json").read_text())["passes"] == rows_of(cut)[:2]
    with pytest.raises(SceneError, match=r"time\.end = .* expected that of the passes"):
        run(scene.with_(**{"time.end": 2e-4}), cut, quiet=True, resume=True)
    with pytest.raises(SceneError, match=r"passes\.number: .* holds 3 passes"):
        run(scene.with_(**{"passes.number": 1}), cut, quiet=True, resume=True)


@pytest.mark.slow
def test_figures_and_report_of_passes(run_scene, command, tmp_path):
    """The figure of all passes, and a report with their table."""
    folder = tmp_path / "passes"
    shutil.copytree(run_scene("rolling-shakedown", **ROLLED), folder)
    command("report", folder)
    assert (folder / "figures" / "passes.png").stat().st_size > 10_000
    page = (folder / "report.html").read_text("utf-8")
    assert 'id="passes"' in page and "alternating plasticity" in page
    assert "--set passes.number=2" in page or "scene.toml" in page


def test_points_on_the_shakedown_map(run_scene, tmp_path):
    """Of a load: its pressure over Y / √3. Of a patch: forces and areas of its nodes say the same.

    The block that slides at 2 m/s has T/N = 0.3 and, as nothing rolls, no Tγ.
    """
    loads = [{**ROLLED["loads"][0], "traction": [3e8, 0.0, -1e9]}]
    scene = Scene.load("rolling-shakedown", **ROLLED | {"loads": loads})
    h5py.File(tmp_path / "results.h5", "w").close()
    (trail,) = trails(tmp_path, scene)
    row = trail.heaviest
    assert row["pressure_over_k"] == pytest.approx(4.35, rel=1e-5)
    assert row["traction_coefficient"] == pytest.approx(0.3) and row["t_gamma"] is None
    for row in rows_of(run_scene("rolling-shakedown", **ROLLED)):
        assert row["pressure_over_k"] == pytest.approx(4.35, rel=1e-5)

    steel = {"law": "j2", "youngs_modulus": E, "poisson_ratio": 0.3, "density": RHO}
    keys = {
        "bodies.block.material": steel | {"yield_stress": 5e8},
        "bodies.base.material": steel | {"yield_stress": 3e8},
    }
    keys |= {"output.fields": False, "time.end": 5e-6, "bodies.block.stiffness_damping": 0.0}
    keys["bodies.base.stiffness_damping"] = 0.0
    folder = run_scene("sliding-block", **keys)
    found = heaviest(folder, Scene.load("sliding-block", **keys))
    pressures, tractions = [], []
    with h5py.File(folder / "results.h5") as file:
        for k in range(6):
            nodes = file[f"contact/face/{k}"]
            pressures.append((nodes["normal_force"][:] / nodes["area"][:]).max())
            T = np.linalg.norm(nodes["tangential_force"][:].sum(axis=0))
            tractions.append(T / nodes["normal_force"][:].sum())
    k = int(np.argmax(pressures))
    assert found["pressure_over_k"] == pytest.approx(pressures[k] * 3**0.5 / 3e8, rel=1e-9)
    assert found["traction_coefficient"] == pytest.approx(tractions[k], rel=1e-6)
    assert found["t_gamma"] is None and tractions[-1] == pytest.approx(0.3, rel=0.01)
    assert heaviest(folder, Scene.load("sliding-block"))["pressure_over_k"] is None  # elastic


def test_profile_of_a_pass(run_scene):
    """Cells from the top down; without loads σz vanishes along x where a rolled bed is steady.

    This way is short: 15 % of the largest stress.
    """
    folder = run_scene("rolling-shakedown", **ROLLED)
    section = read_section(folder / "pass-2")
    assert (np.diff(section["depth"]) > 0).all() and section["depth"][0] < 1.3e-3
    most = np.abs(section["stress_xx"]).max()
    assert most > 50e6
    assert np.abs(section["stress_zz"]).max() < 0.15 * most


@pytest.mark.parametrize(
    ("keys", "told"),
    [
        ({"passes.number": 0}, "passes.number = 0"),
        ({"passes.after": "/nowhere"}, "passes.after = '/nowhere': expected the folder of a run"),
        ({"passes.section": [9.0, 0.0]}, "passes.section = \\[9.0, 0.0\\]: expected x and y"),
        ({"loads": [{**ROLLED["loads"][0], "travelling": {
            **ROLLED["loads"][0]["travelling"], "until": 4e-5}}]}, "travelling.until = 4e-05"),
        ({"supports": [{"surface": "bottom", "directions": ["x"], "velocity": 1.0, "ramp": 1e-5}]},
         "passes: expected supports at rest, got \\['bottom'\\] moved"),
    ],
)  # fmt: skip
def test_bad_passes(keys, told, tmp_path):
    """Each names the key, what it got and what it expects."""
    with pytest.raises(SceneError, match=told):
        run(Scene.load("rolling-shakedown", **keys), tmp_path / "bad", quiet=True)


def test_steel_of_another_scene(run_scene, tmp_path):
    """``passes.after`` a run of other bodies is refused before there is a mesh."""
    folder = run_scene("rolling-shakedown", **ROLLED)
    keys = {"passes.after": str(folder), "bodies.block.material.yield_stress": 1e9}
    with pytest.raises(SceneError, match=r"passes\.after = .* the same \[bodies\]"):
        run(Scene.load("rolling-shakedown", **ROLLED | keys), tmp_path / "bad", quiet=True)


def test_no_material_remembers(command):
    """Passes over elastic steel are doubtful, not refused."""
    done = command("validate", "bar-wave", "--set", "passes.number=2")
    assert "all passes are alike" in done.stdout


def test_a_body_is_put_back():
    """Turned by 200 degrees, moved and strained a little: the strain is left, exactly."""
    random = np.random.default_rng(1)
    points = random.uniform(-1, 1, (20, 3))
    turn, _ = np.linalg.qr(random.standard_normal((3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    strain = np.zeros((20, 3))
    strain[12:] = 1e-2 * random.standard_normal((8, 3))  # not where it is carried
    u = (points + strain) @ turn.T + [5.0, -3.0, 1.0] - points
    found = deformation(points, u, np.arange(12), np.arange(20))
    np.testing.assert_allclose(found, strain, atol=1e-14)


@pytest.mark.slow
def test_a_roller_rolls_again(run_scene):
    """`carter` on steel that could yield but does not: block and roller go back to their start.

    Both passes start with the same forces, to 1e-9. Later round-off has grown, as nodes go from
    facet to facet: 2e-5 of the normal force and 3e-3 of the tangential force at the first outputs,
    which is as much as the last digit of velocities alone makes of a run.
    """
    steel = {"law": "j2", "youngs_modulus": E, "poisson_ratio": 0.3, "density": RHO}
    keys = {
        "bodies.block": {"regions": ["base"], "material": {**steel, "yield_stress": 2e9}},
        "mesh.size": 1e-3, "time.end": 1e-4, "passes.number": 2,
    }  # fmt: skip
    folder = run_scene("carter", **keys)
    for name, share in (("touch_normal_force", 1e-4), ("touch_tangential_x_force", 5e-3)):
        one, two = (history(folder / f"pass-{k}", name) for k in (1, 2))
        largest = np.abs(one).max()
        assert two[0] == pytest.approx(one[0], abs=1e-9 * largest)
        np.testing.assert_allclose(two, one, rtol=0, atol=share * largest)
    assert not (history(folder / "pass-2", "block_largest_plastic_strain") > 0).any()
