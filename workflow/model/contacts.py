# SPDX-License-Identifier: LGPL-3.0-or-later
"""What the contacts of a scene ask of the time step, and the surfaces they are made of."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from workflow.scene.settings import Contact, RigidWall

if TYPE_CHECKING:
    from contact.surface import Surface
    from workflow.model.bodies import Bodies
    from workflow.model.model import Model

Array = npt.NDArray[np.float64]


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


def bulk_moduli(bodies: "Bodies") -> dict[int, float]:
    """Return the bulk modulus of every region tag [Pa]; that of the nearest isotropic material."""
    from workflow.model.bodies import isotropic

    moduli: dict[int, float] = {}
    for name, body in bodies.scene.bodies.items():
        constants = isotropic(bodies.materials[name])
        modulus = constants.E / (3 * (1 - 2 * constants.nu))
        moduli |= {int(tag): float(modulus) for tag in bodies.tags(body)}
    return moduli


def contact_surfaces(
    bodies: "Bodies", contact: Contact, mass: Array
) -> tuple["Surface", "Surface"]:
    """Return contactor and target of a scene entry; collective.

    Args:
        bodies: Bodies of the scene.
        contact: The entry.
        mass: Lumped mass of every local node, shape ``(n_local,)`` [kg].
    """
    from contact.surface import rigid_plane, surface

    domain = bodies.domain
    tag = domain.source.tag
    bulk = bulk_moduli(bodies) if contact.method == "modulus-penalty" else None
    contactor = surface(domain, tag(contact.contactor), mass, bulk=bulk)
    if isinstance(contact.target, RigidWall):
        wall = contact.target
        plane = rigid_plane(np.array(wall.origin), np.array(wall.normal), wall.half_width)
        return contactor, plane
    return contactor, surface(domain, tag(contact.target), mass, bulk=bulk)


def contact_terms(bodies: "Bodies", mass: Array, log: Callable[[str], Any]) -> ContactTerms:
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


def tell_offsets(model: "Model", log: Callable[[str], Any]) -> None:
    """Log which contacts overlapped at the start, where that does not count."""
    for name, pair in model.pairs.items():
        count, depth = pair.initial_offsets
        if count:
            log(f"contacts.{name}: {count} nodes overlap by up to {depth:.1e} m at first, offset")
