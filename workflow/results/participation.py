# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Modal participation: sampled contact forces projected on the natural modes of a wheel or body.

With mass-normalised modes φ (``φᵀ M φ = 1``) the modal coordinates obey ``q̈ + ω² q = Q`` with the
generalised force :math:`Q(t) = \sum_i φ(X_i) \cdot R(t)^T F_i(t)` over the nodes in contact: each
nodal force, turned back into the axes of the wheel, meets the mode where the node sits in the
material, which goes round the wheel as it rolls (S. S. Rao, Mechanical Vibrations, 5th ed., sec.
6.13; R. R. Craig & A. J. Kurdila, Fundamentals of Structural Dynamics, 2nd ed., ch. 11).

What vibrates is what is left without the quasi-static part ``Q / ω²``. Its complex amplitude
``w = q̇ + i ω (q - Q / ω²)`` obeys ``ẇ = i ω w - i Q̇ / ω``, so that from a start without vibration
:math:`|w(t)| = \frac{1}{ω} \left| \int_0^t \dot Q\, e^{-i ω τ} dτ \right|`. Samples are means over
windows of length T, so their differences are means of Q̇ weighted by a triangle, which leaves
``sinc²(f T)`` of the amplitude; that is divided out.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from meshes.arrays import Array, Index
from workflow.results.samples import PairSamples, Samples
from workflow.results.spectra import filtering, turned
from workflow.scene.scene import Scene, SceneError

FAR = 0.02  # of the size of a part: contact farther from it is not its own
RIGID = 1.0  # Hz: slower is no vibration


@dataclass(frozen=True)
class ModeShapes:
    """The modes that ``squealx modes`` has left in a folder.

    Attributes:
        summary: What ``modes.json`` holds.
        frequency: Ascending, shape ``(k,)`` [Hz].
        rows: The row of each mode in the table.
        points, cells: Mesh of the part, ``(n, 3)`` [m] and ``(c, 8)``.
        shapes: Mass-normalised, shape ``(k, n, 3)`` [kg^-1/2].
    """

    summary: dict[str, Any]
    frequency: Array
    rows: list[dict[str, Any]]
    points: Array
    cells: Index
    shapes: Array


@dataclass(frozen=True)
class Participation:
    """How the modes take part in a run.

    Attributes:
        modes: The modes, rigid ones left out.
        t: Starts of the windows, shape ``(m,)`` [s].
        force: Generalised forces, means over the windows, shape ``(k, m)`` [N kg^-1/2].
        vibration: Complex amplitude of velocity about the quasi-static motion, in axes that turn
            with the phase, shape ``(k, m)`` [m/s kg^1/2].
    """

    modes: ModeShapes
    t: Array
    force: Array
    vibration: Array

    @property
    def energy(self) -> Array:
        """Energy of the vibration of each mode over time, shape ``(k, m)`` [J]."""
        return np.asarray(np.abs(self.vibration) ** 2 / 2)


def found(run: Path, scene: Scene, folder: Path | None) -> ModeShapes | None:
    """Return the modes in a folder, or those of the scene beside a run if there are such.

    Args:
        run: Result folder of a run.
        scene: Its scene.
        folder: Folder of modes; None: ``NAME-modes`` beside the run, if its scene has that name.

    Raises:
        SceneError: if a folder is given that holds no modes.
    """
    if folder is None:
        beside = run.absolute().parent / f"{scene.name}-modes"
        if not (beside / "modes.json").is_file():
            return None
        return read(beside, vibrating=True)
    if not (folder / "modes.json").is_file():
        raise SceneError(f"--modes {str(folder)!r}: expected a folder of squealx modes")
    return read(folder, vibrating=True)


def read(folder: Path, vibrating: bool = False) -> ModeShapes:
    """Return the modes in a folder, without rigid motions if ``vibrating``."""
    summary = json.loads((folder / "modes.json").read_text("utf-8"))
    with h5py.File(folder / "modes.vtkhdf", "r", locking=False) as file:
        root = file["VTKHDF"]
        points, cells = root["Points"][:], root["Connectivity"][:].reshape(-1, 8)
        by_number = {int(name.split()[0]): data for name, data in root["PointData"].items()}
        rows = [r for r in summary["modes"] if r["frequency"] >= RIGID or not vibrating]
        shapes = np.array([by_number[row["number"]][:] for row in rows], dtype=np.float64)
    frequency = np.array([row["frequency"] for row in rows])
    return ModeShapes(summary, frequency, rows, points, cells, shapes.reshape(len(rows), -1, 3))


def axes_of(modes: ModeShapes, scene: Scene) -> tuple[Array, Array]:
    """Return centre and axes (columns) of the part's mesh in the mesh of a run at the start.

    A wheel without axle has axes of its own, all other parts those of the scene.
    """
    if modes.summary["part"] != "wheel" or "wheel" in scene.bodies:
        return np.zeros(3), np.eye(3)
    from meshes.profiles.outline import axes
    from workflow.model.geometry import placement_of

    position = placement_of(scene)
    axle, ahead, up = axes(position.yaw, position.roll)
    return np.asarray(position.centre), np.column_stack([ahead, axle, up])


def fits(modes: ModeShapes, scene: Scene, pair: PairSamples) -> bool:
    """Tell whether the contactor of a pair belongs to the part that has the modes."""
    part = modes.summary["part"]
    if part == "wheel" and part not in scene.bodies:
        return scene.rolling is not None and pair.body == scene.rolling.body
    return bool(pair.body == part)


def at_points(modes: ModeShapes, places: Array) -> Array:
    """Return the mode shapes at points of the part or on its surface, shape ``(k, p, 3)``.

    A point beside the cells, which have no curved faces, takes the values of the nearest one.

    Args:
        modes: The modes.
        places: In the axes of their mesh, shape ``(p, 3)`` [m].

    Raises:
        SceneError: if a point is far from the part.
    """
    import pyvista

    corners = np.column_stack([np.full(len(modes.cells), 8), modes.cells]).ravel()
    kinds = np.full(len(modes.cells), pyvista.CellType.HEXAHEDRON)
    grid = pyvista.UnstructuredGrid(corners, kinds, modes.points)
    closest: Any = grid.find_closest_cell(places, return_closest_point=True)
    cells, nearest = (np.atleast_1d(closest[0]), np.atleast_2d(closest[1]))
    off = np.linalg.norm(places - nearest, axis=1).max()
    if off > FAR * np.ptp(modes.points, axis=0).max():
        raise SceneError(
            f"modes of {modes.summary['part']} of {modes.summary['scene']}: the contact is "
            f"{off:.1e} m away from that part; expected the modes of the wheel of this run"
        )
    out = np.empty((len(modes.shapes), len(places), 3))
    for p, (cell, place) in enumerate(zip(cells, nearest, strict=True)):
        nodes = modes.cells[cell]
        out[:, p] = np.einsum(
            "n,kni->ki", weights(modes.points[nodes], place), modes.shapes[:, nodes]
        )
    return out


def weights(corners: Array, place: Array) -> Array:
    """Return the trilinear weights of a point in a hexahedron, shape ``(8,)``.

    Args:
        corners: Shape ``(8, 3)``, in the order of VTK [m].
        place: Shape ``(3,)`` [m].
    """
    signs = np.array([[x, y, z] for z in (-1, 1) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))])
    xi = np.zeros(3)
    for _ in range(20):
        factors = 1 + signs * xi
        N = factors.prod(axis=1) / 8
        slope = np.stack(
            [signs[:, i] * factors[:, (i + 1) % 3] * factors[:, (i + 2) % 3] for i in range(3)]
        )
        step = np.linalg.solve((slope / 8 @ corners).T, place - N @ corners)
        xi = np.clip(xi + step, -1.0, 1.0)
        if np.abs(step).max() < 1e-12:
            break
    return np.asarray((1 + signs * xi).prod(axis=1) / 8)


def participation(
    modes: ModeShapes, samples: Samples, pair: PairSamples, scene: Scene
) -> Participation:
    """Return how modes take part in what a contact pair does to them.

    Args:
        modes: The modes of the part that has the contactor.
        samples: The samples of the run.
        pair: The pair among them.
        scene: The scene of the run.
    """
    centre, axes = axes_of(modes, scene)
    used, row = np.unique(pair.node, return_inverse=True)
    shapes = at_points(modes, (pair.reference(used) - centre) @ axes)
    sample = pair.sample
    force = (
        turned(pair.normal_forces + pair.tangential_forces, samples.t[sample], samples.spin) @ axes
    )
    generalised = np.array(
        [
            np.bincount(sample, np.einsum("ri,ri->r", shape[row], force), len(samples.t))
            for shape in shapes
        ]
    )
    starts = samples.t - samples.interval / 2
    # a run that does not start from equilibrium meets its first force unprepared
    struck = scene.equilibrium is None and bool(starts[0] < samples.interval / 2)
    moved = vibration(generalised, modes.frequency, starts, samples.interval, struck)
    return Participation(modes, starts, generalised, moved)


def vibration(
    force: Array, frequency: Array, starts: Array, interval: float, struck: bool = False
) -> Array:
    """Return the complex amplitude of velocity of modes about their quasi-static motion.

    Args:
        force: Generalised forces, means over windows, shape ``(k, m)``.
        frequency: Natural frequencies, shape ``(k,)`` [Hz].
        starts: Of the windows, shape ``(m,)`` [s].
        interval: Length of a window [s].
        struck: There was no force before the first window; else what is in it was there already.
    """
    omega = 2 * np.pi * frequency[:, None]
    before = np.zeros_like(force[:, :1]) if struck else force[:, :1]
    rate = np.diff(force, axis=1, prepend=before) * np.exp(-1j * omega * starts)
    filtered = filtering(frequency, interval)[:, None] ** 2
    return np.asarray(-1j * np.cumsum(rate, axis=1) / (omega * filtered))


def together(rows: list[dict[str, Any]], energy: Array) -> list[tuple[dict[str, Any], Array]]:
    """Return the modes with the energies of the two of each pair added up.

    Args:
        rows: The modes in the table.
        energy: Of each mode, shape ``(k, ...)`` [J].
    """
    number = {row["number"]: i for i, row in enumerate(rows)}
    out = []
    for i, row in enumerate(rows):
        other = number.get(row["partner"])
        if other is not None and other < i:
            continue
        out.append((row, energy[i] if other is None else energy[i] + energy[other]))
    return out
