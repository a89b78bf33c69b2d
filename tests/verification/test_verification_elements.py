# SPDX-License-Identifier: LGPL-3.0-or-later
"""Verification rows 1 to 3 for every element and law."""

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem
from hypothesis import given, settings
from hypothesis import strategies as st

from forms.elasticity import Elastic, full
from forms.elements import control_energy, internal_work, strain_energy
from forms.kernel import CellKernel
from forms.materials import Orthotropic
from forms.simd.native import NativeKernel
from meshes.domain import Domain, distribute
from meshes.hexmesh import boundary, join
from meshes.shapes import blocks
from meshes.tags import Tag
from tests.energies import LAWS

STEEL = Elastic(210e9, 0.3, 7800.0, damping=1e-6)
TURN = np.linalg.qr(np.random.default_rng(5).standard_normal((3, 3)))[0]
SPRUCE = Orthotropic(
    (11e9, 0.9e9, 0.5e9), (0.4, 0.45, 0.5), (0.7e9, 0.65e9, 0.05e9), 450.0, 1e-6,
    tuple(map(tuple, TURN)),
)  # fmt: skip
CASES = [
    ("full", "small-strain", None, STEEL),
    ("full", "total-lagrangian", None, STEEL),
    ("full", "neo-hookean", None, STEEL),
    ("full", "energy", None, STEEL),
    ("full", "small-strain", None, SPRUCE),
    ("full", "total-lagrangian", None, SPRUCE),
    ("one-point", "small-strain", None, STEEL),
    ("one-point", "small-strain", 0.1, STEEL),
    ("one-point", "total-lagrangian", None, STEEL),
    ("one-point", "total-lagrangian", 0.1, STEEL),
    ("one-point", "neo-hookean", None, STEEL),
    ("one-point", "neo-hookean", 0.1, STEEL),
    ("one-point", "energy", None, STEEL),
    ("one-point", "small-strain", None, SPRUCE),
    ("one-point", "small-strain", 0.1, SPRUCE),
    ("one-point", "total-lagrangian", None, SPRUCE),
    ("one-point", "total-lagrangian", 0.1, SPRUCE),
    ("selective", "small-strain", None, STEEL),
    ("selective", "neo-hookean", None, STEEL),
]
LARGE = [case for case in CASES if LAWS[case[1]].rotating]


def name(case) -> str:
    element, law, coefficient, material = case
    kind = element if coefficient is None else f"{element} {coefficient}"
    return f"{kind}, {law}" + (", spruce" if material is SPRUCE else "")


# of row 1, what compiles longest: a coefficient of hourglass control once, the others by `long`
ROW_1 = [
    pytest.param(case, id=name(case), marks=[pytest.mark.slow, pytest.mark.long])
    if case[2] is not None and case[1:] != ("small-strain", 0.1, STEEL)
    else pytest.param(case, id=name(case))
    for case in CASES
]


@pytest.fixture(scope="module")
def cube() -> Domain:
    """A distorted unit cube of 27 hexahedra with warped faces."""
    box = blocks.block((0, 0, 0), (1, 1, 1), cells=(3, 3, 3))
    return distribute(blocks.distorted(box, amplitude=0.3, seed=1), MPI.COMM_SELF)


def work(domain: Domain, case, u, w, v=None, material=None):
    element, law, coefficient, own = case
    dx = full(domain.msh)
    return internal_work(element, LAWS[law], u, w, material or own, dx, v, coefficient=coefficient)


def force(domain: Domain, case, u: np.ndarray, v: np.ndarray | None = None) -> np.ndarray:
    """Nodal forces, shape ``(n, 3)``."""
    functions = [fem.Function(domain.V) for x in (u, v) if x is not None]
    for f, x in zip(functions, (u, v), strict=False):
        f.x.array[:] = np.ravel(x)
    w = ufl.TestFunction(domain.V)
    rate = functions[1] if v is not None else None
    out = np.zeros_like(functions[0].x.array)
    CellKernel(work(domain, case, functions[0], w, rate)).add(out)
    return out.reshape(-1, 3)


def rotation(degrees: float) -> np.ndarray:
    """Rotation about a slanted axis (Rodrigues' formula)."""
    a = np.radians(degrees)
    n = np.array([1.0, 2.0, 3.0]) / np.sqrt(14)
    N = np.cross(np.eye(3), n) * -1
    return np.eye(3) + np.sin(a) * N + (1 - np.cos(a)) * N @ N


# row 1


def kernel_error(case, cells, seed: int, E: float, nu: float, beta: float, dtype=np.float64):
    """Difference of kernel and ``assemble_vector`` with default flags over the largest entry.

    Moduli of steel are constants of the form, so that it is compiled once for all of them.
    """
    box = blocks.block((0, 0, 0), (1, 1, 1), cells=cells)
    shift = np.random.default_rng(seed).uniform(-0.15, 0.15, box.points.shape) / max(cells)
    domain = distribute(box.moved(box.points + shift), MPI.COMM_SELF)
    material = case[3]
    if material is STEEL:
        material = Elastic(*(fem.Constant(domain.msh, x) for x in (E, nu, 7800.0, beta)))
    u, v, w = fem.Function(domain.V), fem.Function(domain.V), ufl.TestFunction(domain.V)
    random = np.random.default_rng(seed)
    u.x.array[:] = 0.06 / max(cells) * random.standard_normal(u.x.array.shape)
    v.x.array[:] = 1e3 * random.standard_normal(v.x.array.shape)
    form = work(domain, case, u, w, v, material)
    expected = fem.assemble_vector(fem.form(form)).array
    out = np.zeros_like(u.x.array)
    NativeKernel(form, dtype).add(out)
    return float(np.abs(out - expected).max() / np.abs(expected).max())


@pytest.mark.parametrize("case", ROW_1)
def test_row_1_kernel_equals_dolfinx_assembly(case):
    """Damped, random moduli, ν to 0.4999, on random distorted meshes: 1e-13 of the largest entry.

    Reassociated sums of some hundred terms differ by a few hundred round-offs at most.
    """
    nu = st.one_of(st.floats(0, 0.49), st.sampled_from([0.499, 0.4999]))
    cells, E, beta = st.tuples(*[st.integers(1, 4)] * 3), st.floats(1e6, 1e12), st.floats(0, 1e-4)

    @settings(max_examples=10, deadline=None, derandomize=True)
    @given(cells, st.integers(0, 10_000), E, nu, beta)
    def agrees(cells, seed, E, nu, beta):
        assert kernel_error(case, cells, seed, E, nu, beta) <= 1e-13

    agrees()


@pytest.mark.parametrize("case", ROW_1)
def test_row_1_single_precision(case):
    """The same in float32, strains of some per cent: some round-offs of 6e-8, below 1e-6."""
    error = kernel_error(case, (3, 3, 3), 1, 210e9, 0.3, 1e-6, np.float32)
    assert 1e-9 < error < 1e-6


SIDE_BY_SIDE = [
    (("full", "small-strain", None, STEEL), ("one-point", "total-lagrangian", None, STEEL)),
    (("one-point", "neo-hookean", 0.1, STEEL), ("selective", "neo-hookean", None, STEEL)),
    (("selective", "small-strain", None, STEEL), ("full", "total-lagrangian", None, SPRUCE)),
    (("one-point", "small-strain", None, SPRUCE), ("one-point", "small-strain", 0.1, STEEL)),
]


@pytest.mark.parametrize("pair", SIDE_BY_SIDE)
def test_row_1_bodies_of_different_elements_in_one_form(pair):
    """Two regions, an element each: one kernel = the two assembled by themselves, 1e-13.

    Of value because FFCx mixes rules of one point with others where they share cells
    (:func:`forms.cells.one_point`).
    """
    other = blocks.block((2, 0, 0), (3, 1, 1), cells=(2, 2, 2), region=Tag.BASE)
    own = blocks.block((0, 0, 0), (1, 1, 1), cells=(3, 3, 3))
    two = join(*(blocks.distorted(part, amplitude=0.3, seed=2) for part in (own, other)))
    domain = distribute(two, MPI.COMM_SELF)
    dx = full(domain.msh, domain.regions)
    u, v, w = fem.Function(domain.V), fem.Function(domain.V), ufl.TestFunction(domain.V)
    random = np.random.default_rng(3)
    u.x.array[:] = 0.02 * random.standard_normal(u.x.array.shape)
    v.x.array[:] = 1e3 * random.standard_normal(u.x.array.shape)
    forms = [
        internal_work(element, LAWS[law], u, w, material, dx(tag), v, coefficient=coefficient)
        for (element, law, coefficient, material), tag in zip(
            pair, (Tag.BLOCK, Tag.BASE), strict=True
        )
    ]
    expected = sum(fem.assemble_vector(fem.form(form)).array for form in forms)
    out = np.zeros_like(u.x.array)
    NativeKernel(sum(forms)).add(out)
    np.testing.assert_allclose(out, expected, rtol=0, atol=1e-13 * np.abs(expected).max())


@pytest.mark.parametrize("case", CASES, ids=name)
def test_force_is_the_derivative_of_the_energy(cube, case):
    """``ufl.derivative`` of strain plus hourglass energy = internal force, to round-off."""
    element, law, coefficient, material = case
    u, w, dx = fem.Function(cube.V), ufl.TestFunction(cube.V), full(cube.msh)
    u.x.array[:] = 0.02 * np.random.default_rng(1).standard_normal(u.x.array.shape)
    energy = strain_energy(element, LAWS[law], u, material, dx)
    if element == "one-point":
        energy += control_energy(LAWS[law], u, material, dx, coefficient=coefficient)
    expected = fem.assemble_vector(fem.form(ufl.derivative(energy, u, w))).array
    found = force(cube, case, u.x.array).ravel()
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13 * np.abs(expected).max())


# row 2


def stress(case, A: np.ndarray) -> np.ndarray:
    """Nominal stress at a constant displacement gradient, by NumPy."""
    element, law, _, material = case
    F, one = np.eye(3) + A, np.eye(3)
    if law in ("neo-hookean", "energy"):
        J, Fit = np.linalg.det(F), np.linalg.inv(F).T
        if element == "full" or element == "one-point":
            return STEEL.mu * (F - Fit) + STEEL.lmbda * (J - 1) * J * Fit
        shape = STEEL.mu * J ** (-2 / 3) * (F - (F * F).sum() / 3 * Fit)
        return shape + (STEEL.lmbda + 2 * STEEL.mu / 3) * (J - 1) * J * Fit
    strain = (A + A.T) / 2 if law == "small-strain" else (F.T @ F - one) / 2
    if material is SPRUCE:
        sigma = np.einsum("ijkl,kl->ij", SPRUCE.tensor, strain)
    else:
        sigma = STEEL.lmbda * np.trace(strain) * one + 2 * STEEL.mu * strain
    return sigma if law == "small-strain" else F @ sigma


def patch_errors(cube: Domain, case) -> tuple[float, float]:
    """Largest force on interior nodes, and error of the mean stress, relative."""
    size = 1e-3 if case[1] == "small-strain" else 0.2
    A = size * np.array([[1, 2, 0], [-1, 0.5, 1], [0.3, 0, 1]])
    x = cube.V.tabulate_dof_coordinates()
    f = force(cube, case, x @ A.T)
    edge = cube.local_dofs(np.unique(boundary(cube.source.cells)))
    inside = np.setdiff1d(np.arange(len(x)), edge)
    assert len(inside) == 8
    expected = stress(case, A)
    error = np.abs(f.T @ x - expected).max() / np.abs(expected).max()
    return np.abs(f[inside]).max() / np.abs(f).max(), error


@pytest.mark.parametrize("case", CASES, ids=name)
def test_row_2_patch_test_on_distorted_hexahedra(cube, case):
    """u = A x, 20 % strain and turn: no force on interior nodes, Σ f ⊗ x = P V; 1e-12."""
    inside, mean = patch_errors(cube, case)
    assert inside <= 1e-12
    assert mean <= 1e-12


def spectrum(case, seeds: int = 10) -> np.ndarray:
    """Eigenvalues of single distorted cells at rest over the largest, ascending, ``(n, 24)``."""
    domain = distribute(blocks.block((0, 0, 0), (1, 1, 1), cells=(1, 1, 1)), MPI.COMM_SELF)
    u, w = fem.Function(domain.V), ufl.TestFunction(domain.V)
    tangent = ufl.derivative(work(domain, case, u, w), u, ufl.TrialFunction(domain.V))
    compiled, x, found = fem.form(tangent), domain.msh.geometry.x, []
    start = x.copy()
    for seed in range(seeds):
        x[:] = start + np.random.default_rng(seed).uniform(-0.15, 0.15, x.shape)
        K = fem.assemble_matrix(compiled).to_dense()
        assert np.abs(K - K.T).max() <= 1e-14 * np.abs(K).max()
        values = np.linalg.eigvalsh(K)
        found.append(values / values[-1])
    return np.array(found)


@pytest.mark.parametrize("case", CASES, ids=name)
def test_row_2_a_cell_has_six_rigid_motions_and_no_other_free_one(case):
    """Ten warped cells: exactly 6 zero eigenvalues (1e-14) and 18 stiff ones.

    The least of those is above 0.02 of the largest; of spruce, whose moduli differ by 220, 0.004.
    """
    values = spectrum(case)
    assert np.abs(values[:, :6]).max() <= 1e-14
    assert values[:, 6:].min() >= (4e-3 if case[3] is SPRUCE else 2e-2)


# row 3


def rigid_error(cube: Domain, case, degrees: float, shift: float = 1.0) -> float:
    """Force, elastic and damping, of a turned, shifted and spinning body over E h |u|."""
    x = cube.V.tabulate_dof_coordinates()
    now = x @ rotation(degrees).T + shift * np.array([1.0, -0.5, 0.2])
    v = np.cross([3.0, 50.0, -7.0], now) + np.array([20.0, 1.0, 0.0])
    material = getattr(case[3], "isotropic", case[3])
    scale = material.E / 3 * np.abs(now - x).max()
    forces = force(cube, case, now - x), force(cube, case, now - x, v)
    return max(np.abs(f).max() for f in forces) / scale


@pytest.mark.parametrize("degrees", [1, 90, 1000])
@pytest.mark.parametrize("case", LARGE, ids=name)
def test_row_3_rotation_leaves_no_force(cube, case, degrees):
    """Turned, shifted and spinning: no elastic or damping force, ≤ 1e-10 of the scale E h |u|."""
    assert rigid_error(cube, case, degrees) <= 1e-10


@pytest.mark.parametrize("case", CASES, ids=name)
def test_row_3_translation_leaves_no_force(cube, case):
    """Shifted by a kilometre, for small strain too: round-off of E h |u|, 1e-14."""
    x = cube.V.tabulate_dof_coordinates()
    shift = 1e3 * np.array([1.0, -0.5, 0.2]) + 0 * x
    material = getattr(case[3], "isotropic", case[3])
    assert np.abs(force(cube, case, shift)).max() <= 1e-14 * material.E / 3 * 1e3
