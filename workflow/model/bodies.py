# SPDX-License-Identifier: LGPL-3.0-or-later
"""Forms of the bodies of a scene: internal work, energies, viscosity; and the stable step."""

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
import ufl

from forms import elements
from forms.arrays import Array
from forms.cells import one_point
from forms.elasticity import Elastic, exact, full
from forms.elements import LAWS, Law
from forms.springs.connections import Connections
from forms.springs.step_bound import NONE, Attached, as_springs, attached, joined, joined_step
from forms.time_step import assembled_frequency, cell_frequency
from forms.viscosity import bulk_viscosity, damped_step, tangent_viscosity
from meshes.domain import Domain
from workflow.model.contacts import contact_terms
from workflow.model.geometry import cell_size
from workflow.scene.bodies import Body, Isotropic
from workflow.scene.scene import Scene, SceneError


class Bodies:
    """Materials and laws of the bodies of a scene, and the forms made of them.

    Attributes:
        scene: The scene.
        domain: The distributed mesh.
        dx: Volume measure with full quadrature and the region tags.
        materials: Elastic constants by body name.
        laws: Material law by body name.
    """

    def __init__(self, scene: Scene, domain: Domain, laws: Mapping[str, Law] | None = None) -> None:
        self.scene, self.domain = scene, domain
        self.dx = full(domain.msh, domain.regions)
        entries = scene.bodies.items()
        self.materials = {name: b.material.constants(b.stiffness_damping) for name, b in entries}
        self.laws = {name: law(body) for name, body in entries} | dict(laws or {})

    def tags(self, body: Body) -> tuple[int, ...]:
        """Return the region tags of the mesh that make a body."""
        return self.domain.source.tags(body.regions)

    def internal_work(self, u: Any, w: Any, v: Any = None) -> Any:
        """Return the form of the internal virtual work; damped if a velocity ``v`` is given."""
        return sum(
            elements.internal_work(
                body.element,
                self.laws[name],
                u,
                w,
                self.materials[name],
                self.dx(self.tags(body)),
                v if body.stiffness_damping else None,
                coefficient=body.hourglass_coefficient,
            )
            for name, body in self.scene.bodies.items()
        )

    def strain_energy(self, u: Any) -> Any:
        """Return the form of the strain energy, without that of hourglass control."""
        return sum(
            elements.strain_energy(
                body.element, self.laws[name], u, self.materials[name], self.dx(self.tags(body))
            )
            for name, body in self.scene.bodies.items()
        )

    def hourglass_energy(self, u: Any) -> Any:
        """Return the form of the energy of hourglass control, None without such elements."""
        forms = [
            elements.control_energy(
                self.laws[name],
                u,
                self.materials[name],
                self.dx(self.tags(body)),
                coefficient=body.hourglass_coefficient,
            )
            for name, body in self.scene.bodies.items()
            if body.element == "one-point"
        ]
        return sum(forms) if forms else None

    def viscous_work(self, u: Any, v: Any, w: Any) -> Any:
        """Return the form of the bulk viscosity's virtual work, None without viscosity."""
        forms = [
            bulk_viscosity(
                u,
                v,
                w,
                isotropic(self.materials[name]),
                linear=body.bulk_viscosity.linear,
                quadratic=body.bulk_viscosity.quadratic,
                rotating=self.laws[name].rotating,
            )
            * one_point(self.dx(self.tags(body)))
            for name, body in self.scene.bodies.items()
            if body.bulk_viscosity
        ]
        return sum(forms) if forms else None

    def damping_work(self, v: Any, w: Any) -> Any:
        """Return a linear form that bounds all material damping, at the scene's own speeds.

        For the quadratic viscosity a cell is taken to be closed by the whole difference of the
        bodies' initial velocities.
        """
        start = [b.velocity or (0.0, 0.0, 0.0) for b in self.scene.bodies.values()]
        closing = max(np.linalg.norm(np.subtract(a, b)) for a in [*start, (0, 0, 0)] for b in start)
        forms = []
        for name, body in self.scene.bodies.items():
            dx, constants = self.dx(self.tags(body)), self.materials[name]
            if body.bulk_viscosity:
                viscous = tangent_viscosity(
                    v,
                    w,
                    isotropic(constants),
                    linear=body.bulk_viscosity.linear,
                    quadratic=body.bulk_viscosity.quadratic,
                    rate=float(closing) / cell_size(self.scene, self.domain.source),
                )
                forms.append(viscous * one_point(dx, mixed=body.element != "one-point"))
            if body.stiffness_damping:
                work = elements.internal_work(
                    body.element,
                    self.laws[name],
                    v,
                    w,
                    constants,
                    dx,
                    coefficient=body.hourglass_coefficient,
                )
                forms.append(body.stiffness_damping * work)
        return sum(forms)

    def mass(self, w: Any) -> Any:
        """Return the form whose vector is the lumped mass."""
        ones, dm = ufl.as_vector([1.0, 1.0, 1.0]), exact(self.domain.msh, self.domain.regions)
        return sum(
            self.materials[name].rho * ufl.inner(ones, w) * dm(self.tags(body))
            for name, body in self.scene.bodies.items()
        )

    def doubts(self) -> Iterator[str]:
        """Yield a line for every choice that is allowed but known to be inaccurate."""
        for name, body in self.scene.bodies.items():
            m, coefficient = body.material, body.hourglass_coefficient
            if coefficient and isinstance(m, Isotropic) and m.poisson_ratio > 0.45:
                yield (
                    f"bodies.{name}: a hourglass_coefficient locks at poisson_ratio = "
                    f"{m.poisson_ratio}; without it the stiffness of the material is taken"
                )


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


def law(body: Body) -> Law:
    """Return the material law of a body; that of its kinematics for linear materials.

    Raises:
        SceneError: if the law is not in :data:`forms.elements.LAWS`.
    """
    linear = body.material.law in ("hooke", "orthotropic")
    name = body.kinematics if linear else body.material.law
    if name not in LAWS:
        raise SceneError(f"material.law = {name!r}: expected one of {['hooke', *LAWS]}")
    return LAWS[name]


def isotropic(constants: Any) -> Elastic:
    """Return the constants themselves, or the nearest isotropic ones."""
    return getattr(constants, "isotropic", constants)
