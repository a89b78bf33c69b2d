# SPDX-License-Identifier: LGPL-3.0-or-later
"""Largest eigenfrequency of cells and of the assembled system, and the stable step."""

from collections.abc import Callable
from typing import Any

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem, la
from scipy.linalg import eigh_tridiagonal

from forms.kernel import CellKernel
from meshes.arrays import Array, Index

CHUNK = 4096  # cells whose 24×24 eigenproblems are solved at once
GROUP = 65536  # cells whose matrices are kept at once, 0.3 GB
RISK = 1e-6  # probability that an assembled frequency is above its bound


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
    owned, column = _columns(V, residual, mass)
    norm = np.sqrt(
        sum((np.einsum("ci,ci->c", c, c) for c in map(column, range(24))), np.zeros(owned))
    )
    first = np.argsort(-norm)[:CHUNK]
    best = _eigenvalues(first, column).max(initial=0.0)
    rest = np.setdiff1d(np.flatnonzero(norm > best), first)
    best = max(best, _eigenvalues(rest, column).max(initial=0.0))
    return float(np.sqrt(V.mesh.comm.allreduce(float(best), op=MPI.MAX)))


def cell_frequencies(
    V: Any, residual: Callable[[Any, Any], Any], mass: Callable[[Any], Any]
) -> Array:
    """Return the largest eigenfrequency of every owned cell, shape ``(owned,)`` [rad/s].

    As :func:`cell_frequency`, which solves only the cells that matter.
    """
    owned, column = _columns(V, residual, mass)
    groups = (np.arange(i, min(i + GROUP, owned)) for i in range(0, owned, GROUP))
    return np.sqrt(np.concatenate([np.zeros(0), *(_eigenvalues(g, column) for g in groups)]))


def _columns(
    V: Any, residual: Callable[[Any, Any], Any], mass: Callable[[Any], Any]
) -> tuple[int, Callable[[int], Array]]:
    """Return the number of owned cells, and column j of M^(-1/2) K M^(-1/2) of each of them."""
    broken = fem.functionspace(V.mesh, ("DG", 1, (3,)))
    u, direction, w = fem.Function(broken), fem.Function(broken), ufl.TestFunction(broken)
    kernel = CellKernel(ufl.derivative(residual(u, w), u, direction))
    owned = V.mesh.topology.index_map(3).size_local
    dofs = (3 * broken.dofmap.list[:owned, :, None] + np.arange(3)).reshape(owned, 24)
    m = np.zeros_like(direction.x.array)
    CellKernel(mass(w)).add(m)
    scale = 1 / np.sqrt(np.where(m > 0, m, 1.0))

    def column(j: int) -> Array:
        direction.x.array[:] = 0.0
        direction.x.array[dofs[:, j]] = scale[dofs[:, j]]
        out = np.zeros_like(scale)
        kernel.add(out)
        return np.asarray((scale * out)[dofs])

    return owned, column


def _eigenvalues(cells: Index, column: Callable[[int], Array]) -> Array:
    """Largest eigenvalue of each of the given cells."""
    matrices = np.stack([column(j)[cells] for j in range(24)], axis=2)
    chunks = (matrices[i : i + CHUNK] for i in range(0, len(cells), CHUNK))
    largest = (np.linalg.eigvalsh((A + A.transpose(0, 2, 1)) / 2)[:, -1] for A in chunks)
    return np.concatenate([np.zeros(0), *largest])


def assembled_frequency(
    V: Any,
    residual: Callable[[Any, Any], Any],
    mass: Array,
    springs: Array | None = None,
    *,
    tolerance: float = 2e-3,
    iterations: int = 300,
) -> tuple[float, bool]:
    """Return a bound of the largest eigenfrequency of the assembled system [rad/s], and if sharp.

    Lanczos on ``M^(-1/2) K M^(-1/2)`` with the kernel of the residual linearised at rest. Neither a
    Ritz value nor its residual tells whether a larger eigenvalue has been missed; a random start
    does: after k steps on n dofs the largest Ritz value is below ``(1 - ε)`` of the eigenvalue with
    a probability of at most ``1.648 √n exp(-√ε (2k - 1))``, whatever the spectrum (Kuczyński and
    Woźniakowski, SIAM J. Matrix Anal. Appl. 13, 1992, 1094–1122). Steps are taken
    until the ε of probability :data:`RISK` allows for the tolerance, and the value is raised by it.

    Supports, which only lower the frequency, are left out.

    Args:
        V: Vector P1 space.
        residual: ``residual(u, w)``, the rank-1 form of the internal forces.
        mass: Lumped mass of every local dof, shape ``(3 * n_local,)`` [kg].
        springs: Stiffness of springs on every local dof whose other ends are held, shape
            ``(3 * n_local,)`` [N/m]; for point masses see :mod:`forms.springs.step_bound`.
        tolerance: How far the value may be above the frequency, relative to it [-].
        iterations: Most Lanczos steps.

    Returns:
        The bound, and whether it is within the tolerance: if the iterations did not suffice it is
        a bound still, but a loose one, infinite after a few steps.
    """
    apply = scaled_stiffness(V, residual, mass, springs)
    value, sharp = largest_eigenvalue(V, apply, tolerance=tolerance, iterations=iterations)
    return float(np.sqrt(value)), sharp


def scaled_stiffness(
    V: Any,
    residual: Callable[[Any, Any], Any],
    mass: Array,
    springs: Array | None = None,
    precision: str = "float64",
) -> Callable[[Array], Array]:
    """Return ``M^(-1/2) K M^(-1/2)`` of the owned dofs at rest, for the mesh as it is when called.

    Arguments as for :func:`assembled_frequency`; ``precision`` is what the cells compute with.
    """
    u, direction, w = fem.Function(V), fem.Function(V), ufl.TestFunction(V)
    kernel = CellKernel(ufl.derivative(residual(u, w), u, direction), precision)
    out = la.vector(V.dofmap.index_map, V.dofmap.bs)
    n = V.dofmap.bs * V.dofmap.index_map.size_local
    scale = 1 / np.sqrt(mass[:n])
    diagonal = 0.0 if springs is None else springs[:n] / mass[:n]

    def apply(q: Array) -> Array:
        direction.x.array[:n] = scale * q
        direction.x.scatter_forward()
        out.array[:] = 0.0
        kernel.add(out)
        out.scatter_reverse(la.InsertMode.add)
        return np.asarray(scale * out.array[:n] + diagonal * q)

    return apply


def largest_eigenvalue(
    V: Any, apply: Callable[[Array], Array], *, tolerance: float, iterations: int = 300
) -> tuple[float, bool]:
    """Return a bound of the largest eigenvalue of a symmetric operator, and if it is sharp.

    Args:
        V: Space whose owned dofs the operator acts on; fixes the random start.
        apply: The operator, positive semidefinite, on this rank's owned dofs, ``(n,)``.
        tolerance: How far the root of the value may be above the true one [-].
        iterations: Most Lanczos steps.

    Returns:
        See :func:`assembled_frequency`, which says why.
    """
    n, comm = V.dofmap.bs * V.dofmap.index_map.size_local, V.mesh.comm

    def dot(a: Array, b: Array) -> float:
        return float(comm.allreduce(float(np.einsum("i,i", a, b))))

    odds = np.log(1.648 * np.sqrt(V.dofmap.bs * V.dofmap.index_map.size_global) / RISK)
    allowed = 1 - (1 + tolerance) ** -2
    needed = int(np.ceil((odds / np.sqrt(allowed) + 1) / 2))
    value, steps = _lanczos(apply, dot, _start(V, n), min(needed, iterations))
    excess = (odds / (2 * steps - 1)) ** 2 if steps else 0.0
    bound = value / (1 - excess) if excess < 1 else np.inf
    return float(bound), bool(excess <= allowed)


def _start(V: Any, n: int) -> Array:
    """Return a normal random vector of the owned dofs that is alike on any number of ranks."""
    geometry, imap = V.mesh.geometry, V.dofmap.index_map
    node = np.empty(imap.size_local + imap.num_ghosts, dtype=np.int64)
    node[V.dofmap.list] = geometry.input_global_indices[geometry.dofmaps[0]]
    everywhere = np.random.default_rng(1).standard_normal((imap.size_global, 3))
    return np.asarray(everywhere[node[: n // 3]].ravel())


def _lanczos(
    apply: Callable[[Array], Array], dot: Callable[[Array, Array], float], q: Array, most: int
) -> tuple[float, int]:
    """Return the largest Ritz value of a symmetric operator and the steps it took.

    No steps if the start vector has been used up, which makes the value exact. Without
    reorthogonalisation: what is lost only repeats eigenvalues that have converged.
    """
    q = q / np.sqrt(dot(q, q))
    before, beta = np.zeros_like(q), 0.0
    diagonal: list[float] = []
    beside: list[float] = []
    exact = False
    while not exact and len(diagonal) < most:
        if diagonal:
            beside.append(beta)
        r = apply(q) - beta * before
        alpha = dot(q, r)
        r -= alpha * q
        diagonal.append(alpha)
        beta = float(np.sqrt(dot(r, r)))
        exact = beta <= 1e-12 * max(diagonal)
        before, q = q, r / (beta or 1.0)
    top = len(diagonal) - 1
    ritz = eigh_tridiagonal(
        diagonal, beside, eigvals_only=True, select="i", select_range=(top,) * 2
    )
    return max(float(ritz[0]), 0.0), 0 if exact else len(diagonal)


def stable_step(
    frequency: float, stiffness_damping: float = 0.0, mass_damping: float = 0.0
) -> float:
    """Return the critical step of central difference with damping lagged by half a step [s].

    ``dt = 2/ω (√(1 + ζ²) − ζ)`` with ``ζ = β ω / 2 + α / (2 ω)`` (Belytschko, Liu and Moran,
    Nonlinear Finite Elements for Continua and Structures, equation 6.2.14).
    """
    zeta = stiffness_damping * frequency / 2 + mass_damping / (2 * frequency)
    return float(2 / frequency * (np.sqrt(1 + zeta**2) - zeta))
