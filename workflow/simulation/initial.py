# SPDX-License-Identifier: LGPL-3.0-or-later
"""The state a run starts from: bodies apart, at rest under their loads, then set in motion."""

from collections.abc import Callable
from typing import Any

import numpy as np

from workflow.model.geometry import cell_size
from workflow.model.model import Model
from workflow.scene.scene import SceneError
from workflow.simulation.prescribed import moves


def check_apart(model: Model) -> None:
    """Refuse bodies that overlap by more than a hundredth of a cell before the run."""
    size = cell_size(model.scene, model.domain.source)
    limit, look = 0.01 * size, 50 * size
    for name, pair in model.pairs.items():
        depth, node, place = pair.penetration(model.state, look)
        if depth > limit:
            x, y, z = place
            raise SceneError(
                f"contacts.{name}: bodies overlap at the start by {depth:.3e} m at node {node} "
                f"(x = {x:.5f}, y = {y:.5f}, z = {z:.5f} m); expected at most {limit:.1e} m"
            )


def start(model: Model, log: Callable[[str], Any]) -> None:
    """Bring the model to rest and set its initial velocities, as the scene asks."""
    scene = model.scene
    if scene.equilibrium is not None:
        extra = np.zeros(0)
        if scene.rolling is not None:
            from workflow.simulation import rolling

            extra = rolling.centrifugal(model)
        if scene.equilibrium.method == "relaxation":
            from workflow.simulation.relaxation import relaxation

            relaxation(model, scene.equilibrium, extra, log)
        else:
            from workflow.simulation.equilibrium import equilibrium

            equilibrium(model, scene.equilibrium, extra, log)
    v = model.state.v.x.array.reshape(-1, 3)
    for name, body in scene.bodies.items():
        if body.velocity is not None:
            v[model.bodies.dofs(name)] = body.velocity
    model.supports(model.state.v.x)
    if scene.rolling is not None:
        from workflow.simulation import rolling

        rolling.start(model)
    if scene.driven or moves(scene):
        from workflow.simulation import prescribed

        prescribed.start(model)
    model.state.v.x.scatter_forward()
