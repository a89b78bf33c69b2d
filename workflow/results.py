# SPDX-License-Identifier: LGPL-3.0-or-later
"""The result folder of a run: settings, history, contact, fields and summary."""

import json
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import numpy.typing as npt
import tomli_w

from meshes.domain import Domain
from workflow.fields import FieldWriter
from workflow.patch_table import append_events, append_patches
from workflow.scene import Scene, SceneError

UNITS = {"t": "s", "energy": "J", "force": "N", "penetration": "m", "area": "m^2", "error": "1"}


def check_free(folder: str | Path) -> Path:
    """Return the folder of a new run without touching it.

    Raises:
        SceneError: if it holds a run already or cannot be made or written.
    """
    path = Path(folder)
    if (path / "scene.toml").exists() or (path / "summary.json").exists():
        raise SceneError(f"out = {str(path)!r}: already holds a run; expected a new folder")
    there = next(p for p in (path, *path.absolute().parents) if p.exists())
    try:
        tempfile.TemporaryDirectory(dir=there).cleanup()  # permissions alone do not tell
    except OSError as error:
        raise SceneError(
            f"out = {str(path)!r}: expected a folder that can be written ({error.strerror})"
        ) from None
    return path


class Results:
    """Writes the results of a run as it goes; all methods are collective, rank 0 writes."""

    def __init__(self, folder: Path, scene: Scene, domain: Domain) -> None:
        self.folder, self.domain, self.comm = folder, domain, domain.msh.comm
        self.outputs = 0
        self.trackers: dict[str, Any] = {}
        self.fields: FieldWriter | None = None
        if self.comm.rank == 0:
            folder.mkdir(parents=True, exist_ok=True)
            (folder / "scene.toml").write_text(tomli_w.dumps(scene.tables()), "utf-8")
            with h5py.File(folder / "results.h5", "w", locking=False) as file:
                file.attrs["scene"] = scene.name
                file.create_group("history")
                file.create_group("contact")
                file.create_group("patches")
            if scene.output.fields:
                self.fields = FieldWriter(folder / "fields.vtkhdf", domain.source)
        self.write_fields = scene.output.fields

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
        """
        if self.comm.rank == 0:
            with h5py.File(self.folder / "results.h5", "r+", locking=False) as file:
                for name, value in history.items():
                    _append(file["history"], name, value)
                for name, footprint in footprints.items():
                    self._append_contact(file, name, history["t"], footprint, motions[name])
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

    def append_fields(self, t: float, u: npt.NDArray[Any], v: npt.NDArray[Any]) -> None:
        """Add displacement and velocity (local arrays) of the whole mesh."""
        if self.write_fields:
            displacement, velocity = gather(self.domain, u), gather(self.domain, v)
            if self.fields is not None:
                self.fields.append(t, displacement, velocity)

    def summarise(self, summary: Mapping[str, Any]) -> None:
        """Write ``summary.json``."""
        if self.comm.rank == 0:
            text = json.dumps(strict(summary), indent=2, default=float)
            (self.folder / "summary.json").write_text(text + "\n", "utf-8")


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


def gather(domain: Domain, local: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
    """Return a local vector field in mesh node order on rank 0, shape ``(n, 3)``."""
    own = local.reshape(-1, 3)[: domain.owned]
    parts = domain.msh.comm.gather((domain.nodes[: domain.owned], own))
    out = np.zeros((len(domain.source.points) if parts else 0, 3))
    for nodes, values in parts or ():
        out[nodes] = values
    return out


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
