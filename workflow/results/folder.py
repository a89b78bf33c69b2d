# SPDX-License-Identifier: LGPL-3.0-or-later
"""Result folder: held by one run, free for a new one, or cut back to the last checkpoint."""

import contextlib
import itertools
import os
import shlex
import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mpi4py import MPI

import h5py
import numpy as np

from workflow.results import atomic, batch
from workflow.results.lock import NAME as LOCK
from workflow.results.lock import locked
from workflow.scene import SceneError


@dataclass(frozen=True)
class Resume:
    """What the results keep of a run that goes on from a checkpoint.

    Attributes:
        outputs: Outputs that were written by then.
        t: Time of the checkpoint [s].
        samples: Samples of probes that were written by then.
        trackers: What follows the patches of each pair, by name.
    """

    outputs: int
    t: float
    samples: int
    trackers: Mapping[str, Any]


def check_free(folder: str | Path, resume: bool = False) -> Path:
    """Return the folder of a new run, or of one to go on with, without touching it.

    Raises:
        SceneError: if it holds a run already or cannot be made or written.
    """
    path = Path(folder)
    if not resume:
        check_empty(path)
    there = next(p for p in (path, *path.absolute().parents) if p.exists())
    try:
        tempfile.TemporaryDirectory(dir=there).cleanup()  # permissions alone do not tell
    except OSError as error:
        raise SceneError(
            f"out = {str(path)!r}: expected a folder that can be written ({error.strerror})"
        ) from None
    return path


def check_empty(path: Path) -> None:
    """Raise ``SceneError`` if a folder holds a run, or outputs of one."""
    if any((path / name).exists() for name in ("scene.toml", "summary.json")) or outputs_in(path):
        raise SceneError(
            f"out = {str(path)!r}: already holds a run; expected a new folder, or run --resume to "
            "go on with it"
        )


def outputs_in(folder: Path) -> int:
    """Return how many outputs a folder holds; one, where its results cannot be read."""
    path = folder / "results.h5"
    if not path.exists():
        return 0
    try:
        with batch.opened(path) as file:
            return len(file["history/t"]) if "history/t" in file else 0
    except (OSError, KeyError, RuntimeError, ValueError):
        return int((folder / "scene.toml").exists())  # it is written before the first output


@contextlib.contextmanager
def kept(out: str | Path, who: str, *, resume: bool = False) -> Iterator[Path]:
    """Keep a result folder for the work inside; yield it.

    Args:
        out: The folder.
        who: What is at work, for the message of whoever comes second.
        resume: Whether it may hold a run.

    Raises:
        SceneError: if somebody is at work there, if it holds a run or cannot be written.
    """
    path = Path(out)
    if not (resume or (path / LOCK).exists()):
        check_empty(path)  # a folder of results is not touched, nor is one at work
    check_free(path, resume=True)
    with locked(path, who):
        if not resume:
            check_empty(path)
        yield path


@contextlib.contextmanager
def occupied(out: str | Path, comm: MPI.Comm, who: str, *, resume: bool = False) -> Iterator[Path]:
    """Keep a result folder on rank 0, as :func:`kept` does; raise alike on all ranks."""
    with contextlib.ExitStack() as stack:
        error = None
        if comm.rank == 0:
            try:
                stack.enter_context(kept(out, who, resume=resume))
            except SceneError as caught:
                error = caught
        error = comm.bcast(error)
        if error is not None:
            raise error
        yield Path(out)


def put_aside(folder: Path) -> Path:
    """Move what a run has left in a folder into one below, and return that; the scene stays."""
    numbers = (n for n in itertools.count(1) if not (folder / f"aside-{n}").exists())
    aside = folder / f"aside-{next(numbers)}"
    aside.mkdir()
    shutil.copy(folder / "scene.toml", aside)
    # results.h5 last: a folder that has it still is one to be put aside
    for path in sorted(folder.iterdir(), key=lambda path: path.name == "results.h5"):
        if path.name not in (LOCK, "scene.toml") and not path.name.startswith("aside-"):
            os.replace(path, aside / path.name)
    return aside


def on_root(comm: MPI.Comm, folder: Path, work: Callable[[], None], *, begun: bool = True) -> None:
    """Write on rank 0.

    Args:
        comm: Ranks that meet the error.
        folder: Result folder.
        work: What writes.
        begun: Whether there is a run to go on with.

    Raises:
        RuntimeError: on all ranks, whatever went wrong: no room, no permission, no memory.
    """
    told: str | None = None
    cause: Exception | None = None
    if comm.rank == 0:
        try:
            work()
        except OSError as error:
            told, cause = atomic.why(error), error
        except Exception as error:
            told, cause = f"{type(error).__name__} {error}".strip(), error
    told = comm.bcast(told)
    if told is not None:
        then = f"; when there is, go on with: {command_to_resume(folder)}" if begun else ""
        raise RuntimeError(
            f"results cannot be written: {told}; expected room and permission in {str(folder)!r}"
            f"{then}"
        ) from cause


def command_to_resume(folder: Path) -> str:
    """Return the command that goes on with a run."""
    return f"squealx run --resume --out {shlex.quote(str(folder))}"


def cut(folder: Path, resume: Resume) -> list[str]:
    """Drop all that a run wrote after its checkpoint; return what had to be replaced.

    A broken ``results.h5`` is replaced by its copy in the checkpoint, broken fields begin anew.

    Raises:
        OSError: if the copy cannot be read either.
    """
    results, fields, lost = folder / "results.h5", folder / "fields.vtkhdf", []
    try:
        cut_results(results, resume)
    except (OSError, KeyError, RuntimeError, ValueError):
        batch.drop(results)
        atomic.copy(folder / "checkpoint" / "results.h5", results)
        cut_results(results, resume)
        lost.append("results.h5 was broken: taken from the checkpoint")
    if fields.exists() and not readable(fields):
        batch.drop(fields)
        os.replace(fields, fields.with_name("fields.broken.vtkhdf"))
        lost.append(f"fields.vtkhdf was broken: put aside, begins again at t = {resume.t:.6e} s")
    return lost


def readable(path: Path) -> bool:
    """Tell whether the changes of a killed process can be finished and the file be read."""
    try:
        batch.finish(path)
        with h5py.File(path, "r", locking=False) as file:
            root = file["VTKHDF"]
            whole = "Points" in root
            if "Steps" in root:
                steps, n = int(root["Steps"].attrs["NSteps"]), len(root["Points"])
                whole &= len(root["Steps/Values"]) == steps
                whole &= len(root["PointData/displacement"]) == steps * n
    except (OSError, KeyError, RuntimeError, ValueError):
        return False
    return bool(whole)


def cut_results(path: Path, resume: Resume) -> None:
    """Drop all of ``results.h5`` that was written after the checkpoint."""
    outputs = resume.outputs
    batch.finish(path)
    with atomic.changing(path) as file:
        for column in file["history"].values():
            if len(column) < outputs:
                raise ValueError(f"{column.name}: expected {outputs} outputs, got {len(column)}")
            column.resize(outputs, axis=0)
        for group in file["contact"].values():
            for k in [k for k in group if int(k) >= outputs]:
                del group[k]
        if resume.samples or "probes" in file:
            from workflow.results import samples  # a run that samples nothing does not import it

            samples.cut(file, resume.samples)
        for table in file["patches"].values() if "patches" in file else ():
            if "output" in table:
                _shorten(table, int(np.searchsorted(table["output"][:], outputs)))
            if "events" in table and "t" in table["events"]:
                events = table["events"]
                _shorten(events, int(np.searchsorted(events["t"][:], resume.t, side="right")))


def _shorten(table: Any, rows: int) -> None:
    for column in table.values():
        if isinstance(column, h5py.Dataset):
            column.resize(min(rows, len(column)), axis=0)
