# SPDX-License-Identifier: LGPL-3.0-or-later
"""Verification rows 1 to 3 and 7 for every element and law, and cantilevers of few layers."""

from mpi4py import MPI

import dolfinx
import numpy as np
import pytest
import ufl
from dolfinx import fem
from scipy.sparse.linalg import spsolve

from forms.cells import one_point, uniform
from forms.elasticity import Elastic, full, green_lagrange
from forms.elements import LAWS, control_energy, internal_work, strain_energy
from forms.inertia import lumped_mass
from forms.kernel import CellIntegral, CellKernel
from forms.stability import cell_frequency, stable_step
from meshes import blocks
from meshes.domain import Domain, distribute
from meshes.hexmesh import HexMesh, boundary
from meshes.tags import Tag
from workflow.stepping import State, central_difference, no_hold

STEEL = Elastic(210e9, 0.3, 7800.0, damping=1e-6)
SOFT = Elastic(1.0, 0.3, 1.0)
CASES = [
    ("full", "small-strain", None),
    ("full", "neo-hookean", None),
    ("one-point", "small-strain", None),
    ("one-point", "total-lagrangian", None),
    ("one-point", "total-lagrangian", 0.1),
    ("one-point", "neo-hookean", None),
    ("selective", "small-strain", None),
    ("selective", "neo-hookean", None),
]
LARGE = [case for case in CASES if LAWS[case[1]].rotating]


@pytest.fixture(scope="module")
def cube() -> Domain:
    """A distorted unit cube of 27 hexahedra with warped faces."""
    box = blocks.block((0, 0, 0), (1, 1, 1), cells=(3, 3, 3))
    return distribute(blocks.distorted(box, amplitude=0.3, seed=1), MPI.COMM_SELF)


def work(domain: Domain, case, u, w, material=STEEL, v=None):
    element, law, coefficient = case
    dx = full(domain.msh)
    return internal_work(element, LAWS[law], u, w, material, dx, v, coefficient=coefficient)


def force(domain: Domain, case, u: np.ndarray, v: np.ndarray | None = None) -> np.ndarray:
    """Nodal forces, shape ``(n, 3)``."""
    functions = [fem.Function(domain.V) for x in (u, v) if x is not None]
    for f, x in zip(functions, (u, v), strict=False):
        f.x.array[:] = np.ravel(x)
    w = ufl.TestFunction(domain.V)
    rate = functions[1] if v is not None else None
    out = np.zeros_like(functions[0].x.array)
    CellKernel(work(domain, case, functions[0], w, v=rate)).add(out)
    return out.reshape(-1, 3)


def rotation(degrees: float) -> np.ndarray:
    """Rotation about a slanted axis (Rodrigues' formula)."""
    a = np.radians(degrees)
    n = np.array([1.0, 2.0, 3.0]) / np.sqrt(14)
    N = np.cross(np.eye(3), n) * -1
    return np.eye(3) + np.sin(a) * N + (1 - np.cos(a)) * N @ N


@pytest.mark.parametrize("case", CASES)
def test_row_1_kernel_equals_dolfinx_assembly(cube, case):
    """Kernel = ``assemble_vector`` with default flags, 1e-13 of the largest entry; damped."""
    u, v, w = fem.Function(cube.V), fem.Function(cube.V), ufl.TestFunction(cube.V)
    random = np.random.default_rng(0)
    u.x.array[:] = 0.02 * random.standard_normal(u.x.array.shape)
    v.x.array[:] = random.standard_normal(v.x.array.shape)
    form = work(cube, case, u, w, v=v)
    expected = fem.assemble_vector(fem.form(form)).array
    out = np.zeros_like(u.x.array)
    CellKernel(form).add(out)
    assert np.abs(expected).max() > 0
    np.testing.assert_allclose(out, expected, rtol=0, atol=1e-13 * np.abs(expected).max())


@pytest.mark.parametrize("case", CASES)
def test_force_is_the_derivative_of_the_energy(cube, case):
    """``ufl.derivative`` of strain plus hourglass energy = internal force, to round-off."""
    element, law, coefficient = case
    u, w, dx = fem.Function(cube.V), ufl.TestFunction(cube.V), full(cube.msh)
    u.x.array[:] = 0.02 * np.random.default_rng(1).standard_normal(u.x.array.shape)
    energy = strain_energy(element, LAWS[law], u, STEEL, dx)
    if element == "one-point":
        energy += control_energy(LAWS[law], u, STEEL, dx, coefficient=coefficient)
    expected = fem.assemble_vector(fem.form(ufl.derivative(energy, u, w))).array
    found = force(cube, case, u.x.array).ravel()
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13 * np.abs(expected).max())


def stress(law: str, A: np.ndarray) -> np.ndarray:
    """Nominal stress at a constant displacement gradient, by NumPy."""
    F, one = np.eye(3) + A, np.eye(3)
    if law == "neo-hookean":
        J, Fit = np.linalg.det(F), np.linalg.inv(F).T
        return STEEL.mu * (F - Fit) + STEEL.lmbda * (J - 1) * J * Fit
    strain = (A + A.T) / 2 if law == "small-strain" else (F.T @ F - one) / 2
    sigma = STEEL.lmbda * np.trace(strain) * one + 2 * STEEL.mu * strain
    return sigma if law == "small-strain" else F @ sigma


@pytest.mark.parametrize("case", CASES)
def test_row_2_patch_test_on_distorted_hexahedra(cube, case):
    """u = A x, 20 % strain and turn: no force on interior nodes, Σ f ⊗ x = P V; 1e-12."""
    law = case[1]
    A = (1e-3 if law == "small-strain" else 0.2) * np.array([[1, 2, 0], [-1, 0.5, 1], [0.3, 0, 1]])
    x = cube.V.tabulate_dof_coordinates()
    f = force(cube, case, x @ A.T)
    inside = np.setdiff1d(
        np.arange(len(x)), cube.local_dofs(np.unique(boundary(cube.source.cells)))
    )
    assert len(inside) == 8
    assert np.abs(f[inside]).max() <= 1e-12 * np.abs(f).max()
    if case[:2] != ("selective", "neo-hookean"):  # its energy splits otherwise
        expected = stress(law, A)
        np.testing.assert_allclose(f.T @ x, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("degrees", [1, 90, 1000])
@pytest.mark.parametrize("case", LARGE)
def test_row_3_rigid_motion_leaves_no_force(cube, case, degrees):
    """Turned, shifted and spinning: no elastic or damping force, ≤ 1e-10 of the scale E h |u|."""
    x = cube.V.tabulate_dof_coordinates()
    now = x @ rotation(degrees).T + [1.0, -0.5, 0.2]
    v = np.cross([3.0, 50.0, -7.0], now) + np.array([20.0, 1.0, 0.0])
    scale = STEEL.E / 3 * np.abs(now - x).max()
    assert np.abs(force(cube, case, now - x)).max() <= 1e-10 * scale
    assert np.abs(force(cube, case, now - x, v)).max() <= 1e-10 * scale


def tip(case, layers: int, cells: int, nu: float = 0.3, slope: float = 0.0) -> float:
    """Tip deflection of a 10 × 1 × 1 cantilever over that of Timoshenko's beam, less one.

    ``slope`` turns the cross-sections inside by up to that angle, so that cells are trapezia.
    """
    material = Elastic(1.0, nu, 1.0)
    box = blocks.block((0, 0, 0), (10, 1, 1), cells=(cells, layers, layers))
    i = np.rint(box.points[:, 0] * cells / 10)
    turned = np.where((i > 0) & (i < cells), slope * (-1) ** i * (box.points[:, 2] - 0.5), 0.0)
    domain = distribute(box.moved(box.points + np.outer(turned, [1, 0, 0])), MPI.COMM_SELF)
    x, dx = domain.V.tabulate_dof_coordinates(), full(domain.msh)
    u, w = fem.Function(domain.V), ufl.TestFunction(domain.V)
    element, law, coefficient = case
    form = internal_work(element, LAWS[law], u, w, material, dx, coefficient=coefficient)
    tangent = ufl.derivative(form, u, ufl.TrialFunction(domain.V))
    K = fem.assemble_matrix(fem.form(tangent)).to_scipy().tocsr()
    share = np.prod(np.where(np.isclose(np.abs(x[:, 1:] - 0.5), 0.5), 0.5, 1.0), axis=1)
    load = np.zeros_like(x)
    load[:, 2] = np.where(np.isclose(x[:, 0], 10), share / layers**2, 0.0)
    held = np.zeros(x.shape, dtype=bool)
    root = np.isclose(x[:, 0], 0)
    held[root, 0] = True
    held[root & np.isclose(x[:, 1], 0), 1] = True
    held[root & np.isclose(x[:, 2], 0), 2] = True
    free = np.flatnonzero(~held.ravel())
    solution = np.zeros(x.size)
    solution[free] = spsolve(K[free][:, free].tocsc(), load.ravel()[free])
    deflection = solution @ load.ravel()
    shear = material.mu * 5 / 6
    return deflection / (10**3 / 3 * 12 + 10 / shear) - 1


FULL, POINT, SOFTER = (
    ("full", "small-strain", None),
    ("one-point", "small-strain", None),
    ("one-point", "small-strain", 0.1),
)


@pytest.mark.parametrize(("layers", "cells"), [(1, 10), (1, 20), (2, 20)])
def test_physical_control_bends_right_with_one_layer(layers, cells):
    """Within 1 % of Timoshenko's beam; full quadrature is 10 to 40 % too stiff."""
    assert abs(tip(POINT, layers, cells)) <= 0.01
    assert -0.4 <= tip(FULL, layers, cells) <= -0.1


def test_parameter_control_is_wrong_with_one_layer_and_right_with_many():
    """Coefficient 0.1: more than twice too soft with one layer, 5 % with four."""
    assert tip(SOFTER, 1, 10) > 1
    assert abs(tip(SOFTER, 4, 20)) < 0.05


def test_physical_control_on_trapezia():
    """Sections turned by ±0.25: full locks by a third, physical control loses 5 % at two layers."""
    assert tip(FULL, 2, 20, slope=0.25) < -0.15
    assert abs(tip(POINT, 2, 20, slope=0.25)) < 0.1


def test_nearly_incompressible_cantilever():
    """ν = 0.4999: full quadrature locks (half the deflection), the others do not."""
    assert tip(FULL, 2, 20, nu=0.4999) < -0.4
    assert abs(tip(("selective", "small-strain", None), 4, 20, nu=0.4999)) < 0.1
    assert abs(tip(POINT, 1, 20, nu=0.4999)) < 0.02


# row 7

RHO, INNER, OUTER = 7800.0, 0.4, 0.5


def ring(around: int, through: int) -> HexMesh:
    """A closed ring of rectangular section, 0.4 to 0.5 m, one cell thick."""
    angle = 2 * np.pi * np.arange(around) / around
    r = np.linspace(INNER, OUTER, through + 1)
    z = np.array([0.0, 0.05])
    zz, aa, rr = np.meshgrid(z, angle, r, indexing="ij")
    points = np.column_stack([(rr * np.cos(aa)).ravel(), (rr * np.sin(aa)).ravel(), zz.ravel()])
    node = np.arange(len(points)).reshape(2, around, through + 1)
    ahead = np.roll(node, -1, axis=1)
    layers = [
        np.stack([n[:, :-1], n[:, 1:], m[:, 1:], m[:, :-1]], axis=-1).reshape(-1, 4)
        for n, m in zip(node, ahead, strict=True)
    ]
    cells = np.hstack(layers)
    return HexMesh(
        points=points,
        cells=cells,
        regions=np.full(len(cells), Tag.BLOCK, dtype=np.int32),
        facets=np.empty((0, 4), dtype=cells.dtype),
        surfaces=np.empty(0, dtype=np.int32),
    )


def hoop_stress(r: np.ndarray, omega: float) -> tuple[np.ndarray, np.ndarray]:
    """Hoop and radial stress of a spinning ring in plane stress (Timoshenko and Goodier, §32)."""
    nu, a2, b2 = STEEL.nu, INNER**2, OUTER**2
    scale = (3 + nu) / 8 * RHO * omega**2
    hoop = scale * (a2 + b2 + a2 * b2 / r**2 - (1 + 3 * nu) / (3 + nu) * r**2)
    return hoop, scale * (a2 + b2 - a2 * b2 / r**2 - r**2)


@pytest.mark.parametrize("omega", [50.0, 500.0])
def test_row_7_spinning_ring(omega):
    """One-point elements with physical control, a turn from the state of Lamé's formula.

    Hoop stress of every cell within 1 % of the largest (averaged over the turn), angular momentum
    constant to 1e-10, energy to 1e-6 of the kinetic energy.
    """
    domain = distribute(ring(48, 3), MPI.COMM_SELF)
    V, dx = domain.V, full(domain.msh, domain.regions)
    x = V.tabulate_dof_coordinates()
    r = np.hypot(x[:, 0], x[:, 1])
    state = State(fem.Function(V), fem.Function(V), dolfinx.la.vector(V.dofmap.index_map, 3))
    hoop, radial = hoop_stress(r, omega)
    start = (
        np.column_stack([x[:, :2], np.zeros(len(x))]) * ((hoop - 0.3 * radial) / STEEL.E)[:, None]
    )
    start[:, 2] = -0.3 * (hoop + radial) / STEEL.E * x[:, 2]
    state.u.x.array[:] = start.ravel()
    state.v.x.array[:] = np.cross([0, 0, omega], x + start).ravel()
    mass = dolfinx.la.vector(V.dofmap.index_map, 3)
    mass.array[:] = lumped_mass(V, dx, {(Tag.BLOCK,): RHO})
    law, w = LAWS["total-lagrangian"], ufl.TestFunction(V)
    kernel = CellKernel(-internal_work("one-point", law, state.u, w, STEEL, dx))
    stored = [
        CellIntegral(strain_energy("one-point", law, state.u, STEEL, dx)),
        CellIntegral(control_energy(law, state.u, STEEL, dx)),
    ]
    t = ufl.TestFunction(fem.functionspace(domain.msh, ("DG", 0)))
    X = ufl.SpatialCoordinate(domain.msh)
    e = ufl.as_vector([-X[1], X[0], 0]) / ufl.sqrt(X[0] ** 2 + X[1] ** 2)
    S = ufl.dot(e, ufl.dot(STEEL.stress(green_lagrange(state.u)), e))
    stresses = fem.form(uniform(S) * t * one_point(dx))
    volumes = fem.assemble_vector(fem.form(uniform(ufl.as_ufl(1.0) * t) * one_point(dx))).array

    def inertia(w):
        return RHO * ufl.inner(ufl.as_vector([1.0] * 3), w) * dx(metadata={"quadrature_degree": 3})

    def stiffness(u, w):
        return internal_work("one-point", law, u, w, STEEL, dx)

    dt = 0.8 * stable_step(cell_frequency(V, stiffness, inertia))
    m, momenta, energies, sums = mass.array.reshape(-1, 3), [], [], 0 * volumes
    for s in central_difference(
        state, mass.petsc_vec, [lambda s, f: kernel.add(f)], no_hold, dt, 2 * np.pi / omega
    ):
        before, a = s.v.x.array.reshape(-1, 3), s.a.array.reshape(-1, 3)
        momenta.append((m * np.cross(x + s.u.x.array.reshape(-1, 3), before))[:, 2].sum())
        if s.step % 20 == 0:
            kinetic = (m * before * (before + dt * a)).sum() / 2
            energies.append(kinetic + sum(part() for part in stored))
            sums += fem.assemble_vector(stresses).array / volumes
    centres = x[V.dofmap.list].mean(axis=1)
    expected, _ = hoop_stress(np.hypot(centres[:, 0], centres[:, 1]), omega)
    error = np.abs(sums / len(energies) / expected - 1).max()
    drift = np.ptp(momenta) / abs(momenta[0])
    change = np.ptp(energies) / energies[0]
    assert error <= 0.01
    assert drift <= 1e-10
    assert change <= 1e-6
