# SPDX-License-Identifier: LGPL-3.0-or-later
"""Dynamic relaxation: rest as the end of a damped motion, the cross-check of the static solve.

Central difference with damping in proportion to mass, ``v₊ = η v₋ + (1 + η)/2 dt a``, under the
very forces of the static solve (Underwood 1983, Dynamic relaxation, in Computational Methods for
Transient Analysis). Masses do not matter at rest: each cell gets the one that makes it as fast as
the step allows. Point masses, slow beside cells, are moved to rest under the present shape.
"""

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem, la

from forms.elasticity import exact
from forms.kernel import CellKernel
from forms.springs.step_bound import attached
from forms.time_step import cell_frequencies
from meshes.arrays import Array
from workflow.model import Model
from workflow.scene.settings import Relaxation
from workflow.simulation.at_rest import AtRest, Log, Solve
from workflow.simulation.guards import GuardError

Seen = tuple[Array, Array]

SAFETY = 0.9  # of the step's limit: what bodies stiffen as they turn and strain
# Springs that act one way only gain energy at the limit: nodes hop for ever. At half of it none do.
HEAVIER = 4.0
FIRST = 0.995  # velocity factor until a frequency has been seen
ROUGH = 1e-4  # tolerance before the last increment of a shift


def relaxation(problem: AtRest, log: Log) -> Solve:
    """Return dynamic relaxation as a solver of a model at rest."""
    settings = problem.settings.relaxation
    mass, tolerance = masses(problem.model, settings), settings.tolerance
    return lambda rough: relax(problem, mass, max(ROUGH, tolerance) if rough else tolerance, log)


def relax(problem: AtRest, mass: Array, tolerance: float, log: Log) -> int:
    """Step from the present displacement to rest, in place; return the steps used.

    Args:
        problem: The model with its loads at rest.
        mass: Mass of every owned scalar dof without contact [kg].
        tolerance: Largest kinetic over internal energy [-].
        log: Called with a line per check.

    Raises:
        GuardError: if it has not converged or blows up.
    """
    model, settings = problem.model, problem.settings.relaxation
    n, u, comm = len(mass), model.state.u.x, model.domain.msh.comm
    v, heavy, factor = np.zeros(n), mass, settings.velocity_factor or FIRST
    candidates, before, peak, share = None, None, 0.0, np.inf
    for step in range(settings.max_steps + 1):
        force = problem.out_of_balance().array[:n]
        if settings.mass_scaling and candidates != (found := searches(model)):
            heavy, candidates = mass + contact_mass(model), found
        if step and step % settings.check_interval == 0:
            parts = [item.stored() for item in model.items if hasattr(item, "stored")]
            stored = sum(sum(part.values()) for part in parts)
            share, peak = peak / max(stored, 1e-300), 0.0
            size = np.sqrt(total(comm, force, force)) / problem.load_size()
            log(in_words(model, step, share, size, factor))
            if share <= tolerance:
                return step
            if not np.isfinite(share):
                break
            now = u.array[:n].copy(), force.copy()
            if before is not None and settings.velocity_factor is None:
                square = squared_frequency(comm, before, now, heavy)
                factor = damping_factor(square, model.dt) if square > 0 else factor
            before = now
        v *= factor
        v += (1 + factor) / 2 * model.dt * force / heavy
        peak = max(peak, total(comm, heavy * v, v) / 2)
        u.array[:n] += model.dt * v
        u.scatter_forward()
    raise GuardError(
        f"relaxation: kinetic over internal energy {share:.1e} after {step} steps, expected "
        f"{tolerance:.0e}; try more equilibrium.relaxation.max_steps, another "
        "velocity_factor or equilibrium.approach, or more equilibrium.hold"
    )


def total(comm: MPI.Comm, x: Array, y: Array) -> float:
    """Return ``x · y`` over all ranks."""
    return float(comm.allreduce(float(x @ y)))


def in_words(model: Model, step: int, share: float, residual: float, factor: float) -> str:
    """Return a check of the relaxation as a line of the log."""
    return (
        f"relaxation {step}: kinetic over internal energy {share:.1e}, residual {residual:.1e}, "
        f"velocity factor {factor:.4f}, {sum(p.active for p in model.pairs.values())} contact nodes"
    )


def squared_frequency(comm: MPI.Comm, before: Seen, now: Seen, mass: Array) -> float:
    """Return ω² of the motion between two checks, Rayleigh's quotient ``Δu · ΔK u / Δu · M Δu``.

    Args:
        comm: All ranks.
        before: Displacement [m] and out-of-balance force [N] of the owned dofs, ``(n,)`` each.
        now: The same, later.
        mass: Their mass, shape ``(n,)`` [kg].
    """
    way, change = now[0] - before[0], before[1] - now[1]
    return total(comm, way, change) / max(total(comm, way, mass * way), 1e-300)


def damping_factor(square: float, dt: float) -> float:
    """Return the velocity factor that damps a frequency critically, ``(2 − c dt)/(2 + c dt)``.

    Args:
        square: ω² of that frequency [1/s²]; c = 2 ω.
        dt: Step [s].
    """
    x = min(np.sqrt(square) * dt, 0.5)
    return float((1 - x) / (1 + x))


def masses(model: Model, settings: Relaxation) -> Array:
    """Return the mass of every owned scalar dof, contact left out [kg].

    Cells get the density at which their largest frequency is ``2 SAFETY / dt``, the bound of any
    sum of them (Irons and Treharne 1971); springs add ``dt² k / 4`` for the same reason.
    """
    n, dt = 3 * model.domain.owned, model.dt
    if not settings.mass_scaling:
        return model.mass.array[:n].copy()
    V, bodies = model.domain.V, model.bodies
    scale = fem.Function(fem.functionspace(V.mesh, ("DG", 0)))
    frequency = cell_frequencies(V, bodies.internal_work, bodies.mass)
    at = scale.function_space.dofmap.list[: len(frequency), 0]
    scale.x.array[at] = (frequency * dt / (2 * SAFETY)) ** 2
    scale.x.scatter_forward()
    w, ones = ufl.TestFunction(V), ufl.as_vector([1.0, 1.0, 1.0])
    dm = exact(V.mesh, model.domain.regions)
    form = sum(
        bodies.materials[name].rho * scale * ufl.inner(ones, w) * dm(bodies.tags(body))
        for name, body in model.scene.bodies.items()
    )
    out = la.vector(V.dofmap.index_map, 3)
    CellKernel(form).add(out)
    out.scatter_reverse(la.InsertMode.add)
    mass = out.array[:n].copy()
    if (links := model.connections) is not None:
        springs, _ = attached(links.comm, links.masses, links.links, model.mass.array)
        mass += (dt / (2 * SAFETY)) ** 2 * springs.nodal[:n]
    return mass


def searches(model: Model) -> list[int]:
    """Return what changes whenever the candidates of a contact do, alike on all ranks."""
    sides = (side for pair in model.pairs.values() for side in pair.passes)
    return [hash(side.candidates.item.tobytes()) for side in sides]


def contact_mass(model: Model) -> Array:
    """Return the mass that the nodes near a contact need for its springs, ``(3 owned,)`` [kg].

    Springs are at most ``penalty / dt²`` times the real mass, in the sense of matrices.
    """
    real = model.mass.array[: 3 * model.domain.owned]
    mass = np.zeros_like(real)
    for side in (side for pair in model.pairs.values() for side in pair.passes):
        near = side.candidates
        facets = near.search.quad[near.found.live.astype(bool)]
        moving = np.concatenate([side.stack.behind(near.item).ravel(), facets.ravel()])
        dofs = side.stack.dofs[np.unique(moving)]
        dofs = dofs[dofs >= 0]
        share = HEAVIER * side.options.penalty / (4 * SAFETY**2)
        mass.reshape(-1, 3)[dofs] += share * real.reshape(-1, 3)[dofs]
    return mass
