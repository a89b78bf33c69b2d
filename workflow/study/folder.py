# SPDX-License-Identifier: LGPL-3.0-or-later
"""Folder of a study: its scenes, its Snakefile, and the result folder of each run."""

import contextlib
import json
import re
import tomllib
from collections.abc import Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Any

import tomli_w

from workflow.results.folder import check_free
from workflow.scene.keys import flat
from workflow.scene.scene import Scene, SceneError
from workflow.study.study import Run, Study


def write(study: Study, runs: Sequence[Run], folder: Path) -> None:
    """Write what Snakemake needs; files that are as they should be stay untouched.

    Raises:
        SceneError: if a run in the folder was made with another scene, before anything is written.
    """
    check(runs, folder)
    _put(folder / "Snakefile", (resources.files("workflow.study") / "Snakefile").read_text())
    for run in runs:
        _put(folder / "scenes" / f"{run.name}.toml", tomli_w.dumps(run.scene.tables()))
    (folder / "logs").mkdir(exist_ok=True)
    about = {
        "name": study.name,
        "title": study.title,
        "compare": study.compare,
        "figures": study.figures,
        "runs": {
            run.name: {
                "group": run.group,
                "label": run.label,
                "ranks": run.ranks,
                "scene": run.scene.name,
                "changes": run.changes,
            }
            for run in runs
        },
    }
    _put(folder / "study.json", json.dumps(about, indent=2) + "\n")


def check(runs: Sequence[Run], folder: Path) -> None:
    """Refuse a folder that cannot be written or whose runs are of other scenes than these."""
    check_free(folder)
    for run in runs:
        made = folder / "runs" / run.name / "scene.toml"
        if made.is_file() and (key := _different(tomllib.loads(made.read_text("utf-8")), run)):
            raise SceneError(
                f"out = {str(folder)!r}: run {run.name} was made with another {key}; expected a "
                f"new folder, or {made.parent} removed"
            )


def _different(made: Mapping[str, Any], run: Run) -> str | None:
    """Return the first key in which a scene that was run differs."""
    with contextlib.suppress(SceneError):
        made = Scene.check(made).tables()  # with the defaults of today
    there, here = dict(flat(made)), dict(flat(run.scene.tables()))
    return next((key for key in there | here if there.get(key) != here.get(key)), None)


def _put(path: Path, text: str) -> None:
    """Write a file unless it holds this already: a newer file would make Snakemake run again."""
    if not path.is_file() or path.read_text("utf-8") != text:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")


def done(folder: Path, name: str) -> bool:
    """Tell whether a run of the study is complete."""
    return (folder / "runs" / name / "done").is_file()


def summary(folder: Path, name: str) -> dict[str, Any]:
    """Return the ``summary.json`` of a run, empty if it has none."""
    try:
        text = (folder / "runs" / name / "summary.json").read_text("utf-8")
        return dict(json.loads(text))
    except (OSError, ValueError):
        return {}


def state(folder: Path, name: str) -> str:
    """Return how far a run is: done, what stopped it, begun, or to do."""
    if done(folder, name):
        return "done"
    status = str(summary(folder, name).get("status", ""))
    if status and status != "done":
        return status
    return "begun" if (folder / "runs" / name / "scene.toml").is_file() else "to do"


def share(folder: Path, name: str) -> float:
    """Return which share of its steps a run has made, from the last line of its log."""
    if done(folder, name):
        return 1.0
    with contextlib.suppress(OSError):
        text = (folder / "runs" / name / "run.log").read_text("utf-8", errors="replace")
        if found := re.findall(r"step (\d+) of (\d+)", text[-2000:]):
            return min(int(found[-1][0]) / max(int(found[-1][1]), 1), 0.99)
    return 0.0


def reason(folder: Path, name: str) -> str:
    """Return why a run did not finish, in one line."""
    status = state(folder, name)
    if status not in ("to do", "begun"):
        return status
    for log in (f"{name}.log", f"{name}-figures.log"):
        with contextlib.suppress(OSError):
            lines = (folder / "logs" / log).read_text("utf-8", errors="replace").splitlines()
            told = [line for line in lines if line.startswith("squealx: ")] or lines
            if told:
                return told[-1].removeprefix("squealx: ")
    return status
