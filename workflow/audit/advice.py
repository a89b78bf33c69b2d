# SPDX-License-Identifier: LGPL-3.0-or-later
"""Advice that takes a model at rest: room in the step, penetration, rounding, slip waves."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from contact.theory.slip_waves import HalfSpace, slip_wave
from workflow.audit.limits import PassSprings
from workflow.model.advice import TURN, turns
from workflow.model.bodies import isotropic
from workflow.model.model import Model
from workflow.model.regions import body_at

SOFT = 0.05  # penetration over the cell
FLOAT32 = 6e-8  # rounding of one number


def advice(model: Model, found: dict[str, Any]) -> Iterator[str]:
    """Yield a line for what the model at rest has to doubt, beside what its scene has.

    Args:
        model: The model of the audit.
        found: The audit so far.
    """
    scene = model.scene
    asked, safety = found["asked"]["all"], scene.time.safety
    if asked >= 1:
        yield f"time.safety = {safety}: {asked:.1%} of a stable step is asked for; the run blows up"
    elif safety > 1:
        yield f"time.safety = {safety}: {1 - asked:.1%} of the step is left"
    yield from _rounding(model)
    for name, contact in scene.contacts.items():
        key, told = f"contacts.{name}", found["contacts"][name]
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


def _rounding(model: Model) -> Iterator[str]:
    """Yield a line for bodies that turn in single precision without a frame that turns along."""
    scene = model.scene
    if scene.time.precision != "float32":
        return
    framed = model.bodies.turning()
    for name, angle in turns(scene).items():
        if angle > TURN and name not in framed:
            noise = FLOAT32 * min(angle, 2.0)
            yield (
                f"time.precision = 'float32': bodies.{name} turns by {angle:.2g} rad, and rounding "
                f"its displacement gradient is as good as strains of {noise:.0e}"
            )


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
