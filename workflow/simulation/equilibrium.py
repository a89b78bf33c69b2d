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
from scipy.optimize import brentq

from forms.kernel import compiled
from meshes.arrays import Array
from workflow.model import Model
from workflow.model.geometry import cell_size
from workflow.simulation.at_rest import AtRest, Log, Solve
from workflow.simulation.guards import GuardError

# petsc4py's stubs know plain lists and take this number for something else
DIFFERENT: Any = PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN

MANY = 30  # steps of conjugate gradients that take as long as new factors, about

ROUGH = 1e-2  # tolerance before the last increment of a shift
ALIKE = 0.1  # change of the springs of the same nodes that the tangent need not follow
SOFT = 0.5  # penalty with which nodes find their place before stiffer springs take over
STIFFER = 8.0  # times at most from one solve to the next
LEFT = 0.3  # of the work of the forces out of balance at the end of a search, at most

Triplets = tuple[npt.NDArray[Any], npt.NDArray[Any], npt.NDArray[Any]]


def equilibrium(problem: AtRest, log: Log) -> Solve:
    """Return Newton's method as a solver of a model at rest; its factors last from call to call."""
    solver, tolerance = Solver(problem.model, problem.held), problem.settings.tolerance
    contacts, roughly = problem.model.scene.contacts, max(ROUGH, tolerance)
    stiff = {
        name: contacts[name].penalty / SOFT
        for name in problem.model.pairs
        if contacts[name].method == "implicit-penalty"
    }
    stages = max(0, int(np.ceil(np.log(max(stiff.values(), default=1.0)) / np.log(STIFFER))))

    def solve(rough: bool) -> int:
        used = 0
        for k in range(stages + 1):
            for name, factor in stiff.items() if stages else ():
                problem.model.pairs[name].soften(min(1.0, factor ** (k / stages - 1)))
            if rough or k < stages:
                used += newton(problem, solver, roughly, log)
            if rough:
                return used
        return used + newton(problem, solver, tolerance, log)

    return solve


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
    model, settings, comm = problem.model, problem.settings, problem.model.domain.msh.comm
    n = 3 * model.domain.owned
    du = la.vector(model.domain.V.dofmap.index_map, 3)
    residual, size = problem.out_of_balance(), np.inf
    for iteration in range(settings.max_iterations + 1):
        own = residual.array[:n]
        # numpy, not PETSc, whose norms are remembered while the array changes beneath
        size = float(np.sqrt(comm.allreduce(own @ own))) / problem.load_size()
        active = sum(p.active for p in model.pairs.values())
        log(f"equilibrium {iteration}: residual {size:.2e}, {active} contact nodes")
        if size <= tolerance:
            check_all_seen(model)
            return iteration
        if not np.isfinite(size):
            break
        solver.solve(contact_springs(model), residual, du)
        share = along(problem, residual, du)
        if share < 1.0:
            log(f"equilibrium {iteration}: {share:.3f} of the step taken")
        residual = problem.model.state.a
    raise GuardError(
        f"equilibrium: residual {size:.1e} of the load after {iteration} iterations, expected "
        f"{tolerance:.0e}; try another equilibrium.approach or more equilibrium.hold"
    )


def along(problem: AtRest, residual: la.Vector, du: la.Vector) -> float:
    """Go along a Newton step until its forces balance roughly, in place; return how far, 0 to 1.

    The work of the forces out of balance per share of the step falls from a positive value. Where
    the whole step leaves a negative one it has gone too far, because nodes have lost or found
    contact on the way, and a share with less than :data:`LEFT` of it is looked for; a step that
    takes all contact away leaves only the small work of the loads.

    Args:
        problem: The model with its loads at rest; ``state.a`` are the forces at the end [N].
        residual: Forces out of balance at the start [N]; overwritten.
        du: The step [m].
    """
    model = problem.model
    n, comm, u = 3 * model.domain.owned, model.domain.msh.comm, model.state.u.x
    step, before = du.array[:n].copy(), u.array[:n].copy()

    def work(share: float) -> float:
        u.array[:n] = before + share * step
        u.scatter_forward()
        return float(comm.allreduce(float(problem.out_of_balance().array[:n] @ step)))

    def parted() -> bool:
        return touched and not any(pair.active for pair in model.pairs.values())

    start = float(comm.allreduce(float(residual.array[:n] @ step)))
    touched = any(pair.active for pair in model.pairs.values())
    end = work(1.0)
    if start <= 0.0 or end >= (0.0 if parted() else -LEFT * start):
        return 1.0
    known, pressed = {0.0: start, 1.0: end}, 0.0

    def left(share: float) -> float:
        nonlocal pressed
        value = known[share] if share in known else work(share)
        if value > 0.0:
            pressed = max(pressed, share)  # as far as nodes have not parted
        return 0.0 if 0.0 <= value <= LEFT * start else value  # 0 ends the search

    share = float(brentq(left, 0.0, 1.0, xtol=1e-3, disp=False))
    work(pressed or share)
    return pressed or share


def check_all_seen(model: Model) -> None:
    """Raise GuardError where bodies overlap deeper than the contact that bears the load knows.

    Contact is looked for to a depth of half a cell; a step of the solver that is longer than small
    cells can carry nodes beyond it, and rest without them is not rest.
    """
    size = cell_size(model.scene, model.domain.source)
    for name, pair in model.pairs.items():
        depth, node, place = pair.penetration(model.state, 50 * size)
        if depth > 1.01 * pair.max_penetration + 1e-9:
            x, y, z = place
            raise GuardError(
                f"equilibrium: contacts.{name}: node {node} at x = {x:.5f}, y = {y:.5f}, "
                f"z = {z:.5f} m is {depth:.2e} m deep and not in contact, whose deepest overlap is "
                f"{pair.max_penetration:.2e} m; try a smaller equilibrium.approach"
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
        self.size = 0.0

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

        While the touching nodes and facets stay the same, and their springs as stiff, the tangent
        is kept: they turn by less than its error, which is that of the undeformed shape.
        """
        rows, columns, values = springs
        places, size = rows * 3 * du.index_map.size_global + columns, float(np.abs(values).sum())
        same = self.ksp is not None and np.array_equal(places, self.places)
        same = same and abs(size - self.size) <= ALIKE * size
        if not self.comm.allreduce(same, op=MPI.LAND):
            self.places, self.size = places, size
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
