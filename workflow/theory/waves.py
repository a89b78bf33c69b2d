# SPDX-License-Identifier: LGPL-3.0-or-later
"""Waves in a slender bar without contact: the ringing of a bar that is held at one end."""

from collections.abc import Iterator

import numpy as np

from workflow.results.record import Record
from workflow.scene.mesh import BarMesh
from workflow.theory import readings
from workflow.theory.assumptions import SLENDER, SMALL, bare, held, material, undamped, velocity
from workflow.theory.quantity import ENERGY, WAVES, Expected


def held_bar(record: Record) -> Iterator[Expected]:
    """Answers for a bar held at one end and thrown along its axis: d'Alembert's waves.

    Assumes a slender bar without damping or contact, held along its axis at one end only.
    """
    scene = record.checked
    mesh, steel = scene.mesh, material(scene, scene.mesh.regions[0])
    if not isinstance(mesh, BarMesh) or mesh.length < SLENDER * mesh.width or steel is None:
        return
    if not bare(scene) or not undamped(scene) or scene.contacts or scene.loads or scene.driven:
        return
    (speed, across, up), ends = velocity(scene, "bar"), [held(scene, e) for e in ("xmin", "xmax")]
    sides = {s.surface for s in scene.supports} - {"xmin", "xmax"}
    if not speed or across or up or sorted(map(len, ends)) != [0, 1] or sides:
        return
    if "x" not in ends[0] | ends[1] or scene.equilibrium:
        return
    E, rho, L = steel.youngs_modulus, steel.density, mesh.length
    c = float(np.sqrt(E / rho))
    if abs(speed) > SMALL * c:
        return
    kinetic, t = record.history["kinetic"], record.history["t"]
    whole = rho * mesh.width**2 * L * speed**2 / 2
    passed = readings.crossings(t, kinetic, kinetic[0] / 2)  # every L/c
    if len(passed) > 1:
        found = (len(passed) - 1) / (4 * float(np.ptp(passed)))
        yield Expected("frequency, c/4L", "Hz", found, c / (4 * L), WAVES)
    tip = _tip(record, "xmax" if ends[0] else "xmin", L / c)
    if tip is not None:
        when, value = tip
        exact = speed * (L / c - abs(when - L / c))
        yield Expected("displacement of the free end after L/c", "m", value, exact, WAVES)
    energy = float(kinetic[-1] + record.history["internal"][-1])
    yield Expected("energy at the end", "J", energy, whole, ENERGY)


def _tip(record: Record, end: str, t: float) -> tuple[float, float] | None:
    """Return output time by ``t`` [s] and mean displacement of an end [m]; None without fields."""
    times = record.history["t"]
    if record.body is None or times[-1] < t:
        return None
    when = float(times[np.argmin(np.abs(times - t))])
    x = record.body.points[:, 0]
    edge = np.isclose(x, x.max() if end == "xmax" else x.min())
    return when, float(record.displacement(when)[edge, 0].mean())
