# SPDX-License-Identifier: LGPL-3.0-or-later
"""Scene in, study out."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from workflow.model import Model, build
    from workflow.model.state import State
    from workflow.results.result import Result, read_run
    from workflow.scene import Scene, SceneError
    from workflow.simulation.initial import rest
    from workflow.simulation.run import run
    from workflow.simulation.stepping import central_difference
    from workflow.theory.wheel_on_rail import at_rest, half_axes

__all__ = [
    "Model",
    "Result",
    "Scene",
    "SceneError",
    "State",
    "at_rest",
    "build",
    "central_difference",
    "half_axes",
    "read_run",
    "rest",
    "run",
]

_HOME = {
    "Model": "model",
    "Result": "results.result",
    "Scene": "scene",
    "SceneError": "scene",
    "State": "model.state",
    "at_rest": "theory.wheel_on_rail",
    "build": "model",
    "central_difference": "simulation.stepping",
    "half_axes": "theory.wheel_on_rail",
    "read_run": "results.result",
    "rest": "simulation.initial",
    "run": "simulation.run",
}


def __getattr__(name: str) -> Any:
    """Import on first use: ``squealx --help`` should not load DOLFINx."""
    if name not in _HOME:
        raise AttributeError(f"module 'workflow' has no attribute {name!r}")
    return getattr(import_module(f"workflow.{_HOME[name]}"), name)
