# SPDX-License-Identifier: LGPL-3.0-or-later
"""The page that maps keywords of other codes to keys of a scene: only what works is on it."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

import pytest
from pydantic import BaseModel

from workflow.results.result import read_run
from workflow.scene.scene import Scene

PAGE = (Path(__file__).parents[2] / "docs" / "from-other-codes.md").read_text("utf-8")
KEY = re.compile(r"`([a-z_]+(?:\.(?:NAME|[a-z_]+))*)`((?: = \S+)?)")
BLOCK = re.compile(r"```(\w+)\n(.*?)```", re.DOTALL)


def keys(annotation: Any, above: str = "") -> Iterator[tuple[str, Any]]:
    """Yield every key below a model or type, dictionaries by NAME, with the type of its value."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        for name, field in annotation.model_fields.items():
            key = f"{above}.{name}" if above else name
            yield key, field.annotation
            yield from keys(field.annotation, key)
        return
    inner = get_args(annotation)
    if get_origin(annotation) is dict:
        yield from keys(inner[1], f"{above}.NAME")
    elif get_origin(annotation) is not Literal:
        for part in inner:
            yield from keys(part, above)


def choices(annotation: Any) -> set[str]:
    """Words that a value may be, of all unions."""
    if get_origin(annotation) is Literal:
        return set(map(str, get_args(annotation)))
    return set().union(*map(choices, get_args(annotation)))


EVERY: dict[str, list[Any]] = {}
for _key, _type in keys(Scene):
    EVERY.setdefault(_key, []).append(_type)


def test_every_key_is_one_of_a_scene():
    """No key of the page is unknown to the models, and there are more than 60."""
    tables = set(Scene.model_fields)
    named = {key for key, _ in KEY.findall(PAGE) if key.split(".")[0] in tables}
    assert not named - set(EVERY)
    assert len(named) > 60 and {"gravity", "time.safety", "driven.NAME.spin"} <= named


def test_every_word_is_one_of_its_key():
    """``key` = "word"`` on the page: the models know the word."""
    told = [(key, word) for key, word in re.findall(r'`([a-zA-Z_.]+)` = "([\w-]+)"', PAGE)]
    for key, word in told:
        known = set().union(*map(choices, EVERY[key]))
        assert word in known or str in EVERY[key], (key, word)
    assert len(told) > 12


def test_no_word_of_another_kind_of_key():
    """The walk finds keys of unions, lists and dictionaries, and none that is not there."""
    assert {"contacts.NAME.friction.memory.length", "supports.ramp", "mesh.path"} <= set(EVERY)
    assert "contacts.NAME.friction.colour" not in EVERY and "contacts.contactor" not in EVERY
    assert choices(EVERY["bodies.NAME.element"][0]) == {"full", "one-point", "selective"}


@pytest.mark.parametrize("text", [t for kind, t in BLOCK.findall(PAGE) if kind == "toml"])
def test_scenes_of_the_page(text, tmp_path):
    """Each is a scene that passes its checks."""
    path = tmp_path / "scene.toml"
    path.write_text(text)
    assert Scene.load(str(path)).contacts


@pytest.mark.slow
def test_law_of_the_page(tmp_path, monkeypatch):
    """The energy in the words of UFL runs as it stands."""
    (text,) = (t for kind, t in BLOCK.findall(PAGE) if kind == "python")
    monkeypatch.chdir(tmp_path)
    exec(compile(text, "page", "exec"), {"__name__": "page"})
    summary = read_run(tmp_path / "own-law").summary
    assert summary["status"] == "done" and summary["own_laws"]
