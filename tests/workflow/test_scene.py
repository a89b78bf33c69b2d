# SPDX-License-Identifier: LGPL-3.0-or-later
"""Scenes: what is refused and how it is said; changes nest; a written scene reads back the same."""

import tomllib

import numpy as np
import pytest
import tomli_w

from meshes.tags import Tag
from workflow.model.geometry import mesh_of
from workflow.scene.scene import Scene, SceneError, names
from workflow.scene.units import unit_of

BAR = """
name = "small"
title = "A bar"
[mesh]
kind = "bar"
length = 0.1
width = 0.01
size = 0.01
[bodies.bar]
regions = ["bar"]
material = { youngs_modulus = 210e9, poisson_ratio = 0.0, density = 7800.0 }
[time]
end = 1e-5
output_interval = 1e-6
"""


def bar(**changes) -> Scene:
    return Scene.check(tomllib.loads(BAR)).with_(**changes)


def refusal(scene: str, **changes) -> str:
    """The message with which a changed built-in scene is refused."""
    with pytest.raises(SceneError) as caught:
        Scene.load(scene, **changes)
    return str(caught.value)


@pytest.mark.parametrize("name", names())
def test_built_in_scenes_are_valid_and_say_what_they_are(name):
    """Every scene of the package loads under its own name and has a title."""
    scene = Scene.load(name)
    assert scene.name == name and scene.title and scene.about


WOOD = {
    "law": "orthotropic",
    "youngs_moduli": [12e9, 0.6e9, 1e9],
    "poisson_ratios": [0.4, 0.35, 0.3],
    "shear_moduli": [0.7e9, 0.8e9, 0.1e9],
    "density": 500.0,
}
WOODEN = {"regions": ["bar"], "material": WOOD}

# key, value and a part of the message, by scene
WRONG = {
    "bar-wave": [
        ("mesh.sise", 1e-3, "mesh.sise = 0.001: unknown key"),
        ("colour", "red", "colour = 'red': unknown key"),
        ("mesh.size", -1.0, "mesh.size = -1.0: expected greater than 0 [m]"),
        ("mesh.size", 0, "mesh.size = 0: expected greater than 0 [m]"),
        ("mesh.size", "fine", "mesh.size = 'fine': expected a valid number [m]"),
        ("mesh.size", True, "mesh.size = True: expected a valid number [m]"),
        ("mesh.size", float("nan"), "mesh.size = nan: expected a finite number [m]"),
        ("time.end", float("inf"), "time.end = inf: expected a finite number [s]"),
        ("time.safety", 1.5, "time.safety = 1.5: expected less than or equal to 1.2"),
        ("guards.check_interval", 0, "expected greater than or equal to 1"),
        ("guards.check_interval", 2.5, "guards.check_interval = 2.5: expected a valid"),
        ("gravity", [0.0, 0.0, "g"], "gravity.2 = 'g': expected a valid number [m/s^2]"),
        ("bodies.bar.material.poisson_ratio", 0.5, "= 0.5: expected less than 0.5 [-]"),
        ("bodies.bar.material.density", -1.0, "density = -1.0: expected greater than 0"),
        ("bodies.bar.kinematics", "large", "kinematics = 'large': expected 'small-strain'"),
        ("bodies.bar.element", "tet", "element = 'tet': expected 'full', 'one-point' or 'selec"),
        ("bodies.bar.hourglass_coefficient", 0.1, "expected element = 'one-point', got 'full'"),
        ("bodies.bar.bulk_viscosity", {"linear": -1.0}, "linear = -1.0: expected greater than"),
        ("bodies.bar.material.law", "rubber", "law = 'rubber': expected one of 'hooke', 'small"),
        ("bodies.bar.material.law", "neo-hookean", "neo-hookean expects 'total-lagrangian'"),
        ("bodies.bar.material", {**WOOD, "poisson_ratios": [5.0, 0.0, 0.0]}, "positive energy"),
        ("bodies.bar.material", {**WOOD, "axes": [[1, 0, 0]] * 3}, "three orthonormal rows"),
        ("bodies.bar.material", {"law": "orthotropic"}, "youngs_moduli: missing; expected"),
        ("bodies.bar", {**WOODEN, "element": "selective"}, "'orthotropic' with 'small-strain'"),
        ("time.precision", "float16", "precision = 'float16': expected 'float64' or 'float32'"),
        ("time.bound", "none", "time.bound = 'none': expected 'cell' or 'assembled'"),
        ("bodies", {}, "bodies = {}: "),
        ("mesh.kind", "sphere", "mesh"),
        ("time.output_interval", 1.0, "time.output_interval = 1.0: expected at most"),
        ("mesh.size.x", 1, "mesh.size.x: expected a key of the scene, but mesh.size is"),
    ],
    "flange-transition": [
        ("rolling.angle_of_attack", 0.3, "= 0.3: expected less than or equal to"),
        ("rolling.body", "bogie", "rolling.body = 'bogie': expected one of"),
        ("rolling.driven_region", "bogie", "rolling.driven_region = 'bogie': exp"),
        ("vehicle.journal", "bogie", "vehicle.journal = 'bogie': expected one of"),
        ("track.seat", "cap", "track.seat = 'cap': expected one of ['tread'"),
        ("equilibrium.approach", {"cart": [0, 0, 0]}, "approach.cart: expected one"),
    ],
    "hertz": [
        ("contacts.touch.friction", -0.1, "contacts.touch.friction = -0.1: expected greater"),
        ("contacts.touch.target", "floor", "contacts.touch.target = 'floor': expected one of"),
        ("contacts.touch.contactor", "floor", "contacts.touch.contactor = 'floor': expected"),
        ("bodies.flat.regions", ["sphere"], "= 'sphere': in body 'sphere' already"),
        ("bodies.flat.regions", ["sphere"], "no body has the regions ['base'] of the mesh"),
        ("bodies.flat.regions", ["flat"], "bodies.flat.regions = 'flat': expected one of"),
        ("supports", [{"surface": "x", "directions": ["x"]}], "supports.0.surface = 'x': exp"),
        ("supports", [{"surface": "xmin", "directions": ["w"]}], "directions.0 = 'w': expected"),
        (
            "loads",
            [{"surface": "xmin"}],
            "loads.0: expected traction or pressure [Pa], or hammer, got neither",
        ),
    ],
}


@pytest.mark.parametrize(
    ("scene", "key", "value", "message"),
    [(scene, *case) for scene, cases in WRONG.items() for case in cases],
)
def test_refusals_name_key_value_and_expectation(scene, key, value, message):
    """One wrong entry in a good scene: the dotted key, what it is, what was expected, its unit."""
    assert message in refusal(scene, **{key: value})


def test_all_wrong_keys_are_listed_at_once():
    """Three mistakes, three lines."""
    lines = refusal("bar-wave", **{"mesh.size": -1.0, "mesh.sise": 1.0, "time.end": "x"}).split(
        "\n"
    )
    assert len(lines) == 3


@pytest.mark.parametrize("section", ["mesh", "bodies", "time", "name"])
def test_missing_sections_are_named(section):
    """A scene without a mesh, bodies, time or name."""
    data = tomllib.loads(BAR)
    del data[section]
    with pytest.raises(SceneError, match=f"^{section}: missing; expected"):
        Scene.check(data)


def test_rolling_needs_a_wheel():
    """A bar cannot roll."""
    rolling = {"body": "bar", "driven_region": "bar", "speed": 1.0}
    with pytest.raises(SceneError, match=r"mesh.kind = 'bar': rolling expects 'wheel-on-rail'"):
        bar(rolling=rolling)


@pytest.mark.parametrize("content", [b"name = [", b"name = '\xff'"])
def test_files_that_are_not_toml_are_named(tmp_path, content):
    """A broken table and bytes that are no UTF-8."""
    path = tmp_path / "broken.toml"
    path.write_bytes(content)
    with pytest.raises(SceneError, match=r"broken.toml: not valid TOML"):
        Scene.load(path)


def test_unknown_scenes_are_told_the_known_ones():
    """Neither a file nor built in."""
    assert (
        "'bar-wavy': expected a TOML file or one of ball-on-block, bar-impact, bar-wave"
        in refusal("bar-wavy")
    )


def test_changes_nest_and_leave_the_rest_alone():
    """``with_`` sets keys at any depth, adds tables, and does not touch the scene it came from."""
    first = bar()
    second = first.with_(
        **{"mesh.size": 0.005, "bodies.bar.material.density": 2700.0, "guards.energy_error": 0.1}
    )
    assert (first.mesh.size, second.mesh.size) == (0.01, 0.005)
    assert (first.bodies["bar"].material.density, first.guards.energy_error) == (7800.0, 0.05)
    assert second.bodies["bar"].material.density == 2700.0
    assert second.bodies["bar"].material.youngs_modulus == 210e9
    assert second.guards.energy_error == 0.1
    assert second.with_(**{"mesh.size": 0.01, "bodies.bar.material.density": 7800.0}) != first
    assert bar(**{"mesh.size": 0.005}).with_(**{"mesh.size": 0.01}) == first


@pytest.mark.parametrize("name", names())
def test_written_scenes_read_back_the_same(tmp_path, name):
    """``tables`` as TOML is the same scene, in every key and digit."""
    scene = Scene.load(name)
    path = tmp_path / "scene.toml"
    path.write_text(tomli_w.dumps(scene.tables()), "utf-8")
    assert Scene.load(path) == scene


@pytest.mark.parametrize("name", ["bar-wave", "sliding-block", "hertz"])
def test_scenes_know_the_regions_and_surfaces_of_their_mesh(name):
    """The names that a scene is checked against are those that its mesh carries."""
    scene = Scene.load(name)
    mesh, _ = mesh_of(scene)
    regions = {Tag(t).name.lower() for t in np.unique(mesh.regions)}
    surfaces = {Tag(t).name.lower() for t in np.unique(mesh.surfaces)}
    assert regions == set(scene.mesh.regions)
    assert surfaces == set(scene.mesh.surfaces)


@pytest.mark.parametrize(
    ("key", "unit"),
    [
        ("mesh.size", "m"),
        ("bodies.any.material.youngs_modulus", "Pa"),
        ("bodies.any.velocity.0", "m/s"),
        ("contacts.any.target.origin.2", "m"),
        ("track.pad_damping.1", "N s/m"),
        ("rolling.angle_of_attack", "rad"),
        ("name", ""),
    ],
)
def test_units_are_found_at_any_depth(key, unit):
    """The unit of a field through tables, lists and unions."""
    assert unit_of(Scene, key.split(".")) == unit


def test_a_scene_starts_from_another(tmp_path):
    """Its own keys stand over those of the base, built-in or beside it, tables merged."""
    (tmp_path / "long.toml").write_text('base = "bar-wave"\nname = "long"\nmesh.length = 0.2\n')
    (tmp_path / "thin.toml").write_text('base = "long.toml"\nmesh.width = 4e-3\n')
    scene, wave = Scene.load(tmp_path / "thin.toml"), Scene.load("bar-wave")
    assert scene == wave.with_(**{"name": "long", "mesh.length": 0.2, "mesh.width": 4e-3})


@pytest.mark.parametrize(
    ("base", "message"),
    [
        ('"nowhere"', "here.toml: base: scene '.*nowhere': expected a TOML file or one of"),
        ("3", r"here.toml: base = 3: expected the name of a scene or a TOML file"),
        ('"here.toml"', r"expected a scene that does not start from it"),
    ],
)
def test_a_base_that_is_none_is_refused(tmp_path, base, message):
    path = tmp_path / "here.toml"
    path.write_text(f"base = {base}\n")
    with pytest.raises(SceneError, match=message):
        Scene.load(path)


def test_the_resolved_scene_is_the_main_scene_but_for_its_mesh():
    main, fine = Scene.load("flange-transition"), Scene.load("flange-resolved")
    told = {key: getattr(fine, key) for key in ("name", "title", "about", "mass_scaling")}
    assert fine.mesh.strip.size < main.mesh.strip.size
    assert fine == main.model_copy(update={**told, "mesh": fine.mesh})
    assert fine.mesh.model_copy(update={"strip": main.mesh.strip}) == main.mesh
