# SPDX-License-Identifier: LGPL-3.0-or-later
"""Internal force of bodies whose material has a memory, as items of a model."""

from collections.abc import Mapping
from typing import Any

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem, la

from forms.cells import one_point
from forms.dilatation import dilatation, dilatation_energy
from forms.kernel import CellIntegral, CellKernel
from forms.material_points import Points
from forms.materials import VOIGT
from forms.memory import EQUIVALENT, FLOW, PLASTIC
from forms.plasticity import MEMORY_LAWS
from meshes.arrays import Array
from workflow.model.bodies import Bodies
from workflow.model.state import State

TOLERANCE = 1e-6  # of the law's own scale: what its local iterations may leave


class LawError(RuntimeError):
    """A material law did not find a state that it admits."""


class MemoryForce:
    """Minus the internal force of one body, with the history of its material.

    Every call of :meth:`add` takes the history on to the displacement of the state.

    Args:
        bodies: The bodies of the model.
        name: That of the body.
        u: Displacement.
        precision: Type that is computed with.
    """

    phase = "internal_force"
    cell_fields: tuple[str, ...]

    def __init__(self, bodies: Bodies, name: str, u: Any, precision: str) -> None:
        body, material = bodies.scene.bodies[name], bodies.materials[name]
        domain, dx = bodies.domain, bodies.dx(bodies.tags(body))
        self.name, self.domain, self.comm = name, domain, domain.msh.comm
        self._u = u
        rotating = body.kinematics == "total-lagrangian"
        split = body.element == "selective"
        given = bodies.memory_laws[name]
        law = MEMORY_LAWS[given] if isinstance(given, str) else given
        self.points = Points(
            law,
            material,
            domain.V,
            dx,
            rotating=rotating,
            element=body.element,
            coefficient=body.hourglass_coefficient,
            dtype=precision,
        )
        self.kernel = self.points.force(u)
        self.cell_fields = (EQUIVALENT,) if EQUIVALENT in self.points.variables else ()
        self._cells = domain.msh.topology.original_cell_index[self.points.history.cells]
        Q = fem.functionspace(domain.msh, ("DG", 0))
        self._sums = np.zeros(Q.dofmap.index_map.size_local + Q.dofmap.index_map.num_ghosts)
        self._terms = {
            term: self.points.cell_integral(density, Q)
            for term, density in self.points.densities(u).items()
        }
        beyond = self.points.beyond(u)
        self._beyond = None if beyond is None else self.points.cell_integral(beyond, Q)
        self._pressure, self._volume = None, None
        if split:
            form = dilatation(u, ufl.TestFunction(domain.V), material, rotating=rotating)
            self._pressure = CellKernel(-form * one_point(dx), precision)
            stored = dilatation_energy(u, material, rotating=rotating) * one_point(dx)
            self._volume = CellIntegral(stored)

    def add(self, state: State, force: la.Vector) -> None:
        """Add this rank's cells and renew the history."""
        self._add(force, renew=True)

    def rest(self, state: State, force: la.Vector) -> None:
        """Add this rank's cells, the history left as it is."""
        self._add(force, renew=False)

    def _add(self, force: la.Vector, *, renew: bool) -> None:
        self.kernel.add(force.array, renew=renew)
        if self._pressure is not None:
            self._pressure.add(force)

    def energy(self, state: State) -> dict[str, float]:
        """Return the energies by term [J]; collective.

        Raises:
            LawError: on all ranks, if the law has found no state that it admits.
        """
        self.check()
        terms = {term: self.comm.allreduce(self._sum(k)) for term, k in self._terms.items()}
        if self._volume is not None:
            terms["internal"] += self._volume()
        return terms

    def stored(self) -> dict[str, float]:
        """Return the elastic energy and that of hourglass control [J]; collective."""
        names = [name for name in ("internal", "hourglass") if name in self._terms]
        terms: dict[str, float] = {
            name: self.comm.allreduce(self._sum(self._terms[name])) for name in names
        }
        if self._volume is not None:
            terms["internal"] += self._volume()
        return terms

    def check(self) -> None:
        """Raise ``LawError`` on all ranks if a cell is beyond what its law admits; collective."""
        if self._beyond is None:
            return
        self._sum(self._beyond)
        worst = int(np.argmax(self._sums)) if len(self._sums) else 0
        own = float(self._sums[worst]) if len(self._sums) else 0.0
        found, rank = self.comm.allreduce((own, self.comm.rank), op=MPI.MAXLOC)
        if not found > TOLERANCE:
            return
        place = None
        if rank == self.comm.rank:
            nodes = self.domain.msh.geometry.dofmaps[0][worst]
            place = self.domain.msh.geometry.x[nodes].mean(axis=0)
        x, y, z = self.comm.bcast(place, root=rank)
        raise LawError(
            f"bodies.{self.name}.material: the law has no state for the strain of the cell at "
            f"({x:.4g}, {y:.4g}, {z:.4g}) m: {found:.1e} beyond what it admits, expected at most "
            f"{TOLERANCE:.0e}; a smaller time.safety makes the increments smaller"
        )

    def _sum(self, kernel: Any) -> float:
        """Return the sum over this rank's cells, and leave the cells in ``_sums``."""
        self._sums[:] = 0.0
        kernel.add(self._sums)
        return float(self._sums.sum())

    def columns(self) -> dict[str, float]:
        """Return the columns of the history: the largest plastic strain so far; collective [-]."""
        if not self.cell_fields:
            return {}
        own = float(self.points.values()[EQUIVALENT].max(initial=0.0))
        return {f"{self.name}_largest_plastic_strain": self.comm.allreduce(own, op=MPI.MAX)}

    def cell_means(self, name: str) -> Array:
        """Return the mean over the points of a history variable, by cell of the mesh; collective.

        On rank 0; zero in cells of other bodies.
        """
        return self._by_cell(self.points.values()[name].mean(axis=(1, 2)))

    def cell_plastic_strain(self) -> Array:
        """Return the mean plastic strain by cell of the mesh, ordered as ``VOIGT``; collective.

        On rank 0, ``(cells, 6)``; zero in cells of other bodies, and of laws that have none. At
        large strain it is ``-sym(F_p⁻¹ - I)``, whose shear is that of simple shear in any amount.
        """
        values = self.points.values()
        if PLASTIC in values:
            own = values[PLASTIC].mean(axis=1)
        elif FLOW in values:
            G = values[FLOW].mean(axis=1).reshape(-1, 3, 3)
            own = -np.stack([(G[:, i, j] + G[:, j, i]) / 2 for i, j in VOIGT], axis=1)
        else:
            own = np.zeros((len(self._cells), len(VOIGT)))
        return self._by_cell(own)

    def cell_stress(self) -> Array:
        """Return the mean Cauchy stress by cell as :meth:`cell_plastic_strain` [Pa]; collective."""
        Q = fem.functionspace(self.domain.msh, ("DG", 0, (len(VOIGT),)))
        kernel = self.points.cell_integral(self.points.mean_stress(self._u), Q)
        sums = np.zeros(len(VOIGT) * len(self._sums))
        kernel.add(sums)
        return self._by_cell(sums.reshape(-1, len(VOIGT))[self.points.history.cells])

    def _by_cell(self, own: Array) -> Array:
        """Return values of this rank's cells by cell of the mesh, on rank 0; collective."""
        parts = self.comm.gather((self._cells, own))
        out = np.zeros((len(self.domain.source.cells) if parts else 0, *own.shape[1:]))
        for cells, values in parts or ():
            out[cells] = values
        return out

    def memory(self) -> dict[str, Array]:
        """Return the history by cell of the mesh, on rank 0; collective."""
        parts = self.comm.gather((self._cells, self.points.history.values()))
        if parts is None:
            return {}
        cells = np.concatenate([own for own, _ in parts])
        values = np.concatenate([values for _, values in parts])
        order = np.argsort(cells)
        return {"cells": cells[order], "history": values[order]}

    def restore(self, memory: Mapping[str, Array]) -> None:
        """Go on from what :meth:`memory` returned."""
        at = np.searchsorted(memory["cells"], self._cells)
        self.points.history.set(memory["history"][at])
