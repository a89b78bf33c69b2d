# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact forces over time as closed forms have them, to be drawn behind those of a run."""

import numpy as np
from scipy.integrate import solve_ivp

from contact.theory import kalker
from contact.theory.closed_forms import carter_creepage
from meshes.arrays import Array
from workflow.results.record import Record
from workflow.theory.assumptions import coulomb
from workflow.theory.bars import wall_impact
from workflow.theory.blocks import sliding
from workflow.theory.rolling import imposed
from workflow.theory.smooth import Smooth, applied, smooth, strike

Curve = tuple[str, Array, Array]  # label, times [s], forces [N]


def closed_forms(record: Record, pair: str) -> list[Curve]:
    """Return the closed forms of a pair's forces: label, times [s], forces [N]; or nothing."""
    scene, load = record.checked, applied(record)
    if (hit := wall_impact(scene)) is not None:
        times = hit.touch + np.array([0.0, 0.0, hit.stay, hit.stay])
        force = hit.force * np.array([0, 1, 1, 0, 0])
        return [("ρ c v A during 2L/c", np.append(times, scene.time.end), force)]
    if load is None:
        bodies = smooth(record)
        return [*_impact(record, bodies), *_creep(record, bodies, pair)] if bodies else []
    curves = [("load", np.array([0.0, scene.time.end]), load * np.ones(2))]
    if (slide := sliding(scene)) is not None:
        times = np.array([0.0, min(slide.stop, scene.time.end)])
        force = slide.friction * slide.load * np.ones(2)
        curves.append(("friction × load until rest", times, force))
    return curves


def _impact(record: Record, bodies: Smooth) -> list[Curve]:
    """Return the force of a Hertzian impact from time zero on (Johnson 11.21)."""
    hit = strike(record)
    if hit is None:
        return []
    rate = hit.stiffness / hit.mass

    def motion(t: float, state: Array) -> list[float]:
        return [state[1], -rate * max(state[0], 0.0) ** 1.5]

    t = np.linspace(0, record.history["t"][-1], 400)
    found = solve_ivp(motion, (0, t[-1]), [0, hit.speed], t_eval=t, rtol=1e-8, atol=1e-14)
    force = hit.stiffness / bodies.parts * np.maximum(found.y[0], 0) ** 1.5
    return [("Hertz, impact", t, force)]


def _creep(record: Record, bodies: Smooth, pair: str) -> list[Curve]:
    """Return the tangential force at the imposed creepage and the last normal force."""
    motion, friction = imposed(record.checked), coulomb(record.checked.contacts[pair])
    normal = record.history[f"{pair}_normal_force"]
    if not bodies.rolls or not bodies.alike or motion is None or not friction:
        return []
    if not len(normal) or normal[-1] <= 0:
        return []
    (xi, eta), hertz, limit = motion[0], bodies.hertz(normal[-1]), friction * normal[-1]
    if bodies.plane:
        whole = carter_creepage(limit, normal[-1], friction, hertz.a, bodies.radii[0])
        name, force = "Carter", limit * (1 - max(1 - abs(xi / whole), 0.0) ** 2)
    else:
        E, nu = bodies.moduli[0]
        axes, shear = (hertz.a, hertz.b), E / (2 * (1 + nu))
        linear = kalker.creep_force((float(xi), float(eta), 0.0), axes, shear, nu)
        size = float(np.linalg.norm(linear)) / bodies.parts
        name, force = "Kalker", kalker.saturated(size, limit)
    times = np.array([0.0, record.history["t"][-1]])
    return [(f"{name}, tangential, steady", times, force * np.ones(2))]
