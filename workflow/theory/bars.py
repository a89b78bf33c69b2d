# SPDX-License-Identifier: LGPL-3.0-or-later
"""Impact of slender bars: on a rigid wall, and on each other."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from contact.theory.closed_forms import bar_impact
from meshes.arrays import Array
from workflow.results.record import Record
from workflow.scene.mesh import BarMesh, BlocksMesh
from workflow.scene.scene import Scene
from workflow.scene.settings import RigidWall
from workflow.theory import readings
from workflow.theory.assumptions import (
    SLENDER,
    SMALL,
    bare,
    material,
    only_contact,
    undamped,
    velocity,
    yielding,
)
from workflow.theory.quantity import ENERGY, MOMENTUM, TAYLOR, WAVES, Expected

GONE = 1.1  # of the contact time, after which a bar has left


@dataclass(frozen=True)
class Impact:
    """Impact that sends a wave of constant stress through a bar and back.

    Attributes:
        force: Contact force [N].
        stay: Time of contact [s].
        touch: Time of the first touch [s].
        speed: Speed of approach [m/s].
        mass: Mass of the bar [kg].
    """

    force: float
    stay: float
    touch: float
    speed: float
    mass: float

    @property
    def gone(self) -> float:
        """Time from which on the bodies are apart [s]."""
        return self.touch + GONE * self.stay


def wall_impact(scene: Scene) -> Impact | None:
    """Return the impact of a bar on a rigid wall, None if it is no such scene.

    Assumes a free slender bar without damping that flies along its axis, and a wall across it.
    """
    mesh = scene.mesh
    if not isinstance(mesh, BarMesh) or mesh.length < SLENDER * mesh.width:
        return None
    if not bare(scene) or not undamped(scene) or scene.supports or scene.loads or scene.driven:
        return None
    speed, across, up = velocity(scene, "bar")
    steel = material(scene, "bar")
    contact = only_contact(scene, "xmin" if speed < 0 else "xmax")
    if not speed or across or up or steel is None or contact is None:
        return None
    gap = _gap(contact.target, mesh.length, speed)
    if gap is None:
        return None
    section = mesh.width**2
    E, rho = steel.youngs_modulus, steel.density
    if abs(speed) > SMALL * np.sqrt(E / rho):
        return None
    force, stay = bar_impact(abs(speed), E, rho, section, mesh.length)
    return Impact(force, stay, gap / abs(speed), abs(speed), rho * section * mesh.length)


def _gap(wall: RigidWall | str, length: float, speed: float) -> float | None:
    """Return the way of a bar to a wall [m], None if it does not stand across that way."""
    if not isinstance(wall, RigidWall):
        return None
    normal = np.array(wall.normal) / np.linalg.norm(wall.normal)
    gap = -wall.origin[0] if speed < 0 else wall.origin[0] - length
    return max(gap, 0.0) if normal[0] == -np.sign(speed) and gap > -1e-9 * length else None


def bar_on_wall(record: Record) -> Iterator[Expected]:
    """Answers for a bar that hits a rigid wall: see :func:`wall_impact`.

    Contact time and motion after it need a run beyond it, the force one beyond its middle.
    """
    hit, end = wall_impact(record.checked), readings.until(record)
    if hit is None:
        return
    t, force, _ = readings.forces(record)
    yield from _contact_time(t, force, hit)
    yield from _plateau(t, force, hit, "contact force on the plateau, ρ c v A", "N", 1.0)
    if end < hit.gone:
        return
    motion = readings.velocity_at_end(record, "bar")
    if motion is not None:
        start = velocity(record.checked, "bar")[0]
        yield Expected("velocity after the rebound", "m/s", float(motion[0]), -start, WAVES)
    kinetic, first = float(record.history["kinetic"][-1]), hit.mass * hit.speed**2 / 2
    yield Expected("kinetic energy after the rebound", "J", kinetic, first, ENERGY)
    (pair,) = record.checked.contacts
    deepest = float(record.history[f"{pair}_max_penetration"].max())
    yield Expected("largest penetration", "m", deepest, 0.0, WAVES)


def yielding_bar_on_wall(record: Record) -> Iterator[Expected]:
    """Answers for a bar that hits a rigid wall faster than it can bear elastically.

    An elastic wave of the yield stress runs ahead of a plastic wave, whose speed is that of the
    hardening slope: ``σ = Y + ρ c_p (v − Y / (ρ c))`` on the wall until the first reflection is
    back. Assumes a free slender bar without Poisson's effect whose hardening is linear, and a wall
    across its way (von Kármán and Duwez, J. Appl. Phys. 21, 1950, 987–994).
    """
    scene = record.checked
    mesh, steel = scene.mesh, yielding(scene, "bar")
    if not isinstance(mesh, BarMesh) or mesh.length < SLENDER * mesh.width or steel is None:
        return
    if not bare(scene) or not undamped(scene) or scene.supports or scene.loads or scene.driven:
        return
    speed, across, up = velocity(scene, "bar")
    contact = only_contact(scene, "xmin" if speed < 0 else "xmax")
    if not speed or across or up or contact is None or steel.saturation_stress:
        return
    gap = _gap(contact.target, mesh.length, speed)
    if gap is None or any(b.recall for b in steel.back_stresses):
        return
    E, rho = steel.youngs_modulus, steel.density
    hardening = steel.hardening_modulus + sum(b.modulus for b in steel.back_stresses)
    c, plastic = np.sqrt(E / rho), np.sqrt(E * hardening / (E + hardening) / rho)
    beyond = abs(speed) - steel.yield_stress / (rho * c)
    if beyond <= 0:
        return
    stress = float(steel.yield_stress + rho * plastic * beyond)
    hit = Impact(stress * mesh.width**2, 2 * mesh.length / c, gap / abs(speed), abs(speed), 0.0)
    t, force, _ = readings.forces(record)
    name = "stress on the wall, Y + ρ c_p (v − Y/(ρ c))"
    yield from _plateau(t, force, hit, name, "Pa", mesh.width**2)


COPPER = (117e9, 0.35, 8930.0, 400e6, 100e6)  # E, ν, ρ, yield stress, hardening
FLIGHT = (0.0324, 0.0032, 227.0, 80e-6)  # length, radius, speed, time


def taylor_bar(record: Record) -> Iterator[Expected]:
    """Answers for Taylor's copper bar, 32.4 mm long and 3.2 mm in radius, at 227 m/s after 80 µs.

    Assumes a bar along x that flies into a rigid frictionless wall across its way.
    """
    scene, body = record.checked, record.body
    if scene.mesh.regions != ("bar",) or body is None or not bare(scene) or not undamped(scene):
        return
    steel, contact = yielding(scene, "bar"), only_contact(scene, "face")
    if steel is None or contact is None or contact.friction or scene.loads or scene.driven:
        return
    elastic = steel.youngs_modulus, steel.poisson_ratio, steel.density
    own = (*elastic, steel.yield_stress, steel.hardening_modulus)
    if steel.back_stresses or steel.saturation_stress or not np.allclose(own, COPPER, rtol=1e-9):
        return
    X = body.points
    speed, across, up = velocity(scene, "bar")
    size = np.ptp(X[:, 0]), np.hypot(X[:, 1], X[:, 2]).max()
    if across or up or not np.allclose((*size, -speed, readings.until(record)), FLIGHT, rtol=1e-3):
        return
    x = X + record.displacement(readings.until(record))
    face = X[:, 0] < X[:, 0].min() + 1e-6 * size[0]
    rim = face & (np.hypot(X[:, 1], X[:, 2]) > 0.999 * size[1])
    yield Expected("final length", "m", float(np.ptp(x[:, 0])), 21.425e-3, TAYLOR)
    radius = float(np.hypot(x[rim, 1], x[rim, 2]).mean())
    yield Expected("radius of the face, mean along its rim", "m", radius, 7.22e-3, TAYLOR)


def two_bars(record: Record) -> Iterator[Expected]:
    """Answers for two equal bars that collide end to end.

    Assumes free slender bars of one material, length and section without damping, that move along
    their axis. Contact time and motion after it need a run beyond it.
    """
    scene = record.checked
    mesh, end = scene.mesh, readings.until(record)
    if not isinstance(mesh, BlocksMesh) or mesh.block != mesh.base:
        return
    if not bare(scene) or not undamped(scene) or scene.supports or scene.loads or scene.driven:
        return
    steel, contact = material(scene, "block"), only_contact(scene, "block_bottom", "base_top")
    width, depth, length = mesh.block
    one, other = (velocity(scene, region) for region in ("block", "base"))
    speed = other[2] - one[2]
    if steel is None or steel != material(scene, "base") or contact is None:
        return
    if speed <= 0 or any((*one[:2], *other[:2])) or length < SLENDER * max(width, depth):
        return
    E, rho = steel.youngs_modulus, steel.density
    if speed > SMALL * np.sqrt(E / rho):
        return
    force, stay = bar_impact(speed / 2, E, rho, width * depth, length)
    hit = Impact(force, stay, 0.0, speed, rho * width * depth * length)
    t, normal, _ = readings.forces(record)
    yield from _plateau(
        t, normal, hit, "contact stress on the plateau, ρ c v/2", "Pa", width * depth
    )
    yield from _contact_time(t, normal, hit)
    motions = [readings.velocity_at_end(record, region) for region in ("block", "base")]
    if end < hit.gone or motions[0] is None or motions[1] is None:
        return
    after = [float(motion[2]) for motion in motions if motion is not None]
    names = [f"velocity of the {which} bar afterwards" for which in ("upper", "lower")]
    for name, value, exact in zip(names, after, (other[2], one[2]), strict=True):
        yield Expected(name, "m/s", value, exact, WAVES)
    whole = hit.mass * (one[2] + other[2])
    yield Expected("momentum afterwards", "kg m/s", hit.mass * sum(after), whole, MOMENTUM)


def _contact_time(t: Array, force: Array, hit: Impact) -> Iterator[Expected]:
    """Time between the passages of half the plateau; from the touch if it came before a sample."""
    passed = readings.crossings(t, force, hit.force / 2)
    if not len(t) or t[-1] < hit.touch + hit.stay or force[-1] > hit.force / 2 or not len(passed):
        return
    came = passed[0] if force[0] < hit.force / 2 and len(passed) > 1 else hit.touch
    name = "contact time, 2 L/c"
    yield Expected(name, "s", float(passed[-1] - came), hit.stay, WAVES)


def _plateau(
    t: Array, force: Array, hit: Impact, name: str, unit: str, area: float
) -> Iterator[Expected]:
    """Mean force in the middle half of the contact time, over an area."""
    middle = np.abs(t - hit.touch - hit.stay / 2) < hit.stay / 4
    if middle.sum() >= 3 and t[-1] > hit.touch + 3 * hit.stay / 4:
        yield Expected(name, unit, float(force[middle].mean()) / area, hit.force / area, WAVES)
