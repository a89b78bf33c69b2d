# SPDX-License-Identifier: LGPL-3.0-or-later
"""Static equilibrium with frictionless contact: Newton on the set of contacting nodes.

The residual is the sum of the very loads that the stepping uses, so a run started from here does
not jump. The tangent is the elastic stiffness at the undeformed shape plus the springs of the
contacts and connections; conjugate gradients with algebraic multigrid solve each step.
"""

from collections.abc import Callable
from typing import Any

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem, la
from dolfinx.fem.petsc import assemble_matrix

from forms.elasticity import RESIDUALS, full
from forms.kernel import JIT_OPTIONS
from workflow.attachments import supports
from workflow.model import Model, regions
from workflow.scene import Equilibrium

Array = npt.NDArray[np.float64]


def equilibrium(
    model: Model, settings: Equilibrium, extra: Array, log: Callable[[str], Any]
) -> int:
    """Bring the model to rest under its loads, in place; return the iterations used.

    Args:
        model: The model; its displacement, contact state and point masses are set.
        settings: Tolerance on the residual over the load, iterations, first guess, extra supports.
        extra: More dead load of every owned dof (the centrifugal force of a spinning wheel), N.
        log: Called with a line per iteration.

    Raises:
        RuntimeError: if it has not converged.
    """
    state, n = model.state, 3 * model.domain.owned
    for body, shift in settings.approach.items():
        state.u.x.array.reshape(-1, 3)[model.body_dofs(body)] += shift
    state.u.x.scatter_forward()
    held = held_dofs(model, settings)
    stiffness = elastic_stiffness(model)
    du = la.vector(model.domain.V.dofmap.index_map, 3)
    du.array[:] = 0.0
    x = model.domain.V.tabulate_dof_coordinates()[: model.domain.owned]
    scale = None
    for iteration in range(settings.max_iterations + 1):
        residual = out_of_balance(model, extra)
        residual.array[held] = 0.0
        own = residual.array[:n]
        size = float(np.sqrt(model.domain.msh.comm.allreduce(own @ own)))
        scale = max(scale or 0.0, load_size(model, extra))
        active = sum(p.active for p in model.pairs.values())
        log(f"equilibrium {iteration}: residual {size / scale:.2e}, {active} contact nodes")
        if size <= settings.tolerance * scale:
            return iteration
        solve(tangent(model, stiffness), residual, held, x, du)
        state.u.x.array[:n] += du.array[:n]
        state.u.x.scatter_forward()
    raise RuntimeError(
        f"equilibrium: residual {size / scale:.1e} of the load after {settings.max_iterations} "
        f"iterations, expected {settings.tolerance:.0e}; try another equilibrium.approach"
    )


def out_of_balance(model: Model, extra: Array) -> la.Vector:
    """Return the sum of all forces at rest, point masses settled, contact without friction."""
    state = model.state
    state.a.array[:] = 0.0
    model.internal.kernel.add(state.a)
    model.dead.add(state, state.a)
    state.a.array[: len(extra)] += extra
    if model.connections is not None:
        model.connections.settle(state.u.x.array)
        model.connections.add(state, state.a)
    state.a.scatter_reverse(la.InsertMode.add)
    for pair in model.pairs.values():
        pair.add(state, state.a, friction=False)
    return state.a


def load_size(model: Model, extra: Array) -> float:
    """Norm of the dead loads with the weight of the point masses, the scale of the residual [N]."""
    nodal = model.dead.nodal + extra if len(extra) else model.dead.nodal
    square = model.domain.msh.comm.allreduce(float(nodal @ nodal))
    if model.connections is not None:
        masses = model.connections.masses
        square += float(((masses.mass[:, None] * masses.gravity) ** 2).sum())
    return float(np.sqrt(square))


def held_dofs(model: Model, settings: Equilibrium) -> npt.NDArray[np.int32]:
    """Owned scalar dofs held in the static solve.

    A support along a slanted direction holds every axis that it touches: the static solve has no
    sliding along it.
    """
    extra = supports(settings.hold, model.scene, model.domain, "equilibrium.hold")
    groups = zip(
        model.supports.dofs + extra.dofs, model.supports.directions + extra.directions, strict=True
    )
    held = [3 * d + i for d, n in groups for i in np.flatnonzero(np.abs(n) > 1e-12)]
    return np.unique(np.concatenate(held)) if held else np.zeros(0, dtype=np.int32)


def elastic_stiffness(model: Model) -> PETSc.Mat:
    """Assembled stiffness at the undeformed shape, with rigid motions for the multigrid [N/m]."""
    V, scene = model.domain.V, model.scene
    dx = full(model.domain.msh, model.domain.regions)
    u, w = fem.Function(V), ufl.TestFunction(V)
    residual = sum(
        RESIDUALS[b.kinematics](u, w, model.materials[name]) * dx(regions(b))
        for name, b in scene.bodies.items()
    )
    form = fem.form(ufl.derivative(residual, u, ufl.TrialFunction(V)), jit_options=JIT_OPTIONS)
    K = assemble_matrix(form)
    K.assemble()
    return K


def tangent(model: Model, stiffness: PETSc.Mat) -> PETSc.Mat:
    """Elastic stiffness plus the springs of contacts and connections [N/m]."""
    number = global_numbers(model)
    rows, columns, values = [], [], []
    for pair in model.pairs.values():
        i, j, blocks = pair.tangent(model.state)  # the same on all ranks
        if model.domain.msh.comm.rank > 0:
            continue
        r, c = np.broadcast_arrays(
            3 * number[i][:, None, None] + np.arange(3)[:, None],
            3 * number[j][:, None, None] + np.arange(3),
        )
        rows.append(r.ravel()), columns.append(c.ravel()), values.append(blocks.ravel())
    if model.connections is not None:
        i, j, k = model.connections.stiffness(number[model.domain.nodes[: model.domain.owned]])
        rows.append(i), columns.append(j), values.append(k)
    K = stiffness.copy()
    if model.pairs or model.connections is not None:
        C = PETSc.Mat().create(K.comm)
        C.setSizes(K.getSizes())
        C.setType("aij")
        flat = [np.concatenate(x) if x else np.zeros(0) for x in (rows, columns, values)]
        C.setPreallocationCOO(flat[0].astype(PETSc.IntType), flat[1].astype(PETSc.IntType))
        C.setValuesCOO(flat[2])
        K.axpy(1.0, C, structure=PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    return K


def global_numbers(model: Model) -> npt.NDArray[np.int64]:
    """Global dof block of every mesh node, on every rank, shape ``(n,)``."""
    domain = model.domain
    number = np.zeros(len(domain.source.points), dtype=np.int64)
    first = domain.V.dofmap.index_map.local_range[0]
    number[domain.nodes[: domain.owned]] = first + np.arange(domain.owned)
    return np.asarray(domain.msh.comm.allreduce(number))


def solve(
    K: PETSc.Mat, residual: la.Vector, held: npt.NDArray[np.int32], x: Array, du: la.Vector
) -> None:
    """Solve ``K du = residual`` with the held dofs at rest, into ``du``."""
    first = 3 * residual.index_map.local_range[0]
    K.zeroRowsColumns((held + first).astype(PETSc.IntType), diag=K.getDiagonal().max()[1])
    K.setBlockSize(3)
    K.setNearNullSpace(rigid_motions(K, x))
    ksp = PETSc.KSP().create(K.comm)
    ksp.setOperators(K)
    ksp.setType("cg")
    ksp.setTolerances(rtol=1e-7, max_it=2000)
    ksp.pc.setType("gamg")
    ksp.setUp()
    ksp.solve(residual.petsc_vec, du.petsc_vec)
    if ksp.getConvergedReason() <= 0:
        raise RuntimeError(
            f"equilibrium: linear solve stopped with reason {ksp.getConvergedReason()} after "
            f"{ksp.getIterationNumber()} iterations; is every body held or in contact?"
        )


def rigid_motions(K: PETSc.Mat, x: Array) -> PETSc.NullSpace:
    """The six rigid motions of the nodes at ``x``, orthonormal: what multigrid must not smooth."""
    basis = []
    for axis in range(6):
        vector = K.createVecRight()
        motion = np.cross(np.eye(3)[axis - 3], x) if axis > 2 else np.eye(3)[axis] + 0 * x
        vector.array_w[:] = motion.ravel()
        for other in basis:
            vector.axpy(-vector.dot(other), other)
        vector.normalize()
        basis.append(vector)
    return PETSc.NullSpace().create(vectors=basis, comm=K.comm)
