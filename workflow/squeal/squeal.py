# SPDX-License-Identifier: LGPL-3.0-or-later
"""Unstable modes of a sliding state: table, files and figures."""

import json
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mpi4py import MPI

import h5py
import numpy as np
import tomli_w

from meshes.arrays import Flags
from meshes.hexmesh import HexMesh
from meshes.quality import edge_lengths
from workflow.model import Model, build
from workflow.model.bodies import isotropic
from workflow.results.fields import write_mesh
from workflow.results.folder import occupied
from workflow.results.table import Column, Table
from workflow.scene.scene import Scene, SceneError
from workflow.simulation.threads import one_per_rank
from workflow.squeal.feeding import fed
from workflow.squeal.pencil import Complex, Pencil, pencil
from workflow.squeal.sliding import Face, drift_at, faces
from workflow.squeal.solve import (
    Eigen,
    Projection,
    check_count,
    fewer,
    full,
    projection,
    refined,
)
from workflow.squeal.steady import steady

ROADS = ("full", "projection")
CELLS = 4.0  # per wavelength of shear, at least
USUAL = 0.9  # of the edges of a body are not longer than what its waves are measured by
RIGID = 1.0  # Hz: slower, and no faster in growth, is no vibration
UNSTABLE = 1e-7  # growth over |λ| from which it is beyond the eigenvalues' tolerance
SHOWN = 20  # rows of the table
FOLLOWED = 16  # coefficients of friction
AUDIBLE = 20.0  # Hz
MOST_ANGLE = 0.2  # rad: a wheel climbs long before


@dataclass(frozen=True)
class Asked:
    """What is asked of a sliding state, see :func:`squeal`."""

    top: float | None
    road: str
    friction: Sequence[float]
    slip: Sequence[float] | None
    sticking: Sequence[str]
    angles: Sequence[float]
    most: int


@dataclass(frozen=True, eq=False)
class Squeal:
    """Small motions about steady sliding, on rank 0; elsewhere the table alone.

    Attributes:
        summary: What ``squeal.json`` holds.
        mesh: The mesh.
        shapes: Of each mode, of mass one, shape ``(k, n, 3)`` [kg^-1/2].
    """

    summary: dict[str, Any]
    mesh: HexMesh
    shapes: Complex


def squeal(
    scene: Scene,
    out: str | Path | None = None,
    comm: MPI.Comm = MPI.COMM_WORLD,
    *,
    top: float | None = 10e3,
    road: str = "full",
    friction: Sequence[float] = (),
    slip: Sequence[float] | None = None,
    sticking: Sequence[str] = (),
    angles: Sequence[float] = (),
    most: int = 500,
    log: Callable[[str], Any] = lambda line: None,
) -> Squeal:
    """Return growth rates and frequencies of a scene in steady sliding; leave them in a new folder.

    Args:
        scene: The scene.
        out: Folder for ``squeal.json``, ``squeal.vtkhdf`` and figures; nothing is written if None.
        comm: Ranks that share it.
        top: Highest frequency; if None, what the mesh bears, with at most ``most`` modes [Hz].
        road: ``full`` matrices, or their ``projection`` on real modes and contact modes.
        friction: Coefficients over which the modes are followed, by projection and in the state of
            the scene's own friction; if none, and there is a folder, from 0 to the scene's own.
        slip: Velocity of contactors against targets, instead of that of the start [m/s].
        sticking: Contacts that stick.
        angles: Angles of attack of a wheel on a rail over which, and over the coefficients of
            friction, growth is mapped: its normal forces are those of the scene [rad].
        most: How many modes are accepted.
        log: Called with lines of progress.

    Raises:
        SceneError: if nothing slides, rubs or touches, or the mesh is too coarse for ``top``.
        GuardError: if there is no steady state.
    """
    asked = Asked(top, road, friction, slip, sticking, angles, most)
    check(scene, asked)
    with nullcontext() if out is None else occupied(out, comm, "squealx squeal") as folder:
        with one_per_rank():
            model = build(scene, comm, log)
            result = small_motions(model, asked, log, followed=out is not None)
        if folder is not None and comm.rank == 0:
            write(folder, scene, result)
    return result


def small_motions(
    model: Model, asked: Asked, log: Callable[[str], Any], *, followed: bool
) -> Squeal:
    """Bring a model to steady sliding, in place, and return what its small motions do; collective.

    Args:
        model: The model.
        asked: What is looked for.
        log: Called with lines of progress.
        followed: Whether modes are followed over friction, if it is not said over which.
    """
    started = time.perf_counter()
    bears, slip = borne(model, asked.top), asked.slip
    sliding = steady(model, None if slip is None else np.array(slip), asked.sticking, log)
    told(sliding, log)
    small, friction = pencil(model, sliding), asked.friction
    if not len(friction) and (followed or len(asked.angles)):
        friction = np.linspace(0.0, mean_friction(sliding), FOLLOWED).tolist()
    top = fewer(small, bears, asked.most) if asked.top is None else asked.top
    count = check_count(small, top, asked.most)
    log(f"{count} modes up to {top:g} Hz without friction, {small.size} free motions")
    few = projection(small, top) if asked.road == "projection" or len(friction) else None
    eigen = of_projection(few, top) if few and asked.road == "projection" else None
    table, shapes = labelled(small, eigen or up_to(full(small, top, count), top))
    found = {
        "scene": model.scene.name,
        "road": asked.road,
        "cells": len(model.domain.source.cells),
        "free_motions": small.size,
        "ranks": small.comm.size,
        "top": top,
        "cells_per_wavelength": CELLS * bears / top,
        "contacts": contacts_of(sliding),
        "unstable": sum(row["kind"] != "stable" for row in table),
        "modes": table,
        "locus": locus(few, sliding, friction, top) if few else [],
        "map": over_angles(model, few, asked, friction, top) if few else [],
    }
    found["wall_seconds"] = time.perf_counter() - started
    log(f"{found['unstable']} of {len(table)} modes grow")
    return Squeal(found, model.domain.source, shapes)


def of_projection(few: Projection, top: float) -> Eigen:
    """Return the modes of a projection up to a frequency [Hz]; those that grow are refined."""
    eigen = up_to(few.eigen(top), top)
    growing = np.array([kind_of(complex(value)) != "stable" for value in eigen.values], dtype=bool)
    return refined(few.pencil, eigen, growing)


def check(scene: Scene, asked: Asked) -> None:
    """Refuse what has no answer, before any work.

    Raises:
        SceneError: naming option or key.
    """
    top, road, friction, angles = asked.top, asked.road, asked.friction, asked.angles
    if top is not None and not top > 0:
        raise SceneError(f"--to {top:g}: expected a frequency above 0 Hz")
    if road not in ROADS:
        raise SceneError(f"--road {road!r}: expected {' or '.join(ROADS)}")
    if any(not (np.isfinite(f) and f >= 0) for f in friction):
        raise SceneError(f"--friction {list(friction)}: expected coefficients >= 0")
    if any(not abs(angle) < MOST_ANGLE for angle in angles):
        raise SceneError(f"--angles {list(angles)}: expected angles below {MOST_ANGLE:g} rad")
    if len(angles) and scene.rolling is None:
        raise SceneError(
            "--angles: expected a wheel that rolls on a rail, with [rolling]; got none"
        )
    if unknown := sorted(set(asked.sticking) - scene.contacts.keys()):
        raise SceneError(f"--stick {', '.join(unknown)}: expected some of {list(scene.contacts)}")
    if not scene.contacts:
        raise SceneError(f"{scene.name}: no contacts; expected one with friction, for squeal")
    if scene.equilibrium is None:
        raise SceneError(
            f"{scene.name}: no [equilibrium]; expected one, to bring the bodies to rest in contact"
        )
    if all(contact.friction == 0.0 for contact in scene.contacts.values()):
        raise SceneError(
            f"contacts.{next(iter(scene.contacts))}.friction = 0: nothing that could squeal; "
            "expected a coefficient above 0 or a law in some contact"
        )


def borne(model: Model, top: float | None) -> float:
    """Return the frequency at which a wave of shear has the fewest cells that do [Hz].

    Args:
        model: The model.
        top: Highest frequency that is asked for, if one is [Hz].

    Raises:
        SceneError: if it is higher.
    """
    mesh, found = model.domain.source, []
    for name, body in model.scene.bodies.items():
        m = isotropic(model.bodies.materials[name])
        own = mesh.cells[np.isin(mesh.regions, model.bodies.tags(body))]
        edge = np.quantile(edge_lengths(mesh.points, own), USUAL)
        found.append((float(np.sqrt(m.mu / m.rho) / edge / CELLS), name))
    bears, name = min(found)
    if top is not None and top > bears:
        cells = CELLS * bears / top
        raise SceneError(
            f"--to {top:g}: a wave of shear at {top:g} Hz has {cells:.2g} cells of body {name!r}; "
            f"expected {CELLS:g} or more, up to {bears:.3g} Hz on this mesh"
        )
    return bears


def told(faces: list[Face], log: Callable[[str], Any]) -> None:
    """Log what the contacts are like."""
    for name, row in contacts_of(faces).items():
        log(
            f"contact {name}: {row['contacts']} contacts {row['state']}, "
            f"{row['normal_force']:.4g} N, slip {row['slip_rate']:.3g} m/s, "
            f"friction {row['friction']:.3g}"
        )


def contacts_of(faces: list[Face]) -> dict[str, dict[str, Any]]:
    """Return the state of each contact of the scene: sums, and means weighted with the force."""
    found: dict[str, dict[str, Any]] = {}
    for name in dict.fromkeys(face.name for face in faces):
        own = [face for face in faces if face.name == name]
        force = np.concatenate([face.contacts.normal_force for face in own])
        mean = {
            key: float(force @ np.concatenate([getattr(f.contacts, of) for f in own]) / force.sum())
            for key, of in (("slip_rate", "speed"), ("friction", "friction"), ("slope", "slope"))
        }
        found[name] = {
            "state": "sticking" if own[0].sticks else "sliding",
            "contacts": len(force),
            "patches": max(face.patches for face in own),
            "normal_force": float(force.sum()),
            **mean,
        }
    return found


def up_to(eigen: Eigen, top: float) -> Eigen:
    """Return the vibrations up to a frequency [Hz] and what grows without; rigid motion is none."""
    kept = vibrates(eigen.values, top)
    return Eigen(eigen.values[kept], eigen.shapes[kept], eigen.residuals[kept])


def vibrates(values: Complex, top: float) -> Flags:
    """Return which eigenvalues are vibrations up to a frequency [Hz], or grow without."""
    f = values.imag / (2 * np.pi)
    moves = np.abs(values) > 2 * np.pi * RIGID
    return moves & (f <= top) & ((f > 0.0) | ((f == 0.0) & (values.real > 0.0)))


def labelled(small: Pencil, eigen: Eigen) -> tuple[list[dict[str, Any]], Complex]:
    """Return a row for each mode, and on rank 0 their shapes by HexMesh node ``(k, n, 3)``."""
    rows, shapes = fed(small, eigen)
    return [
        {
            "frequency": float(value.imag / (2 * np.pi)),
            "growth_rate": float(value.real),
            "kind": kind_of(complex(value)),
            "damping_ratio": float(-value.real / abs(value)),
            **row,
        }
        for value, row in zip(eigen.values, rows, strict=True)
    ], shapes


def kind_of(value: complex) -> str:
    """Return what an eigenvalue [1/s] means: ``stable``, ``flutter`` or ``divergence``."""
    if value.real <= UNSTABLE * abs(value):
        return "stable"
    return "flutter" if value.imag > 0.0 else "divergence"


def locus(
    few: Projection, faces: list[Face], friction: Sequence[float], top: float
) -> list[dict[str, Any]]:
    """Return the modes at other coefficients of friction, see :func:`squeal`."""
    own = mean_friction(faces)
    found = []
    for f in friction:
        values = few.pencil.comm.bcast(few.values(f / own))
        values = np.sort_complex(-1j * values[vibrates(values, top)])
        modes = [
            {"frequency": float(v.real / (2 * np.pi)), "growth_rate": -float(v.imag)}
            for v in values
        ]
        found.append({"friction": float(f), "modes": modes})
    return found


def over_angles(
    model: Model,
    few: Projection,
    asked: Asked,
    friction: Sequence[float],
    top: float,
) -> list[dict[str, Any]]:
    """Return the audible mode that grows fastest at each angle of attack and coefficient.

    The normal forces are those of the state of the scene; which way the patches slide, and how
    fast, is that of the angle.
    """
    found = []
    for angle in asked.angles:
        turned = faces(model, None, asked.sticking, drift_at(model, angle))
        for row in locus(few.rubbed(turned), turned, friction, top):
            heard = [mode for mode in row["modes"] if mode["frequency"] >= AUDIBLE]
            most = max(heard, key=lambda mode: mode["growth_rate"], default=None)
            found.append({"angle": float(angle), "friction": row["friction"], **(most or {})})
    return found


def mean_friction(faces: list[Face]) -> float:
    """Return the coefficient of friction, the mean over normal forces that slide.

    Raises:
        SceneError: if none does.
    """
    if all(face.sticks for face in faces):
        raise SceneError("--friction: expected a contact that slides; all that touch stick")
    force = np.concatenate([f.contacts.normal_force for f in faces if not f.sticks])
    own = np.concatenate([f.contacts.friction for f in faces if not f.sticks])
    return float(force @ own / force.sum())


def write(folder: Path, scene: Scene, result: Squeal) -> None:
    """Write table, scene and fields into a folder; a shape is its real and imaginary part."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "scene.toml").write_text(tomli_w.dumps(scene.tables()), "utf-8")
    text = json.dumps(result.summary, indent=2)
    (folder / "squeal.json").write_text(text + "\n", "utf-8")
    with h5py.File(folder / "squeal.vtkhdf", "w", locking=False) as file:
        root = file.create_group("VTKHDF")
        write_mesh(root, result.mesh)
        for number, (row, shape) in enumerate(
            zip(result.summary["modes"], result.shapes, strict=True), 1
        ):
            title = f"{number:03d} {row['frequency']:.1f} Hz {row['growth_rate']:+.3g} per s"
            root[f"PointData/{title} real"] = shape.real.astype(np.float32)
            root[f"PointData/{title} imaginary"] = shape.imag.astype(np.float32)


def printout(summary: dict[str, Any]) -> Iterator[Table]:
    """Yield the table of what grows, fastest first; without that, of what is damped least."""
    rows = sorted(summary["modes"], key=lambda row: -row["growth_rate"])
    growing = [row for row in rows if row["kind"] != "stable"]
    columns = [
        Column("kHz", "frequency", ".3f", factor=1e-3),
        Column("growth 1/s", "growth_rate", "+.4g"),
        Column("motion", "kind", words=True),
        Column("fed by 1/s", _feeders, words=True),
        Column("damping 1/s", "damping", "+.3g"),
    ]
    contacts = "; ".join(
        f"{name} {row['state']}, friction {row['friction']:.3g}"
        for name, row in summary["contacts"].items()
    )
    title = f"{summary['scene']}: {contacts}"
    of = f"{summary['unstable']} of {len(summary['modes'])} modes up to {summary['top']:g} Hz grow"
    shown = (growing or rows)[:SHOWN]
    note = f"{of}; {summary['cells_per_wavelength']:.1f} cells per wavelength of shear there"
    yield Table(title, columns, shown, note)


def _feeders(row: dict[str, Any]) -> str:
    return ", ".join(f"{name} {rate:+.3g}" for name, rate in row["fed_by"].items())
