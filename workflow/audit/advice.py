# SPDX-License-Identifier: LGPL-3.0-or-later
"""Advice on the settings of a scene that are known to go wrong, each with its measure."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from contact.theory.slip_waves import HalfSpace, slip_wave
from workflow.audit.limits import PassSprings
from workflow.model.bodies import isotropic
from workflow.model.model import Model
from workflow.model.regions import body_at
from workflow.scene.bodies import Isotropic

SOFT = 0.05  # penetration over the cell
ANGLE = 0.06  # largest angle of attack of the stability matrix [rad]
FLOAT32 = 6e-8  # rounding of one number
HOP = 0.05  # energy gained at a landing, above which sliding is noisy
GIVE = 3.0  # implicit penalty from which on the modes of a sliding block are within 1 %


def advice(model: Model, found: dict[str, Any]) -> Iterator[str]:
    """Yield a line for every setting of a scene that its run is likely to suffer from.

    Args:
        model: The model of the audit.
        found: The audit so far.
    """
    scene = model.scene
    asked, safety = found["asked"]["all"], scene.time.safety
    if asked >= 1:
        yield f"time.safety = {safety}: {asked:.1%} of a stable step is asked for; the run blows up"
    elif safety > 1:
        yield f"time.safety = {safety}: beyond the bound, {1 - asked:.1%} of the step is left"
    yield from model.bodies.doubts()
    yield from _bodies(model)
    yield from _contacts(model, found)
    if scene.rolling and abs(scene.rolling.angle_of_attack) > ANGLE:
        yield (
            f"rolling.angle_of_attack = {scene.rolling.angle_of_attack}: beyond the {ANGLE} rad "
            "that were tried"
        )


def _bodies(model: Model) -> Iterator[str]:
    scene, turned = model.scene, turns(model)
    for name, body in scene.bodies.items():
        m, key = body.material, f"bodies.{name}"
        if isinstance(m, Isotropic) and m.poisson_ratio > 0.45 and body.element == "full":
            yield (
                f"{key}: full quadrature locks at poisson_ratio = {m.poisson_ratio}; "
                "element = 'one-point' or 'selective' does not"
            )
        angle = turned.get(name, 0.0)
        if angle > 0.01 and body.kinematics == "small-strain":
            yield (
                f"{key}.kinematics = 'small-strain': the body turns by {angle:.2g} rad, which it "
                f"takes for strains of up to {1 - np.cos(min(angle, np.pi)):.1g}"
            )
        in_frame = name in model.bodies.turning()  # a frame that turns with it takes that away
        if scene.time.precision == "float32" and angle > 0.01 and not in_frame:
            noise = FLOAT32 * min(angle, 2.0)
            yield (
                f"time.precision = 'float32': {key} turns by {angle:.2g} rad, and rounding its "
                f"displacement gradient is as good as strains of {noise:.0e}"
            )


def turns(model: Model) -> dict[str, float]:
    """Return by how much each body turns in the run, as far as the scene tells [rad]."""
    scene, angle = model.scene, {}
    for name, driven in scene.driven.items():
        angle[name] = float(np.linalg.norm(driven.spin)) * scene.time.end
    if scene.rolling and model.placement is not None:
        spin = scene.rolling.speed / model.placement.rolling_radius
        angle[scene.rolling.body] = abs(spin) * scene.time.end
    return angle


def _contacts(model: Model, found: dict[str, Any]) -> Iterator[str]:
    scene = model.scene
    for name, contact in scene.contacts.items():
        key, told = f"contacts.{name}", found["contacts"][name]
        p = contact.penalty
        if contact.method == "penalty" and p / 4 + contact.damping * p**0.5 >= 1:
            yield f"{key}.penalty = {contact.penalty}: leaves no room in the step"
        elif contact.method == "penalty" and contact.friction != 0.0:
            # the mass that a node moves is at least its own: no spring is stiffer than p
            gain = max(landing_gain(q) for q in np.linspace(0.05, 1, 20) * p)
            if gain > HOP:
                yield (
                    f"{key}.penalty = {p}: where sliding makes nodes hop, a landing adds up to "
                    f"{gain:.0%} of their energy in the mean; 1.5 % at 0.8, 75 % at 3; "
                    "method = 'implicit-penalty' adds none"
                )
        elif contact.method == "implicit-penalty" and p < GIVE:
            yield (
                f"{key}.penalty = {p}: gives way as much as the cells behind; the modes of a block "
                "of 4 cells are 28 % too slow at 0.4, 8 % at 1; 10 to 30 is as stable"
            )
        depth, share = told["penetration"], told["penetration_over_cell"]
        if share is not None and share > SOFT:
            yield f"{key}: expected penetration {depth:.1e} m is {share:.0%} of a cell"
        if contact.friction != 0.0 and (pair := _half_spaces(model, name)) is not None:
            speed = slip_wave(*pair)
            if speed is not None and pair[0] != pair[1]:
                yield (
                    f"{key}.friction: the bodies carry slip waves of {speed:.0f} m/s, which any "
                    "Coulomb friction makes grow, the shorter the faster, without limit as cells "
                    "shrink (Ranjith and Rice, 2001); friction with memory or damping bounds it"
                )


def landing_gain(penalty: float, phases: int = 2001) -> float:
    """Return the mean energy that a node gains when it lands on a spring and leaves it again [-].

    Stepping a spring of ``p m/dt²`` that only pushes, with the landing anywhere between two steps:
    nothing where half a period is a whole number of steps (p = 1, 2), below 7 % up to p = 2 and
    steeply more beyond.

    Args:
        penalty: p, below 4 [-].
        phases: Landings that are tried.
    """
    x = -(np.arange(phases) + 0.5) / phases  # in units of speed times dt
    v, inside = -np.ones(phases), np.ones(phases, dtype=bool)
    while inside.any():
        v = np.where(inside, v - penalty * x, v)
        x = np.where(inside, x + v, x)
        inside &= x < 0
    return float((v**2).mean() - 1)


def _half_spaces(model: Model, name: str) -> tuple[HalfSpace, HalfSpace] | None:
    """Return both sides of a contact as half spaces, None if one is rigid."""
    side = model.pairs[name].passes[0]
    if side.target.rigid or side.contactor.rigid:
        return None
    one, other = (_behind(model, int(s.nodes[0])) for s in (side.contactor, side.target))
    return one, other


def _behind(model: Model, node: int) -> HalfSpace:
    """Return the material at a mesh node."""
    body = body_at(model.scene, model.domain.source, node)
    m = isotropic(model.bodies.materials[body])
    return HalfSpace(m.E / (2 * (1 + m.nu)), m.nu, m.rho)


def impact_depth(model: Model, passes: Sequence[PassSprings]) -> float | None:
    """Return how deep the first wave of an impact presses the contact [m], None if none comes.

    Bodies that close at v press with ``v / (1/Z₁ + 1/Z₂)``, ``Z = ρ c`` of waves in the block.
    """
    start = [b.velocity for b in model.scene.bodies.values() if b.velocity is not None]
    if not (start and passes and len(passes[0].springs.mass)):
        return None
    one, springs = passes[0], passes[0].springs
    normal = springs.normal.mean(axis=0)
    still = len(start) < len(model.scene.bodies) or bool((springs.nodes < 0).any())
    speeds = [*(float(np.dot(v, normal)) for v in start), *([0.0] * still)]
    closing = max(speeds) - min(speeds)
    material = [isotropic(m) for m in model.bodies.materials.values()]
    Z = [(m.E * m.rho) ** 0.5 for m in material]
    yielding = sum(1 / z for z in Z) if len(Z) > 1 else 1 / Z[0]
    k = one.penalty * (springs.foundation if one.fixed else springs.mass / model.dt**2)
    return float(np.median(closing / yielding * springs.area / k))
