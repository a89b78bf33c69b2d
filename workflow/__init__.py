# SPDX-License-Identifier: LGPL-3.0-or-later
"""Scene in, study out."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from workflow.running import Result, run
    from workflow.scene import Scene

__all__ = ["Result", "Scene", "run"]


def __getattr__(name: str) -> Any:
    """Import on first use: ``squealx --help`` should not load DOLFINx."""
    if name == "Scene":
        from workflow.scene import Scene

        return Scene
    if name in ("run", "Result"):
        from workflow import running

        return getattr(running, name)
    raise AttributeError(name)
