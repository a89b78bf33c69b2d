# SPDX-License-Identifier: LGPL-3.0-or-later
"""Natural modes of a part of a scene: table, files and figures."""

import csv
import json
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from dataclasses import asdict, dataclass
from importlib import resources
from pathlib import Path
from typing import Any

from mpi4py import MPI

import h5py
import numpy as np
import tomli_w

from meshes.arrays import Array
from meshes.hexmesh import HexMesh
from meshes.tags import Tag
from workflow.model.bodies import Bodies
from workflow.modes.labels import Mode, cylindrical, labelled
from workflow.modes.part import BORE, WHEEL, Part, held_dofs, part_of
from workflow.modes.solve import Spectrum, nodal_mass, spectrum, stiffness
from workflow.results.fields import write_mesh
from workflow.results.folder import occupied
from workflow.results.table import Column, Table
from workflow.scene.mesh import WheelRailMesh
from workflow.scene.scene import Scene, SceneError

FOURIER = "wheel_modes_fourier.csv"


@dataclass(frozen=True)
class Modes:
    """The modes of a part, on rank 0; elsewhere the table alone.

    Attributes:
        summary: What ``modes.json`` holds.
        modes: Ascending.
        mesh: Its mesh.
        shapes: Mass-normalised, ``φᵀ M φ = 1``, shape ``(k, n, 3)`` [kg^-1/2].
        reference: Independent frequencies, ``(n, Hz, direction)``, if there are such.
        axle: Point and direction of the axle, if there is one.
    """

    summary: dict[str, Any]
    modes: list[Mode]
    mesh: HexMesh
    shapes: Array
    reference: list[tuple[int, float, str]]
    axle: tuple[Array, Array] | None = None

    def axis_motion(self, shape: Array) -> Array:
        """Return the axial, radial and circumferential motion of a shape, shape ``(n, 3)``."""
        assert self.axle is not None
        return cylindrical(self.mesh.points, shape[None], *self.axle)[3][0]


def modes(
    scene: Scene,
    out: str | Path | None = None,
    comm: MPI.Comm = MPI.COMM_WORLD,
    *,
    part: str | None = None,
    held: str | None = None,
    top: float = 10e3,
    size: float = 0.026 / 3,
    most: int = 500,
    speed: float | None = None,
    log: Callable[[str], Any] = lambda line: None,
) -> Modes:
    """Return all natural modes of a part up to a frequency; leave them in a new folder.

    Args:
        scene: The scene.
        out: Folder for ``modes.json``, ``modes.vtkhdf`` and figures; nothing is written if None.
        comm: Ranks that share it.
        part: ``wheel`` (without axle, a body of revolution) or a body of the scene.
        held: ``free``, ``bore``, ``supports`` or names of surfaces, see :func:`modes_part.part_of`.
        top: Highest frequency [Hz].
        size: Length of edges in the section of the wheel [m].
        most: How many modes are accepted.
        speed: At which the wheel rolls [m/s]; that of the scene if None.
        log: Called with a line per phase.

    Raises:
        SceneError: if there is no such part, no mode, or too many.
    """
    started = time.perf_counter()
    if not top > 0:
        raise SceneError(f"--to {top:g}: expected a frequency above 0 Hz")
    with nullcontext() if out is None else occupied(out, comm, "squealx modes") as folder:
        chosen = part_of(scene, part, held, size, comm, speed)
        held_here, bodies = held_dofs(chosen), Bodies(chosen.scene, chosen.domain)
        mass = nodal_mass(bodies)
        log(f"{chosen.name}, {chosen.held}: {len(chosen.domain.source.cells)} cells")
        found = spectrum(chosen.domain, stiffness(bodies), mass, held_here, top, most)
        if len(found.frequencies) != found.counted:
            raise RuntimeError(
                f"modes: found {len(found.frequencies)}, but the inertia counts {found.counted}"
            )
        log(f"{found.counted} modes up to {top:g} Hz, all of them by inertia")
        labels, shapes = told_apart(chosen, found, mass)
        summary = summarise(chosen, bodies, labels, float(comm.allreduce(mass.sum())), top, comm)
        summary["wall_seconds"] = time.perf_counter() - started
        result = Modes(
            summary, labels, chosen.domain.source, shapes, fourier(chosen), _axle(chosen)
        )
        if folder is not None and comm.rank == 0:
            write(folder, scene, result)
    return result


def told_apart(part: Part, found: Spectrum, mass: Array) -> tuple[list[Mode], Array]:
    """Return the labels of the modes, and on rank 0 their shapes in mesh order ``(k, n, 3)``.

    Args:
        part: The part.
        found: Its frequencies and the shapes of this rank's nodes.
        mass: Lumped mass of those, shape ``(owned,)`` [kg].
    """
    domain = part.domain
    nodal = domain.gather(np.repeat(mass, 3))[:, 0]
    shapes = np.array([domain.gather(shape.ravel()) for shape in found.shapes])
    labels: list[Mode] = []
    if domain.msh.comm.rank == 0:
        labels, shapes = labelled(
            found.frequencies, shapes, domain.source.points, nodal, _axle(part), hub(part)
        )
    return domain.msh.comm.bcast(labels), shapes


def _axle(part: Part) -> tuple[Array, Array] | None:
    return (part.axis.point, part.axis.direction) if part.axis else None


def hub(part: Part) -> float | None:
    """Return the largest radius of the hub, from which on nodal circles are counted [m]."""
    mesh = part.domain.source
    cells = mesh.regions == mesh.names.get("hub", Tag.HUB)
    if part.axis is None or not cells.any():
        return None
    x = mesh.points[np.unique(mesh.cells[cells])] - part.axis.point
    return float(np.linalg.norm(np.cross(x, part.axis.direction), axis=1).max())


def summarise(
    part: Part, bodies: Bodies, labels: list[Mode], mass: float, top: float, comm: MPI.Comm
) -> dict[str, Any]:
    """Return what ``modes.json`` holds, its modes beside the independent values where there are."""
    body = next(iter(bodies.scene.bodies.values()))
    beside = matched(labels, fourier(part))
    table = [
        asdict(mode)
        | {"independent": beside.get(mode.number), "in_track": in_track(mode, part.spin)}
        for mode in labels
    ]
    return {
        "scene": part.scene.name,
        "part": part.name,
        "held": part.held,
        "element": body.element,
        "cells": len(part.domain.source.cells),
        "nodes": len(part.domain.source.points),
        "ranks": comm.size,
        "mass": mass,
        "top": top,
        "spin": part.spin,
        "independent": f"{FOURIER}: axisymmetric Fourier elements, not measurements"
        if beside
        else None,
        "modes": table,
    }


def in_track(mode: Mode, spin: float) -> list[float] | None:
    """Return the two frequencies of a mode in the frame of the track, None where it has one [Hz].

    To first order in the spin over the frequency; see :func:`workflow.modes.labels.carried`.

    Args:
        mode: The mode, as in the frame of the body.
        spin: How fast the body turns [rad/s].
    """
    if mode.carried is None or not spin:
        return None
    apart = mode.carried * spin / (2 * np.pi)
    return [mode.frequency - apart, mode.frequency + apart]


def fourier(part: Part) -> list[tuple[int, float, str]]:
    """Return the independent frequencies of a wheel, ``(n, Hz, direction)``; none if not its own.

    They hold for the bore clamped, a radius of 0.46 m and steel as in the built-in scene.
    """
    mesh = part.scene.mesh
    body = next(iter(part.scene.bodies.values()))
    if part.name != WHEEL or part.held != BORE or not isinstance(mesh, WheelRailMesh):
        return []
    steel = [getattr(body.material, k, None) for k in ("youngs_modulus", "poisson_ratio")]
    if (*steel, body.material.density) != (210e9, 0.3, 7800.0):
        return []
    if (mesh.wheel_radius, mesh.wheel_profile) != (0.46, "S1002"):
        return []
    text = (resources.files("workflow.modes") / FOURIER).read_text("utf-8")
    rows = csv.DictReader(line for line in text.splitlines() if not line.startswith("#"))
    return [
        (int(row["nodal_diameters_n"]), float(row["f_Hz"]), row["dominant_rim_motion"])
        for row in rows
        if row["candidate"] == mesh.wheel_design
    ]


def matched(labels: list[Mode], reference: list[tuple[int, float, str]]) -> dict[int, float]:
    """Return the independent frequency beside each mode: both lists in order, n by n.

    For n = 0 torsion is apart from all else, and is put beside torsion.

    Args:
        labels: The modes.
        reference: Independent frequencies, ``(n, Hz, direction)``.
    """

    def family(n: int, kind: str) -> tuple[int, bool]:
        return n, n == 0 and kind == "circumferential"

    theirs = defaultdict(list)
    for n, f, kind in sorted(reference):
        theirs[family(n, kind)].append(f)
    out: dict[int, float] = {}
    for mode in labels:
        if mode.diameters is None:
            continue
        if mode.partner and mode.partner < mode.number:
            beside = out.get(mode.partner)
        else:
            waiting = theirs[family(mode.diameters, mode.kind)]
            beside = waiting.pop(0) if waiting else None
        if beside is not None:
            out[mode.number] = beside
    return out


def write(folder: Path, scene: Scene, result: Modes) -> None:
    """Write table, scene and fields into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "scene.toml").write_text(tomli_w.dumps(scene.tables()), "utf-8")
    text = json.dumps(result.summary, indent=2)
    (folder / "modes.json").write_text(text + "\n", "utf-8")
    with h5py.File(folder / "modes.vtkhdf", "w", locking=False) as file:
        root = file.create_group("VTKHDF")
        write_mesh(root, result.mesh)
        for mode, shape in zip(result.modes, result.shapes, strict=True):
            root[f"PointData/{title(mode, width=3)}"] = shape.astype(np.float32)


def title(mode: Mode, width: int = 0) -> str:
    """Return a mode in words: number (if a width is given), frequency, direction, (n, m)."""
    words = [f"{mode.number:0{width}d}"] * (width > 0) + [f"{mode.frequency:.1f} Hz", mode.kind]
    if mode.diameters is not None:
        words.append(f"({mode.diameters}, {_circles(mode.circles)})")
    return " ".join(words)


def printout(summary: dict[str, Any]) -> Iterator[Table]:
    """Yield the table of the modes as ``modes.json`` has them, one row for each pair."""
    rows = [r for r in summary["modes"] if not (r["partner"] and r["partner"] < r["number"])]
    shares = list(rows[0]["shares"])
    columns = [
        Column("mode", lambda r: f"{r['number']}, {r['partner']}" if r["partner"] else r["number"]),
        Column("Hz", "frequency", ".1f"),
        Column("motion", lambda r: r["kind"].replace("umferential", "."), words=True),
    ]
    share = Column("/".join(name[:3] for name in shares) + " %", _shares)
    if "axial" in shares:  # a wheel
        columns += [Column("n, m", _waves), share, Column("split %", "split", ".3f", factor=100)]
    else:
        columns.append(share)
    if summary["spin"]:
        columns.append(Column("in the track Hz", _two))
    if summary["independent"]:
        columns += [Column("indep.", "independent", ".1f"), Column("off %", _off, "+.2f")]
    title = f"{summary['scene']}: {summary['part']}, {summary['held'].replace('_', ' ')}"
    told = [f"turns at {summary['spin']:.4g} rad/s"] * bool(summary["spin"])
    told += [f"indep.: Hz of {summary['independent']}"] * bool(summary["independent"])
    yield Table(title, columns, rows, "; ".join(told))


def _shares(row: dict[str, Any]) -> str:
    return "/".join(f"{100 * share:.0f}" for share in row["shares"].values())


def _waves(row: dict[str, Any]) -> str | None:
    return None if row["diameters"] is None else f"{row['diameters']}, {_circles(row['circles'])}"


def _off(row: dict[str, Any]) -> float | None:
    """Return how far a frequency is off the independent one [%]."""
    f = row["independent"]
    return None if f is None else 100 * (row["frequency"] / f - 1)


def _two(row: dict[str, Any]) -> str | None:
    return row["in_track"] and " / ".join(f"{f:.1f}" for f in row["in_track"])


def _circles(m: int | None) -> str:
    return "–" if m is None else str(m)
