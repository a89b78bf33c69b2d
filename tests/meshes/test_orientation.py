# SPDX-License-Identifier: LGPL-3.0-or-later
import numpy as np
import pytest

from meshes.profiles.measured import read
from meshes.profiles.orientation import Axes
from meshes.profiles.profiles import rail_54e1, s1002

TREAD = s1002().at(np.linspace(0, s1002().length, 400))  # from the flange back to the chamfer
HEAD = rail_54e1().at(np.linspace(0, rail_54e1().length, 300))
BACK = np.column_stack([np.full(60, -0.070), np.linspace(-0.030, 0.009, 60)])
RIM = np.column_stack([np.full(60, 0.065), np.linspace(-0.008, -0.050, 60)])
FLANK = TREAD[(TREAD[:, 0] > -0.0385) & (TREAD[:, 1] < 0.020)]  # to its steep part, 12 mm up

WHEELS = {
    "tread and flange": TREAD,
    "rim face that runs down": np.vstack([TREAD, RIM]),
    "flange back that runs down": np.vstack([BACK, TREAD]),
    "both faces": np.vstack([BACK, TREAD, RIM]),
    "from the tip of the flange on": TREAD[TREAD[:, 0] > -0.055],
    "flange cut off above the root": FLANK,
    "flange cut off, rim face": np.vstack([FLANK, RIM]),
    "worn hollow by 3 mm": TREAD
    - np.column_stack([np.zeros(400), 3e-3 * np.exp(-((TREAD[:, 0] / 0.02) ** 2))]),
    "two faces, no flange": np.vstack(
        [RIM[::-1] * [-1, 1], [[y, -abs(y) / 20] for y in np.linspace(-0.064, 0.064, 80)], RIM]
    ),
}


def written(path, points, flip, mirror, back=0.0):
    """Write points in mm as a file may have them."""
    turned = (
        (points + np.array([back, 0.0])) * [-1.0 if mirror else 1.0, -1.0 if flip else 1.0] * 1e3
    )
    np.savetxt(path, turned[:: -1 if (flip + mirror) % 2 else 1])


NO_FLANGE = "two faces, no flange"
WAYS = [
    (shape, flip, mirror, back)
    for shape in WHEELS
    for flip in (False, True)
    for mirror in (False, True)
    for back in (0.0, 0.070)
    if not (shape == NO_FLANGE and (mirror or back))
]


@pytest.mark.parametrize(("shape", "flip", "mirror", "back"), WAYS)
def test_a_wheel_comes_the_right_way_up(tmp_path, shape, flip, mirror, back):
    """S1002 with faces, without a flange back, cut off or worn, drawn in any way: as it was drawn.

    Without a flange neither its side nor the flange back can be seen: those ways are left out.
    """
    path = tmp_path / "wheel.csv"
    written(path, WHEELS[shape], flip, mirror, back)
    found = read(path, "wheel")
    surface = WHEELS[shape]
    if RIM[-1, 1] == surface[-1, 1]:  # the rim face is no running surface: left out and told
        assert any("points of the rim face are left out" in doubt for doubt in found.doubts())
        surface = surface[: -len(RIM) + (1 if shape == NO_FLANGE else -1)]  # from its edge on
    assert found.points == pytest.approx(surface, abs=1e-12)
    said = found.oriented
    assert (said.outward, said.inner) == ("down" if flip else "up", "right" if mirror else "left")
    assert said.origin == ("flange-back" if back else "tape-circle")


RAILS = {
    "head": HEAD,
    "gauge side and crown": HEAD[HEAD[:, 0] < 0.020],
    "deeper on the gauge side": HEAD[(HEAD[:, 0] < 0) | (HEAD[:, 1] > -0.006)],
}


@pytest.mark.parametrize("mirror", [False, True])
@pytest.mark.parametrize("flip", [False, True])
@pytest.mark.parametrize("shape", RAILS)
def test_a_rail_comes_the_right_way_up(tmp_path, shape, flip, mirror):
    """54E1 in any way: as drawn; the one side that reaches the gauge line is the gauge side."""
    path = tmp_path / "rail.csv"
    written(path, RAILS[shape], flip, mirror)
    found = read(path, "rail")
    assert found.points == pytest.approx(RAILS[shape], abs=1e-9)
    assert found.oriented.outward == ("down" if flip else "up")


def test_what_the_points_do_not_show_is_told_and_can_be_asked_for(tmp_path):
    """A worn head that reaches down on both sides: left is taken and told, right if asked for."""
    worn = HEAD - np.column_stack([np.zeros(300), np.where(HEAD[:, 0] < 0, 2e-3, 0.0)])
    worn = np.delete(worn, slice(148, 152), axis=0)
    path = tmp_path / "rail.csv"
    written(path, worn, False, False)
    found = read(path, "rail")
    assert any("the gauge side is left" in doubt for doubt in found.doubts())
    asked = read(path, "rail", Axes(inner="right"))
    assert asked.points == pytest.approx((worn * [-1, 1])[::-1], abs=1e-12)
    assert not any("gauge side" in doubt for doubt in asked.doubts())


def test_a_symmetric_rail_is_not_doubted(tmp_path):
    """54E1 is the same from both sides: nothing is assumed."""
    path = tmp_path / "rail.csv"
    written(path, HEAD, False, False)
    assert not list(read(path, "rail").doubts())


def test_axes_that_are_asked_for_are_not_guessed(tmp_path):
    """Half a tread of a cone: as asked, outward down and the flange right, moved by 73 mm."""
    y = np.linspace(0.010, 0.090, 60)
    path = tmp_path / "cone.csv"
    np.savetxt(path, np.column_stack([y, y / 20]) * 1e3)
    asked = Axes(outward="down", inner="right", origin="flange-back", flange_back=0.0)
    with pytest.raises(ValueError, match="both sides of the tape circle"):
        read(path, "wheel", asked)
    moved = read(path, "wheel", Axes(outward="down", origin="flange-back", flange_back=0.073))
    assert moved.points == pytest.approx(np.column_stack([y - 0.073, -y / 20]), abs=1e-12)
    with pytest.raises(ValueError, match="origin = 'gauge-face': expected 'tape-circle' or"):
        read(path, "wheel", Axes(origin="gauge-face"))


def test_a_wheel_with_its_origin_elsewhere_is_refused(tmp_path):
    """The flange 40 mm off where either origin would have it: the origin has to be told."""
    path = tmp_path / "wheel.csv"
    written(path, TREAD, False, False, back=-0.035)
    with pytest.raises(
        ValueError, match=r"flange has its tip at lateral -0\.0\d+ m; expected about"
    ):
        read(path, "wheel")
    assert read(path, "wheel", Axes(origin="tape-circle")).points == pytest.approx(
        TREAD - [0.035, 0.0]
    )


def test_a_rail_from_its_gauge_face(tmp_path):
    """54E1 with lateral 0 at the gauge face, 14 mm below the top: it comes back to its axis."""
    face = np.interp(-0.014, HEAD[:150, 1], HEAD[:150, 0])
    path = tmp_path / "rail.csv"
    written(path, HEAD - [face, 0.0], False, False)
    found = read(path, "rail")
    assert found.oriented.origin == "gauge-face"
    assert found.points == pytest.approx(HEAD, abs=1e-5)
    deeper = read(path, "rail", Axes(origin="gauge-face", gauge_depth=0.016))
    assert deeper.points == pytest.approx(HEAD, abs=1e-5)  # its sides are alike at any depth
