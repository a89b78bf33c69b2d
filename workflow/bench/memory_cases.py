# SPDX-License-Identifier: LGPL-3.0-or-later
"""Timed cells of laws with a memory: against elastic cells, and the same law by stock DOLFINx.

Strain goes to and fro between two homogeneous states with a small wave on them, a little beyond
yield, so that all cells flow at each call by about as much as in a step of an explicit run; or well
below, so that none does. Everything is called in turn as in :mod:`workflow.bench.speed_cases`.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import ufl
from dolfinx import fem

from forms.cells import one_point
from forms.dilatation import dilatation
from forms.elasticity import full
from forms.elements import ELEMENTS, HENCKY, LAWS, internal_work
from forms.kernel import CellKernel
from forms.material_points import Points
from forms.plasticity import J2, BackStress, ElastoPlastic
from meshes.arrays import Array
from meshes.domain import Domain
from workflow.bench.speed_cases import STEEL, Call, rounds

CONSTANTS: dict[str, Any] = {"E": STEEL.E, "nu": STEEL.nu, "rho": STEEL.rho, "yield_stress": 300e6}
BACKS = (BackStress(60e9, 400.0), BackStress(8e9, 30.0))
# Little hardening, so that cells flow at every call: a thousand of them add 1 MPa.
MATERIALS = {
    "J2, isotropic": ElastoPlastic(**CONSTANTS, hardening_modulus=50e6),
    "J2, two back stresses": ElastoPlastic(**CONSTANTS, back_stresses=BACKS),
}
Read = Callable[[], tuple[Array, Array]]  # force and history by cell
STRAINS = {"small strain": False, "large strain": True}
ELASTIC, FLOWING, RESTING, STOCK = "elastic", "flowing", "resting", "stock"
BEYOND, BELOW = 1.01, 0.7  # strain of the two states over that of first yield
GRADIENT = np.array([[1.0, 0.8, -0.3], [0.4, -0.7, 0.6], [0.2, 0.7, -0.3]])
WAVE = 1e-3  # of the strain


def memory(domain: Domain, bandwidth: float, count: int) -> list[dict[str, Any]]:
    """Return a row for each law, element and strain.

    Args:
        domain: Mesh.
        bandwidth: Of one core, which bounds the rate where history is all that is moved [B/s].
        count: Number of rounds.
    """
    return [
        {"law": law, "element": element, "strain": strain}
        | measured(Case(domain, material, element, rotating), bandwidth, count)
        for law, material in MATERIALS.items()
        for strain, rotating in STRAINS.items()
        for element in ELEMENTS
    ]


class Case:
    """Kernels of one law on a mesh.

    Attributes:
        bytes: History of a cell [byte].
    """

    def __init__(
        self, domain: Domain, material: ElastoPlastic, element: str, rotating: bool
    ) -> None:
        self.domain, self.material, self.element = domain, material, element
        self.rotating, self.dx = rotating, full(domain.msh)
        self.size = 3 * (
            domain.V.dofmap.index_map.size_local + domain.V.dofmap.index_map.num_ghosts
        )
        self.bytes = 0

    def elastic(self) -> Call:
        """Return the force of the elastic law of the same element and strain."""
        law = HENCKY if self.rotating else LAWS["small-strain"]
        u, w = self.strained(BELOW), ufl.TestFunction(self.domain.V)
        form = internal_work(self.element, law, u, w, self.material, self.dx)
        return partial(CellKernel(form).add, np.zeros(self.size))

    def native(self, share: float) -> tuple[Call, Read]:
        """Return what takes history to two states in turn, and what reads force and history."""
        points, force = self.points(), np.zeros(self.size)
        states = [self.strained(share), self.strained(-share)]
        kernels = [points.force(u) for u in states]
        pressures = [self.pressure(u, CellKernel) for u in states]
        self.bytes = 8 * points.size * points.history.points

        def both() -> None:
            for kernel, pressure in zip(kernels, pressures, strict=True):
                force[:] = 0.0
                kernel.add(force, renew=True)
                if pressure is not None:
                    pressure.add(force)

        return both, lambda: (force, points.history.values()[np.argsort(points.history.cells)])

    def stock(self) -> tuple[Call, Read]:
        """Return the same by ``assemble_vector`` and ``Expression``."""
        points, V = self.points(), self.domain.V
        given = points.history.coefficient
        Q = fem.functionspace(self.domain.msh, given.ufl_element())
        old, new, u = fem.Function(Q), fem.Function(Q), fem.Function(V)
        work, numbers = points.work(u, ufl.TestFunction(V))
        forms = [fem.form(ufl.replace(-work * points.dx, {given: old}))]
        if self.element == "selective":
            forms.append(self.pressure(u, fem.form))
        law = ufl.replace(ufl.as_vector(numbers), {given: old})
        renewed = fem.Expression(law, Q.element.interpolation_points)
        states = [self.strained(share).x.array for share in (BEYOND, -BEYOND)]
        force = np.zeros(self.size)

        def both() -> None:
            for state in states:
                u.x.array[:], force[:] = state, 0.0
                for form in forms:
                    fem.assemble_vector(force, form)
                new.interpolate(renewed)
                old.x.array[:] = new.x.array

        return both, lambda: (force, old.x.array.reshape(-1, Q.dofmap.bs)[Q.dofmap.list])

    def points(self) -> Points:
        """Return the law at the points of the cells."""
        return Points(
            J2,
            self.material,
            self.domain.V,
            self.dx,
            rotating=self.rotating,
            element=self.element,
        )

    def pressure(self, u: Any, compiled: Callable[[Any], Any]) -> Any:
        """Return what a selective cell adds for its volume, None for the others."""
        if self.element != "selective":
            return None
        w = ufl.TestFunction(self.domain.V)
        work = dilatation(u, w, self.material, rotating=self.rotating)
        return compiled(-work * one_point(self.dx))

    def strained(self, share: float) -> Any:
        """Return a displacement whose strain is a share of that at first yield."""
        strain = (GRADIENT + GRADIENT.T) / 2
        equivalent = np.sqrt(2 / 3 * np.sum(strain**2))
        scale = share * self.material.yield_stress / (3 * self.material.mu) / equivalent
        k, u = 300.0 * GRADIENT, fem.Function(self.domain.V)
        u.interpolate(lambda x: scale * (GRADIENT @ x + WAVE / 300.0 * np.sin(k @ x + 0.3)))
        return u


def measured(case: Case, bandwidth: float, count: int) -> dict[str, float]:
    """Return rates and ratios of a case, and how force and history agree with stock's."""
    elastic, (flowing, own), (stock, given) = case.elastic(), case.native(BEYOND), case.stock()
    resting, _ = case.native(BELOW)
    flowing()
    stock()
    pairs = zip(own(), given(), strict=True)
    differences = [float(np.abs(a - b).max() / np.abs(b).max()) for a, b in pairs]
    times = rounds({ELASTIC: elastic, FLOWING: flowing, RESTING: resting}, count)
    slow = rounds({FLOWING: flowing, STOCK: stock}, max(count // 2, 1), inner=1)
    cells = len(case.domain.source.cells)
    moved = 2 * case.bytes + 24 + 24 + 48 + 32  # history read and written; nodes; dofs of a cell
    return {
        "rate": 2 * cells / float(np.median(times[FLOWING])),
        "elastic_rate": cells / float(np.median(times[ELASTIC])),
        "ratio": float(np.median(2 * times[ELASTIC] / times[FLOWING])),
        "ratio_resting": float(np.median(2 * times[ELASTIC] / times[RESTING])),
        "ratio_stock": float(np.median(slow[STOCK] / slow[FLOWING])),
        "difference": max(differences),
        "bytes": case.bytes,
        "bandwidth_rate": bandwidth / moved,
    }
