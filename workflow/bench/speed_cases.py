# SPDX-License-Identifier: LGPL-3.0-or-later
"""Timed cases of ``squealx bench``: cell kernels, whole steps, contact; as a module, ranks.

Everything that is compared is called in turn, round after round, so that a noisy machine disturbs
all alike; times are medians over the rounds and ratios are medians of the ratios within a round.
"""

import json
import sys
import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import dolfinx
import numpy as np
import ufl
from dolfinx import fem

from contact.pair import ContactPair
from contact.surface import surface
from forms import kernel
from forms.elasticity import Elastic, full, small_strain, st_venant_kirchhoff
from forms.elements import LAWS, internal_work
from forms.kernel import CellKernel
from forms.mass import lumped_mass
from forms.simd.native import NativeKernel
from meshes.arrays import Array
from meshes.domain import Domain, distribute
from meshes.hexmesh import join
from meshes.shapes import blocks
from meshes.tags import Tag
from workflow.model.state import State
from workflow.simulation.stepping import central_difference, no_hold

Call = Callable[[], Any]

REFERENCE = "St. Venant-Kirchhoff, full"  # what one-point forms replace
STOCK, TUNED, MATRIX = "assemble_vector", "assemble_vector, tuned", "AIJ MatMult"
STOCK_REFERENCE = f"assemble_vector of {REFERENCE}"
NATIVE = {"native float64": np.float64, "native float32": np.float32}
EDGE = 1e-3  # of a cell [m]
SMALL = (5, 5, 4)  # cells of the scene whose overhead per step is measured
CONTACT_CALLS = 500  # the longest interval between two searches


STEEL = Elastic(E=210e9, nu=0.3, rho=7800.0)
HOURGLASS = "one point, physical hourglass stiffness"
CASES = {  # element and law by title
    "St. Venant-Kirchhoff, full": ("full", "total-lagrangian"),
    f"St. Venant-Kirchhoff, {HOURGLASS}": ("one-point", "total-lagrangian"),
    "small strain, full": ("full", "small-strain"),
    f"small strain, {HOURGLASS}": ("one-point", "small-strain"),
    "small strain, selective (B-bar)": ("selective", "small-strain"),
    "neo-Hookean, full": ("full", "neo-hookean"),
}


def work(element: str, law: str, u: Any, w: Any, dx: Any) -> Any:
    """Return the form of the internal virtual work; ``dx`` has full quadrature."""
    return internal_work(element, LAWS[law], u, w, STEEL, dx)


FORMS = {title: partial(work, *case) for title, case in CASES.items()}


def rounds(
    calls: Mapping[str, Call], count: int, *, at_least: float = 0.02, inner: int = 0
) -> dict[str, Array]:
    """Return seconds per call in each round, shape ``(count,)`` each.

    Args:
        calls: What to time, in turn.
        count: Number of rounds.
        at_least: Shortest time that is measured at once [s].
        inner: Calls that are measured at once, instead of ``at_least``.
    """
    repeat = {}
    for name, call in calls.items():
        call()
        repeat[name] = inner or max(1, int(np.ceil(at_least / _seconds(call, 2))))
    times = np.empty((count, len(calls)))
    for row in times:
        row[:] = [_seconds(call, repeat[name]) for name, call in calls.items()]
    return dict(zip(calls, times.T, strict=True))


def _seconds(call: Call, repeat: int) -> float:
    start = time.perf_counter()
    for _ in range(repeat):
        call()
    return (time.perf_counter() - start) / repeat


def cube(cells: tuple[int, int, int], comm: MPI.Comm = MPI.COMM_SELF) -> Domain:
    """Return a block of cubes with edges of 1 mm."""
    upper = tuple(EDGE * n for n in cells)
    return distribute(blocks.block((0.0, 0.0, 0.0), upper, cells=cells), comm)


def deformed(V: Any) -> Any:
    """Return a smooth displacement with strains of about 1e-4."""
    u = fem.Function(V)
    k = 600.0 * np.array([[1.0, 0.5, -0.3], [-0.4, 1.1, 0.6], [0.2, -0.7, 0.9]])
    u.interpolate(lambda x: 2e-7 * np.sin(k @ x + 0.3))
    return u


def stiffness(domain: Domain) -> Any:
    """Return the assembled stiffness at rest with full quadrature, as large as that of any form."""
    from dolfinx.fem.petsc import assemble_matrix

    w, du = ufl.TestFunction(domain.V), ufl.TrialFunction(domain.V)
    form = fem.form(small_strain(du, w, STEEL) * full(domain.msh), jit_options=kernel.JIT_OPTIONS)
    matrix = assemble_matrix(form)
    matrix.assemble()
    return matrix


def kernels(domain: Domain, matrix: Any, count: int) -> dict[str, Any]:
    """Return rate, ratios to stock assembly and agreement with it, for each form and engine.

    ``ratio`` is against stock assembly of the same form, ``ratio_reference`` against that of
    ``REFERENCE``; both are measured in the same rounds.

    Args:
        domain: Mesh.
        matrix: Its assembled stiffness.
        count: Number of rounds.
    """
    u = deformed(domain.V)
    x, y = matrix.createVecs()
    x.array[:] = u.x.array
    w, dx = ufl.TestFunction(domain.V), full(domain.msh)
    reference = fem.form(FORMS[REFERENCE](u, w, dx))
    found = {}
    for title, work in FORMS.items():
        adds = engines(work(u, w, dx))
        forces = {name: np.zeros_like(u.x.array) for name in adds}
        for name, add in adds.items():
            add(forces[name])
        calls: dict[str, Call] = {
            STOCK_REFERENCE: partial(fem.assemble_vector, np.zeros_like(u.x.array), reference),
            **{name: partial(add, np.zeros_like(u.x.array)) for name, add in adds.items()},
            MATRIX: partial(matrix.mult, x, y),
        }
        times = rounds(calls, count)
        whole = times.pop(STOCK_REFERENCE)
        found[title] = {
            name: {
                "rate": len(domain.source.cells) / float(np.median(seconds)),
                "ratio": float(np.median(times[STOCK] / seconds)),
                "ratio_reference": float(np.median(whole / seconds)),
            }
            for name, seconds in times.items()
        }
        largest = np.abs(forces[STOCK]).max()
        for name in (TUNED, *NATIVE):
            error = np.abs(forces[name] - forces[STOCK]).max() / largest
            found[title][name]["difference"] = float(error)
    return found


def engines(form: Any) -> dict[str, Callable[[Array], Any]]:
    """Return the ways to add a form to an array, by name."""
    stock, tuned = fem.form(form), fem.form(form, jit_options=kernel.JIT_OPTIONS)
    return {
        STOCK: lambda out: fem.assemble_vector(out, stock),
        TUNED: lambda out: fem.assemble_vector(out, tuned),
        **{name: NativeKernel(form, dtype).add for name, dtype in NATIVE.items()},
    }


class Block:
    """A free St. Venant-Kirchhoff block that steps, for as long as it is asked.

    Attributes:
        step: One step.
        force: The internal force of a step alone.
    """

    def __init__(self, domain: Domain) -> None:
        u, v = deformed(domain.V), fem.Function(domain.V)
        a, self.mass, scratch = (dolfinx.la.vector(domain.V.dofmap.index_map, 3) for _ in range(3))
        dx = full(domain.msh, domain.regions)
        self.mass.array[:] = lumped_mass(domain.V, dx, {(int(Tag.BLOCK),): STEEL.rho})
        w = ufl.TestFunction(domain.V)
        internal = CellKernel(-st_venant_kirchhoff(u, w, STEEL) * full(domain.msh))
        loop = central_difference(
            State(u, v, a),
            self.mass.petsc_vec,  # does not keep the vector
            [lambda state, out: internal.add(out)],
            no_hold,
            dt=0.5 * EDGE / STEEL.dilatational_speed,
            t_end=np.inf,
        )
        self.step: Call = lambda: next(loop)
        self.force: Call = lambda: internal.add(scratch.array)


def steps(sizes: list[int], count: int) -> list[dict[str, float]]:
    """Return rate of the whole step and of its kernel for blocks of ``n³`` cells."""
    found = []
    for n in sizes:
        block = Block(cube((n, n, n)))
        times = rounds({"step": block.step, "kernel": block.force}, count)
        found.append(
            {
                "cells": n**3,
                "rate": n**3 / float(np.median(times["step"])),
                "kernel_rate": n**3 / float(np.median(times["kernel"])),
                "share": float(np.median(times["kernel"] / times["step"])),
            }
        )
    return found


def overhead(count: int) -> dict[str, float]:
    """Return what a step of a 100-cell block costs, and what of it is not the kernel [s]."""
    block = Block(cube(SMALL))
    times = rounds({"step": block.step, "kernel": block.force}, count)
    return {
        "cells": int(np.prod(SMALL)),
        "step": float(np.median(times["step"])),
        "kernel": float(np.median(times["kernel"])),
        "fixed": float(np.median(times["step"] - times["kernel"])),
    }


def pressed(m: int) -> tuple[ContactPair, State, State, Any]:
    """Return a pair of sliding blocks with ``(m + 1)²`` contactor nodes, pressed and apart."""
    h, dt = EDGE, 1e-7
    wide = 1.3 * m * h
    base = blocks.block(
        (0, 0, -h),
        (wide, wide, 0),
        cells=(m + 2, m + 2, 1),
        region=Tag.BASE,
        surfaces=blocks.BASE_FACES,
    )
    low, high = 0.11 * m * h, 1.11 * m * h
    top = blocks.block((low, low, 0), (high, high, h), cells=(m, m, 1), surfaces=blocks.BLOCK_FACES)
    domain = distribute(join(base, top), MPI.COMM_SELF)
    dx = full(domain.msh, domain.regions)
    mass = lumped_mass(domain.V, dx, {(int(Tag.BASE), int(Tag.BLOCK)): STEEL.rho})[::3]
    pair = ContactPair(
        surface(domain, Tag.BLOCK_BOTTOM, mass),
        surface(domain, Tag.BASE_TOP, mass),
        dt=dt,
        friction=0.3,
    )
    upper = domain.nodes >= len(base.points)
    states = []
    for lift in (-1e-6, 1.0):
        force = dolfinx.la.vector(domain.V.dofmap.index_map, 3)
        state = State(fem.Function(domain.V), fem.Function(domain.V), force)
        state.u.x.array.reshape(-1, 3)[upper, 2] = lift
        state.v.x.array.reshape(-1, 3)[upper, 0] = 2.0
        states.append(state)
    return pair, states[0], states[1], states[0].a


def contact(sizes: list[int], count: int) -> dict[str, Any]:
    """Return seconds per step of pairs in reach and apart; each search is counted in."""
    found = []
    for m in sizes:
        touching, state, _, force = pressed(m)
        apart, _, away, _ = pressed(m)
        calls = {
            "pressed": partial(touching.add, state, force),
            "apart": partial(apart.add, away, force),
        }
        times = rounds(calls, count, inner=CONTACT_CALLS)
        nodes = len(touching.passes[0].candidates.item)
        found.append(
            {
                "nodes": nodes,
                "touching": touching.active,
                "seconds": float(np.median(times["pressed"])),
                "fixed": float(np.median(times["apart"])),
                "per_node": float(np.median((times["pressed"] - times["apart"]) / nodes)),
            }
        )
    return {"sizes": found, "fixed": found[0]["fixed"], "per_node": found[-1]["per_node"]}


def on_ranks(n: int, count: int, at_once: int = 10) -> float:
    """Return element updates per second of the whole step on all ranks together."""
    comm = MPI.COMM_WORLD
    block = Block(cube((n, n, n), comm))
    block.step()
    times = []
    for _ in range(count):
        comm.Barrier()
        times.append(comm.allreduce(_seconds(block.step, at_once), op=MPI.MAX))
    return n**3 / float(np.median(times))


def index_bytes() -> int:
    """Return the size of the column indices of a matrix [byte]."""
    return int(np.dtype(PETSc.IntType).itemsize)


if __name__ == "__main__":
    measured = on_ranks(*map(int, sys.argv[1:]))
    if MPI.COMM_WORLD.rank == 0:
        print(json.dumps({"ranks": MPI.COMM_WORLD.size, "rate": measured}))
