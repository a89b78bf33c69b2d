# SPDX-License-Identifier: LGPL-3.0-or-later
"""Supports that are set in motion: their path, the work they do, resume and ranks."""

from functools import partial

import h5py
import numpy as np
import pytest

from tests.folders import assert_same, copied
from workflow import Scene, run
from workflow.scene.scene import SceneError
from workflow.scene.settings import Support
from workflow.simulation.prescribed import difference, way

BEGIN, RAMP, SPEED = 1e-5, 6e-5, 2.0
MASS = 7800 * 0.1 * 0.005**2


def towed(**changes) -> Scene:
    """A bar at rest, pulled by one end to 2 m/s."""
    times = {"time.end": 1.2e-4, "time.output_interval": 2e-6, "mesh.size": 5e-3}
    tables = Scene.load("bar-wave", **(times | changes)).tables()
    del tables["bodies"]["bar"]["velocity"]
    tables["supports"][0] |= {"velocity": SPEED, "begin": BEGIN, "ramp": RAMP}
    return Scene.check(tables)


def place(t: np.ndarray) -> np.ndarray:
    """The prescribed way: the integral of ``s³ (10 - 15 s + 6 s²)``, 1/2 at s = 1, and on."""
    s = np.clip((t - BEGIN) / RAMP, 0, 1)
    straight = np.maximum(t - BEGIN - RAMP, 0)
    return SPEED * (RAMP * s**4 * (2.5 - 3 * s + s**2) + straight)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Folder and result of the run, velocities of its ends and momentum at every step."""
    seen = []

    def watch(model):
        v = (model.state.v.x.array + model.dt / 2 * model.state.a.array).reshape(-1, 3)
        x = model.domain.V.tabulate_dof_coordinates()[:, 0]
        momentum = float(model.mass.array[::3] @ v[:, 0])
        seen.append((model.state.t, *v[np.argmin(x)], v[np.argmax(x), 0], momentum))

    folder = tmp_path_factory.mktemp("moving") / "run"
    result = run(towed(**{"output.checkpoint_steps": 31}), folder, quiet=True, watch=watch)
    return folder, result, np.array(seen)


def test_the_end_moves_as_prescribed(whole):
    """Places at every step, so speeds are their differences, the end's is exact; none aside."""
    _, _, seen = whole
    t = seen[:, 0]
    expected = (place(t[1:-1] + t[1]) - place(t[1:-1] - t[1])) / (2 * t[1])
    np.testing.assert_allclose(seen[1:-1, 1], expected, atol=1e-10 * SPEED)
    np.testing.assert_allclose(seen[-1, 1], SPEED, rtol=1e-10)
    assert np.abs(seen[:, 2:4]).max() < 1e-12
    assert np.abs(seen[seen[:, 0] <= BEGIN - t[1], 1:]).max() == 0.0


@pytest.mark.parametrize("steps", [0.3, 1.7, 3.0, 20.0])
@pytest.mark.parametrize("begin", [0.0, 0.4, 2.0])
def test_a_ramp_of_any_length_ends_at_its_speed_and_place(steps, begin):
    """Central differences with its accelerations: v and v (t - begin - ramp/2), to round-off."""
    dt, speed = 1e-7, 5.0
    times = {"ramp": steps * dt, "begin": begin * dt}
    entry = Support(surface="s", directions=["x"], velocity=speed, **times)
    x, v = 0.0, -dt / 2 * difference(partial(way, entry), 0.0, dt)
    for n in range(40):
        v += dt * difference(partial(way, entry), n * dt, dt)
        x += dt * v
    assert v == pytest.approx(speed, rel=1e-9)
    assert x == pytest.approx(speed * (40 - begin - steps / 2) * dt, rel=1e-9)


def test_work_is_the_integral_of_reaction_times_speed(whole):
    """``∫ v dp`` from the momentum of the bar (7e-4); energies add up to it to round-off."""
    _, result, seen = whole
    t, v, p = seen[:, 0], seen[:, 1], seen[:, -1]
    work = np.sum(np.diff(p) * (v[1:] + v[:-1]) / 2)
    energy, history = result.summary["energy"], result.history
    assert energy["external_work"] == pytest.approx(work, rel=2e-3)
    assert energy["kinetic"] + energy["internal"] == pytest.approx(work, rel=2e-3)
    assert np.abs(history["balance_error"]).max() < 1e-12
    # its mean speed comes to that of the end, about which it rings
    later = p[t > BEGIN + RAMP + 1e-6] / MASS
    assert abs(later.mean() - SPEED) < 0.1 * SPEED


def test_resumed_in_the_ramp(whole, tmp_path):
    """Bit by bit."""
    scene = towed(**{"output.checkpoint_steps": 31})
    killed = copied(scene, tmp_path / "again", 45)
    run(scene, killed, quiet=True, resume=True)
    assert_same(tmp_path / "again", killed)
    assert_same(whole[0], killed)


def test_on_two_ranks(squealx, whole, tmp_path):
    """The same work and energies, to round-off."""
    folder = whole[0]
    squealx("run", folder / "scene.toml", "--ranks", 2, "--out", tmp_path / "two")
    with h5py.File(folder / "results.h5") as one, h5py.File(tmp_path / "two/results.h5") as two:
        for name in ("external_work", "kinetic", "internal"):
            a, b = one["history"][name][:], two["history"][name][:]
            np.testing.assert_allclose(b, a, atol=1e-12 * np.abs(a).max())


@pytest.mark.parametrize(
    ("keys", "told"),
    [
        ({"velocity": 1.0}, "velocity and ramp together"),
        ({"ramp": 1e-3}, "velocity and ramp together"),
        ({"begin": 1e-3}, "velocity and ramp together"),
        ({"velocity": 1.0, "ramp": 1e-3, "directions": ["x", "y"]}, "expected one direction"),
    ],
)
def test_bad_keys(keys, told):
    """The message says what belongs together."""
    tables = Scene.load("bar-wave").tables()
    tables["supports"][0] |= keys
    with pytest.raises(SceneError, match=told):
        Scene.check(tables)


def test_what_holds_the_static_solve_does_not_move():
    """``equilibrium.hold`` is at rest."""
    tables = Scene.load("hertz").tables()
    entry = {"surface": "xmin", "directions": ["x"], "velocity": 1.0, "ramp": 1.0}
    tables["equilibrium"]["hold"] = [entry]
    with pytest.raises(SceneError, match=r"equilibrium.hold: expected supports at rest"):
        Scene.check(tables)
