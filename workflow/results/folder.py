# SPDX-License-Identifier: LGPL-3.0-or-later
"""A result folder taken up again at a checkpoint: what came later is dropped."""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np

from workflow.results import atomic
from workflow.results import samples as sample_table
from workflow.simulation.checkpoint import part

if TYPE_CHECKING:
    from workflow.simulation.checkpoint import Checkpoint


def trackers(point: "Checkpoint") -> dict[str, Any]:
    """Return what follows the patches of each pair, by name."""
    from contact.patches import Tracker

    found = {}
    for name in {key.split("/")[1] for key in point.arrays if key.startswith("tracker/")}:
        found[name] = Tracker()
        found[name].restore(part(point.arrays, f"tracker/{name}/"))
    return found


def samples(point: "Checkpoint") -> int:
    """Return how many samples of probes the results had at a checkpoint."""
    return int(point.arrays["samples//every"][1]) if "samples//every" in point.arrays else 0


def cut(folder: Path, outputs: int, t: float, sampled: int = 0) -> list[str]:
    """Keep the first ``outputs`` outputs, those up to ``t`` [s]; return what had to be replaced.

    Of the samples of probes the first ``sampled`` are kept.

    A broken ``results.h5`` is replaced by its copy in the checkpoint, broken fields begin anew.

    Raises:
        OSError: if the copy cannot be read either.
    """
    results, fields, lost = folder / "results.h5", folder / "fields.vtkhdf", []
    try:
        cut_results(results, outputs, t, sampled)
    except (OSError, KeyError, RuntimeError, ValueError):
        atomic.journal_of(results).unlink(missing_ok=True)
        atomic.copy(folder / "checkpoint" / "results.h5", results)
        cut_results(results, outputs, t, sampled)
        lost.append("results.h5 was broken: taken from the checkpoint")
    if fields.exists() and not readable(fields):
        atomic.journal_of(fields).unlink(missing_ok=True)
        os.replace(fields, fields.with_name("fields.broken.vtkhdf"))
        lost.append(f"fields.vtkhdf was broken: put aside, begins again at t = {t:.6e} s")
    return lost


def readable(path: Path) -> bool:
    """Tell whether the changes of a killed process can be finished and the file be read."""
    try:
        atomic.finish(path)
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


def cut_results(path: Path, outputs: int, t: float, sampled: int = 0) -> None:
    """Drop all of ``results.h5`` that was written after the checkpoint."""
    with atomic.changing(path) as file:
        for column in file["history"].values():
            if len(column) < outputs:
                raise ValueError(f"{column.name}: expected {outputs} outputs, got {len(column)}")
            column.resize(outputs, axis=0)
        for group in file["contact"].values():
            for k in [k for k in group if int(k) >= outputs]:
                del group[k]
        sample_table.cut(file, sampled)
        for table in file["patches"].values() if "patches" in file else ():
            if "output" in table:
                _shorten(table, int(np.searchsorted(table["output"][:], outputs)))
            if "events" in table and "t" in table["events"]:
                events = table["events"]
                _shorten(events, int(np.searchsorted(events["t"][:], t, side="right")))


def _shorten(table: Any, rows: int) -> None:
    for column in table.values():
        if isinstance(column, h5py.Dataset):
            column.resize(min(rows, len(column)), axis=0)
