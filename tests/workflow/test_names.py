# SPDX-License-Identifier: LGPL-3.0-or-later
"""Names and paths of a scene are data: they do not leave their folder, wherever one stands."""

import pytest
import tomli_w

from workflow import Scene
from workflow.scene.scene import SceneError
from workflow.study import study

NOT_NAMES = {
    "up": "../elsewhere", "root": "/tmp/elsewhere", "parent": "..", "here": ".", "empty": "",
    "below": "a/b", "other slash": "a\\b", "zero": "a\0b", "line": "a\nb", "hidden": ".git",
    "option": "-r", "long": "x" * 101, "long in bytes": "ä" * 51, "no text": "a\udc80b",
}  # fmt: skip


@pytest.mark.parametrize("case", NOT_NAMES)
def test_a_scene_is_named_as_one_folder(case):
    """The key, what it got and what it expects; a short message for a long name."""
    with pytest.raises(SceneError, match=r"^name = .*: expected ") as told:
        Scene.load("bar-wave", name=NOT_NAMES[case])
    assert len(str(told.value)) < 300


@pytest.mark.parametrize("name", ["bar", "my bar (2)", "Räder [mm] 1.5", "x" * 100, "ä" * 50])
def test_other_names_stay(name):
    """Spaces, letters of any language, brackets."""
    assert Scene.load("bar-wave", name=name).name == name


@pytest.mark.parametrize("table", ["contacts", "bodies"])
def test_contacts_and_bodies_are_no_paths_either(table):
    """Their names are those of groups and columns in results.h5."""
    tables = Scene.load("bar-impact").tables()
    tables[table] = {"a/b": next(iter(tables[table].values()))}
    with pytest.raises(SceneError, match=rf"{table}: name = 'a/b': expected "):
        Scene.check(tables)


@pytest.fixture
def written(tmp_path):
    """Write a study into a folder of its own and return its path."""

    def write(**tables):
        path = tmp_path / "studies" / "study.toml"
        path.parent.mkdir(exist_ok=True)
        path.write_text(tomli_w.dumps({"title": "title", "scene": "bar-wave"} | tables))
        return path

    return write


@pytest.mark.parametrize("case", [case for case in NOT_NAMES if case != "no text"])
def test_a_study_is_named_as_one_folder(written, case):
    """As a scene is; what is no text cannot be written in TOML."""
    with pytest.raises(SceneError, match=r"name = .*: expected "):
        study.load(written(name=NOT_NAMES[case], vary={"time.safety": [0.5]}))


def test_a_run_of_a_long_name_has_a_folder(written):
    """Two that differ at their ends alone are two."""
    rows = [{"name": "n" * 300 + end, "time.safety": 0.5} for end in "ab"]
    names = {run.name for run in study.runs_of(study.load(written(name="few", runs=rows)))}
    assert len(names) == 2 and all(len(name) <= 100 for name in names)


def test_profiles_are_found_beside_their_scene(tmp_path, monkeypatch):
    """Relative to the TOML file, not to where one stands; on the command line to the latter."""
    (tmp_path / "scenes" / "measured").mkdir(parents=True)
    (tmp_path / "elsewhere").mkdir()
    for name in ("scenes/rail.csv", "scenes/measured/wheel.csv", "elsewhere/rail.csv"):
        (tmp_path / name).write_text("0,0\n")
    (tmp_path / "elsewhere" / "54E1").write_text("0,0\n")
    mesh = {"rail_profile": "rail.csv", "wheel_profile": "measured/wheel.csv"}
    path = tmp_path / "scenes" / "mine.toml"
    path.write_text(tomli_w.dumps({"base": "flange-transition", "mesh": mesh}))
    monkeypatch.chdir(tmp_path / "elsewhere")
    found = Scene.load("../scenes/mine.toml").mesh
    assert (tmp_path / "scenes" / "rail.csv").samefile(found.rail_profile)
    assert (tmp_path / "scenes" / "measured" / "wheel.csv").samefile(found.wheel_profile)
    assert found.rail_profile.startswith("/")
    given = Scene.load("../scenes/mine.toml", **{"mesh.rail_profile": "rail.csv"}).mesh
    assert (tmp_path / "elsewhere" / "rail.csv").samefile(given.rail_profile)
    assert Scene.load("flange-transition").mesh.rail_profile == "54E1"


@pytest.mark.parametrize("dotted", [False, True])
def test_profiles_of_a_study_are_found_beside_it(written, tmp_path, dotted):
    """In ``set``, ``vary`` and ``runs``, by dotted keys and in tables."""

    def keyed(key, value):
        return {f"mesh.{key}": value} if dotted else {"mesh": {key: value}}

    made = study.load(
        written(
            name="few",
            set=keyed("wheel_profile", "w.csv"),
            vary=keyed("rail_profile", ["54E1", "r.csv"]),
            runs=[{"name": "one"} | keyed("path", "m.msh")],
        )
    )
    text = str(made)
    for name in ("w.csv", "r.csv", "m.msh"):
        assert str(tmp_path / "studies" / name) in text
    assert str(tmp_path / "studies" / "54E1") not in text
