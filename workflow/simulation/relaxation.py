# SPDX-License-Identifier: LGPL-3.0-or-later
"""Dynamic relaxation: rest as the end of a damped motion, the cross-check of the static solve.

Central difference with damping in proportion to mass, ``v₊ = η v₋ + (1 + η)/2 dt a``, under the
very forces of the static solve (Underwood 1983, Dynamic relaxation, in Computational Methods for
Transient Analysis). Masses do not matter at rest: each cell gets the one that makes it as fast as
the step allows. Point masses, slow beside cells, are moved to rest under the present shape.
"""

from collections.abc import Callable
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem, la

from forms.elasticity import exact
from forms.kernel import CellKernel
from forms.springs.step_bound import attached
from forms.time_step import cell_frequencies
from workflow.model.model import Model
from workflow.model.supports import axle
from workflow.scene.settings import Equilibrium, Relaxation
from workflow.simulation.equilibrium import held_dofs, load_size, move, out_of_balance
from workflow.simulation.guards import GuardError

Array = npt.NDArray[np.float64]
Log = Callable[[str], Any]
Seen = tuple[Array, Array]

SAFETY = 0.9  # of the step's limit: what bodies stiffen as they turn and strain
# Springs that act one way only gain energy at the limit: nodes hop for ever. At half of it none do.
HEAVIER = 4.0
FIRST = 0.995  # velocity factor until a frequency has been seen
ROUGH = 1e-4  # tolerance before the last increment of a shift


def relaxation(model: Model, settings: Equilibrium, extra: Array, log: Log) -> int:
    """Bring the model to rest under its loads, in place; return the steps used.

    Args:
        model: The model; its displacement, contact state and point masses are set.
        settings: Tolerance and factor of the relaxation, first guess, extra supports, shift.
        extra: More dead load of every owned dof (the centrifugal force of a spinning wheel), N.
        log: Called with a line per check.

    Raises:
        GuardError: if it has not converged or blows up.
    """
    own = settings.relaxation
    for body, approach in settings.approach.items():
        move(model, body, np.array(approach))
    held, mass = held_dofs(model, settings), masses(model, own)
    rough = own.model_copy(update={"tolerance": max(ROUGH, own.tolerance)})
    increments = settings.shift_increments if settings.shift else 0
    used = relax(model, rough if increments else own, held, mass, extra, log)
    for k in range(increments):
        body = model.scene.rolling.body  # type: ignore[union-attr]
        move(model, body, settings.shift / increments * axle(model.scene))
        log(f"relaxation: shifted along the axle by {(k + 1) / increments * settings.shift:.2e} m")
        last = own if k + 1 == increments else rough
        used += relax(model, last, held, mass, extra, log)
    return used


def relax(
    model: Model,
    settings: Relaxation,
    held: npt.NDArray[np.int32],
    mass: Array,
    extra: Array,
    log: Log,
) -> int:
    """Step from the present displacement to rest, in place; return the steps used.

    Args:
        model: The model.
        settings: Tolerance and factor.
        held: Owned scalar dofs that stay.
        mass: Mass of every owned scalar dof without contact [kg].
        extra: More dead load, N.
        log: Called with a line per check.
    """
    n, u, comm = len(mass), model.state.u.x, model.domain.msh.comm
    v, heavy, factor = np.zeros(n), mass, settings.velocity_factor or FIRST
    candidates, before, peak, share = None, None, 0.0, np.inf
    for step in range(settings.max_steps + 1):
        force = out_of_balance(model, extra).array[:n]
        force[held] = 0.0
        if settings.mass_scaling and candidates != (found := searches(model)):
            heavy, candidates = mass + contact_mass(model), found
        if step and step % settings.check_interval == 0:
            share, peak = peak / max(internal_energy(model), 1e-300), 0.0
            size = np.sqrt(total(comm, force, force)) / load_size(model, extra)
            log(in_words(model, step, share, size, factor))
            if share <= settings.tolerance:
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
        f"{settings.tolerance:.0e}; try more equilibrium.relaxation.max_steps, another "
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


def internal_energy(model: Model) -> float:
    """Strain energy with that of hourglass control [J]."""
    control = model.hourglass_energy
    return model.strain_energy() + (control() if control is not None else 0.0)


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
        stacked = np.concatenate([side.contactor.dofs, side.target.dofs])
        facets = near.search.quad[near.found.live.astype(bool)]
        dofs = stacked[np.unique(np.concatenate([near.item, facets.ravel()]))]
        dofs = dofs[dofs >= 0]
        share = HEAVIER * side.options.penalty / (4 * SAFETY**2)
        mass.reshape(-1, 3)[dofs] += share * real.reshape(-1, 3)[dofs]
    return mass
