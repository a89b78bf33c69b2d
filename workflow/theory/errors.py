# SPDX-License-Identifier: LGPL-3.0-or-later
"""How far a run is from the closed form of its scene, read from its result folder.

Row numbers are those of the verification: a bar stays at a wall for 2 L/c (8), the pressure of
Hertz (13), the shear of Cattaneo and Mindlin (14), the creepage of Carter (15).
"""

from dataclasses import dataclass

import numpy as np

from contact.theory.closed_forms import bar_impact, carter_creepage, cattaneo_mindlin
from meshes.arrays import Array
from workflow.results.record import PatchNodes, Record
from workflow.results.samples import read as read_samples
from workflow.scene.bodies import Isotropic
from workflow.scene.mesh import BarMesh
from workflow.scene.scene import Scene
from workflow.scene.settings import RigidWall
from workflow.theory.closed_forms import Smooth, checked, smooth

CORE = 0.7  # of Hertz's ellipse: nodes at its edge have a part of their area outside
STEADY = 0.1  # of the run at its end, over which forces in rolling are averaged


@dataclass(frozen=True)
class ClosedFormError:
    """The error of a run.

    Attributes:
        quantity: What is compared, and with whom.
        error: Its relative error.
    """

    quantity: str
    error: float


def closed_form_error(record: Record) -> ClosedFormError | None:
    """Return the error of a run against the closed form of its scene, None if it has none.

    Forces are those at ``output.sample_interval``, or at the outputs. The time of a bar at its wall
    is as fine as they are: they should come several times while a wave passes a cell.
    """
    scene = checked(record)
    if len(scene.contacts) != 1:
        return None
    contact, mesh = next(iter(scene.contacts.values())), scene.mesh
    if isinstance(mesh, BarMesh) and isinstance(contact.target, RigidWall):
        found = _bar(record, scene, mesh)
        return None if found is None else ClosedFormError("contact time, 2 L/c", found)
    bodies = smooth(record)
    if bodies is None or not record.contacts or any(b.velocity for b in scene.bodies.values()):
        return None
    patch = next(p for p in reversed(next(iter(record.contacts.values())).patches) if p)[1]
    moves = any(any(motion.shift) for motion in scene.driven.values())
    turns = any(any(motion.spin) for motion in scene.driven.values())
    if not (moves or turns):
        return ClosedFormError("pressure, Hertz", _pressure(patch, bodies))
    alike = bodies.moduli[0] == bodies.moduli[1]  # so that pressing does not shear
    if not (alike and isinstance(contact.friction, float)):
        return None
    if moves and not turns and np.isclose(*bodies.radii):
        error = _shear(patch, bodies, contact.friction)
        return ClosedFormError("shear, Cattaneo and Mindlin", error)
    if turns and not moves and bodies.plane and (creepage := _creepage(scene)) is not None:
        error = _rolling(record, bodies, contact.friction, creepage)
        return ClosedFormError("creepage, Carter", error)
    return None


def forces(record: Record) -> tuple[Array, Array, Array]:
    """Return times, normal and longitudinal force on the contactor of the first pair [s], [N]."""
    pair = next(iter(record.scene["contacts"]))
    samples = read_samples(record.folder)
    if samples is not None and pair in samples.pairs:
        found = samples.pairs[pair]
        return samples.t, np.linalg.norm(found.normal, axis=1), found.tangential[:, 0]
    history = record.history
    return history["t"], history[f"{pair}_normal_force"], history[f"{pair}_tangential_x_force"]


def _bar(record: Record, scene: Scene, mesh: BarMesh) -> float | None:
    """Error of the time for which a bar stays at a wall (row 8); None while it is there."""
    body = next(iter(scene.bodies.values()))
    if not isinstance(body.material, Isotropic) or not body.velocity:
        return None
    modulus, density = body.material.youngs_modulus, body.material.density
    speed, section = abs(body.velocity[0]), mesh.width**2
    force, stay = bar_impact(speed, modulus, density, section, mesh.length)
    t, normal, _ = forces(record)
    above = normal - force / 2
    touching = np.flatnonzero(above > 0)
    if not len(touching) or touching[-1] == len(t) - 1:
        return None
    first, last = touching[[0, -1]]
    came = _zero(t, above, first - 1) if first else 0.0
    return float(abs((_zero(t, above, last) - came) / stay - 1))


def _zero(t: Array, values: Array, k: int) -> float:
    """Return where the values pass zero between times ``k`` and ``k + 1`` [s]."""
    return float(t[k] + values[k] / (values[k] - values[k + 1]) * (t[k + 1] - t[k]))


def _pressure(patch: PatchNodes, bodies: Smooth) -> float:
    """Error of the pressure in the core of Hertz's ellipse or strip, rms over p₀ (row 13)."""
    hertz = bodies.hertz(patch.normal_force)
    x, y = bodies.local(patch).T
    core = np.hypot(x / hertz.a, y / hertz.b) < CORE
    off = (patch.pressure - hertz.pressure(x, y))[core]
    return float(np.sqrt(np.mean(off**2)) / hertz.p0)


def _shear(patch: PatchNodes, bodies: Smooth, friction: float) -> float:
    """Error of the shear traction along x, rms over its peak (row 14)."""
    P = bodies.whole(patch.normal_force)
    Q = -bodies.whole(float(patch.tangential_forces[:, 0].sum()))
    r = np.hypot(*bodies.local(patch).T)
    exact = cattaneo_mindlin(r, bodies.hertz(patch.normal_force), Q, P, friction)
    off = -patch.tangential_forces[:, 0] / patch.areas - exact
    return float(np.sqrt(np.mean(off**2)) / np.abs(exact).max())


def _creepage(scene: Scene) -> float | None:
    """Return the creepage of a roller that turns on a body that passes under it, or None."""
    turning = [d for d in scene.driven.values() if any(d.spin)]
    passing = [d for d in scene.driven.values() if not any(d.spin)]
    radius = getattr(scene.mesh, "radius", None)
    if len(turning) != 1 or len(passing) != 1 or radius is None:
        return None
    speed = turning[0].velocity[0] - passing[0].velocity[0]
    return 1 - turning[0].spin[1] * radius / speed if speed else None


def _rolling(record: Record, bodies: Smooth, friction: float, creepage: float) -> float:
    """Error of the creepage for the traction that it makes, in plane strain (row 15)."""
    t, normal, tangential = forces(record)
    last = t > t[0] + (1 - STEADY) * (t[-1] - t[0])
    force = float(normal[last].mean())
    P, Q = bodies.whole(force), bodies.whole(float(tangential[last].mean()))
    exact = carter_creepage(Q, P, friction, bodies.hertz(force).a, bodies.radii[0])
    return abs(creepage / exact - 1)
