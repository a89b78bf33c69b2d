# SPDX-License-Identifier: LGPL-3.0-or-later
"""How do I write a material of my own, and on which element does it run?

A rubber rod obeys Mooney's law (1940), ψ = c₁ (Ī₁ − 3) + c₂ (Ī₂ − 3) + κ/2 (J − 1)², and is pulled
to twice its length. Its volume hardly changes (κ ≫ c₁), so the true stress is close to
2 (Λ² − 1/Λ) (c₁ + c₂/Λ). The elements have one point and hourglass control: they do not lock.

    python examples/own_material.py
"""

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem, la

from forms.cells import one_point
from forms.elasticity import Elastic, full
from forms.hourglass import one_point_residual
from forms.kernel import CellKernel
from forms.mass import lumped_mass
from meshes import Tag, block, distribute
from workflow.simulation.stepping import State, central_difference

C1, C2, BULK, RHO = 0.4e6, 0.1e6, 1e9, 1000.0  # [Pa], [kg/m³]
LENGTH, SIZE, STRETCH = 0.1, 0.01, 2.0  # [m], [m], [-]
SOFT = Elastic(E=6 * (C1 + C2), nu=0.49, rho=RHO)  # at small strain, for the hourglass control


def mooney(u, w, material, v=None):
    """Virtual work of Mooney's energy: the five lines to replace."""
    F = ufl.variable(ufl.Identity(3) + ufl.grad(u))
    C, J = F.T * F, ufl.det(F)
    I1, I2 = ufl.tr(C), (ufl.tr(C) ** 2 - ufl.tr(C * C)) / 2
    energy = C1 * J ** (-2 / 3) * I1 + C2 * J ** (-4 / 3) * I2 + BULK / 2 * (J - 1) ** 2
    return ufl.inner(ufl.diff(energy, F), ufl.grad(w))


def true_stress(end: float = 0.1) -> float:
    """Pull for ``end`` seconds and return force over section at the end [Pa]."""
    domain = distribute(block((0, 0, 0), (LENGTH, 0.02, 0.02), size=SIZE), MPI.COMM_SELF)
    V, dx = domain.V, full(domain.msh, domain.regions)
    state = State(fem.Function(V), fem.Function(V), la.vector(V.dofmap.index_map, 3))
    mass = la.vector(V.dofmap.index_map, 3)
    mass.array[:] = lumped_mass(V, dx, {(Tag.BLOCK,): RHO})
    rubber = one_point_residual(mooney, moduli=SOFT)(state.u, ufl.TestFunction(V), None)
    kernel = CellKernel(-rubber * one_point(dx))
    damping = np.pi * np.sqrt(SOFT.E / RHO) / LENGTH  # critical in the first mode

    x = V.tabulate_dof_coordinates()
    fixed, pulled = np.isclose(x, 0), np.isclose(x[:, 0], LENGTH)

    def rod(state, force):
        kernel.add(force)
        force.array[:] -= damping * mass.array * state.v.x.array

    def hold(a):
        """Symmetry planes stay; the end follows a smooth path and rests from 0.6 of the time."""
        s = np.clip((state.t + dt) / (0.6 * end), 0, 1)
        path = LENGTH * (STRETCH - 1) * s**3 * (10 - 15 * s + 6 * s**2)
        rate = (path - state.u.x.array[::3]) / dt
        a.array[::3][pulled] = ((rate - state.v.x.array[::3]) / dt)[pulled]
        a.array.reshape(-1, 3)[fixed] = 0.0

    dt = 0.3 * SIZE / np.sqrt(BULK / RHO)
    for _ in central_difference(state, mass.petsc_vec, [rod], hold, dt, end):
        pass
    force = np.zeros_like(state.u.x.array)
    kernel.add(force)
    sides = [1 + state.u.x.array[a::3][np.isclose(x[:, a], 0.02)].mean() / 0.02 for a in (1, 2)]
    return float(-force[::3][pulled].sum() / (0.02**2 * sides[0] * sides[1]))


if __name__ == "__main__":
    found = true_stress()
    exact = 2 * (STRETCH**2 - 1 / STRETCH) * (C1 + C2 / STRETCH)
    print(f"stress {found:.0f} Pa, closed form {exact:.0f} Pa, error {found / exact - 1:+.1e}")
