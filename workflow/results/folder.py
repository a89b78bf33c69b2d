# SPDX-License-Identifier: LGPL-3.0-or-later
"""Result folder: free for a new run, or cut back to its last checkpoint for one that goes on."""

import os
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mpi4py import MPI

import h5py
import numpy as np

from workflow.results import atomic, batch
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
    held = (path / "scene.toml").exists() or (path / "summary.json").exists()
    if held and not resume:
        raise SceneError(
            f"out = {str(path)!r}: already holds a run; expected a new folder, or --resume"
        )
    there = next(p for p in (path, *path.absolute().parents) if p.exists())
    try:
        tempfile.TemporaryDirectory(dir=there).cleanup()  # permissions alone do not tell
    except OSError as error:
        raise SceneError(
            f"out = {str(path)!r}: expected a folder that can be written ({error.strerror})"
        ) from None
    return path


def checked(out: str | Path, comm: MPI.Comm, resume: bool = False) -> Path:
    """Return the result folder if rank 0 finds it free; raise alike on all ranks if not."""
    error = None
    if comm.rank == 0:
        try:
            check_free(out, resume)
        except SceneError as caught:
            error = caught
    error = comm.bcast(error)
    if error is not None:
        raise error
    return Path(out)


def on_root(comm: MPI.Comm, folder: Path, work: Callable[[], None]) -> None:
    """Write on rank 0.

    Raises:
        RuntimeError: on all ranks, if there is no room or no permission.
    """
    told = None
    if comm.rank == 0:
        try:
            work()
        except OSError as error:
            told = error.strerror or str(error)
    told = comm.bcast(told)
    if told is not None:
        raise RuntimeError(
            f"results cannot be written: {told}; expected room and permission in {str(folder)!r}; "
            f"when there is, go on with: squealx run --resume --out {folder}"
        )


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
