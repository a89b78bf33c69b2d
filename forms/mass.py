# SPDX-License-Identifier: LGPL-3.0-or-later
"""Lumped mass."""

from collections.abc import Mapping
from typing import Any

from mpi4py import MPI  # noqa: F401  (before dolfinx, which is linked with its library)

import dolfinx
import numpy as np
import ufl

from forms.kernel import CellKernel
from meshes.arrays import Array


def inertia(w: Any, dx: Any, densities: Mapping[tuple[int, ...], Any]) -> Any:
    """Return the form ``∫ ρ (1, 1, 1) · w``, whose vector is the lumped mass.

    Args:
        w: Test function.
        dx: Volume measure with the region tags.
        densities: Density of each group of regions, a number or UFL [kg/m³].
    """
    ones = ufl.as_vector([1.0, 1.0, 1.0])
    exact = dx(metadata={"quadrature_degree": 3})
    return sum(rho * ufl.inner(ones, w) * exact(region) for region, rho in densities.items())


def lumped_mass(V: Any, dx: Any, densities: Mapping[tuple[int, ...], Any]) -> Array:
    """Return the row-sum lumped mass of every local scalar dof, ghosts included [kg].

    Row sums of the consistent mass, ``∫ ρ N_i``, with the quadrature that is exact on any trilinear
    hexahedron: all entries are positive and their sum is the mass.

    Args:
        V: Vector P1 space.
        dx: Volume measure with the region tags.
        densities: Density of each group of regions, a number or UFL [kg/m³].

    Returns:
        Mass, shape ``(3 * n_local,)`` [kg].

    Raises:
        ValueError: if the space is not P1 on hexahedra (row sums of higher orders go negative).
    """
    if V.mesh.basix_cell().name != "hexahedron" or V.element.basix_element.degree != 1:
        raise ValueError("lumped mass: expected a P1 space on hexahedra")
    mass = dolfinx.la.vector(V.dofmap.index_map, V.dofmap.bs)
    mass.array[:] = 0.0
    CellKernel(inertia(ufl.TestFunction(V), dx, densities)).add(mass)
    mass.scatter_reverse(dolfinx.la.InsertMode.add)
    mass.scatter_forward()
    if not np.all(mass.array > 0):
        raise ValueError("lumped mass: a node has no positive mass; is every region in a body?")
    return mass.array.copy()
