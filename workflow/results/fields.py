# SPDX-License-Identifier: LGPL-3.0-or-later
"""``fields.vtkhdf``: displacement and velocity of the whole mesh over time, for ParaView.

Cells that may yield have plastic strain, von Mises' stress and, if asked for, stress and back
stress.

The file is a temporal VTKHDF UnstructuredGrid written with h5py: ``dolfinx.io.vtkhdf`` holds one
unnamed point field only.
"""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import numpy.typing as npt

from meshes.hexmesh import HexMesh
from workflow.results.atomic import changing
from workflow.results.batch import Batch
from workflow.results.columns import Item, note

FIELDS = ("displacement", "velocity")
HEXAHEDRON = 12  # VTK cell type
CHUNK = 65536  # most rows written at once
ROWS = 512  # steps that are stored together


class FieldWriter:
    """Appends the fields of one output at a time; made and used on rank 0 only.

    The file is closed between outputs and never locked, so it can be read, and copied, while the
    run goes on. An output is there whole or not at all.

    Attributes:
        path: The file.
        nodes: Number of nodes n of the mesh.
        steps: Number of outputs.
        last: Time of the last one [s].
    """

    def __init__(
        self, path: str | Path, source: HexMesh, *, resume_at: float | None = None
    ) -> None:
        """Write the mesh to ``path``, or go on with the file that is there.

        Args:
            path: File to write; an old one is replaced unless ``resume_at`` is given.
            source: Mesh, its node order is the one of the fields.
            resume_at: Time up to which the outputs of an existing file are kept [s].

        Raises:
            ValueError: if the file to go on with holds another mesh.
        """
        self.path = Path(path)
        self.nodes = len(source.points)
        self.steps, self.last = 0, -np.inf
        if resume_at is None or not self.path.exists():
            with h5py.File(self.path, "w", locking=False) as file:
                write_mesh(file.create_group("VTKHDF"), source)
        else:
            self._cut(resume_at)
        self.batch = Batch(self.path)

    def append(
        self,
        t: float,
        displacement: npt.NDArray[np.floating],
        velocity: npt.NDArray[np.floating],
        cells: Mapping[str, npt.NDArray[np.floating]] | None = None,
        *,
        wait: bool = False,
    ) -> None:
        """Add one output.

        Args:
            t: Time, later than the last output [s].
            displacement: Of each HexMesh node, shape ``(n, 3)`` [m].
            velocity: Of each HexMesh node, shape ``(n, 3)`` [m/s].
            cells: Values of each HexMesh cell by name, the same names at every output.
            wait: It may be written with later ones, see :mod:`workflow.results.batch`.

        Raises:
            ValueError: if a field has another shape or ``t`` is not later.
        """
        values = dict(zip(FIELDS, (displacement, velocity), strict=True))
        for name, array in values.items():
            if np.shape(array) != (self.nodes, 3):
                raise ValueError(f"{name}: expected {(self.nodes, 3)}, got {np.shape(array)}")
        if not t > self.last:
            raise ValueError(f"t: expected later than the last output at {self.last} s, got {t} s")
        self.batch.add(list(self._step(t, values, cells or {})))
        self.last, self.steps = t, self.steps + 1
        if not wait:
            self.flush()

    def flush(self) -> None:
        """Write the outputs that wait.

        Raises:
            OSError: if there is no room; the file is then as it was.
        """
        self.batch.flush()

    def _step(
        self,
        t: float,
        values: Mapping[str, npt.NDArray[np.floating]],
        cells: Mapping[str, npt.NDArray[np.floating]],
    ) -> Iterator[Item]:
        """Yield what makes an output; columns are made with the first.

        Not before: VTK refuses a file with steps but none written.
        """
        for name, array in values.items():
            data = np.asarray(array, dtype=np.float32)
            yield _column(f"PointData/{name}", data, min(self.nodes, CHUNK))
            yield _column(f"Steps/PointDataOffsets/{name}", np.array([self.steps * self.nodes]))
        for name, array in cells.items():
            data = np.asarray(array, dtype=np.float32)
            yield _column(f"CellData/{name}", data, min(len(data), CHUNK))
            yield _column(f"Steps/CellDataOffsets/{name}", np.array([self.steps * len(data)]))
        yield _column("Steps/Values", np.array([t], dtype=np.float64))
        yield _column("Steps/NumberOfParts", np.ones(1, dtype=np.int64))
        # where the step starts in the static mesh
        for name in ("PartOffsets", "PointOffsets", "CellDataOffsets/region"):
            yield _column(f"Steps/{name}", np.zeros(1, dtype=np.int64))
        for name in ("CellOffsets", "ConnectivityIdOffsets"):
            yield _column(f"Steps/{name}", np.zeros((1, 1), dtype=np.int64))
        yield note("VTKHDF/Steps", NSteps=self.steps + 1)

    def _cut(self, t: float) -> None:
        """Drop the outputs after ``t`` [s] from the file."""
        with changing(self.path) as file:
            root = file["VTKHDF"]
            if len(root["Points"]) != self.nodes:
                raise ValueError(
                    f"{self.path}: expected {self.nodes} nodes, got {len(root['Points'])}"
                )
            if "Steps" in root:
                times = root["Steps/Values"][:]
                self.steps = k = int(np.searchsorted(times, t, side="right"))
                self.last = float(times[k - 1]) if k else -np.inf
                root["Steps"].attrs["NSteps"] = k
                _resize(root, k, self.nodes, len(root["Types"]))


def write_mesh(root: h5py.Group, mesh: HexMesh) -> None:
    """Write the mesh as the one static part of a VTKHDF UnstructuredGrid."""
    root.attrs["Version"] = np.array([2, 2])
    # VTK wants a string of fixed length
    root.attrs["Type"] = np.bytes_("UnstructuredGrid")
    root["Points"] = mesh.points
    root["Connectivity"] = mesh.cells.ravel()
    root["Offsets"] = 8 * np.arange(len(mesh.cells) + 1)
    root["Types"] = np.full(len(mesh.cells), HEXAHEDRON, dtype=np.uint8)
    root["NumberOfPoints"] = np.array([len(mesh.points)])
    root["NumberOfCells"] = np.array([len(mesh.cells)])
    root["NumberOfConnectivityIds"] = np.array([mesh.cells.size])
    root["CellData/region"] = mesh.regions
    names = {int(tag): mesh.name(int(tag)) for tag in np.unique(mesh.regions)}
    root["CellData/region"].attrs["names"] = json.dumps(names)


def _column(name: str, values: npt.NDArray[Any], chunk: int = ROWS) -> Item:
    return Item(f"VTKHDF/{name}", values, {}, chunk)


def _resize(root: h5py.Group, steps: int, nodes: int, cells: int) -> None:
    """Give every growing dataset the length for ``steps`` time steps."""
    for name in FIELDS:
        root["PointData"][name].resize(steps * nodes, axis=0)
    for name in root["CellData"].keys() - {"region"}:
        root["CellData"][name].resize(steps * cells, axis=0)
    root["Steps"].visititems(
        lambda _, item: item.resize(steps, axis=0) if isinstance(item, h5py.Dataset) else None
    )
