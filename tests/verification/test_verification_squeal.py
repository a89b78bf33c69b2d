# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rows 37 to 39: mass on a belt, mode coupling, sliding block: by eigenvalues and in time."""

import itertools

from mpi4py import MPI

import numpy as np
import pytest
from scipy.optimize import least_squares

from workflow import Scene, build
from workflow.simulation.initial import start
from workflow.simulation.stepping import steps
from workflow.squeal.sliding import in_motion
from workflow.squeal.squeal import squeal
from workflow.squeal.steady import steady
from workflow.stability.growth import growth

OMEGA = 1e4  # rad/s, unit of frequency in mode-coupling
DECAY, SPEED, FORCE, MASS, STIFFNESS = 0.1, 0.1, 100.0, 1.0, 1e4  # mass-on-belt


def coupled(friction):
    """Eigenvalue λ of largest real part of row 38 [rad/s]."""
    K = np.array([[2.0, 0.2 - friction], [0.2, 2.2]])
    values = np.emath.sqrt(-np.linalg.eigvals(K).astype(complex)) * OMEGA
    return max([*values, *-values], key=lambda value: (round(value.real, 6), value.imag))


@pytest.mark.parametrize("road", ["full", "projection"])
@pytest.mark.parametrize("friction", [0.24, 0.26, 0.3, 0.5])
def test_mode_coupling_row_38(road, friction):
    """``M = I, K = [[2, 0.2 - f], [0.2, 2.2]]`` in units of 1e4 rad/s: unstable above f = 0.25.

    For f = 0.3 it grows by 0.03449 at 1.4495. The scene has the same as a block in the contact
    kernel, all of whose growth comes from the contact.
    """
    scene = Scene.load("mode-coupling", **{"contacts.sole.friction": friction})
    found = squeal(scene, comm=MPI.COMM_SELF, top=5e3, road=road).summary
    growing = [mode for mode in found["modes"] if mode["kind"] == "flutter"]
    assert len(growing) == found["unstable"] == (friction > 0.25)
    if growing:
        (mode,), exact = growing, coupled(friction)
        assert mode["growth_rate"] == pytest.approx(exact.real, rel=2e-3)
        assert mode["frequency"] == pytest.approx(exact.imag / (2 * np.pi), rel=5e-4)
        assert mode["fed_by"] == {"sole": pytest.approx(mode["growth_rate"])}


@pytest.mark.slow
def test_mode_coupling_in_time_row_38():
    """The scene in time grows by 344.9 per second at 2307.0 Hz, as the eigenvalues say."""
    model = build(Scene.load("mode-coupling"), MPI.COMM_SELF)
    start(model, lambda line: None)
    pair = model.pairs["sole"]
    t, force = np.array([(s.t, pair.normal_force) for s in steps(model, 12e-3)])[::20].T
    late, exact = t > 2e-3, coupled(0.3)
    seen = growth(t[late], force[late] / force[0])
    assert seen.sure
    assert seen.rate == pytest.approx(exact.real, rel=1e-2)
    assert seen.frequency == pytest.approx(exact.imag / (2 * np.pi), rel=1e-2)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("size", "friction", "end"),
    [
        (5e-3, 0.3, 150e-6),
        (5e-3, 0.6, 100e-6),
        *(
            pytest.param(2.5e-3, friction, end, marks=pytest.mark.long)
            for friction, end in ((0.1, 100e-6), (0.3, 100e-6), (0.6, 100e-6), (1.0, 70e-6))
        ),
    ],
)
def test_sliding_block_by_both_roads_row_39(size, friction, end):
    """A block in steady sliding with a billionth of a metre of its fastest mode goes on as that.

    Frequency within 2 %, growth rate within 10 %; contact springs 8 times as stiff as usual, by a
    short step.
    """
    keys = {"mesh.size": size, "mesh.base_size": 1.24 * size, "time.safety": 0.2}
    keys |= {"contacts.face.friction": friction, "bodies.block.velocity": [15.0, 0.0, 0.0]}
    scene = Scene.load("sliding-block", **keys)
    found = squeal(scene, comm=MPI.COMM_SELF, top=100e3)
    k = int(np.argmax([mode["growth_rate"] for mode in found.summary["modes"]]))
    mode = found.summary["modes"][k]
    value = mode["growth_rate"] + 2j * np.pi * mode["frequency"]
    model = build(scene, MPI.COMM_SELF)
    steady(model)
    shape = found.shapes[k][model.domain.nodes].ravel()
    shape *= 1e-9 / np.abs(shape).max()
    model.state.u.x.array[:] += shape.real
    model.state.v.x.array[:] += (value * shape).real
    pair = model.pairs["face"]
    t, force = np.array([(s.t, pair.normal_force) for s in steps(model, end)]).T
    late = t > 0.4 * end
    seen = growth(t[late][::2], force[late][::2] / force[0])
    assert seen.sure
    assert seen.frequency == pytest.approx(mode["frequency"], rel=2e-2)
    assert seen.rate == pytest.approx(mode["growth_rate"], rel=0.1)


def let_go(scene, shape, value, end, nodes):
    """Times and velocities of some nodes in a run from steady sliding, ``(k,)``, ``(k, 3 m)``.

    Args:
        scene: A wheel on a rail.
        shape: Displacement added at the start, by mesh node [m].
        value: λ of it [1/s].
        end: Last time [s].
        nodes: Mesh nodes.
    """
    model = build(scene, MPI.COMM_SELF)
    steady(model)
    model.state.v.x.array[:] = 0.0
    in_motion(model)  # the deformation that has come to rest is what travels with the contact
    own = shape[model.domain.nodes]
    model.state.u.x.array[:] += own.real.ravel()
    model.state.v.x.array[:] += (value * own).real.ravel()
    at = model.domain.local_dofs(nodes)
    states = itertools.islice(steps(model, end), 0, None, 40)
    rows = [(s.t, s.v.x.array.reshape(-1, 3)[at].ravel()) for s in states]
    return np.array([t for t, _ in rows]), np.array([v for _, v in rows])


def one_oscillation(t, x, value):
    """λ next to ``value`` of the oscillation that fits all columns best, and what it leaves."""
    x = (x - x.mean(axis=0)) / (x - x.mean(axis=0)).std()

    def rest(p):
        wave = np.exp((1e2 * p[0] + 2j * np.pi * 1e3 * p[1]) * t)
        basis = np.column_stack([np.ones_like(t), wave.real, wave.imag])
        return (x - basis @ np.linalg.lstsq(basis, x, rcond=None)[0]).ravel()

    found = least_squares(rest, [value.real / 1e2, value.imag / (2e3 * np.pi)])
    left = np.sqrt(2 * found.cost / x.size)
    return 1e2 * found.x[0] + 2j * np.pi * 1e3 * found.x[1], left


@pytest.mark.slow
@pytest.mark.long
def test_a_wheel_in_a_curve_by_both_roads():
    """A wheel in two-point contact, with and without 10 nm of its mode that grows: the difference.

    Its frequency is within 1 % of the eigenvalue's, its growth within 35 %: over 2 ms the normal
    force swings between 60 and 90 kN, and the wheel turns by 6 degrees under the mode.
    """
    keys = {"mesh.rail_length": 3.6, "equilibrium.shift": 0.003, "time.end": 2e-3}
    keys |= {"time.output_interval": 1e-4, "rolling.traction_coefficient": 0.0}
    led = Scene.load("steady-curving").tables()["supports"]
    led = [s | {"ramp": 1e-5} if s.get("velocity") else s for s in led]
    scene = Scene.load("steady-curving", **keys, supports=led)
    found = squeal(scene, comm=MPI.COMM_SELF, top=2400.0, road="projection")
    modes = found.summary["modes"]
    heard = [k for k, mode in enumerate(modes) if mode["frequency"] > 500.0]
    k = max(heard, key=lambda k: modes[k]["growth_rate"])
    value = modes[k]["growth_rate"] + 2j * np.pi * modes[k]["frequency"]
    assert modes[k]["residual"] < 1e-7 and 2250.0 < modes[k]["frequency"] < 2350.0
    shape = found.shapes[k] * (1e-8 / np.abs(found.shapes[k]).max())
    nodes = np.argsort(-np.abs(shape).max(axis=1))[:200:10]  # some of those that move most
    t, without = let_go(scene, 0 * shape, value, 2e-3, nodes)
    _, with_it = let_go(scene, shape, value, 2e-3, nodes)
    seen, left = one_oscillation(t, with_it - without, value)
    assert left < 0.1
    assert seen.imag == pytest.approx(value.imag, rel=1e-2)
    assert seen.real == pytest.approx(value.real, rel=0.35)


def test_falling_friction_excites_row_37():
    """A mass on a belt whose friction falls is a spring with the damper ``N f'(v)``, negative.

    ``λ² m + λ N f' + k = 0`` with ``f' = -(0.4 - 0.3) / d exp(-v / d)``. With the sharp fall of the
    scene itself nothing is left of the slope at 0.1 m/s, and it grows by no vibration: the limit
    cycle is reached by sticking.
    """
    slope = -0.1 / DECAY * np.exp(-SPEED / DECAY)
    rate = -FORCE * slope / (2 * MASS)
    omega = np.sqrt(STIFFNESS / MASS - rate**2)
    scene = Scene.load("mass-on-belt", **{"contacts.sole.friction.decay": DECAY})
    (mode,) = squeal(scene, comm=MPI.COMM_SELF, top=1e3).summary["modes"]
    assert mode["growth_rate"] == pytest.approx(rate, rel=1e-4)
    assert mode["frequency"] == pytest.approx(omega / (2 * np.pi), rel=1e-4)
    found = squeal(Scene.load("mass-on-belt"), comm=MPI.COMM_SELF, top=1e3).summary
    assert found["unstable"] == 0


@pytest.mark.slow
def test_mass_on_a_belt_in_time_row_37():
    """Static friction 0.4, kinetic 0.3: sticks 20.000 ms, slips 47.124 ms, swings by 1.4142 mm.

    Slip begins where the spring holds 40 N, 1 mm from where it holds the 30 N of slip, at the speed
    of the belt, 1 mm times ω: the swing is √2 mm, slip is 3/4 of a turn, and the belt carries the
    mass over 2 mm. At both ends of slip it is accelerated by 10 N, so it is slower than w for
    20 ms + 2 w / (10 m/s²).
    """
    w, model = 1e-3, build(Scene.load("mass-on-belt"), MPI.COMM_SELF)
    start(model, lambda line: None)

    def mean(x):
        return x.x.array[::3].mean()

    t, u, v = np.array([(s.t, mean(s.u), mean(s.v)) for s in steps(model, 0.18)])[::5].T
    late = t > 0.1  # from its second slip on
    assert np.ptp((u - SPEED * t)[late]) / 2 == pytest.approx(np.sqrt(2) * 1e-3, rel=1e-2)
    turns = np.flatnonzero(np.diff((np.abs(v) < w).astype(int)))
    first, _, *_ = turns[t[turns] > 0.07]  # sticks
    begins, ends, again = t[turns[turns >= first][:3]]
    assert ends - begins == pytest.approx(20e-3 + 2 * w / 10.0, rel=1e-2)
    assert again - ends == pytest.approx(1.5 * np.pi / 100.0 - 2 * w / 10.0, rel=1e-2)
