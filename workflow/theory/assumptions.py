# SPDX-License-Identifier: LGPL-3.0-or-later
"""Assumptions of closed forms, looked up in a scene: what acts on its bodies, what holds them."""

from workflow.scene.bodies import ElastoPlastic, Isotropic
from workflow.scene.scene import Scene
from workflow.scene.settings import Contact, Load

SMALL = 0.01  # strain, speed over that of waves, up to which waves are linear
SLENDER = 10.0  # least length over width of a bar whose waves are one-dimensional


def bare(scene: Scene) -> bool:
    """Whether nothing acts on the bodies but contact, loads, held and driven surfaces."""
    others = (scene.springs, scene.absorbing, scene.rolling, scene.vehicle, scene.track)
    moved = any(support.velocity for support in scene.supports)
    return not (any(others) or moved or any(scene.gravity or ()))


def undamped(scene: Scene) -> bool:
    """Whether neither material nor contact takes energy from waves."""
    bodies = scene.bodies.values()
    if any(b.stiffness_damping or b.mass_damping or b.bulk_viscosity for b in bodies):
        return False
    return not any(contact.damping for contact in scene.contacts.values())


def material(scene: Scene, region: str) -> Isotropic | None:
    """Return the material of a region, None if it is not isotropic."""
    for body in scene.bodies.values():
        if region in [name.lower() for name in body.regions]:
            return body.material if isinstance(body.material, Isotropic) else None
    return None


def yielding(scene: Scene, region: str) -> ElastoPlastic | None:
    """Return the material of a region if it yields, else None."""
    own = scene.bodies[body_of(scene, region)].material
    return own if isinstance(own, ElastoPlastic) else None


def body_of(scene: Scene, region: str) -> str:
    """Return the name of the body that a region belongs to."""
    return next(
        name
        for name, body in scene.bodies.items()
        if region in [entry.lower() for entry in body.regions]
    )


def velocity(scene: Scene, region: str) -> tuple[float, float, float]:
    """Return the velocity at which the body of a region starts [m/s]."""
    return scene.bodies[body_of(scene, region)].velocity or (0.0, 0.0, 0.0)


def held(scene: Scene, surface: str) -> set[str]:
    """Return the directions in which supports at rest hold a surface."""
    return {d for s in scene.supports if s.surface == surface for d in s.directions}


def only_contact(scene: Scene, contactor: str, target: str | None = None) -> Contact | None:
    """Return the one contact of a scene if it is on these surfaces; on a rigid wall without one."""
    if len(scene.contacts) != 1:
        return None
    (contact,) = scene.contacts.values()
    on = contact.target if isinstance(contact.target, str) else None
    if contact.contactor == contactor and on == target:
        return contact
    return (
        contact if target is not None and (contact.contactor, on) == (target, contactor) else None
    )


def coulomb(contact: Contact) -> float | None:
    """Return the coefficient of friction of a contact, None if it is a law."""
    return contact.friction if isinstance(contact.friction, float) else None


def pressed(scene: Scene) -> float | None:
    """Return the pressure of the one load of a scene, on its top [Pa]; None if there is another."""
    if len(scene.loads) != 1 or scene.loads[0].surface != "zmax":
        return None
    if pushed(scene.loads[0]) or scene.loads[0].travelling:
        return None
    along, across, up = scene.loads[0].traction
    return -up if up < 0 and not (along or across) else None


def pushed(load: Load) -> bool:
    """Whether a load has a pressure along the normal, comes up within a time, or is a blow."""
    return bool(load.pressure or load.ramp or load.hammer)
