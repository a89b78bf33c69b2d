# SPDX-License-Identifier: LGPL-3.0-or-later
"""Central difference: conventions of time, supports and point masses; the guard of its result."""

from mpi4py import MPI

import numpy as np
import pytest

from forms.springs.connections import Connections
from forms.springs.point_masses import PointMasses
from workflow.model.model import Model, build
from workflow.model.supports import Supports
from workflow.scene.scene import Scene
from workflow.simulation import guards
from workflow.simulation.stepping import central_difference, no_hold

G = np.array([1.0, -2.0, 3.0])


@pytest.fixture
def model() -> Model:
    """Four cells of the bar, clamped in x at one end."""
    small = {"mesh.length": 0.04, "mesh.width": 0.01, "mesh.size": 0.01}
    return build(Scene.load("bar-wave", **small), MPI.COMM_SELF)


def flight(model: Model, hold=no_hold, steps: int = 7, dt: float = 1e-3):
    """Yield copies of t, u and v (at t) of a flight under gravity G, thrown at (5, 0, 0) m/s."""
    model.state.v.x.array[0::3] = 5.0

    def weight(state, force):
        force.array[:] += (model.mass.array.reshape(-1, 3) * G).ravel()

    loop = central_difference(model.state, model.mass.petsc_vec, [weight], hold, dt, steps * dt)
    for s in loop:
        v = s.v.x.array + dt / 2 * s.a.array
        yield s.t, s.u.x.array.reshape(-1, 3).copy(), v.reshape(-1, 3)


def test_free_flight_is_exact(model):
    """Constant acceleration: u = v₀ t + G t²/2 and v = v₀ + G t at every step, to round-off."""
    times = []
    for t, u, v in flight(model):
        times.append(t)
        np.testing.assert_allclose(
            u, np.tile([5.0 * t, 0, 0] + G * t**2 / 2, (len(u), 1)), rtol=1e-13
        )
        np.testing.assert_allclose(v, np.tile([5.0, 0, 0] + G * t, (len(u), 1)), rtol=1e-13)
    np.testing.assert_allclose(times, 1e-3 * np.arange(8), rtol=1e-14)
    assert model.state.step == 7


def test_supports_stay_where_they_are(model):
    """Nodes of x = 0 keep u_x = 0 when at rest at the start; the others fly."""
    x = model.domain.V.tabulate_dof_coordinates()[:, 0]
    clamped = np.isclose(x, 0)
    model.state.v.x.array[:] = 0.0
    for _, u, _ in flight(model, hold=held_from_rest(model)):
        pass
    assert not u[clamped, 0].any()
    assert u[clamped, 1].all() and u[~clamped].all()


def test_supports_take_only_the_held_component(model):
    """Along an axis it is exactly zero, along a slanted n it is a − (a·n) n; other nodes are left.

    The groups overlap, as on an edge: the node of both loses y and then n, which is normal to y.
    """
    n = np.array([0.6, 0.0, -0.8])
    y = np.array([0.0, -1.0, 0.0])
    hold = Supports([np.array([1, 4], dtype=np.int32), np.array([4, 7], dtype=np.int32)], [y, n])
    a = model.state.a
    a.array[:] = np.random.default_rng(2).standard_normal(len(a.array))
    expected = a.array.reshape(-1, 3).copy()
    hold(a)
    expected[[1, 4], 1] = 0.0
    for node in (4, 7):
        expected[node] -= (expected[node] @ n) * n
    held = a.array.reshape(-1, 3)
    assert not held[[1, 4], 1].any()
    np.testing.assert_allclose(held, expected, rtol=1e-14, atol=1e-15)


def test_steps_start_from_the_dead_force(model):
    """The weight as a constant force and nothing added: the parabola of a free flight."""
    weight = (model.mass.array.reshape(-1, 3) * G).ravel()[: 3 * model.domain.owned]
    args = model.state, model.mass.petsc_vec, [], no_hold, 1e-3, 7e-3
    for s in central_difference(*args, dead=weight):
        u = s.u.x.array.reshape(-1, 3)
        np.testing.assert_allclose(u, np.tile(G * s.t**2 / 2, (len(u), 1)), rtol=1e-13)
    assert s.step == 7


def held_from_rest(model: Model):
    """The model's supports, whose nodes also lose the throw of ``flight``."""

    def hold(a):
        model.supports(a)
        if model.state.step == 0:
            model.supports(model.state.v.x)

    return hold


def test_loads_see_the_velocity_half_a_step_back(model):
    """At the start v is that of t; later a load at t sees v(t − dt/2) = 5 + G (t − dt/2)."""
    dt, seen = 1e-3, []

    def weight(state, force):
        seen.append(state.v.x.array[0])
        force.array[:] += (model.mass.array.reshape(-1, 3) * G).ravel()

    model.state.v.x.array[0::3] = 5.0
    for _ in central_difference(model.state, model.mass.petsc_vec, [weight], no_hold, dt, 3 * dt):
        pass
    np.testing.assert_allclose(seen, 5 + G[0] * np.array([0, 0.5, 1.5, 2.5]) * dt, rtol=1e-13)


def test_point_masses_fly_with_the_bodies(model):
    """A free point mass under gravity, thrown at 5 m/s, falls as exactly as the bodies do."""
    dt = 1e-3
    masses = PointMasses(np.array([3.0]), G, np.ones((1, 3)), np.zeros((1, 3)), np.zeros((1, 3)))
    masses.v[0, 0] = 5.0
    load = Connections(MPI.COMM_SELF, masses, [], dt).add
    loop = central_difference(
        model.state, model.mass.petsc_vec, [load], no_hold, dt, 7 * dt, [masses]
    )
    for s in loop:
        np.testing.assert_allclose(masses.u[0], [5.0 * s.t, 0, 0] + G * s.t**2 / 2, rtol=1e-13)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_non_finite_motion_is_caught_with_its_place(model, bad):
    """A bad displacement runs through the fast-math kernel to the guard, which names the node."""
    node = int(np.argmax(model.domain.V.tabulate_dof_coordinates().sum(axis=1)))
    model.state.u.x.array[3 * node] = bad
    loads = [model.internal.add]
    loop = central_difference(model.state, model.mass.petsc_vec, loads, no_hold, model.dt, 1.0)
    next(loop)
    with pytest.raises(guards.GuardError, match=r"step 0.*body 'bar' \(bar\), node .* x = 0.0[34]"):
        guards.check_finite(model)


def test_finite_motion_passes_the_guard(model):
    """The same step without the bad number; one that comes later is found too."""
    model.state.u.x.array[:] = np.random.default_rng(0).standard_normal(len(model.state.u.x.array))
    loads = [model.internal.add]
    loop = central_difference(model.state, model.mass.petsc_vec, loads, no_hold, model.dt, 1.0)
    next(loop)
    assert np.abs(model.state.a.array).max() > 0
    guards.check_finite(model)
    model.state.v.x.array[7] = -np.inf
    next(loop)
    with pytest.raises(guards.GuardError, match="non-finite"):
        guards.check_finite(model)
