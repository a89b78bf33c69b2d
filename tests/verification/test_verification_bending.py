# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cantilevers of one to four layers in every element, against closed forms and Timoshenko's beam.

A beam of 10 × 1 × 1 under a load at its end; its energy is the work of the load.
"""

from functools import cache

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem
from scipy.sparse.linalg import spsolve

from forms.elasticity import Elastic, full
from forms.elements import LAWS, internal_work
from meshes.domain import distribute
from meshes.shapes import blocks

ELEMENTS = [("full", None), ("selective", None), ("one-point", None), ("one-point", 0.1)]
FULL, SELECTIVE, POINT, SOFTER = ELEMENTS


@cache
def tip(element, layers: int, cells: int, nu: float = 0.3, slope: float = 0.0) -> float:
    """Tip deflection over that of Timoshenko's beam with a shear coefficient of 5/6, less one.

    ``slope`` turns the cross-sections inside by up to that angle, so that cells are trapezia.
    """
    material = Elastic(1.0, nu, 1.0)
    box = blocks.block((0, 0, 0), (10, 1, 1), cells=(cells, layers, layers))
    i = np.rint(box.points[:, 0] * cells / 10)
    turned = np.where((i > 0) & (i < cells), slope * (-1) ** i * (box.points[:, 2] - 0.5), 0.0)
    domain = distribute(box.moved(box.points + np.outer(turned, [1, 0, 0])), MPI.COMM_SELF)
    x, dx = domain.V.tabulate_dof_coordinates(), full(domain.msh)
    u, w = fem.Function(domain.V), ufl.TestFunction(domain.V)
    law = LAWS["small-strain"]
    form = internal_work(element[0], law, u, w, material, dx, coefficient=element[1])
    tangent = ufl.derivative(form, u, ufl.TrialFunction(domain.V))
    K = fem.assemble_matrix(fem.form(tangent)).to_scipy().tocsr()
    share = np.prod(np.where(np.isclose(np.abs(x[:, 1:] - 0.5), 0.5), 0.5, 1.0), axis=1)
    load = np.zeros_like(x)
    load[:, 2] = np.where(np.isclose(x[:, 0], 10), share / layers**2, 0.0)
    held = np.zeros(x.shape, dtype=bool)
    root = np.isclose(x[:, 0], 0)
    held[root, 0] = True
    held[root & np.isclose(x[:, 1], 0), 1] = True
    held[root & np.isclose(x[:, 2], 0), 2] = True
    free = np.flatnonzero(~held.ravel())
    solution = np.zeros(x.size)
    solution[free] = spsolve(K[free][:, free].tocsc(), load.ravel()[free])
    return float(solution @ load.ravel() / (bending() + 10 / (5 / 6 * material.mu)) - 1)


def bending() -> float:
    """Deflection of the slender beam, F L³ / 3 E I."""
    return 10**3 / 3 * 12


def one_layer(element, a: float) -> float:
    """Bending stiffness of one layer of cells of length ``a``, ν = 0, over that of the beam.

    Energies of ``u_x = κ x z`` in a cell, over E κ² V / 24, with E = 2 μ and section 1 × 1. Full
    quadrature adds the parasitic shear κ x. Of that of selective cells, the mean volume change is
    zero, and the sections shrink across, ``u_y = -2/7 κ y z``, to the least energy that is left.
    Mean strains are zero at one point: the control alone acts, physical as the beam, or
    κ_FB/2 · (κ a)² / 2 with κ_FB of Flanagan and Belytschko.
    """
    if element == FULL:
        return 1 + a**2 / 2
    if element == SELECTIVE:
        return 4 / 7 + a**2 / 2
    if element == POINT:
        return 1.0
    control = 0.1 * (1 + 2 * a**2) / 2 / (3 * a)
    return 6 * control * a


@pytest.mark.parametrize("element", ELEMENTS)
@pytest.mark.parametrize("cells", [10, 20, 40])
def test_one_layer_bends_by_its_closed_form(element, cells):
    """ν = 0: deflection by the cell's own bending stiffness and shear G A, within 0.7 %.

    Full quadrature is 33 % too stiff with cubes, selective 7 %, physical control 0.3 %; coefficient
    0.1 is 3.3 times as soft. What is left comes from the end, where sections cannot warp.
    """
    shear = 10 / 0.5
    expected = bending() / one_layer(element, 10 / cells) + shear
    found = (1 + tip(element, 1, cells, 0.0)) * (bending() + 10 / (5 / 6 * 0.5))
    assert found == pytest.approx(expected, rel=7e-3)


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.4999])
@pytest.mark.parametrize(("layers", "cells"), [(1, 10), (1, 20), (2, 20), (4, 40)])
def test_physical_control_bends_right_from_one_layer_on(layers, cells, nu):
    """Within 1.2 % of Timoshenko's beam, nearly incompressible or not."""
    assert abs(tip(POINT, layers, cells, nu)) <= 0.012


@pytest.mark.parametrize("element", [FULL, SELECTIVE, SOFTER])
def test_all_elements_converge_to_the_beam(element):
    """1, 2, 4 layers of cubes, ν = 0.3: the error falls by more than two each time, below 4 %."""
    errors = [abs(tip(element, n, 10 * n)) for n in (1, 2, 4)]
    assert errors[1] < errors[0] / 2 and errors[2] < errors[1] / 2
    assert errors[2] < 0.04


def test_full_quadrature_locks_where_cells_are_long_or_skew():
    """Too stiff by a third with cubes, and by 15 % with sections turned by ±0.25, two layers."""
    assert tip(FULL, 1, 10) < -0.3
    assert tip(FULL, 2, 20, slope=0.25) < -0.14
    assert abs(tip(SELECTIVE, 2, 20, slope=0.25)) < 0.07
    assert abs(tip(POINT, 2, 20, slope=0.25)) < 0.05


def test_nearly_incompressible_cantilever():
    """ν = 0.4999: full quadrature locks even with four layers, selective and physical do not.

    So does control by a coefficient: it is a fraction of λ + 2 μ, which goes to infinity.
    """
    assert tip(FULL, 4, 40, 0.4999) < -0.3
    assert tip(SOFTER, 4, 40, 0.4999) < -0.9
    assert abs(tip(SELECTIVE, 2, 20, 0.4999)) < 0.04
    assert abs(tip(SELECTIVE, 4, 40, 0.4999)) < 0.02
    assert abs(tip(POINT, 1, 10, 0.4999)) < 0.012
