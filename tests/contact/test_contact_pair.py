# SPDX-License-Identifier: LGPL-3.0-or-later
"""Forces of a contact pair: sums, friction cone, objectivity, closed forms, energies."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from contact import ContactPair, rigid_plane
from tests.skins import (
    RHO_H,
    evaluate,
    plate_on_plane,
    skin,
    stacked,
    state_of,
    tangent_of,
    two_skins,
)


@pytest.mark.parametrize("friction", [0.0, 0.3, 1.2])
def test_action_equals_reaction_and_cone(friction):
    """Randomly moving deformable skins: forces and moments sum to zero, |F_t| <= friction F_n."""
    lower, upper = two_skins()
    pair = ContactPair(upper, lower, dt=1e-6, friction=friction, damping=0.1)
    X, state = stacked(lower, upper)
    rng = np.random.default_rng(3)
    top = slice(len(lower.nodes), None)
    most = 0
    state.u.x.array.reshape(-1, 3)[top, 2] = -8e-4
    for k in range(300):
        v = rng.normal(size=X.shape) * 1.0
        v[top] += [5.0 * np.cos(k / 30), 3.0, -2.0 * np.sin(k / 20)]
        state.v.x.array[:] = v.ravel()
        state.u.x.array[:] += pair.dt * v.ravel()
        f = evaluate(pair, state)
        x = X + state.u.x.array.reshape(-1, 3)
        x = x - x.mean(axis=0)
        size = np.abs(f).sum()
        most = max(most, pair.active)
        assert np.abs(f.sum(axis=0)).max() <= 1e-12 * size
        assert np.abs(np.cross(x, f).sum(axis=0)).max() <= 1e-12 * size * 0.05
        h = pair.passes[0].contact_state
        limit = friction * h.normal_force
        assert (np.linalg.norm(h.tangential_force, axis=1) <= limit * (1 + 1e-14)).all()
        assert np.abs(np.einsum("ia,ia->i", h.tangential_force, h.normal)).max() <= 1e-12 * size
    assert most > 10


def test_hand_numbers():
    """One node 1 um deep over the centre of a facet: k = penalty m_eff / dt^2, 1/5 : 4/5 : ..."""
    lower = skin(3, 3, 0.03, 0.03, lambda x, y: 0 * x, up=True)
    upper = skin(1, 1, 0.01, 0.01, lambda x, y: 0.02 + 0 * x, up=False, origin=(0.015, 0.015),
                 dof=16, first=50)  # fmt: skip
    _, state = stacked(lower, upper)
    pair = ContactPair(upper, lower, dt=1e-6, penalty=0.25)
    u = state.u.x.array.reshape(-1, 3)
    u[16] = [0.0, 0.0, -0.02 - 1e-6]  # node at (0.015, 0.015), the centre of the middle facet
    u[17:, 2] = 0.0
    f = evaluate(pair, state)
    m_c, m_t = RHO_H * 1e-4 / 4, RHO_H * 1e-4
    # the contactor is a quarter cell: four of its nodes would share a target node
    m_eff = 1.0 / (1.0 / m_c + 4.0 / m_t)
    expected = 0.25 * m_eff / 1e-12 * 1e-6
    assert f[16] == pytest.approx([0.0, 0.0, expected], rel=1e-9)
    assert pair.normal_force == pytest.approx(expected, rel=1e-9)
    middle = lower.facets[4]
    assert f[middle, 2] == pytest.approx(np.full(4, -expected / 4), rel=1e-9)
    assert pair.max_penetration == pytest.approx(1e-6, rel=1e-8)
    assert pair.stored_energy == pytest.approx(0.5 * expected * 1e-6, rel=1e-8)


def test_stick_spring_and_slip_dissipation():
    """Pushed sideways by s: F_t = k_t s up to friction * N; then friction * N * way is lost."""
    plate, pair, state = plate_on_plane(0.3, tangential=0.5)
    evaluate(pair, state)
    kn = 0.2 * plate.mass.sum() / 1e-12
    normal = kn * 1e-6
    assert pair.normal_force == pytest.approx(normal, rel=1e-12)
    u, v = state.u.x.array, state.v.x.array
    v[0::3] = 1e-2
    step = 1e-8
    for k in range(1, 31):
        u[0::3] += step
        evaluate(pair, state)
        assert pair.tangential_force[0] == pytest.approx(-0.5 * kn * k * step, rel=1e-10)
    assert pair.friction_dissipation == pytest.approx(0.0, abs=1e-15 * normal)
    for _ in range(200):
        u[0::3] += step
        evaluate(pair, state)
    assert pair.tangential_force == pytest.approx([-0.3 * normal, 0, 0], rel=1e-12)
    slid = 230 * step - 0.3 * normal / (0.5 * kn)
    assert pair.friction_dissipation == pytest.approx(0.3 * normal * slid, rel=1e-9)
    elastic = 0.5 * (0.3 * normal) ** 2 / (0.5 * kn)
    assert pair.stored_energy == pytest.approx(0.5 * normal * 1e-6 + elastic, rel=1e-9)


def test_objective_under_rigid_rotation():
    """Both skins turned together by 2 rad in 40 steps: the traction turns with them, no slip."""
    lower, upper = two_skins()
    pair = ContactPair(upper, lower, dt=1e-6, friction=0.5)
    X, state = stacked(lower, upper)
    u, v = state.u.x.array.reshape(-1, 3), state.v.x.array.reshape(-1, 3)
    top = slice(len(lower.nodes), None)
    shift = np.array([2e-7, 1e-7, 0.0])
    u[top, 2] = -8e-4
    evaluate(pair, state)
    for _ in range(40):  # some sticking, some slipping
        u[top] += shift
        v[top] = shift / pair.dt
        f0 = evaluate(pair, state)
    x0, lost = X + u, pair.friction_dissipation
    t0, active = pair.passes[0].contact_state.tangential_force.copy(), pair.active
    assert np.abs(t0).max() > 0
    axis = np.array([0.3, -0.5, 0.8]) / np.linalg.norm([0.3, -0.5, 0.8])
    for k in range(1, 41):
        x = Rotation.from_rotvec(0.05 * k * axis).apply(x0)
        v[:] = (x - X - u) / pair.dt
        u[:] = x - X
        f = evaluate(pair, state)
    turn = Rotation.from_rotvec(2.0 * axis)
    assert pair.active == active
    size = np.abs(f0).max()
    assert (
        np.abs(pair.passes[0].contact_state.tangential_force - turn.apply(t0)).max() <= 1e-9 * size
    )
    assert np.abs(f - turn.apply(f0)).max() <= 1e-9 * size
    assert pair.friction_dissipation == pytest.approx(lost, rel=1e-9)


def test_damping_pushes_never_pulls():
    """Separating fast while still overlapping: the damped force is zero, not negative."""
    _, pair, state = plate_on_plane(0.0, damping=0.5)
    state.v.x.array[2::3] = -1.0
    approach = evaluate(pair, state)[:, 2].sum()
    pair.reset()
    state.v.x.array[2::3] = 0.0
    rest = evaluate(pair, state)[:, 2].sum()
    state.v.x.array[2::3] = 100.0
    leave = evaluate(pair, state)
    assert approach > rest > 0.0
    assert (leave == 0.0).all()


def test_statics_ignores_velocity_and_matches_tangent():
    """friction=False: forces depend on u only and their derivative is minus the tangent."""
    lower, upper = two_skins()
    pair = ContactPair(upper, lower, dt=1e-6, friction=0.4)
    X, state = stacked(lower, upper)
    u = state.u.x.array.reshape(-1, 3)
    u[len(lower.nodes) :, 2] = -6e-4
    state.v.x.array[:] = np.nan
    f = evaluate(pair, state, friction=False)
    assert np.isfinite(f).all() and pair.active > 5
    K = tangent_of(pair, state, lower, upper)
    assert np.linalg.eigvalsh(K).min() >= -1e-9 * np.abs(K).max()
    step = 1e-10 * np.random.default_rng(0).normal(size=X.shape)
    u += step
    g = evaluate(pair, state, friction=False)
    assert np.abs((g - f).ravel() + K @ step.ravel()).max() <= 0.05 * np.abs(g - f).max()


def test_contact_found_in_statics_carries_over():
    """Stiffness and penetration after statics are those of the first dynamic step."""
    _, pair, state = plate_on_plane(0.3)
    f = evaluate(pair, state, friction=False)
    k = pair.passes[0].contact_state.stiffness.copy()
    assert evaluate(pair, state) == pytest.approx(f, rel=1e-14)
    assert (pair.passes[0].contact_state.stiffness == k).all()


def test_conservative_bounce():
    """A free plate on a frictionless plane: the spring gives back the kinetic energy."""
    plate, pair, state = plate_on_plane(0.0)
    u, v = state.u.x.array, state.v.x.array
    u[2::3] = 2e-6
    v[2::3] = -0.5
    mass = np.repeat(plate.mass, 3)
    for _ in range(200):
        f = evaluate(pair, state).ravel()
        v += pair.dt * f / mass
        u += pair.dt * v
    assert v[2::3] == pytest.approx(np.full(len(plate.nodes), 0.5), rel=1e-2)


@pytest.mark.parametrize(("friction", "damping"), [(0.3, 0.0), (0.3, 0.2), (0.0, 0.2)])
def test_energy_balance_of_a_sliding_plate(friction, damping):
    """Leapfrog: kinetic + stored + dissipated energy less the work of the load stays constant."""
    plate, pair, state = plate_on_plane(friction, damping=damping)
    u, v = state.u.x.array, state.v.x.array
    mass = np.repeat(plate.mass, 3)
    load = np.zeros(u.size)
    load[2::3] = -0.1 * mass[2::3] / pair.dt**2 * 1e-6
    v[0::3], v[2::3] = 0.2, -0.05
    work, start, error = 0.0, None, 0.0
    for _ in range(400):
        f = evaluate(pair, state).ravel() + load
        after = v + pair.dt * f / mass
        lost = pair.friction_dissipation + pair.damping_dissipation
        energy = 0.5 * mass @ (v * after) + pair.stored_energy + lost - work
        start = energy if start is None else start
        error = max(error, abs(energy - start))
        v[:] = after
        before = load @ u
        u += pair.dt * v
        work += load @ u - before
    assert lost > 0.1 * start if friction or damping else lost == 0.0
    assert error <= 1e-12 * start


def test_memory_resumes_bitwise():
    """Stop and go on in a new pair: the same forces to the last bit."""
    lower, upper = two_skins()
    options = {"dt": 1e-6, "friction": 0.3}
    one = ContactPair(upper, lower, **options)
    two = ContactPair(upper, lower, **options)
    X, state = stacked(lower, upper)
    rng = np.random.default_rng(7)
    for k in range(60):
        v = rng.normal(size=X.shape) * 0.5
        v[len(lower.nodes) :] += [4.0, 1.0, -3.0]
        state.v.x.array[:] = v.ravel()
        state.u.x.array[:] += 1e-6 * v.ravel()
        f = evaluate(one, state)
        if k == 30:
            two.restore(one.memory())
        if k > 30:
            assert (evaluate(two, state) == f).all()
    assert one.active > 0 and two.friction_dissipation == one.friction_dissipation


def test_penetration_names_the_deepest_node():
    plate, pair, state = plate_on_plane(0.0)
    state.u.x.array[3 * 7 + 2] = -5e-4
    depth, node, place = pair.penetration(state)
    assert depth == pytest.approx(5.01e-4) and node == plate.nodes[7]
    assert place == pytest.approx(plate.reference[7] + [0, 0, -5e-4])
    state.u.x.array[2::3] = 1.0
    assert pair.penetration(state)[:2] == (0.0, -1)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"dt": 0.0}, "dt"),
        ({"penalty": -1.0}, "penalty"),
        ({"damping": np.nan}, "damping"),
        ({"tangential": 0.0}, "tangential"),
        ({"reach": -1.0}, "reach"),
        ({"friction": -0.1}, "friction"),
        ({"friction": "high"}, "friction"),
    ],
)
def test_bad_options(change, message):
    lower, upper = two_skins()
    with pytest.raises(ValueError, match=message):
        ContactPair(upper, lower, **({"dt": 1e-6} | change))


def test_bad_arrays():
    _, pair, state = plate_on_plane(0.0)
    plane = rigid_plane((0, 0, 0), (0, 0, 1), 1.0)
    with pytest.raises(ValueError, match="rigid"):
        ContactPair(plane, plane, dt=1e-6)
    short = state_of(np.zeros(6), np.zeros(6))
    with pytest.raises(ValueError, match="expected u and v"):
        evaluate(pair, short)
    with pytest.raises(ValueError, match="float64"):
        pair.add(state, SimpleNamespace(array=np.zeros(75, dtype=np.float32)))
    state.u.x.array[4] = np.nan
    with pytest.raises(RuntimeError, match="node"):
        evaluate(pair, state)
