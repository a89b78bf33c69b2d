# SPDX-License-Identifier: LGPL-3.0-or-later
"""Complex eigenvalues of small motions about sliding, ``(λ² + λ C + K) y = 0``, by two roads.

``full`` takes the matrices as they are: SLEPc's two-level Arnoldi method for quadratic problems,
inverted at a positive real shift, whose nearest eigenvalues are the slowest ones. ``projection``
takes the motion to be a sum of real modes without friction and of the deflections under forces at
the contacts. It is a small dense problem for any friction, and right as far as these shapes reach.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc
from slepc4py import SLEPc

import numpy as np
from scipy.linalg import eig, eigvals

from meshes.arrays import Array, Flags, Index
from workflow.modes.solve import BELOW, below, direct, within
from workflow.scene.scene import SceneError
from workflow.squeal.pencil import SYMMETRIC, Complex, Pencil, rows_of, summed, times
from workflow.squeal.sliding import Face

TOLERANCE = 1e-10  # of an eigenvalue
LOWER = 0.7  # frequency over one up to which there are too many modes
SHIFT = 0.5  # over the highest frequency
MORE = 10  # eigenvalues that are looked for besides those that a frictionless contact has
WIDER = 1.1  # reach of what is found over what is asked: growing modes lie aside
BEYOND = 1.3  # highest frequency of the real modes over that asked for
REFINED = 1e-8  # residual of a mode on the full matrices
STEPS = 40  # of Davidson's method
ALIKE = 1e-10  # share of a shape that others do not have, below which it is left out


@dataclass(frozen=True, eq=False)
class Eigen:
    """Eigenvalues with ``Im λ ≥ 0``, by frequency.

    Attributes:
        values: λ, growth rate and angular frequency, shape ``(k,)`` [1/s].
        shapes: Of each, the part of its vector on this rank, of unit length, shape ``(k, n)``.
        residuals: Length of ``(λ² + λ C + K) y`` over ``|λ|²``, shape ``(k,)``.
    """

    values: Complex
    shapes: Complex
    residuals: Array


def check_count(pencil: Pencil, top: float, most: int) -> int:
    """Return how many modes there are without friction up to a frequency [Hz].

    Raises:
        SceneError: if it is none, or more than ``most``.
    """
    count = below(pencil.K, (2 * np.pi * top) ** 2)
    if count == 0:
        raise SceneError(f"--to {top:g}: no mode up to {top:g} Hz; expected a higher frequency")
    if count > most:
        raise SceneError(
            f"--to {top:g}: {count} modes up to {top:g} Hz; expected at most {most}, see --most"
        )
    return count


def fewer(pencil: Pencil, top: float, most: int) -> float:
    """Return a frequency, lower where there are too many modes up to it [Hz]."""
    while below(pencil.K, (2 * np.pi * top) ** 2) > most:
        top *= LOWER
    return top


def full(pencil: Pencil, top: float, count: int) -> Eigen:
    """Return the eigenvalues up to a frequency from the full matrices.

    Args:
        pencil: The matrices.
        top: Highest frequency [Hz].
        count: How many modes there are without friction.
    """
    reach = 2 * np.pi * top
    matrices = [(pencil.K, pencil.K_f, reach**2), (pencil.C, pencil.C_f, reach)]
    K, C = (summed(A, B, 1 / scale) for A, B, scale in matrices)
    wanted, size = 2 * count + MORE, 2 * pencil.size
    while True:
        pep = solver(K, C, min(wanted, size))
        pep.solve()
        found = [read(pep, k, reach) for k in range(pep.getConverged())]
        farthest = max((abs(value / reach - SHIFT) for value, _ in found), default=0.0)
        if wanted >= size or farthest > WIDER * np.hypot(1.0, SHIFT):
            break
        wanted *= 2
        pep.destroy()
    pep.destroy()
    values = np.array([value for value, _ in found])
    shapes = np.array([shape for _, shape in found])
    return sorted_upper(pencil, values, shapes)


def solver(K: PETSc.Mat, C: PETSc.Mat, wanted: int) -> Any:
    """Return the solver of the quadratic problem for the eigenvalues next to the shift."""
    unit: Any = PETSc.Mat()
    unit.createAIJ(K.getSizes(), nnz=1, comm=K.getComm())
    unit.assemble()
    unit.shift(1.0)
    pep = SLEPc.PEP().create(K.getComm())
    pep.setOperators([K, C, unit])
    pep.setProblemType(SLEPc.PEP.ProblemType.GENERAL)
    pep.setType(SLEPc.PEP.Type.TOAR)
    pep.setTolerances(TOLERANCE)
    pep.setDimensions(wanted)
    pep.setTarget(SHIFT)
    pep.setWhichEigenpairs(SLEPc.PEP.Which.TARGET_MAGNITUDE)
    st = pep.getST()
    st.setType("sinvert")
    ksp = st.getKSP()
    ksp.setType("preonly")
    ksp.getPC().setType("lu")
    ksp.getPC().setFactorSolverType("mumps")
    return pep


def read(pep: Any, k: int, reach: float) -> tuple[complex, Complex]:
    """Return an eigenvalue [1/s] and the part of its vector on this rank."""
    y, z = (pep.getOperators()[0].createVecRight() for _ in range(2))
    value = pep.getEigenpair(k, y, z)
    return complex(value) * reach, y.array_r + 1j * z.array_r


def sorted_upper(pencil: Pencil, values: Complex, shapes: Complex) -> Eigen:
    """Return the pairs with ``Im λ ≥ 0`` by frequency, with unit vectors and their residuals."""
    kept = np.flatnonzero(values.imag >= 0.0)
    kept = kept[np.lexsort([values.real[kept], values.imag[kept]])]
    values, shapes = values[kept], shapes[kept]
    square = pencil.comm.allreduce((np.abs(shapes) ** 2).sum(axis=1))
    shapes = shapes / np.sqrt(square)[:, None]
    return Eigen(values, shapes, residuals(pencil, values, shapes))


def residuals(pencil: Pencil, values: Complex, shapes: Complex) -> Array:
    """Return the lengths of ``(λ² + λ C + K) y`` over ``|λ|²``, shape ``(k,)``; collective."""
    square = (np.abs(defects(pencil, values, shapes)) ** 2).sum(axis=1)
    return np.asarray(
        np.sqrt(pencil.comm.allreduce(square)) / np.maximum(np.abs(values) ** 2, 1e-300)
    )


def defects(pencil: Pencil, values: Complex, shapes: Complex) -> Complex:
    """Return ``(λ² + λ C + K) y`` of each pair, the part on this rank, shape ``(k, n)``."""
    left = values[:, None] ** 2 * shapes
    for A, factor in (
        (pencil.K, 1.0),
        (pencil.K_f, 1.0),
        (pencil.C, values[:, None]),
        (pencil.C_f, values[:, None]),
    ):
        left = left + factor * (times(A, shapes.real) + 1j * times(A, shapes.imag))
    return np.asarray(left)


@dataclass(frozen=True, eq=False)
class Projection:
    """Small motions in few shapes, for any friction.

    Attributes:
        pencil: The full matrices.
        V: Orthonormal shapes, the part of this rank, shape ``(r, n)``.
        K, C, K_f, C_f: The matrices in these shapes, shape ``(r, r)``.
    """

    pencil: Pencil
    V: Array
    K: Array
    C: Array
    K_f: Array
    C_f: Array

    def values(self, share: float) -> Complex:
        """Return all eigenvalues with so much of the friction, shape ``(2 r,)`` [1/s].

        Args:
            share: What the coefficients of friction are over those of the scene.
        """
        companion, scale = self._companion(share)
        return np.asarray(eigvals(companion) * scale)

    def _companion(self, share: float) -> tuple[Array, float]:
        """Return the matrix of first order, and the scale of its eigenvalues [1/s]."""
        r, K, C = len(self.V), self.K + share * self.K_f, self.C + share * self.C_f
        scale = float(np.sqrt(np.linalg.norm(K, 2)))
        return np.block([[np.zeros((r, r)), np.eye(r)], [-K / scale**2, -C / scale]]), scale

    def rubbed(self, faces: list[Face]) -> "Projection":
        """Return the same motions with the friction of these contacts; collective."""
        r = len(self.V)
        K_f, C_f = np.zeros((r, r)), np.zeros((r, r))
        for face in faces:
            c = face.contacts
            nodes = np.unique(c.nodes[c.nodes >= 0])
            moves = self._moves(nodes)
            n, t, b = (rows @ moves for rows in rows_of(face, nodes))
            pull, slope = c.steepness[:, None], (c.normal_force * c.slope)[:, None]
            K_f -= t.T @ (pull * c.stiffness[:, None] * n)
            C_f += t.T @ (slope * t - pull * c.damper[:, None] * n)
            C_f += b.T @ (c.turning[:, None] * b)
        return replace(self, K_f=K_f, C_f=C_f)

    def widened(self, rows: Array) -> "Projection":
        """Return the projection on more orthonormal shapes, ``(k, n)``; collective."""
        V, comm = np.vstack([self.V, rows]), self.pencil.comm

        def wider(A: PETSc.Mat, own: Array) -> Array:
            right = comm.allreduce(V @ times(A, rows).T)
            left = comm.allreduce(times(A, rows, transposed=True) @ self.V.T)
            return np.block([[np.vstack([own, left]), right]])

        p = self.pencil
        pairs = ((p.K, self.K), (p.C, self.C), (p.K_f, self.K_f), (p.C_f, self.C_f))
        return Projection(p, V, *(wider(A, own) for A, own in pairs))

    def _moves(self, nodes: Index) -> Array:
        """Return how HexMesh nodes move in each shape, on all ranks, shape ``(3 k, r)``."""
        dofs = self.pencil.domain.local_dofs(nodes)
        own = dofs >= 0
        rows = (3 * dofs[own][:, None] + np.arange(3)).ravel()
        whole = np.zeros((3 * len(nodes), len(self.V)))
        whole[np.repeat(own, 3)] = self.pencil.T[rows] @ self.V.T
        return np.asarray(self.pencil.comm.allreduce(whole))

    def eigen(self, top: float) -> Eigen:
        """Return the eigenvalues up to a frequency [Hz] with the friction of the scene."""
        comm = self.pencil.comm
        companion, scale = self._companion(1.0)
        values, vectors = comm.bcast(eig(companion))  # to the last digit the same on all ranks
        values, vectors = values * scale, vectors[: len(self.V)]
        kept = np.abs(values) < WIDER * 2 * np.pi * top
        return sorted_upper(self.pencil, values[kept], vectors[:, kept].T @ self.V)

    def nearest(self, value: complex) -> Eigen:
        """Return the mode next to an eigenvalue [1/s] with the friction of the scene."""
        companion, scale = self._companion(1.0)
        values, vectors = self.pencil.comm.bcast(eig(companion))
        k = [int(np.argmin(np.abs(values * scale - value)))]
        return sorted_upper(self.pencil, values[k] * scale, vectors[: len(self.V), k].T @ self.V)


def projection(pencil: Pencil, top: float) -> Projection:
    """Return the projection on real modes and contact modes for frequencies to ``top`` [Hz]."""
    bounds = -((2 * np.pi * BELOW) ** 2), (2 * np.pi * BEYOND * top) ** 2
    _, modes, _ = within(pencil.K, bounds)
    # of K + ω², so that bodies that nothing holds deflect as well
    return spanned(pencil, modes, contact_modes(pencil, inverse(pencil.K, (2 * np.pi * top) ** 2)))


def spanned(pencil: Pencil, *shapes: Array) -> Projection:
    """Return the projection on the span of shapes, rows of the parts on this rank; collective."""
    V = orthonormal(pencil.comm, np.vstack(shapes))
    matrices = (pencil.K, pencil.C, pencil.K_f, pencil.C_f)
    return Projection(
        pencil, V, *(np.asarray(pencil.comm.allreduce(V @ times(A, V).T)) for A in matrices)
    )


def refined(pencil: Pencil, eigen: Eigen, chosen: Flags) -> Eigen:
    """Return modes of a projection brought to convergence on the full matrices; collective.

    Davidson's method (E. R. Davidson, J. Comput. Phys. 17, 87-94, 1975) for each chosen mode alone:
    its shape and the contact modes at its own frequency, then what ``(K − ω²)⁻¹`` makes of the
    residual. Friction and contact dampers are forces on these contacts, so few steps do.

    Args:
        pencil: The full matrices.
        eigen: Modes of a projection.
        chosen: Which of them, shape ``(k,)``.
    """
    values, shapes, left = eigen.values.copy(), eigen.shapes.copy(), eigen.residuals.copy()
    for k in np.flatnonzero(chosen):
        solve = inverse(pencil.K, -(values[k].imag ** 2))
        few = spanned(pencil, *parts_of(shapes[k]), contact_modes(pencil, solve))
        for _ in range(STEPS):
            found = few.nearest(values[k])
            values[k], shapes[k], left[k] = found.values[0], found.shapes[0], found.residuals[0]
            if left[k] < REFINED:
                break
            (left_over,) = defects(pencil, found.values, found.shapes)
            more = np.vstack([solve(part) for part in parts_of(left_over)])
            few = few.widened(besides(pencil.comm, few.V, more))
    return Eigen(values, shapes, left)


def parts_of(y: Complex) -> tuple[Array, Array]:
    """Return the real and the imaginary part as rows, shape ``(1, n)`` each."""
    return y.real[None], y.imag[None]


def besides(comm: MPI.Comm, V: Array, rows: Array) -> Array:
    """Return an orthonormal basis of what rows have besides orthonormal ones; collective."""
    for _ in range(2):  # most of them is in V
        rows = orthonormal(comm, rows - comm.allreduce(rows @ V.T) @ V)
    return rows


def inverse(K: PETSc.Mat, shift: float) -> Callable[[Array], Array]:
    """Return what solves ``(K + shift) x = y`` for rows y of the parts on this rank; collective."""
    A = K.copy()
    A.shift(shift)
    A.setOption(SYMMETRIC, True)
    pc = PETSc.PC().create(A.getComm())
    pc.setOperators(A)
    direct(pc)
    pc.setUp()
    x, y = A.createVecRight(), A.createVecLeft()

    def solve(rows: Array) -> Array:
        out = np.empty_like(rows)
        for row, found in zip(rows, out, strict=True):
            x.array[:] = row
            pc.apply(x, y)
            found[:] = y.array_r
        return out

    return solve


def contact_modes(pencil: Pencil, solve: Callable[[Array], Array]) -> Array:
    """Return the deflections under unit forces along n, t and b of every contact, ``(3 m, n)``.

    Args:
        pencil: The matrices.
        solve: What a stiffness makes of forces, see :func:`inverse`.
    """
    domain, out = pencil.domain, []
    for face in pencil.faces:
        nodes = np.unique(face.contacts.nodes[face.contacts.nodes >= 0])
        dofs = domain.local_dofs(nodes)
        own = (3 * dofs[dofs >= 0][:, None] + np.arange(3)).ravel()
        for rows in rows_of(face, nodes):
            force = np.zeros((rows.shape[0], pencil.T.shape[0]))
            force[:, own] = rows.toarray()[:, np.repeat(dofs >= 0, 3)]
            out.append(force @ pencil.T)
    return solve(np.vstack(out))


def orthonormal(comm: MPI.Comm, shapes: Array) -> Array:
    """Return an orthonormal basis of shapes, rows of the parts on this rank; collective."""
    for _ in range(2):  # the second time for what round-off has left
        size = np.sqrt(comm.allreduce((shapes**2).sum(axis=1)))
        shapes = shapes[size > 0.0] / size[size > 0.0, None]  # none where all is held
        gram = comm.allreduce(shapes @ shapes.T)
        values, vectors = comm.bcast(np.linalg.eigh(gram))
        kept = values > ALIKE * values[-1]
        shapes = (vectors[:, kept] / np.sqrt(values[kept])).T @ shapes
    return np.asarray(shapes)
