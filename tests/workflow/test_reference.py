# SPDX-License-Identifier: LGPL-3.0-or-later
"""Keys of a scene explained from the models: texts, units, schema, scenes of one's own."""

import json
import re
import tomllib

import jsonschema
import pytest
from pydantic import TypeAdapter

from workflow import Scene
from workflow.scene import reference, schema, template
from workflow.scene.keys import flat
from workflow.scene.scene import BUILTIN, SceneError, names
from workflow.scene.units import kinds, unit_of


@pytest.mark.parametrize("table", schema.models(), ids=lambda table: table.__name__)
def test_every_field_has_text_and_unit(table):
    """A sentence below each field; a unit wherever a number may stand; examples that fit."""
    texts = schema.texts(table)
    for name, field in table.model_fields.items():
        assert re.fullmatch(r"\S.{6,}\.", texts.get(name, "")), f"{table.__name__}.{name}: no text"
        if kinds(table, [name]) & {int, float}:
            assert unit_of(table, [name]), f"{table.__name__}.{name}: no unit"
        for example in field.examples or ():
            TypeAdapter(field.annotation).validate_python(example, strict=False)


def test_every_key_has_an_example():
    """What is not a table has a value to copy, which is TOML."""
    for key in reference.keys():
        assert key.text and key.type
        if "table" not in key.type:
            tomllib.loads(f"value = {key.example}")


def test_keys_are_complete():
    """Every key of every built-in scene, defaults in it, is one that is explained."""
    used = {
        re.sub(r"\.\d+\b", "[]", key)
        for name in names()
        for key, _ in flat(Scene.load(name).tables(), lists=True)
    }
    known = [
        re.compile(re.escape(key.path).replace(r"\.NAME", r"\.[^.]+")) for key in reference.keys()
    ]
    for key in used:  # or the one above, of a name of the user's choice, as in approach
        both = key, key.rpartition(".")[0]
        assert any(pattern.fullmatch(each) for pattern in known for each in both), key


@pytest.mark.parametrize("asked", ["contacts.friction", "contacts.wheel_rail.friction"])
def test_a_key_is_found_with_and_without_name(asked):
    """The coefficient: a number or a law, without unit, at least 0, by default 0."""
    (key,) = reference.find(asked)
    assert (key.path, key.type, key.unit) == ("contacts.NAME.friction", "number or table", "-")
    assert (key.default, key.range) == ("0.0", "≥ 0")
    assert "contacts.NAME.friction.static" in {below.path for below in reference.below(key)}


def test_lists_words_and_kinds_are_found():
    """Entries by number; words in names and texts; a key of several shapes, once for each."""
    assert [key.path for key in reference.find("supports.0.surface")] == ["supports[].surface"]
    assert "bodies.NAME.stiffness_damping" in {key.path for key in reference.find("Rayleigh")}
    assert len(reference.find("mesh.size")) == 9
    assert reference.find("mesh.nonsense") == []


@pytest.mark.parametrize(
    ("value", "text"),
    [(2.1e11, "2.1e11"), (0.46, "0.46"), (-1e-5, "-1e-5"), (True, "true"), ([1, 2.0], "[1, 2.0]")],
)
def test_values_are_written_as_toml(value, text):
    """As people write them, and back without loss."""
    assert reference.toml(value) == text
    assert tomllib.loads(f"value = {text}")["value"] == value


def test_schema_is_current():
    """The shipped file is what the models say (squealx schema writes it)."""
    assert json.loads(schema.SHIPPED.read_text("utf-8")) == schema.schema()


VALIDATOR = jsonschema.Draft202012Validator(schema.schema())


def complaints(tables) -> list[str]:
    return [f"{list(error.path)}: {error.message}" for error in VALIDATOR.iter_errors(tables)]


@pytest.mark.parametrize("name", names())
def test_built_in_scenes_name_the_schema_and_fit_it(name):
    """The first line is the one that editors read."""
    text = (BUILTIN / f"{name}.toml").read_text("utf-8")
    assert text.startswith("#:schema ../scene.schema.json\n")
    assert complaints(tomllib.loads(text)) == []


@pytest.mark.parametrize(
    "change",
    [
        {"frction": 0.3},
        {"time": {"end": 1e-3}},
        {"time": {"end": -1.0, "output_interval": 1e-4}},
        {"mesh": {"kind": "ball"}},
        {"gravity": [0.0, 0.0]},
    ],
    ids=str,
)
def test_schema_refuses(change):
    """Unknown and missing keys, values out of range, kinds there are not, too few numbers."""
    assert complaints(tomllib.loads((BUILTIN / "hertz.toml").read_text()) | change)


def test_schema_of_a_scene_with_base():
    """It may leave out what it likes, but not invent keys."""
    assert complaints({"base": "hertz", "mesh": {"size": 1e-3}}) == []
    assert complaints({"base": "hertz", "mesh": {"sise": 1e-3}})
    assert complaints({"name": "without", "title": "a base"})


@pytest.mark.parametrize("name", names())
def test_a_scene_of_ones_own_is_the_built_in_one(name, tmp_path):
    """Under another name; files that it names lie beside it."""
    template.new(tmp_path / "mine", name)
    own, built_in = Scene.load(tmp_path / "mine.toml").tables(), Scene.load(name).tables()
    assert own.pop("name") == "mine" and built_in.pop("name") == name
    for tables in (own, built_in):
        tables["mesh"].pop("path", None)
    assert own == built_in
    assert complaints(tomllib.loads((tmp_path / "mine.toml").read_text("utf-8"))) == []


@pytest.mark.parametrize("name", ["hertz", "stick-slip", "flange-transition"])
def test_commented_keys_are_defaults(name, tmp_path):
    """Every default that stands commented out may be uncommented: the scene stays as it was."""
    template.new(tmp_path / "mine", name)
    defaults = {(key.name, key.default) for key in reference.keys() if key.default}
    lines, count = [], 0
    for line in (tmp_path / "mine.toml").read_text("utf-8").splitlines():
        key = re.fullmatch(r"# (\w+) = (.*?)(   # .*)?", line)
        if key and key[1] != "kinematics" and (key[1], key[2].rstrip()) in defaults:
            line, count = line.removeprefix("# "), count + 1
        lines.append(line)
    (tmp_path / "all.toml").write_text("\n".join(lines), "utf-8")
    assert count > 15
    assert Scene.load(tmp_path / "all.toml") == Scene.load(tmp_path / "mine.toml")


@pytest.mark.parametrize(
    ("file", "source", "word"),
    [
        ("mine", "hertz", "expected a new file"),
        ("other", "hertzz", "--from 'hertzz'"),
        ("-x", "hertz", "name = '-x'"),
        ("none/other", "hertz", "expected a folder"),
    ],
)
def test_new_refuses(tmp_path, file, source, word):
    """A file that is there, a scene that is not, a bad name, no folder: nothing is written."""
    (tmp_path / "mine.toml").write_text("mine")
    with pytest.raises(SceneError, match=re.escape(word)):
        template.new(tmp_path / file, source)
    assert [path.name for path in tmp_path.iterdir()] == ["mine.toml"]
    assert (tmp_path / "mine.toml").read_text() == "mine"
