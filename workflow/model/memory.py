# SPDX-License-Identifier: LGPL-3.0-or-later
"""Internal force of bodies whose material has a memory, as items of a model."""

from collections.abc import Iterator, Mapping
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import ufl
from dolfinx import fem, la
from dolfinx.fem.petsc import assemble_matrix

from forms.cells import one_point
from forms.dilatation import dilatation, dilatation_energy, mean_stress
from forms.kernel import CellIntegral, CellKernel, compiled
from forms.material_points import Points
from forms.materials import VOIGT
from forms.memory import EQUIVALENT, FLOW, PLASTIC
from forms.plasticity import MEMORY_LAWS
from forms.stretch import deformations
from meshes.arrays import Array
from workflow.model.bodies import Bodies
from workflow.model.cost import size_in_words
from workflow.model.state import State
from workflow.model.zones import border

VON_MISES, STRESS, BACK_STRESS = "von_mises_stress", "stress", "back_stress"
IN_VTK = [0, 1, 2, 3, 5, 4]  # numbers of a tensor in VTK's order
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

    Attributes:
        yielding: For the summary: how many cells have a history and their body has, bytes that it
            takes, and how many cells have yielded at the border of the zone, if there is one.
    """

    phase = "internal_force"
    cell_fields: tuple[str, ...]

    def __init__(self, bodies: Bodies, name: str, u: Any, precision: str) -> None:
        body, material = bodies.scene.bodies[name], bodies.materials[name]
        domain, dx = bodies.domain, bodies.remembering(name)
        self.name, self.domain, self.comm, self.u = name, domain, domain.msh.comm, u
        rotating = body.kinematics == "total-lagrangian"
        split = body.near_element == "selective"
        given = bodies.memory_laws[name]
        law = MEMORY_LAWS[given] if isinstance(given, str) else given
        self.points = Points(
            law,
            material,
            domain.V,
            dx,
            rotating=rotating,
            element=body.near_element,
            coefficient=body.hourglass_coefficient,
            dtype=precision,
        )
        self.kernel = self.points.force(u)
        self._hardens = [name for name in self.points.variables if name.startswith(BACK_STRESS)]
        self.cell_fields = (EQUIVALENT,) if EQUIVALENT in self.points.variables else ()
        self.cell_fields += (VON_MISES,)
        if bodies.scene.output.stress:
            self.cell_fields += (STRESS, BACK_STRESS) if self._hardens else (STRESS,)
        self._split = split
        self._cells = domain.msh.topology.original_cell_index[self.points.history.cells]
        inside, whole = bodies.zones[name], bodies.whole(name)
        self._at_border = border(domain.source, inside, whole)[self._cells]
        self.yielding = {
            "cells": int(inside.sum()),
            "cells_of_body": int(whole.sum()),
            "bytes": self.comm.allreduce(self.points.history.table.nbytes),
        }
        self._noticed = False
        self._soft: tuple[Any, Any] | None = None  # history, and a form of it, for statics
        self._stress_kernels: dict[str, Any] = {}
        self._mean_stress: CellKernel | None = None
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

    @property
    def softens(self) -> bool:
        """Whether statics may ask for :meth:`softening`."""
        return not self.points.rotating

    @property
    def size(self) -> str:
        """How many cells have a memory, and what it takes, in words."""
        count, of = self.yielding["cells"], self.yielding["cells_of_body"]
        room = size_in_words(self.yielding["bytes"])
        return f"bodies.{self.name}: {count} of {of} cells may yield, {room} of history"

    def add(self, state: State, force: la.Vector) -> None:
        """Add this rank's cells and renew the history."""
        self._add(force, renew=True)

    def rest(self, state: State, force: la.Vector) -> None:
        """Add this rank's cells, the history left as it is."""
        self._add(force, renew=False)

    def settle_memory(self, state: State) -> None:
        """Renew the history, the force left aside."""
        self.kernel.add(np.zeros_like(state.a.array), renew=True)

    def softening(self) -> PETSc.Mat:
        """Return what flow changes of the stiffness of the body, at the present step [N/m].

        For small strain: the derivative of a law at large strain takes minutes to compile.
        """
        if self._soft is None:
            msh, points = self.domain.msh, self.points
            space = fem.functionspace(msh, points.history.coefficient.ufl_element())
            held = fem.Function(space)
            self._soft = held, compiled(points.softening(self.u, held))
        held, form = self._soft
        V = held.function_space
        at = V.dofmap.list[self.points.history.cells]
        held.x.array.reshape(-1, V.dofmap.bs)[at] = self.points.history.values()
        K = assemble_matrix(form)
        K.assemble()
        return K

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
        told = self.comm.bcast(self._strained(worst) if rank == self.comm.rank else "", root=rank)
        raise LawError(
            f"bodies.{self.name}.material: the law has no state for the {told}: {found:.1e} beyond "
            f"what it admits, expected at most {TOLERANCE:.0e}; a smaller time.safety makes the "
            "increments smaller"
        )

    def _strained(self, cell: int) -> str:
        """Return strain and place of a cell of this rank in words."""
        corners = self.domain.msh.geometry.x[self.domain.msh.geometry.dofmaps[0][cell]]
        moved = corners + self.u.x.array.reshape(-1, 3)[self.domain.V.dofmap.list[cell]]
        H = deformations(corners[None], moved[None])[0].mean(axis=0) - np.eye(3)
        strain = (H + H.T) / 2
        parts = ", ".join(f"{'xyz'[i]}{'xyz'[j]} = {strain[i, j]:.3g}" for i, j in VOIGT)
        x, y, z = corners.mean(axis=0)
        return f"strain {parts} of the cell at ({x:.4g}, {y:.4g}, {z:.4g}) m"

    def _sum(self, kernel: Any) -> float:
        """Return the sum over this rank's cells, and leave the cells in ``_sums``."""
        self._sums[:] = 0.0
        kernel.add(self._sums)
        return float(self._sums.sum())

    def columns(self) -> dict[str, float]:
        """Return the columns of the history: the largest plastic strain so far; collective [-]."""
        if EQUIVALENT not in self.points.variables:
            return {}
        strain = self.points.values()[EQUIVALENT].max(axis=(1, 2), initial=0.0)
        largest = self.comm.allreduce(float(strain.max(initial=0.0)), op=MPI.MAX)
        if self.yielding["cells"] < self.yielding["cells_of_body"]:
            own = int((strain[self._at_border] > 0).sum())
            self.yielding["yielded_at_border"] = self.comm.allreduce(own)
        return {f"{self.name}_largest_plastic_strain": largest}

    def notices(self) -> Iterator[str]:
        """Yield a line when cells at the border of the zone have yielded for the first time."""
        count = self.yielding.get("yielded_at_border", 0)
        if count and not self._noticed:
            self._noticed = True
            yield (
                f"bodies.{self.name}.yielding: {count} cells at the border of the zone have "
                "yielded, those beyond cannot; a larger yielding.depth or yielding.box lets them"
            )

    def cell_means(self, name: str) -> Array:
        """Return the mean over the points of a field, by cell of the mesh; collective.

        On rank 0; in other cells strain is zero, stress is not a number. Tensors have six numbers
        as VTK has them, xx, yy, zz, xy, yz, xz.
        """
        if name == EQUIVALENT:
            return self._by_cell(self.points.values()[name].mean(axis=(1, 2)), 0.0)
        if name == BACK_STRESS:
            values = self.points.values()
            own = np.sum([values[k].mean(axis=1) for k in self._hardens], axis=0)[:, IN_VTK]
        else:
            own = self._stresses(name)
        return self._by_cell(own, np.nan)

    def cell_plastic_strain(self) -> Array:
        """Return the mean plastic strain by cell of the mesh, as VTK has tensors; collective.

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
        return self._by_cell(own[:, IN_VTK], 0.0)

    def _by_cell(self, own: Array, other: float) -> Array:
        """Return values of this rank's cells by cell of the mesh, on rank 0; collective."""
        parts = self.comm.gather((self._cells, own))
        out = np.full((len(self.domain.source.cells) if parts else 0, *own.shape[1:]), other)
        for cells, values in parts or ():
            out[cells] = values
        return out

    def _stresses(self, name: str) -> Array:
        """Return von Mises' stress or the stress of this rank's cells; compiled when asked for."""
        if name not in self._stress_kernels:
            single = name == VON_MISES
            shape = ("DG", 0) if single else ("DG", 0, (6,))
            density = (self.points.von_mises if single else self.points.stress)(self.u)
            space = fem.functionspace(self.domain.msh, shape)
            self._stress_kernels[name] = self.points.cell_integral(density, space)
        width = 1 if name == VON_MISES else 6
        sums = np.zeros(width * len(self._sums))
        self._stress_kernels[name].add(sums)
        at = self.points.history.cells
        if width == 1:
            return np.asarray(sums[at])
        stress = sums.reshape(-1, 6)[at]
        if self._split:
            stress[:, :3] += self._pressures()[at, None]
        return np.asarray(stress[:, IN_VTK])

    def _pressures(self) -> Array:
        """Return the mean stress of the volume of this rank's selective cells [Pa]."""
        if self._mean_stress is None:
            Q = fem.functionspace(self.domain.msh, ("DG", 0))
            material, dx = self.points.point.material, self.points.dx
            form = mean_stress(self.u, material, rotating=self.points.rotating)
            self._mean_stress = CellKernel(form * ufl.TestFunction(Q) * one_point(dx))
        sums = np.zeros(len(self._sums))
        self._mean_stress.add(sums)
        return sums

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
