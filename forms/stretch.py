# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Smallest stretch of cells since a shape that they had, by which the stable step shrinks.

A motion of wave vector k in one shape of a mesh has ``F⁻ᵀ k`` in another, at most longer by the
inverse of the smallest principal stretch of the deformation F between them. The mass of a node
stays, and so do the moduli of a law in logarithmic elastic strain: no frequency grows by more, so
the stable step falls by no more than that stretch.
"""

from collections.abc import Iterable
from typing import Any

import numpy as np
import ufl
from dolfinx import fem
from ufl import Identity, as_matrix, cofac, conditional, det, dot, gt, inner

from forms.cells import mean_gradient, one_point, per_point
from forms.kernel import CellKernel
from meshes.arrays import Array, Index

FEW = 4  # cells that are looked at closely: those that are deformed most
GONE = 1e200  # the measure of a cell that is turned inside out


class Stretch:
    """The deformation of cells since a shape, in one number each and closely where it is largest.

    Attributes:
        since: Displacement of the shape that stretches are counted from, a function of the space.
        measure: Of each cell of this rank, ``tr C⁻⁴`` of its mean deformation: it tells which
            cells are deformed most, and changes only when their shape does.
    """

    def __init__(self, u: Any, measures: Iterable[Any]) -> None:
        """Compile the measure.

        Args:
            u: Displacement, a DOLFINx function of the vector P1 space.
            measures: Volume measures of the cells that count, each cell in one.
        """
        V = u.function_space
        self.u, self.since, self.mesh, self.dofs = u, fem.Function(V), V.mesh, V.dofmap.list
        Q = fem.functionspace(V.mesh, ("DG", 0))
        self.measure = np.zeros(Q.dofmap.index_map.size_local + Q.dofmap.index_map.num_ghosts)
        then, now = (Identity(3) + mean_gradient(field) for field in (self.since, u))
        density = measure_of(then, now) * per_point(V.mesh.ufl_domain()) * ufl.TestFunction(Q)
        self._kernel = CellKernel(sum(density * one_point(dx) for dx in measures))

    def begin(self) -> None:
        """Count from the present shape on."""
        self.since.x.array[:] = self.u.x.array

    def look(self) -> float:
        """Measure all cells of this rank; return the largest."""
        self.measure[:] = 0.0
        self._kernel.add(self.measure)
        return float(self.measure.max(initial=0.0))

    def smallest(self) -> tuple[float, int]:
        """Return the smallest stretch at the Gauss points of this rank's cells, and its cell.

        Below 0 in a cell that is turned inside out at a point; 1 and -1 without cells. Of the
        cells that were deformed most when they were measured.
        """
        few = min(FEW, len(self.measure))
        cells = np.argpartition(self.measure, -few)[len(self.measure) - few :]
        cells = np.sort(cells[self.measure[cells] > 0])
        if not len(cells):
            return 1.0, -1
        stretch = smallest_stretch(self.corners(self.since, cells), self.corners(self.u, cells))
        worst = int(np.argmin(stretch))
        return float(stretch[worst]), int(cells[worst])

    def corners(self, u: Any, cells: Index) -> Array:
        """Return where a displacement takes the corners of cells, shape ``(n, 8, 3)`` [m]."""
        geometry = self.mesh.geometry
        X = geometry.x[geometry.dofmaps[0][cells]]
        return np.asarray(X + u.x.array.reshape(-1, 3)[self.dofs[cells]])


def measure_of(then: Any, now: Any) -> Any:
    """Return ``tr C⁻⁴`` of the deformation between two deformation gradients in UFL.

    It is :data:`GONE` where the cell is turned inside out now.
    """
    J = det(now)
    A = dot(then, as_matrix(cofac(now).T))  # J F⁻¹ of the deformation in between
    C = dot(A.T, A)
    CC = dot(C, C)
    return conditional(gt(J, 0), inner(CC, CC) / J**8, GONE)


def smallest_stretch(then: Array, now: Array) -> Array:
    """Return the smallest principal stretch at the Gauss points of each cell, ``(n,)`` [-].

    Minus one where a cell is turned inside out at any of them.

    Args:
        then: Corners in the order of DOLFINx before the deformation, shape ``(n, 8, 3)`` [m].
        now: The same after it.
    """
    F = deformations(then, now)
    least = np.sqrt(np.linalg.eigvalsh(F.swapaxes(2, 3) @ F)[:, :, 0]).min(axis=1)
    inside_out = (np.linalg.det(F) <= 0).any(axis=1)
    return np.where(inside_out, -1.0, least)


def deformations(then: Array, now: Array) -> Array:
    """Return the deformation gradients at the Gauss points of cells, shape ``(n, 8, 3, 3)``.

    Arguments as for :func:`smallest_stretch`.
    """
    before = np.einsum("nci,gca->ngia", then, SLOPES)
    after = np.einsum("nci,gca->ngia", now, SLOPES)
    return np.asarray(after @ np.linalg.inv(before))


def slopes(points: Array) -> Array:
    """Return the derivatives of the corner functions at points of the unit cube, (g, 8, 3)."""
    corner = np.array([[k & 1, k >> 1 & 1, k >> 2 & 1] for k in range(8)])
    factor = np.where(corner, points[:, None], 1 - points[:, None])
    slope = np.where(corner, 1.0, -1.0)
    columns = [slope[:, a] * np.delete(factor, a, axis=2).prod(axis=2) for a in range(3)]
    return np.stack(columns, axis=2)


GAUSS = np.array(list(np.ndindex(2, 2, 2))) / 3**0.5 + (1 - 3**-0.5) / 2
SLOPES = slopes(GAUSS)
