# SPDX-License-Identifier: LGPL-3.0-or-later
"""Model of a scene: mesh, mass, forms, supports, loads, contacts and the stable step."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from workflow.model.model import Model, build

__all__ = ["Model", "build"]


def __getattr__(name: str) -> Any:
    """Import on first use: a placement or a region does not need compiled forms."""
    if name not in __all__:
        raise AttributeError(f"module 'workflow.model' has no attribute {name!r}")
    from workflow.model import model

    return getattr(model, name)
