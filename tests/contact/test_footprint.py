# SPDX-License-Identifier: LGPL-3.0-or-later
"""Footprints: two patches, their resultants, stick and slip."""

import numpy as np
import pytest

from contact import ContactPair, rigid_plane
from contact.footprint import stick_zone
from tests.skins import evaluate, skin, state_of


def two_bumps(friction=0.3):
    """A skin with a deep bump at y = -0.02 and a shallow one at y = +0.02, on a plane."""

    def height(x, y):
        deep = (np.abs(y + 0.02) < 0.006) & (np.abs(x) < 0.006)
        low = (np.abs(y - 0.02) < 0.003) & (np.abs(x) < 0.003)
        return 1e-4 - 1.02e-4 * deep - 1.01e-4 * low

    plate = skin(20, 40, 0.04, 0.08, height, up=False, origin=(-0.02, -0.04), first=500)
    plane = rigid_plane((0, 0, 0), (0, 0, 1), 1.0)
    n = 3 * len(plate.nodes)
    pair = ContactPair(plate, plane, dt=1e-6, friction=friction)
    return plate, pair, state_of(np.zeros(n), np.zeros(n))


def test_two_patches():
    """5 x 5 nodes at 2 um and 3 x 3 nodes at 1 um depth; numbered from high y to low y."""
    plate, pair, state = two_bumps()
    evaluate(pair, state)
    foot = pair.footprint()
    one, two = foot.patches
    assert (one.nodes, two.nodes) == (9, 25)
    assert one.centre == pytest.approx([0, 0.02, -1e-6], abs=1e-12)
    assert two.centre == pytest.approx([0, -0.02, -2e-6], abs=1e-12)
    assert (np.bincount(foot.patch) == [9, 25]).all()
    kn = 0.2 * plate.mass[plate.mass.argmax()] / 1e-12
    assert one.normal_force == pytest.approx(9 * kn * 1e-6)
    assert two.normal_force == pytest.approx(25 * kn * 2e-6)
    assert two.area == pytest.approx(25 * 4e-6, rel=2e-3)
    assert two.max_pressure == pytest.approx(kn * 2e-6 / 4e-6, rel=2e-3)
    assert two.contact_angle == pytest.approx(0.0) and two.normal_resultant[2] > 0
    assert (foot.node == plate.nodes[np.isin(plate.nodes, foot.node)]).all()
    assert foot.pressure == pytest.approx(foot.normal_force / foot.area)


def test_contact_angle():
    """A plane tilted by 70 degrees about x gives a contact angle of 70 degrees."""
    angle = np.radians(70.0)
    normal = np.array([0.0, -np.sin(angle), np.cos(angle)])
    plate = skin(4, 4, 0.04, 0.04, lambda x, y: 0 * x, up=False, origin=(-0.02, -0.02))
    across = np.array([0.0, np.cos(angle), np.sin(angle)])
    x = plate.reference
    turned = x[:, :1] * [1, 0, 0] + x[:, 1:2] * across - 1e-6 * normal
    u = (turned - x).ravel()
    pair = ContactPair(plate, rigid_plane((0, 0, 0), normal, 1.0), dt=1e-6)
    evaluate(pair, state_of(u, np.zeros(u.size)))
    (patch,) = pair.footprint().patches
    assert patch.nodes == 25 and patch.contact_angle == pytest.approx(angle)


def test_stick_and_slip():
    """Pushed sideways past the limit of the shallow patch only: deep one sticks, shallow slips."""
    _, pair, state = two_bumps()
    evaluate(pair, state)
    state.u.x.array[0::3] += 4e-7
    state.v.x.array[0::3] = 0.4
    evaluate(pair, state)
    shallow, deep = pair.footprint().patches
    assert (shallow.sticking, deep.sticking) == (0, 25)
    assert shallow.tangential_force[0] == pytest.approx(-0.3 * shallow.normal_force)
    assert pair.footprint().slip_velocity[:, 0] == pytest.approx(0.4)
    assert pair.footprint(stick_tolerance=1.0).patches[1].sticking == 0


def test_stick_zone_tolerance():
    traction = np.array([[1.0, 0, 0], [0, 0.96, 0], [0, 0, 0.5]])
    assert stick_zone(np.ones(3), traction, 0.05).tolist() == [False, False, True]


def test_no_contact_is_an_empty_footprint():
    _, pair, state = two_bumps()
    state.u.x.array[2::3] = 1e-3
    evaluate(pair, state)
    foot = pair.footprint()
    assert foot.patches == () and len(foot.node) == 0 and foot.stick.shape == (0,)


def test_conformal_patches_are_parted_at_the_valley():
    """Two bumps joined by nodes that press with a tenth of the lower one: two patches, not one."""

    def height(x, y):
        one, two = np.abs(y + 0.012) < 0.006, np.abs(y - 0.012) < 0.006
        return 1e-4 - 1e-4 * (np.abs(x) < 0.006) - 2e-6 * one - 1e-6 * two - 1e-7

    plate = skin(20, 20, 0.04, 0.04, height, up=False, origin=(-0.02, -0.02))
    pair = ContactPair(plate, rigid_plane((0, 0, 0), (0, 0, 1), 1.0), dt=1e-6)
    n = 3 * len(plate.nodes)
    evaluate(pair, state_of(np.zeros(n), np.zeros(n)))
    foot = pair.footprint()
    upper, lower = foot.patches
    assert upper.centre[1] == pytest.approx(0.012, abs=2e-3)
    assert lower.centre[1] == pytest.approx(-0.012, abs=2e-3)
    assert lower.max_pressure == pytest.approx(2.1 / 1.1 * upper.max_pressure)
    assert upper.nodes + lower.nodes == len(foot.node)


def test_resultants_in_the_frame_of_the_patch():
    """A plate spun about the normal of a tilted plane: spin moment, no net shear; then pulled."""
    angle = np.radians(30.0)
    normal = np.array([0.0, -np.sin(angle), np.cos(angle)])
    across = np.array([0.0, np.cos(angle), np.sin(angle)])
    plate = skin(4, 4, 0.04, 0.04, lambda x, y: 0 * x, up=False, origin=(-0.02, -0.02))
    x = plate.reference
    on = x[:, :1] * [1, 0, 0] + x[:, 1:2] * across
    start = on - 1e-6 * normal - x
    pair = ContactPair(plate, rigid_plane((0, 0, 0), normal, 1.0), dt=1e-6, friction=0.5)
    state = state_of(start.ravel(), np.zeros(x.size))
    evaluate(pair, state)

    def moved(by):
        """The patch after one step in which each node moves by ``by``; all from the same start."""
        pair.reset()
        state.u.x.array[:] = start.ravel()
        state.v.x.array[:] = 0.0
        evaluate(pair, state)
        state.v.x.array[:] = by.ravel() / pair.dt
        state.u.x.array[:] += by.ravel()
        evaluate(pair, state)
        (patch,) = pair.footprint().patches
        return patch

    turned = moved(1e-6 * np.cross(normal, on))
    kt = 0.2 * plate.mass / 1e-12
    assert turned.spin_moment == pytest.approx(-1e-6 * kt @ (on**2).sum(axis=1), rel=1e-3)
    assert np.abs(turned.shear_stress).max() < 1e-3 * abs(turned.spin_moment) / 0.04**3
    np.testing.assert_allclose(turned.frame, [[1, 0, 0], across, normal], atol=1e-9)
    pulled = moved(1e-8 * (np.cos(0.7) * np.array([1, 0, 0]) + np.sin(0.7) * across) + 0 * on)
    shear = -1e-8 * kt.sum() * np.array([np.cos(0.7), np.sin(0.7)])
    np.testing.assert_allclose(pulled.force_in_frame[:2], shear, rtol=1e-6)
    np.testing.assert_allclose(pulled.shear_stress, shear / pulled.area, rtol=1e-6)
    assert pulled.force_in_frame[2] == pytest.approx(pulled.normal_force)
    np.testing.assert_allclose(pulled.frame.T @ pulled.force_in_frame, pulled.force)
    # on the target it points forward: 180 degrees from the negative longitudinal axis
    assert pulled.shear_angle == pytest.approx(0.7 - np.pi, abs=1e-6)
