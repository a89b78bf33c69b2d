# SPDX-License-Identifier: LGPL-3.0-or-later
import numpy as np
import pytest

from meshes.profiles.measured import from_points
from meshes.profiles.outline import gap_function, outline
from meshes.profiles.placement import lateral_shift_for, place, placed, rail_in_track
from meshes.profiles.profiles import rail_54e1, s1002, shifted
from meshes.tags import Tag
from meshes.wheel_rail.wheelset import wheelset


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


def crown(radius=0.3):
    """A round rail head, its top at (0.75, 0), drawn by points 0.25 mm apart."""
    y = np.linspace(-0.035, 0.035, 281)
    points = np.column_stack([y + 0.75, np.sqrt(radius**2 - y**2) - radius])
    return from_points(points)


@pytest.mark.parametrize("shift", [-0.005, 0.0, 0.01])
@pytest.mark.parametrize(("yaw", "roll"), [(0.0, 0.0), (0.02, 0.0), (-0.05, 0.0), (0.0, 0.01)])
def test_cone_on_crown(shift, yaw, roll):
    """A 1:20 cone touches a 300 mm crown where the slopes agree.

    Normals without x lie at sin θ = γ tan ψ ahead of the bottom, so the outline of the cone is a
    line of slope tan β = γ / (cos ψ cos θ), turned by the roll; it touches 300 mm sin β off the
    middle, and the centre stands r cos θ above that point.
    """
    slope, radius = 1 / 20, 0.46
    p = place(cone(slope), crown(), shift=shift, yaw=yaw, roll=roll)
    sine = slope * np.tan(yaw)
    cosine = np.sqrt(1 - sine**2)
    beta = np.arctan(slope / (np.cos(yaw) * cosine)) + roll
    y, z = 0.75 - 0.3 * np.sin(beta), 0.3 * np.cos(beta) - 0.3
    assert p.tread_point[1:] == pytest.approx([y, z], abs=1e-5)
    assert p.tread_angle == pytest.approx(beta, abs=1e-7)
    along = (y - 0.75 - shift) / np.cos(yaw)  # on the axle, but for the lead of the contact
    if roll == 0.0:
        eta = (along - radius * sine * np.tan(yaw)) / (1 - slope * sine * np.tan(yaw))
        r = radius - slope * eta
        assert p.rolling_radius == pytest.approx(r, abs=1e-6)
        assert p.centre[2] == pytest.approx(z + r * cosine, abs=1e-6)
        assert p.tread_point[0] == pytest.approx(
            r * sine * np.cos(yaw) - eta * np.sin(yaw), abs=1e-5
        )
    else:
        base = np.array([np.cos(roll), np.sin(roll)])
        foot = np.array([y - 0.75 - shift, z - p.centre[2]])
        eta = foot @ base
        assert radius - slope * eta == pytest.approx(foot @ [base[1], -base[0]], abs=1e-7)
    assert p.flange_gap is None


@pytest.mark.parametrize("roll", [0.0, 0.01])
def test_gap_function_of_cone(roll):
    """Over a crown the outline of a cone is a line: gap z₀ + (y - y₀) tan β - √(ρ² - y²) + ρ."""
    wheel, rail = cone(1 / 20), crown()
    p = place(wheel, rail, shift=0.003, roll=roll)
    gap = gap_function(wheel, rail, p.centre, radius=0.46, roll=roll)
    y, z = gap.points[:, 1] - 0.75, gap.points[:, 2]
    over = np.isfinite(gap.vertical)
    line = p.tread_point[2] + (y - p.tread_point[1] + 0.75) * np.tan(np.arctan(1 / 20) + roll)
    assert z == pytest.approx(line, abs=1e-9)
    exact = (line - np.sqrt(0.3**2 - y**2, where=over, out=np.ones_like(y)) + 0.3)[over]
    assert gap.vertical[over] == pytest.approx(exact, abs=2e-9)
    inside = over & (np.abs(y) < 0.03)
    radial = np.hypot(y, z + 0.3) - 0.3
    assert gap.normal[inside] == pytest.approx(radial[inside], abs=1e-8)
    nearest = 0.5e-4**2 / 2 / 0.3  # a point at most half a spacing from the contact
    assert -1e-9 < gap.vertical[over].min() < nearest + 1e-9


@pytest.mark.parametrize(("yaw", "roll"), [(0.02, 0.0), (0.0, 0.03), (0.03, -0.02)])
def test_placed_mesh_follows_the_outline(yaw, roll):
    """No node of the placed tread lies below the outline; one comes within 20 µm of it."""
    p = place(shift=0.004, yaw=yaw, roll=roll)
    mesh = placed(wheelset(size=4e-3), p)
    x = mesh.points[np.unique(mesh.surface(Tag.TREAD))]
    s = np.arange(0.06, 0.12, 1e-5)
    line = (outline(s1002(), s, 0.46, yaw, roll) + p.centre)[:, 1:]
    band = (x[:, 1] > line[:, 0].min() + 2e-3) & (x[:, 1] < line[:, 0].max() - 2e-3)
    clear = x[band, 2] - np.interp(x[band, 1], *line.T)
    assert clear.min() > -1e-7 and clear.min() < 2e-5


def test_gap_needs_a_flange():
    with pytest.raises(ValueError, match="flange_gap: expected a wheel with a flange"):
        lateral_shift_for(cone(0.05), crown())
