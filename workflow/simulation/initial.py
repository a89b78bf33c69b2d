# SPDX-License-Identifier: LGPL-3.0-or-later
"""State that a run starts from: at rest under its loads, then set in motion."""

import numpy as np

from workflow.model import Model
from workflow.model.supports import axle
from workflow.scene.settings import Equilibrium
from workflow.simulation import prescribed, rolling
from workflow.simulation.at_rest import AtRest, Log, move


def rest(model: Model, log: Log = lambda line: None) -> int:
    """Bring a model to rest under its loads, in place; return the iterations or steps used.

    The method is that of the scene's ``[equilibrium]``, Newton's where it has none. A shift along
    the axle follows the loads in increments: a loaded axle bends and takes the wheel off the rail's
    gauge corner by millimetres, which the unloaded placement cannot know.

    Args:
        model: The model; its displacement, contact state and point masses are set.
        log: Called with lines of progress.

    Raises:
        GuardError: if it does not come to rest.
    """
    scene, settings = model.scene, model.scene.equilibrium or Equilibrium()
    extra = rolling.centrifugal(model) if scene.rolling is not None else np.zeros(0)
    problem = AtRest(model, settings, extra)
    for body, approach in settings.approach.items():
        move(model, body, np.array(approach))
    # a scene imports the solver that it names
    if settings.method == "relaxation":
        from workflow.simulation.relaxation import relaxation as method
    else:
        from workflow.simulation.equilibrium import equilibrium as method
    solve, count = method(problem, log), settings.shift_increments if settings.shift else 0
    used = solve(count > 0)
    for k in range(1, count + 1):
        assert scene.rolling is not None
        move(model, scene.rolling.body, settings.shift / count * axle(scene))
        name = method.__name__
        log(f"{name}: shifted along the axle by {k / count * settings.shift:.2e} m")
        used += solve(k < count)
    return used


def start(model: Model, log: Log) -> None:
    """Bring the model to rest and set its initial velocities, as the scene asks."""
    if model.scene.equilibrium is not None:
        rest(model, log)
    set_in_motion(model)


def set_in_motion(model: Model) -> None:
    """Set the initial velocities of a model at rest, in place."""
    scene = model.scene
    v = model.state.v.x.array.reshape(-1, 3)
    for name, body in scene.bodies.items():
        if body.velocity is not None:
            v[model.bodies.dofs(name)] = body.velocity
    model.supports(model.state.v.x)
    if scene.rolling is not None:
        rolling.start(model)
    prescribed.start(model)
    model.state.v.x.scatter_forward()
