# SPDX-License-Identifier: LGPL-3.0-or-later
"""Wheel contact locus and gap function.

The rail is a prism along x and the wheel a surface of revolution about the yawed axle. Their
shortest distance is normal to x, so it is met on the wheel where the normal has no x component:
``cos(yaw) sin(theta) - sin(yaw) sin(roll) cos(theta) = sin(yaw) cos(roll) n_y / n_r`` on the
parallel circle with profile normal ``(n_y, n_r)``. This trace, seen along x, is the wheel's
outline, and contact in space becomes contact of plane curves.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from meshes.arrays import Array
from meshes.profiles.profiles import Profile

SPACING = 1e-5  # of the points of the rail that are compared; the gap is then exact to 1e-9 m


@dataclass(frozen=True)
class Gap:
    """Distance between the outline of a placed wheel and the rail.

    Attributes:
        s: Arc length on the wheel profile, shape ``(n,)`` [m].
        points: Points of the outline, shape ``(n, 3)`` [m].
        vertical: Height above the rail top, NaN beside the rail, shape ``(n,)`` [m].
        normal: Distance to the nearest point of the rail, negative within it, shape ``(n,)`` [m].
    """

    s: Array
    points: Array
    vertical: Array
    normal: Array


def outline(wheel: Profile, s: Array, radius: float, yaw: float, roll: float = 0.0) -> Array:
    """Return the points of the wheel that can touch a prism along x, shape ``(n, 3)`` [m].

    Where the profile is too steep for the yaw no such point exists and NaN stands in its place.

    Args:
        wheel: Wheel profile.
        s: Arc length on it, shape ``(n,)`` [m].
        radius: Radius of the tape circle [m].
        yaw: Angle of attack [rad].
        roll: Angle by which the axle rises towards the field side [rad].
    """
    axle, ahead, up = axes(yaw, roll)
    sine, cosine = _where(wheel, s, axle, ahead, up)
    eta, r = wheel.at(s).T
    r = r + radius
    return np.asarray(
        eta[:, None] * axle + (r * sine)[:, None] * ahead - (r * cosine)[:, None] * up
    )


def axes(yaw: float, roll: float) -> tuple[Array, Array, Array]:
    """Return the directions of the axle, ahead of the wheel and up in its plane, ``(3,)`` each."""
    c, s = np.cos(yaw), np.sin(yaw)
    ahead = np.array([c, s, 0.0])
    axle = np.array([-s * np.cos(roll), c * np.cos(roll), np.sin(roll)])
    return axle, ahead, np.cross(ahead, axle)


def _where(wheel: Profile, s: Array, axle: Array, ahead: Array, up: Array) -> tuple[Array, Array]:
    """Return sine and cosine of the angle ahead of the bottom at which normals have no x."""
    n_y, n_r = wheel.normal(s).T
    lead = np.arctan2(up[0], ahead[0])
    with np.errstate(invalid="ignore", divide="ignore"):
        angle = lead + np.arcsin(-axle[0] * n_y / n_r / np.hypot(ahead[0], up[0]))
    angle[n_r <= 0] = np.nan
    return np.sin(angle), np.cos(angle)


def contact_angle(wheel: Profile, s: float, yaw: float, roll: float) -> float:
    """Return the angle of the contact plane with the horizontal at a point of the outline."""
    axle, ahead, up = axes(yaw, roll)
    at = np.array([s])
    (sine,), (cosine,) = _where(wheel, at, axle, ahead, up)
    n_y, n_r = wheel.normal(at)[0]
    normal = n_y * axle + n_r * (sine * ahead - cosine * up)
    return float(np.arctan2(normal[1], -normal[2]))


def gap_function(
    wheel: Profile,
    rail: Profile,
    centre: Array,
    *,
    radius: float,
    yaw: float = 0.0,
    roll: float = 0.0,
    spacing: float = 1e-4,
) -> Gap:
    """Return the distance of a placed wheel from the rail along its outline.

    Args:
        wheel: Wheel profile.
        rail: Rail profile in the track.
        centre: Centre of the tape circle, shape ``(3,)`` [m].
        radius: Radius of the tape circle [m].
        yaw: Angle of attack [rad].
        roll: Angle by which the axle rises towards the field side [rad].
        spacing: Distance of the points along the wheel profile [m].
    """
    s = np.arange(0, wheel.length, spacing)
    points = outline(wheel, s, radius, yaw, roll) + centre
    s, points = s[np.isfinite(points[:, 2])], points[np.isfinite(points[:, 2])]
    y, z, _ = seen_from_above(rail)
    vertical = points[:, 2] - np.interp(points[:, 1], y, z, left=np.nan, right=np.nan)
    return Gap(s, points, vertical, distance(points, rail)[0])


def seen_from_above(rail: Profile) -> tuple[Array, Array, Array]:
    """Return y, z and arc length of the part of a rail that is seen from above, y rising [m]."""
    s = np.arange(0, rail.length, SPACING)
    y, z = rail.at(s).T
    top = np.maximum.accumulate(y) == y
    top[1:] &= np.diff(y) > 0
    return y[top], z[top], s[top]


def distance(points: Array, rail: Profile) -> tuple[Array, Array]:
    """Return the signed distance of points from the rail and the arc length of its nearest ones."""
    s = np.arange(0, rail.length, SPACING)
    _, near = cKDTree(rail.at(s)).query(points[:, 1:])
    gap = np.sum((points[:, 1:] - rail.at(s[near])) * rail.normal(s[near]), axis=1)
    return np.asarray(gap), s[near]
