# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact pairs of a scene and the surfaces they are made of."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from meshes.arrays import Array
from workflow.model.apart import check_surfaces
from workflow.model.bodies import Bodies, isotropic
from workflow.model.regions import body_at
from workflow.scene import SceneError
from workflow.scene.contacts import law_of
from workflow.scene.settings import Contact, RigidWall

if TYPE_CHECKING:
    from contact.pair import ContactPair
    from contact.surface import Surface


def bulk_moduli(bodies: Bodies) -> dict[int, float]:
    """Return the bulk modulus of every region tag [Pa]; that of the nearest isotropic material."""
    moduli: dict[int, float] = {}
    for name, body in bodies.scene.bodies.items():
        constants = isotropic(bodies.materials[name])
        modulus = constants.E / (3 * (1 - 2 * constants.nu))
        moduli |= {int(tag): float(modulus) for tag in bodies.tags(body)}
    return moduli


def contact_surfaces(bodies: Bodies, contact: Contact, mass: Array) -> tuple["Surface", "Surface"]:
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


def pair(bodies: Bodies, key: str, mass: Array, dt: float, friction: Any = None) -> "ContactPair":
    """Return the contact pair of a scene entry.

    Args:
        bodies: Bodies of the scene.
        key: Name of the entry.
        mass: Lumped mass of every local dof, shape ``(3 n_local,)`` [kg].
        dt: Step [s].
        friction: A law in place of the scene's own.

    Raises:
        SceneError: if ``friction``, a coefficient, table or law, cannot be used.
    """
    from contact.pair import ContactPair

    contact = bodies.scene.contacts[key]
    try:
        law = law_of(contact.friction if friction is None else friction)
    except ValueError as error:
        raise SceneError(f"contacts.{key}.friction: {error}") from error
    contactor, target = contact_surfaces(bodies, contact, mass[::3])
    return ContactPair(
        contactor,
        target,
        comm=bodies.domain.msh.comm,
        dt=dt,
        friction=law,
        penalty=contact.penalty,
        damping=contact.damping,
        method=contact.method,
        smooth=contact.smooth,
        sharp_angle=contact.sharp_angle,
        initial_overlap=contact.initial_overlap,
        offset_time=contact.offset_time,
        two_pass=contact.two_pass,
        points=contact.points,
        name=key,
    )


def checked_pair(
    bodies: Bodies, key: str, mass: Array, dt: float, friction: Any = None
) -> tuple["ContactPair", list[str]]:
    """Return a contact pair, its surfaces checked, and what is doubtful about it.

    Arguments as for :func:`pair`.

    Raises:
        SceneError: as :func:`pair`; if bodies overlap at the start or share nodes, or cannot meet.
    """
    found = pair(bodies, key, mass, dt, friction)
    sides = [(one.contactor, one.target) for one in found.passes]
    doubts = list(check_surfaces(bodies.scene, bodies.domain.source, key, sides))
    return found, [*doubts, *_slip_waves(bodies, key, *sides[0])]


def _slip_waves(bodies: Bodies, key: str, contactor: "Surface", target: "Surface") -> Iterator[str]:
    """Yield a line if friction makes waves between two unlike bodies grow."""
    if target.rigid or bodies.scene.contacts[key].friction == 0.0:
        return
    from contact.theory.slip_waves import HalfSpace, slip_wave  # for friction of two bodies

    pair = []
    for side in (contactor, target):
        body = body_at(bodies.scene, bodies.domain.source, int(side.nodes[0]))
        m = isotropic(bodies.materials[body])
        pair.append(HalfSpace(m.E / (2 * (1 + m.nu)), m.nu, m.rho))
    if pair[0] != pair[1] and (speed := slip_wave(*pair)) is not None:
        yield (
            f"contacts.{key}.friction: the bodies carry slip waves of {speed:.0f} m/s, which any "
            "Coulomb friction makes grow, the shorter the faster, without limit as cells shrink "
            "(Ranjith and Rice, 2001); friction with memory or damping bounds it"
        )
