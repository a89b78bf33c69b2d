# SPDX-License-Identifier: LGPL-3.0-or-later
"""Springs, dampers and point masses against one- and two-mass closed forms (row 19)."""

from types import SimpleNamespace

from mpi4py import MPI

import numpy as np
import pytest

from forms.springs import springs
from forms.springs.connections import Connections
from forms.springs.point_masses import PointMasses
from forms.springs.springs import Springs

UP = np.array([0.0, 0.0, 1.0])
NOTHING = np.zeros(3)


def point_masses(mass, *, stiffness=NOTHING, damping=NOTHING, free=np.ones(3), gravity=NOTHING):
    """Point masses, each with the same springs and dampers to the ground."""
    n = len(mass)
    tile = [np.tile(np.asarray(a, dtype=float), (n, 1)) for a in (free, stiffness, damping)]
    return PointMasses(np.asarray(mass, dtype=float), np.asarray(gravity, dtype=float), *tile)


def nodes(n: int):
    """A state of n nodes at rest, and an array for their forces."""
    u, v = (SimpleNamespace(x=SimpleNamespace(array=np.zeros(3 * n))) for _ in range(2))
    return SimpleNamespace(u=u, v=v, step=0), SimpleNamespace(array=np.zeros(3 * n))


def release(masses: PointMasses, links, dt: float, steps: int, n: int = 0):
    """Let point masses go with all nodes held; return z and the energies at every step."""
    connections = Connections(MPI.COMM_SELF, masses, links, dt)
    state, force = nodes(n)
    z, energy = [], []
    for i in range(steps):
        state.step = i
        connections.add(state, force)
        if i == 0:
            masses.back(dt / 2)
        kinetic, stored = masses.kinetic_energy(dt), connections.stored_energy(state.u.x.array)
        z.append(masses.u[0, 2])
        energy.append([kinetic, stored, connections.dissipation()])
        masses.step(dt)
    return np.array(z), np.array(energy)


def crossings(z: np.ndarray, dt: float) -> np.ndarray:
    """Times at which z falls through zero."""
    i = np.flatnonzero((z[:-1] > 0) & (z[1:] <= 0))
    return (i + z[i] / (z[i] - z[i + 1])) * dt


def spread(k, c=0.0, *, n: int = 3) -> Springs:
    """Vertical springs of total stiffness k and damping c from n nodes to mass 0."""
    share = np.ones((n, 1)) / n
    dofs, point = np.arange(n, dtype=np.int32), np.zeros(n, dtype=np.int32)
    return springs.spread(MPI.COMM_SELF, dofs, k * share * UP, c * share * UP, point)


def mean(k, c=0.0) -> Springs:
    """One spring and damper from the mean of three nodes to mass 0."""
    dofs = np.arange(3, dtype=np.int32)
    return springs.mean(MPI.COMM_SELF, dofs, np.array([0.5, 0.3, 0.2]), k * UP, c * UP, 0)


M, K, ZETA = 250.0, 4e6, 0.05
C = 2 * ZETA * np.sqrt(K * M)
HOLDERS = {
    "ground": lambda: (point_masses([M], stiffness=K * UP, damping=C * UP), []),
    "spread": lambda: (point_masses([M]), [spread(K, C)]),
    "mean": lambda: (point_masses([M]), [mean(K, C)]),
}


@pytest.mark.parametrize("holder", HOLDERS)
def test_row_19_oscillator_frequency_and_decrement(holder):
    """250 kg on 4 MN/m with ζ = 5 %: ω_d = ω √(1−ζ²), log decrement 2πζ/√(1−ζ²), 0.1 %.

    At 600 steps a period the step shortens the period by (ω dt)²/24 = 5e-6, and the damper that
    lags half a step adds ζ ω dt / 2 = 3e-4 to the decrement.
    """
    masses, links = HOLDERS[holder]()
    omega = np.sqrt(K / M)
    dt = 2 * np.pi / omega / 600
    masses.u[0, 2] = 1e-3
    z, _ = release(masses, links, dt, 600 * 6, n=3)
    t = crossings(z, dt)
    assert 2 * np.pi / np.diff(t).mean() == pytest.approx(omega * np.sqrt(1 - ZETA**2), rel=1e-3)
    peaks = [z[i : i + 600].max() for i in range(300, 2701, 600)]
    decrement = -np.diff(np.log(peaks)).mean()
    assert decrement == pytest.approx(2 * np.pi * ZETA / np.sqrt(1 - ZETA**2), rel=1e-3)


@pytest.mark.parametrize("holder", HOLDERS)
def test_energy_of_a_damped_oscillator_closes_to_round_off(holder):
    """Kinetic + stored + dissipated energy stays what it was, even with coarse steps.

    The kinetic energy of the half-steps around the start is −(ω dt)²/4 of that, not zero.
    """
    masses, links = HOLDERS[holder]()
    dt = 0.2 / np.sqrt(K / M)
    masses.u[0, 2] = 1e-3
    _, energy = release(masses, links, dt, 1000, n=3)
    total = energy.sum(axis=1)
    assert energy[-1, 2] > 0.95 * total[0]
    np.testing.assert_allclose(total, total[0], rtol=1e-12)
    assert total[0] == pytest.approx(K * 1e-6 / 2 * (1 - 0.2**2 / 4), rel=1e-12)


def test_dissipation_of_a_braked_mass():
    """A mass thrown at v₀ against a damper: m v₀²/2 (1 − exp(−2ct/m)) taken, 0.1 % at dt = m/500c.

    Near the end the velocity half a step ago makes it larger by c dt/m of the rest.
    """
    masses = point_masses([M], damping=C * UP)
    masses.v[0, 2] = 3.0
    dt, steps = M / C / 500, 500
    _, energy = release(masses, [], dt, steps + 1)
    expected = M * 3.0**2 / 2 * (1 - np.exp(-2 * C * dt * np.arange(steps + 1) / M))
    np.testing.assert_allclose(energy[:, 2], expected, atol=1e-3 * expected[-1])


def test_row_19_static_deflection_under_weight():
    """A sprung mass hangs lower than its axle box by m g / k, and then all is at rest."""
    masses = point_masses([M], free=UP, gravity=-9.81 * UP)
    link = mean(K)
    connections = Connections(MPI.COMM_SELF, masses, [link], 1e-6)
    state, force = nodes(3)
    state.u.x.array[2::3] = [0.01, 0.02, -0.03]
    connections.settle(state.u.x.array)
    at = 0.5 * 0.01 + 0.3 * 0.02 - 0.2 * 0.03
    assert masses.u[0, 2] == pytest.approx(at - M * 9.81 / K, rel=1e-12)
    connections.add(state, force)
    np.testing.assert_allclose(masses.force, 0, atol=1e-9 * M * 9.81)
    np.testing.assert_allclose(force.array.reshape(3, 3).sum(axis=0), -M * 9.81 * UP, atol=1e-8)


def test_mean_spring_does_not_feel_a_ring_turn_but_a_spread_one_does():
    """A ring of nodes turned by 40 degrees about its axis: no force; shifted by 1 mm: k · 1 mm."""
    a = np.arange(8) * np.pi / 4
    ring = 0.08 * np.column_stack([np.cos(a), 0 * a, np.sin(a)])
    turn = np.radians(40)
    R = np.array([[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]])
    masses = point_masses([M])
    dofs = np.arange(8, dtype=np.int32)
    k = np.full(3, K)
    link = springs.mean(MPI.COMM_SELF, dofs, np.full(8, 1 / 8), k, 0 * k)
    state, force = nodes(8)
    state.u.x.array[:] = (ring @ R.T - ring).ravel()
    link.add(state.u.x.array, state.v.x.array, masses, force.array, masses.force, 0.0)
    np.testing.assert_allclose(force.array, 0, atol=1e-12 * K * 0.08)
    state.u.x.array.reshape(-1, 3)[:, 2] += 1e-3
    link.add(state.u.x.array, state.v.x.array, masses, force.array, masses.force, 0.0)
    np.testing.assert_allclose(force.array.reshape(8, 3)[:, 2], -K * 1e-3 / 8, rtol=1e-9)
    each = springs.spread(MPI.COMM_SELF, dofs, np.full((8, 3), K / 8), 0 * ring)
    force.array[:] = 0.0
    each.add(state.u.x.array, state.v.x.array, masses, force.array, masses.force, 0.0)
    assert np.abs(force.array).max() > 0.5 * K / 8 * 0.08 * 2 * np.sin(turn / 2)


def test_reaction_on_the_masses_balances_the_forces_on_the_nodes():
    """Springs and dampers to two free masses: nodal forces and mass forces sum to zero."""
    random = np.random.default_rng(0)
    masses = point_masses([M, 2 * M])
    k, c = random.uniform(1, 2, (2, 5, 3))
    dofs, point = np.arange(5, dtype=np.int32), np.array([0, 1, 1, 0, 0], dtype=np.int32)
    links = [springs.spread(MPI.COMM_SELF, dofs, K * k, C * c, point), mean(K, C)]
    state, force = nodes(5)
    state.u.x.array[:], state.v.x.array[:] = random.standard_normal((2, 15))
    masses.u[:], masses.v[:] = random.standard_normal((2, 2, 3))
    Connections(MPI.COMM_SELF, masses, links, 1e-6).add(state, force)
    assert np.abs(masses.force).max() > K
    total = force.array.reshape(-1, 3).sum(axis=0) + masses.force.sum(axis=0)
    np.testing.assert_allclose(total, 0, atol=1e-12 * np.abs(masses.force).max())


def test_spread_springs_node_by_node():
    """−k e − c ė on every node, e from its mass or the ground; a node may have two springs.

    Against a loop over the springs; and the same with no point mass at all.
    """
    random = np.random.default_rng(3)
    masses = point_masses([M, M])
    dofs = np.array([3, 0, 3, 4, 1], dtype=np.int32)
    point = np.array([1, -1, 0, 1, -1], dtype=np.int32)
    k, c = random.uniform(1, 2, (2, 5, 3))
    u, v = random.standard_normal((2, 5, 3))
    masses.u[:], masses.v[:] = random.standard_normal((2, 2, 3))
    force, reaction = np.zeros(15), np.zeros((2, 3))
    link = springs.spread(MPI.COMM_SELF, dofs, k, c, point)
    link.add(u.ravel(), v.ravel(), masses, force, reaction, 0.0)
    nodal, ends = np.zeros((5, 3)), np.zeros((2, 3))
    for i, (node, m) in enumerate(zip(dofs, point, strict=True)):
        q, w = (masses.u[m], masses.v[m]) if m >= 0 else (0.0, 0.0)
        f = -k[i] * (u[node] - q) - c[i] * (v[node] - w)
        nodal[node] += f
        if m >= 0:
            ends[m] -= f
    np.testing.assert_allclose(force.reshape(-1, 3), nodal, rtol=1e-13)
    np.testing.assert_allclose(reaction, ends, rtol=1e-13)
    force[:] = 0.0
    ground = springs.spread(MPI.COMM_SELF, dofs[1:2], k[1:2], c[1:2])
    ground.add(u.ravel(), v.ravel(), point_masses([]), force, np.zeros((0, 3)), 0.0)
    np.testing.assert_allclose(force[:3], -k[1] * u[0] - c[1] * v[0], rtol=1e-13)


def test_condensed_stiffness_is_the_derivative_of_the_settled_forces():
    """−∂f_i/∂u_j with the masses at rest again, by exact differences of a linear model: 1e-11.

    Three masses, one of them on the ground spring, one shared by two links, one node on the ground,
    held in x; nodes with shuffled global numbers.
    """
    random = np.random.default_rng(1)
    masses = point_masses([M, M, M], free=[0, 1, 1])
    masses.base_stiffness[1] = [1e6, 2e6, 3e6]
    k = random.uniform(1e6, 5e6, (6, 3))
    dofs = np.array([0, 1, 2, 3, 4, 5], dtype=np.int32)
    point = np.array([0, 0, 1, 1, -1, 2], dtype=np.int32)
    links = [springs.spread(MPI.COMM_SELF, dofs, k, 0 * k, point), mean(K)]
    connections = Connections(MPI.COMM_SELF, masses, links, 1e-6)
    number = random.permutation(6)
    rows, columns, values = connections.stiffness(number)
    condensed = np.zeros((18, 18))
    np.add.at(condensed, (rows, columns), values)
    dof = (3 * number[:, None] + np.arange(3)).ravel()
    expected = np.zeros_like(condensed)
    for j in range(18):
        state, force = nodes(6)
        state.u.x.array[j] = 1.0
        connections.settle(state.u.x.array)
        connections.add(state, force)
        expected[dof, dof[j]] = -force.array
    np.testing.assert_allclose(condensed, expected, atol=1e-11 * K)


def test_tangent_with_point_masses_is_the_derivative_of_the_forces():
    """−∂f_i/∂u_j and −∂f_i/∂v_j over nodes and free components of masses, by exact differences.

    The model of the condensed stiffness, with dampers, one of them a matrix; condensing the masses
    out of the stiffness gives that one.
    """
    random = np.random.default_rng(1)
    masses = point_masses([M, M, M], free=[0, 1, 1])
    masses.base_stiffness[1], masses.base_damping[1] = [1e6, 2e6, 3e6], [1e3, 2e3, 3e3]
    k, c = random.uniform(1e6, 5e6, (6, 3)), random.uniform(1e3, 5e3, (6, 3, 3))
    dofs = np.arange(6, dtype=np.int32)
    point = np.array([0, 0, 1, 1, -1, 2], dtype=np.int32)
    links = [springs.spread(MPI.COMM_SELF, dofs, k, c + c.swapaxes(1, 2), point), mean(K, 1e3)]
    connections = Connections(MPI.COMM_SELF, masses, links, 1e-6)
    number, free = random.permutation(6), masses.free.ravel() > 0
    dof = np.concatenate([(3 * number[:, None] + np.arange(3)).ravel(), 18 + np.arange(6)])
    found = np.zeros((2, 24, 24))
    for part, (rows, columns, values) in zip(found, connections.tangent(number, 18), strict=True):
        np.add.at(part, (rows, columns), values)
    expected = np.zeros_like(found)
    for which, j in np.ndindex(2, 24):
        state, force = nodes(6)
        masses.u[:], masses.v[:] = 0.0, 0.0
        nodal, inner = ((state.u, masses.u), (state.v, masses.v))[which]
        if j < 18:
            nodal.x.array[j] = 1.0
        else:
            inner.reshape(-1)[np.flatnonzero(free)[j - 18]] = 1.0
        connections.add(state, force)
        all_forces = np.concatenate([force.array, masses.force.ravel()[free]])
        expected[which, dof, dof[j]] = -all_forces
    np.testing.assert_allclose(found[0], expected[0], atol=1e-11 * K)
    np.testing.assert_allclose(found[1], expected[1], atol=1e-11 * K)
    rows, columns, values = connections.stiffness(number)
    condensed = np.zeros((18, 18))
    np.add.at(condensed, (rows, columns), values)
    A = found[0]
    settled = A[:18, :18] - A[:18, 18:] @ np.linalg.solve(A[18:, 18:], A[18:, :18])
    np.testing.assert_allclose(settled, condensed, atol=1e-11 * K)
