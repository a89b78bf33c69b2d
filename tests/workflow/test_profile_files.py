# SPDX-License-Identifier: LGPL-3.0-or-later
"""Profile files in scenes and on the command line."""

import json

import numpy as np
import pytest

from meshes.profiles import inclined, rail, read, s1002
from workflow import Scene
from workflow.model.checks import check
from workflow.model.geometry import in_track, placement_of, readings
from workflow.scene.scene import SceneError


def points_of(profile, n=400):
    """Return points of a profile in mm, one of them at the edge of the chamfer of S1002."""
    return profile.at(np.union1d(np.linspace(0, profile.length, n), profile.joints[-2])) * 1e3


@pytest.fixture
def worn(tmp_path):
    """S1002 from its flange back, worn hollow by 1 mm, as a MiniProf file."""
    y, z = points_of(s1002()).T
    hollow = z - np.exp(-((y / 20) ** 2))
    rows = "\n".join(f"{a + 70:.4f} {b:.4f}" for a, b in zip(y, hollow, strict=True))
    path = tmp_path / "worn wheel.whl"
    path.write_text(f"ColumnDef=X,Y\n\n{rows}\n")
    return path


def test_the_command_shows_what_was_understood(command, worn):
    """S1002 worn by 1 mm, from the flange back: 29 mm high, 32.5 mm thick, 70 degrees, one corner.

    The flange is measured 10 mm outside the worn tape circle, so 9 mm outside the drawn one: that
    is 33.3 mm thick. Written as plain CSV it reads back the same, now from the tape circle.
    """
    plain, figure = worn.parent / "plain.csv", worn.parent / "fig.png"
    told = json.loads(command("profile", worn, "--json", "--out", plain, "--figure", figure).stdout)
    assert [told[k] for k in ("kind", "unit", "origin", "inner", "outward", "points")] == [
        "wheel", "mm", "flange-back", "left", "up", 401,
    ]  # fmt: skip
    assert told["shift"] == [-0.070, 0.0]
    drawn = s1002()
    y, z = drawn.points[np.argmax(drawn.points[:, 1]) :][:1000].T
    shape = {"flange_height": 0.029, "flange_angle": np.radians(70)}
    shape["flange_thickness"] = np.interp(-9e-3, -z, y) + 0.070
    assert {k: told["shape"][k] for k in shape} == pytest.approx(shape, rel=2e-3)
    assert figure.stat().st_size > 20000
    again = read(plain, "wheel")
    assert again.oriented.origin == "tape-circle"
    assert again.points == pytest.approx(read(worn).points, abs=1e-10)


def test_the_command_in_words(command, tmp_path, monkeypatch):
    """An inclined 54E1 in 301 points: a rail whose crown slopes by 1:40 (42), and the figure."""
    monkeypatch.chdir(tmp_path)
    np.savetxt("rail.csv", points_of(inclined(rail("54E1"), 1 / 40), 300), delimiter=";")
    words = " ".join(command("profile", "rail.csv").stdout.split())
    assert (tmp_path / "runs" / "profile-rail.png").is_file()
    assert "taken for a rail: text, semicolons, decimal points, utf-8" in words
    assert "crown slope 0.0236, 1:42" in words and "profile-rail.png" in words
    assert "head width 69.96 mm" in words


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["none.csv"], "no such file; expected a file of points"),
        (["{worn}", "--kind", "rail"], "expected a rail, got a file that is said to hold a wheel"),
        (["{worn}", "--kind", "bogie"], "--kind 'bogie': expected 'wheel' or 'rail'"),
        (["{worn}", "--unit", "furlong"], "--unit 'furlong': expected one of 'auto', 'm', 'cm'"),
        (["{worn}", "--origin", "rail-axis"], "expected 'tape-circle' or 'flange-back'"),
        (["{worn}", "--smoothing", "-1"], "--smoothing -1.0: expected a length in m"),
        (["{worn}", "--out", "{worn}"], "expected another file than the one that is read"),
        (["{worn}", "--out", "."], "expected a file to write"),
        (["{worn}", "--figure", "fig.doc"], "--figure 'fig.doc': expected a .png"),
        (["{worn}", "--part", "2"], "part = 2: expected 1 to 1"),
    ],
)
def test_the_command_refuses(command, worn, words, message):
    """Exit code 2 and a sentence; the file that is read stays as it is."""
    before = worn.read_bytes()
    done = command("profile", *(word.format(worn=worn) for word in words), check=False)
    assert (done.returncode, done.stdout) == (2, "") and message in done.stderr
    assert worn.read_bytes() == before


def test_validate_tells_what_it_read(command, worn):
    """The line of a profile file in validate; none where profiles are built in."""
    name = f"mesh.wheel_profile={worn}"
    out = command("validate", "flange-transition", "--set", name, "--json").stdout
    (line,) = json.loads(out)["profiles"]
    assert line.startswith("mesh.wheel_profile: wheel of 401 points, MiniProf")
    assert "origin at the flange back; 1 corners" in line
    assert "profiles" not in json.loads(command("validate", "flange-transition", "--json").stdout)


def test_coarse_profiles_are_doubted(tmp_path):
    """54E1 by its 9 joints: the scene is valid, with a line that says how far off it may be."""
    drawn = rail("54E1")
    np.savetxt(tmp_path / "rail.csv", drawn.at(drawn.joints) * 1e3)
    change = {"mesh.rail_profile": str(tmp_path / "rail.csv"), "mesh.lateral_shift": 0.0}
    change["mesh.strip"] = None
    scene = Scene.load("flange-transition").with_(**change)
    check(scene)
    told = list(readings(scene.mesh))
    assert any("leaves the curve open by up to 2.9 mm" in line for line in told)


def test_distances_are_keys(tmp_path):
    """Flange back at 0, tape circle 73 mm from it, backs 1356 mm apart: tape circle at 751 mm.

    A gauge of 1435 mm, 16 mm below the top: there the face of an upright 54E1 is at 717.5 mm.
    """
    np.savetxt(tmp_path / "wheel.csv", points_of(s1002()) + np.array([73.0, 0.0]))
    keys = {"mesh.wheel_profile": str(tmp_path / "wheel.csv"), "mesh.lateral_shift": 1e-3}
    keys |= {"mesh.flange_back": 0.073, "mesh.back_to_back": 1.356, "mesh.inclination": 0.0}
    keys |= {"mesh.wheel_axes.origin": "flange-back", "mesh.gauge_depth": 0.016}
    scene = Scene.load("flange-transition").with_(**keys)
    assert placement_of(scene).centre[1] == pytest.approx(0.678 + 0.073 + 1e-3, abs=1e-12)
    y, z = in_track(scene.mesh, rail("54E1")).points.T
    assert np.interp(-0.016, z[: len(z) // 2], y[: len(y) // 2]) == pytest.approx(0.7175, abs=1e-8)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"mesh.wheel_axes.unit": "mm"},
            r"mesh\.wheel_axes: expected a file as .*'S1002', built in",
        ),
        ({"mesh.rail_axes.inner": "up"}, r"mesh\.rail_axes\.inner = 'up': expected 'auto', 'left'"),
        ({"mesh.flange_back": 0.0}, r"mesh\.flange_back = 0\.0: expected greater than 0 \[m\]"),
        ({"mesh.gauge_depth": 0.05}, r"gauge side that reaches 0\.05 m below"),
    ],
)
def test_bad_keys(change, message):
    """Axes of a built-in profile, a side that is none, no distance, a gauge below the head."""
    with pytest.raises(SceneError, match=message):
        check(Scene.load("flange-transition").with_(**change))
