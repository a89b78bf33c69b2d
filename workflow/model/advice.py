# SPDX-License-Identifier: LGPL-3.0-or-later
"""Advice on the settings of a scene that are known to go wrong, told before its mesh is made.

What a scene is likely to suffer from, by its settings alone: ``validate``, ``run`` and ``audit``
say it alike. What only the model at rest tells is left to the audit.
"""

from collections.abc import Iterator

import numpy as np

from workflow.model.cost import Cost, host_memory, size_in_words, time_in_words
from workflow.scene.bodies import MEMORY, Orthotropic
from workflow.scene.mesh import Foreign, WheelRailMesh
from workflow.scene.scene import Scene

ANGLE = 0.06  # largest angle of attack of the stability matrix [rad]
TURN = 0.01  # from which on rotation and rounding matter [rad]
HOP = 0.05  # energy gained at a landing, above which sliding is noisy
GIVE = 3.0  # implicit penalty from which on the modes of a sliding block are within 1 %
LONG = 3 * 86400.0  # s of one core
LARGE = 20e9  # bytes of results


def doubts(scene: Scene, cost: Cost | None = None) -> Iterator[str]:
    """Yield a line for every setting of a scene that its run is likely to suffer from.

    Args:
        scene: The scene.
        cost: What its run takes; not spoken of if None.
    """
    if scene.time.safety > 1:
        yield f"time.safety = {scene.time.safety}: beyond the bound of the stable step"
    yield from _bodies(scene)
    yield from _contacts(scene)
    if scene.passes and not any(body.material.law in MEMORY for body in scene.bodies.values()):
        yield "passes: no material of the scene has a memory (law = 'j2'): all passes are alike"
    if scene.rolling and abs(scene.rolling.angle_of_attack) > ANGLE:
        yield (
            f"rolling.angle_of_attack = {scene.rolling.angle_of_attack}: beyond the {ANGLE} rad "
            "that were tried"
        )
    if cost is not None:
        yield from _costs(scene, cost)


def _costs(scene: Scene, cost: Cost) -> Iterator[str]:
    interval = scene.output.sample_interval
    if interval is not None and interval < 0.7 * cost.step:
        yield (
            f"output.sample_interval = {interval}: a sample is the mean over at least one step, "
            f"about {cost.step:.1e} s"
        )
    if cost.seconds > LONG:
        yield f"time.end = {scene.time.end}: about {time_in_words(cost.seconds)} on one core"
    if cost.disk > LARGE:
        yield (
            f"time.output_interval = {scene.time.output_interval}: about "
            f"{size_in_words(cost.disk)} of results; output.fields = false leaves the largest out"
        )
    if (most := host_memory()) < 1.5 * cost.memory:
        yield (
            f"mesh: {cost.cells} cells take about {size_in_words(cost.memory)} of memory, this "
            f"machine has {size_in_words(most)}"
        )


def turns(scene: Scene) -> dict[str, float]:
    """Return by how much each body turns in the run, as far as the scene tells [rad]."""
    angle = {}
    for name, driven in scene.driven.items():
        angle[name] = float(np.linalg.norm(driven.spin)) * scene.time.end
    mesh, radius = scene.mesh, None
    if isinstance(mesh, Foreign):
        radius = mesh.rolling_radius
    elif isinstance(mesh, WheelRailMesh):
        radius = mesh.wheel_radius
    if scene.rolling and radius:
        angle[scene.rolling.body] = abs(scene.rolling.speed) / radius * scene.time.end
    return angle


def _bodies(scene: Scene) -> Iterator[str]:
    for name, body in scene.bodies.items():
        m, key, coefficient = body.material, f"bodies.{name}", body.hourglass_coefficient
        if not isinstance(m, Orthotropic) and m.poisson_ratio > 0.45:
            if coefficient:
                yield (
                    f"{key}: a hourglass_coefficient locks at poisson_ratio = {m.poisson_ratio}; "
                    "without it the stiffness of the material is taken"
                )
            if "full" in body.elements:
                yield (
                    f"{key}: full quadrature locks at poisson_ratio = {m.poisson_ratio}; "
                    "element = 'one-point' or 'selective' does not"
                )


def _contacts(scene: Scene) -> Iterator[str]:
    for name, contact in scene.contacts.items():
        key, p = f"contacts.{name}", contact.penalty
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
