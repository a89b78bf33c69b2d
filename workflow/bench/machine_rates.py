# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rates of one core for the parts of a step: cells of each body, nodes, and what is always there.

All are processor time, the least of many short rounds: other work on the machine only
adds to it.
"""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import islice
from typing import Any

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import la

from forms.elasticity import full
from forms.elements import internal_work
from forms.kernel import CellKernel
from forms.nodal import lib, pointer
from workflow.bench.speed_cases import cube, deformed
from workflow.model.bodies import law
from workflow.model.model import build
from workflow.scene import Scene
from workflow.scene.bodies import Body
from workflow.simulation import stepping
from workflow.simulation.progress import Clock

CUBE = 24  # cells along an edge: vectors of a part of some 10 000 cells
SMALL = "stick-slip"  # a scene of four cells with contact, spring, load and support
STEPS = 100  # of it, at once
NODES = "nodes"
ROUNDS = 80  # short ones: some of them are not disturbed


@dataclass(frozen=True)
class Rates:
    """Seconds that one core needs in a step.

    Attributes:
        cell: For a cell of each element of a body, by its name and that of the element [s].
        node: For a node: acceleration, kick and drift [s].
        fixed: For calls that do not depend on the size of the mesh [s].
    """

    cell: dict[str, dict[str, float]]
    node: float
    fixed: float


def rates(scene: Scene) -> Rates:
    """Measure the rates that a scene's steps go by."""
    kernels = cell_calls(scene)
    nodes = (CUBE + 1) ** 3
    seconds = least_seconds({**kernels, NODES: node_call(nodes)})
    cell: dict[str, dict[str, float]] = {
        name: {element: seconds[kind_of(body, element)] / CUBE**3 for element in body.elements}
        for name, body in scene.bodies.items()
    }
    return Rates(cell, seconds[NODES] / nodes, fixed_seconds())


def least_seconds(calls: Mapping[Any, Callable[[], Any]]) -> dict[Any, float]:
    """Return the processor time of each call, the least of rounds in which they take turns [s]."""
    found = np.empty((ROUNDS, len(calls)))
    for row in found:
        for k, call in enumerate(calls.values()):
            start = time.process_time()
            call()
            row[k] = time.process_time() - start
    return dict(zip(calls, map(float, found.min(axis=0)), strict=True))


def kind_of(body: Body, element: str) -> tuple[Any, ...]:
    """Return what the time of a cell of a body depends on."""
    return element, body.kinematics, body.material.law, body.hourglass_coefficient


def cell_calls(scene: Scene) -> dict[Any, Callable[[], Any]]:
    """Return the internal force of a cube of the cells of each kind."""
    domain = cube((CUBE, CUBE, CUBE))
    u, w = deformed(domain.V), ufl.TestFunction(domain.V)
    out = np.zeros_like(u.x.array)
    found: dict[Any, Callable[[], Any]] = {}
    for body, element in ((b, e) for b in scene.bodies.values() for e in b.elements):
        if (kind := kind_of(body, element)) not in found:
            form = internal_work(
                element,
                law(body),
                u,
                w,
                body.material.constants(),
                full(domain.msh),
                coefficient=body.hourglass_coefficient,
            )
            found[kind] = partial(CellKernel(form, scene.time.precision).add, out)
    return found


def node_call(nodes: int) -> Callable[[], Any]:
    """Return both passes of a step over some nodes: acceleration, then kick and drift."""
    n = 3 * nodes
    per_mass, load, a, v, u = map(pointer, np.zeros((5, n)))

    def update() -> None:
        lib.nd_accelerate(n, per_mass, a)
        lib.nd_advance(n, 1e-7, load, a, v, u)

    return update


def fixed_seconds() -> float:
    """Return the time of a step of a scene of four cells, its contact taken off [s]."""
    model = build(Scene.load(SMALL), MPI.COMM_SELF)
    loop, state = stepping.steps(model, np.inf, Clock()), model.state
    force = la.vector(model.domain.V.dofmap.index_map, 3)

    def steps() -> None:
        for _ in islice(loop, STEPS):
            pass

    def contact() -> None:
        for _ in range(STEPS):
            for pair in model.pairs.values():
                pair.add(state, force)

    found = least_seconds({"steps": steps, "contact": contact})
    return max(found["steps"] - found["contact"], 0.0) / STEPS
