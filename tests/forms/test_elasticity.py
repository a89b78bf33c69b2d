# SPDX-License-Identifier: LGPL-3.0-or-later
"""Elastic materials against the textbook states of stress."""

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem

from forms.elasticity import Elastic, full, small_strain
from forms.elements import LAWS
from forms.kernel import CellIntegral, CellKernel
from meshes.domain import Domain, distribute
from meshes.hexmesh import join
from meshes.shapes import blocks
from meshes.tags import Tag

STEEL = Elastic(210e9, 0.3, 7800.0, damping=1e-6)
SIDES = np.array([0.5, 0.2, 0.3])  # of the block [m]


@pytest.fixture(scope="module")
def bar() -> Domain:
    """A distorted block of 0.5 m × 0.2 m × 0.3 m."""
    box = blocks.block((0, 0, 0), tuple(SIDES), cells=(3, 3, 3))
    return distribute(blocks.distorted(box, seed=4), MPI.COMM_SELF)


@pytest.fixture(scope="module")
def bodies(bar) -> dict:
    """Internal force and strain energy of every law as functions of the nodal values."""
    compiled = {}
    for name, law in LAWS.items():
        u, w = fem.Function(bar.V), ufl.TestFunction(bar.V)
        compiled[name] = (
            u,
            CellKernel(law.residual(u, w, STEEL) * full(bar.msh)),
            CellIntegral(law.energy(u, STEEL) * full(bar.msh)),
        )
    return compiled


def force(body, u: np.ndarray) -> np.ndarray:
    out = np.zeros_like(body[0].x.array)
    body[1].add(np.ravel(u), out)
    return out.reshape(-1, 3)


def energy(body, u: np.ndarray) -> float:
    body[0].x.array[:] = np.ravel(u)
    return body[2]()


def positions(domain: Domain) -> np.ndarray:
    return domain.V.tabulate_dof_coordinates()


def test_constants_are_those_of_steel():
    """λ and μ give E and ν back; pressure waves run at √(E(1−ν)/((1+ν)(1−2ν)ρ)) = 6020 m/s."""
    lmbda, mu = STEEL.lmbda, STEEL.mu
    assert mu * (3 * lmbda + 2 * mu) / (lmbda + mu) == pytest.approx(STEEL.E, rel=1e-14)
    assert lmbda / (2 * (lmbda + mu)) == pytest.approx(STEEL.nu, rel=1e-14)
    assert STEEL.dilatational_speed == pytest.approx(6020, abs=1)


def test_uniaxial_tension_pulls_with_youngs_modulus(bar, bodies):
    """u = ε (x, −νy, −νz): force E ε A on the end, nothing on the sides, energy E ε² V / 2."""
    e = 1e-3
    x = positions(bar)
    u = e * x * [1, -STEEL.nu, -STEEL.nu]
    f = force(bodies["small-strain"], u)
    end = np.isclose(x[:, 0], SIDES[0])
    pull = STEEL.E * e * SIDES[1] * SIDES[2]
    np.testing.assert_allclose(f[end].sum(axis=0), [pull, 0, 0], rtol=1e-12, atol=1e-12 * pull)
    assert np.abs(f[:, 1:]).max() < 1e-12 * pull
    work = STEEL.E * e**2 / 2 * SIDES.prod()
    assert energy(bodies["small-strain"], u) == pytest.approx(work, rel=1e-12)


def test_large_stretch_follows_st_venant_kirchhoff(bar, bodies):
    """Stretch s along x, none across: P = M (s³ − s)/2 with M = λ + 2μ, energy M (s²−1)²/8 V."""
    s = 1.4
    modulus = STEEL.lmbda + 2 * STEEL.mu
    x = positions(bar)
    u = x * [s - 1, 0, 0]
    f = force(bodies["total-lagrangian"], u)[np.isclose(x[:, 0], SIDES[0]), 0].sum()
    assert f == pytest.approx(modulus * (s**3 - s) / 2 * SIDES[1] * SIDES[2], rel=1e-12)
    work = modulus * (s**2 - 1) ** 2 / 8 * SIDES.prod()
    assert energy(bodies["total-lagrangian"], u) == pytest.approx(work, rel=1e-12)


def test_kinematics_agree_for_small_displacements(bar, bodies):
    """Strains of 1e-10: St. Venant–Kirchhoff is linear up to 1e-10, not lost in round-off of F."""
    u = 1e-11 * np.random.default_rng(5).standard_normal(positions(bar).shape)
    linear, exact = (force(bodies[k], u) for k in ("small-strain", "total-lagrangian"))
    np.testing.assert_allclose(exact, linear, rtol=0, atol=1e-8 * np.abs(linear).max())


@pytest.mark.parametrize("kinematics", LAWS)
def test_force_is_the_gradient_of_the_energy(bar, bodies, kinematics):
    """dE(u + s w)/ds = f(u) · w, by a central difference: error O(s²), about 1e-8."""
    random = np.random.default_rng(6)
    u, w = 0.01 * random.standard_normal((2, len(positions(bar)), 3))
    s = 1e-4
    body = bodies[kinematics]
    slope = (energy(body, u + s * w) - energy(body, u - s * w)) / (2 * s)
    assert slope == pytest.approx(np.vdot(force(body, u), w), rel=1e-6)


def test_damping_stress_is_beta_times_the_stress_of_the_velocity(bar, bodies):
    """Small strain: f(u, v) = K u + β K v."""
    u, v = 1e-3 * np.random.default_rng(7).standard_normal((2, len(positions(bar)), 3))
    fu, fv, w = fem.Function(bar.V), fem.Function(bar.V), ufl.TestFunction(bar.V)
    out = np.zeros_like(fu.x.array)
    CellKernel(small_strain(fu, w, STEEL, fv) * full(bar.msh)).add(u.ravel(), 1e6 * v.ravel(), out)
    body = bodies["small-strain"]
    expected = force(body, u) + STEEL.damping * 1e6 * force(body, v)
    atol = 1e-13 * np.abs(expected).max()
    np.testing.assert_allclose(out.reshape(-1, 3), expected, rtol=0, atol=atol)


def test_measure_is_limited_to_its_regions():
    """Volumes 0.03 and 2 of two blocks with their own region, by a force of 1 N/m³."""
    other = blocks.block((1, 0, 0), (2, 1, 2), cells=(2, 1, 1), region=Tag.BASE)
    mesh = join(blocks.block((0, 0, 0), tuple(SIDES), cells=(1, 2, 1)), other)
    both = distribute(mesh, MPI.COMM_SELF)
    w = ufl.TestFunction(both.V)
    found = []
    for region in ((Tag.BLOCK,), (Tag.BASE,), (Tag.BLOCK, Tag.BASE), None):
        dx = full(both.msh, both.regions, region and tuple(map(int, region)))
        out = np.zeros(3 * len(both.nodes))
        CellKernel(w[0] * dx).add(out)
        found.append(out.sum())
    np.testing.assert_allclose(found, [0.03, 2, 2.03, 2.03], rtol=1e-13)
