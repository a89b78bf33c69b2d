# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rigid point masses on springs and dampers to the ground: sprung mass, sleepers."""

from dataclasses import dataclass, field

import numpy as np

from meshes.arrays import Array


@dataclass
class PointMasses:
    """Rigid point masses that move with the central-difference step of the bodies.

    Attributes:
        mass: Mass of each, shape ``(m,)`` [kg].
        gravity: Acceleration of gravity, shape ``(3,)`` [m/s²].
        free: 1 where a component may move, 0 where it keeps its velocity, shape ``(m, 3)``.
        base: Stiffness and damping of each to the ground, shapes ``(m, 3)`` [N/m], [N s/m].
        u, v: Displacement at t and velocity at t − dt/2, shape ``(m, 3)`` [m], [m/s].
        force: Force of this step, shape ``(m, 3)`` [N].
        work: Done so far by what keeps components at their velocity [J].
    """

    mass: Array
    gravity: Array
    free: Array
    base_stiffness: Array
    base_damping: Array
    u: Array = field(init=False)
    v: Array = field(init=False)
    force: Array = field(init=False)
    dissipation: float = 0.0
    work: float = 0.0
    _damping: Array = field(init=False, repr=False)
    _kept: Array | None = field(default=None, init=False, repr=False)

    def __post_init__(self) -> None:
        self.u = np.zeros((len(self.mass), 3))
        self.v = np.zeros_like(self.u)
        self.force = np.zeros_like(self.u)
        self._damping = np.zeros_like(self.u)

    def take(self, force: Array, dt: float) -> None:
        """Take the force of this step ``(m, 3)`` [N], ``dt`` [s] after that of the last one."""
        kept = (self.free - 1) * force
        if self._kept is not None:
            self.work += damper_work(self._kept, kept, self.v, dt)
        self._kept = kept
        self.force[:] = force

    def base_force(self) -> Array:
        """Weight and force of the springs and dampers to the ground, shape ``(m, 3)`` [N]."""
        self._damping = self.base_damping * self.v
        return self.mass[:, None] * self.gravity - self.base_stiffness * self.u - self._damping

    @property
    def acceleration(self) -> Array:
        """Acceleration under the force of this step, shape ``(m, 3)`` [m/s²]."""
        return self.free * self.force / self.mass[:, None]

    def back(self, dt: float) -> None:
        """Take the velocity back by ``dt`` [s]: at the start it is given at t, not t − dt/2."""
        self.v -= dt * self.acceleration

    def step(self, dt: float) -> None:
        """Kick and drift over ``dt`` [s]."""
        self.v += dt * self.acceleration
        self.u += dt * self.v
        self.dissipation += damper_work(self._damping, self.base_damping * self.v, self.v, dt)

    def stored_energy(self) -> float:
        """Energy of the springs to the ground less the work of gravity [J]."""
        return float(
            (self.base_stiffness * self.u**2).sum() / 2
            - (self.mass[:, None] * self.gravity * self.u).sum()
        )

    def kinetic_energy(self, dt: float) -> float:
        """Kinetic energy ``m v₋ · v₊ / 2`` of the two half-step velocities [J]."""
        after = self.v + dt * self.acceleration
        return float((self.mass[:, None] * self.v * after).sum() / 2)


def damper_work(before: Array, force: Array, rate: Array, dt: float) -> float:
    """Energy taken by dampers, or work of other forces, over a step [J].

    Half the forces at its two ends times the way ``dt · rate`` between them: counted like this, the
    ledger of a linear problem closes to round-off.

    Args:
        before: Damper force at the start of the step [N].
        force: Damper force at its end, that of ``rate`` [N].
        rate: Velocity in the middle of the step [m/s].
        dt: Step [s].
    """
    return dt * float(np.vdot(before + force, rate)) / 2
