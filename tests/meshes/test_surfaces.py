# SPDX-License-Identifier: LGPL-3.0-or-later
"""Running surfaces in space against the outline of a yawed wheel, and moved rigidly."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from meshes.profiles.outline import contact_angle, outline
from meshes.profiles.placement import RADIUS, TAPE, place, rail_in_track
from meshes.profiles.profiles import s1002
from meshes.profiles.surfaces import rail_surface, wheel_surface

YAW, ROLL = 0.02, 0.003
WHEEL, RAIL = s1002(), rail_in_track()
CENTRE = np.array([0.1, TAPE, RADIUS])


def test_outline_lies_on_the_wheel():
    """Points where a yawed wheel can touch a rail, made from normals in the plane: 1e-9 m."""
    wheel = wheel_surface(WHEEL, RADIUS, CENTRE, YAW, ROLL)
    s = np.linspace(0.045, 0.12, 200)  # from within the flange to the tread's end
    points = outline(WHEEL, s, RADIUS, YAW, ROLL) + CENTRE
    assert np.abs(wheel.depth(points)[0]).max() < 1e-9


def test_normals_of_the_outline_have_no_x():
    """Where a yawed wheel touches a prism along x its normal is across, at the contact angle."""
    wheel = wheel_surface(WHEEL, RADIUS, CENTRE, YAW, ROLL)
    for s in (0.05, 0.07, 0.09):
        point = (outline(WHEEL, np.array([s]), RADIUS, YAW, ROLL) + CENTRE)[0]
        normal = wheel.normal(point)
        assert normal[0] == pytest.approx(0, abs=1e-6)
        angle = np.arctan2(normal[1], -normal[2])
        assert angle == pytest.approx(contact_angle(WHEEL, s, YAW, ROLL), abs=1e-6)


def test_heights_meet_the_surface():
    """Along a slanted direction the points found have no depth; beside the rail there are none."""
    rail = rail_surface(RAIL)
    across = np.linspace(-0.02, 0.015, 50)
    normal = np.array([0.0, -np.sin(0.2), np.cos(0.2)])
    tangent = np.array([0.0, np.cos(0.2), np.sin(0.2)])
    plane = RAIL.at(RAIL.s[np.argmax(RAIL.points[:, 1])])
    plane = np.array([0.3, *plane]) + across[:, None] * tangent
    found = plane + rail.heights(plane, normal)[:, None] * normal
    assert np.abs(rail.depth(found)[0]).max() < 1e-12
    beside = plane + np.array([0.0, 0.2, 0.0])
    assert np.isnan(rail.heights(beside, normal)).all()


def test_surfaces_move_as_their_points():
    """A surface turned and shifted carries its points along; depth grows inwards."""
    wheel = wheel_surface(WHEEL, RADIUS, CENTRE, YAW)
    points = outline(WHEEL, np.linspace(0.05, 0.1, 20), RADIUS, YAW) + CENTRE
    about, turn, shift = np.array([0.0, 0.7, 0.0]), np.array([0.1, -0.2, 0.3]), np.ones(3)
    moved = wheel.moved(shift, turn, about)
    there = about + shift + (points - about) @ Rotation.from_rotvec(turn).as_matrix().T
    depth, gradient = moved.depth(there)
    assert np.abs(depth).max() < 1e-9
    step = 1e-6 * gradient / np.linalg.norm(gradient, axis=1)[:, None]
    rise = (moved.depth(there + step)[0] - moved.depth(there - step)[0]) / 2e-6
    assert rise == pytest.approx(np.linalg.norm(gradient, axis=1), rel=1e-4)


def test_curvatures():
    """Wheel: the cone's cos / r along; rail: an arc of the head across, 0 along."""
    at = place(shift=0.002)
    wheel, rail = wheel_surface(WHEEL, RADIUS, at.centre), rail_surface(RAIL)
    along, across = wheel.curvatures(at.tread_point)
    assert along == pytest.approx(np.cos(at.tread_angle) / at.rolling_radius, rel=1e-6)
    assert across == pytest.approx(-WHEEL.curvature(at.tread_s), rel=1e-2)
    along, across = rail.curvatures(at.tread_point)
    assert along == 0
    assert min(abs(1 / across - r) for r in (0.013, 0.08, 0.3)) < 1e-6
