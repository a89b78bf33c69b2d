# SPDX-License-Identifier: LGPL-3.0-or-later
"""Smooth bodies that touch: Hertz at rest, Cattaneo and Mindlin under a shift, Hertz's impact."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from contact.theory.closed_forms import (
    Hertz,
    cattaneo_mindlin,
    contact_modulus,
    hertz_ellipse,
    hertz_line,
    line_compression,
    sinking,
    sphere_impact_approach,
    sphere_impact_time,
    stick_radius_ratio,
)
from meshes.arrays import Array
from workflow.results.patch_nodes import PatchNodes
from workflow.results.record import Record
from workflow.scene.mesh import BlocksMesh, CapMesh, CurvedMesh, Foreign
from workflow.scene.scene import Scene
from workflow.theory import readings
from workflow.theory.assumptions import bare, coulomb, held, material, pressed, undamped, velocity
from workflow.theory.quantity import CATTANEO, ENERGY, HERTZ, IMPACT, LINE, STATICS, Expected

if TYPE_CHECKING:
    from workflow.theory.measured import Touching

CORE = 0.7  # of Hertz's ellipse: nodes at its edge have a part of their area outside
DEEP = 2.0  # half widths from the contact, where approach is measured
ROOM = 0.25  # of the room in the bodies that a contact on half-spaces takes up at most
FLAT = 0.2  # of the radius, likewise
WAVES = 10.0  # times a wave runs up and down a body during an impact, at least
PARTED = 1.05  # of the contact time, after which the bodies are apart

Moduli = tuple[tuple[float, float], tuple[float, float]]  # of two bodies: Young's [Pa], Poisson's


@dataclass(frozen=True)
class Smooth:
    """Two smooth elastic bodies of which a part may be modelled.

    Attributes:
        radii: Radii of the relative curvature along x and y [m]; infinite along y in plane strain.
        moduli: Young's modulus [Pa] and Poisson's ratio of the upper and the lower body.
        thickness: Of plane strain [m], NaN in space.
        halved: Whether the model begins at the plane through the centre, across x and across y.
        rolls: Whether the upper body rolls.
        room: Least distance from the middle of the contact to the end of the bodies [m].
        regions: Of the upper and of the lower body.
    """

    radii: tuple[float, float]
    moduli: Moduli
    thickness: float
    halved: tuple[bool, bool]
    rolls: bool
    room: float
    regions: tuple[str, ...]

    @property
    def parts(self) -> int:
        """What is modelled times this is the whole."""
        return int(2 ** sum(self.halved))

    @property
    def plane(self) -> bool:
        """Whether this is plane strain."""
        return bool(np.isfinite(self.thickness))

    @property
    def round(self) -> bool:
        """Whether the contact is a circle."""
        return bool(np.isclose(*self.radii))

    @property
    def alike(self) -> bool:
        """Whether both bodies are alike, so that pressing does not shear."""
        return self.moduli[0] == self.moduli[1]

    @property
    def modulus(self) -> float:
        """Contact modulus E* [Pa]."""
        return contact_modulus(*self.moduli[0], *self.moduli[1])

    def whole(self, force: float) -> float:
        """Return the force on the whole contact of that on the model [N], [N/m] in plane strain."""
        return force * self.parts / (self.thickness if self.plane else 1.0)

    def hertz(self, force: float) -> Hertz:
        """Return Hertz's contact under a normal force on the model [N]."""
        load = self.whole(force)
        if self.plane:
            return hertz_line(load, self.radii[0], self.modulus)
        return hertz_ellipse(load, *self.radii, self.modulus)

    def holds(self, hertz: Hertz) -> bool:
        """Tell whether a contact is small beside the bodies and their radii."""
        axes = (hertz.a,) if self.plane else (hertz.a, hertz.b)
        flat = all(a < FLAT * r for a, r in zip(axes, self.radii, strict=False))
        return flat and max(axes) < ROOM * self.room

    def local(self, patch: PatchNodes) -> Array:
        """Return the positions of contact nodes from the centre of the contact, ``(n, 2)`` [m]."""
        centre = np.where(self.halved, 0.0, patch.centre[:2])
        return np.asarray(patch.position[:, :2] - centre)


def smooth(record: Record) -> Smooth | None:
    """Return the smooth bodies of a scene, None if it has none whose contact Hertz describes.

    Assumes isotropic bodies, curved towards each other, and planes of symmetry that are held.
    """
    scene = record.checked
    if len(scene.contacts) != 1:
        return None
    shape = _shape(record)
    if shape is None:
        return None
    upper, lower = (material(scene, region) for region in shape.regions)
    if upper is None or lower is None:
        return None
    first, second = ((m.youngs_modulus, m.poisson_ratio) for m in (upper, lower))
    bodies = replace(shape, moduli=(first, second))
    cut = {"xmin": bodies.halved[0], "ymin": bodies.halved[1] or bodies.plane, "ymax": bodies.plane}
    free = [name for name, is_cut in cut.items() if is_cut and name[0] not in held(scene, name)]
    return None if free else bodies


NO_MODULI: Moduli = ((np.nan, np.nan), (np.nan, np.nan))  # of a shape alone


def _shape(record: Record) -> Smooth | None:
    """Return the smooth bodies of a mesh by shape, None if they are not curved to each other."""
    mesh = record.checked.mesh
    if isinstance(mesh, CapMesh):
        radii, quarter = (mesh.radius, mesh.radius), (True, True)
        return Smooth(radii, NO_MODULI, np.nan, quarter, False, mesh.extent, mesh.regions)
    if isinstance(mesh, Foreign):
        found = measured(record)
        if found is None or not sum(found.curvature) > 0:
            return None
        radius = 1 / sum(found.curvature)
        radii, room = (radius, radius), found.room
        return Smooth(radii, NO_MODULI, np.nan, found.halved, False, room, found.regions)
    if not isinstance(mesh, CurvedMesh):
        return None
    along = _relative(mesh.radius, mesh.base_radius)
    across = _relative(mesh.crown, mesh.base_crown)
    plane = mesh.layers is not None
    if not along > 0 or (across == 0) != plane:
        return None
    halved = (mesh.x[0] == 0, mesh.y[0] == 0 and not plane)
    thickness = mesh.y[1] - mesh.y[0] if plane else np.nan
    ends = (*mesh.x, *(() if plane else mesh.y), mesh.height, mesh.depth)
    room = min(abs(end) for end in ends if end)
    radii = (1 / along, np.inf if plane else 1 / across)
    return Smooth(radii, NO_MODULI, thickness, halved, mesh.rolls, room, mesh.regions)


def measured(record: Record) -> "Touching | None":
    """Return what the nodes of another program's mesh tell, None without fields.

    Only of a scene with one contact that nothing but loads and held surfaces acts on.
    """
    from workflow.theory.measured import touching

    scene = record.checked
    if len(scene.contacts) != 1 or not bare(scene) or record.body is None:
        return None
    return touching(record.body)


def _relative(one: float | None, other: float | None) -> float:
    """Return the relative curvature of two radii, flat where there is none [1/m]."""
    return sum(1.0 / r for r in (one, other) if r is not None)


def applied(record: Record) -> float | None:
    """Return the normal force that a dead load on the top presses through a contact [N], or None.

    Assumes no gravity and nothing else that presses.
    """
    scene = record.checked
    mesh, pressure = scene.mesh, pressed(scene)
    if pressure is None or not bare(scene) or scene.driven:
        return None
    if isinstance(mesh, BlocksMesh):
        return pressure * mesh.block[0] * mesh.block[1]
    if isinstance(mesh, CapMesh):
        return pressure * mesh.extent**2
    if isinstance(mesh, CurvedMesh) and not mesh.rolls:
        return pressure * (mesh.x[1] - mesh.x[0]) * (mesh.y[1] - mesh.y[0])
    if isinstance(mesh, Foreign) and (found := measured(record)) is not None:
        return pressure * found.top
    return None


def pressing(record: Record) -> tuple[Smooth, PatchNodes, Hertz] | None:
    """Return bodies, contact at the last output and Hertz's, None if he does not describe it.

    Assumes bodies that were brought to rest before, and that pressing does not shear: alike, or
    without friction. Hertz's contact is that under the load, under the force found without one.
    """
    scene, bodies = record.checked, smooth(record)
    if bodies is None or not bare(scene) or not scene.equilibrium:
        return None
    (contact,), load = scene.contacts.values(), applied(record)
    if any(body.velocity for body in scene.bodies.values()):
        return None
    if not bodies.alike and coulomb(contact) != 0:
        return None
    if load is None and (scene.loads or not scene.driven):
        return None
    patch = readings.patch_at_end(record)
    if patch is None:
        return None
    hertz = bodies.hertz(patch.normal_force if load is None else load)
    return (bodies, patch, hertz) if bodies.holds(hertz) else None


def hertz_contact(record: Record) -> Iterator[Expected]:
    """Answers of Hertz for the contact at the last output: see :func:`pressing`."""
    found = pressing(record)
    if found is None:
        return
    bodies, patch, hertz = found
    source = LINE if bodies.plane else HERTZ
    x, y = bodies.local(patch).T
    pressure, r = patch.pressure, np.hypot(x / hertz.a, y / hertz.b)
    off = (pressure - hertz.pressure(x, y))[r < CORE]
    if len(off):
        rms = float(np.sqrt(np.mean(off**2)) / hertz.p0)
        yield Expected("nodal pressure off Hertz's, rms over p0", "1", rms, 0.0, source)
    middle = float(pressure[np.argmin(r)])
    yield Expected("largest pressure p0, node in the middle", "Pa", middle, hertz.p0, source)
    a, b = readings.half_axes(bodies.local(patch), patch.normal_forces, 4 if bodies.plane else 5)
    yield Expected("half axis a along x, from moments", "m", a, hertz.a, source)
    if not bodies.plane:
        yield Expected("half axis b along y, from moments", "m", b, hertz.b, source)
    if (load := applied(record)) is not None:
        yield Expected("normal force", "N", patch.normal_force, load, STATICS)
    if not any(any((*d.spin, *d.velocity)) for d in record.checked.driven.values()):
        yield from _approach(record, bodies, hertz)


def _approach(record: Record, bodies: Smooth, hertz: Hertz) -> Iterator[Expected]:
    """Approach of distant points, of points ``DEEP`` half widths from the contact in plane strain.

    What of it lies farther away than those is taken from the closed form. Needs fields.
    """
    depth = DEEP * max(hertz.a, 0.0 if bodies.plane else hertz.b)
    found = _nearer(record, depth, bodies.regions)
    if found is None:
        return
    if bodies.plane:
        exact = sum(line_compression(hertz, depth, *moduli) for moduli in bodies.moduli)
        name = f"approach of points {DEEP:g} a from the contact"
        yield Expected(name, "m", found, exact, LINE)
    else:
        beyond = sum(sinking(hertz, depth, *moduli) for moduli in bodies.moduli)
        yield Expected("approach", "m", found + beyond, hertz.approach, HERTZ)


def _nearer(record: Record, depth: float, regions: tuple[str, ...]) -> float | None:
    """Return how far points on the axis, at a depth in both bodies, came together [m], or None."""
    body = record.body
    if body is None:
        return None
    numbers = {name: number for number, name in body.names.items()}
    u, moved = record.displacement(readings.until(record))[:, 2], 0.0
    for side, region in zip((1, -1), regions, strict=True):
        nodes = np.unique(body.cells[body.regions == numbers[region]])
        x, y, z = body.points[nodes].T
        axis = np.hypot(x, y) < 1e-9
        z, u_z = side * z[axis], u[nodes][axis]
        if not axis.any() or z.max() < depth:
            return None
        order = np.argsort(z)
        moved -= side * float(np.interp(depth, z[order], u_z[order]))
    return moved


def shifted(record: Record) -> Iterator[Expected]:
    """Answers of Cattaneo and Mindlin for a sphere that is pressed, then shifted along x.

    Assumes spheres that are alike, constant friction, a shift that is over, and no full sliding.
    """
    found, scene = pressing(record), record.checked
    if found is None:
        return
    bodies, patch, _ = found
    friction = coulomb(next(iter(scene.contacts.values())))
    shifts = [d for d in scene.driven.values() if any(d.shift)]
    moves = any(any((*d.spin, *d.velocity)) for d in scene.driven.values())
    if moves or len(shifts) != 1 or not bodies.round or not bodies.alike or bodies.halved[0]:
        return
    if not friction or any(shifts[0].shift[1:]) or readings.until(record) < shifts[0].shift_time:
        return
    hertz, P = bodies.hertz(patch.normal_force), bodies.whole(patch.normal_force)
    along = float(patch.tangential_forces[:, 0].sum())
    Q, sign = bodies.whole(abs(along)), np.sign(along)
    if not 0 < Q < friction * P:
        return
    exact = cattaneo_mindlin(np.hypot(*bodies.local(patch).T), hertz, Q, P, friction)
    off = sign * patch.tangential_forces[:, 0] / patch.areas - exact
    rms = float(np.sqrt(np.mean(off**2)) / exact.max())
    yield Expected("nodal shear off Cattaneo's, rms over its peak", "1", rms, 0.0, CATTANEO)
    radius = float(np.sqrt(bodies.parts * patch.areas[patch.stick].sum() / np.pi))
    c = stick_radius_ratio(Q, P, friction) * hertz.a
    yield Expected("radius of the stick zone", "m", radius, c, CATTANEO)


@dataclass(frozen=True)
class Strike:
    """Impact of a body with a round nose.

    Attributes:
        mass: Mass of the whole body [kg].
        speed: Its speed at the touch [m/s].
        stiffness: Force on the whole over approach to the power of 3/2 [N/m^1.5].
        stay: Time of contact [s].
        approach: Largest approach [m].
    """

    mass: float
    speed: float
    stiffness: float
    stay: float
    approach: float

    @property
    def force(self) -> float:
        """Largest force on the whole [N]."""
        return self.stiffness * self.approach**1.5


def strike(record: Record) -> Strike | None:
    """Return the impact of a round body on one that is held, None if it is no such scene.

    Assumes no damping, a start in touch, and contact that is long against waves in the body.
    """
    scene, bodies, history = record.checked, smooth(record), record.history
    if bodies is None or not bodies.round or bodies.rolls or not len(history.get("t", ())):
        return None
    upper, lower = bodies.regions
    (x, y, z), steel = velocity(scene, upper), material(scene, upper)
    if steel is None or z >= 0 or x or y or any(velocity(scene, lower)):
        return None
    still = not (scene.equilibrium or scene.loads or scene.driven)
    if not still or not bare(scene) or not undamped(scene) or "z" not in held(scene, "base_bottom"):
        return None
    if not bodies.alike and coulomb(next(iter(scene.contacts.values()))) != 0:
        return None
    mass = float(2 * history["kinetic"][0] * bodies.parts / z**2)
    radius, modulus = bodies.radii[0], bodies.modulus
    stay = sphere_impact_time(mass, radius, modulus, -z)
    approach = sphere_impact_approach(mass, radius, modulus, -z)
    found = Strike(mass, -z, 4 / 3 * modulus * np.sqrt(radius), stay, approach)
    c = float(np.sqrt(steel.youngs_modulus / steel.density))
    slow = stay > WAVES * 2 * _height(scene) / c
    largest = hertz_ellipse(found.force, radius, radius, modulus)
    return found if slow and bodies.holds(largest) else None


def _height(scene: Scene) -> float:
    """Height of the upper of two smooth bodies [m]."""
    mesh = scene.mesh
    return mesh.height if isinstance(mesh, CurvedMesh) else getattr(mesh, "extent", np.nan)


def struck(record: Record) -> Iterator[Expected]:
    """Answers of Hertz for an impact: see :func:`strike`; for what is over at the last output."""
    hit, bodies, end = strike(record), smooth(record), readings.until(record)
    if hit is None or bodies is None:
        return
    t, normal, _ = readings.forces(record)
    force = bodies.parts * normal
    if end > PARTED * hit.stay and not force[-1] and (force > 0).sum() > 2:
        found = _contact_time(t, force)
        yield Expected("contact time", "s", found, hit.stay, IMPACT)
    if end > hit.stay / 2:
        yield Expected("largest force", "N", float(force.max()), hit.force, IMPACT)
    if end > PARTED * hit.stay:
        motion = readings.velocity_at_end(record, bodies.regions[0])
        if motion is not None:
            yield Expected("velocity after the rebound", "m/s", float(motion[2]), hit.speed, IMPACT)
        kinetic = record.history["kinetic"]
        after, before = float(kinetic[-1]), float(kinetic[0])
        yield Expected("kinetic energy after the rebound", "J", after, before, ENERGY)


def _contact_time(t: Array, force: Array) -> float:
    """Time for which a force lasts [s]: its power of 2/3, the approach, comes and goes evenly."""
    depth, touching = force ** (2 / 3), np.flatnonzero(force > 0)

    def end(first: int, second: int, beyond: int) -> float:
        """Time at which the approach through two samples is zero, not beyond a third."""
        rate = (depth[second] - depth[first]) / (t[second] - t[first])
        return float(np.clip(t[first] - depth[first] / rate, *sorted((t[first], t[beyond]))))

    first, last = touching[0], touching[-1]
    return end(last, last - 1, last + 1) - end(first, first + 1, max(first - 1, 0))
