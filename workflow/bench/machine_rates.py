# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rates of one core for the parts of a step: cells of each body, nodes, and what is always there.

All are processor time, the least of some rounds: other work on the machine only adds to it.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import islice
from typing import Any

from mpi4py import MPI

import numpy as np
import ufl

from forms.elasticity import full
from forms.elements import internal_work
from forms.kernel import CellKernel
from forms.nodal import lib, pointer
from workflow.bench.speed_cases import cube, deformed
from workflow.model.bodies import law
from workflow.model.model import build
from workflow.scene import Scene
from workflow.simulation import stepping
from workflow.simulation.progress import Clock

CUBE = 24  # cells along an edge: vectors of a part of some 10 000 cells
SMALL = "stick-slip"  # a scene of four cells with contact, spring, load and support
STEPS = 2000  # of it
ROUNDS = 9


@dataclass(frozen=True)
class Rates:
    """Seconds that one core needs in a step.

    Attributes:
        cell: For a cell of each body, by name [s].
        node: For a node: acceleration, kick and drift [s].
        fixed: For calls that do not depend on the size of the mesh [s].
    """

    cell: dict[str, float]
    node: float
    fixed: float


def rates(scene: Scene) -> Rates:
    """Measure the rates that a scene's steps go by."""
    return Rates(cell_seconds(scene), node_seconds(), fixed_seconds())


def least_seconds(call: Callable[[], Any], repeat: int) -> float:
    """Return the processor time of a call, the least of rounds of ``repeat`` calls [s]."""
    call()
    found = []
    for _ in range(ROUNDS):
        start = time.process_time()
        for _ in range(repeat):
            call()
        found.append((time.process_time() - start) / repeat)
    return min(found)


def cell_seconds(scene: Scene) -> dict[str, float]:
    """Return the time of the internal force for a cell of each body [s]."""
    domain = cube((CUBE, CUBE, CUBE))
    u, w = deformed(domain.V), ufl.TestFunction(domain.V)
    out = np.zeros_like(u.x.array)
    known: dict[Any, float] = {}
    found = {}
    for name, body in scene.bodies.items():
        kind = (body.element, body.kinematics, body.material.law, body.hourglass_coefficient)
        if kind not in known:
            form = internal_work(
                body.element,
                law(body),
                u,
                w,
                body.material.constants(),
                full(domain.msh),
                coefficient=body.hourglass_coefficient,
            )
            kernel = CellKernel(form, scene.time.precision)
            known[kind] = least_seconds(partial(kernel.add, out), 10) / CUBE**3
        found[name] = known[kind]
    return found


def node_seconds() -> float:
    """Return the time of the two passes over the nodes, for a node [s]."""
    n = 3 * (CUBE + 1) ** 3
    arrays = np.zeros((5, n))
    per_mass, load, a, v, u = map(pointer, arrays)

    def update() -> None:
        lib.nd_accelerate(n, per_mass, a)
        lib.nd_advance(n, 1e-7, load, a, v, u)

    return 3 * least_seconds(update, 100) / n


def fixed_seconds() -> float:
    """Return the time of a step of a scene of four cells, without its contact [s]."""
    model = build(Scene.load(SMALL), MPI.COMM_SELF)
    found = []
    for _ in range(ROUNDS):
        clock = Clock()
        start = time.process_time()
        for _ in islice(stepping.steps(model, np.inf, clock), STEPS):
            pass
        contact = clock.seconds["contact"]
        found.append((time.process_time() - start - contact) / STEPS)
    return min(found)
