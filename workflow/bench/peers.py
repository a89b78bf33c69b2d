# SPDX-License-Identifier: LGPL-3.0-or-later
"""Other codes on the same job: the internal force of St. Venant-Kirchhoff cells; as a module, JSON.

Each gets the same block of hexahedra with 2 × 2 × 2 points in float64 and the same displacement, on
one core, in turn with stock assembly and the native kernel; its force is compared with stock's.
scikit-fem has the form as its manual writes forms, JAX the same arithmetic with cells as the last
axis of every array, which its compiler turns into the fastest loops that were found.
"""

import importlib.util
import json
import os
import sys
from collections.abc import Callable
from functools import partial
from typing import Any

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem

from forms.elasticity import full
from forms.simd.native import NativeKernel
from meshes.arrays import Array
from meshes.hexmesh import HexMesh
from workflow.bench.speed_cases import FORMS, REFERENCE, STEEL, cube, deformed, rounds

STOCK, NATIVE = "assemble_vector", "native float64"
MODULES = {"scikit-fem": "skfem", "JAX": "jax"}
EXTRA = "not installed: pip install 'squealx[bench]'"
CORNERS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
CORNERS = np.concatenate([CORNERS, CORNERS + np.array([0, 0, 1])])  # of a HexMesh cell
LMBDA = STEEL.E * STEEL.nu / (1 + STEEL.nu) / (1 - 2 * STEEL.nu)  # Pa
MU = STEEL.E / 2 / (1 + STEEL.nu)  # Pa

Force = Callable[[], Array]


def measure(n: int, count: int) -> dict[str, Any]:
    """Return rate, share of stock's rate and agreement with it of each code, or why it is skipped.

    Args:
        n: Cells along each edge of the block.
        count: Number of rounds.
    """
    domain = cube((n, n, n), MPI.COMM_SELF)
    u, w = deformed(domain.V), ufl.TestFunction(domain.V)
    form = FORMS[REFERENCE](u, w, full(domain.msh))
    moved = domain.gather(u.x.array)
    forces: dict[str, Force] = {
        STOCK: partial(added, partial(_assemble, fem.form(form)), u.x.array),
        NATIVE: partial(added, NativeKernel(form, np.float64).add, u.x.array),
    }
    found: dict[str, Any] = {}
    for name, make in (("scikit-fem", of_scikit_fem), ("JAX", of_jax)):
        if importlib.util.find_spec(MODULES[name]) is None:
            found[name] = {"skipped": EXTRA}
        else:
            forces[name] = make(domain.source, moved)
    results = {name: force() for name, force in forces.items()}
    whole = domain.gather(results[STOCK])
    results |= {name: domain.gather(results[name]) for name in (STOCK, NATIVE)}
    times = rounds(forces, count)
    for name, seconds in times.items():
        found[name] = {
            "rate": n**3 / float(np.median(seconds)),
            "ratio": float(np.median(times[STOCK] / seconds)),
            "difference": float(np.abs(results[name] - whole).max() / np.abs(whole).max()),
        }
    return {"cells": n**3, "codes": found}


def added(add: Callable[[Array], Any], like: Array) -> Array:
    """Return what ``add`` adds to zero."""
    force = np.zeros_like(like)
    add(force)
    return force


def _assemble(form: Any, out: Array) -> None:
    fem.assemble_vector(out, form)


def of_scikit_fem(mesh: HexMesh, moved: Array) -> Force:
    """Return the force of scikit-fem, shape ``(n, 3)`` [N]."""
    import skfem
    from skfem.helpers import ddot, eye, grad, mul, trace, transpose

    order = [int(np.argmax((CORNERS == point).all(axis=1))) for point in _reference(skfem)]
    block = skfem.MeshHex(mesh.points.T.copy(), mesh.cells[:, order].T.copy())
    basis = skfem.Basis(block, skfem.ElementVector(skfem.ElementHex1()), intorder=3)
    assert basis.X.shape == (3, 8)

    @skfem.LinearForm
    def work(v: Any, w: Any) -> Any:
        one = eye(np.ones(w.x.shape[1:]), 3)
        F = one + grad(w.u)
        E = (mul(transpose(F), F) - one) / 2
        S = LMBDA * eye(trace(E), 3) + 2 * MU * E
        return ddot(mul(F, S), grad(v))

    u = np.zeros(basis.N)
    u[basis.nodal_dofs] = moved.T
    return lambda: work.assemble(basis, u=basis.interpolate(u))[basis.nodal_dofs].T


def _reference(skfem: Any) -> Any:
    """Return the corners of scikit-fem's reference cell in its own order."""
    return np.rint(np.asarray(skfem.ElementHex1().doflocs)).astype(int)


def of_jax(mesh: HexMesh, moved: Array) -> Force:
    """Return the force of JAX, compiled, shape ``(n, 3)`` [N]."""
    import jax
    from jax import numpy as jnp

    jax.config.update("jax_enable_x64", True)
    g = 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3.0)
    slopes = [shape_slopes(np.array([x, y, z])) for x in g for y in g for z in g]

    @jax.jit
    def force(x: Any, u: Any) -> Any:
        here, there = (jnp.moveaxis(a[mesh.cells], 0, -1) for a in (x, u))
        parts = sum(at_point(jnp, slope, here, there) for slope in slopes)
        return jnp.zeros_like(u).at[mesh.cells].add(jnp.moveaxis(parts, -1, 0))

    x, u = jnp.asarray(mesh.points), jnp.asarray(moved)
    return lambda: np.asarray(force(x, u).block_until_ready())


def shape_slopes(point: Array) -> Array:
    """Return the slopes of the trilinear functions of the unit cube at a point, ``(8, 3)``."""
    value = np.where(CORNERS == 1, point, 1.0 - point)
    sign = np.where(CORNERS == 1, 1.0, -1.0)
    return np.column_stack(
        [sign[:, d] * np.delete(value, d, axis=1).prod(axis=1) for d in range(3)]
    )


def at_point(jnp: Any, slope: Array, x: Any, u: Any) -> Any:
    """Return the share of one Gauss point in the forces of all cells, shape ``(8, 3, cells)``."""
    r = range(3)
    J = jnp.tensordot(slope.T, x, 1)  # [j, i]: dx_i / dξ_j
    minors = [jnp.cross(J[(j + 1) % 3], J[(j + 2) % 3], axis=0) for j in r]
    det = (J[0] * minors[0]).sum(0)
    inverse = jnp.stack(minors) / det  # [j, i]: dξ_j / dx_i
    H = jnp.tensordot(slope.T, u, 1)
    F = [[sum(H[j, a] * inverse[j, i] for j in r) + (a == i) for i in r] for a in r]
    E = [[(sum(F[k][i] * F[k][j] for k in r) - (i == j)) / 2 for j in r] for i in r]
    pressure = LMBDA * (E[0][0] + E[1][1] + E[2][2])
    S = [[2 * MU * E[i][j] + (pressure if i == j else 0.0) for j in r] for i in r]
    P = [[sum(F[a][k] * S[k][j] for k in r) for j in r] for a in r]
    volume = det / 8
    flow = [[sum(P[a][i] * inverse[j, i] for i in r) * volume for a in r] for j in r]
    return jnp.tensordot(slope, jnp.stack([jnp.stack(row) for row in flow]), 1)


if __name__ == "__main__":
    if hasattr(os, "sched_setaffinity"):  # JAX takes every core that it may
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    print(json.dumps(measure(*map(int, sys.argv[1:]))))
