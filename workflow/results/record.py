# SPDX-License-Identifier: LGPL-3.0-or-later
"""A result folder as arrays: history, footprints and their patches, mesh and displacement."""

import json
import os
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from meshes.arrays import Array
from meshes.tags import NAMES, Tag
from workflow.results.batch import opened
from workflow.scene.scene import Scene, SceneError

if TYPE_CHECKING:
    from workflow.results.patch_nodes import PatchNodes

RAIL = (Tag.RAIL_HEAD, Tag.RAIL_WEB, Tag.RAIL_FOOT)


@dataclass(frozen=True)
class Contact:
    """All footprints of a contact pair.

    Attributes:
        t: Output times, shape ``(k,)`` [s].
        patches: Of each output, by place: 1 the rail top, 2 the gauge corner.
    """

    t: Array
    patches: list[dict[int, "PatchNodes"]]

    def series(self, place: int, quantity: str) -> Array:
        """Return a patch quantity over the outputs, NaN where the patch is not there."""
        found = [p.get(place) for p in self.patches]
        return np.array([np.nan if p is None else getattr(p, quantity) for p in found])

    @property
    def two_points(self) -> npt.NDArray[np.bool_]:
        """Tell for each output whether both patches are there."""
        return np.array([len(p) == 2 for p in self.patches], dtype=bool)


@dataclass(frozen=True)
class Body:
    """The mesh of a run.

    Attributes:
        points: Reference positions, shape ``(n, 3)`` [m].
        cells: Hexahedra, shape ``(c, 8)``.
        regions: Region of each cell, shape ``(c,)``.
        names: Name of each region.
    """

    points: Array
    cells: npt.NDArray[np.int64]
    regions: npt.NDArray[np.int32]
    names: dict[int, str] = field(default_factory=lambda: {t: n for n, t in NAMES.items()})

    @property
    def centres(self) -> Array:
        """Centre of each cell, shape ``(c, 3)`` [m]."""
        return np.asarray(self.points[self.cells].mean(axis=1))

    def part(self, mask: npt.NDArray[np.bool_]) -> "Body":
        """Return the cells of a mask; nodes keep their numbers."""
        return Body(self.points, self.cells[mask], self.regions[mask], self.names)


class Record:
    """The files of a result folder, each read when it is first asked for.

    Attributes:
        modes: Folder of natural modes that were given with it, if any.
    """

    def __init__(self, folder: str | Path, modes: Path | None = None) -> None:
        self.folder, self.modes = Path(folder), modes
        self.scene: dict[str, Any] = tomllib.loads((self.folder / "scene.toml").read_text("utf-8"))

    @cached_property
    def checked(self) -> Scene:
        """The scene as checked models."""
        return Scene.check(self.scene)

    @property
    def wheel_on_rail(self) -> bool:
        """Tell whether this is a wheel on a rail."""
        return bool(self.scene["mesh"]["kind"] == "wheel-on-rail")

    @cached_property
    def history(self) -> dict[str, Array]:
        """Columns of the history by name."""
        with opened(self.folder / "results.h5") as file:
            return {name: data[:] for name, data in file["history"].items()}

    @cached_property
    def contacts(self) -> dict[str, Contact]:
        """Footprints of each pair that touched at all, by name."""
        with opened(self.folder / "results.h5") as file:
            found = {name: _contact(group) for name, group in file["contact"].items()}
        return {name: contact for name, contact in found.items() if any(contact.patches)}

    def patches_at(self, pair: str, output: int) -> dict[int, "PatchNodes"]:
        """Return the patches of a pair at one output by place; the last output is -1."""
        from workflow.results.patch_nodes import patches_of  # a run without contact has none

        with opened(self.folder / "results.h5") as file:
            group = file["contact"].get(pair, {})
            outputs = sorted(group, key=int)
            return patches_of(group[outputs[output]]) if outputs else {}

    @cached_property
    def patches(self) -> dict[str, Array]:
        """Columns of the table of patches of the first pair that touched, a row for each patch."""
        with opened(self.folder / "results.h5") as file:
            table = file.get(f"patches/{next(iter(self.contacts))}", {})  # older folders have none
            return {name: data[:] for name, data in table.items() if name != "events"}

    @cached_property
    def body(self) -> Body | None:
        """The mesh, or None if the run wrote no fields."""
        if not self._fields.exists():
            return None
        with opened(self._fields) as file:
            root = file["VTKHDF"]
            cells = root["Connectivity"][:].reshape(-1, 8)
            region = root["CellData/region"]
            body = Body(root["Points"][:], cells, region[:])
            if "names" not in region.attrs:
                return body
            names = {int(tag): name for tag, name in json.loads(region.attrs["names"]).items()}
            return replace(body, names=names)

    def displacement(self, t: float) -> Array:
        """Return the displacement at the output nearest to time ``t``, shape ``(n, 3)`` [m]."""
        return self._nearest("displacement", t)

    def velocity(self, t: float) -> Array:
        """Return the velocity at the output nearest to time ``t``, shape ``(n, 3)`` [m/s]."""
        return self._nearest("velocity", t)

    def _nearest(self, name: str, t: float) -> Array:
        with opened(self._fields) as file:
            root = file["VTKHDF"]
            n = len(root["Points"])
            if "Steps" not in root or not len(root["Steps/Values"]):
                return np.zeros((n, 3))
            times = root["Steps/Values"][:]
            k = int(np.argmin(np.abs(times - t)))
            return np.asarray(root["PointData"][name][k * n : (k + 1) * n], dtype=np.float64)

    def cells_at_end(self) -> dict[str, Array]:
        """Return the fields of cells at the last output by name, empty where there are none."""
        if not self._fields.exists():
            return {}
        with opened(self._fields) as file:
            root = file["VTKHDF"]
            steps, c = len(root["Steps/Values"]) if "Steps" in root else 0, len(root["Types"])
            names = root["CellData"].keys() - {"region"} if steps else set()
            last = slice((steps - 1) * c, steps * c)
            return {name: root["CellData"][name][last].astype(np.float64) for name in names}

    def series(self, name: str) -> Iterator[tuple[float, Array]]:
        """Yield time and nodal values ``(n, 3)`` of ``displacement`` or ``velocity`` by output."""
        with opened(self._fields) as file:
            root = file["VTKHDF"]
            n = len(root["Points"])
            for k, t in enumerate(root["Steps/Values"][:] if "Steps" in root else ()):
                yield float(t), root["PointData"][name][k * n : (k + 1) * n].astype(np.float64)

    @property
    def _fields(self) -> Path:
        return self.folder / "fields.vtkhdf"


def whole(folder: str | Path, modes: Path | None = None) -> Record:
    """Return the record of a result folder whose files can be read.

    Args:
        folder: Result folder of a run.
        modes: Folder of natural modes that goes with it.

    Raises:
        SceneError: naming the file that is missing or damaged.
    """
    path = Path(folder)
    for name in ("scene.toml", "results.h5"):
        if not os.path.isfile(path / name):  # False for names that no system takes
            raise SceneError(f"folder = {str(path)!r}: expected a result folder with {name}")
    name = "scene.toml"
    try:
        record = Record(path, modes)
        record.checked
        name = "results.h5"
        _check_history(record)
        name = "fields.vtkhdf"
        _check_fields(record)
        name = "summary.json"
        if (path / name).exists() and not isinstance(json.loads((path / name).read_bytes()), dict):
            raise ValueError("no JSON object")
    except (OSError, LookupError, ValueError, TypeError, RuntimeError) as error:
        said = " ".join(str(error).split()).partition(" (")[0]
        raise SceneError(
            f"{str(path / name)!r} cannot be read: {said}; expected it as a run has written it "
            "(--resume takes results.h5 from the checkpoint; without fields.vtkhdf or summary.json "
            "the rest can still be read)"
        ) from None
    return record


def _check_history(record: Record) -> None:
    """Raise an error if columns of the history are of different lengths, or no contact is read."""
    lengths = {name: len(column) for name, column in record.history.items()}
    if len(set(lengths.values())) > 1:
        raise ValueError(f"columns of {sorted(set(lengths.values()))} rows")
    with opened(record.folder / "results.h5") as file:
        file["contact"].keys()


def _check_fields(record: Record) -> None:
    """Raise an error if cells have nodes that are not there, or outputs are missing."""
    body = record.body
    if body is None:
        return
    if body.cells.size and not 0 <= body.cells.min() <= body.cells.max() < len(body.points):
        raise ValueError(f"cells of nodes {body.cells.min()} to {body.cells.max()}")
    if len(body.regions) != len(body.cells):
        raise ValueError(f"{len(body.regions)} regions for {len(body.cells)} cells")
    with opened(record.folder / "fields.vtkhdf") as file:
        root = file["VTKHDF"]
        steps = len(root["Steps/Values"]) if "Steps" in root else 0
        if steps and len(root["PointData/displacement"]) != steps * len(body.points):
            raise ValueError(f"displacements of other than {steps} outputs")


def _contact(group: Any) -> Contact:
    from workflow.results.patch_nodes import patches_of  # a run without contact has none

    outputs = [group[k] for k in sorted(group, key=int)]
    t = np.array([k.attrs["t"] for k in outputs])
    return Contact(t, [patches_of(k) for k in outputs])
