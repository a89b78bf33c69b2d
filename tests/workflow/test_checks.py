# SPDX-License-Identifier: LGPL-3.0-or-later
"""What no run can have: refused by ``validate`` and by ``run`` alike, with the key."""

import numpy as np
import pytest

from meshes import profiles
from workflow import Scene, run
from workflow.model.advice import doubts
from workflow.model.checks import check
from workflow.model.geometry import placement_of, readings
from workflow.model.model import build
from workflow.scene.scene import SceneError

WALL = {"origin": [0.0, 0.0, 0.0], "normal": [1.0, 0.0, 0.0], "half_width": 0.05}
REFUSED = {
    "normal": (
        "bar-impact",
        {"contacts.wall.target": WALL | {"normal": [0.0, 0.0, 0.0]}},
        r"^contacts: target.normal = \[0.0, 0.0, 0.0\]: expected a direction",
    ),
    "target": (
        "bar-impact",
        {"contacts.wall.target": 5},
        "contacts.wall.target = 5: expected the name of a surface, or a table with origin",
    ),
    "itself": (
        "contact-patch",
        {"contacts.face.target": "Block_Bottom"},
        "contacts.face.target = 'Block_Bottom': expected another surface",
    ),
    "design": ("two-patches", {"mesh.wheel_design": "E"}, "mesh.wheel_design = 'E': .*A_straight"),
    "radius": ("two-patches", {"mesh.wheel_radius": 0.3}, "mesh.wheel_radius = 0.3: .*0.440 m"),
    "short rail": ("two-patches", {"mesh.rail_length": 0.2}, "mesh.rail_length = 0.2: .*leaves"),
    "far": ("flange-transition", {"rolling.speed": 1e6}, "expected less than the circumference"),
    "small strain": (
        "flange-transition",
        {"bodies.wheelset.kinematics": "small-strain"},
        "bodies.wheelset.kinematics = 'small-strain' .* turns by 0.41 rad.*'total-lagrangian'",
    ),
    "spin": (
        "carter",
        {"bodies.roller.kinematics": "small-strain"},
        "bodies.roller.kinematics = 'small-strain' .* turns by 0.065 rad",
    ),
    "ramp": (
        "bar-wave",
        {"supports": [{"surface": "xmin", "directions": ["x"], "velocity": 5.0, "ramp": 3e-7}]},
        "supports.0.ramp = 3e-07: over within 1.5 steps of 2.0e-07 s; expected 5 or more",
    ),
    "shift": (
        "cattaneo-mindlin",
        {"driven.sphere.shift_time": 1e-8},
        "driven.sphere.shift_time = 1e-08: over within",
    ),
    "speed": (
        "bar-impact",
        {"bodies.bar.velocity": [-1e4, 0.0, 0.0]},
        r"bodies.bar.velocity = \[-10000.0, 0.0, 0.0\]: 1e\+04 m/s, .* of a cell in a step",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refused_by_validate_and_by_run(case, tmp_path):
    """The same message, and no mesh is made: no folder is left either."""
    name, change, told = REFUSED[case]
    with pytest.raises(SceneError, match=told) as refused:
        check(Scene.load(name, **change))
    with pytest.raises(SceneError) as again:
        run(Scene.load(name, **change), tmp_path / "run", quiet=True)
    assert str(again.value) == str(refused.value)
    assert not (tmp_path / "run").exists()


EXTREME = [
    f"{key}={sign}"
    for key in (
        "bodies.bar.material.youngs_modulus",
        "bodies.bar.material.density",
        "bodies.bar.stiffness_damping",
        "bodies.bar.mass_damping",
        "contacts.wall.penalty",
        "contacts.wall.damping",
        "mesh.size",
        "time.end",
    )
    for sign in ("1e300", "1e-300", "1e18", "1e-18")
]


@pytest.mark.parametrize("word", EXTREME)
def test_extreme_numbers(word):
    """Refused with a key, or a step that is a number: nothing overflows in the bounds."""
    key, _, value = word.partition("=")
    try:
        scene = Scene.load("bar-impact", **{key: float(value)})
        check(scene)
    except SceneError as refused:
        assert key in str(refused) or "time." in str(refused)
        return
    with np.errstate(all="raise"):
        model = build(scene.with_(**{"mesh.size": 0.005}))
    assert 0 < model.dt < np.inf and 0 < model.dt_bound < np.inf


def test_a_shift_into_the_gauge_corner_tells_gap_and_remedy():
    """At 12 mm the flange stands 3 mm inside; up to the shift that is named it does not."""
    with pytest.raises(
        SceneError, match=r"mesh.lateral_shift = 0.012 .* would stand 2.9.e-03 m"
    ) as e:
        check(Scene.load("two-patches", **{"mesh.lateral_shift": 0.012}))
    most = float(str(e.value).split("expected at most ")[1].split(" m")[0])
    check(Scene.load("two-patches", **{"mesh.lateral_shift": most}))


def test_a_profile_that_begins_at_the_flange_back(tmp_path):
    """Its points reach only 0.24 mm to the left of lateral 0: taken as measured from the back."""
    points = profiles.s1002().points[::5]
    path = tmp_path / "back.csv"
    shifted = points - [points[0, 0] + 0.00024, 0.0]
    np.savetxt(path, shifted, delimiter=",", header="y,z", comments="")
    scene = Scene.load("two-patches", **{"mesh.wheel_profile": str(path)})
    check(scene)
    assert any("origin at the flange back" in line for line in readings(scene.mesh))


def test_kinematics_follow_the_motion():
    """Left out, a rolling or spinning body gets those for rotation, any other small strain."""
    tables = Scene.load("flange-transition").tables()
    for body in tables["bodies"].values():
        del body["kinematics"]
    kinds = {name: body.kinematics for name, body in Scene.check(tables).bodies.items()}
    expected = {"wheelset": "total-lagrangian", "rail": "small-strain", "sleepers": "small-strain"}
    assert kinds == expected
    tables["rolling"]["speed"] = 0.0
    assert Scene.check(tables).bodies["wheelset"].kinematics == "small-strain"
    tables = Scene.load("carter").tables()
    for body in tables["bodies"].values():
        del body["kinematics"]
    kinds = {name: body.kinematics for name, body in Scene.check(tables).bodies.items()}
    assert kinds == {"roller": "total-lagrangian", "block": "small-strain"}


def test_speeds_that_no_surface_stands_in_the_way_of():
    """Without contact, and of bodies that move alike, 10 km/s are allowed."""
    check(Scene.load("bar-wave", **{"bodies.bar.velocity": [1e4, 0.0, 0.0]}))
    both = {f"bodies.{name}.velocity": [0.0, 0.0, -1e4] for name in ("block", "base")}
    check(Scene.load("two-bars", **both))


@pytest.mark.parametrize("name", ["flange-transition", "carter", "sliding-block", "two-bars"])
def test_shipped_scenes_give_no_cause_to_doubt(name):
    """Not by their settings."""
    scene = Scene.load(name)
    assert list(doubts(scene, check(scene))) == []


COSTLY = {  # steps of 0.2 µs; 2 025 nodes of 24 bytes in each of 8e6 outputs; steps of 10 fs
    "samples": ({"output.sample_interval": 1e-9}, "output.sample_interval = 1e-09: a sample is"),
    "disk": ({"time.output_interval": 1e-11}, "of results; output.fields = false leaves"),
    "time": ({"bodies.bar.stiffness_damping": 1.0}, "time.end = 8e-05: about "),
}


@pytest.mark.parametrize("case", COSTLY)
def test_costly_settings_are_doubted(case):
    """One line each, with the key."""
    change, told = COSTLY[case]
    scene = Scene.load("bar-wave", **change)
    assert any(told in line for line in doubts(scene, check(scene)))


def test_a_thick_flange_is_told_how_to_stand():
    """Wheels 10 mm farther apart leave about 1 mm at no shift: 2.7 mm is refused with a remedy.

    Moved 2 mm back the wheel stands where it was asked for.
    """
    apart = {"mesh.back_to_back": 1.37, "mesh.strip": None}
    told = r"mesh.flange_gap = 0.0027 .* a thicker flange.*; mesh.lateral_shift, which may be neg"
    with pytest.raises(SceneError, match=told):
        placement_of(Scene.load("flange-transition", **apart))
    back = Scene.load("flange-transition", **apart, **{"mesh.lateral_shift": -2e-3})
    assert placement_of(back).flange_gap == pytest.approx(2.7e-3, abs=2e-4)
