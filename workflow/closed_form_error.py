# SPDX-License-Identifier: LGPL-3.0-or-later
"""How far a run is from the closed form of its scene, read from its result folder.

Row numbers are those of the verification: a bar stays at a wall for 2 L/c (8), the pressure of
Hertz (13), the shear of Cattaneo and Mindlin (14), the creepage of Carter (15).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from contact.closed_forms import (
    Hertz,
    bar_impact,
    carter_creepage,
    cattaneo_mindlin,
    contact_modulus,
    hertz_ellipse,
    hertz_line,
)
from workflow.body_tables import Isotropic
from workflow.mesh_tables import BarMesh, CapMesh, CurvedMesh
from workflow.recorded import Patch, Record
from workflow.scene import Scene
from workflow.sections import Driven, RigidWall

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

    Bars need an output interval well below the time that a wave takes through a cell.
    """
    scene = Scene.check(record.scene)
    bodies = list(scene.bodies.values())
    if len(scene.contacts) != 1 or not all(isinstance(b.material, Isotropic) for b in bodies):
        return None
    mesh, contact = scene.mesh, next(iter(scene.contacts.values()))
    if isinstance(mesh, BarMesh) and isinstance(contact.target, RigidWall):
        return ClosedFormError("contact time, 2 L/c", _bar(record, scene, mesh))
    if not record.contacts or any(body.velocity for body in bodies):
        return None
    patch = next(p for p in reversed(next(iter(record.contacts.values())).patches) if p)[1]
    moves = [motion for motion in scene.driven.values() if any(motion.shift)]
    turns = [motion for motion in scene.driven.values() if any(motion.spin)]
    if isinstance(mesh, CapMesh) or (isinstance(mesh, CurvedMesh) and not (moves or turns)):
        return ClosedFormError("pressure, Hertz", _pressure(patch, scene, mesh))
    alike = len({_elastic(body) for body in bodies}) == 1  # pressing does not shear
    if not (isinstance(mesh, CurvedMesh) and isinstance(contact.friction, float) and alike):
        return None
    if moves and not turns and _radii(mesh)[0] == _radii(mesh)[1]:
        error = _shear(patch, scene, mesh, contact.friction)
        return ClosedFormError("shear, Cattaneo and Mindlin", error)
    still = [motion for motion in scene.driven.values() if not any(motion.spin)]
    if len(turns) == len(still) == 1 and mesh.layers and mesh.rolls:
        error = _creepage(record, scene, mesh, contact.friction, turns[0], still[0])
        return ClosedFormError("creepage, Carter", error)
    return None


def _bar(record: Record, scene: Scene, mesh: BarMesh) -> float:
    """Error of the time for which a bar stays at a wall (row 8)."""
    body = next(iter(scene.bodies.values()))
    speed = abs((body.velocity or (1.0,))[0])
    modulus, _ = _elastic(body)
    force, stay = bar_impact(speed, modulus, body.material.density, mesh.width**2, mesh.length)
    t = record.history["t"]
    above = record.history[f"{next(iter(scene.contacts))}_normal_force"] - force / 2
    touching = np.flatnonzero(above > 0)
    if not len(touching) or touching[-1] == len(t) - 1:
        return float("nan")  # not yet gone
    times = [_zero(t, above, touching[0] - 1), _zero(t, above, touching[-1])]
    return float(abs(np.ptp(times) / stay - 1))


def _zero(t: np.ndarray, values: np.ndarray, k: int) -> float:
    """Return where the values pass zero between outputs ``k`` and ``k + 1`` [s]."""
    if k < 0:
        return float(t[0])
    share = values[k] / (values[k] - values[k + 1])
    return float(t[k] + share * (t[k + 1] - t[k]))


def _pressure(patch: Patch, scene: Scene, mesh: CapMesh | CurvedMesh) -> float:
    """Error of the pressure in the core of Hertz's ellipse or strip, rms over p₀ (row 13)."""
    hertz = _hertz(patch, scene, mesh)
    x, y = patch.position[:, :2].T
    core = np.hypot(x / hertz.a, y / hertz.b) < CORE
    off = (patch.pressing / patch.areas - hertz.pressure(x, y))[core]
    return float(np.sqrt(np.mean(off**2)) / hertz.p0)


def _shear(patch: Patch, scene: Scene, mesh: CurvedMesh, friction: float) -> float:
    """Error of the shear traction along x, rms over its peak (row 14)."""
    hertz, whole = _hertz(patch, scene, mesh), _quarters(mesh)
    P, Q = whole * patch.normal_force, -whole * float(patch.traction[:, 0].sum())
    r = np.hypot(*patch.position[:, :2].T)
    exact = cattaneo_mindlin(r, hertz, Q, P, friction)
    off = -patch.traction[:, 0] / patch.areas - exact
    return float(np.sqrt(np.mean(off**2)) / np.abs(exact).max())


def _creepage(
    record: Record, scene: Scene, mesh: CurvedMesh, friction: float, turning: Driven, still: Driven
) -> float:
    """Error of the creepage for the traction that it makes, in plane strain (row 15)."""
    pair, width = next(iter(scene.contacts)), mesh.y[1] - mesh.y[0]
    last = -max(1, round(STEADY * len(record.history["t"])))
    P, Q = (
        float(np.mean(record.history[f"{pair}_{key}"][last:])) / width
        for key in ("normal_force", "tangential_x_force")
    )
    radius, speed = mesh.radius or np.inf, turning.velocity[0] - still.velocity[0]
    relative = _radii(mesh)[0]
    half_width = hertz_line(P, relative, _modulus(scene)).a
    exact = carter_creepage(Q, P, friction, half_width, relative)
    return float(abs((1 - turning.spin[1] * radius / speed) / exact - 1))


def _hertz(patch: Patch, scene: Scene, mesh: CapMesh | CurvedMesh) -> Hertz:
    """Return the contact of Hertz under the force that was found."""
    radii = _radii(mesh)
    if isinstance(mesh, CurvedMesh) and mesh.layers:
        share = 2 if mesh.x[0] == 0 else 1
        load = share * patch.normal_force / (mesh.y[1] - mesh.y[0])
        return hertz_line(load, radii[0], _modulus(scene))
    return hertz_ellipse(_quarters(mesh) * patch.normal_force, *radii, _modulus(scene))


def _quarters(mesh: CapMesh | CurvedMesh) -> int:
    """Return how many times the modelled part makes the whole, by its planes of symmetry."""
    if isinstance(mesh, CapMesh):
        return 4
    return int(2 ** sum(ends[0] == 0 for ends in (mesh.x, mesh.y)))


def _radii(mesh: CapMesh | CurvedMesh) -> tuple[float, float]:
    """Return the radii of the relative curvature along x and y [m]."""
    if isinstance(mesh, CapMesh):
        return mesh.radius, mesh.radius
    pairs = (mesh.radius, mesh.base_radius), (mesh.crown, mesh.base_crown)
    curvatures = [sum(1 / radius for radius in pair if radius) for pair in pairs]
    x, y = (1 / c if c else float("inf") for c in curvatures)
    return x, y


def _modulus(scene: Scene) -> float:
    """Return the contact modulus of the first and the last body [Pa]."""
    moduli = [_elastic(body) for body in scene.bodies.values()]
    return contact_modulus(*moduli[0], *moduli[-1])


def _elastic(body: Any) -> tuple[float, float]:
    return body.material.youngs_modulus, body.material.poisson_ratio
