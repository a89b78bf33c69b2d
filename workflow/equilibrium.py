# SPDX-License-Identifier: LGPL-3.0-or-later
"""Static equilibrium with frictionless contact: Newton on the set of contacting nodes.

The residual is the sum of the very loads that the stepping uses, so a run started from here does
not jump. The tangent is the elastic stiffness at the undeformed shape plus the springs of the
contacts and connections; a sparse direct solver solves each step.
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
from workflow.attachments import axle, supports
from workflow.model import Model, regions
from workflow.scene import Equilibrium

Array = npt.NDArray[np.float64]
Triplets = tuple[npt.NDArray[Any], npt.NDArray[Any], npt.NDArray[Any]]


def equilibrium(
    model: Model, settings: Equilibrium, extra: Array, log: Callable[[str], Any]
) -> int:
    """Bring the model to rest under its loads, in place; return the iterations used.

    A shift along the axle follows the loads in increments: a loaded axle bends and takes the wheel
    off the rail's gauge corner by millimetres, which the unloaded placement cannot know.

    Args:
        model: The model; its displacement, contact state and point masses are set.
        settings: Tolerance on the residual over the load, iterations, first guess, extra supports.
        extra: More dead load of every owned dof (the centrifugal force of a spinning wheel), N.
        log: Called with a line per iteration.

    Raises:
        RuntimeError: if it has not converged.
    """
    for body, approach in settings.approach.items():
        move(model, body, np.array(approach))
    held = held_dofs(model, settings)
    stiffness = elastic_stiffness(model)
    rough = settings.model_copy(update={"tolerance": max(1e-4, settings.tolerance)})
    increments = settings.shift_increments if settings.shift else 0
    used = newton(model, rough if increments else settings, extra, held, stiffness, log)
    for k in range(increments):
        body = model.scene.rolling.body  # type: ignore[union-attr]
        move(model, body, settings.shift / increments * axle(model.scene))
        log(f"equilibrium: shifted along the axle by {(k + 1) / increments * settings.shift:.2e} m")
        last = settings if k + 1 == increments else rough
        used += newton(model, last, extra, held, stiffness, log)
    return used


def move(model: Model, body: str, shift: Array) -> None:
    """Displace a whole body rigidly by ``shift``, shape ``(3,)`` [m]."""
    u = model.state.u.x
    u.array.reshape(-1, 3)[model.body_dofs(body)] += shift
    u.scatter_forward()


def newton(
    model: Model,
    settings: Equilibrium,
    extra: Array,
    held: npt.NDArray[np.int32],
    stiffness: PETSc.Mat,
    log: Callable[[str], Any],
) -> int:
    """Solve for rest from the present displacement, in place; return the iterations used."""
    state, n = model.state, 3 * model.domain.owned
    du = la.vector(model.domain.V.dofmap.index_map, 3)
    du.array[:] = 0.0
    scale = load_size(model, extra)
    for iteration in range(settings.max_iterations + 1):
        residual = out_of_balance(model, extra)
        residual.array[held] = 0.0
        own = residual.array[:n]
        # numpy, not PETSc, whose norms are remembered while the array changes beneath
        size = float(np.sqrt(model.domain.msh.comm.allreduce(own @ own))) / scale
        active = sum(p.active for p in model.pairs.values())
        log(f"equilibrium {iteration}: residual {size:.2e}, {active} contact nodes")
        if size <= settings.tolerance:
            return iteration
        solve(tangent(model, stiffness), residual, held, du)
        state.u.x.array[:n] += du.array[:n]
        state.u.x.scatter_forward()
    raise RuntimeError(
        f"equilibrium: residual {size:.1e} of the load after {settings.max_iterations} "
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
    """Assembled stiffness at the undeformed shape, [N/m]."""
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
    triplets: list[Triplets] = [(np.zeros(0), np.zeros(0), np.zeros(0))]
    for pair in model.pairs.values():
        i, j, blocks = pair.tangent(model.state)  # the same on all ranks
        if model.domain.msh.comm.rank > 0:
            continue
        r, c = np.broadcast_arrays(
            3 * number[i][:, None, None] + np.arange(3)[:, None],
            3 * number[j][:, None, None] + np.arange(3),
        )
        triplets.append((r.ravel(), c.ravel(), blocks.ravel()))
    if model.connections is not None:
        owned = number[model.domain.nodes[: model.domain.owned]]
        triplets.append(model.connections.stiffness(owned))
    K = stiffness.copy()
    if model.pairs or model.connections is not None:
        C: Any = PETSc.Mat().create(K.comm)  # petsc4py's stubs know lists, not arrays
        (m, n), (M, N) = K.getLocalSize(), K.getSize()
        C.setSizes(((m, M), (n, N)))
        C.setType("aij")
        rows, columns, values = (np.concatenate(x) for x in zip(*triplets, strict=True))
        C.setPreallocationCOO(rows.astype(PETSc.IntType), columns.astype(PETSc.IntType))
        C.setValuesCOO(values)
        pattern: Any = PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN  # an int to the stubs
        K.axpy(1.0, C, structure=pattern)
    return K


def global_numbers(model: Model) -> npt.NDArray[np.int64]:
    """Global dof block of every mesh node, on every rank, shape ``(n,)``."""
    domain = model.domain
    number = np.zeros(len(domain.source.points), dtype=np.int64)
    first = domain.V.dofmap.index_map.local_range[0]
    number[domain.nodes[: domain.owned]] = first + np.arange(domain.owned)
    return np.asarray(domain.msh.comm.allreduce(number))


def solve(K: PETSc.Mat, residual: la.Vector, held: npt.NDArray[np.int32], du: la.Vector) -> None:
    """Solve ``K du = residual`` with the held dofs at rest, into ``du``.

    A direct solve: wheel and rail are long and thin, so the factors stay sparse, while multigrid
    needs hundreds of iterations on their stretched cells (3 s against 20 s at 150 k dofs).
    """
    first = 3 * residual.index_map.local_range[0]
    K.zeroRowsColumns((held + first).astype(PETSc.IntType), diag=K.getDiagonal().max()[1])
    ksp = PETSc.KSP().create(K.comm)
    ksp.setOperators(K)
    ksp.setType("preonly")
    ksp.pc.setType("cholesky")
    ksp.pc.setFactorSolverType("mumps")
    ksp.solve(residual.petsc_vec, du.petsc_vec)
    if ksp.getConvergedReason() <= 0:
        raise RuntimeError(
            f"equilibrium: linear solve failed with reason {ksp.getConvergedReason()}; "
            "is every body held or in contact?"
        )
    ksp.destroy()
