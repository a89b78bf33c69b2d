# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cell means and hourglass modes against full quadrature, closed forms and UFL's own derivative."""

from mpi4py import MPI

import dolfinx
import numpy as np
import pytest
import ufl
from dolfinx import fem

from forms.cells import CellGrad, mean_gradient, one_point, per_point, positions, uniform, volume
from forms.elasticity import Elastic, full, small_strain, st_venant_kirchhoff
from forms.hourglass import hourglass, hourglass_energy, one_point_residual
from forms.kernel import CellIntegral, CellKernel
from meshes.domain import Domain, distribute
from meshes.shapes import blocks

STEEL = Elastic(210e9, 0.3, 7800.0, damping=1e-6)
SCALINGS = [None, 0.1]


@pytest.fixture(scope="module")
def cube() -> Domain:
    """A unit cube of 27 hexahedra, all of them with warped faces."""
    domain = distribute(blocks.block((0, 0, 0), (1, 1, 1), cells=(3, 3, 3)), MPI.COMM_SELF)
    x = domain.msh.geometry.x
    x += np.random.default_rng(1).uniform(-0.08, 0.08, x.shape)
    return domain


@pytest.fixture(scope="module")
def cell() -> Domain:
    """One warped hexahedron."""
    domain = distribute(blocks.block((0, 0, 0), (1, 1, 1), cells=(1, 1, 1)), MPI.COMM_SELF)
    x = domain.msh.geometry.x
    x += np.random.default_rng(2).uniform(-0.15, 0.15, x.shape)
    return domain


def values(form) -> np.ndarray:
    """Nodal values of a one-form with the present coefficients."""
    (w,) = form.arguments()
    out = np.zeros_like(fem.Function(w.ufl_function_space()).x.array)
    CellKernel(form).add(out)
    return out


def random_field(domain: Domain, size: float, seed: int) -> fem.Function:
    f = fem.Function(domain.V)
    f.x.array[:] = size * np.random.default_rng(seed).standard_normal(f.x.array.shape)
    return f


def stiffness(domain: Domain, form, u: fem.Function) -> np.ndarray:
    """Dense tangent of a one-form, column by column."""
    direction = fem.Function(domain.V)
    kernel = CellKernel(ufl.derivative(form, u, direction))
    columns = np.zeros((direction.x.array.size,) * 2)
    for j, out in enumerate(columns):
        direction.x.array[:] = np.arange(len(out)) == j
        kernel.add(out)
    return columns.T


def per_cell(domain: Domain, integrand, dx) -> np.ndarray:
    """Integral over each cell."""
    t = ufl.TestFunction(fem.functionspace(domain.msh, ("DG", 0)))
    return fem.assemble_vector(fem.form(integrand * t * dx)).array


def test_volume_of_warped_cells_is_exact(cube):
    """One-point sums with the closed-form volume = 3×3×3 Gauss points, 1e-14 per cell."""
    x, dx = positions(cube.msh.ufl_domain()), full(cube.msh)
    expected = per_cell(cube, 1.0, dx(metadata={"quadrature_degree": 5}))
    found = per_cell(cube, volume(x) * per_point(cube.msh.ufl_domain()), one_point(dx))
    np.testing.assert_allclose(found, expected, rtol=1e-13)


def test_mean_gradient_of_warped_cells_is_exact(cube):
    """∫ ∂u_i/∂x_j by the closed form = 3×3×3 Gauss points, 1e-13, in all nine components."""
    u, dx = random_field(cube, 1.0, 3), full(cube.msh)
    weight = volume(positions(cube.msh.ufl_domain())) * per_point(cube.msh.ufl_domain())
    t = ufl.TestFunction(fem.functionspace(cube.msh, ("DG", 0, (3, 3))))
    found = values(ufl.inner(mean_gradient(u), t) * weight * one_point(dx))
    expected = values(ufl.inner(ufl.grad(u), t) * dx(metadata={"quadrature_degree": 5}))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-14)


def test_one_point_forms_add_to_others(cube):
    """The mixed one-point measure adds to full quadrature on the same cells, 1e-15.

    The plain one does not in FFCx 0.11, for any form: remove ``mixed`` when this fails.
    """
    u, w, dx = random_field(cube, 0.1, 9), ufl.TestFunction(cube.V), full(cube.msh)
    form = ufl.inner(ufl.grad(u), ufl.grad(w))
    apart = [values(form * part) for part in (dx, one_point(dx), one_point(dx, mixed=True))]
    np.testing.assert_allclose(apart[1], apart[2], rtol=0, atol=1e-15)
    found = values(form * dx + form * one_point(dx, mixed=True))
    np.testing.assert_allclose(found, apart[0] + apart[2], rtol=0, atol=1e-15)
    wrong = fem.assemble_vector(fem.form(form * dx + form * one_point(dx))).array
    assert np.abs(wrong - apart[0] - apart[1]).max() > 1e-3


def test_uniform_replaces_gradients_behind_operators(cube):
    """A residual by ``variable`` and ``diff`` has the same means as the one written out."""
    u, w, dx = random_field(cube, 0.01, 4), ufl.TestFunction(cube.V), full(cube.msh)
    F = ufl.variable(ufl.Identity(3) + ufl.grad(u))
    C = F.T * F - ufl.Identity(3)
    energy = STEEL.lmbda / 8 * ufl.tr(C) ** 2 + STEEL.mu / 4 * ufl.inner(C, C)
    indirect = ufl.inner(ufl.diff(energy, F), ufl.grad(w))
    expected = values(uniform(st_venant_kirchhoff(u, w, STEEL)) * one_point(dx))
    found = values(uniform(indirect) * one_point(dx))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10 * np.abs(expected).max())


def test_cell_gradient_is_grad_times_jacobian(cube):
    """∂u/∂ξ = ∇u J, and the derivative by u keeps it."""
    u, w, dx = random_field(cube, 1.0, 5), ufl.TestFunction(cube.V), full(cube.msh)
    J = ufl.Jacobian(cube.msh)
    own, known = CellGrad(u), ufl.dot(ufl.grad(u), J)
    for D in (own, known):
        assert D.ufl_shape == (3, 3)
    found = values(ufl.derivative(ufl.inner(own, own) * dx, u, w))
    expected = values(ufl.derivative(ufl.inner(known, known) * dx, u, w))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


def test_what_is_not_a_trilinear_field_is_refused(cube):
    """Gradients of scalars, of other expressions, and tetrahedra."""
    scalar = fem.Function(fem.functionspace(cube.msh, ("Lagrange", 1)))
    with pytest.raises(ValueError, match="vector field"):
        uniform(ufl.inner(ufl.grad(scalar), ufl.grad(scalar)))
    with pytest.raises(ValueError, match="expected a function"):
        CellGrad(ufl.as_vector([1, 2, 3]) * scalar)
    tets = dolfinx.mesh.create_unit_cube(MPI.COMM_SELF, 1, 1, 1)
    with pytest.raises(ValueError, match="trilinear hexahedra"):
        positions(ufl.domain.extract_unique_domain(ufl.SpatialCoordinate(tets)))


@pytest.mark.parametrize("coefficient", SCALINGS)
@pytest.mark.parametrize("rotating", [False, True])
def test_force_is_the_derivative_of_the_energy(cube, coefficient, rotating):
    """Hand-collected residual = ``ufl.derivative`` of the energy, to round-off; large strain."""
    u, w, dx = random_field(cube, 0.05, 6), ufl.TestFunction(cube.V), one_point(full(cube.msh))
    options = {"rotating": rotating, "coefficient": coefficient}
    force = values(hourglass(u, w, STEEL, **options) * dx)
    expected = values(ufl.derivative(hourglass_energy(u, STEEL, **options) * dx, u, w))
    np.testing.assert_allclose(force, expected, rtol=0, atol=1e-13 * np.abs(expected).max())


@pytest.mark.parametrize("coefficient", SCALINGS)
@pytest.mark.parametrize("rotating", [False, True])
def test_collected_residual_is_the_sum_of_its_parts(cube, coefficient, rotating):
    """Stress, control and a term with ``w`` itself, collected by derivatives of w: to 1e-14."""
    law = st_venant_kirchhoff if rotating else small_strain

    def residual(u, w, material, v=None):
        return law(u, w, material, v) + 1e9 * ufl.inner(u, w)

    u, v, w = random_field(cube, 0.05, 6), random_field(cube, 1e3, 9), ufl.TestFunction(cube.V)
    options, dx = {"rotating": rotating, "coefficient": coefficient}, one_point(full(cube.msh))
    found = values(one_point_residual(residual, **options)(u, w, STEEL, v) * dx)
    expected = values(uniform(residual(u, w, STEEL, v)) * dx)
    expected += values(hourglass(u, w, STEEL, v, **options) * dx)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-14 * np.abs(expected).max())


@pytest.mark.parametrize("coefficient", SCALINGS)
def test_linear_fields_feel_nothing(cube, coefficient):
    """u = A x on warped cells: 1e-15 of the force of a random field of that size."""
    x = cube.msh.geometry.x
    nodes = np.empty((len(x), 3))
    nodes[cube.V.dofmap.list] = x[cube.msh.geometry.dofmaps[0]]
    u, w, dx = fem.Function(cube.V), ufl.TestFunction(cube.V), one_point(full(cube.msh))
    form = hourglass(u, w, STEEL, rotating=False, coefficient=coefficient) * dx
    random = np.random.default_rng(7)
    u.x.array[:] = random.standard_normal(nodes.size)
    scale = np.abs(values(form)).max()
    u.x.array[:] = (nodes @ random.standard_normal((3, 3))).ravel()
    assert np.abs(values(form)).max() <= 1e-15 * scale


@pytest.mark.parametrize("coefficient", SCALINGS)
@pytest.mark.parametrize("rotating", [False, True])
def test_rank_of_a_warped_cell_is_18(cell, coefficient, rotating):
    """12 from the hourglass modes, 6 from the one point; together all but the rigid motions."""
    u, w, dx = fem.Function(cell.V), ufl.TestFunction(cell.V), full(cell.msh)
    residual = st_venant_kirchhoff if rotating else small_strain
    control = hourglass(u, w, STEEL, rotating=rotating, coefficient=coefficient) * one_point(dx)
    means = uniform(residual(u, w, STEEL)) * one_point(dx)
    for form, rank in ((control, 12), (means, 6), (means + control, 18)):
        K = stiffness(cell, form, u)
        assert np.abs(K - K.T).max() <= 1e-15 * np.abs(K).max()
        eigenvalues = np.linalg.eigvalsh(K)
        assert np.all(np.abs(eigenvalues[: 24 - rank]) <= 1e-14 * eigenvalues[-1])
        assert np.all(eigenvalues[24 - rank :] >= 1e-3 * eigenvalues[-1])


@pytest.mark.parametrize("axes", [(0, 1, 2), (1, 2, 0), (2, 0, 1), (0, 2, 1)])
def test_one_cell_bends_as_a_plate(axes):
    """u_a = κ x_a x_b in a cell of 0.3 × 0.2 × 0.1 m: energy E/(1 − ν²) κ² V h_b² / 24, 1e-13.

    No shear and no stress across the layer; full quadrature is far stiffer.
    """
    a, b, _ = axes
    sides = np.array([0.3, 0.2, 0.1])
    domain = distribute(blocks.block(-sides / 2, sides / 2, cells=(1, 1, 1)), MPI.COMM_SELF)
    u, x = fem.Function(domain.V), domain.V.tabulate_dof_coordinates()
    u.x.array.reshape(-1, 3)[:, a] = 0.01 * x[:, a] * x[:, b]
    energy = hourglass_energy(u, STEEL, rotating=False) * one_point(full(domain.msh))
    expected = STEEL.E / (1 - 0.3**2) * 0.01**2 * sides.prod() * sides[b] ** 2 / 24
    assert CellIntegral(energy)() == pytest.approx(expected, rel=1e-13)


def test_one_cell_twists_as_full_quadrature_says():
    """u = θ (−y z, x z, 0) in a box: energy μ θ² V (h_x² + h_y²) / 24, 1e-13."""
    sides = np.array([0.3, 0.2, 0.1])
    domain = distribute(blocks.block(-sides / 2, sides / 2, cells=(1, 1, 1)), MPI.COMM_SELF)
    u, (x, y, z) = fem.Function(domain.V), domain.V.tabulate_dof_coordinates().T
    u.x.array[:] = 0.01 * np.column_stack([-y * z, x * z, 0 * x]).ravel()
    energy = hourglass_energy(u, STEEL, rotating=False) * one_point(full(domain.msh))
    expected = STEEL.mu * 0.01**2 * sides.prod() * (sides[0] ** 2 + sides[1] ** 2) / 24
    assert CellIntegral(energy)() == pytest.approx(expected, rel=1e-13)


@pytest.mark.parametrize("coefficient", SCALINGS)
def test_damping_dissipates_and_is_the_rate_of_the_force(cube, coefficient):
    """At rest, the damping force at velocity v is β times the force of displacement v."""
    v, w, dx = random_field(cube, 1e-3, 8), ufl.TestFunction(cube.V), one_point(full(cube.msh))
    rest = fem.Function(cube.V)
    damped = values(hourglass(rest, w, STEEL, v, coefficient=coefficient) * dx)
    elastic = values(hourglass(v, w, STEEL, rotating=False, coefficient=coefficient) * dx)
    np.testing.assert_allclose(
        damped, STEEL.damping * elastic, rtol=0, atol=1e-13 * np.abs(damped).max()
    )
    assert damped @ v.x.array > 0
