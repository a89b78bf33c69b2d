# SPDX-License-Identifier: LGPL-3.0-or-later
"""Stable time step of a scene, and what shortens it: bodies, springs, contact, damping."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem, la

from forms.kernel import CellKernel
from forms.springs.connections import Connections
from forms.springs.step_bound import NONE, Attached, as_springs, attached, joined, joined_step
from forms.time_step import assembled_frequency, cell_frequency, stable_step
from forms.viscosity import damped_step
from meshes.arrays import Array
from workflow.model.bodies import Bodies
from workflow.model.contacts import contact_surfaces
from workflow.model.regions import place

PRODUCTS = 40
LOOK = 10  # first steps between two looks at the shape of cells


@dataclass(frozen=True)
class ContactTerms:
    """Sums over the contacts of a scene.

    Attributes:
        room: What springs in proportion to m/dt² and their dampers leave of the 1 in
            ``dt²/4 K + dt/2 C < M`` [-].
        undamped: What the dampers alone leave of it; 1 where they leave nothing [-].
        square: Bound of K/M of the springs that do not depend on the step [1/s²].
        rate: Bound of C/M of their dampers [1/s].
    """

    room: float
    undamped: float
    square: float
    rate: float


def step_bound(
    bodies: Bodies, mass: Array, connections: Connections | None, log: Callable[[str], Any]
) -> float:
    """Return the largest stable step [s]: of the assembled system with contact, or of the cells.

    A contact spring is ``penalty * m_eff / dt²``, so the pairs of a scene add at most the sum p of
    their penalties to ``(ω dt)²``, whose limit is 4: ``dt = √(4 − p) / ω`` without damping. Their
    dampers take ``ζ √p`` of the room ``1 − p/4`` that this leaves; springs from the bulk modulus
    add to ω². The cell bound, which viscosity always takes, has the penalties in hand.

    Args:
        bodies: Bodies with their forms.
        mass: Lumped mass of every local scalar dof [kg].
        connections: Springs, dampers and point masses, if there are such.
        log: Called with a line if the assembled value cannot be used.
    """
    scene, V = bodies.scene, bodies.domain.V
    entries = scene.bodies.values()
    damping = max(b.stiffness_damping for b in entries), max(b.mass_damping for b in entries)
    springs = dampers = NONE
    if connections is not None:
        parts = connections.masses, connections.links
        springs, dampers = attached(connections.comm, *parts, mass)
    touch = contact_terms(bodies, mass, log)
    damping = damping[0], damping[1] + touch.rate
    if any(b.bulk_viscosity for b in entries):
        dt = damped_step(V, bodies.internal_work, bodies.damping_work, bodies.mass)
        bound = 2 / dt + damping[1]
        return joined_step(
            touch.square**0.5, springs, dampers, mass_damping=bound, room=touch.undamped
        )
    if scene.time.bound == "assembled":
        held = springs.nodal if connections is not None else None
        frequency, sharp = assembled_frequency(V, bodies.internal_work, mass, held)
        frequency = float(np.hypot(frequency, touch.square**0.5))
        room = touch.room
        if sharp and room > 0:
            dt = joined_step(frequency, springs, dampers, *damping, held=True, room=room)
            if connections is None or dt > 0.98 * np.sqrt(room) * 2 / frequency:
                return dt
            return damped_bound(bodies, mass, (springs, dampers), damping, dt, room, touch.square)
        why = "the contact penalties are too large" if sharp else "Lanczos has not converged"
        log(f"step: bounded by its stiffest cell, because {why}")
    frequency = cell_frequency(V, bodies.internal_work, bodies.mass)
    frequency = float(np.hypot(frequency, touch.square**0.5))
    return joined_step(frequency, springs, dampers, *damping, room=touch.undamped)


def bodies_followed(bodies: Bodies) -> list[str]:
    """Return the bodies whose shape the step follows: in large strain, of a law with a memory."""
    if bodies.scene.time.follow_shape is False:
        return []
    entries = bodies.scene.bodies
    return [n for n in bodies.memory_laws if entries[n].kinematics == "total-lagrangian"]


def first_step(bodies: Bodies, bound: float) -> tuple[float, float | None]:
    """Return the step that a run begins with [s], and the time between looks at the shape.

    Outputs fall on steps; so do looks, a whole number of which is made from output to output. None
    where the step stays as it is.

    Args:
        bodies: Bodies with their forms.
        bound: Bound of the step [s].
    """
    time = bodies.scene.time
    limit = time.safety * bound
    if not bodies_followed(bodies):
        return float(time.output_interval / np.ceil(time.output_interval / limit)), None
    span = time.output_interval / max(1, round(time.output_interval / (LOOK * limit)))
    return even_step(span, limit), span


def even_step(span: float, limit: float) -> float:
    """Return the longest step up to a limit that a span is a whole number of [s]."""
    return float(span / np.ceil(span / limit * (1 - 1e-12)))  # round-off decides nothing


def damped_bound(
    bodies: Bodies,
    mass: Array,
    attachments: tuple[Attached, Attached],
    damping: tuple[float, float],
    dt: float,
    room: float,
    contact: float,
    iterations: int = 3,
) -> float:
    """Return a longer stable step than ``dt`` where dampers sit on other nodes than the stiffest.

    ``dt < 2 √room / ω`` with ω of ``K + 2/dt C`` is stable, and its right side grows with dt: from
    a stable step on, each iterate is stable too.

    Args:
        bodies: Bodies with their forms.
        mass: Lumped mass of every local scalar dof [kg].
        attachments: Springs and dampers.
        damping: Largest stiffness- and mass-proportional damping [s], [1/s].
        dt: A stable step [s].
        room: As in :func:`forms.springs.step_bound.joined_step`.
        contact: Bound of K/M of contact springs that do not depend on the step [1/s²].
        iterations: Lanczos runs.
    """
    beta, alpha = damping
    for _ in range(iterations):
        lagged = as_springs(*attachments, dt)
        work = bodies.internal_work
        frequency, sharp = assembled_frequency(bodies.domain.V, work, mass, lagged.nodal)
        if not sharp:
            return dt
        square = (frequency**2 + contact) * (1 + 2 * beta / dt) + 2 * alpha / dt
        longer = 2 * np.sqrt(room / joined(square, lagged, held=True))
        if longer < 1.01 * dt:
            return float(max(dt, longer))
        dt = float(longer)
    return dt


def contact_terms(bodies: Bodies, mass: Array, log: Callable[[str], Any]) -> ContactTerms:
    """Return what the contacts ask of the step; a line to ``log`` where no step can be stable.

    Args:
        bodies: Bodies of the scene.
        mass: Lumped mass of every local scalar dof [kg].
        log: Called with the line.
    """
    room, undamped, square, rate = 1.0, 1.0, 0.0, 0.0
    for name, contact in bodies.scene.contacts.items():
        if contact.method == "penalty":
            lag = contact.damping * contact.penalty**0.5
            share = contact.penalty / 4 + lag
            room, undamped = room - share, undamped - lag
            if share >= 1:
                log(
                    f"contacts.{name}: penalty / 4 + damping √penalty = {share:.2f}; from 1 on no "
                    "step is stable"
                )
        elif contact.method == "modulus-penalty":
            from contact.normal_law import largest_rates

            pair = contact_surfaces(bodies, contact, mass[::3])
            stiff, damped = largest_rates(*pair, contact.penalty, contact.damping)
            log(f"contacts.{name}: spring alone is stable up to {2 / stiff**0.5 * 1e9:.1f} ns")
            square, rate = square + stiff, rate + damped
    return ContactTerms(room, undamped if undamped > 0 else 1.0, square, rate)


def step_report(bodies: Bodies, mass: Array, dt: float, bound: float) -> Iterator[str]:
    """Yield lines for the log of a run: the step, what is stiffest, what shortens it; collective.

    Args:
        bodies: Bodies with their forms.
        mass: Lumped mass of every local scalar dof [kg].
        dt: Step [s].
        bound: Its bound [s].
    """
    scene, entries = bodies.scene, bodies.scene.bodies.values()
    omega, where = stiffest(bodies, mass)
    yield (
        f"audit: step {dt * 1e9:.1f} ns of at most {bound * 1e9:.1f} ns "
        f"({scene.time.bound} bound); the stiffest motion, 2/ω = {2 / omega * 1e9:.1f} ns, is in "
        f"{where}"
    )
    if scene.contacts and scene.time.bound == "assembled":
        p = sum(c.penalty for c in scene.contacts.values() if c.method == "penalty")
        left = np.sqrt(max(1 - p / 4, 0.0))
        yield f"audit: contact penalties, {p:.2g} of 4, shorten the step to {left:.1%}"
    beta, alpha = (
        max(getattr(b, k) for b in entries) for k in ("stiffness_damping", "mass_damping")
    )
    if alpha or beta:
        share = stable_step(omega, beta, alpha) * omega / 2
        yield (
            f"audit: damping shortens the step to {share:.1%} (stiffness {beta:.2g} s, mass "
            f"{alpha:.2g} 1/s)"
        )


def stiffest(bodies: Bodies, mass: Array) -> tuple[float, str]:
    """Return frequency [rad/s] and place, in words, of the stiffest motion of the bodies alone.

    It is found by some products with the scene's own stiffness, a moment beside the run. Its place
    is that of its largest displacement; its frequency is from below.

    Args:
        bodies: Bodies with their forms.
        mass: Lumped mass of every local scalar dof [kg].
    """
    domain = bodies.domain
    V, n = domain.V, 3 * domain.owned
    comm: MPI.Comm = domain.msh.comm
    u, q, w = fem.Function(V), fem.Function(V), ufl.TestFunction(V)
    kernel = CellKernel(ufl.derivative(bodies.internal_work(u, w), u, q))
    scale, out = 1 / np.sqrt(mass[:n]), la.vector(V.dofmap.index_map, 3)
    x = np.random.default_rng(1).standard_normal((len(domain.source.points), 3))
    x = x[domain.nodes[: domain.owned]].ravel()
    value = 0.0
    for _ in range(PRODUCTS):
        x /= np.sqrt(comm.allreduce(float(x @ x)))
        q.x.array[:n] = scale * x
        q.x.scatter_forward()
        out.array[:] = 0.0
        kernel.add(out)
        out.scatter_reverse(la.InsertMode.add)
        y = scale * out.array[:n]
        value, x = comm.allreduce(float(x @ y)), y
    size = (x.reshape(-1, 3) ** 2).sum(axis=1)
    top = int(np.argmax(size)) if len(size) else -1
    here = (float(size[top]), place(domain, bodies.scene, top)) if len(size) else (-1.0, "")
    return float(np.sqrt(value)), max(comm.allgather(here))[1]
