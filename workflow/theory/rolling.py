# SPDX-License-Identifier: LGPL-3.0-or-later
"""Steady rolling of smooth bodies: Carter in plane strain, Kalker and CONTACT in space."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from contact.theory import kalker
from contact.theory.closed_forms import (
    Hertz,
    carter_creepage,
    carter_stick_ratio,
    carter_traction,
)
from meshes.arrays import Array
from workflow.results.patch_nodes import PatchNodes
from workflow.results.record import Record
from workflow.scene.mesh import CurvedMesh
from workflow.scene.scene import Scene
from workflow.theory import readings
from workflow.theory.assumptions import coulomb
from workflow.theory.quantity import CARTER, CONTACT, ENERGY, KALKER, Expected
from workflow.theory.smooth import Smooth, pressing

STEADY = 0.2  # of the run at its end, over which forces in rolling are averaged
ROLLED = 10.0  # half axes that a contact rolls until it is steady
SHIFTED = 3.0  # the same where a shift made most of the traction before
LINEAR = 0.2  # of the limit of friction: creep forces up to which Kalker's theory is linear

# Results of CONTACT for steel with ν = 0.3, a cylinder of 460 mm on a crown of 300 mm under 100 kN:
# coefficient of friction, traction over load, creepage, share of the area that sticks
CASES = np.array(
    [
        (0.6, 0.10, 0.0007251, 0.9119),
        (0.5, 0.15, 0.001143, 0.8280),
        (0.6, 0.20, 0.001545, 0.8087),
        (0.6, 0.30, 0.002502, 0.6955),
        (0.5, 0.30, 0.002643, 0.6158),
    ]
)
LOAD, AXES, POISSON = 1e5, (7.162e-3, 5.387e-3), 0.3  # of these cases [N], [m], [-]
SCALE = 210e9 / (2 * (1 + POISSON)) * AXES[0] * AXES[1] / LOAD  # of creepage over friction


@dataclass(frozen=True)
class Rolling:
    """Steady rolling of one body on another at a creepage that is imposed.

    Attributes:
        bodies: The bodies.
        patch: Contact at the last output.
        hertz: Its shape under the mean force.
        friction: Coefficient of friction [-].
        creepage: Longitudinal and lateral, shape ``(2,)`` [-].
        speed: Speed of rolling, negative against x [m/s].
        normal: Mean normal force on the model [N].
        tangential: Mean tangential force on the upper body, along and across, ``(2,)`` [N].
    """

    bodies: Smooth
    patch: PatchNodes
    hertz: Hertz
    friction: float
    creepage: Array
    speed: float
    normal: float
    tangential: Array

    @property
    def limit(self) -> float:
        """Largest tangential force on the model [N]."""
        return self.friction * self.normal

    def linear(self) -> Array:
        """Return the force of Kalker's linear theory on the model, shape ``(2,)`` [N]."""
        E, nu = self.bodies.moduli[0]
        way = (float(self.creepage[0]), float(self.creepage[1]), 0.0)
        axes = (self.hertz.a, self.hertz.b)
        return kalker.creep_force(way, axes, E / (2 * (1 + nu)), nu) / self.bodies.parts


def imposed(scene: Scene) -> tuple[Array, float] | None:
    """Return the creepages that driven bodies impose, ``(2,)``, and the speed of rolling [m/s].

    None unless one body turns about the y axis and another passes under it.
    """
    mesh = scene.mesh
    turning = [d for d in scene.driven.values() if any(d.spin)]
    passing = [d for d in scene.driven.values() if not any(d.spin)]
    if not isinstance(mesh, CurvedMesh) or mesh.radius is None:
        return None
    if len(turning) != 1 or len(passing) != 1 or turning[0].spin[0] or turning[0].spin[2]:
        return None
    along, across, _ = np.subtract(turning[0].velocity, passing[0].velocity)
    if not along:
        return None
    rim = turning[0].spin[1] * mesh.radius
    return np.array([along - rim, across]) / along, float(along)


def steady(record: Record) -> Rolling | None:
    """Return the steady rolling at the end of a run, None if there is none.

    Assumes what :func:`~workflow.theory.smooth.pressing` does, bodies that are alike, constant
    friction, and a way of ``ROLLED`` half axes, ``SHIFTED`` ones after a shift that is over.
    """
    found, motion = pressing(record), imposed(record.checked)
    if found is None or motion is None or not found[0].rolls or not found[0].alike:
        return None
    bodies, patch, hertz = found
    (contact,) = record.checked.contacts.values()
    friction, upper = coulomb(contact), 1 if contact.contactor == "cap" else -1
    end, shifts = readings.until(record), [d.shift_time for d in record.checked.driven.values()]
    way = SHIFTED if any(shifts) else ROLLED
    if not friction or abs(motion[1]) * end < way * hertz.a or end < 2 * max(shifts):
        return None
    t, normal, tangential = readings.forces(record)
    last = t > t[0] + (1 - STEADY) * (t[-1] - t[0])
    force = float(normal[last].mean())
    mean = upper * tangential[last, :2].mean(axis=0)
    return Rolling(bodies, patch, bodies.hertz(force), friction, *motion, force, mean)


def carter(record: Record) -> Iterator[Expected]:
    """Answers of Carter for a driven or braked roller in plane strain: see :func:`steady`."""
    rolling = steady(record)
    if rolling is None or not rolling.bodies.plane or rolling.creepage[1]:
        return
    bodies, hertz, friction = rolling.bodies, rolling.hertz, rolling.friction
    P, Q = bodies.whole(rolling.normal), bodies.whole(float(rolling.tangential[0]))
    if not 0 < abs(Q) < friction * P:
        return
    exact = carter_creepage(Q, P, friction, hertz.a, bodies.radii[0])
    xi = float(rolling.creepage[0])
    yield Expected("creepage for the traction", "1", xi, exact, CARTER)
    left = max(1 - abs(xi) * bodies.radii[0] / (friction * hertz.a), 0.0)
    force = -float(np.sign(xi)) * rolling.limit * (1 - left**2)
    along = float(rolling.tangential[0])
    yield Expected("tangential force at the creepage", "N", along, force, CARTER)
    yield from _carter_zone(rolling, record.checked)
    yield from _power(record, rolling)


def _carter_zone(rolling: Rolling, scene: Scene) -> Iterator[Expected]:
    """Stick zone and tractions at the last output under the forces there."""
    bodies, patch, friction = rolling.bodies, rolling.patch, rolling.friction
    along = float(patch.tangential_forces[:, 0].sum())
    P, Q = bodies.whole(patch.normal_force), bodies.whole(along)
    if not 0 < abs(Q) < friction * P or not isinstance(scene.mesh, CurvedMesh):
        return
    hertz, ratio = bodies.hertz(patch.normal_force), carter_stick_ratio(Q, P, friction)
    x, stick = bodies.local(patch)[:, 0], patch.stick
    size = scene.mesh.size
    width = float(np.ptp(x[stick])) + size if stick.any() else 0.0
    yield Expected("width of the stick zone", "m", width, 2 * ratio * hertz.a, CARTER)
    exact = carter_traction(np.sign(rolling.speed) * x, hertz, ratio, friction)
    off = np.sign(along) * patch.tangential_forces[:, 0] / patch.areas - exact
    rms = float(np.sqrt(np.mean(off**2)) / exact.max())
    yield Expected("nodal shear off Carter's, rms over its peak", "1", rms, 0.0, CARTER)


def creep_force(record: Record) -> Iterator[Expected]:
    """Answers of Kalker's theory at small creepage without spin: see :func:`steady`.

    Assumes a force up to ``LINEAR`` of its limit; the little that slips is taken into account.
    """
    rolling = steady(record)
    if rolling is None or rolling.bodies.plane or not any(rolling.creepage):
        return
    linear = rolling.linear()
    size = float(np.linalg.norm(linear))
    if size > LINEAR * rolling.limit:
        return
    exact = kalker.saturated(size, rolling.limit) / size * linear
    for k, name in enumerate(("longitudinal creep force, c11", "lateral creep force, c22")):
        if rolling.creepage[k]:
            value = float(rolling.tangential[k])
            yield Expected(name, "N", value, float(exact[k]), KALKER)
    yield from _power(record, rolling)


def half_space_code(record: Record) -> Iterator[Expected]:
    """Answers of the half-space code CONTACT at any longitudinal creepage: see :func:`steady`.

    Assumes the ratio of half axes and the Poisson ratio of its ``CASES``, to one per cent, and a
    creepage among theirs; load, friction and size only scale them.
    """
    rolling = steady(record)
    if rolling is None or rolling.bodies.plane or rolling.creepage[1] or not rolling.creepage[0]:
        return
    hertz, (E, nu) = rolling.hertz, rolling.bodies.moduli[0]
    shear, P = E / (2 * (1 + nu)), rolling.bodies.whole(rolling.normal)
    xi, like = float(rolling.creepage[0]), hertz.a / hertz.b / (AXES[0] / AXES[1])
    scaled = abs(xi) / rolling.friction * shear * hertz.a * hertz.b / P
    table = SCALE * CASES[:, 2] / CASES[:, 0]
    if abs(like - 1) > 0.01 or abs(nu - POISSON) > 0.01 or not table[0] <= scaled <= table[-1]:
        return
    traction = float(rolling.tangential[0]) / rolling.normal
    exact = -float(np.sign(xi)) * rolling.friction * traction_share(scaled)
    yield Expected("traction over normal force", "1", traction, exact, CONTACT)
    patch = rolling.patch
    sticks = float(patch.areas[patch.stick].sum()) / patch.area
    exact = float(np.interp(scaled, table, CASES[:, 3]))
    yield Expected("share of the area that sticks", "1", sticks, exact, CONTACT)
    yield from _power(record, rolling)


def traction_share(scaled: float) -> float:
    """Return the traction of CONTACT over its limit at a creepage between its cases [-].

    Its ratio to the creep force of Vermeulen and Johnson is near 1 and changes evenly.

    Args:
        scaled: Creepage over friction, times shear modulus and half axes over load [-].
    """
    c11 = kalker.coefficient("c11", AXES[0] / AXES[1], POISSON)
    table = SCALE * CASES[:, 2] / CASES[:, 0]
    theirs = [kalker.saturated(c11 * s, 1.0) for s in table]
    ratio = np.interp(scaled, table, CASES[:, 1] / CASES[:, 0] / theirs)
    return float(ratio) * kalker.saturated(c11 * scaled, 1.0)


def _power(record: Record, rolling: Rolling) -> Iterator[Expected]:
    """Power of friction in steady rolling: force times creepage times speed.

    Nodes give it off in bursts as they leave: it is the slope of the heat over the steady part.
    """
    t, heat = record.history["t"], record.history["friction_dissipation"]
    last = t > t[0] + (1 - STEADY) * (t[-1] - t[0])
    if last.sum() < 3:
        return
    power = float(np.polyfit(t[last], heat[last], 1)[0])
    exact = abs(float(rolling.tangential @ rolling.creepage * rolling.speed))
    yield Expected("power of friction, force × creepage × speed", "W", power, exact, ENERGY)
