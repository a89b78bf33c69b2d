# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sphere that yields on a rigid flat: the fit of Kogut and Etsion to finite elements.

Force over that at the critical approach, ``P / P_c = 1.03 (ω / ω_c)^1.425`` from the first yield to
six times its approach, ``ω_c = (π K H / 2 E')² R`` with ``K = 0.454 + 0.41 ν`` and ``H = 2.8 Y``
(J. Appl. Mech. 69, 2002, 657–662), ``P_c`` of Hertz.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from meshes.arrays import Array
from workflow.results.record import Record
from workflow.scene.bodies import ElastoPlastic
from workflow.scene.scene import Scene
from workflow.scene.settings import RigidWall
from workflow.theory import readings
from workflow.theory.assumptions import held, undamped, yielding
from workflow.theory.quantity import FLATTENING, STATICS, Expected

APPROACHES = (3.0, 6.0)  # of the critical one
ROUND = 1e-5  # of the radius, by which nodes may be off the sphere


@dataclass(frozen=True)
class Flattening:
    """A sphere pressed on a flat by its equator.

    Attributes:
        approach: Critical approach [m].
        force: Force at it on what is modelled [N].
    """

    approach: float
    force: float


def first_yield(steel: ElastoPlastic, radius: float) -> tuple[float, float]:
    """Return critical approach [m] and force [N] of a whole sphere."""
    nu = steel.poisson_ratio
    modulus = steel.youngs_modulus / (1 - nu**2)
    hardness = (0.454 + 0.41 * nu) * 2.8 * steel.yield_stress
    approach = (np.pi * hardness / (2 * modulus)) ** 2 * radius
    return approach, 4 / 3 * modulus * radius**0.5 * approach**1.5


def flattening(record: Record) -> Flattening | None:
    """Return the sphere of a scene, None if it has none.

    Assumes a perfectly plastic body that touches with a part of a sphere, its centre in the
    surface that is moved straight down on a frictionless wall, and planes of symmetry that are
    held.
    """
    scene, body = record.checked, record.body
    regions = scene.mesh.regions
    moved = [s for s in scene.supports if s.velocity]
    if body is None or len(regions) != 1 or len(moved) != 1 or len(scene.contacts) != 1:
        return None
    steel, (contact,) = yielding(scene, regions[0]), scene.contacts.values()
    wall = contact.target
    if steel is None or steel.hardening_modulus or steel.saturation_stress or steel.back_stresses:
        return None
    if not isinstance(wall, RigidWall) or wall.normal != (0.0, 0.0, 1.0) or contact.friction:
        return None
    if moved[0].directions != ["z"] or not undamped(scene) or loaded(scene):
        return None
    top = body.points[:, 2].max()
    radius = top - wall.origin[2]
    down = body.points + record.displacement(readings.until(record))
    touching = body.points[down[:, 2] < wall.origin[2] + ROUND * radius]
    off = np.linalg.norm(touching - (0.0, 0.0, top), axis=1) - radius
    if not radius > 0 or np.abs(off).max(initial=0.0) > ROUND * radius:
        return None
    approach, force = first_yield(steel, radius)
    halved = sum(axis in held(scene, f"{axis}min") for axis in "xy")
    return Flattening(approach, force / 2**halved)


def loaded(scene: Scene) -> bool:
    """Tell whether anything but supports and contact acts on a scene."""
    others = (scene.loads, scene.driven, scene.springs, scene.absorbing, scene.rolling)
    return any((*others, scene.vehicle, scene.track, *(scene.gravity or ())))


def flattened_sphere(record: Record) -> Iterator[Expected]:
    """Answers for a sphere that yields on a rigid flat, see :func:`flattening`.

    That the loading is slow enough is told by the kinetic energy at the largest approach, over
    what the sphere has taken up: its own way down is a part of it.
    """
    found = flattening(record)
    if found is None:
        return
    rows = [(t, float(-u[:, 2].min())) for t, u in _top(record)]
    t, approach = np.array(rows).T
    times, force, _ = readings.forces(record)
    share = approach / found.approach
    for wanted in APPROACHES:
        if share[-1] < wanted:
            return
        at = float(np.interp(wanted, share, t))
        value = float(np.interp(at, times, force)) / found.force
        name = f"P / P_c at {wanted:.0f} times the critical approach"
        yield Expected(name, "1", value, 1.03 * wanted**1.425, FLATTENING)
    history = record.history
    last = int(np.searchsorted(history["t"], at)) - 1
    taken = sum(float(history[name][last]) for name in ("internal", "plastic_dissipation"))
    name = "kinetic energy there, over the energy taken up"
    yield Expected(name, "1", float(history["kinetic"][last]) / taken, 0.0, STATICS)


def _top(record: Record) -> Iterator[tuple[float, Array]]:
    """Yield the displacement of the top by output."""
    body = record.body
    assert body is not None
    height = body.points[:, 2]
    top = height > height.max() - ROUND * np.ptp(height)
    for t, u in record.series("displacement"):
        yield t, u[top]
