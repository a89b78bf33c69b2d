# SPDX-License-Identifier: LGPL-3.0-or-later
"""Outputs of a run: a row of history and the footprints at each, the summary at the end."""

import traceback
from collections.abc import Callable
from functools import partial, reduce
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from workflow.model.model import Model
from workflow.results.writer import Results
from workflow.simulation.energy import Energy, Ledger, columns
from workflow.simulation.progress import Clock
from workflow.simulation.reactions import Reactions


def output(
    model: Model,
    results: Results,
    energy: Energy,
    error: float,
    ledger: Ledger,
    reactions: Reactions,
) -> dict[str, float]:
    """Write one output: history, footprints, fields; return the row of history."""
    state, scene = model.state, model.scene
    history = {"t": state.t, **columns(energy, error)}
    history |= {"guarded_error": ledger.guarded_error, "contact_work": ledger.contact_work}
    u, v = state.u.x.array, state.v.x.array + model.dt / 2 * state.a.array
    contacts, pairs = {}, model.pairs
    if pairs:
        from workflow.results.footprints import touch  # a run without contact has none
    for name, pair in pairs.items():
        contacts[name] = touch(pair, u, v, scene)
        columns_of = contact_history(pair, contacts[name].foot)
        history |= {f"{name}_{key}": value for key, value in columns_of.items()}
    history |= reactions.columns(contacts)
    for item in model.items:
        history |= item.columns() if hasattr(item, "columns") else {}
    results.append(history, contacts)
    results.append_fields(state.t, u, v, cell_fields(model))
    return history


def cell_fields(model: Model) -> dict[str, Callable[[], Any]]:
    """Return what gathers each field of cells, of all bodies with a memory together."""
    items = [item for item in model.items if hasattr(item, "cell_means")]

    def gather(name: str) -> Any:
        own = [item.cell_means(name) for item in items if name in item.cell_fields]
        return reduce(np.fmax, own)  # where a body has none it is zero or not a number

    names = sorted({name for item in items for name in item.cell_fields})
    return {name: partial(gather, name) for name in names}


def answers(
    model: Model, folder: Path, status: str, log: Callable[[str], Any]
) -> list[dict[str, Any]]:
    """Return what theory expects of a run beside what came out, read from its folder; collective.

    Nothing of a run that was stopped, or with laws that its scene does not tell. An error in the
    theory ends no run: it is logged.
    """
    if status != "done" or model.own_laws:
        return []
    found: list[dict[str, Any]] = []
    if model.domain.msh.comm.rank == 0:
        from workflow.results.record import Record
        from workflow.theory.expected import expected

        try:
            found = [answer.entry() for answer in expected(Record(folder))]
        except Exception:
            log(f"theory: no answers, for an error in it:\n{traceback.format_exc()}")
    return list(model.domain.msh.comm.bcast(found))


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
    model: Model,
    energy: Energy | None,
    error: float,
    status: str,
    clock: Clock,
    wall: float,
    *,
    contacts: bool = True,
) -> dict[str, Any]:
    """Return the contents of ``summary.json``; without contacts a rank can do so by itself."""
    mesh = model.domain.source
    pressed = {}
    for name, pair in model.pairs.items() if contacts else ():
        footprint = pair.footprint()
        pressed[name] = {
            "max_penetration": pair.max_penetration,
            "normal_force": pair.normal_force,
            "tangential_force": list(map(float, pair.tangential_force)),
            "patches": len(footprint.patches),
            "area": float(np.sum(footprint.area)),
            "contact_angles": [patch.contact_angle for patch in footprint.patches],
        }
    yielding = {item.name: item.yielding for item in model.items if hasattr(item, "yielding")}
    stepping = sum(clock.seconds[p] for p in ("internal_force", "contact", "update", "output"))
    return {
        "scene": model.scene.name,
        "version": version("squealx"),
        "status": status,
        "own_laws": model.own_laws,
        "cells": len(mesh.cells),
        "nodes": len(mesh.points),
        "dofs": 3 * len(mesh.points),
        "ranks": model.domain.msh.comm.size,
        "steps": model.state.step,
        "time": model.state.t,
        "dt": model.dt,
        "dt_bound": model.dt_bound,
        "added_mass": model.added_mass.tables() if model.added_mass is not None else None,
        **({"yielding": yielding} if yielding else {}),
        "wall_seconds": wall,
        "processor_seconds": clock.processor,
        "seconds_per_phase": clock.seconds,
        "element_updates_per_second": len(mesh.cells) * model.state.step / max(stepping, 1e-9),
        "energy": columns(energy, error) if energy is not None else None,
        "contacts": pressed,
        "expected": [],
    }
