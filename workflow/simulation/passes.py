# SPDX-License-Identifier: LGPL-3.0-or-later
"""Passes: runs of a scene one after the other, each over the steel that the one before has left."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from mpi4py import MPI

import tomli_w

from workflow.model.residual import passes_in
from workflow.results import atomic
from workflow.results.folder import command_to_resume, occupied, on_root, outputs_in
from workflow.results.passes import rows_of, write_table
from workflow.results.result import Result
from workflow.results.writer import write_summary
from workflow.scene import Scene, SceneError
from workflow.simulation.checkpoint import check_same
from workflow.simulation.guards import GuardError
from workflow.simulation.interrupts import Interrupted
from workflow.simulation.progress import Clock, Progress
from workflow.simulation.resuming import on_all, summary_of, tables_of

Run = Callable[..., Result]


def run_passes(
    scene: Scene, out: str | Path, comm: MPI.Comm, run: Run, *, quiet: bool, resume: bool
) -> Result:
    """Run the passes of a scene into ``pass-1``, ``pass-2`` … of a folder; those done are kept.

    Args:
        scene: The scene, with two or more passes.
        out: Their folder.
        comm: Ranks that share them.
        run: Runs one: called with a scene, a folder and ``resume``.
        quiet: No progress on the terminal.
        resume: Whether there may be passes already.

    Raises:
        SceneError: bad input, or a folder of other runs.
        GuardError: a pass was stopped; those before it are kept.
        Interrupted: by a signal.
    """
    assert scene.passes is not None
    number, progress = scene.passes.number, Progress(comm.rank == 0, quiet, Clock())
    with occupied(out, comm, "squealx run", resume=resume) as folder:
        on_all(comm, lambda: begin(folder, scene))
        progress.keep_in(folder, objects=False)
        result = Result(folder, {})
        for k in range(1, number + 1):
            progress.log(f"pass {k} of {number}")
            there = on_all(comm, partial(Path.exists, path_of(folder, k)))
            try:
                result = run(pass_of(scene, folder, k), path_of(folder, k), resume=there)
            except (GuardError, Interrupted) as stop:
                stop.args = (f"pass {k}: {stop}; all passes: {command_to_resume(folder)}",)
                progress.ended(str(stop))
                raise
            result = Result(folder, concluded(folder, result.summary, number, comm))
        progress.ended("done")
        progress.close()
        return result


def path_of(folder: Path, k: int) -> Path:
    """Return the folder of a pass, the first is 1."""
    return folder / f"pass-{k}"


def pass_of(scene: Scene, folder: Path, k: int) -> Scene:
    """Return the scene of a pass, an ordinary one that begins after the run before."""
    changes: dict[str, Any] = {"passes.number": 1}
    if k > 1:
        changes["passes.after"] = str(path_of(folder, k - 1))
    return scene.with_(**changes)


def begin(folder: Path, scene: Scene) -> None:
    """Write the scene of all passes, or see that it is the one that is there.

    Raises:
        SceneError: if the folder holds something else.
    """
    made = folder / "scene.toml"
    if outputs_in(folder):
        raise SceneError(
            f"passes.number: {str(folder)!r} holds a single run; expected a new folder, with "
            "passes.after to begin where that run has ended"
        )
    if made.is_file():
        there = tables_of(made)
        check_same(there, scene, "folder")
        if passes_in(folder) and there["time"]["end"] != scene.time.end:
            raise SceneError(
                f"time.end = {scene.time.end} s: expected that of the passes which are there, "
                f"{there['time']['end']} s"
            )
    (folder / "summary.json").unlink(missing_ok=True)  # until all passes are done
    atomic.replace(made, tomli_w.dumps(scene.tables()).encode())


def concluded(folder: Path, summary: dict[str, Any], number: int, comm: MPI.Comm) -> dict[str, Any]:
    """Write what there is to tell of the passes that are done; return the summary.

    Raises:
        GuardError: on all ranks, if it cannot be written.
    """
    found: dict[str, Any] = {}
    try:
        on_root(comm, folder, lambda: found.update(conclude(folder, summary, number)))
    except RuntimeError as error:
        raise GuardError(str(error)) from error
    return dict(comm.bcast(found))


def conclude(folder: Path, summary: dict[str, Any], number: int) -> dict[str, Any]:
    """Write the table of the passes that are done; when all are, the summary of the last with it.

    Times are those of all passes.
    """
    rows = rows_of(folder)
    write_table(folder, rows)
    if len(rows) < number:
        return summary
    each = [summary_of(path) for path in passes_in(folder)]
    times = {name: sum(one[name] for one in each) for name in ("wall_seconds", "processor_seconds")}
    found = summary | times | {"passes": rows}
    write_summary(folder, found)
    return found
