# SPDX-License-Identifier: LGPL-3.0-or-later
"""Tractions, dead loads, mass damping and drive torque against closed forms."""

from types import SimpleNamespace

from mpi4py import MPI

import numpy as np
import pytest

from forms.loads import (
    DeadLoad,
    DriveTorque,
    MassDamping,
    TimedLoad,
    nodal_pressure,
    nodal_traction,
    smooth_step,
)
from meshes.shapes import blocks, caps
from meshes.shapes.shells import hollow_sphere
from meshes.tags import Tag

AXIS = np.array([0.6, 0.0, 0.8])


def motion(n: int):
    """A state of n nodes at rest and an array for their forces."""
    u, v = (SimpleNamespace(x=SimpleNamespace(array=np.zeros(3 * n))) for _ in range(2))
    return SimpleNamespace(u=u, v=v, t=0.0, step=0), SimpleNamespace(array=np.zeros(3 * n))


def test_traction_sums_to_area_times_traction_at_the_centroid():
    """Irregular quads on the rectangle 2 × 3: total 6 t, first moment that of the rectangle."""
    face = blocks.block((0, 0, 0), (2, 3, 1), cells=(4, 5, 1))
    shift = np.random.default_rng(0).uniform(-0.1, 0.1, face.points.shape) * [1, 1, 0]
    inside = np.all((face.points[:, :2] > 0.01) & (face.points[:, :2] < [1.99, 2.99]), axis=1)
    points = face.points + shift * inside[:, None]
    t = np.array([1e6, -2e6, 3e5])
    f = nodal_traction(points, face.surface(Tag.ZMAX), t)
    np.testing.assert_allclose(f.sum(axis=0), 6 * t, rtol=1e-13)
    np.testing.assert_allclose(f[:, 0] @ points, 6 * t[0] * np.array([1, 1.5, 1]), rtol=1e-13)
    assert not f[points[:, 2] == 0].any()


def test_traction_on_a_cap_converges_to_its_area():
    """A quarter cap over a square of 20 mm on a sphere of 50 mm: area by a fine midpoint rule.

    Facets cut the sphere by h²/24R² of its area, 1e-5 at 1 mm, and the 2 × 2 points less: 1e-4.
    """
    cap = caps.sphere_cap(0.05, 0.02, size=1e-3, growth=1.0)
    f = nodal_traction(cap.points, cap.surface(Tag.CAP), np.array([0, 0, 1.0]))
    x = (np.arange(1000) + 0.5) * 0.02 / 1000
    area = (0.05 / np.sqrt(0.05**2 - x**2 - x[:, None] ** 2)).sum() * (0.02 / 1000) ** 2
    assert f[:, 2].sum() == pytest.approx(area, rel=1e-4)


def test_pressure_pushes_against_the_normal():
    """On the flat side of a box p A, against the outward normal; on all of a body nothing in sum.

    Inside an eighth of a hollow sphere it is p π a² / 4 along each axis, less what facets cut off.
    """
    box = blocks.block((0, 0, 0), (2.0, 1.0, 3.0), size=0.5)
    f = nodal_pressure(box.points, box.surface(Tag.ZMAX), 7.0)
    np.testing.assert_allclose(f.sum(axis=0), [0, 0, -14.0], atol=1e-12)
    np.testing.assert_allclose(
        nodal_pressure(box.points, box.facets, 7.0).sum(axis=0), 0, atol=1e-12
    )
    sphere = hollow_sphere(1.0, 2.0, 0.5, across=16)
    f = nodal_pressure(sphere.points, sphere.surface(Tag.INSIDE), 1.0)
    np.testing.assert_allclose(f.sum(axis=0), np.pi / 4, rtol=1e-3)


def test_ramped_load_comes_up_and_knows_its_work():
    """A third of the way 17/81 of the load; on a spring k its work is that of the path, F²/2k.

    The spring follows at once, u = F / k; a checkpoint in the middle changes nothing.
    """
    load, (state, force) = TimedLoad(MPI.COMM_SELF, np.array([6.0, 0, 0]), 3.0), motion(1)
    assert load.rest is None
    for k in range(401):
        state.t, force.array[:] = k / 100, 0.0
        state.u.x.array[0] = 6.0 * smooth_step(state.t / 3.0) / 2.0
        load.add(state, force)
        if k == 100:
            assert force.array[0] == pytest.approx(6 * 17 / 81)
        if k == 200:
            kept = load.memory()
            load = TimedLoad(MPI.COMM_SELF, load.nodal, load.time)
            load.add(state, motion(1)[1])
            load.restore(kept)
    assert force.array[0] == 6.0
    assert load.energy(state)["external_work"] == pytest.approx(9.0, rel=1e-12)


def test_dead_load_adds_itself_and_knows_its_work():
    """Work F · u of owned dofs; a ghost at the end is left alone."""
    load = DeadLoad(MPI.COMM_SELF, np.arange(6.0))
    state, force = motion(3)
    force.array[:] = 1.0
    load.add(state, force)
    np.testing.assert_array_equal(force.array, [1, 2, 3, 4, 5, 6, 1, 1, 1])
    state.u.x.array[:] = 2.0
    assert load.energy(state) == {"external_work": 30.0}


def test_mass_damping_slows_by_exp_of_minus_alpha_t():
    """v' = −α v: v₀ exp(−α t), and m v₀²/2 (1 − exp(−2 α t)) taken; α dt = 1e-3, so 0.1 %."""
    alpha, dt, m, v0 = 40.0, 2.5e-5, 3.0, 7.0
    load = MassDamping(MPI.COMM_SELF, np.full(3, alpha * m), dt)
    state, force = motion(1)
    state.v.x.array[:] = v0
    for step in range(1001):
        force.array[:] = 0.0
        load.add(state, force)
        state.v.x.array[:] += force.array / m * dt * (0.5 if step == 0 else 1.0)
    t = 1000 * dt
    np.testing.assert_allclose(state.v.x.array, v0 * np.exp(-alpha * t), rtol=2e-3)
    taken = 3 * m * v0**2 / 2 * (1 - np.exp(-2 * alpha * t))
    assert load.dissipation == pytest.approx(taken, rel=1e-3)


def drive(torque: float, ramp: float = 0.0) -> DriveTorque:
    """A torque about a slanted axis on the last 10 of 12 nodes with random places and masses."""
    random = np.random.default_rng(1)
    dofs = np.arange(2, 12, dtype=np.int32)
    places, mass = random.standard_normal((10, 3)), random.uniform(1, 3, 10)
    return DriveTorque(MPI.COMM_SELF, dofs, mass, places, AXIS, torque, ramp)


def rotation(angle: float) -> np.ndarray:
    """Rotation about ``AXIS`` (Rodrigues' formula)."""
    N = np.cross(AXIS, np.eye(3)).T
    return np.eye(3) + np.sin(angle) * N + (1 - np.cos(angle)) * N @ N


def test_torque_gives_a_rigid_angular_acceleration_and_no_net_force():
    """T = 500 N m: Σ f = 0, axial moment T, and a = (T / I) n × r with I = Σ m r²."""
    load = drive(500.0)
    state, force = motion(12)
    load.add(state, force)
    f = force.array.reshape(-1, 3)[2:]
    assert not force.array[:6].any()
    centre = load.mass @ load.reference / load.mass.sum()
    arm = load.reference - centre
    distance = np.linalg.norm(np.cross(AXIS, arm), axis=1)
    inertia = load.mass @ distance**2
    np.testing.assert_allclose(f.sum(axis=0), 0, atol=1e-12 * np.abs(f).max())
    assert np.cross(arm, f).sum(axis=0) @ AXIS == pytest.approx(500.0, rel=1e-13)
    acceleration = 500.0 / inertia * np.cross(AXIS, arm)
    np.testing.assert_allclose(f / load.mass[:, None], acceleration, rtol=1e-12, atol=1e-12)


def test_work_of_the_torque_is_torque_times_angle():
    """Two turns while flying off: W = T φ; each step of 1/500 turn gives T sin(Δφ), 3e-5 less."""
    load = drive(500.0)
    state, force = motion(12)
    centre = load.mass @ load.reference / load.mass.sum()
    for angle in np.linspace(0, 4 * np.pi, 1001):
        turned = (load.reference - centre) @ rotation(angle).T + centre + angle * AXIS[::-1]
        state.u.x.array.reshape(-1, 3)[2:] = turned - load.reference
        load.add(state, force)
    assert load.work == pytest.approx(500.0 * 4 * np.pi, rel=3e-5)


def test_work_of_the_torque_is_that_of_its_forces():
    """Nodes that move at random while the torque rises: W = Σ (f₀ + f) · Δu / 2, to round-off."""
    load, random = drive(500.0, ramp=1.0), np.random.default_rng(4)
    state, last = motion(12)[0], motion(12)[1].array
    before, work = state.u.x.array.copy(), 0.0
    for state.t in np.linspace(0, 1.5, 16):
        force = motion(12)[1]
        load.add(state, force)
        work += float((last + force.array) @ (state.u.x.array - before)) / 2
        before, last = state.u.x.array.copy(), force.array
        state.u.x.array[:] += random.standard_normal(36)
    assert load.work == pytest.approx(work, rel=1e-12)
    assert abs(work) > 1.0


def test_work_of_a_ramped_torque():
    """Turning evenly while the torque rises to T: W = T φ / 2."""
    load = drive(500.0, ramp=1.0)
    state, force = motion(12)
    centre = load.mass @ load.reference / load.mass.sum()
    for state.t in np.linspace(0, 1, 201):
        turned = (load.reference - centre) @ rotation(state.t).T + centre
        state.u.x.array.reshape(-1, 3)[2:] = turned - load.reference
        load.add(state, force)
    assert load.work == pytest.approx(500.0 / 2, rel=3e-5)


@pytest.mark.parametrize(("t", "share"), [(0.0, 0.0), (1e-3, 0.25), (4e-3, 1.0), (9e-3, 1.0)])
def test_torque_is_ramped_linearly(t, share):
    """From nothing to T over 4 ms, and no further."""
    load, full = drive(500.0, ramp=4e-3), drive(500.0)
    state, force = motion(12)
    state.t = t
    load.add(state, force)
    expected = motion(12)[1]
    full.add(state, expected)
    np.testing.assert_allclose(force.array, share * expected.array, rtol=1e-14)
