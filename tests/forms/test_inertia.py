# SPDX-License-Identifier: LGPL-3.0-or-later
"""Lumped mass: the sum is the mass, at the right place, and never negative."""

from mpi4py import MPI

import dolfinx
import numpy as np
import pytest
from dolfinx import fem

from forms.elasticity import full
from forms.mass import lumped_mass
from meshes.domain import Domain, distribute
from meshes.hexmesh import join
from meshes.shapes import blocks
from meshes.tags import Tag

DENSITIES: dict[tuple[int, ...], float] = {(int(Tag.BLOCK),): 7800.0, (int(Tag.BASE),): 2400.0}


@pytest.fixture(scope="module")
def two() -> Domain:
    """A distorted block of 6 m³ at the origin and one of 1 m³ beside it."""
    first = blocks.block((0, 0, 0), (1, 2, 3), cells=(3, 4, 4))
    second = blocks.block((2, 0, 0), (3, 1, 1), cells=(2, 3, 3), region=Tag.BASE)
    distorted = [blocks.distorted(m, amplitude=0.3, seed=8) for m in (first, second)]
    return distribute(join(*distorted), MPI.COMM_SELF)


def mass_of(domain: Domain) -> np.ndarray:
    dx = full(domain.msh, domain.regions)
    return lumped_mass(domain.V, dx, DENSITIES).reshape(-1, 3)


def test_mass_is_positive_and_sums_to_density_times_volume(two):
    """7800 · 6 + 2400 · 1 kg in each direction, the same for the three dofs of a node."""
    mass = mass_of(two)
    assert mass.min() > 0
    np.testing.assert_allclose(mass.sum(axis=0), 7800 * 6 + 2400, rtol=1e-13)
    np.testing.assert_allclose(mass, mass[:, :1] * np.ones(3), rtol=1e-14)


def test_centre_of_mass_is_exact_on_distorted_cells(two):
    """Row sums keep ∫ ρ x: (46800 (0.5, 1, 1.5) + 2400 (2.5, 0.5, 0.5)) / 49200."""
    mass, x = mass_of(two)[:, 0], two.V.tabulate_dof_coordinates()
    expected = (46800 * np.array([0.5, 1, 1.5]) + 2400 * np.array([2.5, 0.5, 0.5])) / 49200
    np.testing.assert_allclose(mass @ x / mass.sum(), expected, rtol=1e-13)


def test_a_corner_carries_an_eighth_of_its_cell():
    """One cube of 0.1 m: ρ h³ / 8 on each node."""
    cube = distribute(blocks.block((0, 0, 0), (0.1,) * 3, cells=(1, 1, 1)), MPI.COMM_SELF)
    mass = lumped_mass(cube.V, full(cube.msh, cube.regions), {(int(Tag.BLOCK),): 7800.0})
    np.testing.assert_allclose(mass, np.full(24, 7800 * 1e-3 / 8), rtol=1e-13)


@pytest.mark.parametrize(
    ("cell", "degree"),
    [(dolfinx.mesh.CellType.hexahedron, 2), (dolfinx.mesh.CellType.tetrahedron, 1)],
)
def test_other_elements_are_refused(cell, degree):
    """Row sums of quadratic cells go negative; tetrahedra are not supported."""
    msh = dolfinx.mesh.create_unit_cube(MPI.COMM_SELF, 1, 1, 1, cell)
    V = fem.functionspace(msh, ("Lagrange", degree, (3,)))
    with pytest.raises(ValueError, match="expected a P1 space on hexahedra"):
        lumped_mass(V, full(msh), {(1,): 7800.0})


def test_a_region_without_density_is_refused(two):
    """The nodes of the base have no mass when only the block is listed."""
    dx = full(two.msh, two.regions)
    with pytest.raises(ValueError, match="no positive mass; is every region in a body"):
        lumped_mass(two.V, dx, {(int(Tag.BLOCK),): 7800.0})
