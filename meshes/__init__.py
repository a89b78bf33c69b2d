# SPDX-License-Identifier: LGPL-3.0-or-later
"""Hexahedral meshes of wheel, rail and bodies with closed-form answers; running-surface profiles.

A mesh is a :class:`HexMesh`, plain arrays; :func:`distribute` spreads it over the ranks. Names are
imported when they are first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from meshes.domain import Domain as Domain
    from meshes.domain import distribute as distribute
    from meshes.hexmesh import HexMesh as HexMesh
    from meshes.hexmesh import boundary as boundary
    from meshes.hexmesh import join as join
    from meshes.shapes.blocks import bar as bar
    from meshes.shapes.blocks import block as block
    from meshes.shapes.blocks import grid as grid
    from meshes.tags import Tag as Tag
    from meshes.wheel_rail.rail import rail as rail
    from meshes.wheel_rail.wheelset import wheelset as wheelset

_HOME = {
    "Domain": "domain",
    "HexMesh": "hexmesh",
    "Tag": "tags",
    "bar": "shapes.blocks",
    "block": "shapes.blocks",
    "boundary": "hexmesh",
    "distribute": "domain",
    "grid": "shapes.blocks",
    "join": "hexmesh",
    "rail": "wheel_rail.rail",
    "wheelset": "wheel_rail.wheelset",
}

__all__ = [*_HOME]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'meshes' has no attribute {name!r}")
    return getattr(import_module(f"meshes.{_HOME[name]}"), name)
