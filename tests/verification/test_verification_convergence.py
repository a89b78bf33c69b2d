# SPDX-License-Identifier: LGPL-3.0-or-later
"""Verification row 4: a manufactured solution on curved grids, second order in every element."""

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem
from scipy.sparse.linalg import spsolve
from ufl import as_vector, cos, div, grad, inner, sin, sym

from forms.elasticity import Elastic, full
from forms.elements import LAWS, internal_work
from forms.materials import Orthotropic
from meshes.domain import distribute
from meshes.shapes import blocks

STEEL = Elastic(1.0, 0.3, 1.0)
WOOD = Orthotropic((11.0, 0.9, 0.5), (0.4, 0.45, 0.5), (0.7, 0.65, 0.05), 1.0)
RUBBER = Elastic(1.0, 0.4999, 1.0)
CASES = [
    ("full", None, STEEL),
    ("one-point", None, STEEL),
    ("one-point", 0.1, STEEL),
    ("selective", None, STEEL),
    ("selective", None, RUBBER),
    ("one-point", None, RUBBER),
    ("full", None, WOOD),
    ("one-point", None, WOOD),
]


def solution(x, material):
    """Displacement of the closed form; free of volume change where the material is."""
    a, b, c = 1.3, 1.7, 2.1
    if material is RUBBER:
        return as_vector([sin(a * x[1]) * cos(x[2]), cos(b * x[2]) * sin(x[0]), sin(c * x[0])])
    return as_vector(
        [sin(a * x[0]) * cos(b * x[1] + x[2]), sin(b * x[1] * x[2]), cos(c * x[2]) * x[0] * x[1]]
    )


def error(case, n: int) -> float:
    """Error of the displacement over its size, both as integrals over a cube of n³ cells.

    Its grid is bent by a sixteenth, and the surface moves by the solution.
    """
    element, coefficient, material = case
    box = blocks.block((0, 0, 0), (1, 1, 1), cells=(n, n, n))
    x, y, z = box.points.T
    bend = [np.sin(np.pi * b) * np.sin(2 * np.pi * c) for b, c in ((y, z), (z, x), (x, y))]
    domain = distribute(box.moved(box.points + np.column_stack(bend) / 16), MPI.COMM_SELF)
    V, X = domain.V, ufl.SpatialCoordinate(domain.msh)
    dx, exact = full(domain.msh), solution(X, material)
    u, w = fem.Function(V), ufl.TestFunction(V)
    work = internal_work(element, LAWS["small-strain"], u, w, material, dx, coefficient=coefficient)
    tangent = ufl.derivative(work, u, ufl.TrialFunction(V))
    K = fem.assemble_matrix(fem.form(tangent)).to_scipy().tocsr()
    body_force = -div(material.stress(sym(grad(exact))))
    points = V.element.interpolation_points
    u.interpolate(fem.Expression(exact, points))
    f = fem.assemble_vector(fem.form(inner(body_force, w) * dx(metadata={"quadrature_degree": 4})))
    corners = np.rint(box.points * n)[domain.nodes]
    held = np.repeat(((corners == 0) | (corners == n)).any(axis=1), 3)
    free = np.flatnonzero(~held)
    start = np.where(held, u.x.array, 0.0)
    rest = (f.array - K @ start)[free]
    u.x.array[free] = spsolve(K[free][:, free].tocsc(), rest)
    fine = dx(metadata={"quadrature_degree": 6})
    squares = [fem.assemble_scalar(fem.form(inner(a, a) * fine)) for a in (u - exact, exact)]
    return float(np.sqrt(squares[0] / squares[1]))


@pytest.mark.parametrize("case", CASES)
def test_row_4_manufactured_solution_is_second_order(case):
    """4, 8, 12 cells to a side: slope 2 ± 0.1 between the last two, error 0.4 % there."""
    errors = [error(case, n) for n in (4, 8, 12)]
    slope = np.log(errors[1] / errors[2]) / np.log(12 / 8)
    assert slope == pytest.approx(2, abs=0.1)
    assert errors[2] < 0.004


def test_full_quadrature_locks_as_the_volume_is_kept():
    """ν = 0.4999: the order falls to 1.2 between 8 and 12 cells, the error is 1.5 times theirs."""
    errors = [error(("full", None, RUBBER), n) for n in (8, 12)]
    assert np.log(errors[0] / errors[1]) / np.log(12 / 8) < 1.5
    assert errors[1] > 1.4 * error(("selective", None, RUBBER), 12)
