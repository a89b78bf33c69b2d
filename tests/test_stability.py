# SPDX-License-Identifier: LGPL-3.0-or-later
"""The step bound against dense eigenvalues, a closed form and a damped oscillator (row 6)."""

from functools import cache
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
import scipy.linalg
import ufl
from dolfinx import fem

from forms.elasticity import Elastic, full, small_strain
from forms.stability import assembled_frequency, cell_frequency, stable_step
from meshes import blocks
from meshes.domain import Domain, distribute
from meshes.hexmesh import HexMesh, join

RHO = 7800.0


def body(mesh: HexMesh, nu: float, ratio: float = 1.0):
    """Domain, residual and mass form of a body whose stiffness varies from cell to cell.

    Young's modulus is a cell-wise field and ν a constant, so one compiled form serves all cases.
    """
    domain = distribute(mesh, MPI.COMM_SELF)
    E: Any = fem.Function(fem.functionspace(domain.msh, ("DG", 0)))
    random = np.random.default_rng(9)
    E.x.array[:] = 210e9 * ratio ** random.uniform(-1, 0, len(E.x.array))
    poisson: Any = fem.Constant(domain.msh, nu)  # UFL terms do where numbers would
    material = Elastic(E, poisson, RHO)
    dx = full(domain.msh)
    ones = ufl.as_vector([1.0, 1.0, 1.0])

    def inertia(w):
        return RHO * ufl.inner(ones, w) * dx(metadata={"quadrature_degree": 3})

    return domain, lambda u, w: small_strain(u, w, material) * dx, inertia


def largest_frequency(domain: Domain, residual, inertia) -> float:
    """Largest eigenfrequency of the assembled M⁻¹ K, dense, by stock DOLFINx assembly."""
    u, du, w = fem.Function(domain.V), ufl.TrialFunction(domain.V), ufl.TestFunction(domain.V)
    K = fem.assemble_matrix(fem.form(ufl.derivative(residual(u, w), u, du))).to_dense()
    m = fem.assemble_vector(fem.form(inertia(w))).array
    n = len(m)
    scaled = K / np.sqrt(np.outer(m, m))
    top = scipy.linalg.eigh(scaled, eigvals_only=True, subset_by_index=[n - 1, n - 1])
    return float(np.sqrt(top[0]))


@cache
def frequencies(nu: float, aspect: float, ratio: float, cells: int) -> tuple[float, float]:
    """Cell bound and assembled value on a distorted block whose cells are ``aspect`` : 1 : 1."""
    mesh = blocks.block((0, 0, 0), (aspect * cells, cells, cells), cells=(cells,) * 3)
    parts = body(blocks.distorted(mesh, amplitude=0.3, seed=10), nu, ratio)
    domain, residual, inertia = parts
    return cell_frequency(domain.V, residual, inertia), largest_frequency(*parts)


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.4999])
@pytest.mark.parametrize("aspect", [1.0, 50.0])
@pytest.mark.parametrize("ratio", [1.0, 1e6])
def test_row_6_cell_bound_is_never_exceeded(nu, aspect, ratio):
    """Largest cell eigenvalue ≥ largest assembled one (Irons and Treharne), and not wildly above.

    On 27 cells it is within a factor of 2.5 (a stiff cell among soft ones: mass of 8 neighbours).
    """
    bound, assembled = frequencies(nu, aspect, ratio, 3)
    assert assembled <= bound * (1 + 1e-12) <= 2.5 * assembled


@pytest.mark.parametrize("nu", [0.0, 0.4999])
def test_one_cell_is_its_own_mesh(nu):
    """With a single cell, bound and assembled value are the same number."""
    bound, assembled = frequencies(nu, 1.0, 1.0, 1)
    assert bound == pytest.approx(assembled, rel=1e-12)


def test_thin_slab_has_the_frequency_of_a_bar_element():
    """A cell of thickness h, a thousand times wider, ν = 0: ω = 2c/h of the lumped bar element.

    Shear adds (h/H)² c_s²-terms: 1e-6.
    """
    h, c = 1e-3, np.sqrt(210e9 / RHO)
    domain, residual, inertia = body(blocks.block((0, 0, 0), (h, 1, 1), cells=(1, 1, 1)), 0.0)
    omega = cell_frequency(domain.V, residual, inertia)
    assert omega == pytest.approx(2 * c / h, rel=1e-5)


def test_largest_cell_is_found_where_its_norm_is_not_the_largest(monkeypatch):
    """A slab and a cube of 2 % lower frequency but larger Frobenius norm, solved one at a time.

    A cell whose norm is larger than the best frequency so far must still be looked at.
    """
    slab = blocks.block((0, 0, 0), (1e-3, 1, 1), cells=(1, 1, 1))
    cube = blocks.block((2, 0, 0), (3, 1, 1), cells=(1, 1, 1))
    alone = [cell_frequency(d.V, k, m) for d, k, m in (body(mesh, 0.0) for mesh in (slab, cube))]
    side = alone[1] / (0.98 * alone[0])  # frequency goes with 1 / size
    cube = blocks.block((2, 0, 0), (2 + side, side, side), cells=(1, 1, 1))
    monkeypatch.setattr("forms.stability.CHUNK", 1)
    domain, residual, inertia = body(join(slab, cube), 0.0)
    assert cell_frequency(domain.V, residual, inertia) == pytest.approx(alone[0], rel=1e-9)


def growth(omega: float, beta: float, alpha: float, dt: float, steps: int = 20_000) -> float:
    """Largest |u| in the last tenth of a run over that in the first, damping lagged half a step."""
    u, v = 0.0, 1.0
    history = np.empty(steps)
    for i in range(steps):
        v += dt * (-(omega**2) * (u + beta * v) - alpha * v)
        u += dt * v
        history[i] = abs(u)
        if history[i] > 1e6 * history[0]:
            return np.inf
    return history[-steps // 10 :].max() / history[: steps // 10].max()


@pytest.mark.parametrize(("beta", "alpha"), [(0, 0), (0.2, 0), (3.0, 0), (0, 0.5), (0.4, 0.3)])
def test_damping_shortens_the_stable_step_as_much_as_it_should(beta, alpha):
    """Oscillator of 1 rad/s with forces of v(t − dt/2): bounded at 0.999 dt, diverging at 1.001 dt.

    The scheme is stable up to ω dt = 2 (√(1 + ζ²) − ζ) exactly.
    """
    dt = stable_step(1.0, beta, alpha)
    assert growth(1.0, beta, alpha, 0.999 * dt) <= 1.01
    assert growth(1.0, beta, alpha, 1.001 * dt) == np.inf


def test_undamped_step_is_two_over_omega():
    """ω dt = 2."""
    assert stable_step(8.0) == pytest.approx(0.25, rel=1e-15)


@pytest.mark.parametrize(("nu", "aspect", "ratio"), [(0.3, 1, 1), (0.49, 10, 1), (0.3, 1, 1e6)])
def test_lanczos_finds_the_assembled_frequency(nu, aspect, ratio):
    """Matrix-free Lanczos against the dense eigenvalue: not below it, 0.1 % above at most."""
    mesh = blocks.block((0, 0, 0), (4 * aspect, 4, 4), cells=(4, 4, 4))
    domain, residual, inertia = body(blocks.distorted(mesh, amplitude=0.3, seed=10), nu, ratio)
    mass = fem.assemble_vector(fem.form(inertia(ufl.TestFunction(domain.V)))).array
    found, converged = assembled_frequency(domain.V, residual, mass)
    dense = largest_frequency(domain, residual, inertia)
    assert converged
    assert 1 - 1e-9 <= found / dense <= 1 + 1e-3


def test_lanczos_says_when_it_has_not_converged():
    domain, residual, inertia = body(blocks.block((0, 0, 0), (4, 4, 4), cells=(4, 4, 4)), 0.3)
    mass = fem.assemble_vector(fem.form(inertia(ufl.TestFunction(domain.V)))).array
    assert not assembled_frequency(domain.V, residual, mass, iterations=5)[1]
