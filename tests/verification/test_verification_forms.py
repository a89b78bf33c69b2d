# SPDX-License-Identifier: LGPL-3.0-or-later
"""Verification rows 1 to 3: cell kernels, volume patch test, rigid motion.

All on one distorted mesh of 27 hexahedra in two regions, which fills the unit cube.
"""

from typing import Any

from mpi4py import MPI

import basix.ufl
import dolfinx
import numpy as np
import pytest
import ufl
from dolfinx import fem
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from ufl import Identity, det, grad, inner, ln, sym, tr

from forms.elasticity import Elastic, full, small_strain, st_venant_kirchhoff
from forms.kernel import CellKernel
from forms.simd.native import NativeKernel
from meshes.domain import Domain, distribute
from meshes.hexmesh import boundary, join
from meshes.shapes import blocks
from meshes.tags import Tag

STEEL = Elastic(210e9, 0.3, 7800.0, damping=1e-6)
RESIDUALS = {"small strain": small_strain, "St. Venant-Kirchhoff": st_venant_kirchhoff}


@pytest.fixture(scope="module")
def cube() -> Domain:
    """A distorted unit cube."""
    box = blocks.block((0, 0, 0), (1, 1, 1), cells=(3, 3, 3))
    return distribute(blocks.distorted(box, amplitude=0.3, seed=1), MPI.COMM_SELF)


@pytest.fixture(scope="module")
def two(cube) -> Domain:
    """The cube next to a coarser one of another region."""
    other = blocks.block((2, 0, 0), (3, 1, 1), cells=(2, 2, 2), region=Tag.BASE)
    return distribute(join(cube.source, blocks.distorted(other, seed=2)), MPI.COMM_SELF)


def positions(domain: Domain) -> np.ndarray:
    return domain.V.tabulate_dof_coordinates()


def force(domain: Domain, integrand, *fields: np.ndarray) -> np.ndarray:
    """Nodal forces of an integrand of the given nodal fields, shape ``(n, 3)``."""
    functions = [fem.Function(domain.V) for _ in fields]
    w = ufl.TestFunction(domain.V)
    kernel = CellKernel(integrand(*functions, w) * full(domain.msh))
    out = np.zeros_like(functions[0].x.array)
    kernel.add(*(np.ravel(x) for x in fields), out)
    return out.reshape(-1, 3)


def rotation(degrees: float) -> np.ndarray:
    """Rotation about a slanted axis (Rodrigues' formula)."""
    a = np.radians(degrees)
    n = np.array([1.0, 2.0, 3.0]) / np.sqrt(14)
    N = np.cross(np.eye(3), n) * -1
    return np.eye(3) + np.sin(a) * N + (1 - np.cos(a)) * N @ N


# row 1


def neo_hookean(u, w):
    """A residual that forms/ does not have: any UFL one-form goes."""
    F = Identity(3) + grad(u)
    P = STEEL.mu * (F - ufl.inv(F).T) + STEEL.lmbda * ln(det(F)) * ufl.inv(F).T
    return inner(P, grad(w))


def varying(u, w, E):
    """Small strain with Young's modulus as a P1 field, ν = 0."""
    return E * inner(sym(grad(u)), sym(grad(w)))


Pool = dict[int, list[Any]]  # scalars by the quadrature degree that they go with


def pool(domain: Domain, seed: int) -> Pool:
    """Everything scalar that a form may hold, of order one, random: by quadrature degree 2 and 3.

    Vector and scalar P1 fields, their gradients, cell-wise and point-wise fields, constants, the
    coordinates.
    """
    random, msh = np.random.default_rng(seed), domain.msh
    point = [
        basix.ufl.quadrature_element("hexahedron", value_shape=(), degree=degree)
        for degree in (2, 3)
    ]
    fields = []
    for element in (("Lagrange", 1, (3,)), ("Lagrange", 1), ("DG", 0), *point):
        f = fem.Function(fem.functionspace(msh, element))
        f.x.array[:] = random.uniform(-1, 1, f.x.array.shape)
        fields.append(f)
    u, p, q, *points = fields
    H = grad(u) / 3  # h = 1/3
    c = [fem.Constant(msh, random.uniform(0.5, 2)), fem.Constant(msh, random.uniform(-1, 1, 3))]
    x = ufl.SpatialCoordinate(msh)
    shared = [u[0], u[2], H[0, 1], H[2, 2], tr(H), p, grad(p)[1] / 3, q, c[0], c[1][2], x[0], x[2]]
    return {degree: [*shared, own] for degree, own in zip((2, 3), points, strict=True)}


UNARY = {
    "abs": abs,
    "sqrt": lambda a: ufl.sqrt(1 + a**2),
    "square": lambda a: a**2,
    "cube": lambda a: a**3,
    "power": lambda a: (1 + a**2) ** 0.7,
    "reciprocal": lambda a: 1 / (1 + a**2),
    "exp": lambda a: ufl.exp(-(a**2)),
    "ln": lambda a: ln(2 + a**2),
    "sin": ufl.sin,
    "tanh": ufl.tanh,
}
BINARY = {
    "+": lambda a, b: a + b,
    "-": lambda a, b: a - b,
    "*": lambda a, b: a * b,
    "/": lambda a, b: a / (1.5 + abs(b)),
    "min": ufl.min_value,
    "max": ufl.max_value,
    "atan2": lambda a, b: ufl.atan2(a, 2 + b**2),
    "lt": lambda a, b: ufl.conditional(ufl.lt(a, b), a * b, 2 - b),
    "and": lambda a, b: ufl.conditional(ufl.And(ufl.gt(a, 0.1), ufl.Not(ufl.le(b, 0.2))), a, b**2),
}
DEGREES = st.sampled_from([2, 3])
SCALARS = st.recursive(
    st.integers(0, 12),
    lambda inner: st.one_of(
        st.tuples(st.sampled_from(sorted(UNARY)), inner),
        st.tuples(st.sampled_from(sorted(BINARY)), inner, inner),
    ),
    max_leaves=5,
)
TESTED = ("w", "grad w", "small strain", "St. Venant-Kirchhoff")
TERMS = st.tuples(
    SCALARS,
    st.sampled_from(TESTED),
    DEGREES,
    st.sampled_from([None, (Tag.BLOCK,), (Tag.BASE,), (Tag.BLOCK, Tag.BASE)]),
)


def scalar(drawn: Any, leaves: list[Any]) -> Any:
    """UFL expression of a drawn tree."""
    if isinstance(drawn, int):
        return leaves[drawn]
    name, *operands = drawn
    return (UNARY | BINARY)[name](*(scalar(each, leaves) for each in operands))


def term(drawn: Any, domain: Domain, leaves: Pool, w: Any) -> Any:
    """A cell integral of one region, or some, or all, with one of two quadrature degrees."""
    tree, tested, degree, region = drawn
    a = scalar(tree, leaves[degree])
    u = leaves[degree][0].ufl_operands[0]
    if tested == "w":
        integrand = a * w[1] + inner(u, w)
    elif tested == "grad w":
        integrand = a * grad(w)[0, 2] - grad(w)[1, 1]
    else:
        soft = Elastic(1 + a**2, 0.3, 1.0)
        residual = small_strain if tested == "small strain" else st_venant_kirchhoff
        integrand = residual(u, w, soft)
    dx = full(domain.msh, domain.regions)(metadata={"quadrature_degree": degree})
    return integrand * (dx if region is None else dx(region))


def kernel_error(form: Any, dtype: Any) -> float:
    """Difference of native kernel and ``assemble_vector`` with default flags, over the largest."""
    expected = fem.assemble_vector(fem.form(form)).array
    out = np.zeros_like(expected)
    NativeKernel(form, dtype).add(out)
    return float(np.abs(out - expected).max() / (np.abs(expected).max() or 1.0))


@settings(
    max_examples=16,
    deadline=None,
    derandomize=True,
    phases=[Phase.explicit, Phase.generate],  # each example is compiled: no search for a smaller
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(st.lists(TERMS, min_size=1, max_size=4), st.integers(0, 1000))
def test_row_1_random_forms(two, drawn, seed):
    """Sums of random terms: native kernel = ``assemble_vector``, 1e-13 of the largest entry.

    Any scalars under any functions, conditionals included, before ``w``, ``∇w`` or as a modulus;
    all cells, a region, or two; two quadrature degrees with fields at the points of each. In single
    precision within 1e-5.
    """
    leaves, w = pool(two, seed), ufl.TestFunction(two.V)
    form = sum(term(each, two, leaves, w) for each in drawn)
    assert kernel_error(form, np.float64) <= 1e-13
    assert kernel_error(form, np.float32) <= 1e-5


FORMS = {
    "small strain": lambda u, v, E, w, dx: small_strain(u, w, STEEL, v) * dx,
    "St. Venant-Kirchhoff": lambda u, v, E, w, dx: st_venant_kirchhoff(u, w, STEEL, v) * dx,
    "neo-Hookean": lambda u, v, E, w, dx: neo_hookean(u, w) * dx,
    "mass": lambda u, v, E, w, dx: STEEL.rho * inner(u, w) * dx(metadata={"quadrature_degree": 3}),
    "varying coefficient": lambda u, v, E, w, dx: varying(u, w, E) * dx,
    "several regions": lambda u, v, E, w, dx: (
        small_strain(u, w, STEEL) * dx(Tag.BLOCK)
        + STEEL.rho * inner(v, w) * dx(Tag.BASE)
        + tr(grad(u)) * w[0] * dx((Tag.BLOCK, Tag.BASE))
    ),
}


@pytest.mark.parametrize("form", FORMS)
def test_row_1_kernel_equals_dolfinx_assembly(two, form):
    """Kernel with fast flags = ``assemble_vector`` with default flags, 1e-13 of the largest entry.

    Reassociated sums of some hundred terms differ by a few hundred round-offs at most.
    """
    random = np.random.default_rng(0)
    u, v = fem.Function(two.V), fem.Function(two.V)
    E = fem.Function(fem.functionspace(two.msh, ("Lagrange", 1)))
    u.x.array[:] = 0.02 * random.standard_normal(u.x.array.shape)
    v.x.array[:] = random.standard_normal(v.x.array.shape)
    E.x.array[:] = random.uniform(1e9, 2e11, E.x.array.shape)
    F = FORMS[form](u, v, E, ufl.TestFunction(two.V), full(two.msh, two.regions))
    expected = fem.assemble_vector(fem.form(F)).array
    out = dolfinx.la.vector(two.V.dofmap.index_map, 3)
    out.array[:] = 0.0
    CellKernel(F).add(out)
    assert np.abs(expected).max() > 0
    np.testing.assert_allclose(out.array, expected, rtol=0, atol=1e-13 * np.abs(expected).max())


# row 2


@pytest.mark.parametrize("name", RESIDUALS)
def test_row_2_patch_test_on_distorted_hexahedra(cube, name):
    """u = A x: no force on any interior node; the moments Σ f ⊗ x are the exact stress × volume.

    For small strain σ = C : sym A; else P = F S with 2E = FᵀF − I, and A is 20 % strain and turn.
    Round-off over the largest nodal force: 1e-12.
    """
    A = (0.2 if name != "small strain" else 1e-3) * np.array([[1, 2, 0], [-1, 0.5, 1], [0.3, 0, 1]])
    F = np.eye(3) + A
    strain = (A + A.T) / 2 if name == "small strain" else (F.T @ F - np.eye(3)) / 2
    stress = STEEL.lmbda * np.trace(strain) * np.eye(3) + 2 * STEEL.mu * strain
    stress = stress if name == "small strain" else F @ stress
    x = positions(cube)
    f = force(cube, lambda u, w: RESIDUALS[name](u, w, STEEL), x @ A.T)
    inside = np.setdiff1d(
        np.arange(len(x)), cube.local_dofs(np.unique(boundary(cube.source.cells)))
    )
    assert len(inside) == 8
    assert np.abs(f[inside]).max() <= 1e-12 * np.abs(f).max()
    np.testing.assert_allclose(f.T @ x, stress, rtol=0, atol=1e-12 * np.abs(stress).max())


def test_row_2_stress_is_exact_at_every_point(cube):
    """u = A x on distorted cells: σ = C : sym A at every Gauss point to 1e-12."""
    A = 1e-3 * np.array([[1, 2, 0], [-1, 0.5, 1], [0.3, 0, 1]])
    u = fem.Function(cube.V)
    u.x.array[:] = (positions(cube) @ A.T).ravel()
    points = np.array([[i, j, k] for i in (0.2, 0.8) for j in (0.3, 0.7) for k in (0.0, 0.5)])
    sigma = fem.Expression(STEEL.stress(sym(grad(u))), points)
    values = sigma.eval(cube.msh, np.arange(27, dtype=np.int32)).reshape(-1, 3, 3)
    strain = (A + A.T) / 2
    exact = STEEL.lmbda * np.trace(strain) * np.eye(3) + 2 * STEEL.mu * strain
    assert len(values) == 27 * 8
    np.testing.assert_allclose(values - exact, 0, atol=1e-12 * np.abs(exact).max())


# row 3


@pytest.mark.parametrize("degrees", [0, 1, 90, 1000])
def test_row_3_rigid_motion_leaves_no_force(cube, degrees):
    """Turn about a slanted axis and shift by a metre: no force, ≤ 1e-10 of the scale E h |u|.

    Small strain, by contrast, must feel turns of 90 and 1000 degrees.
    """
    x = positions(cube)
    u = x @ rotation(degrees).T - x + [1.0, -0.5, 0.2]
    scale = STEEL.E / 3 * np.abs(u).max()
    f = force(cube, lambda u, w: st_venant_kirchhoff(u, w, STEEL), u)
    assert np.abs(f).max() <= 1e-10 * scale
    if degrees >= 90:
        linear = force(cube, lambda u, w: small_strain(u, w, STEEL), u)
        assert np.abs(linear).max() > 0.01 * scale


@pytest.mark.parametrize("degrees", [1, 90, 1000])
def test_row_3_stiffness_damping_does_not_feel_a_rigid_spin(cube, degrees):
    """Turned and spinning at v = V + ω × r: no damping force, ≤ 1e-10 of the scale β E h |v|."""
    x = positions(cube)
    now = x @ rotation(degrees).T
    v = np.cross([3.0, 50.0, -7.0], now) + np.array([20.0, 1.0, 0.0])

    def damped(u, v, w):
        return st_venant_kirchhoff(u, w, STEEL, v)

    f = force(cube, damped, now - x, v) - force(cube, damped, now - x, 0 * v)
    assert np.abs(f).max() <= 1e-10 * STEEL.damping * STEEL.E / 3 * np.abs(v).max()


def test_row_3_forces_turn_with_the_body(cube):
    """Objectivity: x → R x, v → R v + ω × R x turns elastic and damping force by R, to 1e-12."""
    x = positions(cube)
    random = np.random.default_rng(3)
    now = x + 0.03 * random.standard_normal(x.shape)
    v = 1e3 * random.standard_normal(x.shape)
    R = rotation(77.0)

    def damped(u, v, w):
        return st_venant_kirchhoff(u, w, STEEL, v)

    f = force(cube, damped, now - x, v)
    turned = force(cube, damped, now @ R.T - x, v @ R.T + np.cross([0, 0, 1e3], now @ R.T))
    np.testing.assert_allclose(turned, f @ R.T, rtol=0, atol=1e-12 * np.abs(f).max())
