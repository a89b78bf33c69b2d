# SPDX-License-Identifier: LGPL-3.0-or-later
"""The result folder of a run: settings, history, contact, fields and summary."""

import json
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

import h5py
import numpy as np
import numpy.typing as npt
import tomli_w

from meshes.domain import Domain
from workflow.results import atomic
from workflow.results.fields import FieldWriter
from workflow.results.patches import append_events, append_patches
from workflow.scene.scene import Scene, SceneError

if TYPE_CHECKING:
    from workflow.simulation.checkpoint import Checkpoint
    from workflow.simulation.sampling import Sampling

UNITS = {"t": "s", "energy": "J", "force": "N", "penetration": "m", "area": "m^2", "error": "1"}


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


class Results:
    """Writes the results of a run as it goes; all methods are collective, rank 0 writes.

    Attributes:
        outputs: Number of outputs written.
        trackers: What follows the patches of each pair, on rank 0.
        lost: What could not be kept of a run that is resumed, for the log.
    """

    def __init__(
        self, folder: Path, scene: Scene, domain: Domain, point: "Checkpoint | None" = None
    ) -> None:
        """Begin a result folder, or go on with the one of a checkpoint.

        Raises:
            SceneError: if it cannot be written.
        """
        self.folder, self.domain, self.comm = folder, domain, domain.msh.comm
        self.outputs = 0
        self.trackers: dict[str, Any] = {}
        self.fields: FieldWriter | None = None
        self.write_fields = scene.output.fields
        self.lost: list[str] = []
        try:
            on_root(self.comm, folder, lambda: self._open(scene, point))
        except RuntimeError as error:
            raise SceneError(f"out = {str(folder)!r}: {error}") from None
        self.outputs = point.about["outputs"] if point else 0

    def _open(self, scene: Scene, point: "Checkpoint | None") -> None:
        self.folder.mkdir(parents=True, exist_ok=True)
        settings = tomli_w.dumps(scene.tables()).encode()
        fields, t = self.folder / "fields.vtkhdf", None
        if point is None:
            for path in (self.folder / "results.h5", fields):
                atomic.journal_of(path).unlink(missing_ok=True)
            with h5py.File(self.folder / "results.h5", "w", locking=False) as file:
                file.attrs["scene"] = scene.name
                for name in ("history", "contact", "patches"):
                    file.create_group(name)
        else:
            from workflow.results import folder

            t = float(point.arrays["time"][0])
            self.trackers = folder.trackers(point)
            self.lost = folder.cut(self.folder, point.about["outputs"], t, folder.samples(point))
        atomic.replace(self.folder / "scene.toml", settings)  # from now on it holds a run
        if self.write_fields:
            self.fields = FieldWriter(fields, self.domain.source, resume_at=t)

    def append(
        self,
        history: Mapping[str, float],
        footprints: Mapping[str, Any],
        motions: Mapping[str, Any],
    ) -> None:
        """Add one output.

        Args:
            history: A row of the history.
            footprints: The footprint of each contact pair.
            motions: The creepage at each patch of each footprint.

        Raises:
            RuntimeError: if it cannot be written; the file is then as it was.
        """

        def write() -> None:
            with atomic.changing(self.folder / "results.h5") as file:
                for name, value in history.items():
                    _append(file["history"], name, value)
                for name, footprint in footprints.items():
                    self._append_contact(file, name, history["t"], footprint, motions[name])

        on_root(self.comm, self.folder, write)
        self.outputs += 1

    def _append_contact(
        self, file: Any, name: str, t: float, footprint: Any, motion: Sequence[Any]
    ) -> None:
        """Add nodes, patches and events of one pair; patches keep their number."""
        from contact.patches import Tracker

        tracker = self.trackers.setdefault(name, Tracker())
        identity, events = tracker.follow(t, footprint)
        group = file.require_group(f"contact/{name}/{self.outputs}")
        group.attrs["t"] = t
        arrays = contact_arrays(footprint) | {"patch": identity[footprint.patch]}
        for key, array in arrays.items():
            data = group.create_dataset(key, data=array)
            data.attrs["units"] = CONTACT_UNITS[key]
        table = file.require_group(f"patches/{name}")
        append_patches(table, self.outputs, t, footprint, identity, motion)
        append_events(table.require_group("events"), events)

    def append_samples(self, sampling: "Sampling | None") -> None:
        """Add what was sampled since the last time, if a run samples at all."""
        if sampling is None:
            return
        from workflow.results import samples

        arrays = sampling.take()
        if not self.comm.bcast(len(arrays["t"])):
            return

        def write() -> None:
            with atomic.changing(self.folder / "results.h5") as file:
                samples.append(file, sampling, arrays)

        on_root(self.comm, self.folder, write)

    def append_fields(self, t: float, u: npt.NDArray[Any], v: npt.NDArray[Any]) -> None:
        """Add displacement and velocity (local arrays) of the whole mesh."""
        if self.write_fields:
            displacement, velocity = self.domain.gather(u), self.domain.gather(v)
            fields = self.fields

            def write() -> None:
                if fields is not None:
                    fields.append(t, displacement, velocity)

            on_root(self.comm, self.folder, write)

    def summarise(self, summary: Mapping[str, Any]) -> None:
        """Write ``summary.json``."""
        text = json.dumps(strict(summary), indent=2, default=float) + "\n"
        path = self.folder / "summary.json"
        on_root(self.comm, self.folder, lambda: atomic.replace(path, text.encode()))


def strict(value: Any) -> Any:
    """Return the value with ``None`` for every number that JSON cannot hold (NaN, infinity)."""
    if isinstance(value, Mapping):
        return {key: strict(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [strict(entry) for entry in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value


CONTACT_UNITS = {
    "node": "1",
    "position": "m",
    "normal": "1",
    "normal_force": "N",
    "tangential_force": "N",
    "area": "m^2",
    "slip_velocity": "m/s",
    "stick": "1",
    "patch": "1",
    "friction": "1",
}


def contact_arrays(footprint: Any) -> dict[str, npt.NDArray[Any]]:
    """Return the per-node arrays of a footprint by name."""
    return {
        key: np.asarray(getattr(footprint, key)) for key in CONTACT_UNITS if hasattr(footprint, key)
    }


def _append(group: Any, name: str, value: float) -> None:
    if name not in group:
        data = group.create_dataset(name, shape=(0,), maxshape=(None,), dtype="f8", chunks=(1024,))
        data.attrs["units"] = unit(name)
    data = group[name]
    data.resize(len(data) + 1, axis=0)
    data[-1] = value


def unit(name: str) -> str:
    """Return the unit of a history column, from the last word of its name."""
    words = name.split("/")[-1].split("_")
    return next((UNITS[w] for w in reversed(words) if w in UNITS), "J")
