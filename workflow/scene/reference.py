# SPDX-License-Identifier: LGPL-3.0-or-later
"""Reference of scene keys: type, unit, default, range, text and an example of every one.

All of it is read from the models by way of their JSON Schema. Examples are those of the field, else
what the built-in scenes say. ``NAME`` stands for a name of the user's choice, ``[]`` for one of a
list.
"""

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

from workflow.scene.keys import is_tables
from workflow.scene.scene import names, read
from workflow.scene.schema import complete

FAMILIAR = ("flange-transition", "hertz")  # their values are the examples, then any other scene's
WORDS = {"number": "number", "integer": "integer", "string": "text", "boolean": "true or false"}


@dataclass(frozen=True)
class Key:
    """A key of a scene.

    Attributes:
        path: Dotted name, such as ``contacts.NAME.friction``.
        where: What else its table has to say for it to be there, such as ``kind = "bar"``.
        type: What the value is, in words.
        unit: Unit of its numbers; empty where it has none.
        default: Value if left out, as TOML; None if it has to be given, empty if there is none.
        range: What the value may be.
        text: What it is.
        example: A value, as TOML; empty for tables.
    """

    path: str
    where: str
    type: str
    unit: str
    default: str | None
    range: str
    text: str
    example: str

    def meant(self, asked: str) -> bool:
        """Tell whether a dotted name, with or without names and numbers, is that of this key."""
        pattern = re.escape(self.path).replace(r"\[\]", r"(\[\]|\.\d+)?")
        pattern = re.sub(r"\\\.NAME", r"(\\.[^.]+)?", pattern)
        return re.fullmatch(pattern, asked) is not None

    @property
    def name(self) -> str:
        """Name within its table."""
        return self.path.rsplit(".", 1)[-1]

    @property
    def rows(self) -> dict[str, str]:
        """What there is to say of it besides its text, by heading; no empty entries."""
        said = {
            "type": f"{self.type} [{self.unit}]" if self.unit else self.type,
            "with": self.where,
            "default": "must be given" if self.default is None else self.default,
            "range": self.range,
            "example": self.example,
        }
        return {head: text for head, text in said.items() if text}


@cache
def keys() -> tuple[Key, ...]:
    """Return all keys of a scene in the order of its tables."""
    schema, seen = complete(), _examples()
    return tuple(
        Key(
            path,
            where,
            _type(node),
            _unit(node),
            None if required else _default(node),
            _range(node),
            node.get("description", ""),
            _example(node, seen.get((path, where))),
        )
        for path, where, node, required in _walk(schema, schema["$defs"], "", "")
    )


def find(asked: str) -> list[Key]:
    """Return the keys that a dotted name means; if none, those that have it as word."""
    if found := [key for key in keys() if key.meant(asked)]:
        return found
    word = asked.lower()
    return [key for key in keys() if word in key.path.lower() or word in key.text.lower()]


def below(key: Key) -> list[Key]:
    """Return the keys of the tables that a key may hold."""
    return [each for each in keys() if re.match(re.escape(key.path) + r"[.\[]", each.path)]


def toml(value: Any) -> str:
    """Return a value as TOML writes it in one line."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return _short(value)
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
    if isinstance(value, Mapping):
        inner = ", ".join(f"{key} = {toml(entry)}" for key, entry in value.items())
        return f"{{ {inner} }}" if inner else "{}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(toml, value))}]"
    return str(value)


def _short(value: float) -> str:
    """Return a number as people write it: 0.46, 2.1e11."""
    if value == 0.0 or 1e-3 <= abs(value) < 1e6:
        return repr(value)
    digits, power = f"{value:.15e}".split("e")
    digits = digits if float(f"{value:.12e}") != value else f"{value:.12e}".split("e")[0]
    return f"{digits.rstrip('0').rstrip('.')}e{int(power)}"


def _walk(
    table: Mapping[str, Any], defined: Mapping[str, Any], above: str, where: str
) -> Iterator[tuple[str, str, dict[str, Any], bool]]:
    """Yield path, condition, schema and whether it must be given, of all keys of a table."""
    for name, node in table["properties"].items():
        path = f"{above}.{name}" if above else name
        yield path, where, node, name in _required(table)
        for inner, suffix in _tables(node, defined):
            yield from _walk(inner, defined, path + suffix, _condition(inner) or where)


def _required(table: Mapping[str, Any]) -> list[str]:
    """Return the keys of a table that must be given, unless one alone stands for several."""
    choices = [choice["required"] for choice in table.get("anyOf", ())]
    return list(table.get("required", max(choices, key=len, default=[])))


def _tables(node: Any, defined: Mapping[str, Any]) -> Iterator[tuple[dict[str, Any], str]]:
    """Yield the tables that a value may be or hold, and what their path has after the key."""
    if "$ref" in node:
        yield defined[node["$ref"].rsplit("/", 1)[-1]], ""
    for choice in (*node.get("allOf", ()), *node.get("oneOf", ()), *node.get("anyOf", ())):
        yield from _tables(choice, defined)
    for word, suffix in (("items", "[]"), ("additionalProperties", ".NAME")):
        if isinstance(node.get(word), dict):
            yield from ((inner, suffix + more) for inner, more in _tables(node[word], defined))


def _condition(table: Mapping[str, Any]) -> str:
    """Return the key that tells this kind of table from others, with its value."""
    fixed = ((k, node["const"]) for k, node in table["properties"].items() if "const" in node)
    return next((f"{key} = {toml(value)}" for key, value in fixed), "")


def _examples() -> dict[tuple[str, str], Any]:
    """Return the values of the built-in scenes by path and condition."""
    schema, found = complete(), dict[tuple[str, str], Any]()
    for name in (*FAMILIAR, *names()):
        for place, value in _used(schema, schema["$defs"], read(name), "", ""):
            found.setdefault(place, value)
    return found


def _used(
    table: Mapping[str, Any], defined: Mapping[str, Any], data: Any, above: str, where: str
) -> Iterator[tuple[tuple[str, str], Any]]:
    """Yield the values of nested tables by path and condition."""
    for name, node in table["properties"].items():
        if name not in data:
            continue
        path = f"{above}.{name}" if above else name
        yield (path, where), data[name]
        for inner, suffix in _tables(node, defined):
            for entry in _entries(data[name], suffix):
                if _fits(entry, inner):
                    condition = _condition(inner) or where
                    yield from _used(inner, defined, entry, path + suffix, condition)


def _entries(value: Any, suffix: str) -> Iterable[Any]:
    """Return the tables that stand behind a key, by the suffix of their path."""
    if suffix == "[]":
        return list(value) if isinstance(value, list) else []
    if suffix == ".NAME":
        return list(value.values()) if isinstance(value, dict) else []
    return [value]


def _fits(data: Any, table: Mapping[str, Any]) -> bool:
    """Tell whether a value is this kind of table."""
    if not isinstance(data, dict) or not data.keys() <= table["properties"].keys():
        return False
    fixed = ((key, node["const"]) for key, node in table["properties"].items() if "const" in node)
    return all(data.get(key) == value for key, value in fixed)


def _type(node: Mapping[str, Any]) -> str:
    """Return what a value is, in words."""
    if "$ref" in node or "allOf" in node:
        return "table"
    if choices := node.get("oneOf") or node.get("anyOf"):
        return " or ".join(dict.fromkeys(map(_type, choices)))
    if "const" in node or "enum" in node:
        return "choice" if "enum" in node else "text"
    if node["type"] == "array":
        if "prefixItems" in node:
            words = {_type(entry) for entry in node["prefixItems"]}
            return f"{len(node['prefixItems'])} × {words.pop()}"
        return f"list of {_type(node['items'])}s".replace("texts", "text")
    if node["type"] == "object":
        inner = _type(node["additionalProperties"])
        return "tables by name" if inner == "table" else f"{inner} by name"
    return WORDS[node["type"]]


def _unit(node: Any) -> str:
    """Return the unit of the numbers of a value."""
    if "unit" in node:
        return str(node["unit"])
    inner = [*node.get("prefixItems", ()), *node.get("oneOf", ()), *node.get("anyOf", ())]
    inner += [n for w in ("items", "additionalProperties") if isinstance(n := node.get(w), dict)]
    return next((unit for each in inner if (unit := _unit(each))), "")


def _range(node: Mapping[str, Any]) -> str:
    """Return what a value may be, in words."""
    if "enum" in node or "const" in node:
        return ", ".join(map(toml, node.get("enum", [node.get("const")])))
    said = [
        f"{sign} {node[word]:g}"
        for word, sign in (
            ("exclusiveMinimum", ">"),
            ("minimum", "≥"),
            ("exclusiveMaximum", "<"),
            ("maximum", "≤"),
        )
        if word in node
    ]
    if "pattern" in node:
        said.append("letters, digits, _ and -")
    if "prefixItems" not in node and (node.get("minItems") or node.get("minProperties")):
        said.append("at least one")
    inner = [*node.get("prefixItems", ())[:1], *node.get("oneOf", ()), *node.get("anyOf", ())]
    inner += [n for w in ("items", "additionalProperties") if isinstance(n := node.get(w), dict)]
    return ", ".join(dict.fromkeys([*said, *filter(None, map(_range, inner))]))


def _default(node: Mapping[str, Any]) -> str:
    """Return the value of a key that is left out; none of a table, whose keys have their own."""
    if node.get("default") is None or _type(node) in ("table", "list of tables"):
        return ""
    return toml(node["default"])


def _example(node: Mapping[str, Any], seen: Any) -> str:
    """Return a value as TOML: the field's own, of a built-in scene, or the default."""
    if "const" in node:
        return toml(node["const"])
    value = node["examples"][0] if "examples" in node else seen
    if value is None:
        value = node.get("default")
    tables = isinstance(value, dict) and _type(node).startswith(("table", "number or table"))
    return "" if value is None or tables or is_tables(value) else toml(value)
