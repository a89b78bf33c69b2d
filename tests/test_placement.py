# SPDX-License-Identifier: LGPL-3.0-or-later
import numpy as np
import pytest

from meshes.measured import from_points
from meshes.outline import gap_function, outline
from meshes.placement import lateral_shift_for, place, placed, rail_in_track
from meshes.profiles import rail_54e1, s1002, shifted


def cone(slope):
    """A straight conical profile from -60 to 60 mm."""
    y = np.linspace(-0.06, 0.06, 25)
    return from_points(np.column_stack([y, -slope * y]))


def test_outline_of_yawed_cone():
    """On a cone r = R - γ y the normal is normal to x at sin θ = γ tan ψ, on every circle."""
    slope, yaw, radius = 0.05, 0.02, 0.46
    wheel = cone(slope)
    s = np.linspace(0, wheel.length, 7)
    x = outline(wheel, s, radius, yaw)
    axle, ahead = np.array([-np.sin(yaw), np.cos(yaw), 0]), np.array([np.cos(yaw), np.sin(yaw), 0])
    assert np.hypot(x @ ahead, x[:, 2]) == pytest.approx(radius - slope * (x @ axle))
    assert (x @ ahead) / np.hypot(x @ ahead, x[:, 2]) == pytest.approx(slope * np.tan(yaw))


def test_upright_wheel_touches_from_above():
    """No other point of wheel and rail is closer than the touching one, which closes to 10 nm."""
    wheel, rail = s1002(), rail_in_track()
    p = place(shift=0.002)
    y, z = (wheel.at(np.arange(0.06, wheel.length, 1e-5)) * [1, -1]).T
    y, z = y + 0.752, z + p.centre[2] - 0.46
    top, height = rail.at(np.arange(0, rail.length, 1e-5)).T
    inside = (y > top.min() + 1e-3) & (y < top.max() - 1e-3)
    clearance = z[inside] - np.interp(y[inside], *np.sort([top, height], axis=1)[:1], height)
    assert clearance.min() == pytest.approx(0.0, abs=1e-8)


def test_contact_is_common_tangent():
    """At the touching point wheel and rail share the normal, so angle and slope agree."""
    rail = rail_in_track()
    for shift in (0.0, 0.002, 0.004):
        p = place(shift=shift)
        assert p.tread_angle == pytest.approx(float(rail.angle(p.tread_rail_s)), abs=2e-3)
        assert p.rolling_radius == pytest.approx(p.centre[2] - p.tread_point[2], abs=1e-9)


@pytest.mark.parametrize("yaw", [0.0, 0.01, 0.02])
@pytest.mark.parametrize("gap", [1e-4, 3e-4])
def test_flange_gap(yaw, gap):
    """The shift solves for the gap; the flange meets the rail ahead by R tan 70° tan ψ."""
    p = lateral_shift_for(flange_gap=gap, yaw=yaw)
    assert p.flange_gap == pytest.approx(gap, abs=1e-8)
    assert 0.005 < p.shift < 0.0075
    lead = p.flange_radius * np.tan(p.flange_angle) * np.tan(yaw) * np.cos(yaw)
    offset = (p.flange_point[1] - p.centre[1]) * np.tan(yaw)
    assert p.flange_point[0] == pytest.approx(lead - offset, abs=2e-4)


def test_gap_out_of_reach():
    with pytest.raises(ValueError, match="flange_gap"):
        lateral_shift_for(flange_gap=0.1)


def test_wheel_beside_the_rail():
    with pytest.raises(ValueError, match="not above the rail"):
        place(rail=shifted(rail_54e1(), [2.0, 0.0]))
