# SPDX-License-Identifier: LGPL-3.0-or-later
"""JSON Schema of a scene file, made from the models: what editors complete and check with.

The text of a key is the string below its field, read from the source only here: no run pays for it.
"""

import ast
import inspect
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

from workflow.scene.scene import Scene
from workflow.scene.units import Section

SHIPPED = Path(__file__).with_name("scene.schema.json")  # `squealx schema`, which the scenes name

DIALECT = "https://json-schema.org/draft/2020-12/schema"
BASE = {
    "type": "string",
    "description": "Scene to start from, built-in or a file; this one names what differs.",
    "examples": ["flange-transition"],
}


def models(base: type[Section] = Section) -> list[type[Section]]:
    """Return the models of a scene and its tables."""
    below = [m for m in base.__subclasses__() if m.__module__.startswith("workflow.scene.")]
    return [found for model in below for found in (model, *models(model))]


@cache
def texts(model: type[Section]) -> dict[str, str]:
    """Return the text of each field of a table that has one."""
    tree = ast.parse(inspect.getsource(model)).body[0]
    assert isinstance(tree, ast.ClassDef)
    inherited = {} if Section in model.__bases__ or model is Section else texts(model.__bases__[0])
    return inherited | {
        field.target.id: " ".join(text.value.value.split())
        for field, text in pairwise(tree.body)
        if isinstance(field, ast.AnnAssign)
        and isinstance(field.target, ast.Name)
        and isinstance(text, ast.Expr)
        and isinstance(text.value, ast.Constant)
        and isinstance(text.value.value, str)
    }


def complete() -> dict[str, Any]:
    """Return the schema of a whole scene, its tables by name in ``$defs``; no key may be null."""
    schema = _plain(Scene.model_json_schema())
    tables = {model.__name__: model for model in models()}
    defined = schema["$defs"] | {"Scene": schema}
    for name, table in defined.items():
        for field, text in texts(tables[name]).items():
            key = table["properties"][field]
            if "$ref" in key:  # what stands beside a reference is passed over by some editors
                table["properties"][field] = key = {"allOf": [{"$ref": key.pop("$ref")}], **key}
            key["description"] = text
    return schema


def schema() -> dict[str, Any]:
    """Return the schema of a scene file; with ``base`` it may leave out any key."""
    whole = complete()
    tables = whole.pop("$defs")
    loose = _partial(whole | {"$defs": tables})
    loose_tables = {f"{name}.part": table for name, table in loose.pop("$defs").items()}
    whole["properties"] = {"base": False, **whole["properties"]}
    loose["properties"] = {"base": BASE, **loose["properties"]}
    return {
        "$schema": DIALECT,
        "title": "Scene of squealx",
        **loose,
        "if": {"not": {"required": ["base"]}},
        "then": {"$ref": "#/$defs/Scene"},
        "$defs": {"Scene": whole, **tables, **loose_tables},
    }


def _plain(node: Any) -> Any:
    """Return a schema without made-up titles, and without null, which TOML does not have."""
    if isinstance(node, list):
        return [_plain(entry) for entry in node]
    if not isinstance(node, dict):
        return node
    if any(choice == {"type": "null"} for choice in node.get("anyOf", ())):
        choices = [choice for choice in node["anyOf"] if choice != {"type": "null"}]
        node = {k: v for k, v in node.items() if k not in ("anyOf", "default")} | (
            choices[0] if len(choices) == 1 else {"anyOf": choices}
        )
    drop = {"discriminator"} | ({"title"} if isinstance(node.get("title"), str) else set())
    return {key: _plain(value) for key, value in node.items() if key not in drop}


def _partial(node: Any) -> Any:
    """Return a schema in which no key is required, its tables by names of their own."""
    if isinstance(node, list):
        return [_partial(entry) for entry in node]
    if not isinstance(node, dict):
        return node
    found = {"anyOf" if key == "oneOf" else key: _partial(value) for key, value in node.items()}
    if isinstance(found.get("required"), list):
        del found["required"]
    if isinstance(found.get("$ref"), str):
        found["$ref"] += ".part"
    return found
