# SPDX-License-Identifier: LGPL-3.0-or-later
"""Scene in, study out."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from workflow.scene.scene import Scene
    from workflow.simulation.run import Result, run

__all__ = ["Result", "Scene", "run"]


def __getattr__(name: str) -> Any:
    """Import on first use: ``squealx --help`` should not load DOLFINx."""
    if name == "Scene":
        from workflow.scene.scene import Scene

        return Scene
    if name in ("run", "Result"):
        from workflow.simulation import run as running

        return getattr(running, name)
    raise AttributeError(name)
