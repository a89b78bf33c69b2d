# SPDX-License-Identifier: LGPL-3.0-or-later
"""How do I step a material of my own, written as a UFL residual?

A rubber block is pulled at one end by a dead traction as large as its shear modulus μ and damped
until it rests. Its energy per volume is neo-Hookean, ψ = μ/2 (tr FᵀF − 3 − 2 ln det F), so the
nominal stress along it is μ (Λ − 1/Λ). At Λ − 1/Λ = 1 it has stretched by the golden ratio.

    python examples/own_residual.py
"""

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem, la

from forms.elasticity import full
from forms.kernel import CellKernel
from forms.loads import nodal_traction
from forms.mass import lumped_mass
from meshes import Tag, block, distribute
from workflow.simulation.stepping import State, central_difference

MU, RHO = 1e6, 1000.0  # shear modulus [Pa], density [kg/m³]
LENGTH, SIZE = 0.1, 0.01  # [m]
GOLDEN = (1 + np.sqrt(5)) / 2


def residual(u, w):
    """Virtual work of the first Piola–Kirchhoff stress ∂ψ/∂F: the five lines to replace."""
    F = ufl.variable(ufl.Identity(3) + ufl.grad(u))
    energy = MU / 2 * (ufl.tr(F.T * F) - 3 - 2 * ufl.ln(ufl.det(F)))
    return ufl.inner(ufl.diff(energy, F), ufl.grad(w))


def stretch(end: float = 0.15) -> float:
    """Pull for ``end`` seconds and return the stretch Λ of the block."""
    domain = distribute(block((0, 0, 0), (LENGTH, 0.02, 0.02), size=SIZE), MPI.COMM_SELF)
    V, dx = domain.V, full(domain.msh, domain.regions)
    state = State(fem.Function(V), fem.Function(V), la.vector(V.dofmap.index_map, 3))
    mass = la.vector(V.dofmap.index_map, 3)
    mass.array[:] = lumped_mass(V, dx, {(Tag.BLOCK,): RHO})

    kernel = CellKernel(-residual(state.u, ufl.TestFunction(V)) * dx)
    mesh = domain.source
    pull = nodal_traction(mesh.points, mesh.surface(Tag.XMAX), np.array([MU, 0, 0]))
    pull = pull[domain.nodes].ravel()
    damping = np.pi / 2 * np.sqrt(2 * MU / RHO) / LENGTH  # about critical in the first mode

    def rubber(state, force):
        kernel.add(force)

    def load(state, force):
        force.array[:] += pull - damping * mass.array * state.v.x.array

    x = V.tabulate_dof_coordinates()
    ends = np.isclose(x, 0)  # three planes of symmetry

    def hold(a):
        a.array.reshape(-1, 3)[ends] = 0.0

    dt = 0.4 * SIZE / np.sqrt(2 * MU / RHO)  # wave speed at rest; stretching slows the waves
    for _ in central_difference(state, mass.petsc_vec, [rubber, load], hold, dt, end):
        pass
    return 1 + float(state.u.x.array[::3][np.isclose(x[:, 0], LENGTH)].mean()) / LENGTH


if __name__ == "__main__":
    found = stretch()
    print(f"stretch {found:.9f}, golden ratio {GOLDEN:.9f}, error {found / GOLDEN - 1:+.1e}")
