# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contacts of a pass in steady slip, and what small motions do to their forces.

A contact that slides in direction t at speed s bears ``F = p (n - f t)`` with the friction
coefficient f(s, p). A small relative motion w changes that by

    δF = -(n - (f + p ∂f/∂p) t) (k n·w + c n·ẇ) - p ∂f/∂s t t·ẇ - (f p / s) b b·ẇ

with ``b = n × t``: friction feeds normal motion into t, its slope damps or excites along t, and
the turning of the slip damps across it. Contacts that stick have the spring ``k_t`` along t and b.

Left out: the turning of n with the facet, the couple that balances the moment of the gap, and the
memory of a law, whose slope acts at once.
"""

from dataclasses import dataclass, replace

import numpy as np

from contact.arrays import State
from contact.friction import Law, LawState, coefficients
from contact.one_pass import Pass
from meshes.arrays import Array, Index

NUDGE = 1e-4  # of slip rate and pressure, for the slopes of a law
STILL = 1e-9  # m/s: slower contacts have no direction of slip


@dataclass(frozen=True, eq=False)
class Sliding:
    """Contacts that bear forces; the same on all ranks.

    Attributes:
        number: Contactor node or point of each, shape ``(m,)``.
        nodes: HexMesh nodes that it joins: contactor, then facet; negative for rigid ones,
            shape ``(m, n)``.
        weight: Their weights in the gap, shape ``(m, n)``.
        normal: Normals of the target n, shape ``(m, 3)``.
        along: Directions of slip of the contactor t, any tangent if it sticks, shape ``(m, 3)``.
        speed: Slip rates s, zero where it sticks, shape ``(m,)`` [m/s].
        normal_force: Forces p, shape ``(m,)`` [N].
        stiffness: Normal springs k, shape ``(m,)`` [N/m].
        tangential: Tangential springs where it sticks, zero else, shape ``(m,)`` [N/m].
        damper: Normal dampers c, shape ``(m,)`` [N s/m].
        friction: Coefficients f, zero where it sticks, shape ``(m,)``.
        steepness: Change of the friction force with the normal force, f + p ∂f/∂p, ``(m,)``.
        slope: ∂f/∂s, shape ``(m,)`` [s/m].
    """

    number: Index
    nodes: Index
    weight: Array
    normal: Array
    along: Array
    speed: Array
    normal_force: Array
    stiffness: Array
    tangential: Array
    damper: Array
    friction: Array
    steepness: Array
    slope: Array

    @property
    def across(self) -> Array:
        """Tangents at right angles to the slip, b = n × t, shape ``(m, 3)``."""
        return np.cross(self.normal, self.along)

    @property
    def turning(self) -> Array:
        """Dampers across the slip, f p / s, shape ``(m,)`` [N s/m]."""
        slides = self.speed > 0.0
        return self.friction * self.normal_force / np.where(slides, self.speed, np.inf)

    def stuck(self, tangential: float) -> "Sliding":
        """Return the same contacts in stick, with springs of ``tangential`` times the normal ones.

        They keep their normal forces.
        """
        none = np.zeros_like(self.speed)
        return replace(
            self,
            speed=none,
            friction=none,
            steepness=none,
            slope=none,
            tangential=tangential * self.stiffness,
        )


def sliding(
    side: Pass, state: State, t: float, slip: Array | None = None, drift: Array | None = None
) -> Sliding:
    """Return the contacts of a pass that bear forces in the present state; collective.

    Args:
        side: One pass of a contact.
        state: Displacement at rest, and the velocities of the sliding bodies.
        t: Time at which the law of friction is taken [s].
        slip: Velocity of the contactor against the target in place of that of ``state``, of which
            each contact has the part along its target, shape ``(3,)`` [m/s].
        drift: Velocity of the contactor besides, shape ``(3,)`` [m/s].

    Raises:
        ValueError: if a contact has no slip, or the law does not hold there.
    """
    springs = side.springs_at_rest(state)
    h, on = side.contact_state, springs.gap < 0.0
    c, normal = springs.number[on], springs.normal[on]
    along, speed = slips(side, c, normal, state, slip, drift)
    if (still := speed < STILL).any():
        raise ValueError(f"{still.sum()} of {len(c)} contacts do not slide")
    force = springs.stiffness[on] * -springs.gap[on]
    friction, steepness, slope = slopes(
        side.options.law, speed, force, side.stack.area[c], side.stack.node[c], t
    )
    return Sliding(
        number=c,
        nodes=springs.nodes[on],
        weight=springs.weight[on],
        normal=normal,
        along=along,
        speed=speed,
        normal_force=force,
        stiffness=springs.stiffness[on],
        tangential=np.zeros_like(force),
        damper=h.damper[c],
        friction=friction,
        steepness=steepness,
        slope=slope,
    )


def slips(
    side: Pass,
    c: Index,
    normal: Array,
    state: State,
    slip: Array | None = None,
    drift: Array | None = None,
) -> tuple[Array, Array]:
    """Return directions of slip, zero where there is none, and slip rates [m/s]; collective.

    Args:
        side: One pass of a contact.
        c: Contacts, shape ``(m,)``.
        normal: Normals of the target, shape ``(m, 3)``.
        state: As for :func:`sliding`.
        slip: As there.
        drift: As there.
    """
    w = side.velocity(c, state) if slip is None else np.broadcast_to(slip, normal.shape)
    w = w if drift is None else w + drift
    w = w - np.einsum("ma,ma->m", w, normal)[:, None] * normal
    speed = np.linalg.norm(w, axis=1)
    return w / np.maximum(speed, 1e-300)[:, None], speed


def slopes(
    law: Law, speed: Array, force: Array, area: Array, node: Index, t: float
) -> tuple[Array, Array, Array]:
    """Return coefficient f, f + p ∂f/∂p and ∂f/∂s [s/m] of a law in steady slip.

    Args:
        law: The law; one with memory has had the time to follow.
        speed: Slip rates, shape ``(m,)`` [m/s].
        force: Normal forces, shape ``(m,)`` [N].
        area: Areas that they act on, shape ``(m,)`` [m²].
        node: HexMesh nodes, shape ``(m,)``.
        t: Time [s].
    """
    state = LawState(t, 1e-9, node, np.full(len(speed), np.nan))

    def at(rate: float, press: float) -> Array:
        return coefficients(law, rate * speed, press * force / area, state)

    up, down = 1 + NUDGE, 1 - NUDGE
    by_speed = (at(up, 1.0) - at(down, 1.0)) / (2 * NUDGE * speed)
    by_pressure = (at(1.0, up) - at(1.0, down)) / (2 * NUDGE)  # times p
    friction = at(1.0, 1.0)
    return friction, friction + by_pressure, by_speed
