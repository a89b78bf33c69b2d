# SPDX-License-Identifier: LGPL-3.0-or-later
"""Advice that takes a model at rest: room in the step, penetration, rounding."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from workflow.audit.limits import PassSprings
from workflow.model.advice import TURN, turns
from workflow.model.bodies import isotropic
from workflow.model.model import Model

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
    for name, told in found["contacts"].items():
        depth, share = told["penetration"], told["penetration_over_cell"]
        if share is not None and share > SOFT:
            yield f"contacts.{name}: expected penetration {depth:.1e} m is {share:.0%} of a cell"


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
