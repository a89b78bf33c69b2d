# SPDX-License-Identifier: LGPL-3.0-or-later
"""Stability audit: stable time step and the share taken by bodies, contacts and damping."""

import resource
import time
from collections.abc import Callable, Iterator
from typing import Any

from mpi4py import MPI

import numpy as np

from contact.options import IMPLICIT
from forms.time_step import cell_frequency
from workflow.audit.advice import advice, impact_depth
from workflow.audit.limits import Limits, critical_penalty
from workflow.audit.sliding import in_words, sliding_state
from workflow.model.model import Model, build
from workflow.model.step import stiffest
from workflow.scene.scene import Scene
from workflow.simulation.guards import node_sizes
from workflow.simulation.initial import start
from workflow.simulation.stepping import steps

TIMED = 20  # steps


def report(
    scene: Scene, comm: MPI.Comm = MPI.COMM_WORLD, log: Callable[[str], Any] = lambda line: None
) -> dict[str, Any]:
    """Return the limits and the cost of a run of a scene; collective, the same on all ranks.

    The bodies are brought to rest first, if the scene asks for it: contact is audited where it
    will be. A few steps are timed at the end.

    Args:
        scene: The scene.
        comm: Ranks that share it.
        log: Called with lines of progress.

    Raises:
        SceneError: bad input.
        GuardError: the bodies do not come to rest.
    """
    began = time.perf_counter()
    model = build(scene, comm, log)
    start(model, log)
    log("limits of step, penalty and damping")
    limits = Limits(model)
    omega, where = stiffest(model.bodies, model.mass.array)
    bodies = model.bodies
    found: dict[str, Any] = {
        "scene": scene.name,
        "cells": len(model.domain.source.cells),
        "ranks": comm.size,
        "step": model.dt,
        "safety": scene.time.safety,
        "bound": {
            "scene": model.dt_bound,
            "kind": scene.time.bound,
            "cells": 2 / cell_frequency(bodies.domain.V, bodies.internal_work, bodies.mass),
            "stiffest_motion": 2 / omega,
        },
        "stiffest": where,
        **demand(model, limits),
        "contacts": {name: contact_report(model, limits, name) for name in model.pairs},
    }
    found["cost"] = cost(model, time.perf_counter() - began)
    found["sliding"] = sliding_state(scene, found["cells"], comm, log)
    found["doubts"] = [*model.doubts, *advice(model, found)]
    return found


def demand(model: Model, limits: Limits) -> dict[str, Any]:
    """Return what the parts of a model ask of the 1 that a step has, and where the limits are."""
    dt = model.dt
    return {
        "asked": {
            "all": limits.demand(dt),
            "bodies": limits.demand(dt, contact=False),
            "contacts": limits.share(dt),
        },
        "critical": {
            "step": limits.step(),
            "step_without_contact": limits.step(contact=False),
            "penalty_factor": critical_penalty(model, limits),
            "penalty_factor_at_this_step": limits.penalty(dt),
            "contact_damping": limits.damping(dt),
        },
    }


def contact_report(model: Model, limits: Limits, name: str) -> dict[str, Any]:
    """Return stiffness and expected penetration of one contact.

    ``limits_the_step`` is False where no penalty is too large: with springs at the end of the step
    and with constraints.
    """
    contact, pair = model.scene.contacts[name], model.pairs[name]
    found: dict[str, Any] = {
        "method": contact.method,
        "penalty": contact.penalty,
        "limits_the_step": contact.method not in IMPLICIT,
    }
    passes = [t for t in limits.springs[name] if len(t.springs.mass)]
    if passes:
        t, dt = passes[0], model.dt
        follows, fixed = t.springs.mass / dt**2, t.springs.foundation
        known = np.isfinite(fixed) & (fixed > 0)
        ratio = float(np.median(follows[known] / fixed[known])) if known.any() else np.nan
        other = "equivalent_penalty" if t.fixed else "equivalent_modulus_penalty"
        found[other] = contact.penalty / ratio if t.fixed else contact.penalty * ratio
        found["stiffness"] = float(np.median(t.penalty * (fixed if t.fixed else follows)))
    size = min(float(np.median(node_sizes(side))) for side in pair.passes)
    depth = pair.max_penetration if model.scene.equilibrium else impact_depth(model, passes)
    share = None if depth is None else depth / size
    return found | {"cell": size, "penetration": depth, "penetration_over_cell": share}


def cost(model: Model, spent: float) -> dict[str, Any]:
    """Return steps, wall time and memory of the run, from some timed steps; moves the model."""
    comm, scene = model.domain.msh.comm, model.scene
    loop = steps(model, TIMED * model.dt)
    times = [time.perf_counter() for _ in loop]  # the median: some steps search, others wait
    step = comm.allreduce(float(np.median(np.diff(times))), op=MPI.MAX)
    count = round(scene.time.end / model.dt)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024  # kB on Linux
    return {
        "steps": count,
        "seconds_per_step": step,
        "seconds_stepping": count * step,
        "seconds_before": spent,
        "memory": comm.allreduce(int(peak)),
    }


def printout(found: dict[str, Any]) -> Iterator[str]:
    """Yield the lines of a report."""
    b, a, c = found["bound"], found["asked"], found["critical"]
    yield (
        f"{found['scene']}: step {found['step'] * 1e9:.1f} ns, "
        f"{found['step'] / b['scene']:.2f} of the bound {b['scene'] * 1e9:.1f} ns ({b['kind']}); "
        f"stiffest cell {b['cells'] * 1e9:.1f} ns, stiffest motion {b['stiffest_motion'] * 1e9:.1f}"
        f" ns in {found['stiffest']}"
    )
    yield (
        f"asked of a stable step: {a['all']:.1%}; by bodies {a['bodies']:.1%}, by contacts "
        f"{a['contacts']:.1%}; stable up to {c['step'] * 1e9:.1f} ns"
    )
    if any(one["limits_the_step"] for one in found["contacts"].values()):
        yield (
            f"largest stable penalties: {_times(c['penalty_factor'])} where the step follows them, "
            f"{_times(c['penalty_factor_at_this_step'])} at this step; largest contact damping "
            f"{c['contact_damping']:.2f} of critical"
        )
    for name, one in found["contacts"].items():
        yield f"contacts.{name}: {', '.join(_contact_words(one))}"
    cost = found["cost"]
    yield (
        f"{cost['steps']} steps of {cost['seconds_per_step'] * 1e3:.3g} ms: "
        f"{cost['seconds_stepping']:.0f} s and outputs, after {cost['seconds_before']:.0f} s; "
        f"{cost['memory'] / 2**20:.0f} MB"
    )
    yield from in_words(found["sliding"])
    yield from (f"doubt: {line}" for line in found["doubts"])


def _contact_words(one: dict[str, Any]) -> Iterator[str]:
    """Yield what is said of a contact: its springs, whether they limit the step, its give."""
    if one["method"] == "lagrange":
        yield "lagrange, no give"
    else:
        yield f"{one['method']} {one['penalty']:g}"
    yield from (f"as {k[11:].replace('_', '-')} {v:.3g}" for k, v in one.items() if "equiv" in k)
    if not one["limits_the_step"]:
        yield "stable at any penalty and takes nothing of the step"
    if one["penetration"] is not None:
        share = one["penetration_over_cell"]
        give = "penetration" if one["limits_the_step"] else "give"
        yield f"{give} {one['penetration'] * 1e6:.3g} µm, {share:.2%} of a cell"


def _times(factor: float) -> str:
    return f"{factor:.2f} times these" if np.isfinite(factor) else "any"
