# SPDX-License-Identifier: LGPL-3.0-or-later
"""Linear elastic bodies with their connections, factorised once: forces in, displacements out."""

from dataclasses import dataclass
from typing import Any, cast

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem, la
from dolfinx.fem.petsc import assemble_matrix

from forms.kernel import compiled
from meshes.arrays import Array
from workflow.model import Model

# petsc4py's stubs know plain lists and take these numbers for something else
DIFFERENT: Any = PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN
SPD: Any = PETSc.Mat.Option.SPD

ANCHOR = 1e-4  # all anchors in one direction together, over the mean stiffness of a dof


@dataclass(frozen=True, eq=False)
class Free:
    """Motions that nothing resists: in a steady state their inertia balances the other forces.

    Attributes:
        comm: Ranks.
        mass: Of each owned dof, shape ``(n,)`` [kg].
        motions: Of the owned dofs, orthogonal in mass, shape ``(n, k)`` [kg^-1/2].
    """

    comm: MPI.Comm
    mass: Array
    motions: Array

    def balance(self, force: Array) -> None:
        """Take away what accelerates these motions, of forces ``(n,)`` or ``(n, m)``, in place."""
        along = self.comm.allreduce(self.motions.T @ force)
        force -= (self.mass * (self.motions @ along).T).T

    def leave(self, u: Array) -> None:
        """Take these motions off displacements ``(n,)`` or ``(n, m)``, in place."""
        u -= self.motions @ self.comm.allreduce(self.motions.T @ (self.mass * u.T).T)


class Elastic:
    """Stiffness at the undeformed shape as a Cholesky factor (MUMPS).

    A body that only contact holds has no stiffness of its own. So in a model with contact every
    dof is anchored to the ground by a spring that is soft beside any contact. Wheel and rail are
    long and thin, so the factor stays sparse, while multigrid needs hundreds of iterations on their
    stretched cells.

    Attributes:
        anchor: Stiffness of the anchor of a dof [N/m].
        free: Motions that are balanced by their inertia, instead of anchors; None for none.
    """

    def __init__(
        self,
        model: Model,
        held: npt.NDArray[np.int32],
        free: Free | None = None,
        *,
        soft: bool = False,
    ) -> None:
        """Factorise; collective.

        Args:
            model: The model.
            held: Owned scalar dofs that stay.
            free: Motions that are balanced by their inertia.
            soft: Whether bodies that flow at the present displacement are as soft as that.
        """
        domain, self.free = model.domain, free
        self.comm, self.n, self.held = domain.msh.comm, 3 * domain.owned, held
        K = elastic_stiffness(model)
        for item in model.items if soft else ():
            if getattr(item, "softens", False):
                K.axpy(1.0, item.softening(), structure=DIFFERENT)
        first = domain.V.dofmap.index_map.local_range[0]
        if model.connections is not None:
            rows, columns, values = model.connections.stiffness(first + np.arange(domain.owned))
            C: Any = PETSc.Mat().create(self.comm)
            C.setSizes(K.getSizes())
            C.setType("aij")
            C.setPreallocationCOO(rows.astype(PETSc.IntType), columns.astype(PETSc.IntType))
            C.setValuesCOO(values)
            K.axpy(1.0, C, structure=DIFFERENT)
        diagonal: Any = K.getDiagonal()
        self.anchor = 3 * ANCHOR * diagonal.sum() / diagonal.getSize() ** 2 if model.pairs else 0.0
        rows = (held + 3 * first).astype(PETSc.IntType)
        K.zeroRowsColumns(cast(Any, rows), diag=diagonal.max()[1])
        K.shift(self.anchor)
        self._factor = cholesky(K)

    def solve(self, force: la.Vector, u: la.Vector) -> None:
        """Set the owned part of ``u`` [m] to the displacement under ``force`` [N]."""
        force.array[self.held] = 0.0
        if self.free is not None:
            self.free.balance(force.array[: self.n])
        self._factor.solve(force.petsc_vec, u.petsc_vec)
        if self.free is not None:
            self.free.leave(u.array[: self.n])

    def solve_many(self, forces: Array) -> Array:
        """Return the displacements of the owned dofs under each column of ``forces``, ``(n, m)``.

        Args:
            forces: On the owned dofs, shape ``(n, m)`` [N].
        """
        m = forces.shape[1]
        sizes: Any = (self.n, None), (None, m)
        F, U = (PETSc.Mat().createDense(sizes, comm=self.comm) for _ in range(2))
        F.setUp()
        U.setUp()
        array: Array = cast(Array, F.getDenseArray())
        array[:] = forces
        array[self.held] = 0.0
        if self.free is not None:
            self.free.balance(array)
        self._factor.matSolve(F, U)
        found: Array = np.array(U.getDenseArray(readonly=True), dtype=np.float64)
        if self.free is not None:
            self.free.leave(found)
        return found


def elastic_stiffness(model: Model, at: fem.Function | None = None) -> PETSc.Mat:
    """Assembled stiffness at a displacement, at the undeformed shape if there is none, [N/m]."""
    V = model.domain.V
    u, w = at or fem.Function(V), ufl.TestFunction(V)
    residual = model.bodies.internal_work(u, w)
    K = assemble_matrix(compiled(ufl.derivative(residual, u, ufl.TrialFunction(V))))
    K.assemble()
    return K


def cholesky(K: PETSc.Mat) -> PETSc.Mat:
    """Return the factor of a symmetric positive definite matrix."""
    K.setOption(SPD, True)  # spares MUMPS the search for pivots
    pc = PETSc.PC().create(K.comm)
    pc.setType("cholesky")
    pc.setFactorSolverType("mumps")
    pc.setOperators(K)
    pc.setUp()
    return pc.getFactorMatrix()
