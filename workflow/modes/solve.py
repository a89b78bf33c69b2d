# SPDX-License-Identifier: LGPL-3.0-or-later
"""Natural frequencies of an interval, all of them: shift and invert on slices of the spectrum.

With the lumped mass the problem is a standard one, ``M^-1/2 K M^-1/2 y = ω² y``. By Sylvester's law
the negative pivots of a factorised ``A - σ`` count the eigenvalues below σ, so SLEPc knows how many
there are between two shifts and looks until it has them all.
"""

from dataclasses import dataclass
from typing import Any

from petsc4py import PETSc
from slepc4py import SLEPc

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from dolfinx.fem.petsc import assemble_matrix

from forms.kernel import compiled
from meshes.arrays import Array
from meshes.domain import Domain
from workflow.model.bodies import Bodies
from workflow.scene.scene import SceneError

# petsc4py's stubs take this number for something else
SYMMETRIC: Any = PETSc.Mat.Option.SYMMETRIC

BELOW = 10.0  # Hz: rigid motion comes out within this of zero
TOLERANCE = 1e-10  # of an eigenvalue
# controls of MUMPS without which it does not count pivots: the root in one piece, null ones found
COUNTING = {13: 1, 24: 1}


@dataclass(frozen=True)
class Spectrum:
    """All modes of an interval.

    Attributes:
        frequencies: Ascending, shape ``(k,)`` [Hz].
        shapes: Of each, on the owned dofs of this rank, ``φᵀ M φ = 1``, shape ``(k, owned, 3)``.
        mass: Lumped mass of the owned nodes, shape ``(owned,)`` [kg].
        counted: How many there are by the inertia of the shifted matrices.
    """

    frequencies: Array
    shapes: Array
    mass: Array
    counted: int


def stiffness(bodies: Bodies) -> PETSc.Mat:
    """Return the assembled stiffness at the undeformed shape [N/m]."""
    V = bodies.domain.V
    u, w = fem.Function(V), ufl.TestFunction(V)
    tangent = ufl.derivative(bodies.internal_work(u, w), u, ufl.TrialFunction(V))
    K = assemble_matrix(compiled(tangent))
    K.assemble()
    return K


def nodal_mass(bodies: Bodies) -> Array:
    """Return the lumped mass of the owned nodes, shape ``(owned,)`` [kg]."""
    return bodies.lumped_mass()[::3][: bodies.domain.owned]


def spectrum(
    domain: Domain, K: PETSc.Mat, mass: Array, held: npt.NDArray[np.int32], top: float, most: int
) -> Spectrum:
    """Return all modes from rest to a frequency.

    Args:
        domain: The mesh.
        K: Stiffness [N/m].
        mass: Lumped mass of the owned nodes, shape ``(owned,)`` [kg].
        held: Owned scalar dofs that do not move.
        top: Highest frequency [Hz].
        most: How many modes are accepted.

    Raises:
        SceneError: if there is none, or more than ``most``.
    """
    free = np.setdiff1d(np.arange(3 * domain.owned), held)
    scale = 1 / np.sqrt(np.repeat(mass, 3)[free])
    A = scaled(K, free, scale)
    bounds = -((2 * np.pi * BELOW) ** 2), (2 * np.pi * top) ** 2
    check_count(A, bounds, top, most)
    values, vectors, counted = within(A, bounds)
    shapes = np.zeros((len(values), 3 * domain.owned))
    shapes[:, free] = vectors * scale
    frequencies = np.sqrt(np.maximum(values, 0.0)) / (2 * np.pi)
    return Spectrum(frequencies, shapes.reshape(len(values), -1, 3), mass, counted)


def within(A: PETSc.Mat, bounds: tuple[float, float]) -> tuple[Array, Array, int]:
    """Return all eigenvalues of a symmetric matrix in an interval.

    Args:
        A: The matrix.
        bounds: The interval.

    Returns:
        Eigenvalues, ascending; of each the part of its unit vector on this rank, shape ``(k, n)``;
        how many there are by inertia.
    """
    eps = solver(A, bounds)
    eps.solve()
    _, inertias = eps.getKrylovSchurInertias()
    found, counted = eps.getConverged(), int(inertias[-1] - inertias[0])
    y = A.createVecRight()
    values, vectors = np.zeros(found), np.zeros((found, y.getLocalSize()))
    for k in range(found):
        values[k] = eps.getEigenpair(k, y).real
        vectors[k] = y.array_r
    eps.destroy()
    order = np.argsort(values)
    return values[order], vectors[order], counted


def scaled(K: PETSc.Mat, free: npt.NDArray[Any], scale: Array) -> PETSc.Mat:
    """Return the rows and columns of the free dofs, each divided by the root of its mass."""
    comm = K.getComm()
    rows: Any = (free + K.getOwnershipRange()[0]).astype(PETSc.IntType)
    kept = PETSc.IS().createGeneral(rows, comm=comm)
    A = K.createSubMatrix(kept, kept)
    d = A.createVecRight()
    d.array[:] = scale
    A.diagonalScale(d, d)
    A.setOption(SYMMETRIC, True)
    return A


def check_count(A: PETSc.Mat, bounds: tuple[float, float], top: float, most: int) -> None:
    """Refuse an interval with no mode or too many, before any is looked for."""
    count = below(A, bounds[1]) - below(A, bounds[0])
    if count == 0:
        raise SceneError(f"--to {top:g}: no mode up to {top:g} Hz; expected a higher frequency")
    if count > most:
        raise SceneError(
            f"--to {top:g}: {count} modes up to {top:g} Hz; expected at most {most}, see --most"
        )


def below(A: PETSc.Mat, shift: float) -> int:
    """Return how many eigenvalues of a symmetric matrix lie below a shift: its negative pivots."""
    B = A.copy()
    B.shift(-shift)
    B.setOption(SYMMETRIC, True)
    pc = PETSc.PC().create(A.getComm())
    pc.setOperators(B)
    direct(pc)
    factors = pc.getFactorMatrix()
    for key, value in COUNTING.items():
        factors.setMumpsIcntl(key, value)
    pc.setUp()
    count = int(pc.getFactorMatrix().getInertia()[0])
    pc.destroy()
    B.destroy()
    return count


def direct(pc: PETSc.PC) -> None:
    """Make a preconditioner a symmetric factorisation by MUMPS."""
    pc.setType("cholesky")
    pc.setFactorSolverType("mumps")
    pc.setFactorSetUpSolverType()


def solver(A: PETSc.Mat, bounds: tuple[float, float]) -> Any:
    """Return Krylov-Schur with spectrum slicing on an interval of eigenvalues [1/s²]."""
    eps = SLEPc.EPS().create(A.getComm())
    eps.setOperators(A)
    eps.setProblemType(SLEPc.EPS.ProblemType.HEP)
    eps.setType(SLEPc.EPS.Type.KRYLOVSCHUR)
    eps.setWhichEigenpairs(SLEPc.EPS.Which.ALL)
    eps.setInterval(*bounds)
    eps.setTolerances(TOLERANCE)
    # the KSP of the ST itself is not the one that slices the spectrum
    ksp = eps.getKrylovSchurKSP()
    ksp.setType("preonly")
    pc = ksp.getPC()
    pc.setType("cholesky")
    pc.setFactorSolverType("mumps")
    for key, value in COUNTING.items():  # its factors do not exist yet: by options only
        PETSc.Options().setValue(f"{ksp.getOptionsPrefix()}mat_mumps_icntl_{key}", value)
    return eps
