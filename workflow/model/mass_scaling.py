# SPDX-License-Identifier: LGPL-3.0-or-later
"""Mass scaling: more density in the cells that would shorten the step, as inertia only.

Selective mass scaling by cells, as in LS-DYNA (theory manual, R14, section 25.5): a cell whose own
largest frequency is above a limit gets the density that brings it to the limit. The limit is the
highest at which the assembled system is stable at the step asked for, which is above the frequency
of that step because neighbours slow each other down. What is added has no weight, and neither modes
nor loads know of it.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from dolfinx import fem

from forms.springs.connections import Connections
from forms.time_step import assembled_frequency, cell_frequencies
from meshes.arrays import Array
from meshes.quality import cell_volumes
from workflow.model.bodies import Bodies
from workflow.model.step import step_bound
from workflow.scene import SceneError
from workflow.scene.settings import MassScaling

RUNG = 1.04  # limits are tried in steps of this, so that the one found does not hang on round-off
RUNGS = 16


@dataclass(frozen=True)
class AddedMass:
    """Mass that has been added to cells.

    Attributes:
        step: Step bound with it [s].
        cells: Number of heavier cells.
        bodies: Added mass by body [kg].
        regions: Added mass by region of the mesh [kg].
        largest: Largest factor on a cell's density [-].
    """

    step: float
    cells: int
    bodies: dict[str, float]
    regions: dict[str, float]
    largest: float

    @property
    def total(self) -> float:
        """All added mass [kg]."""
        return sum(self.bodies.values())

    def tables(self) -> dict[str, Any]:
        """Return it for ``summary.json``."""
        return {
            "total": self.total,
            "bodies": self.bodies,
            "regions": self.regions,
            "cells": self.cells,
            "largest_factor": self.largest,
        }


def scale_masses(
    bodies: Bodies,
    settings: MassScaling,
    connections: Connections | None,
    log: Callable[[str], Any],
) -> AddedMass:
    """Add mass to the cells of ``bodies`` until the step asked for is stable; collective.

    Args:
        bodies: Bodies with their forms; the density of their inertia is changed.
        settings: Step asked for and the limits of what may be added.
        connections: Springs, dampers and point masses, if there are such.
        log: Called with lines for the log.

    Raises:
        SceneError: if no mass, or more than allowed, would do.
    """
    V, wanted = bodies.domain.V, settings.step / bodies.scene.time.safety
    frequency = cell_frequencies(V, bodies.internal_work, bodies.mass)
    density = fem.Function(fem.functionspace(V.mesh, ("DG", 0)))
    at = density.function_space.dofmap.list[: len(frequency), 0]

    def scaled(rung: int) -> Array:
        limit = RUNG**rung * 2 / wanted
        density.x.array[at] = np.maximum(1.0, (frequency / limit) ** 2)
        density.x.scatter_forward()
        return bodies.lumped_mass()

    def stable(rung: int) -> bool:
        return assembled_frequency(V, bodies.internal_work, scaled(rung), tolerance=0.01)[0] < most

    bodies.density_factor, most = density, 2 / wanted
    low, high = 0, RUNGS  # no cell, and so no sum of them, is above its own limit
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if stable(middle) else (low, middle)
    # dampers, connections and contacts want some more
    rungs = range(low, low - RUNGS, -1)
    bounds = (step_bound(bodies, scaled(rung), connections, _silent) for rung in rungs)
    step = next((bound for bound in bounds if bound >= wanted), None)
    if step is None:
        raise SceneError(
            f"mass_scaling.step = {settings.step}: expected a step that mass in cells can reach, "
            "got one that dampers, connections or contacts forbid; see squealx audit"
        )
    added = _added(bodies, density.x.array[at], step)
    log(
        f"mass scaling: {added.total:.3g} kg in {added.cells} cells for a step of "
        f"{settings.step * 1e9:.1f} ns; by body "
        + ", ".join(f"{name} {kg:.3g} kg" for name, kg in added.bodies.items())
    )
    _check(settings, added)
    return added


def _silent(line: str) -> None:
    """Log nothing."""


def _added(bodies: Bodies, factor: Array, step: float) -> AddedMass:
    """Return what the factors on the density of the owned cells add; collective."""
    domain, comm = bodies.domain, bodies.domain.msh.comm
    source = domain.source
    cells = domain.msh.topology.original_cell_index[: len(factor)]
    more = (factor - 1.0) * cell_volumes(source.points, source.cells[cells])
    by_body, by_region = dict[str, float](), dict[str, float]()
    for name, body in bodies.scene.bodies.items():
        for region in body.regions:
            mine = np.isin(source.regions[cells], source.tags([region]))
            mass = float(comm.allreduce(body.material.density * more[mine].sum()))
            by_region[region] = mass
            by_body[name] = by_body.get(name, 0.0) + mass
    heavier = int(comm.allreduce(int((factor > 1.0).sum())))
    largest = max(comm.allgather(float(factor.max(initial=1.0))))
    return AddedMass(step, heavier, by_body, by_region, largest)


def _check(settings: MassScaling, added: AddedMass) -> None:
    """Raise SceneError if more has been added than the scene allows."""
    if added.total > settings.total:
        raise SceneError(
            f"mass_scaling.total = {settings.total} kg: a step of {settings.step} s needs "
            f"{added.total:.3g} kg; expected a shorter mass_scaling.step or a higher limit"
        )
    for region, mass in added.regions.items():
        if settings.per_region is not None and mass > settings.per_region:
            raise SceneError(
                f"mass_scaling.per_region = {settings.per_region} kg: a step of {settings.step} s "
                f"needs {mass:.3g} kg in {region!r}; expected a shorter mass_scaling.step or a "
                "higher limit"
            )
