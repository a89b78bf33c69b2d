# SPDX-License-Identifier: LGPL-3.0-or-later
"""What ``CellKernel`` promises its callers; its numbers are checked by verification row 1."""

import subprocess
import sys

from mpi4py import MPI

import dolfinx
import numpy as np
import pytest
import ufl
from dolfinx import fem
from ufl import grad, inner

from forms.elasticity import Elastic, full, small_strain
from forms.kernel import CellIntegral, CellKernel
from meshes.domain import Domain, distribute
from meshes.shapes import blocks

STEEL = Elastic(210e9, 0.3, 7800.0)


@pytest.fixture(scope="module")
def cube() -> Domain:
    """A distorted unit cube of 27 hexahedra."""
    box = blocks.block((0, 0, 0), (1, 1, 1), cells=(3, 3, 3))
    return distribute(blocks.distorted(box, amplitude=0.3, seed=1), MPI.COMM_SELF)


def body_force(domain: Domain) -> tuple[fem.Function, fem.Function, CellKernel]:
    """Kernel of ``∫ (2 a + 3 b) · w`` with its two coefficients."""
    a, b, w = fem.Function(domain.V), fem.Function(domain.V), ufl.TestFunction(domain.V)
    return a, b, CellKernel(inner(2 * a + 3 * b, w) * full(domain.msh))


def total(out: np.ndarray) -> np.ndarray:
    """Sum of a nodal force: ``∫ (2 a + 3 b)``, the partition of unity, for constant a and b."""
    return out.reshape(-1, 3).sum(axis=0)


def test_add_adds_to_what_is_there(cube):
    """Twice into an array of ones: 1 + 2 f."""
    _, _, kernel = body_force(cube)
    ones, zero = np.ones_like(kernel.coefficients[0].x.array), 0.0
    once, twice = np.zeros_like(ones), np.ones_like(ones)
    kernel.add(ones, zero, once)
    for _ in range(2):
        kernel.add(ones, zero, twice)
    np.testing.assert_allclose(twice, 1 + 2 * once, rtol=1e-14)
    np.testing.assert_allclose(total(once), [2, 2, 2], rtol=1e-13)


def test_coefficients_come_in_order_as_arrays_functions_or_their_own_values(cube):
    """∫ (2 a + 3 b) over the unit cube for constant a and b, given in each of the three ways."""
    a, b, kernel = body_force(cube)
    other = fem.Function(cube.V)
    other.x.array[:] = 10.0
    out = dolfinx.la.vector(cube.V.dofmap.index_map, 3)
    for given, expected in (((1.0, other), 32), ((other, 1.0), 23), ((), 23)):
        out.array[:] = 0.0
        kernel.add(*given, out)
        np.testing.assert_allclose(total(out.array), expected, rtol=1e-13)
    a.x.array[:] = 0.0
    b.x.array[:] = 5.0
    out.array[:] = 0.0
    kernel.add(out)
    np.testing.assert_allclose(total(out.array), 15, rtol=1e-13)


def test_wrong_number_of_coefficients_is_named(cube):
    """One value for two coefficients."""
    a, _, kernel = body_force(cube)
    with pytest.raises(ValueError, match="expected none or 2, got 1"):
        kernel.add(a, np.zeros_like(a.x.array))


@pytest.mark.parametrize("rank", [0, 2])
def test_forms_of_other_rank_are_refused(cube, rank):
    """A functional and a bilinear form."""
    u = fem.Function(cube.V) if rank == 0 else ufl.TrialFunction(cube.V)
    w = fem.Function(cube.V) if rank == 0 else ufl.TestFunction(cube.V)
    with pytest.raises(ValueError, match=rf"expected rank 1 .* got rank {rank}"):
        CellKernel(inner(u, w) * ufl.dx)


def test_facet_integrals_are_refused(cube):
    """A traction over the surface beside a cell integral."""
    w = ufl.TestFunction(cube.V)
    with pytest.raises(ValueError, match=r"cell integrals only, got \['cell', 'exterior_facet'\]"):
        CellKernel(w[0] * ufl.dx + w[0] * ufl.ds)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_fast_math_lets_a_nan_through_to_the_force(cube, bad):
    """One bad displacement makes the force of its own node non-finite, and no far one."""
    u, w = fem.Function(cube.V), ufl.TestFunction(cube.V)
    kernel = CellKernel(small_strain(u, w, STEEL) * full(cube.msh))
    out = np.zeros_like(u.x.array)
    along = cube.V.tabulate_dof_coordinates().sum(axis=1)
    corner, far = int(np.argmin(along)), int(np.argmax(along))
    u.x.array[3 * corner] = bad
    kernel.add(out)
    assert not np.isfinite(out[3 * corner])
    assert np.isfinite(out.reshape(-1, 3)[far]).all()


def test_integral_sums_over_the_mesh(cube):
    """∫ |∇u|² of u = (x + 2y, 0, 3z) over the unit cube is 1 + 4 + 9."""
    u = fem.Function(cube.V)
    x, y, z = cube.V.tabulate_dof_coordinates().T
    u.x.array[:] = np.column_stack([x + 2 * y, 0 * x, 3 * z]).ravel()
    assert CellIntegral(inner(grad(u), grad(u)) * full(cube.msh))() == pytest.approx(14, rel=1e-13)


def test_the_face_of_forms_is_complete_and_cheap():
    """``import forms`` loads neither UFL nor DOLFINx; every name of ``__all__`` is there."""
    code = (
        "import sys, forms\n"
        "assert not {'ufl', 'dolfinx'} & sys.modules.keys()\n"
        "from forms import *\n"
        "assert Law.from_energy and LAWS and CellKernel is sys.modules['forms.kernel'].CellKernel\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=120)
