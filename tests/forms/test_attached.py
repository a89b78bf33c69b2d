# SPDX-License-Identifier: LGPL-3.0-or-later
"""The step bound of bodies on springs and dampers: oscillators, and dense eigenvalues."""

from mpi4py import MPI

import dolfinx
import numpy as np
import pytest
import scipy.linalg
import scipy.optimize
import ufl
from dolfinx import fem
from hypothesis import given, settings
from hypothesis import strategies as st

from forms.elasticity import Elastic, full, small_strain
from forms.springs.connections import Connections
from forms.springs.point_masses import PointMasses
from forms.springs.springs import Springs, mean, spread
from forms.springs.step_bound import Attached, attached, joined, joined_step
from forms.time_step import assembled_frequency, cell_frequency, stable_step
from meshes.domain import Domain, distribute
from meshes.shapes import blocks
from workflow.model.state import State
from workflow.simulation.stepping import central_difference, no_hold

COMM = MPI.COMM_WORLD if MPI.COMM_WORLD.size > 1 else MPI.COMM_SELF
SOFT = Elastic(1e3, 0.3, 8.0)
NONE = Attached(np.zeros(3), 0.0, np.zeros(0), np.zeros(0))


def one(stiffness: float, mass: float) -> Attached:
    """A spring or damper between a node and a point mass of 2 kg."""
    rate = stiffness / mass
    return Attached(np.full(3, stiffness), rate, np.full(3, stiffness / 2.0), np.zeros(3))


@pytest.mark.parametrize("mass", [1e-3, 2.0, 1e3])
def test_two_masses_on_a_spring(mass):
    """ω² = k (1/m + 1/M), light or heavy node; to round-off."""
    assert joined(0.0, one(5.0, mass)) == pytest.approx(5 / mass + 5 / 2, rel=1e-14)


def test_a_node_on_a_spring_to_the_ground():
    """ω² = k / m, and the cells' own on top; a point mass alone on its base counts too."""
    ground = Attached(np.full(3, 6.0), 3.0, np.zeros(0), np.zeros(0))
    assert joined(0.0, ground) == 3.0
    assert joined(4.0, ground) == 7.0
    assert joined(7.0, ground, held=True) == 7.0
    alone = Attached(np.zeros(3), 0.0, np.zeros(1), np.array([9.0]))
    assert joined(4.0, alone) == 9.0


@pytest.mark.parametrize(("spring", "damper"), [(1.0, 0.0), (1.0, 0.3), (4.0, 9.0), (1.0, 100.0)])
def test_step_of_a_damped_oscillator(spring, damper):
    """Node of mass m on k and c to the ground: dt = 2/ω (√(1 + ζ²) − ζ), ζ = c / (2 √(k m))."""
    m = 2.0
    parts = (Attached(np.full(3, x), x / m, np.zeros(0), np.zeros(0)) for x in (spring, damper))
    omega, zeta = np.sqrt(spring / m), damper / (2 * np.sqrt(spring * m))
    expected = 2 / omega * (np.sqrt(1 + zeta**2) - zeta)
    assert joined_step(0.0, *parts) == pytest.approx(expected, rel=1e-13)


def test_without_connections_it_is_the_step_of_the_bodies():
    """Stiffness- and mass-proportional damping as before."""
    assert joined_step(3.0, NONE, NONE, 0.1, 0.2) == pytest.approx(stable_step(3.0, 0.1, 0.2))


@pytest.mark.parametrize("room", [0.2, 0.9])
def test_contact_springs_take_their_share_at_any_damping(room):
    """ω² dt²/4 + c dt/2 = room; √room of the step would be too long where damping is large."""
    for damping in (0.0, 0.1, 50.0):
        dt = joined_step(3.0, NONE, NONE, 0.0, damping, room=room)
        assert 9 * dt**2 / 4 + damping * dt / 2 == pytest.approx(room, rel=1e-14)
        assert dt <= np.sqrt(room) * joined_step(3.0, NONE, NONE, 0.0, damping) * (1 + 1e-14)


def test_damped_bodies_of_known_step_with_springs():
    """2/dt as damping: dt without springs; with them, safe however K and C of the body share it."""
    dt, ground = 0.3, Attached(np.full(3, 40.0), 40.0, np.zeros(0), np.zeros(0))
    assert joined_step(0.0, NONE, NONE, mass_damping=2 / dt) == pytest.approx(dt, rel=1e-14)
    found = joined_step(0.0, ground, NONE, mass_damping=2 / dt)
    assert found < 0.8 * dt
    for share in (0.0, 0.5, 1.0):
        square, lag = share * 4 / dt**2, (1 - share) * 2 / dt
        assert (square + 40) * found**2 / 4 + lag * found / 2 <= 1 + 1e-14


def test_a_light_mass_between_stiff_bodies_and_the_ground_is_seen():
    """A sleeper of 1 g: its own frequency bounds the step, not that of the bodies."""
    sleeper = Attached(np.full(3, 1e3), 1.0, np.array([1e6]), np.array([1e6]))
    assert joined(10.0, sleeper) >= 2e6
    assert joined(10.0, sleeper) == pytest.approx(2e6, rel=1e-4)


def cube(cells: int = 2) -> Domain:
    box = blocks.block((0, 0, 0), (1, 1, 1), cells=(cells,) * 3)
    return distribute(blocks.distorted(box, amplitude=0.3, seed=1), COMM)


def forms(domain: Domain, material: Elastic = SOFT):
    dx = full(domain.msh)

    def inertia(w):
        ones = ufl.as_vector([1.0] * 3)
        return material.rho * ufl.inner(ones, w) * dx(metadata={"quadrature_degree": 3})

    return lambda u, w: small_strain(u, w, material) * dx, inertia


def nodal_mass(domain: Domain, inertia) -> np.ndarray:
    mass = dolfinx.la.vector(domain.V.dofmap.index_map, 3)
    mass.array[:] = fem.assemble_vector(fem.form(inertia(ufl.TestFunction(domain.V)))).array
    mass.scatter_reverse(dolfinx.la.InsertMode.add)
    mass.scatter_forward()
    return mass.array.copy()


def connected(domain: Domain, seed: int, size: float = 1.0) -> tuple[PointMasses, list[Springs]]:
    """Point masses from 1 g to 1 t, one of them held along z, under pads and a journal.

    Pads tie each node of the bottom to one of two masses or the ground, the journal the mean of the
    top to the third. The same on any number of ranks.
    """
    random = np.random.default_rng(seed)
    mass = 10 ** random.uniform(-3, 3, 3)
    base, shock = size * 10 ** random.uniform(1, 5, (2, 3, 3))
    free = np.ones((3, 3))
    free[1, 2] = 0.0
    masses = PointMasses(mass, np.zeros(3), free, base, 1e-3 * shock)
    points = domain.source.points
    drawn = random.uniform(size=(len(points), 7))
    links = []
    for z in (0.0, 1.0):
        dofs = domain.local_dofs(nodes := np.flatnonzero(points[:, 2] == z))
        if z == 0:
            point = (4 * drawn[nodes, 6]).astype(np.int32) % 3 - 1
            k, c = size * 10 ** (5 * drawn[nodes, :3]), size * 10 ** (3 * drawn[nodes, 3:6])
            links.append(spread(domain.msh.comm, dofs, k, c, point))
        else:
            k, c = size * 10 ** random.uniform(2, 6, 3), size * 10 ** random.uniform(0, 4, 3)
            weight = np.full(len(dofs), 1 / len(dofs))
            links.append(mean(domain.msh.comm, dofs, weight, k, c, 2))
    return masses, links


def dense(masses: PointMasses, links: list, n: int, which: str) -> np.ndarray:
    """Springs (or dampers) of bodies and point masses, each from its energy, dense."""
    ground = getattr(masses, f"base_{which}").ravel()
    K = np.diag(np.append(np.zeros(n), ground))
    for link in links:
        block = np.concatenate([link.dofs, n // 3 + link.points])
        for weight, k in zip(link.B.toarray(), getattr(link, which), strict=True):
            for axis in range(3):
                b = np.zeros(n + 9)
                b[3 * block + axis] = weight
                K += k[axis] * np.outer(b, b)
    return K


@pytest.mark.skipif(COMM.size > 1, reason="dense matrices on one rank")
@settings(max_examples=30, deadline=None, derandomize=True)
@given(st.integers(0, 10_000), st.floats(-4, 4), st.floats(0, 0.1))
def test_bound_is_never_exceeded(seed, size, beta):
    """Random point masses, pads, journals and dampers on a body: dense limit ≥ bound, both ways.

    The limit is where ``dt²/4 K + dt/2 C < M`` ends; the springs range from no part of the step to
    all of it.
    """
    domain = cube()
    residual, inertia = forms(domain)
    m = nodal_mass(domain, inertia)
    masses, links = connected(domain, seed, 10**size)
    springs, dampers = attached(COMM, masses, links, m)
    n, free = len(m), np.append(np.ones(len(m)), masses.free.ravel()) > 0
    scale = 1 / np.sqrt(np.append(m, np.repeat(masses.mass, 3)))[free]
    u, du, w = fem.Function(domain.V), ufl.TrialFunction(domain.V), ufl.TestFunction(domain.V)
    cells = np.zeros((n + 9,) * 2)
    cells[:n, :n] = fem.assemble_matrix(fem.form(ufl.derivative(residual(u, w), u, du))).to_dense()
    K = dense(masses, links, n, "stiffness") + cells
    C = dense(masses, links, n, "damping") + beta * cells
    K, C = (np.outer(scale, scale) * A[np.ix_(free, free)] for A in (K, C))

    def top(dt):
        return scipy.linalg.eigvalsh(dt**2 / 4 * K + dt / 2 * C)[-1] - 1

    omega = cell_frequency(domain.V, residual, inertia)
    steps = [joined_step(omega, springs, dampers, beta)]
    found, sharp = assembled_frequency(domain.V, residual, m, springs.nodal)
    assert sharp
    steps.append(joined_step(found, springs, dampers, beta, held=True))
    free_omega, _ = assembled_frequency(domain.V, residual, m)
    stiff = joined(found**2, springs, held=True)
    exact = scipy.linalg.eigvalsh(K)[-1]
    assert exact <= stiff <= 2.1 * exact
    assert exact <= joined(free_omega**2, springs)
    limit = scipy.optimize.brentq(top, 0.01 * min(steps), 100 * max(steps))
    assert max(steps) <= limit <= 3 * max(steps)


def test_springs_in_the_assembled_operator():
    """Lanczos with nodal springs = dense eigenvalue of K + diag(k), never below; any ranks."""
    domain = cube(3)
    residual, inertia = forms(domain)
    m = nodal_mass(domain, inertia)
    masses, links = connected(domain, 3, 10.0)
    springs, _ = attached(COMM, masses, links, m)
    found, sharp = assembled_frequency(domain.V, residual, m, springs.nodal)
    alone, _ = assembled_frequency(domain.V, residual, m)
    assert sharp and found > 1.2 * alone
    own = distribute(domain.source, MPI.COMM_SELF)
    residual, inertia = forms(own)
    u, du, w = fem.Function(own.V), ufl.TrialFunction(own.V), ufl.TestFunction(own.V)
    K = fem.assemble_matrix(fem.form(ufl.derivative(residual(u, w), u, du))).to_dense()
    nodal = np.zeros((len(own.nodes), 3))
    nodal[domain.nodes[: domain.owned]] = springs.nodal.reshape(-1, 3)[: domain.owned]
    nodal = COMM.allreduce(nodal)[own.nodes]
    mass = nodal_mass(own, inertia)
    scaled = (K + np.diag(nodal.ravel())) / np.sqrt(np.outer(mass, mass))
    expected = np.sqrt(scipy.linalg.eigvalsh(scaled)[-1])
    assert 1 - 1e-9 <= found / expected <= 1 + 2e-3
    rates = springs.rate, springs.tied.sum(), springs.base.sum()
    assert np.ptp(COMM.allgather(rates), axis=0).max() == 0.0


def growth(factor: float, damping: float) -> float:
    """|u| after 400 steps over that after 40 of a body far softer than its connections.

    A single cell whose nodes hang on point masses of their own weight, stepped as a run steps it
    with ``factor`` of the bound.
    """
    domain = distribute(blocks.block((0, 0, 0), (1, 1, 1), cells=(1, 1, 1)), MPI.COMM_SELF)
    residual, inertia = forms(domain, Elastic(1e-9, 0.3, 8.0))
    m = nodal_mass(domain, inertia)
    masses = PointMasses(np.ones(8), np.zeros(3), np.ones((8, 3)), *np.zeros((2, 8, 3)))
    k, each = np.full((8, 3), 50.0), np.arange(8, dtype=np.int32)
    link = spread(MPI.COMM_SELF, each, k, damping * k, each)
    springs, dampers = attached(MPI.COMM_SELF, masses, [link], m)
    omega = cell_frequency(domain.V, residual, inertia)
    dt = factor * joined_step(omega, springs, dampers)
    V = domain.V
    state = State(fem.Function(V), fem.Function(V), dolfinx.la.vector(V.dofmap.index_map, 3))
    state.v.x.array[:] = 1.0
    mass = dolfinx.la.vector(V.dofmap.index_map, 3)
    mass.array[:] = m
    load = Connections(MPI.COMM_SELF, masses, [link], dt)
    sizes = [
        np.abs(masses.v - s.v.x.array.reshape(-1, 3)).max()
        for s in central_difference(
            state, mass.petsc_vec, [load.add], no_hold, dt, 400 * dt, [masses]
        )
    ]
    return max(sizes[-40:]) / max(sizes[:40])


@pytest.mark.parametrize("damping", [0.0, 0.02, 0.5])
def test_run_is_bounded_just_below_the_bound_and_diverges_just_above(damping):
    """Node and point mass of 1 kg, ω = 10 rad/s, stepped by the real loop at 0.99 and 1.01."""
    assert growth(0.99, damping) <= 1.01
    assert growth(1.01, damping) > 10


@pytest.mark.mpi
@pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="is itself on ranks")
def test_bounds_also_hold_on_ranks(tests_on):
    """The assembled operator with springs under ``mpiexec``, against the dense one."""
    tests_on(2, __file__, "-k", "operator")
