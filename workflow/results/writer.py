# SPDX-License-Identifier: LGPL-3.0-or-later
"""Writer of a result folder: settings, history, contact, fields and summary."""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy.typing as npt
import tomli_w

from meshes.domain import Domain
from workflow.results import atomic, batch
from workflow.results.columns import Item, note, rows
from workflow.results.fields import FieldWriter
from workflow.results.folder import Resume, cut, on_root
from workflow.results.patches import event_rows, patch_rows
from workflow.results.shakedown import yield_in_shear
from workflow.results.table import strict
from workflow.scene import Scene, SceneError

if TYPE_CHECKING:
    from workflow.results.footprints import Touch

UNITS = {
    "t": "s",
    "energy": "J",
    "force": "N",
    "penetration": "m",
    "area": "m^2",
    "error": "1",
    "strain": "1",
}


class Results:
    """Writes the results of a run as it goes; all methods are collective, rank 0 writes.

    Attributes:
        outputs: Number of outputs written.
        trackers: What follows the patches of each pair, on rank 0.
        lost: What could not be kept of a run that is resumed, for the log.
    """

    def __init__(
        self, folder: Path, scene: Scene, domain: Domain, resume: Resume | None = None
    ) -> None:
        """Begin a result folder, or go on with the one of a checkpoint.

        Raises:
            SceneError: if it cannot be written.
        """
        self.folder, self.domain, self.comm = folder, domain, (comm := domain.msh.comm)
        self.outputs = 0
        self.trackers: dict[str, Any] = {}
        self.batch: batch.Batch | None = None  # these two on rank 0 only
        self.fields: FieldWriter | None = None
        self.write_fields = scene.output.fields
        self.lost: list[str] = []
        self._kept: set[str] = set()  # pairs whose surfaces are in the file
        self._tables: dict[str, set[str]] = {}  # columns that those of a resumed run began with
        try:
            on_root(comm, folder, lambda: self._open(scene, resume), begun=resume is not None)
        except RuntimeError as error:
            if resume is None:
                self._remove()
            raise SceneError(f"out = {str(folder)!r}: {error}") from None
        self.outputs = resume.outputs if resume else 0
        self.k = yield_in_shear(scene)

    def _open(self, scene: Scene, resume: Resume | None) -> None:
        self.folder.mkdir(parents=True, exist_ok=True)
        settings = tomli_w.dumps(scene.tables()).encode()
        fields = self.folder / "fields.vtkhdf"
        if resume is None:
            for path in (self.folder / "results.h5", fields):
                batch.drop(path)
            with h5py.File(self.folder / "results.h5", "w", locking=False) as file:
                file.attrs["scene"] = scene.name
                for name in ("history", "contact", "patches"):
                    file.create_group(name)
        else:
            self.trackers = dict(resume.trackers)
            self.lost = cut(self.folder, resume)
            self._tables = tables_of(self.folder / "results.h5")
        atomic.replace(self.folder / "scene.toml", settings)  # from now on it holds a run
        self.batch = batch.Batch(self.folder / "results.h5")
        if self.write_fields:
            t = resume.t if resume else None
            self.fields = FieldWriter(fields, self.domain.source, resume_at=t)

    def _remove(self) -> None:
        """Leave nothing of a run that could not begin."""
        if self.comm.rank == 0:
            for name in ("scene.toml", "results.h5", "fields.vtkhdf"):
                (self.folder / name).unlink(missing_ok=True)

    def append(
        self,
        history: Mapping[str, float],
        contacts: Mapping[str, "Touch"],
    ) -> None:
        """Add one output; it may wait to be written with later ones.

        Args:
            history: A row of the history.
            contacts: The contact of each pair.

        Raises:
            RuntimeError: if it cannot be written; the file is then as it was.
        """

        def record() -> Iterator[Item]:
            for name, value in history.items():
                yield rows(f"history/{name}", [float(value)], unit(name))
            for name, contact in contacts.items():
                yield from self._contact(name, history["t"], contact)

        self.add(record)
        self.outputs += 1

    def _contact(self, name: str, t: float, contact: "Touch") -> Iterator[Item]:
        """Yield nodes, facets, patches and events of one pair; patches keep their number."""
        from contact.patches import Tracker
        from workflow.results import footprints  # a run without contact has none

        tracker, foot = self.trackers.setdefault(name, Tracker()), contact.foot
        identity, events = tracker.follow(t, foot)
        group = f"contact/{name}/{self.outputs}"
        yield note(group, t=t)
        yield from footprints.items(group, contact, identity)
        if contact.sides and name not in self._kept:
            self._kept.add(name)
            yield from footprints.surface_items(name, contact.sides)
        table, motion = f"patches/{name}", contact.motion
        yield from patch_rows(table, self.outputs, t, foot, identity, motion, self.k)
        yield from event_rows(f"patches/{name}/events", events)

    def add(self, record: Callable[[], Iterable[Item]]) -> None:
        """Add what ``record`` returns on rank 0 to ``results.h5``, all of it or nothing.

        Raises:
            RuntimeError: if it cannot be written; the file is then as it was.
        """

        def work() -> None:
            if self.batch is not None:
                self.batch.add([item for item in record() if self._fits(item)])

        on_root(self.comm, self.folder, work)

    def _fits(self, item: Item) -> bool:
        """Tell whether to write: tables that an older squealx has begun get no new columns."""
        table, _, column = item.name.rpartition("/")
        return table not in self._tables or column in self._tables[table]

    def append_fields(
        self,
        t: float,
        u: npt.NDArray[Any],
        v: npt.NDArray[Any],
        cells: Mapping[str, Callable[[], npt.NDArray[Any]]] | None = None,
    ) -> None:
        """Add the fields of the whole mesh; they may wait too. Collective.

        Args:
            t: Time [s].
            u: Displacement, a local array [m].
            v: Velocity, a local array [m/s].
            cells: What returns the values of all cells on rank 0, by name; collective.
        """
        if self.write_fields:
            displacement, velocity = self.domain.gather(u), self.domain.gather(v)
            values = {name: gather() for name, gather in (cells or {}).items()}
            fields = self.fields

            def write() -> None:
                if fields is not None:
                    fields.append(t, displacement, velocity, values, wait=True)

            on_root(self.comm, self.folder, write)

    def flush(self) -> None:
        """Write all that waits.

        Raises:
            RuntimeError: if it cannot be written; what waits is kept beside the files.
        """
        on_root(self.comm, self.folder, self.settle)

    def settle(self) -> None:
        """Write all that waits, on rank 0.

        Raises:
            OSError: if it cannot be written.
        """
        for file in (self.batch, self.fields):
            if file is not None:
                file.flush()

    def summarise(self, summary: Mapping[str, Any]) -> None:
        """Write ``summary.json``."""
        on_root(self.comm, self.folder, lambda: write_summary(self.folder, summary))


def write_summary(folder: Path, summary: Mapping[str, Any]) -> None:
    """Write ``summary.json``; on one rank."""
    text = json.dumps(strict(summary), indent=2, default=float) + "\n"
    atomic.replace(folder / "summary.json", text.encode())


def tables_of(path: Path) -> dict[str, set[str]]:
    """Return the columns of history and patches that have rows, by table."""
    with h5py.File(path, "r", locking=False) as file:
        tables = {"history": file["history"]}
        tables |= {f"patches/{pair}": table for pair, table in file.get("patches", {}).items()}
        return {name: set(table) for name, table in tables.items() if len(table.get("t", ()))}


def unit(name: str) -> str:
    """Return the unit of a history column, from the last word of its name."""
    words = name.split("/")[-1].split("_")
    return next((UNITS[w] for w in reversed(words) if w in UNITS), "J")
