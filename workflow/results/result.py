# SPDX-License-Identifier: LGPL-3.0-or-later
"""Results of a run in Python: its folder, summary and history."""

import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from workflow.results.batch import opened

if TYPE_CHECKING:
    from workflow.results.record import Record


@dataclass
class Result:
    """A finished (or stopped) run.

    Attributes:
        folder: Where its results are.
        summary: The contents of ``summary.json``.
    """

    folder: Path
    summary: dict[str, Any]

    @property
    def history(self) -> dict[str, npt.NDArray[np.float64]]:
        """Columns of ``/history`` in ``results.h5``."""
        with opened(self.folder / "results.h5") as file:
            return {name: data[:] for name, data in file["history"].items()}

    @cached_property
    def record(self) -> "Record":
        """Footprints, patches, mesh and displacements, each read when it is first asked for."""
        from workflow.results.record import Record  # a run without contact does not need it

        return Record(self.folder)


def read_run(folder: str | Path) -> Result:
    """Return the results in a folder; of a run that is going on, what it has written so far.

    Raises:
        FileNotFoundError: if it holds no run.
    """
    path = Path(folder)
    if not (path / "scene.toml").exists():
        raise FileNotFoundError(f"{path}: expected the result folder of a run, found no scene.toml")
    summary = path / "summary.json"
    return Result(path, json.loads(summary.read_text("utf-8")) if summary.exists() else {})
