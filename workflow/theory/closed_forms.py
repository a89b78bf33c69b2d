# SPDX-License-Identifier: LGPL-3.0-or-later
"""What theory says of a scene: forces over time, and the contact of smooth bodies.

Each function looks at the scene and returns nothing where no closed form fits it.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from meshes.arrays import Array
from workflow.model.regions import owners
from workflow.results.record import PatchNodes, Record

if TYPE_CHECKING:
    from contact.theory.closed_forms import Hertz
    from workflow.scene.scene import Scene

Curve = tuple[str, Array, Array]  # label, times [s], forces [N]


@dataclass(frozen=True)
class Smooth:
    """Two smooth elastic bodies of which a part may be modelled.

    Attributes:
        radii: Radii of the relative curvature along x and y [m]; infinite along y in plane strain.
        moduli: Young's modulus [Pa] and Poisson's ratio of the two bodies.
        parts: What is modelled times this is the whole.
        thickness: Of plane strain [m], NaN in space.
        halved: Whether the model begins at the plane through the centre, across x and across y.
        rolls: Whether the upper body rolls.
    """

    radii: tuple[float, float]
    moduli: tuple[tuple[float, float], tuple[float, float]]
    parts: int
    thickness: float
    halved: tuple[bool, bool]
    rolls: bool

    @property
    def plane(self) -> bool:
        """Tell whether this is plane strain."""
        return bool(np.isfinite(self.thickness))

    @property
    def modulus(self) -> float:
        """Contact modulus E* [Pa]."""
        from contact.theory.closed_forms import contact_modulus

        return contact_modulus(*self.moduli[0], *self.moduli[1])

    def whole(self, force: float) -> float:
        """Return the force on the whole contact of that on the model [N], [N/m] in plane strain."""
        return force * self.parts / (self.thickness if self.plane else 1.0)

    def hertz(self, force: float) -> "Hertz":
        """Return Hertz's contact under a normal force on the model [N]."""
        from contact.theory.closed_forms import hertz_ellipse, hertz_line

        load = self.whole(force)
        if self.plane:
            return hertz_line(load, self.radii[0], self.modulus)
        return hertz_ellipse(load, *self.radii, self.modulus)

    def local(self, patch: PatchNodes) -> Array:
        """Return the positions of contact nodes from the centre of the contact, ``(n, 2)`` [m]."""
        centre = np.where(self.halved, 0.0, patch.centre[:2])
        return np.asarray(patch.position[:, :2] - centre)


def checked(record: Record) -> "Scene":
    """Return the scene of a record."""
    from workflow.scene.scene import Scene

    return Scene.check(record.scene)


def smooth(record: Record) -> Smooth | None:
    """Return the smooth bodies of a scene, None if it has none whose contact Hertz describes."""
    from workflow.scene.bodies import Isotropic
    from workflow.scene.mesh import CapMesh, CurvedMesh

    scene = checked(record)
    mesh, body_of = scene.mesh, owners(scene)
    if not isinstance(mesh, CapMesh | CurvedMesh) or len(scene.contacts) != 1:
        return None
    materials = [scene.bodies[body_of[region]].material for region in mesh.regions]
    constants = [(m.youngs_modulus, m.poisson_ratio) for m in materials if isinstance(m, Isotropic)]
    if len(constants) != 2:
        return None
    pair = (constants[0], constants[1])
    if isinstance(mesh, CapMesh):
        return Smooth((mesh.radius, mesh.radius), pair, 4, np.nan, (True, True), False)
    along = _relative(mesh.radius, mesh.base_radius)
    across = _relative(mesh.crown, mesh.base_crown)
    plane = mesh.layers is not None
    if not along > 0 or (across == 0) != plane:
        return None
    halved = (mesh.x[0] == 0, mesh.y[0] == 0 and not plane)
    thickness = mesh.y[1] - mesh.y[0] if plane else np.nan
    radii = (1 / along, np.inf if plane else 1 / across)
    return Smooth(radii, pair, 2 ** sum(halved), thickness, halved, mesh.rolls)


def _relative(one: float | None, other: float | None) -> float:
    """Return the relative curvature of two radii, flat where there is none [1/m]."""
    return sum(1.0 / r for r in (one, other) if r is not None)


def applied(record: Record) -> float | None:
    """Return the normal force that dead loads on the top press through a contact [N], or None."""
    from workflow.scene.mesh import BlocksMesh, CapMesh, CurvedMesh

    scene = checked(record)
    mesh = scene.mesh
    pressure = -sum(load.traction[2] for load in scene.loads if load.surface == "zmax")
    if pressure <= 0 or len(scene.loads) != 1 or any(scene.gravity or ()):
        return None
    if isinstance(mesh, BlocksMesh):
        return pressure * mesh.block[0] * mesh.block[1]
    if isinstance(mesh, CapMesh):
        return pressure * mesh.extent**2
    if isinstance(mesh, CurvedMesh) and not mesh.rolls:
        return pressure * (mesh.x[1] - mesh.x[0]) * (mesh.y[1] - mesh.y[0])
    return None


def closed_forms(record: Record, pair: str) -> list[Curve]:
    """Return what theory says of a pair's forces: label, times [s], forces [N]; or nothing."""
    from workflow.scene.mesh import BarMesh, BlocksMesh

    scene, load = checked(record), applied(record)
    contact, mesh, whole = scene.contacts[pair], scene.mesh, np.array([0.0, scene.time.end])
    if isinstance(mesh, BarMesh):
        return _bar(scene, contact)
    if load is None:
        bodies = smooth(record)
        return [*_impact(record, bodies), *_creep(record, bodies, pair)] if bodies else []
    forms = [("load", whole, load * np.ones(2))]
    speed = abs((next(iter(scene.bodies.values())).velocity or (0.0,))[0])
    friction = contact.friction
    if isinstance(mesh, BlocksMesh) and speed and isinstance(friction, float) and friction:
        from contact.theory.closed_forms import sliding_stop

        density: Any = next(iter(scene.bodies.values())).material
        mass = density.density * mesh.block[0] * mesh.block[1] * mesh.block[2]
        _, stop = sliding_stop(speed, friction, load / mass)
        slide = np.array([0.0, min(stop, scene.time.end)])
        forms.append(("friction × load until rest", slide, friction * load * np.ones(2)))
    return forms


def _bar(scene: "Scene", contact: Any) -> list[Curve]:
    """Return the force of a bar on a rigid wall."""
    from contact.theory.closed_forms import bar_impact
    from workflow.scene.bodies import Isotropic
    from workflow.scene.settings import RigidWall

    body = next(iter(scene.bodies.values()))
    mesh: Any = scene.mesh
    speed = abs((body.velocity or (0.0,))[0])
    flies = speed and isinstance(contact.target, RigidWall)
    if not flies or not isinstance(body.material, Isotropic):
        return []
    E, rho = body.material.youngs_modulus, body.material.density
    force, stay = bar_impact(speed, E, rho, mesh.width**2, mesh.length)
    times = np.array([0.0, 0.0, stay, stay, scene.time.end])
    return [("ρ c v A during 2L/c", times, force * np.array([0, 1, 1, 0, 0]))]


def _impact(record: Record, bodies: Smooth) -> list[Curve]:
    """Return the force of a Hertzian impact from time zero on (Johnson 11.21), for circles."""
    from scipy.integrate import solve_ivp

    scene = checked(record)
    speeds = [-b.velocity[2] for b in scene.bodies.values() if b.velocity and b.velocity[2] < 0]
    round_ = np.isclose(*bodies.radii)
    if len(speeds) != 1 or not round_ or scene.equilibrium or not len(record.history["t"]):
        return []
    mass = 2 * record.history["kinetic"][0] / speeds[0] ** 2
    stiffness = 4 / 3 * bodies.modulus * np.sqrt(bodies.radii[0]) / bodies.parts

    def motion(t: float, state: Array) -> list[float]:
        return [state[1], -stiffness / mass * max(state[0], 0.0) ** 1.5]

    t = np.linspace(0, record.history["t"][-1], 400)
    found = solve_ivp(motion, (0, t[-1]), [0, speeds[0]], t_eval=t, rtol=1e-8, atol=1e-14)
    return [("Hertz, impact", t, stiffness * np.maximum(found.y[0], 0) ** 1.5)]


def _imposed(scene: "Scene") -> Array | None:
    """Return the creepages that driven bodies impose, longitudinal and lateral, or None.

    The upper body turns about the y axis, the lower one passes under it.
    """
    spins = [d.spin[1] for d in scene.driven.values() if any(d.spin) and not any(d.velocity)]
    passes = [np.array(d.velocity) for d in scene.driven.values() if d.velocity[0]]
    radius = getattr(scene.mesh, "radius", None)
    if len(spins) != 1 or len(passes) != 1 or radius is None:
        return None
    speed = -passes[0]
    return np.array([(speed[0] - spins[0] * radius) / speed[0], speed[1] / speed[0]])


def _creep(record: Record, bodies: Smooth, pair: str) -> list[Curve]:
    """Return the tangential force at the imposed creepage and the last normal force."""
    from contact.theory import kalker
    from contact.theory.closed_forms import carter_creepage

    scene = checked(record)
    friction, creepage = scene.contacts[pair].friction, _imposed(scene)
    if not bodies.rolls or bodies.moduli[0] != bodies.moduli[1] or creepage is None:
        return []
    normal = record.history[f"{pair}_normal_force"]
    if not len(normal) or normal[-1] <= 0:
        return []
    if not isinstance(friction, float) or friction == 0:
        return []
    hertz, limit = bodies.hertz(normal[-1]), friction * normal[-1]
    if bodies.plane:
        whole = carter_creepage(limit, normal[-1], friction, hertz.a, bodies.radii[0])
        left = max(1 - abs(creepage[0] / whole), 0.0)
        name, force = "Carter", limit * (1 - left**2)
    else:
        E, nu = bodies.moduli[0]
        way = (creepage[0], creepage[1], 0.0)
        linear = kalker.creep_force(way, (hertz.a, hertz.b), E / (2 * (1 + nu)), nu)
        size = float(np.linalg.norm(linear)) / bodies.parts
        name, force = "Kalker", kalker.saturated(size, limit)
    times = np.array([0.0, record.history["t"][-1]])
    return [(f"{name}, tangential, steady", times, force * np.ones(2))]
