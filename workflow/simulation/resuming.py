# SPDX-License-Identifier: LGPL-3.0-or-later
"""Resumption of a run: from its checkpoint, from the start, or not at all as it is finished.

Results are never replaced. A run that was killed before its first checkpoint begins anew, and what
it had written is put aside.
"""

import contextlib
import json
import math
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mpi4py import MPI

from workflow.model.residual import passes_in
from workflow.results.folder import outputs_in, put_aside
from workflow.scene import Scene, SceneError
from workflow.simulation.checkpoint import Checkpoint, check_same, file_of, read


def finished(
    folder: Path, scene: Scene, own: dict[str, str], comm: MPI.Comm
) -> dict[str, Any] | None:
    """Return the summary of a run that has reached the end of this scene; None of any other.

    Args:
        folder: Result folder.
        scene: What is to be run.
        own: Names of laws and items that are given with it, see ``Model.own_laws``.
        comm: Ranks that share the run.

    Raises:
        SceneError: on all ranks, if the folder holds a run of another scene or of other laws.
    """
    return on_all(comm, lambda: _finished(folder, scene, own))


def point_of(
    folder: Path, scene: Scene, comm: MPI.Comm, log: Callable[[str], Any]
) -> Checkpoint | None:
    """Return the checkpoint that a run goes on from; None where it begins from the start.

    Raises:
        SceneError: on all ranks, if a run that is done left no checkpoint to prolong it from.
    """
    point = read(folder, comm)
    if point is None:
        aside = on_all(comm, lambda: _cleared(folder, scene))
        log(f"resume: no checkpoint in {folder}, begins from the start")
        if aside is not None:
            log(f"resume: outputs that were there are kept in {aside}")
    return point


def how_to_go_on(folder: Path) -> str:
    """Return what can be done with a finished run, in words."""
    if file_of(folder).exists():
        return "finished before, left as it is; a later time.end goes on from its checkpoint"
    return "finished before, left as it is; without a checkpoint it cannot be prolonged"


def on_all(comm: MPI.Comm, work: Callable[[], Any]) -> Any:
    """Return on all ranks what ``work`` does on rank 0; raise its ``SceneError`` on all as well."""
    found, error = None, None
    if comm.rank == 0:
        try:
            found = work()
        except SceneError as caught:
            error = caught
        except OSError as caught:
            error = SceneError(f"resume: {caught.filename}: {caught.strerror or caught}")
    found, error = comm.bcast((found, error))
    if error is not None:
        raise error
    return found


def _finished(folder: Path, scene: Scene, own: dict[str, str]) -> dict[str, Any] | None:
    made = folder / "scene.toml"
    if there := passes_in(folder):
        raise SceneError(
            f"passes.number: {str(folder)!r} holds {len(there)} passes; expected two or more"
        )
    if not made.is_file():
        if outputs_in(folder):
            raise SceneError(
                f"resume: {str(folder)!r} holds results but no scene.toml to compare with; "
                "expected a new folder"
            )
        return None
    check_same(tables_of(made), scene, "folder")
    summary = summary_of(folder)
    if summary.get("status") != "done":
        return None
    if (had := summary.get("own_laws", {})) != own:
        raise SceneError(f"resume: expected the laws of that run, {had}, got {own}")
    late = abs(scene.time.end - summary.get("time", math.inf)) > summary.get("dt", 0.0)
    return None if late else summary


def tables_of(made: Path) -> dict[str, Any]:
    """Return the tables of the scene in a folder, with the defaults of today where it is whole."""
    try:
        tables = tomllib.loads(made.read_text("utf-8"))
    except ValueError as error:
        raise SceneError(f"resume: {str(made)!r}: not valid TOML: {error}") from None
    with contextlib.suppress(SceneError):
        return Scene.check(tables).tables()
    return tables


def summary_of(folder: Path) -> dict[str, Any]:
    """Return the ``summary.json`` of a folder; empty if there is none that can be read."""
    with contextlib.suppress(OSError, ValueError, TypeError):
        return dict(json.loads((folder / "summary.json").read_text("utf-8")))
    return {}


def _cleared(folder: Path, scene: Scene) -> Path | None:
    """Make room for a run from the start; return where the outputs went that were there."""
    if not outputs_in(folder):
        return None
    summary = summary_of(folder)
    if summary.get("status") == "done":
        raise SceneError(
            f"time.end = {scene.time.end} s: the run in {str(folder)!r} ended at "
            f"{summary['time']} s and left no checkpoint to go on from "
            "(output.checkpoint_minutes = 0); expected a new folder"
        )
    return put_aside(folder)
