# SPDX-License-Identifier: LGPL-3.0-or-later
"""Report page of a run: settings, results, figures, checks, command to reproduce it.

The page is a single HTML file that holds its pictures; it needs no network and no scripts.
"""

import base64
import itertools
import json
import shlex
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from workflow.figures import gallery
from workflow.model.residual import last_pass
from workflow.report.checks import Check, checks
from workflow.report.tables import (
    contact_tables,
    energy_table,
    event_table,
    model_table,
    other_table,
    phase_table,
    settings,
)
from workflow.results import atomic
from workflow.results.passes import rows_of
from workflow.results.passes import tables as tables_of_passes
from workflow.results.record import Record, whole
from workflow.scene.keys import differences
from workflow.scene.scene import Scene, SceneError, names
from workflow.theory.quantity import answers

LINES = 200  # of the log that are shown at either end
KINDS = {".png": "image/png", ".gif": "image/gif"}


def report(folder: str | Path, modes: Path | None = None) -> Path:
    """Draw the figures of a result folder, write its ``report.html`` and return the path.

    Args:
        folder: Result folder of a run, finished, stopped or killed.
        modes: Folder of natural modes that spectra are drawn with.

    Raises:
        SceneError: if the folder holds no run, or what it holds cannot be read.
    """
    record = whole(last_pass(Path(folder)), modes)
    pictures = gallery.draw(folder, modes)
    page = render(contents(record, pictures, Record(folder)))
    path = Path(folder) / "report.html"
    atomic.replace(path, page.encode())
    return path


def contents(record: Record, pictures: Sequence[Path], top: Record | None = None) -> dict[str, Any]:
    """Return what the template shows, by name.

    Args:
        record: The run; of several passes the last.
        pictures: Its figures.
        top: The folder of all passes, if there are several.
    """
    top = top or record
    summary, log = read_summary(top.folder), read_log(record.folder)
    found = checks(record, summary)
    return {
        "scene": top.checked,
        "about": about(top.checked.name),
        "summary": summary,
        "status": summary.get("status", UNFINISHED),
        "in_short": in_short(record, summary, found),
        "resume": how_to_resume(top.folder, summary),
        "passes": tables_of_passes(rows) if (rows := rows_of(top.folder)) else (),
        "model": model_table(record, summary),
        "others": other_table(summary),
        "settings": settings(top.checked),
        "audit": [line for line in log if " audit: " in line],
        "log": shortened([line for line in log if " audit: " not in line]),
        "checks": found,
        "expected": answers(summary.get("expected", ())),
        "contacts": contact_tables(record),
        "events": event_table(record),
        "energy": energy_table(record, summary),
        "phases": phase_table(summary),
        "figures": [embedded(p, k) for k, p in enumerate(pictures, 1)],
        "command": command(top),
    }


UNFINISHED = "unfinished: no summary.json, so the run goes on or was killed"


def about(name: str) -> str:
    """Return what the file of a built-in scene says of it, empty for any other."""
    if name not in names():
        return ""
    text = (resources.files("workflow.scene") / "builtin" / f"{name}.toml").read_text("utf-8")
    head = itertools.takewhile(lambda line: line.startswith("#"), text.splitlines())
    return " ".join(line.removeprefix("#").strip() for line in head)


def in_short(record: Record, summary: dict[str, Any], found: Sequence[Check]) -> list[str]:
    """Return the sentences that a reader in a hurry needs."""
    t = record.history.get("t", np.zeros(0))
    end = record.checked.time.end
    lines = []
    if "steps" in summary:
        lines.append(
            f"{summary['cells']:,} cells and {summary['nodes']:,} nodes were stepped "
            f"{summary['steps']:,} times by {summary['dt'] * 1e9:.4g} ns on {summary['ranks']} "
            f"{'rank' if summary['ranks'] == 1 else 'ranks'} in {summary['wall_seconds']:.3g} s."
        )
    reached = f"{t[-1] * 1e3:.4g}" if len(t) else "0"
    outputs = "one output" if len(t) == 1 else f"{len(t)} outputs"
    lines.append(f"{outputs.capitalize()} to t = {reached} ms of {end * 1e3:.4g} ms.")
    for name, contact in record.contacts.items():
        lines.append(_touch(name, contact))
    missed = [c.name for c in found if c.passed is False]
    judged = [c for c in found if c.passed is not None]
    if judged:
        told = f"Failed: {', '.join(missed)}." if missed else f"All {len(judged)} checks passed."
        lines.append(told)
    return [line.replace(",", "\u202f") if k == 0 else line for k, line in enumerate(lines)]


def _touch(name: str, contact: Any) -> str:
    """Return in a sentence what a contact did."""
    forces = [sum(p.normal_force for p in patches.values()) for patches in contact.patches]
    text = f"Contact {name} bore up to {max(forces) / 1e3:.4g} kN"
    if contact.two_points.any():
        birth = contact.t[int(contact.two_points.argmax())]
        text += f"; two patches from t = {birth * 1e3:.4g} ms on"
        text += ", one again at the end" if len(contact.patches[-1]) == 1 else ""
    return text + "."


def read_summary(folder: Path) -> dict[str, Any]:
    """Return the contents of ``summary.json``, empty if the run has not written it."""
    path = folder / "summary.json"
    found = json.loads(path.read_text("utf-8")) if path.is_file() else {}
    return found if isinstance(found, dict) else {}


def read_log(folder: Path) -> list[str]:
    """Return the lines of ``run.log``, none if there is none."""
    path = folder / "run.log"
    return path.read_text("utf-8", errors="replace").splitlines() if path.is_file() else []


def shortened(log: Sequence[str]) -> list[str]:
    """Return the log, the middle of a long one left out and said so."""
    left = len(log) - 2 * LINES
    if left <= 0:
        return list(log)
    return [*log[:LINES], f"… {left} lines left out, all are in run.log …", *log[-LINES:]]


def embedded(path: Path, number: int) -> dict[str, Any]:
    """Return a picture as a data address with its number and caption."""
    data = base64.b64encode(path.read_bytes()).decode()
    address = f"data:{KINDS[path.suffix]};base64,{data}"
    caption = gallery.caption(path.stem)
    return {"number": number, "name": path.stem, "address": address, "caption": caption}


def render(shown: dict[str, Any]) -> str:
    """Return the page; everything that is put into it is escaped."""
    from jinja2 import Environment, StrictUndefined, select_autoescape

    environment = Environment(
        autoescape=select_autoescape(default=True),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    text = (resources.files("workflow.report") / "template.html").read_text("utf-8")
    return environment.from_string(text).render(**shown)


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


def how_to_resume(folder: Path, summary: dict[str, Any]) -> str | None:
    """Return the command that goes on with a run that has not reached its end, None if it has."""
    if summary.get("status") == "done":
        return None
    return f"squealx run --resume --out {shlex.quote(str(folder))}"
