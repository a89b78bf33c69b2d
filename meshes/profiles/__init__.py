# SPDX-License-Identifier: LGPL-3.0-or-later
"""Wheel and rail profiles: drawn, measured or a user's own, and the placement of wheel on rail.

A :class:`Profile` of one's own comes from points (:func:`from_points`), a file of text, MiniProf or
SIMPACK (:func:`from_csv`, or :func:`read` with what was understood of it) or arrays of arc length,
points, tangent angles and curvatures.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from meshes.profiles.measured import Reading as Reading
    from meshes.profiles.measured import from_csv as from_csv
    from meshes.profiles.measured import from_points as from_points
    from meshes.profiles.measured import read as read
    from meshes.profiles.orientation import Axes as Axes
    from meshes.profiles.placement import RADIUS as RADIUS
    from meshes.profiles.placement import Placement as Placement
    from meshes.profiles.placement import lateral_shift_for as lateral_shift_for
    from meshes.profiles.placement import place as place
    from meshes.profiles.placement import rail_in_track as rail_in_track
    from meshes.profiles.profiles import RAILS as RAILS
    from meshes.profiles.profiles import Profile as Profile
    from meshes.profiles.profiles import inclined as inclined
    from meshes.profiles.profiles import rail as rail
    from meshes.profiles.profiles import s1002 as s1002
    from meshes.profiles.profiles import shifted as shifted
    from meshes.profiles.surfaces import rail_surface as rail_surface
    from meshes.profiles.surfaces import wheel_surface as wheel_surface

_HOME = {
    "Axes": "orientation",
    "Placement": "placement",
    "Profile": "profiles",
    "RADIUS": "placement",
    "RAILS": "profiles",
    "Reading": "measured",
    "from_csv": "measured",
    "from_points": "measured",
    "inclined": "profiles",
    "lateral_shift_for": "placement",
    "place": "placement",
    "rail": "profiles",
    "rail_in_track": "placement",
    "read": "measured",
    "rail_surface": "surfaces",
    "s1002": "profiles",
    "shifted": "profiles",
    "wheel_surface": "surfaces",
}

__all__ = [*_HOME]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'meshes.profiles' has no attribute {name!r}")
    return getattr(import_module(f"meshes.profiles.{_HOME[name]}"), name)
