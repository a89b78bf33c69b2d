# SPDX-License-Identifier: LGPL-3.0-or-later
"""Samples in ``results.h5``: written as they come, cut at a checkpoint, read back.

``/probes`` holds ``t`` (middle of each window), ``motion/NAME`` of each probe, and for each pair
``contact/PAIR/normal_force`` and ``tangential_force`` on the contactor; ``contact/PAIR/nodal`` has
the same by node: ``count`` nodes for each sample, their numbers and forces one behind the other,
and ``contact/PAIR/surface`` the nodes of the contactor with their reference positions.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from meshes.arrays import Array
from workflow.results.batch import opened

UNITS = {"displacement": "m", "velocity": "m/s", "acceleration": "m/s^2"}


@dataclass(frozen=True)
class PairSamples:
    """Forces on the contactor of one pair, in the axes of the track.

    Attributes:
        normal, tangential: Totals, shape ``(k, 3)`` [N].
        start: First row of each sample among the nodes, and their number, shape ``(k + 1,)``.
        node: Mesh nodes, shape ``(m,)``.
        normal_forces, tangential_forces: Their normal and tangential forces, shape ``(m, 3)`` [N].
        body: Body of the contactor.
        surface: Its mesh nodes, ascending, shape ``(nc,)``.
        places: Their reference positions, shape ``(nc, 3)`` [m].
    """

    normal: Array
    tangential: Array
    start: npt.NDArray[np.int64]
    node: npt.NDArray[np.int64]
    normal_forces: Array
    tangential_forces: Array
    body: str
    surface: npt.NDArray[np.int64]
    places: Array

    def reference(self, nodes: npt.NDArray[np.int64]) -> Array:
        """Return the reference positions of mesh nodes of the contactor, shape ``(k, 3)`` [m]."""
        return np.asarray(self.places[np.searchsorted(self.surface, nodes)])

    @property
    def sample(self) -> npt.NDArray[np.int64]:
        """The sample of each row of nodes, shape ``(m,)``."""
        return np.repeat(np.arange(len(self.start) - 1), np.diff(self.start))


@dataclass(frozen=True)
class Samples:
    """What was sampled of a run.

    Attributes:
        t: Middle of each window, shape ``(k,)`` [s].
        interval: Length of a window [s].
        motion: Of each probe, shape ``(k, 3)``, in the unit of its quantity.
        quantity: Of each probe.
        place: Reference position of each probe, shape ``(3,)`` [m].
        body: Body of each probe.
        pairs: Contact pairs by name.
        spin: Angular velocity of the wheelset, shape ``(3,)`` [rad/s]; zero without rolling.
        centre: Its centre at the start, shape ``(3,)`` [m].
    """

    t: Array
    interval: float
    motion: dict[str, Array]
    quantity: dict[str, str]
    place: dict[str, Array]
    body: dict[str, str]
    pairs: dict[str, PairSamples]
    spin: Array
    centre: Array


def cut(file: Any, rows: int) -> None:
    """Keep the first ``rows`` samples of an open results file.

    Raises:
        ValueError: if there are fewer.
    """
    root = file.get("probes")
    if root is None and rows == 0:
        return
    if root is None or len(root["t"]) < rows:
        raise ValueError(f"probes: expected {rows} samples")
    columns = [root["t"], *root.get("motion", {}).values()]
    for group in root.get("contact", {}).values():
        nodes = int(group["nodal/count"][:rows].sum())
        columns += [group[k] for k in ("normal_force", "tangential_force", "nodal/count")]
        for key in ("node", "normal_force", "tangential_force"):
            group[f"nodal/{key}"].resize(nodes, axis=0)
    for column in columns:
        column.resize(rows, axis=0)


def read(folder: Path) -> Samples | None:
    """Return the samples of a result folder, or None if it has none."""
    with opened(folder / "results.h5") as file:
        root = file.get("probes")
        if root is None or not len(root["t"]):
            return None
        motion = dict(root.get("motion", {}))
        return Samples(
            t=root["t"][:],
            interval=float(root.attrs["interval"]),
            motion={name: data[:] for name, data in motion.items()},
            quantity={name: str(data.attrs["quantity"]) for name, data in motion.items()},
            place={name: np.asarray(data.attrs["place"]) for name, data in motion.items()},
            body={name: str(data.attrs["body"]) for name, data in motion.items()},
            pairs={name: _pair(group) for name, group in root.get("contact", {}).items()},
            spin=np.asarray(root.attrs.get("spin", np.zeros(3))),
            centre=np.asarray(root.attrs.get("centre", np.zeros(3))),
        )


def _pair(group: Any) -> PairSamples:
    nodal = group["nodal"]
    return PairSamples(
        normal=group["normal_force"][:],
        tangential=group["tangential_force"][:],
        start=np.concatenate([[0], np.cumsum(nodal["count"][:])]),
        node=nodal["node"][:].astype(np.int64),
        normal_forces=nodal["normal_force"][:].astype(np.float64),
        tangential_forces=nodal["tangential_force"][:].astype(np.float64),
        body=str(group.attrs["body"]),
        surface=group["surface/node"][:].astype(np.int64),
        places=group["surface/place"][:],
    )
