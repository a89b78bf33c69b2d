# SPDX-License-Identifier: LGPL-3.0-or-later
"""Dotted keys of nested tables: ``mesh.size`` is ``{"mesh": {"size": ...}}``."""

from collections.abc import Iterator, Mapping
from typing import Any

from workflow.scene.units import SceneError


def flat(tables: Any, above: str = "", *, lists: bool = False) -> Iterator[tuple[str, Any]]:
    """Yield dotted key and value of nested tables; an empty table is a value.

    Args:
        tables: The tables.
        above: Key of what they stand below.
        lists: Whether tables in lists are entered too, by their number.
    """
    if lists and isinstance(tables, list):
        tables = dict(enumerate(tables))
    for name, value in tables.items():
        key = f"{above}.{name}" if above else str(name)
        entered = isinstance(value, Mapping) or (lists and is_tables(value))
        if entered and value:
            yield from flat(value, key, lists=lists)
        else:
            yield key, value


def is_tables(value: Any) -> bool:
    """Tell whether a value is a list of tables."""
    return isinstance(value, list) and any(isinstance(entry, Mapping) for entry in value)


def nested(table: Mapping[str, Any]) -> dict[str, Any]:
    """Return the tables that dotted keys, at any depth, stand for."""
    found: dict[str, Any] = {}
    for key, value in table.items():
        *above, last = key.split(".")
        entry = {last: nested(value) if isinstance(value, Mapping) else value}
        for name in reversed(above):
            entry = {name: entry}
        found = joined(found, entry)
    return found


def joined(first: Mapping[str, Any], second: Mapping[str, Any]) -> dict[str, Any]:
    """Return nested tables with those of ``second`` put over ``first``."""
    both = dict(first)
    for key, value in second.items():
        under = both.get(key)
        if isinstance(value, Mapping) and isinstance(under, Mapping):
            value = joined(under, value)
        both[key] = value
    return both


def changed(tables: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return nested tables with values by dotted key put in; a table takes the place of another.

    Raises:
        SceneError: if a key lies below a value.
    """
    found = dict(tables)
    for key, value in changes.items():
        *above, last = key.split(".")
        inner = found
        for depth, table in enumerate(above, 1):
            below = inner.get(table, {})
            if not isinstance(below, dict):
                path = ".".join(above[:depth])
                raise SceneError(f"{key}: expected a key of the scene, but {path} is not a table")
            inner[table] = dict(below)
            inner = inner[table]
        inner[last] = value
    return found


def differences(base: Mapping[str, Any], other: Mapping[str, Any]) -> dict[str, Any] | None:
    """Return the values by dotted key that make ``other`` of ``base``; None if keys would go.

    Values that the options of a command cannot hold, lists of tables, make it None as well.
    """
    before, after = dict(flat(base)), dict(flat(other))
    gone = [key for key, value in before.items() if key not in after and value != {}]
    changes = {k: v for k, v in after.items() if v != {} and (k not in before or before[k] != v)}
    return None if gone or any(map(is_tables, changes.values())) else changes
