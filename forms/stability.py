# SPDX-License-Identifier: LGPL-3.0-or-later
"""The largest stable step of central difference, from the scene's own forms."""

from collections.abc import Callable
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem, la
from scipy.linalg import eigh_tridiagonal

from forms.kernel import Array, CellKernel

CHUNK = 4096  # cells whose 24×24 eigenproblems are solved at once


def cell_frequency(
    V: Any, residual: Callable[[Any, Any], Any], mass: Callable[[Any], Any]
) -> float:
    """Return the largest eigenfrequency of any single cell, an upper bound of ω_max [rad/s].

    The assembled eigenvalues are bounded by those of the cells (Irons and Treharne, 1971; Hughes,
    The Finite Element Method, section 9.3). The cell matrices come from the given forms themselves,
    written on the broken (discontinuous) space, where assembly is cell by cell. A cell is solved
    only if its Frobenius norm, an upper bound of its largest eigenvalue, can still win.

    Args:
        V: Vector P1 space whose mesh is used.
        residual: ``residual(u, w)``, the rank-1 form of the internal forces.
        mass: ``mass(w)``, the rank-1 form whose vector is the lumped mass.

    Returns:
        The largest frequency over all ranks [rad/s].
    """
    broken = fem.functionspace(V.mesh, ("DG", 1, (3,)))
    u, direction, w = fem.Function(broken), fem.Function(broken), ufl.TestFunction(broken)
    kernel = CellKernel(ufl.derivative(residual(u, w), u, direction))
    owned = V.mesh.topology.index_map(3).size_local
    dofs = (3 * broken.dofmap.list[:owned, :, None] + np.arange(3)).reshape(owned, 24)
    m = np.zeros_like(direction.x.array)
    CellKernel(mass(w)).add(m)
    scale = 1 / np.sqrt(np.where(m > 0, m, 1.0))

    def column(j: int) -> Array:
        """Column j of M^(-1/2) K M^(-1/2) of every owned cell, shape ``(owned, 24)``."""
        direction.x.array[:] = 0.0
        direction.x.array[dofs[:, j]] = scale[dofs[:, j]]
        out = np.zeros_like(scale)
        kernel.add(out)
        return (scale * out)[dofs]

    norm = np.sqrt(
        sum((np.einsum("ci,ci->c", c, c) for c in map(column, range(24))), np.zeros(owned))
    )
    first = np.argsort(-norm)[:CHUNK]
    best = _largest(first, column)
    best = max(best, _largest(np.setdiff1d(np.flatnonzero(norm > best), first), column))
    return float(np.sqrt(V.mesh.comm.allreduce(best, op=MPI.MAX)))


def _largest(cells: npt.NDArray[np.int64], column: Callable[[int], Array]) -> float:
    """Largest eigenvalue of the given cells."""
    matrices = np.stack([column(j)[cells] for j in range(24)], axis=2)
    chunks = (matrices[i : i + CHUNK] for i in range(0, len(cells), CHUNK))
    return max(
        (float(np.linalg.eigvalsh((A + A.transpose(0, 2, 1)) / 2).max()) for A in chunks),
        default=0.0,
    )


def assembled_frequency(
    V: Any,
    residual: Callable[[Any, Any], Any],
    mass: Array,
    *,
    tolerance: float = 1e-3,
    iterations: int = 300,
) -> tuple[float, bool]:
    """Return the largest eigenfrequency of the assembled system [rad/s], and if it converged.

    Lanczos on ``M^(-1/2) K M^(-1/2)`` with the kernel of the residual linearised at rest.
    The value is the Ritz value plus its residual norm, which bounds how far an eigenvalue can be
    above it (Parlett, The Symmetric Eigenvalue Problem, theorem 4.5.1); it has converged when the
    residual is below ``tolerance`` of the value. Supports, which only lower it, are left out.

    Args:
        V: Vector P1 space.
        residual: ``residual(u, w)``, the rank-1 form of the internal forces.
        mass: Lumped mass of every local dof, shape ``(3 * n_local,)`` [kg].
        tolerance: Largest relative residual.
        iterations: Most Lanczos steps.
    """
    u, direction, w = fem.Function(V), fem.Function(V), ufl.TestFunction(V)
    kernel = CellKernel(ufl.derivative(residual(u, w), u, direction))
    out = la.vector(V.dofmap.index_map, V.dofmap.bs)
    n = V.dofmap.bs * V.dofmap.index_map.size_local
    scale, comm = 1 / np.sqrt(mass[:n]), V.mesh.comm

    def dot(a: Array, b: Array) -> float:
        return float(comm.allreduce(float(np.einsum("i,i", a, b))))

    def apply(q: Array) -> Array:
        direction.x.array[:n] = scale * q
        direction.x.scatter_forward()
        out.array[:] = 0.0
        kernel.add(out)
        out.scatter_reverse(la.InsertMode.add)
        return np.asarray(scale * out.array[:n])

    return _lanczos(apply, dot, _start(V, n), tolerance, iterations)


def _start(V: Any, n: int) -> Array:
    """Return a start vector that no cell is blind to and that is alike on any number of ranks."""
    x = V.tabulate_dof_coordinates()[: n // 3]
    size = V.mesh.comm.allreduce(float(np.abs(x).max(initial=0.0)), op=MPI.MAX) or 1.0
    phase = x @ np.array([12.9898, 78.233, 37.719]) / size * 1e3
    return np.sin(phase[:, None] + np.array([0.0, 2.0, 4.0])).ravel()


def _lanczos(
    apply: Callable[[Array], Array],
    dot: Callable[[Array, Array], float],
    q: Array,
    tolerance: float,
    iterations: int,
) -> tuple[float, bool]:
    """Return the root of the largest eigenvalue of a symmetric operator, and its convergence.

    No reorthogonalisation: lost orthogonality only repeats eigenvalues that have converged.
    """
    q = q / np.sqrt(dot(q, q))
    before, beta = np.zeros_like(q), 0.0
    diagonal: list[float] = []
    beside: list[float] = []
    value, error = 0.0, np.inf
    for step in range(1, iterations + 1):
        r = apply(q) - beta * before
        alpha = dot(q, r)
        r -= alpha * q
        diagonal.append(alpha)
        beta = float(np.sqrt(dot(r, r)))
        if step % 5 == 0 or beta == 0.0:
            top = len(diagonal) - 1
            ritz, vector = eigh_tridiagonal(diagonal, beside, select="i", select_range=(top, top))
            value, error = float(ritz[0]), beta * abs(float(vector[-1, 0]))
            if error <= tolerance * value:
                break
        beside.append(beta)
        before, q = q, r / beta
    return float(np.sqrt(value + error)), bool(error <= tolerance * value)


def stable_step(
    frequency: float, stiffness_damping: float = 0.0, mass_damping: float = 0.0
) -> float:
    """Return the critical step of central difference with damping lagged by half a step [s].

    ``dt = 2/ω (√(1 + ζ²) − ζ)`` with ``ζ = β ω / 2 + α / (2 ω)`` (Belytschko, Liu and Moran,
    Nonlinear Finite Elements for Continua and Structures, equation 6.2.14).
    """
    zeta = stiffness_damping * frequency / 2 + mass_damping / (2 * frequency)
    return float(2 / frequency * (np.sqrt(1 + zeta**2) - zeta))
