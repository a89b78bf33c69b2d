# SPDX-License-Identifier: LGPL-3.0-or-later
"""Results of a run in Python: its folder, summary and history."""

import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy.typing as npt

from workflow.results.batch import opened

if TYPE_CHECKING:
    from workflow.results.record import Record


class Columns(dict[str, npt.NDArray[Any]]):
    """Columns of a table by name, a row for each output, patch or node.

    Attributes:
        units: Unit of each column.
    """

    def __init__(self, table: Any) -> None:
        """Read the datasets of an HDF5 group, but not its groups."""
        columns = {name: data for name, data in table.items() if hasattr(data, "dtype")}
        super().__init__({name: data[:] for name, data in columns.items()})
        self.units = {name: str(data.attrs.get("units", "")) for name, data in columns.items()}

    def flat(self) -> dict[str, npt.NDArray[Any]]:
        """Return columns of one value a row: vectors as ``NAME_0``, ``NAME_1``; bytes as text."""
        found: dict[str, npt.NDArray[Any]] = {}
        for name, array in self.items():
            if array.ndim > 1:
                found |= {f"{name}_{k}": array[:, k] for k in range(array.shape[1])}
            else:
                found[name] = array.astype(str) if array.dtype.kind == "S" else array
        return found

    def to_pandas(self) -> Any:
        """Return the flat columns as ``pandas.DataFrame``, the units as its ``attrs["units"]``.

        ``.set_index("t").to_xarray()`` makes an ``xarray.Dataset`` of it.

        Raises:
            ModuleNotFoundError: if pandas is not installed; squealx does not bring it.
        """
        try:
            import pandas as pd
        except ModuleNotFoundError as error:
            raise ModuleNotFoundError(
                "to_pandas: expected pandas, which squealx does not bring: pip install pandas; "
                "flat() has the same columns as arrays"
            ) from error
        frame = pd.DataFrame(self.flat())
        frame.attrs["units"] = self.units
        return frame


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
    def history(self) -> Columns:
        """Columns of ``/history`` in ``results.h5``, a row for each output."""
        return self._table("history")

    def patches(self, pair: str) -> Columns:
        """Return the patches of a contact pair, a row for each patch and output.

        Raises:
            KeyError: if the pair has had none.
        """
        return self._table(f"patches/{pair}")

    def events(self, pair: str) -> Columns:
        """Return births, ends, splits and merges of the patches of a pair.

        Raises:
            KeyError: if the pair has had none.
        """
        return self._table(f"patches/{pair}/events")

    def footprint(self, pair: str, output: int) -> Columns:
        """Return the nodes of the contactor that bear forces at an output, a row for each.

        Raises:
            KeyError: if there is no such output.
        """
        return self._table(f"contact/{pair}/{output}")

    def _table(self, name: str) -> Columns:
        with opened(self.folder / "results.h5") as file:
            if name not in file:
                group, _, last = name.rpartition("/")
                there = sorted(file.get(group, {}))
                raise KeyError(f"{self.folder}: no {last!r} in {group or '/'}, which has {there}")
            return Columns(file[name])

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
