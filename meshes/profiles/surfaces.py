# SPDX-License-Identifier: LGPL-3.0-or-later
"""Running surfaces of wheel and rail in space, and their heights over a plane.

A surface is a profile swept along a line or round an axle, in axes of its own that a rigid motion
carries along: local x along the rail or ahead, y across or along the axle, z up.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from meshes.arrays import Array
from meshes.profiles.outline import SPACING, axes, seen_from_above
from meshes.profiles.profiles import Profile

STEPS = 5  # of Newton's method, to 1e-16 m over the tread
MET = 1e-7  # depth before its last step, below which it has met the surface [m]


@dataclass(frozen=True)
class Surface:
    """A rail (prism) or a wheel (surface of revolution) where it stands.

    Attributes:
        profile: The profile of which ``y``, ``s`` is the part that is seen.
        y: Lateral coordinate, increasing, shape ``(n,)`` [m].
        s: Arc length there, shape ``(n,)`` [m].
        radius: Of the tape circle of a wheel, 0 for a rail [m].
        origin: Origin of the local axes, shape ``(3,)`` [m]; on the axle of a wheel.
        turn: Local axes as columns, shape ``(3, 3)``.
    """

    profile: Profile
    y: Array
    s: Array
    radius: float
    origin: Array
    turn: Array

    def moved(self, shift: Array, rotation: Array, about: Array) -> "Surface":
        """Return the surface turned by a rotation vector about a point [rad], then shifted [m]."""
        R = Rotation.from_rotvec(rotation).as_matrix()
        origin = about + shift + R @ (self.origin - about)
        return replace(self, origin=origin, turn=R @ self.turn)

    def depth(self, points: Array) -> tuple[Array, Array]:
        """Return how far points are within, along local z or the radius, and its gradient.

        Args:
            points: Shape ``(n, 3)`` [m].

        Returns:
            Depth, negative outside, shape ``(n,)`` [m]; gradient in space, shape ``(n, 3)`` [-].
        """
        x, y, z = ((points - self.origin) @ self.turn).T
        s = np.interp(y, self.y, self.s)
        (near, height), slope = self.profile.at(s).T, np.tan(self.profile.angle(s))
        height = height + slope * (y - near)  # s is interpolated
        if self.radius == 0.0:
            depth, gradient = height - z, [np.zeros_like(y), slope, -np.ones_like(y)]
        else:
            r = np.hypot(x, z)
            depth, gradient = self.radius + height - r, [-x / r, slope, -z / r]
        return depth, np.column_stack(gradient) @ self.turn.T

    def heights(self, plane: Array, normal: Array) -> Array:
        """Return the heights of the surface along a direction over points near it, ``(n,)`` [m].

        NaN where the line through a point does not meet it near by.

        Args:
            plane: The points, shape ``(n, 3)`` [m].
            normal: Unit vector, shape ``(3,)``.
        """
        height = np.zeros(len(plane))
        for _ in range(STEPS):
            depth, gradient = self.depth(plane + height[:, None] * normal)
            height = height - depth / (gradient @ normal)
        height[~(np.abs(depth) < MET)] = np.nan
        return height

    def normal(self, point: Array) -> Array:
        """Return the outward unit normal at a point of the surface, shape ``(3,)``."""
        gradient = self.depth(point[None])[1][0]
        return np.asarray(-gradient / np.linalg.norm(gradient))

    def curvatures(self, point: Array) -> tuple[float, float]:
        """Return the curvatures along and across at a point of it, positive where convex [1/m]."""
        x, y, z = (point - self.origin) @ self.turn
        s = np.interp(y, self.y, self.s)
        along = 0.0
        if self.radius:
            along = float(np.cos(self.profile.angle(s)) / np.hypot(x, z))
        return along, -float(self.profile.curvature(s))


def rail_surface(rail: Profile) -> Surface:
    """Return the running surface of a rail profile in the track: (y, z) of the global frame."""
    y, _, s = seen_from_above(rail)
    return Surface(rail, y, s, 0.0, np.zeros(3), np.eye(3))


def wheel_surface(
    wheel: Profile, radius: float, centre: Array, yaw: float = 0.0, roll: float = 0.0
) -> Surface:
    """Return the running surface of a wheel from the tip of its flange to the field side.

    Args:
        wheel: Wheel profile.
        radius: Radius of the tape circle [m].
        centre: Its centre, shape ``(3,)`` [m].
        yaw: Angle of attack [rad].
        roll: Angle by which the axle rises towards the field side [rad].
    """
    s = np.arange(0, wheel.length, SPACING)
    y, outward = wheel.at(s).T
    seen = np.arange(len(s)) >= np.argmax(outward)
    seen &= np.concatenate([[True], np.diff(np.maximum.accumulate(y)) > 0])
    axle, ahead, up = axes(yaw, roll)
    return Surface(wheel, y[seen], s[seen], radius, centre, np.column_stack([ahead, axle, up]))
