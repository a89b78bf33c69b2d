# SPDX-License-Identifier: LGPL-3.0-or-later
import re

import numpy as np
import pytest
from scipy.spatial import cKDTree

from meshes.profiles.measured import from_csv, from_points, read
from meshes.profiles.placement import rail_in_track
from meshes.profiles.profiles import RAILS, inclined, rail, rail_54e1, s1002


def test_s1002_flange():
    """Flange 28 mm high with its tip at -55 mm, 32.5 mm thick 10 mm below the tape circle."""
    wheel = s1002()
    y, r = wheel.points.T
    tip = np.argmax(r)
    assert r[tip] == pytest.approx(28e-3, abs=1e-7) and y[tip] == pytest.approx(-55e-3, abs=5e-5)
    flank = slice(tip, tip + 1000)
    assert np.interp(-10e-3, -r[flank], y[flank]) + 70e-3 == pytest.approx(32.5e-3, abs=2e-6)
    assert np.degrees(-wheel.angles[tip:].min()) == pytest.approx(70.0, abs=1e-4)


@pytest.mark.parametrize(
    "profile",
    [s1002(chamfer=False), *map(rail, RAILS), rail_54e1("outline"), rail("60E1", "outline")],
)
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
    wheel, head = s1002(), rail_54e1()
    root = wheel.s[np.argmin(np.abs(wheel.points[:, 0] + 36e-3))]
    assert wheel.curvature(root) == pytest.approx(1 / 13e-3)
    assert head.curvature((head.joints[1] + head.joints[2]) / 2) == pytest.approx(-1 / 13e-3)
    assert head.curvature(head.length / 2 + 1e-3) == pytest.approx(-1 / 0.3)


@pytest.mark.parametrize(
    ("design", "height", "standard"),
    [
        ("54E1", 0.159, (69.775e-4, 75.13e-3, 2338.0e-8, 419.08e-8)),
        ("60E1", 0.172, (76.70e-4, 80.92e-3, 3038.3e-8, 512.3e-8)),
    ],
)
def test_rail_section(design, height, standard):
    """Area, height of the centre and second moments of the standard within 0.02 %."""
    y, z = rail(design, "outline").points.T
    z = z + height
    cross = -(y[:-1] * z[1:] - y[1:] * z[:-1])
    area = cross.sum() / 2
    centre = (cross * (z[:-1] + z[1:])).sum() / (6 * area)
    iy, iz = ((cross * (u[:-1] ** 2 + u[:-1] * u[1:] + u[1:] ** 2)).sum() / 12 for u in (z, y))
    moments = iy - area * centre**2, iz
    assert (area, centre, *moments) == pytest.approx(standard, rel=2e-4)


@pytest.mark.parametrize("slope", [0.0, 1 / 40, 1 / 20])
def test_gauge_in_track(slope):
    """Highest point at z = 0, gauge face at half of 1435 mm, 14 mm below; rail leaning in."""
    head = rail_in_track(inclination=slope)
    y, z = head.at(np.arange(0, head.length, 1e-5)).T
    top = np.argmax(z)
    assert z[top] == pytest.approx(0.0, abs=1e-9)
    assert np.interp(-14e-3, z[:top], y[:top]) == pytest.approx(0.7175, abs=1e-8)
    crown = inclined(rail_54e1(), slope).angle(head.length / 2)
    assert crown == pytest.approx(np.arctan(slope))


def test_csv_round_trip(tmp_path):
    """A profile read from 0.5 mm points differs from the drawing by less than 1 µm."""
    head = rail_54e1()
    points = head.at(np.arange(0, head.length, 0.5e-3))
    path = tmp_path / "rail.csv"
    np.savetxt(path, points * 1e3, delimiter=",", header="y,z", comments="")
    read = from_csv(path)
    s = np.linspace(0.01, 0.11, 101)
    offset = np.sum((read.at(s) - head.at(s)) * head.normal(s), axis=1)
    assert np.abs(offset).max() < 1e-6


WAYS = {
    "m": (1e-3, 1.0, 1.0, 1),
    "in reverse": (1.0, 1.0, 1.0, -1),
    "upside down": (1.0, 1.0, -1.0, 1),
    "mirrored": (1.0, -1.0, 1.0, 1),
    "mirrored, upside down, in m": (1e-3, -1.0, -1.0, 1),
}


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("kind", ["wheel", "rail"])
def test_axes_are_found(tmp_path, kind, way):
    """However a file is drawn, the profile read from it is the one drawn.

    A mirrored rail is a rail: its gauge side is where the file has it (54E1 is symmetric).
    """
    scale, sideways, outward, step = WAYS[way]
    drawn = s1002() if kind == "wheel" else rail_54e1()
    points = drawn.at(np.linspace(0, drawn.length, 400)) * 1e3
    path = tmp_path / "drawn.csv"
    np.savetxt(path, (points * [sideways, outward] * scale)[::step])
    read = from_csv(path, kind=kind)
    exact = from_points(points * 1e-3)
    assert read.length == pytest.approx(exact.length, rel=1e-12)
    s = np.linspace(0, exact.length, 50)
    assert read.at(s) == pytest.approx(exact.at(s), abs=1e-10)


def test_corners_stay_corners(tmp_path):
    """A square edge is not rounded or overshot by the spline: 30 mm down, 60 mm across, 30 down."""
    down, across = np.linspace(-30, 0, 4)[:-1], np.linspace(-30, 30, 7)
    left = np.column_stack([np.full(3, -30.0), down])
    points = np.vstack([left, np.column_stack([across, np.zeros(7)]), (left * [-1, 1])[::-1]])
    path = tmp_path / "square.csv"
    np.savetxt(path, points)
    read = from_csv(path)
    assert read.length == pytest.approx(0.120, rel=1e-9)
    assert np.abs(read.points[:, 0]).max() <= 0.030 + 1e-12 and read.points[:, 1].max() < 1e-12
    assert read.joints == pytest.approx([0.0, 0.030, 0.090, 0.120])


def test_smoothing_takes_the_noise_out():
    """Noise of 5 µm on an arc of 300 mm: its curvature comes back within 5 %; without it is lost.

    The noise itself is left in the points: the curve keeps within the given distance of them.
    """
    angle = np.linspace(-0.1, 0.1, 301)
    arc = 0.3 * np.column_stack([np.sin(angle), np.cos(angle)])
    noisy = arc + np.random.default_rng(2).normal(scale=5e-6, size=arc.shape)
    rough, smooth = from_points(noisy), from_points(noisy, smoothing=7e-6)
    s = np.linspace(0.01, 0.05, 101)
    assert smooth.curvature(s) == pytest.approx(-1 / 0.3, rel=0.05)
    assert np.abs(rough.curvature(s) + 1 / 0.3).max() > 10 / 0.3


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ([[0, 0], [1, 0]], "4 points or more, got 2"),
        (
            [[0, 0], [2, 0], [1, 0.01], [3, 0], [4, 0]],
            "not monotone.* point 3 of 5, lateral 10.00 mm",
        ),
        ([[0, 0], [2, 0], [2, 1], [1, 1], [1, -1]], "the curve intersects itself"),
    ],
)
def test_bad_csv(tmp_path, rows, message):
    path = tmp_path / "bad.csv"
    np.savetxt(path, np.multiply(rows, 10.0))
    with pytest.raises(ValueError, match=rf"bad\.csv: .*{message}"):
        from_csv(path, kind="rail")


def test_points_that_repeat(tmp_path):
    """Of a file they are left out, with a word; in an array they are refused by their number."""
    points = np.array([[-20, -5], [-10, -1], [-10, -1], [0, 0], [10, -1], [20, -5.0]])
    path = tmp_path / "rail.csv"
    np.savetxt(path, points)
    found = read(path, "rail")
    assert found.points == pytest.approx(points[[0, 1, 3, 4, 5]] * 1e-3)
    assert "1 points that repeat the one before are left out" in list(found.doubts())
    with pytest.raises(ValueError, match="point 3 repeats the one before"):
        from_points(points)


@pytest.mark.parametrize(("spacing", "noise"), [(5e-4, 1e-5), (1e-4, 1e-5), (2e-5, 2e-5)])
def test_noise_makes_no_corners(spacing, noise):
    """S1002 with noise that is up to as large as the spacing has one corner, its chamfer at 60 mm.

    The smoothed curve keeps within four standard deviations of the drawing.
    """
    drawn = s1002()
    n = int(drawn.length / spacing)
    scatter = np.random.default_rng(1).normal(scale=noise, size=(n, 2))
    found = from_points(
        drawn.at(np.linspace(0, drawn.length, n)) + scatter, smoothing=noise * np.sqrt(2)
    )
    corners = found.at(found.joints[1:-1])
    assert len(corners) == 1 and corners[0, 0] == pytest.approx(0.060, abs=4e-4)
    inner = drawn.at(np.linspace(0.02, 0.98, 400) * drawn.length)
    assert cKDTree(found.points).query(inner)[0].max() < 4 * max(noise, 1.2e-5)


def test_scatter_is_told(tmp_path):
    """Noise of 10 µm on S1002 at 0.25 mm: a scatter of 10 µm, and the smoothing that fits it."""
    drawn = s1002()
    noise = np.random.default_rng(3).normal(scale=1e-5, size=(640, 2))
    path = tmp_path / "wheel.csv"
    np.savetxt(path, drawn.at(np.linspace(0, drawn.length, 640)) + noise)
    found = read(path, "wheel")
    assert found.scatter == pytest.approx(1e-5, rel=0.15)
    asked = re.findall(r"profile_smoothing = (\S+) would", "".join(found.doubts()))
    assert [float(word) for word in asked] == pytest.approx([1.4e-5], rel=0.15)
    smooth = read(path, "wheel", smoothing=1.4e-5)
    assert not list(smooth.doubts()) and 1e-5 < smooth.residuals.max() < 8e-5


def test_resolution_is_judged(tmp_path):
    """A half circle of 30 mm in chords of 18 degrees: an arc that turns twice that over a chord.

    Such a chord has 60 sin(9°) mm, the arc a height of half of it by tan(9°). In chords of
    2 degrees nothing is said. Of 54E1 in 9 points the curve misses 2.65 mm; it says up to 2.9 mm.
    """
    told = {}
    for degrees in (18, 2):
        angle = np.radians(np.arange(-90, 91, degrees))
        path = tmp_path / "round.csv"
        np.savetxt(path, 30 * np.column_stack([np.sin(angle), np.cos(angle)]))
        told[degrees] = read(path, "rail")
    open_, nine = np.sin(np.radians(9)) * np.tan(np.radians(9)) * 0.030, np.radians(18)
    assert told[18].gaps.max() == pytest.approx(open_, rel=1e-6)
    assert told[18].turns == pytest.approx(nine, rel=1e-6)
    assert any("open by up to 0.74 mm" in doubt for doubt in told[18].doubts())
    assert not list(told[2].doubts())
    drawn = rail_54e1()
    path = tmp_path / "joints.csv"
    np.savetxt(path, drawn.at(drawn.joints) * 1e3)
    few = read(path, "rail")
    missed = cKDTree(few.profile.points).query(drawn.at(np.linspace(0.02, 0.1, 800)))[0].max()
    assert missed == pytest.approx(2.65e-3, rel=0.01) and missed < few.gaps.max() < 1.1 * missed


def test_an_edge_is_not_coarse(tmp_path):
    """The chamfer of S1002, an edge of 41 degrees among chords of 0.4 mm, is no lack of points."""
    drawn = s1002()
    path = tmp_path / "wheel.csv"
    np.savetxt(path, drawn.at(np.unique([*np.linspace(0, drawn.length, 400), drawn.joints[-2]])))
    found = read(path, "wheel")
    assert len(found.corners) == 1 and not list(found.doubts())


@pytest.mark.parametrize("n", [300, 20000])
def test_a_crossing_is_found_wherever_it_is(n):
    """A loop of 0.2 mm at an end of a straight line of n points, and the line without it."""
    line = np.column_stack([np.linspace(0, 0.1, n), np.zeros(n)])
    angle = np.linspace(-np.pi / 2, 2 * np.pi - np.pi / 2 + 1.0, 40)
    loop = line[-1] + 1e-4 * np.column_stack([np.cos(angle), 1 + np.sin(angle)])
    from_points(line)
    with pytest.raises(ValueError, match="intersects itself"):
        from_points(np.vstack([line, loop[1:]]))


@pytest.mark.parametrize(
    ("points", "message"),
    [
        ([[10, 0], [20, -1], [30, -2], [40, -3]], "both sides of the tape circle"),
        ([[-1, 0], [0, 0], [1, 0], [2, 0], [3, 0]], r"width of 0\.02 to 0\.4 m, got 0\.004 m"),
    ],
)
def test_not_a_wheel(tmp_path, points, message):
    path = tmp_path / "bad.csv"
    np.savetxt(path, points)
    with pytest.raises(ValueError, match=message):
        from_csv(path, kind="wheel")


def test_missing_csv():
    with pytest.raises(FileNotFoundError, match=r"nowhere\.csv"):
        from_csv("nowhere.csv")
