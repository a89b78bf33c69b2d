# SPDX-License-Identifier: LGPL-3.0-or-later
"""A step that follows the shape of cells: what it keeps, how far it falls, what it is told by."""

import json

from mpi4py import MPI

import h5py
import numpy as np
import pytest

from workflow import Scene, SceneError, run
from workflow.model.model import build
from workflow.results.samples import read
from workflow.simulation.following import SHARP, Following
from workflow.simulation.guards import GuardError
from workflow.simulation.stepping import central_difference, due, no_hold, retime

G = np.array([1.0, -2.0, 3.0])
SMALL = {"mesh.length": 0.04, "mesh.width": 0.01, "mesh.size": 0.01}
LARGE = {"bodies.bar.kinematics": "total-lagrangian"}
# a bar that is flattened by a quarter at the wall
FAST = LARGE | {"mesh.size": 2.5e-3, "bodies.bar.velocity": [-400.0, 0.0, 0.0], "time.end": 1e-5}
FAST |= {"time.safety": 0.3}


def test_a_flight_stays_exact_where_the_step_changes():
    """Constant acceleration: u = v₀ t + G t²/2 and v = v₀ + G t, step after step of another length.

    A kick over the new step alone would miss by half the difference of the steps times G.
    """
    model = build(Scene.load("bar-wave", **SMALL), MPI.COMM_SELF)
    model.dt, state = 1e-3, model.state
    state.v.x.array[0::3] = 5.0

    def weight(state, force):
        force.array[:] += (model.mass.array.reshape(-1, 3) * G).ravel()

    loop = central_difference(
        state, model.mass.petsc_vec, [weight], no_hold, 1e-3, 0.02, step=lambda: model.dt
    )
    dts = []
    for s in loop:
        t, u = s.t, s.u.x.array.reshape(-1, 3)
        v = (s.v.x.array + model.dt / 2 * s.a.array).reshape(-1, 3)
        np.testing.assert_allclose(
            u, np.tile([5 * t, 0, 0] + G * t**2 / 2, (len(u), 1)), rtol=1e-12
        )
        np.testing.assert_allclose(v, np.tile([5.0, 0, 0] + G * t, (len(v), 1)), rtol=1e-12)
        dts.append(model.dt)
        retime(model, 1e-3 * (0.5 if s.step % 2 else 0.9))
    assert len(set(dts)) == 3 and s.t == pytest.approx(0.02, abs=1e-3)


def test_an_oscillation_is_of_second_order_where_the_step_changes():
    """On a spring, u = cos ω t with steps that change all the time: four times closer at half."""
    omega, errors = 2 * np.pi, []
    for dt in (0.02, 0.01):
        model = build(Scene.load("bar-wave", **SMALL), MPI.COMM_SELF)
        model.dt, state, worst = dt, model.state, 0.0
        state.u.x.array[:] = 1.0

        def spring(state, force):
            force.array[:] -= model.mass.array * omega**2 * state.u.x.array

        mass = model.mass.petsc_vec
        for s in central_difference(state, mass, [spring], no_hold, dt, 2.0, step=lambda: model.dt):
            worst = max(worst, float(np.abs(s.u.x.array - np.cos(omega * s.t)).max()))
            retime(model, dt * (0.6 if s.step // 3 % 2 else 1.0))
        errors.append(worst)
    assert errors[1] == pytest.approx(errors[0] / 4, rel=0.1)
    assert errors[0] < 0.02


def test_ends_of_intervals():
    """Steps of a third of an interval, then of a quarter: each end is met once, nothing else is."""
    times, t = [], 0.0
    for dt in 9 * [1 / 3] + 8 * [1 / 4]:
        t += dt
        times.append(due(t, 1.0, dt))
    assert times == 3 * [False, False, True] + 2 * [False, False, False, True]
    assert due(0.0, 1.0, 0.1)


@pytest.mark.parametrize("share", [0.5, 0.8])
def test_the_bound_of_a_flattened_bar_is_that_of_flatter_cubes(share):
    """Cubes without Poisson's effect, flattened along x as flow does it: 2 / ω = share · h / c."""
    model = build(Scene.load("plastic-bar", **LARGE, **{"mesh.size": 2.5e-3}), MPI.COMM_SELF)
    first, following = model.dt_bound, Following(model)
    assert following.look() is None and model.dt_bound == first
    x = model.domain.V.tabulate_dof_coordinates()
    model.state.u.x.array[:] = (x * ([share, *2 * [share**-0.5]] - np.ones(3))).ravel()
    told = following.look()
    assert f"-> {model.dt * 1e9:.2f} ns for the shape of body 'bar'" in told
    assert share / (1 + SHARP) ** 2 < model.dt_bound / first < share * 1.001
    steps = model.span / model.dt
    assert model.dt <= 0.5 * model.dt_bound and steps == pytest.approx(round(steps), rel=1e-12)
    model.state.u.x.array[:] = 0.0
    assert following.look() is None  # it never rises


def test_a_cell_that_turns_inside_out_ends_the_run():
    """A corner that is pushed through its cell: body, cell and place are told."""
    model = build(Scene.load("plastic-bar", **LARGE, **{"mesh.size": 2.5e-3}), MPI.COMM_SELF)
    following, mesh = Following(model), model.domain.source
    node = int(np.argmax(mesh.points.sum(axis=1)))
    cell = int(np.flatnonzero((mesh.cells == node).any(axis=1))[0])
    (dof,) = model.domain.local_dofs(np.array([node]))
    model.state.u.x.array[3 * dof : 3 * dof + 3] = -2.5e-3 * 0.9
    with pytest.raises(
        GuardError, match=f"turned inside out at step 0, .* body 'bar', cell {cell},"
    ):
        following.look()


def test_a_run_tells_its_steps_and_keeps_its_outputs(run_scene):
    """The step falls with the bar: log, summary, outputs at their times, energy within 5e-3."""
    folder = run_scene("plastic-bar", **FAST)
    summary = json.loads((folder / "summary.json").read_text())
    changes = summary["step_changes"]
    assert len(changes) >= 3 and changes[0]["body"] == "bar"
    dts = [changes[0]["dt_before"], *(c["dt"] for c in changes)]
    assert dts == sorted(dts, reverse=True) and summary["dt"] == dts[-1] < 0.85 * dts[0]
    assert summary["dt"] <= 0.3 * summary["dt_bound"]
    log = (folder / "run.log").read_text()
    assert f"dt {dts[0] * 1e9:.2f} -> {dts[1] * 1e9:.2f} ns for the shape of body 'bar'" in log
    with h5py.File(folder / "results.h5") as file:
        t, error = file["history/t"][:], file["history/balance_error"][:]
    np.testing.assert_allclose(t, 1e-6 * np.arange(11), rtol=1e-10)
    assert np.abs(error).max() < 5e-3


def test_sampled_means_where_the_step_changes(run_scene):
    """Window by window, mass times the mean acceleration is the mean force of the wall: 1e-9."""
    probe = [{"name": "whole", "region": "bar", "quantity": "acceleration"}]
    keys = FAST | {"probes": probe, "output.sample_interval": 2e-6}
    folder = run_scene("plastic-bar", **keys)
    assert json.loads((folder / "summary.json").read_text())["step_changes"]
    samples, mass = read(folder), 7800.0 * 0.1 * 0.005**2
    force = samples.pairs["wall"].normal[:, 0]
    assert len(samples.t) == 5
    np.testing.assert_allclose(
        mass * samples.motion["whole"][:, 0], force, rtol=0, atol=1e-9 * force.max()
    )


@pytest.mark.mpi
def test_two_ranks_take_the_same_steps(run_scene, command, tmp_path):
    """Step changes are equal, the history of the wall's force agrees to 1e-9."""
    folder, two = run_scene("plastic-bar", **FAST), tmp_path / "two"
    words = [w for k, v in FAST.items() for w in ("--set", f"{k}={v}")]
    command("run", "plastic-bar", "--out", two, "--ranks", 2, *words)
    one, other = (json.loads((f / "summary.json").read_text()) for f in (folder, two))
    for a, b in zip(one["step_changes"], other["step_changes"], strict=True):
        assert a["step"] == b["step"] and a["dt"] == pytest.approx(b["dt"], rel=1e-12)
    with h5py.File(folder / "results.h5") as a, h5py.File(two / "results.h5") as b:
        x, y = (file["history/wall_normal_force"][:] for file in (a, b))
        np.testing.assert_allclose(y, x, rtol=0, atol=1e-9 * x.max())


def test_scenes_without_such_bodies_keep_their_step(tmp_path):
    """Elastic, at small strain, or told not to: a whole number of equal steps between outputs."""
    for name, keys in (
        ("bar-impact", {"mesh.size": 5e-3, "bodies.bar.kinematics": "total-lagrangian"}),
        ("plastic-bar", {"mesh.size": 2.5e-3}),
        ("plastic-bar", LARGE | {"mesh.size": 2.5e-3, "time.follow_shape": False}),
    ):
        scene = Scene.load(name, **keys, **{"time.end": 1e-6, "time.output_interval": 1e-6})
        model = build(scene, MPI.COMM_SELF)
        assert model.span is None
        assert model.dt == 1e-6 / np.ceil(1e-6 / (scene.time.safety * model.dt_bound))
    result = run(scene, tmp_path / "run", quiet=True)
    assert result.summary["step_changes"] == [] and result.summary["dt"] == model.dt


def test_nothing_to_follow_is_refused():
    """Asked for where no body has a memory at large strain: the key, and why."""
    for keys in ({}, {"bodies.bar.kinematics": "small-strain"}):
        name = "plastic-bar" if keys else "bar-impact"
        with pytest.raises(SceneError, match=r"time\.follow_shape = true: expected a body"):
            Scene.load(name, **keys, **{"time.follow_shape": True})
    assert Scene.load("plastic-bar", **LARGE, **{"time.follow_shape": True}).time.follow_shape
