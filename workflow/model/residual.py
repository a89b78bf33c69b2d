# SPDX-License-Identifier: LGPL-3.0-or-later
"""Residual state of an earlier run: where it is, and whether a scene can begin with it."""

import json
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from workflow.scene import Scene

FILE = "residual.npz"


def passes_in(folder: Path) -> list[Path]:
    """Return the folders of the passes in a result folder, in order; none of a single run."""
    found = {int(p.name[5:]): p for p in folder.glob("pass-*") if p.name[5:].isdigit()}
    return [found[k] for k in sorted(found)]


def last_pass(folder: Path) -> Path:
    """Return the folder of the last pass in a result folder; itself, if it holds a single run."""
    return next(reversed(passes_in(folder)), folder)


def before(scene: Scene) -> Path | None:
    """Return the folder of the run whose steel a scene begins with, if it names one."""
    after = scene.passes.after if scene.passes else None
    return None if after is None else last_pass(Path(after))


def unfit(scene: Scene) -> Iterator[str]:
    """Yield a line for why a scene cannot begin with the steel that its ``passes.after`` names."""
    folder = before(scene)
    if folder is None:
        return
    told = f"passes.after = {str(folder)!r}"
    if not (folder / FILE).is_file() or _read(folder).get("status") != "done":
        yield f"{told}: expected the folder of a run with [passes] that is done"
        return
    then, now = tomllib.loads((folder / "scene.toml").read_text("utf-8")), scene.tables()
    for key in ("mesh", "bodies"):
        if then.get(key) != now[key]:
            yield f"{told}: expected a run with the same [{key}] as this scene"


def _read(folder: Path) -> dict[str, Any]:
    try:
        return dict(json.loads((folder / "summary.json").read_text("utf-8")))
    except (OSError, ValueError):
        return {}
