# SPDX-License-Identifier: LGPL-3.0-or-later
"""Static equilibrium with frictionless contact: Newton on the set of contacting nodes.

The tangent is the elastic stiffness at the undeformed shape plus the springs of the contacts and
connections. Conjugate gradients solve each step, preconditioned by a Cholesky factor (MUMPS) of an
earlier tangent.
"""

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
from workflow.simulation.at_rest import AtRest, Log, Solve
from workflow.simulation.guards import GuardError

# petsc4py's stubs know plain lists and take this number for something else
DIFFERENT: Any = PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN

MANY = 30  # steps of conjugate gradients that take as long as new factors, about

ROUGH = 1e-2  # tolerance before the last increment of a shift
HALVINGS = 6  # of a step that ends all contact, before it is believed

Triplets = tuple[npt.NDArray[Any], npt.NDArray[Any], npt.NDArray[Any]]


def equilibrium(problem: AtRest, log: Log) -> Solve:
    """Return Newton's method as a solver of a model at rest; its factors last from call to call."""
    solver, tolerance = Solver(problem.model, problem.held), problem.settings.tolerance
    return lambda rough: newton(problem, solver, max(ROUGH, tolerance) if rough else tolerance, log)


def newton(problem: AtRest, solver: "Solver", tolerance: float, log: Log) -> int:
    """Solve for rest from the present displacement, in place; return the iterations used.

    Args:
        problem: The model with its loads at rest.
        solver: Of the tangent.
        tolerance: Largest residual over the load [-].
        log: Called with a line per iteration.

    Raises:
        GuardError: if it has not converged.
    """
    model, settings = problem.model, problem.settings
    state, n = model.state, 3 * model.domain.owned
    du = la.vector(model.domain.V.dofmap.index_map, 3)
    du.array[:] = 0.0
    touched, halved = False, 0
    for iteration in range(settings.max_iterations + 1):
        residual = problem.out_of_balance()
        scale = problem.load_size()
        residual.array[problem.held] = 0.0
        own = residual.array[:n]
        # numpy, not PETSc, whose norms are remembered while the array changes beneath
        size = float(np.sqrt(model.domain.msh.comm.allreduce(own @ own))) / scale
        active = sum(p.active for p in model.pairs.values())
        log(f"equilibrium {iteration}: residual {size:.2e}, {active} contact nodes")
        if size <= tolerance:
            return iteration
        if not np.isfinite(size):
            break
        if touched and not active and halved < HALVINGS:
            # too long a step took all contact away; without its springs the body would fall on
            du.array[:n] *= -0.5 if halved == 0 else 0.5
            halved += 1
        else:
            solver.solve(contact_springs(model), residual, du)
            touched, halved = active > 0, 0
        state.u.x.array[:n] += du.array[:n]
        state.u.x.scatter_forward()
    raise GuardError(
        f"equilibrium: residual {size:.1e} of the load after {iteration} iterations, expected "
        f"{tolerance:.0e}; try another equilibrium.approach or more equilibrium.hold"
    )


def elastic_stiffness(model: Model) -> PETSc.Mat:
    """Assembled stiffness at the undeformed shape, [N/m]."""
    V = model.domain.V
    u, w = fem.Function(V), ufl.TestFunction(V)
    residual = model.bodies.internal_work(u, w)
    K = assemble_matrix(compiled(ufl.derivative(residual, u, ufl.TrialFunction(V))))
    K.assemble()
    return K


def contact_springs(model: Model) -> Triplets:
    """Springs of all contacts as rows, columns and values of global scalar dofs, on rank 0."""
    number = global_numbers(model)
    triplets: list[Triplets] = [(np.zeros(0), np.zeros(0), np.zeros(0))]
    axis = np.arange(3)
    for pair in model.pairs.values():
        i, j, blocks = pair.tangent(model.state)  # collective, the same on all ranks
        rows = 3 * number[i][:, None, None] + axis[:, None]
        columns = 3 * number[j][:, None, None] + axis
        rows, columns = np.broadcast_arrays(rows, columns)
        if model.domain.msh.comm.rank == 0:
            triplets.append((rows.ravel(), columns.ravel(), blocks.ravel()))
    rows, columns, values = (np.concatenate(x) for x in zip(*triplets, strict=True))
    return rows, columns, values


class Solver:
    """Solver of the tangent: conjugate gradients behind the factors of an earlier tangent.

    From one iteration to the next only some nodes begin or cease to touch, which changes the
    tangent by a matrix of that rank, so a few steps do. Where they become many it is factorised
    anew. Wheel and rail are long and thin, so the factors stay sparse, while multigrid needs
    hundreds of iterations on their stretched cells (3 s against 20 s at 150 k dofs).
    """

    def __init__(self, model: Model, held: npt.NDArray[np.int32]) -> None:
        self.held = held
        self.comm = model.domain.msh.comm
        self.fixed = elastic_stiffness(model)
        if model.connections is not None:
            own = global_numbers(model)[model.domain.nodes[: model.domain.owned]]
            springs = model.connections.stiffness(own)
            self.fixed.axpy(1.0, self._matrix(springs), structure=DIFFERENT)
        self.ksp: PETSc.KSP | None = None
        self.places: Array = np.zeros(0)

    def _matrix(self, triplets: Triplets) -> PETSc.Mat:
        rows, columns, values = triplets
        C: Any = PETSc.Mat().create(self.comm)
        C.setSizes(self.fixed.getSizes())
        C.setType("aij")
        C.setPreallocationCOO(rows.astype(PETSc.IntType), columns.astype(PETSc.IntType))
        C.setValuesCOO(values)
        return cast(PETSc.Mat, C)

    def solve(self, springs: Triplets, residual: la.Vector, du: la.Vector) -> None:
        """Solve ``K du = residual`` with the held dofs at rest, into ``du``.

        While the touching nodes and facets stay the same the tangent is kept: their springs turn
        by less than its error, which is that of the undeformed shape.
        """
        rows, columns, _ = springs
        places = rows * 3 * du.index_map.size_global + columns
        same = self.ksp is not None and np.array_equal(places, self.places)
        if not self.comm.allreduce(same, op=MPI.LAND):
            self.places = places
            self._set(self._matrix(springs), 3 * du.index_map.local_range[0])
        assert self.ksp is not None
        self.ksp.solve(residual.petsc_vec, du.petsc_vec)
        if not self.ksp.is_converged:
            self.ksp.pc.setReusePreconditioner(False)
            self.ksp.solve(residual.petsc_vec, du.petsc_vec)
        if not self.ksp.is_converged:
            raise GuardError(
                f"equilibrium: linear solve failed with reason {self.ksp.getConvergedReason()}; "
                "is every body held or in contact?"
            )
        self.ksp.pc.setReusePreconditioner(self.ksp.getIterationNumber() <= MANY)

    def _set(self, springs: PETSc.Mat, first: int) -> None:
        """Take over the tangent with these springs; its factors are made when first needed."""
        K: Any = self.fixed.copy()
        K.axpy(1.0, springs, structure=DIFFERENT)
        K.zeroRowsColumns((self.held + first).astype(PETSc.IntType), diag=K.getDiagonal().max()[1])
        if self.ksp is None:
            self.ksp = PETSc.KSP().create(self.comm)
            self.ksp.setType("cg")
            self.ksp.setTolerances(rtol=1e-4, max_it=2 * MANY)
            self.ksp.pc.setType("cholesky")
            self.ksp.pc.setFactorSolverType("mumps")
        self.ksp.setOperators(K)


def global_numbers(model: Model) -> npt.NDArray[np.int64]:
    """Global dof block of every mesh node, on every rank, shape ``(n,)``."""
    domain = model.domain
    number = np.zeros(len(domain.source.points), dtype=np.int64)
    first = domain.V.dofmap.index_map.local_range[0]
    number[domain.nodes[: domain.owned]] = first + np.arange(domain.owned)
    return np.asarray(domain.msh.comm.allreduce(number))
