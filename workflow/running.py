# SPDX-License-Identifier: LGPL-3.0-or-later
"""A run from scene to results: equilibrium, rolling start, steps, outputs, summary."""

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

import numpy as np

from forms.elements import Law
from workflow import guards
from workflow.clock import Clock
from workflow.contact_step import tell_offsets
from workflow.energy import Energy, Ledger, columns
from workflow.geometry import cell_size
from workflow.model import Model, build
from workflow.patch_table import creepages
from workflow.progress import Progress
from workflow.results import Results, check_free
from workflow.scene import Scene, SceneError
from workflow.stepping import central_difference

if TYPE_CHECKING:
    from contact.friction import Law as FrictionLaw


@dataclass
class Result:
    """A finished (or stopped) run.

    Attributes:
        folder: Where its results are.
        summary: The contents of ``summary.json``.
    """

    folder: Path
    summary: dict[str, Any]

    @property
    def history(self) -> dict[str, Any]:
        """Columns of ``/history`` in ``results.h5``."""
        import h5py

        with h5py.File(self.folder / "results.h5", "r", locking=False) as file:
            return {name: data[:] for name, data in file["history"].items()}


def run(
    scene: Scene,
    out: str | Path,
    comm: MPI.Comm = MPI.COMM_WORLD,
    *,
    watch: Callable[[Model], None] | None = None,
    laws: Mapping[str, Law] | None = None,
    friction: "Mapping[str, FrictionLaw] | None" = None,
    quiet: bool = False,
) -> Result:
    """Run a scene and leave its results in a new folder.

    Args:
        scene: What to run.
        out: Result folder; made if missing, must not hold a run.
        comm: Ranks that share the run.
        watch: Called with the model at every step, for experiments.
        laws: Material laws of your own by body name, in place of the scene's.
        friction: Friction laws of your own by contact name, in place of the scene's.
        quiet: No progress on the terminal; ``run.log`` is always written.

    Raises:
        SceneError: bad input, before anything is written.
        GuardError: the run was stopped; everything up to there is kept.
    """
    started = time.perf_counter()
    folder = checked(out, comm)
    clock = Clock()
    progress = Progress(comm.rank == 0, quiet)
    model = build(scene, comm, progress.log, clock, laws, friction)
    check_apart(model)
    results = Results(folder, scene, model.domain)
    progress.keep_in(folder / "run.log")
    energy, error, status = None, 0.0, "done"
    try:
        with clock.phase("equilibrium"):
            start(model, progress.log)
        for energy, error in steps(model, results, clock, progress, watch):
            pass
    except guards.GuardError as stop:
        status = f"stopped: {stop}"
        raise
    except RuntimeError as stop:  # of the contact: a node went through, or is nowhere
        status = f"stopped: {stop}"
        raise guards.GuardError(f"{stop} (step {model.state.step})") from stop
    except BaseException as failure:
        status = f"failed: {type(failure).__name__}: {failure}"
        raise
    finally:
        wall = time.perf_counter() - started
        summary = summarise(model, energy, error, status, clock, wall)
        results.summarise(summary)
        progress.close()
    return Result(folder, summary)


def checked(out: str | Path, comm: MPI.Comm) -> Path:
    """Return the result folder if rank 0 finds it free; raise alike on all ranks if not."""
    error = None
    if comm.rank == 0:
        try:
            check_free(out)
        except SceneError as caught:
            error = caught
    error = comm.bcast(error)
    if error is not None:
        raise error
    return Path(out)


def check_apart(model: Model) -> None:
    """Refuse bodies that overlap by more than a hundredth of a cell before the run."""
    size = cell_size(model.scene, model.domain.source)
    limit, look = 0.01 * size, 50 * size
    for name, pair in model.pairs.items():
        depth, node, place = pair.penetration(model.state, look)
        if depth > limit:
            x, y, z = place
            raise SceneError(
                f"contacts.{name}: bodies overlap at the start by {depth:.3e} m at node {node} "
                f"(x = {x:.5f}, y = {y:.5f}, z = {z:.5f} m); expected at most {limit:.1e} m"
            )


def start(model: Model, log: Callable[[str], Any]) -> None:
    """Bring the model to rest and set its initial velocities, as the scene asks."""
    scene = model.scene
    if scene.equilibrium is not None:
        from workflow.equilibrium import equilibrium

        extra = np.zeros(0)
        if scene.rolling is not None:
            from workflow import rolling

            extra = rolling.centrifugal(model)
        equilibrium(model, scene.equilibrium, extra, log)
    v = model.state.v.x.array.reshape(-1, 3)
    for name, body in scene.bodies.items():
        if body.velocity is not None:
            v[model.body_dofs(name)] = body.velocity
    model.supports(model.state.v.x)
    if scene.rolling is not None:
        from workflow import rolling

        rolling.start(model)
    if scene.driven:
        from workflow import driven

        driven.start(model)
    model.state.v.x.scatter_forward()


def steps(
    model: Model,
    results: Results,
    clock: Clock,
    progress: Progress,
    watch: Callable[[Model], None] | None,
) -> Iterator[tuple[Energy, float]]:
    """Step to the end; yield energies and balance error at every output."""
    scene, state = model.scene, model.state
    ledger = Ledger(model)
    per_output = round(scene.time.output_interval / model.dt)
    last = round(scene.time.end / model.dt)
    loads = [clock.timed(model.phase_of(add), add) for add in model.loads]
    constraints = [clock.timed(model.phase_of(add), add) for add in model.last]
    points = model.connections.masses if model.connections is not None else None
    progress.start(last, model.dt)
    loop = central_difference(
        state,
        model.mass.petsc_vec,
        loads,
        model.drives or model.supports,
        model.dt,
        last * model.dt,
        points,
        model.dead.nodal,
        last=constraints,
    )
    began = time.perf_counter()
    busy = sum(clock.seconds.values())
    for _ in loop:
        guards.check_finite(model)
        if state.step == 0:
            tell_offsets(model, progress.log)
        if watch is not None:
            watch(model)
        if state.step % per_output == 0:
            with clock.phase("output"):
                energy, error = ledger.measure()
                output(model, results, energy, error)
            progress.output(model, error)
            guards.check_energy(model, error)
            yield energy, error
        elif state.step % scene.guards.check_interval == 0:
            guards.check_energy(model, ledger.measure()[1])
        progress.step(state.step)
    others = sum(clock.seconds.values()) - busy
    clock.seconds["update"] += time.perf_counter() - began - others


def output(model: Model, results: Results, energy: Energy, error: float) -> None:
    """Write one output: history, footprints, fields."""
    state, scene = model.state, model.scene
    history = {"t": state.t, **columns(energy, error)}
    u, v = state.u.x.array, state.v.x.array + model.dt / 2 * state.a.array
    footprints, motions = {}, {}
    for name, pair in model.pairs.items():
        footprint = pair.footprint(stick_tolerance=scene.contacts[name].stick_tolerance)
        footprints[name] = footprint
        motions[name] = creepages(pair, u, v, footprint, scene)
        history |= {
            f"{name}_{key}": value for key, value in contact_history(pair, footprint).items()
        }
    results.append(history, footprints, motions)
    results.append_fields(state.t, u, v)


def contact_history(pair: Any, footprint: Any) -> dict[str, float]:
    """Return the history columns of a contact pair."""
    x, y, z = pair.tangential_force
    return {
        "normal_force": pair.normal_force,
        "tangential_x_force": x,
        "tangential_y_force": y,
        "tangential_z_force": z,
        "max_penetration": pair.max_penetration,
        "normal_energy": pair.normal_energy,
        "tangential_energy": pair.tangential_energy,
        "friction_dissipation": pair.friction_dissipation,
        "area": float(np.sum(footprint.area)),
        "patches": float(len(footprint.patches)),
    }


def summarise(
    model: Model, energy: Energy | None, error: float, status: str, clock: Clock, wall: float
) -> dict[str, Any]:
    """Return the contents of ``summary.json``."""
    mesh = model.domain.source
    contacts = {}
    for name, pair in model.pairs.items():
        footprint = pair.footprint()
        contacts[name] = {
            "max_penetration": pair.max_penetration,
            "normal_force": pair.normal_force,
            "tangential_force": list(map(float, pair.tangential_force)),
            "patches": len(footprint.patches),
            "area": float(np.sum(footprint.area)),
            "contact_angles": [patch.contact_angle for patch in footprint.patches],
        }
    stepping = sum(clock.seconds[p] for p in ("internal_force", "contact", "update", "output"))
    return {
        "scene": model.scene.name,
        "version": version("squealx"),
        "status": status,
        "cells": len(mesh.cells),
        "nodes": len(mesh.points),
        "dofs": 3 * len(mesh.points),
        "ranks": model.domain.msh.comm.size,
        "steps": model.state.step,
        "time": model.state.t,
        "dt": model.dt,
        "dt_bound": model.dt_bound,
        "wall_seconds": wall,
        "seconds_per_phase": clock.seconds,
        "element_updates_per_second": len(mesh.cells) * model.state.step / max(stepping, 1e-9),
        "energy": columns(energy, error) if energy is not None else None,
        "contacts": contacts,
    }
