# SPDX-License-Identifier: LGPL-3.0-or-later
"""Springs and dampers between two bodies: closed forms, momentum, stiffness, step bound, ranks."""

from mpi4py import MPI

import numpy as np
import pytest
import scipy.linalg
from dolfinx import fem, la
from hypothesis import given, settings
from hypothesis import strategies as st

from forms.springs.connections import Connections
from forms.springs.point_masses import PointMasses
from forms.springs.springs import Springs, node_to_facet
from forms.springs.step_bound import attached, joined, joined_step
from meshes.domain import Domain, distribute
from meshes.hexmesh import join
from meshes.shapes import blocks
from meshes.tags import Tag
from meshes.wheel_rail.seats import below
from workflow.model.state import State
from workflow.simulation.stepping import central_difference, no_hold

COMM = MPI.COMM_WORLD if MPI.COMM_WORLD.size > 1 else MPI.COMM_SELF
GAP = 0.1
NOBODY = np.zeros((0, 3))


def nothing() -> PointMasses:
    """No point mass."""
    return PointMasses(np.zeros(0), np.zeros(3), NOBODY, NOBODY, NOBODY)


def two_blocks(comm: MPI.Comm = COMM) -> Domain:
    """A block of 3x3x1 cells with another, of 4x4x1, over its middle."""
    lower = blocks.block((0, 0, -1), (3, 3, 0), cells=(3, 3, 1))
    upper = blocks.block((0.4, 0.4, GAP), (2.4, 2.4, 1), cells=(4, 4, 1))
    return distribute(join(lower, upper), comm)


def between(domain: Domain, seed: int = 0, size: float = 1.0) -> Springs:
    """Random springs and dampers from the upper block's underside to the points below."""
    source, random = domain.source, np.random.default_rng(seed)
    nodes = np.flatnonzero(source.points[:, 2] == GAP)
    top = source.surface(Tag.ZMAX)
    top = top[(source.points[top][:, :, 2] == 0).all(axis=1)]
    facet, weights = below(source.points, top, source.points[nodes])
    k, c = size * 10 ** random.uniform(2, 4, (2, len(nodes), 3))
    ends = domain.local_dofs(facet), weights
    return node_to_facet(domain.msh.comm, domain.local_dofs(nodes), ends, k, 1e-3 * c)


def everywhere(domain: Domain, owned: np.ndarray) -> np.ndarray:
    """Values of the owned dofs by mesh node, on every rank, shape ``(n, 3)``."""
    nodal = np.zeros((len(domain.source.points), 3))
    nodal[domain.nodes[: domain.owned]] = owned.reshape(-1, 3)[: domain.owned]
    return domain.msh.comm.allreduce(nodal)


def shaken(domain: Domain, link: Springs) -> tuple[np.ndarray, float]:
    """Forces of all nodes under random displacements and velocities, and the spring energy."""
    drawn = np.random.default_rng(7).standard_normal((2, len(domain.source.points), 3))
    u, v = (np.ascontiguousarray(x[domain.nodes]).ravel() for x in drawn)
    force = np.zeros_like(u)
    link.add(u, v, nothing(), force, NOBODY, 0.0)
    return everywhere(domain, force), domain.msh.comm.allreduce(link.stored_energy(u, NOBODY))


def test_one_spring_by_hand():
    """−k e on the node, k e with bilinear weights on the facet; e = u − Σ b u."""
    domain = two_blocks(MPI.COMM_SELF)
    nodes = np.array([0, 1, 4, 5])
    weights, k, c = np.array([[0.4, 0.3, 0.2, 0.1]]), np.array([[1.0, 2, 3]]), np.zeros((1, 3))
    dofs = domain.local_dofs(nodes)
    node = domain.local_dofs(np.array([40]))
    link = node_to_facet(MPI.COMM_SELF, node, (dofs[None], weights), k, c)
    u = np.random.default_rng(0).standard_normal((domain.owned, 3))
    force = np.zeros_like(u)
    link.add(u.ravel(), 0 * u.ravel(), nothing(), force.reshape(-1), NOBODY, 0.0)
    f = -k[0] * (u[node[0]] - weights[0] @ u[dofs])
    np.testing.assert_allclose(force[node[0]], f, rtol=1e-14)
    np.testing.assert_allclose(force[dofs], -np.outer(weights[0], f), rtol=1e-13)
    assert np.count_nonzero(force.any(axis=1)) == 5


def test_forces_sum_to_zero_and_so_does_the_moment_of_vertical_ones():
    """Σ f = 0 to round-off. Moments: those of shear forces on the lever of the gap, no other."""
    domain = two_blocks(MPI.COMM_SELF)
    link = between(domain)
    force, _ = shaken(domain, link)
    scale = np.abs(force).sum()
    assert np.abs(force.sum(axis=0)).max() < 1e-15 * scale
    moment = np.cross(domain.source.points, force).sum(axis=0)
    upper = domain.source.points[:, 2] >= GAP
    shear = force[upper].sum(axis=0)
    assert moment == pytest.approx(GAP * np.array([-shear[1], shear[0], 0]), abs=1e-14 * scale)


def assembled(domain: Domain, link: Springs, number: np.ndarray) -> np.ndarray:
    """Matrix of the triplets by the given numbers of owned dofs, all on the first rank."""
    K = np.zeros((3 * len(domain.source.points),) * 2)
    load = Connections(domain.msh.comm, nothing(), [link], 1.0)
    rows, columns, values = load.stiffness(number)
    np.add.at(K, (rows, columns), values)
    return K


def test_stiffness_is_the_derivative_of_the_force_and_of_the_energy():
    """K u = −f, u K u / 2 = stored energy, to 1e-13; and all of it is there."""
    domain = two_blocks(MPI.COMM_SELF)
    link = between(domain)
    u = np.random.default_rng(1).standard_normal(3 * domain.owned)
    force = np.zeros_like(u)
    link.add(u, 0 * u, nothing(), force, NOBODY, 0.0)
    K = assembled(domain, link, np.arange(domain.owned))
    np.testing.assert_allclose(K @ u, -force, atol=1e-13 * np.abs(force).max())
    assert u @ K @ u / 2 == pytest.approx(link.stored_energy(u, NOBODY), rel=1e-13)
    assert np.linalg.matrix_rank(K) == link.stiffness.size


def test_majorant_of_one_mass_on_another_is_exact():
    """A node on a node: both sides k (1/m + 1/M), the eigenvalue of the pair."""
    node, ends = np.array([0], dtype=np.int32), np.array([[1, 2, 3, 4]], dtype=np.int32)
    facet, k = (ends, np.array([[0.0, 1, 0, 0]])), np.full((1, 3), 5.0)
    link = node_to_facet(MPI.COMM_SELF, node, facet, k, 0 * k)
    mass = np.repeat([2.0, 1, 7, 1, 1], 3)
    springs, _ = attached(MPI.COMM_SELF, nothing(), [link], mass)
    assert joined(0.0, springs) == pytest.approx(5 / 2 + 5 / 7, rel=1e-14)
    np.testing.assert_allclose((springs.nodal / mass)[[0, 6]], 5 / 2 + 5 / 7, rtol=1e-14)
    assert not springs.nodal[[3, 9, 12]].any()


@settings(max_examples=20, deadline=None, derandomize=True)
@given(st.integers(0, 10_000), st.floats(-3, 3))
def test_bound_is_never_exceeded(seed, spread):
    """Random masses over six decades: dense limit of dt²/4 K + dt/2 C < M ≥ bound.

    The bound of ω² is found within 1 to 3.2 times the largest eigenvalue.
    """
    domain = two_blocks(MPI.COMM_SELF)
    link = between(domain, seed)
    random = np.random.default_rng(seed)
    m = np.repeat(10 ** (spread * random.uniform(-1, 1, domain.owned)), 3)
    springs, dampers = attached(MPI.COMM_SELF, nothing(), [link], m)
    K = assembled(domain, link, np.arange(domain.owned))
    stiffness, link.stiffness = link.stiffness, link.damping
    C = assembled(domain, link, np.arange(domain.owned))
    link.stiffness = stiffness
    scale = 1 / np.sqrt(m)
    K, C = (scale[:, None] * A * scale for A in (K, C))
    exact = scipy.linalg.eigvalsh(K)[-1]
    assert exact <= joined(0.0, springs) * (1 + 1e-12)
    assert joined(0.0, springs) <= 4 * exact
    dt = joined_step(0.0, springs, dampers)
    assert scipy.linalg.eigvalsh(dt**2 / 4 * K + dt / 2 * C)[-1] <= 1 + 1e-12


M, K_SPRING, ZETA = 2.0, 50.0, 0.05


def swing(dt: float, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Let the upper block's one node go on its spring; its stretch and the energies, every step."""
    domain = two_blocks(MPI.COMM_SELF)
    V = domain.V
    state = State(fem.Function(V), fem.Function(V), la.vector(V.dofmap.index_map, 3))
    mass = la.vector(V.dofmap.index_map, 3)
    mass.array[:] = M
    nodes, weights = np.array([[0, 1, 5, 4]]), np.array([[0.4, 0.3, 0.2, 0.1]])
    node, ends = domain.local_dofs(np.array([40])), domain.local_dofs(nodes)
    reduced = 1 / (1 / M + (weights**2).sum() / M)
    k, c = np.zeros((2, 1, 3))
    k[:, 2], c[:, 2] = K_SPRING, 2 * ZETA * np.sqrt(K_SPRING * reduced)
    link = node_to_facet(MPI.COMM_SELF, node, (ends, weights), k, c)
    load = Connections(MPI.COMM_SELF, nothing(), [link], dt)
    state.u.x.array[3 * node[0] + 2] = 1e-3
    rows = []
    for s in central_difference(state, mass.petsc_vec, [load.add], no_hold, dt, (steps - 1) * dt):
        u, v, a = s.u.x.array, s.v.x.array, s.a.array
        kinetic = M * v @ (v + dt * a) / 2
        stretch = link.stretch(u, NOBODY)[0, 2]
        rows.append([stretch, kinetic, load.stored_energy(u), load.dissipation()])
    return np.array(rows)[:, 0], np.array(rows)[:, 1:]


OMEGA = np.sqrt(K_SPRING * (1 + 0.3) / M)  # Σ b² = 0.3


def test_row_19_frequency_and_decrement_of_two_bodies():
    """ω² = k (1/m + Σ b²/M), ω_d = ω √(1−ζ²), log decrement 2πζ/√(1−ζ²), 0.1 %."""
    dt = 2 * np.pi / OMEGA / 600
    z, _ = swing(dt, 600 * 6)
    i = np.flatnonzero((z[:-1] > 0) & (z[1:] <= 0))
    t = (i + z[i] / (z[i] - z[i + 1])) * dt
    assert 2 * np.pi / np.diff(t).mean() == pytest.approx(OMEGA * np.sqrt(1 - ZETA**2), rel=1e-3)
    peaks = [z[i : i + 600].max() for i in range(300, 2701, 600)]
    decrement = -np.diff(np.log(peaks)).mean()
    assert decrement == pytest.approx(2 * np.pi * ZETA / np.sqrt(1 - ZETA**2), rel=1e-3)


def test_energy_of_two_bodies_closes_to_round_off():
    """Kinetic + stored + dissipated energy stays what it was, even with coarse steps."""
    _, energy = swing(0.2 / OMEGA, 1000)
    total = energy.sum(axis=1)
    assert energy[-1, 2] > 0.5 * total[0]
    np.testing.assert_allclose(total, total[0], rtol=1e-12)


def test_ranks_agree():
    """Forces, energy, stiffness and majorant on any number of ranks: those of one, 1e-13."""
    domain, alone = two_blocks(), two_blocks(MPI.COMM_SELF)
    link, own = between(domain), between(alone)
    (f, e), (f1, e1) = shaken(domain, link), shaken(alone, own)
    np.testing.assert_allclose(f, f1, atol=1e-13 * np.abs(f1).max())
    assert e == pytest.approx(e1, rel=1e-13)
    nodal, stiffness = [], []
    for d, part in ((domain, link), (alone, own)):
        mass = 1.0 + np.repeat(d.nodes % 7, 3)
        springs, _ = attached(d.msh.comm, nothing(), [part], mass)
        nodal.append(everywhere(d, springs.nodal))
        stiffness.append(assembled(d, part, d.nodes[: d.owned]))
    np.testing.assert_allclose(nodal[0], nodal[1], rtol=1e-12)
    if COMM.rank == 0:
        np.testing.assert_allclose(stiffness[0], stiffness[1], atol=1e-13 * stiffness[1].max())
    assert COMM.allreduce(link.owned) == link.count
    if COMM.size > 1:  # some springs cross ranks; not all are on all, however the mesh is cut
        crossing = COMM.allreduce(len(link.rows) - link.owned)
        assert 0 < crossing < (COMM.size - 1) * link.count


@pytest.mark.mpi
@pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="is itself on ranks")
@pytest.mark.parametrize("ranks", [2, 3])
def test_on_ranks(tests_on, ranks):
    """The test above under ``mpiexec``."""
    tests_on(ranks, __file__, "-k", "ranks_agree")
