# SPDX-License-Identifier: LGPL-3.0-or-later
"""Samples between outputs: means that keep momentum, the same after a kill and on other ranks."""

import subprocess
import sys

import numpy as np
import pytest

from tests.folders import BAR, assert_same, copied
from workflow import Scene, run
from workflow.results import samples
from workflow.scene.scene import SceneError

STEPS = 3  # of a window
DT = 4e-7  # 5 steps to an output
PROBES = [
    {"name": "tip", "point": [0.1001, 0.0025, 0.0025]},
    {"name": "mass", "region": "bar"},
    {"name": "pull", "region": "bar", "quantity": "acceleration"},
    {"name": "face", "surface": "xmin", "quantity": "displacement"},
    {"name": "corner", "surface": "xmax", "point": [0.0, 9.0, 9.0], "quantity": "displacement"},
]


def bar(steps: float = STEPS, **changes) -> Scene:
    """The bar against the wall, coarse, sampled at every so many steps."""
    times = {"time.end": 2.4e-5, "time.output_interval": 5 * DT}
    scene = Scene.load("bar-impact", **{**BAR, **times, **changes})
    tables = scene.tables() | {"probes": PROBES}
    tables["output"] |= {"sample_interval": steps * DT}
    return Scene.check(tables)


@pytest.fixture(scope="module")
def sampled(tmp_path_factory):
    """Folder and samples of a run; momentum, a corner and a face of the bar at every step."""
    folder = tmp_path_factory.mktemp("probes") / "run"
    seen = {"momentum": [], "corner": [], "face": []}

    def watch(model):
        state, domain = model.state, model.domain
        v = state.v.x.array + model.dt / 2 * state.a.array
        u, x = state.u.x.array.reshape(-1, 3), domain.V.tabulate_dof_coordinates()
        corner = np.argmin(np.linalg.norm(x - [0.1, 0.0025, 0.0025], axis=1))
        seen["momentum"].append((model.mass.array * v).reshape(-1, 3).sum(axis=0))
        seen["corner"].append(u[corner].copy())
        seen["face"].append(u[x[:, 0] < 1e-9].copy())

    run(bar(), folder, quiet=True, watch=watch)
    return folder, samples.read(folder), {k: np.array(v) for k, v in seen.items()}


def trapezoid(values: np.ndarray) -> np.ndarray:
    """Means over windows of STEPS steps."""
    x = np.asarray(values)
    n = (len(x) - 1) // STEPS
    w = np.r_[0.5, np.ones(STEPS - 1), 0.5] / STEPS
    return np.array([w @ x[STEPS * k : STEPS * (k + 1) + 1] for k in range(n)])


def test_windows_lie_side_by_side(sampled):
    """``t`` is their middle."""
    _, samples, seen = sampled
    assert samples.interval == pytest.approx(STEPS * DT, rel=1e-14)
    assert len(samples.t) == (len(seen["corner"]) - 1) // STEPS == 20
    middle = (np.arange(20) + 0.5) * STEPS * DT
    np.testing.assert_allclose(samples.t, middle, rtol=1e-12)


def test_force_times_window_is_the_change_of_momentum(sampled):
    """Of the bar, whose momentum is summed over its nodes; to round-off in every window."""
    _, samples, seen = sampled
    pair = samples.pairs["wall"]
    impulse = (pair.normal + pair.tangential) * samples.interval
    change = np.diff(seen["momentum"][::STEPS], axis=0)
    assert np.abs(impulse).max() > 1e-3
    np.testing.assert_allclose(impulse, change, atol=1e-13 * np.abs(seen["momentum"]).max())


def test_mean_acceleration_of_the_centre_of_mass_is_force_over_mass(sampled):
    """Probe of a region; to round-off."""
    _, samples, _ = sampled
    mass = 7800 * 0.1 * 0.005**2
    pair = samples.pairs["wall"]
    force = pair.normal + pair.tangential
    np.testing.assert_allclose(
        mass * samples.motion["pull"], force, atol=1e-11 * np.abs(force).max()
    )


def test_nodal_forces_sum_to_the_total(sampled):
    """They are kept in single precision."""
    _, samples, _ = sampled
    pair = samples.pairs["wall"]
    total = np.zeros_like(pair.normal)
    np.add.at(total, pair.sample, pair.normal_forces)
    np.testing.assert_allclose(total, pair.normal, atol=3e-7 * np.abs(pair.normal).max())
    np.testing.assert_array_equal(pair.reference(pair.node)[:, 0], 0.0)
    assert pair.body == "bar"
    assert pair.start[-1] == len(pair.node)


def test_means_of_motion(sampled):
    """Velocity by the way made, displacement by the trapezoidal rule over the steps."""
    _, samples, seen = sampled
    way = np.diff(seen["corner"][::STEPS], axis=0)
    np.testing.assert_allclose(samples.motion["tip"], way / samples.interval, atol=1e-12)
    corner = trapezoid(seen["corner"])
    np.testing.assert_allclose(samples.motion["corner"], corner, rtol=1e-12, atol=1e-18)
    # four corners of a square have a quarter of its area each
    face = trapezoid(seen["face"].mean(axis=1))
    assert seen["face"].shape[1] == 4
    np.testing.assert_allclose(samples.motion["face"], face, rtol=1e-12, atol=1e-18)


def test_log_tells_nodes(sampled):
    """The node, how far it is from the point given, and the window that came of it."""
    log = (sampled[0] / "run.log").read_text()
    assert "probe tip: velocity of node" in log
    assert "1.0e-04 m from the point given" in log
    assert f"means over {STEPS} steps" in log
    assert "mean of the 4 nodes of xmin" in log


def test_nothing_is_sampled_by_default(tmp_path):
    """Neither a group in the results nor an import."""
    code = (
        "import sys; from workflow import Scene, run\n"
        f"scene = Scene.load('bar-impact', **{BAR})\n"
        f"run(scene, {str(tmp_path / 'run')!r}, quiet=True)\n"
        "assert 'workflow.simulation.sampling' not in sys.modules\n"
        "assert 'workflow.results.samples' not in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=100)
    assert samples.read(tmp_path / "run") is None


@pytest.mark.parametrize("steps", [STEPS, 10])
def test_resumed_samples_are_the_same_bit_by_bit(steps, tmp_path):
    """Windows of 3 steps do not end where checkpoints are taken, every 7, nor at outputs."""
    scene = bar(steps)
    killed = copied(scene, tmp_path / "whole", 45)
    run(scene, killed, quiet=True, resume=True)
    assert_same(tmp_path / "whole", killed)
    assert len(samples.read(killed).t) > 5


def test_samples_of_a_killed_run_are_cut_to_the_checkpoint(tmp_path):
    """Outputs after the last checkpoint have flushed samples; the resumed run writes them anew."""
    scene = bar(1, **{"output.checkpoint_steps": 40})
    killed = copied(scene, tmp_path / "whole", 55)
    assert len(samples.read(killed).t) > 40
    run(scene, killed, quiet=True, resume=True)
    assert_same(tmp_path / "whole", killed)


def test_interval_stays_and_sampling_may_begin_late(tmp_path):
    """Of a resumed run."""
    scene = bar(STEPS)
    killed = copied(scene, tmp_path / "whole", 45)
    with pytest.raises(SceneError, match=r"output.sample_interval: 6 steps, expected 3"):
        run(bar(2 * STEPS), killed, quiet=True, resume=True)
    plain = scene.tables()
    del plain["output"]["sample_interval"], plain["probes"]
    plain = Scene.check(plain)
    later = copied(plain, tmp_path / "plain", 45)
    tables = plain.tables()
    tables["output"]["sample_interval"] = 2 * DT
    run(Scene.check(tables), later, quiet=True, resume=True)
    assert samples.read(later).t[0] > 42 * DT


def test_two_ranks_sample_the_same(squealx, sampled, tmp_path):
    """Motion and forces as on one, within the growth of round-off."""
    folder, one, _ = sampled
    squealx("run", folder / "scene.toml", "--ranks", 2, "--out", tmp_path / "two")
    two = samples.read(tmp_path / "two")
    np.testing.assert_array_equal(one.t, two.t)
    for name, motion in one.motion.items():
        np.testing.assert_allclose(two.motion[name], motion, atol=1e-10 * np.abs(motion).max())
    for key in ("normal", "normal_forces", "places"):
        a, b = (getattr(x.pairs["wall"], key) for x in (one, two))
        np.testing.assert_allclose(a, b, atol=1e-7 * np.abs(a).max())
    np.testing.assert_array_equal(one.pairs["wall"].node, two.pairs["wall"].node)


@pytest.mark.parametrize(
    ("probe", "told"),
    [
        ({"name": "a"}, "probes.a: expected a point, surface or region, got none"),
        ({"name": "a", "surface": "xmin", "region": "bar"}, "a surface or a region"),
        ({"name": "a", "region": "wheel"}, r"probes.0.region = 'wheel': expected one of \['bar'\]"),
        ({"name": "a", "surface": "tread"}, "probes.0.surface = 'tread': expected one of"),
        ({"name": "a b", "region": "bar"}, "probes.0.name"),
        ({"name": "a", "region": "bar", "quantity": "speed"}, "probes.0.quantity"),
    ],
)
def test_bad_probes(probe, told):
    """The message names the key, what it got and what it expects."""
    tables = bar().tables() | {"probes": [probe]}
    with pytest.raises(SceneError, match=told):
        Scene.check(tables)


def test_probes_need_an_interval_and_names_of_their_own():
    """Told together with all else that does not fit."""
    tables = bar().tables() | {"probes": [PROBES[1], PROBES[1]]}
    del tables["output"]["sample_interval"]
    with pytest.raises(SceneError, match="each name once") as caught:
        Scene.check(tables)
    assert "output.sample_interval: missing" in str(caught.value)
    with pytest.raises(SceneError, match=r"sample_interval = 0\.1: expected at most"):
        Scene.load("bar-impact", **{"output.sample_interval": 0.1})
