# SPDX-License-Identifier: LGPL-3.0-or-later
"""``fields.vtkhdf``: displacement and velocity of the whole mesh over time, for ParaView.

The file is a temporal VTKHDF UnstructuredGrid written with h5py: ``dolfinx.io.vtkhdf`` holds one
unnamed point field only.
"""

import json
from pathlib import Path

import h5py
import numpy as np
import numpy.typing as npt

from meshes.hexmesh import HexMesh
from workflow.results.atomic import changing
from workflow.results.columns import create

FIELDS = ("displacement", "velocity")
HEXAHEDRON = 12  # VTK cell type
CHUNK = 65536  # most rows written at once
ROWS = 512  # steps that are stored together


class FieldWriter:
    """Appends the fields of one output at a time; made and used on rank 0 only.

    The file is closed between outputs and never locked, so it can be read, and copied, while the
    run goes on. The number of steps is raised last: a reader does not see half an output.

    Attributes:
        path: The file.
        nodes: Number of nodes n of the mesh.
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
        if resume_at is None or not self.path.exists():
            with h5py.File(self.path, "w", locking=False) as file:
                write_mesh(file.create_group("VTKHDF"), source)
        else:
            self._cut(resume_at)

    def append(
        self,
        t: float,
        displacement: npt.NDArray[np.floating],
        velocity: npt.NDArray[np.floating],
    ) -> None:
        """Add one output.

        Args:
            t: Time, later than the last output [s].
            displacement: Of each HexMesh node, shape ``(n, 3)`` [m].
            velocity: Of each HexMesh node, shape ``(n, 3)`` [m/s].

        Raises:
            ValueError: if a field has another shape or ``t`` is not later.
        """
        values = dict(zip(FIELDS, (displacement, velocity), strict=True))
        for name, array in values.items():
            if np.shape(array) != (self.nodes, 3):
                raise ValueError(f"{name}: expected {(self.nodes, 3)}, got {np.shape(array)}")
        with changing(self.path) as file:
            root = file["VTKHDF"]
            if "Steps" not in root:  # not before: VTK refuses a file with steps but none written
                _open_steps(root, self.nodes)
            k = int(root["Steps"].attrs["NSteps"])
            last = root["Steps/Values"][k - 1] if k else -np.inf
            if not t > last:
                raise ValueError(f"t: expected later than the last output at {last} s, got {t} s")
            _resize(root, k + 1, self.nodes)
            for name, array in values.items():
                root["PointData"][name][k * self.nodes :] = array
                root["Steps/PointDataOffsets"][name][k] = k * self.nodes
            root["Steps/Values"][k] = t
            root["Steps/NumberOfParts"][k] = 1
            root["Steps"].attrs["NSteps"] = k + 1

    def _cut(self, t: float) -> None:
        """Drop the outputs after ``t`` [s] from the file."""
        with changing(self.path) as file:
            root = file["VTKHDF"]
            if len(root["Points"]) != self.nodes:
                raise ValueError(
                    f"{self.path}: expected {self.nodes} nodes, got {len(root['Points'])}"
                )
            if "Steps" in root:
                k = int(np.searchsorted(root["Steps/Values"], t, side="right"))
                root["Steps"].attrs["NSteps"] = k
                _resize(root, k, self.nodes)


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


def _open_steps(root: h5py.Group, nodes: int) -> None:
    """Make the empty, growing datasets of the time steps."""
    steps = root.create_group("Steps")
    steps.attrs["NSteps"] = 0
    create(root, "Steps/Values", (), np.float64, ROWS)
    # where each step starts in the static mesh: always at zero, the fill value
    for name in ("PartOffsets", "NumberOfParts", "PointOffsets", "CellDataOffsets/region"):
        create(root, f"Steps/{name}", (), np.int64, ROWS)
    for name in ("CellOffsets", "ConnectivityIdOffsets"):
        create(root, f"Steps/{name}", (1,), np.int64, ROWS)
    for name in FIELDS:
        create(root, f"PointData/{name}", (3,), np.float32, min(nodes, CHUNK))
        create(root, f"Steps/PointDataOffsets/{name}", (), np.int64, ROWS)


def _resize(root: h5py.Group, steps: int, nodes: int) -> None:
    """Give every growing dataset the length for ``steps`` time steps."""
    for name in FIELDS:
        root["PointData"][name].resize(steps * nodes, axis=0)
    root["Steps"].visititems(
        lambda _, item: item.resize(steps, axis=0) if isinstance(item, h5py.Dataset) else None
    )
