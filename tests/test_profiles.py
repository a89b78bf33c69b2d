# SPDX-License-Identifier: LGPL-3.0-or-later
import numpy as np
import pytest

from meshes.measured import from_csv
from meshes.placement import rail_in_track
from meshes.profiles import inclined, rail_54e1, s1002


def test_s1002_flange():
    """Flange 28 mm high with its tip at -55 mm, 32.5 mm thick 10 mm below the tape circle."""
    wheel = s1002()
    y, r = wheel.points.T
    tip = np.argmax(r)
    assert r[tip] == pytest.approx(28e-3, abs=1e-7) and y[tip] == pytest.approx(-55e-3, abs=5e-5)
    flank = slice(tip, tip + 1000)
    assert np.interp(-10e-3, -r[flank], y[flank]) + 70e-3 == pytest.approx(32.5e-3, abs=2e-6)
    assert np.degrees(-wheel.angles[tip:].min()) == pytest.approx(70.0, abs=1e-4)


@pytest.mark.parametrize("profile", [s1002(chamfer=False), rail_54e1(), rail_54e1("outline")])
def test_joints_are_smooth(profile):
    """Position and direction are continuous; ``at`` runs at unit speed along the arc length."""
    assert np.abs(np.diff(profile.angles)).max() < 0.03
    s = np.linspace(0, profile.length - 1e-6, 4001)
    speed = np.hypot(*(profile.at(s + 1e-6) - profile.at(s)).T) / 1e-6
    # the published S1002 coefficients leave a 0.1 µm step at the start of the flange root
    assert speed == pytest.approx(1.0, abs=2e-3)
    assert (
        np.abs(np.sum(profile.normal(s) * (profile.at(s + 1e-6) - profile.at(s)), 1)).max() < 3e-9
    )


def test_radii():
    """The flange root and the gauge corner are arcs of 13 mm, hollow and round."""
    wheel, rail = s1002(), rail_54e1()
    root = wheel.s[np.argmin(np.abs(wheel.points[:, 0] + 36e-3))]
    assert wheel.curvature(root) == pytest.approx(1 / 13e-3)
    assert rail.curvature((rail.joints[1] + rail.joints[2]) / 2) == pytest.approx(-1 / 13e-3)
    assert rail.curvature(rail.length / 2 + 1e-3) == pytest.approx(-1 / 0.3)


def test_rail_section():
    """Area 69.775 cm2, second moments 2338 and 419.08 cm4, centre 75.13 mm above the foot."""
    y, z = rail_54e1("outline").points.T
    z = z + 0.159
    cross = -(y[:-1] * z[1:] - y[1:] * z[:-1])
    area = cross.sum() / 2
    centre = (cross * (z[:-1] + z[1:])).sum() / (6 * area)
    iy, iz = ((cross * (u[:-1] ** 2 + u[:-1] * u[1:] + u[1:] ** 2)).sum() / 12 for u in (z, y))
    assert area == pytest.approx(69.775e-4, rel=1e-4)
    assert centre == pytest.approx(75.13e-3, abs=1e-5)
    assert iy - area * centre**2 == pytest.approx(2338.0e-8, rel=2e-4)
    assert iz == pytest.approx(419.08e-8, rel=2e-4)


@pytest.mark.parametrize("slope", [0.0, 1 / 40, 1 / 20])
def test_gauge_in_track(slope):
    """Highest point at z = 0, gauge face at half of 1435 mm, 14 mm below; rail leaning in."""
    rail = rail_in_track(inclination=slope)
    y, z = rail.at(np.arange(0, rail.length, 1e-5)).T
    top = np.argmax(z)
    assert z[top] == pytest.approx(0.0, abs=1e-9)
    assert np.interp(-14e-3, z[:top], y[:top]) == pytest.approx(0.7175, abs=1e-8)
    crown = inclined(rail_54e1(), slope).angle(rail.length / 2)
    assert crown == pytest.approx(np.arctan(slope))


def test_csv_round_trip(tmp_path):
    """A profile read from 0.5 mm points differs from the drawing by less than 1 µm."""
    rail = rail_54e1()
    points = rail.at(np.arange(0, rail.length, 0.5e-3))
    path = tmp_path / "rail.csv"
    np.savetxt(path, points * 1e3, delimiter=",", header="y,z", comments="")
    read = from_csv(path)
    s = np.linspace(0.01, 0.11, 101)
    offset = np.sum((read.at(s) - rail.at(s)) * rail.normal(s), axis=1)
    assert np.abs(offset).max() < 1e-6


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ([[0, 0], [1, 0]], "4 or more"),
        ([[0, 0], [1, 0], [1, 0], [2, 0], [3, 0]], "repeats"),
        ([[0, 0], [2, 0], [1, 0.01], [3, 0], [4, 0]], "not monotone"),
        ([[0, 0], [2, 0], [2, 1], [1, 1], [1, -1]], "intersects"),
    ],
)
def test_bad_csv(tmp_path, rows, message):
    path = tmp_path / "bad.csv"
    np.savetxt(path, rows)
    with pytest.raises(ValueError, match=message):
        from_csv(path)


def test_missing_csv():
    with pytest.raises(FileNotFoundError, match=r"nowhere\.csv"):
        from_csv("nowhere.csv")
