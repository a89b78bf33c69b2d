# SPDX-License-Identifier: LGPL-3.0-or-later
"""Blocks on a base or a plane: uniform pressure, sliding to rest, stick-slip, slip weakening."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from contact.theory.closed_forms import (
    sliding_stop,
    slip_weakening_work,
    stick_slip_period,
)
from workflow.results.record import Record
from workflow.scene.contacts import Exponential
from workflow.scene.mesh import BarMesh, BlocksMesh
from workflow.scene.scene import Scene
from workflow.scene.settings import RigidWall
from workflow.theory import readings
from workflow.theory.assumptions import (
    bare,
    coulomb,
    held,
    material,
    only_contact,
    pressed,
    pushed,
    velocity,
)
from workflow.theory.quantity import COULOMB, STATICS, WEAKENING, Expected

SLIDING = (0.1, 0.85)  # of the time until a block stops, over which its friction is averaged
STOPPED = 1.2  # of that time, after which it has stopped
SUDDEN = 0.01  # of the speed of the pull, at which friction in a jump has fallen for good
SLIPPED = 10.0  # times the slip over which friction falls, that a sole slips at least


def contact_patch(record: Record) -> Iterator[Expected]:
    """Answers for two blocks of one section that are pressed on each other: uniform pressure.

    Assumes rest, one load on the top, the lower block held from below and free sides, and no
    friction or the same material on both.
    """
    scene, mesh, load = record.checked, record.checked.mesh, pressed(record.checked)
    contact = only_contact(scene, "block_bottom", "base_top")
    if not isinstance(mesh, BlocksMesh) or load is None or contact is None or scene.driven:
        return
    alike = material(scene, "block") == material(scene, "base") is not None
    still = scene.equilibrium and not any(b.velocity for b in scene.bodies.values())
    both = [s for s, o in (("xmin", "xmax"), ("ymin", "ymax")) if held(scene, s) and held(scene, o)]
    if not bare(scene) or not still or both or mesh.block[:2] != mesh.base[:2]:
        return
    if "z" not in held(scene, "base_bottom") or not (alike or coulomb(contact) == 0):
        return
    patch = readings.patch_at_end(record)
    if patch is None:
        return
    pressure, share = patch.pressure, patch.areas / patch.area
    rms = float(np.sqrt(share @ (pressure / load - 1) ** 2))
    yield Expected("nodal pressure off the uniform one, rms over it", "1", rms, 0.0, STATICS)
    yield Expected("largest nodal pressure", "Pa", float(pressure.max()), load, STATICS)
    whole = load * mesh.block[0] * mesh.block[1]
    yield Expected("normal force", "N", patch.normal_force, whole, STATICS)


@dataclass(frozen=True)
class Slide:
    """A block thrown along a base that slides to rest.

    Attributes:
        load: Normal force [N].
        friction: Coefficient of friction [-].
        mass: Mass of the block [kg].
        speed: Its speed at the start along x [m/s].
        way: Way until it stops [m].
        stop: Time until then [s].
    """

    load: float
    friction: float
    mass: float
    speed: float
    way: float
    stop: float


def sliding(scene: Scene) -> Slide | None:
    """Return how a block slides to rest, None if it is no such scene.

    Assumes constant friction, one load on the top, a start along x from rest under that load, a
    base that is held from below, and room on it.
    """
    mesh, load = scene.mesh, pressed(scene)
    contact = only_contact(scene, "block_bottom", "base_top")
    steel = material(scene, "block")
    if not isinstance(mesh, BlocksMesh) or load is None or contact is None or steel is None:
        return None
    (speed, across, up), friction = velocity(scene, "block"), coulomb(contact)
    if not speed or across or up or not friction or any(velocity(scene, "base")):
        return None
    if not bare(scene) or not scene.equilibrium or scene.driven:
        return None
    others = {s.surface for s in scene.supports} - {"base_bottom"}
    if others or not {"x", "z"} <= held(scene, "base_bottom"):
        return None
    length, width, height = mesh.block
    pressing, mass = load * length * width, steel.density * length * width * height
    way, stop = sliding_stop(abs(speed), friction, pressing / mass)
    room = way < (mesh.base[0] - length) / 2
    return Slide(pressing, friction, mass, speed, way, stop) if room else None


def sliding_block(record: Record) -> Iterator[Expected]:
    """Answers for a block that slides to rest: see :func:`sliding`.

    Friction needs a run to ``SLIDING`` of the time until it stops, the stop one a little beyond.
    """
    slide, end = sliding(record.checked), readings.until(record)
    if slide is None or end < SLIDING[1] * slide.stop:
        return
    t, _, tangential = readings.forces(record)
    steady = (t > SLIDING[0] * slide.stop) & (t < SLIDING[1] * slide.stop)
    limit = slide.friction * slide.load
    force = float(abs(tangential[steady, 0].mean()))
    yield Expected("friction force", "N", force, limit, COULOMB)
    motion = readings.moved(record, "block", "velocity")
    if motion is not None:
        t, speed = motion[0], motion[1][:, 0] * np.sign(slide.speed)
        steady = (t > SLIDING[0] * slide.stop) & (t < SLIDING[1] * slide.stop)
        slope = -float(np.polyfit(t[steady], speed[steady], 1)[0])
        yield Expected("deceleration", "m/s^2", slope, limit / slide.mass, COULOMB)
    if end < STOPPED * slide.stop:
        return
    place = readings.moved(record, "block")
    if motion is not None and place is not None:
        stop = float(readings.crossings(t, speed, 0.0)[0])
        way = float(np.interp(stop, t, place[1][:, 0] - place[1][0, 0])) * np.sign(slide.speed)
        yield Expected("time until it stops", "s", stop, slide.stop, COULOMB)
        yield Expected("way until it stops", "m", float(way), slide.way, COULOMB)
    heat = float(record.history["friction_dissipation"][-1])
    yield Expected("heat of friction", "J", heat, slide.mass * slide.speed**2 / 2, COULOMB)


def on_plane(scene: Scene) -> tuple[float, Exponential] | None:
    """Return normal force [N] and law of friction of a bar pressed on a plane below it, or None.

    Assumes rest at the start, one load on the top, and friction that falls with the slip rate.
    """
    mesh, contact = scene.mesh, only_contact(scene, "zmin")
    if not isinstance(mesh, BarMesh) or contact is None or len(scene.loads) != 1:
        return None
    wall, law, load = contact.target, contact.friction, scene.loads[0]
    if not isinstance(wall, RigidWall) or not isinstance(law, Exponential) or pushed(load):
        return None
    if wall.normal[0] or wall.normal[1] or wall.normal[2] <= 0 or load.surface != "zmax":
        return None
    if any(b.velocity for b in scene.bodies.values()) or scene.driven or load.travelling:
        return None
    if not scene.equilibrium or load.traction[1] or load.traction[2] >= 0:
        return None
    across = all(s.directions == ["y"] and not s.velocity for s in scene.supports)
    return (-load.traction[2] * mesh.length * mesh.width, law) if across else None


@dataclass(frozen=True)
class Jumps:
    """Stick-slip of a block that a spring pulls.

    Attributes:
        static: Friction at rest [N].
        kinetic: Friction in a jump [N].
        stiffness: Of the spring [N/m].
        speed: Of its pulled end [m/s].
        mass: Of the block [kg].
    """

    static: float
    kinetic: float
    stiffness: float
    speed: float
    mass: float

    @property
    def period(self) -> float:
        """Time between two jumps [s]."""
        drop = self.static - self.kinetic
        return stick_slip_period(self.speed, self.stiffness, self.mass, drop)

    @property
    def swing(self) -> float:
        """What the pull swings by about the friction in a jump [N]: it goes on while it begins."""
        omega = np.sqrt(self.stiffness / self.mass)
        return float(np.hypot(self.static - self.kinetic, self.stiffness * self.speed / omega))


def jumps(scene: Scene) -> Jumps | None:
    """Return how a block on a plane sticks and slips, None if it is no such scene.

    Assumes a spring along x and friction without memory that in a jump falls at once (``SUDDEN``),
    but not so fast that the sole lets go piece by piece: within more than the drop of its shear
    stress over ρ c_s. The spring may not be pressed by as much as friction in a jump: its energy,
    which tells the pull, knows no sign.
    """
    touch, steel, mesh = on_plane(scene), material(scene, scene.mesh.regions[0]), scene.mesh
    if touch is None or steel is None or len(scene.springs) != 1 or not isinstance(mesh, BarMesh):
        return None
    (normal, law), spring = touch, scene.springs[0]
    others = (scene.absorbing, scene.rolling, scene.vehicle, scene.track, any(spring.damping))
    (stiffness, *aside), (speed, *sideways) = spring.stiffness, spring.velocity
    across = any((*aside, *sideways, scene.loads[0].traction[0], *(scene.gravity or ())))
    if law.memory or any(others) or not stiffness or not speed or across:
        return None
    mass = steel.density * mesh.length * mesh.width**2
    found = Jumps(law.static * normal, law.kinetic * normal, stiffness, abs(speed), mass)
    shear = steel.youngs_modulus / (2 * (1 + steel.poisson_ratio))
    drop = (law.static - law.kinetic) * normal / (mesh.length * mesh.width)
    least = drop / float(np.sqrt(shear * steel.density))
    at_once = 0 < least < law.decay < SUDDEN * abs(speed)
    return found if at_once and found.swing < 2 * found.kinetic else None


def stick_slip(record: Record) -> Iterator[Expected]:
    """Answers for a block that sticks and slips: see :func:`jumps`. Needs two jumps."""
    exact = jumps(record.checked)
    if exact is None:
        return
    t, (pair,) = record.history["t"], record.checked.contacts
    pull = np.sqrt(2 * exact.stiffness * np.maximum(record.history["spring"], 0.0))
    rising = readings.crossings(t, pull, exact.kinetic)[0::2]
    if len(rising) < 2:
        return
    found = float(np.ptp(rising)) / (len(rising) - 1)
    yield Expected("period between jumps", "s", found, exact.period, COULOMB)
    largest = exact.kinetic + exact.swing
    yield Expected("largest pull of the spring", "N", float(pull.max()), largest, COULOMB)
    friction = float(np.abs(record.history[f"{pair}_tangential_x_force"]).max())
    yield Expected("largest friction force", "N", friction, exact.static, COULOMB)


def slip_weakening(record: Record) -> Iterator[Expected]:
    """Answers for a bar let go on a plane where friction weakens with slip: its heat and speed.

    Assumes friction that falls over a length of slip, and a shear load along x beyond what friction
    at rest can bear: all of the sole slips one way from time zero on, and ``SLIPPED`` lengths far,
    so that its mean slip tells the heat. Elastic energy is left out of the speed. Needs fields.
    """
    scene, touch = record.checked, on_plane(record.checked)
    steel, mesh = material(scene, scene.mesh.regions[0]), scene.mesh
    if touch is None or steel is None or not isinstance(mesh, BarMesh) or not bare(scene):
        return
    (normal, law), stress = touch, scene.loads[0].traction[0]
    pull = abs(stress) * mesh.length * mesh.width
    if law.memory is None or pull <= law.static * normal:
        return
    found, motion = _slip_of_sole(record), readings.velocity_at_end(record, "bar")
    if found is None or motion is None or found < SLIPPED * law.memory.length:
        return
    lost = normal * slip_weakening_work(found, law.static, law.kinetic, law.memory.length)
    heat = float(record.history["friction_dissipation"][-1])
    yield Expected("heat of friction for the slip", "J", heat, lost, WEAKENING)
    mass = steel.density * mesh.length * mesh.width**2
    exact = float(np.sqrt(2 * (pull * found - lost) / mass)) * float(np.sign(stress))
    yield Expected("velocity for the slip", "m/s", float(motion[0]), exact, WEAKENING)


def _slip_of_sole(record: Record) -> float | None:
    """Mean way along x of the lowest nodes of a mesh since the start [m]; None without fields."""
    if record.body is None:
        return None
    z = record.body.points[:, 2]
    sole = np.isclose(z, z.min())
    first, last = (record.displacement(t)[sole, 0] for t in record.history["t"][[0, -1]])
    return float(abs((last - first).mean()))
