# SPDX-License-Identifier: LGPL-3.0-or-later
"""The command that does a run again, and the one that goes on with it."""

import json
import shlex
from pathlib import Path
from typing import Any

from workflow.recorded import Record
from workflow.scene import Scene, SceneError, names


def command(record: Record) -> str:
    """Return a command that runs the scene of a result folder again.

    That is the built-in scene with what was changed of it, where this can be told in options, and
    the scene file of the folder else.
    """
    tables = record.checked.tables()
    name = str(tables["name"])
    changes = differences(Scene.load(name).tables(), tables) if name in names() else None
    if changes is None or not _same(name, changes, tables):
        return f"squealx run {shlex.quote(str(record.folder / 'scene.toml'))} --out NEW"
    options = [f"--set {shlex.quote(f'{k}={json.dumps(v)}')}" for k, v in changes.items()]
    return " ".join(["squealx run", name, *options, "--out NEW"])


def _same(name: str, changes: dict[str, Any], tables: dict[str, Any]) -> bool:
    """Tell whether a built-in scene with changes is the scene of the tables."""
    try:
        return Scene.load(name, **changes).tables() == tables
    except SceneError:
        return False


def differences(base: dict[str, Any], other: dict[str, Any]) -> dict[str, Any] | None:
    """Return the values by dotted key that make ``other`` of ``base``; None if keys would go.

    Values that the options of a command cannot hold, lists of tables, make it None as well.
    """
    changes: dict[str, Any] = {}
    if set(base) - set(other):
        return None
    for key, value in other.items():
        if key in base and base[key] == value:
            continue
        if isinstance(value, dict):
            inner = base.get(key, {})
            below = differences(inner, value) if isinstance(inner, dict) else None
            if below is None:
                return None
            changes |= {f"{key}.{k}": v for k, v in below.items()}
        elif isinstance(value, list) and any(isinstance(v, dict) for v in value):
            return None
        else:
            changes[key] = value
    return changes


def how_to_resume(folder: Path, summary: dict[str, Any]) -> str | None:
    """Return the command that goes on with a run that has not reached its end, None if it has."""
    if summary.get("status") == "done":
        return None
    return f"squealx run --resume --out {shlex.quote(str(folder))}"
