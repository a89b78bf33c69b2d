# SPDX-License-Identifier: LGPL-3.0-or-later
"""Strips of narrow cells across the profiles of wheel and rail."""

import numpy as np
import pytest

from meshes.generate.sweep import Strip
from meshes.hexmesh import boundary
from meshes.profiles.placement import narrow_arcs, place, rail_in_track
from meshes.profiles.profiles import s1002
from meshes.quads import enclosed_volume
from meshes.quality import cell_volumes, quality
from meshes.tags import Tag
from meshes.wheel_rail.rail import rail
from meshes.wheel_rail.wheelset import wheelset
from workflow import Scene
from workflow.model.checks import check
from workflow.model.geometry import strips_of
from workflow.scene import SceneError

ZONE = (-0.06, 0.06)
BODIES = {"wheel": (wheelset, Tag.TREAD), "rail": (rail, Tag.RAILHEAD)}


def widths(mesh, tag):
    """Width across the profile of the facets over the middle of the zone [m]."""
    p = mesh.points[mesh.surface(tag)]
    here = (np.abs(p[..., 0]) < 0.03).all(axis=1)
    edges = np.roll(p[here], -1, axis=1) - p[here]
    return np.linalg.norm(edges[..., 1:], axis=2).max(axis=1)


@pytest.mark.parametrize("size", [5e-4, 2.5e-4])
@pytest.mark.parametrize("side", BODIES)
def test_cells_are_narrow_where_patches_are(side, size):
    """Narrowest columns within a factor 1.55 of what is asked; sound cells, closed surface."""
    body, tag = BODIES[side]
    strip = Strip(*narrow_arcs(yaw=0.02)[side], size)
    mesh, plain = body(size=4e-3, zone=ZONE, strip=strip), body(size=4e-3, zone=ZONE)
    width = widths(mesh, tag)
    narrow = width[width < 1.55 * size]
    assert len(narrow) > 30
    assert narrow.min() > size / 2.5
    assert quality(mesh).scaled_jacobian > 0.2
    assert len(plain.cells) < len(mesh.cells) < 2 * len(plain.cells)
    inside = enclosed_volume(mesh.points, boundary(mesh.cells))
    assert cell_volumes(mesh.points, mesh.cells).sum() == pytest.approx(inside, rel=1e-12)


def test_strip_off_the_fine_profile_is_refused():
    with pytest.raises(ValueError, match=r"strip: expected a part of the fine profile, .* got"):
        rail(size=4e-3, zone=ZONE, strip=Strip(0.0, 0.004, 5e-4))


def test_arcs_reach_from_the_pressed_flange_to_the_shoulder():
    """They hold the first touch of the flange, on 62 to 71 degrees, and end where the crown begins.

    54E1 at 1:40 leaves its crown of 80 mm radius at 15 degrees for the shoulder of 13 mm.
    """
    arcs, at = narrow_arcs(), place(shift=0.007)
    assert arcs["wheel"][0] < at.flange_s < arcs["wheel"][1]
    assert arcs["rail"][0] < at.flange_rail_s < arcs["rail"][1]
    wheel = np.degrees(-s1002().angle(np.array(arcs["wheel"])))
    rail_slope = np.degrees(rail_in_track().angle(np.array(arcs["rail"])))
    assert 62 < wheel[0] < 71
    assert 60 < rail_slope[0] < 78
    assert (wheel[1], rail_slope[1]) == pytest.approx((15.5, 15.5), abs=1.5)


def test_scene_finds_its_strips_or_takes_those_told():
    scene = Scene.load("flange-transition")
    found = strips_of(scene)
    told = strips_of(scene.with_(**{"mesh.strip.rail": [0.02, 0.026]}))
    assert (told["rail"].start, told["rail"].end) == (0.02, 0.026)
    assert told["wheel"] == found["wheel"]
    assert strips_of(Scene.check({**scene.tables(), "mesh": plain(scene)})) == {
        "wheel": None,
        "rail": None,
    }


def plain(scene):
    """The mesh table of a scene without its strip."""
    return {key: value for key, value in scene.tables()["mesh"].items() if key != "strip"}


@pytest.mark.parametrize("arc", [[0.02, 1.0], [0.03, 0.02], [-0.01, 0.01]])
def test_arc_off_the_profile_is_refused_before_meshing(arc):
    with pytest.raises(SceneError, match=r"mesh\.strip\.rail = .*: expected a rising stretch"):
        check(Scene.load("flange-transition", **{"mesh.strip.rail": arc}))


def test_strip_that_is_found_beyond_the_tread_is_refused_with_its_key(tmp_path):
    """A flange cut off 12 mm above its foot: wheel and rail come close at its very end."""
    wheel = s1002().at(np.linspace(0, s1002().length, 400))
    wheel = wheel[(wheel[:, 0] > -0.0385) & (wheel[:, 1] < 0.020)]
    np.savetxt(tmp_path / "cut.csv", wheel * 1e3)
    scene = Scene.load("two-patches", **{"mesh.wheel_profile": str(tmp_path / "cut.csv")})
    with pytest.raises(SceneError, match=r"^mesh\.strip\.wheel: expected a part of"):
        check(scene)


@pytest.mark.parametrize(("side", "fine"), [("rail", "0.0200 to 0.0719"), ("wheel", "0.0438 to")])
def test_arc_off_the_fine_part_is_refused_before_meshing(side, fine):
    """On the gauge face below the fine cells, on the flange's back: key, what is expected, got."""
    arc = [0.0005, 0.002]
    told = rf"mesh\.strip\.{side} = \[0\.0005, 0\.002\]: expected .*, {fine} .*, got 0\.0005 to 0"
    with pytest.raises(SceneError, match=told):
        check(Scene.load("flange-transition", **{f"mesh.strip.{side}": arc}))


def test_scene_says_what_is_wrong_with_a_strip():
    with pytest.raises(SceneError, match=r"mesh\.strip\.size = 0\.0: expected"):
        Scene.load("flange-transition", **{"mesh.strip.size": 0.0})
