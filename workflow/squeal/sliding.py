# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contacts of a scene that slide: where they are, what they bear, how fast they slip."""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from contact.one_pass import Pass
from contact.sliding import Sliding, sliding
from meshes.arrays import Array, Index
from workflow.model import Model
from workflow.model.regions import body_at, surface_nodes
from workflow.model.supports import axle, supports
from workflow.scene.scene import SceneError
from workflow.simulation.initial import set_in_motion


@dataclass(frozen=True, eq=False)
class Face:
    """One pass of a contact in steady sliding.

    Attributes:
        name: Contact of the scene.
        contacts: Its contacts.
        patch: Patch of each, from 0, shape ``(m,)``.
        sticks: Whether it was told to stick.
    """

    name: str
    contacts: Sliding
    patch: Index
    sticks: bool

    @property
    def patches(self) -> int:
        """Number of its patches."""
        return int(self.patch.max(initial=-1)) + 1


def in_motion(model: Model) -> None:
    """Set the velocities of the start, bodies on moved supports with the speed they come to."""
    set_in_motion(model)
    v = model.state.v.x
    for entry in model.scene.supports:
        if entry.velocity:
            node = int(surface_nodes(model.domain, entry.surface)[0])
            n = supports([entry], model.scene, model.domain).directions[0]
            dofs = model.bodies.dofs(body_at(model.scene, model.domain.source, node))
            v.array.reshape(-1, 3)[dofs] += entry.velocity * n
    v.scatter_forward()


def faces(
    model: Model, slip: Array | None, sticking: Collection[str], drift: Array | None = None
) -> list[Face]:
    """Return the contacts of the present state that bear forces; collective.

    Args:
        model: The model.
        slip: Velocity of contactors against targets, instead of that of the state [m/s].
        sticking: Contacts that stick.
        drift: Velocity of contactors besides [m/s].

    Raises:
        SceneError: if nothing touches or slides.
    """
    found = []
    for name, pair in model.pairs.items():
        for side in pair.passes:
            try:
                on = sliding(side, model.state, model.scene.time.end, slip, drift)
            except ValueError as error:
                raise SceneError(
                    f"contacts.{name}: {error} at the start of the run; expected a velocity of "
                    "bodies.NAME or driven.NAME, or a slip by --slip VX,VY,VZ"
                ) from error
            if name in sticking:
                on = on.stuck(side.options.tangential)
            if len(on.number):
                found.append(Face(name, on, patches_of(side, on.number), name in sticking))
    if not found:
        raise SceneError(
            f"squeal: none of the contacts {', '.join(model.pairs)} touches at rest; expected "
            "loads, or an equilibrium.approach, that press the bodies together"
        )
    return found


def drift_at(model: Model, angle: float) -> Array:
    """Return what the wheel moves sideways besides at another angle of attack, ``(3,)`` [m/s].

    A wheel that rolls along the rail with its plane turned by the angle slides across it at
    ``V tan(angle)``. What it slides already is the speed of the support that leads its axle.

    Args:
        model: A wheel on a rail.
        angle: Angle of attack [rad].
    """
    rolling, scene = model.scene.rolling, model.scene
    assert rolling is not None
    led = sum(s.velocity for s in scene.supports if s.velocity and "axle" in s.directions)
    return np.asarray(-(rolling.speed * np.tan(angle) + led) * axle(scene))


def patches_of(side: Pass, number: Index) -> Index:
    """Return the patch of each contact of a pass, shape ``(m,)``."""
    foot, on = side.footprint(), side.pressed().c
    patch = np.zeros(len(side.contactor.nodes), dtype=np.int64)
    patch[on] = foot.patch
    return patch[side.stack.nearest[number]]


def friction_of(model: Model, found: list[Face]) -> Array:
    """Return the friction of sliding contacts on the owned dofs, shape ``(3 owned,)`` [N]."""
    force = np.zeros((model.domain.owned, 3))
    for c in (face.contacts for face in found):
        pull = -(c.friction * c.normal_force)[:, None] * c.along
        nodes = c.nodes.ravel()
        dofs = np.where(nodes >= 0, model.domain.local_dofs(nodes), -1)
        share = (c.weight[:, :, None] * pull[:, None]).reshape(-1, 3)
        np.add.at(force, dofs[dofs >= 0], share[dofs >= 0])
    return force.ravel()
