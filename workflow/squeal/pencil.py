# SPDX-License-Identifier: LGPL-3.0-or-later
"""Small motions about steady sliding: ``M ü + (C + C_f) u̇ + (K + K_f) u = 0``.

K is the tangent of the internal forces at the deformed shape, geometric part included, with the
springs of track, vehicle and contact; C that of material and mass damping, dampers and dashpots.
K_f and C_f come from friction, see :mod:`contact.sliding`; K_f is not symmetric. M is the lumped
mass of the run. All are written in free motions y with ``u = T y`` and ``Tᵀ M T = 1``, so held
directions are gone and point masses are dofs like others.

Left out: convection and gyroscopic forces where bodies turn or travel past the contact, bulk
viscosity, loads that follow the surface, and items of one's own.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from dolfinx.fem.petsc import assemble_matrix
from scipy.sparse import block_diag, csr_array, diags_array

from contact.tangent import relative_rows
from forms.kernel import compiled
from forms.loads import MassDamping
from meshes.arrays import Array, Index
from meshes.domain import Domain
from workflow.model import Model
from workflow.simulation.elastic import DIFFERENT, elastic_stiffness
from workflow.squeal.sliding import Face

Triplets = tuple[Index, Index, Array]
Complex = npt.NDArray[np.complex128]

# petsc4py's stubs know plain lists and take this number for something else
SYMMETRIC: Any = PETSc.Mat.Option.SYMMETRIC


@dataclass(frozen=True, eq=False)
class Pencil:
    """Matrices of small motions, of mass one.

    Attributes:
        domain: The mesh.
        K, C: Without friction, symmetric [1/s²], [1/s].
        K_f, C_f: What friction adds.
        T: Motion of the dofs of this rank, owned nodes and then point masses, by free motions.
        faces: The contacts.
    """

    domain: Domain
    K: PETSc.Mat
    C: PETSc.Mat
    K_f: PETSc.Mat
    C_f: PETSc.Mat
    T: csr_array
    faces: list[Face]

    @property
    def comm(self) -> MPI.Comm:
        """Ranks that share it."""
        return self.domain.msh.comm

    @property
    def size(self) -> int:
        """Number of free motions on all ranks."""
        return int(self.K.getSize()[0])

    def shape(self, y: Complex) -> Complex:
        """Return a motion by HexMesh node on rank 0, shape ``(n, 3)``; collective."""
        u = (self.T @ y)[: 3 * self.domain.owned]
        return self.domain.gather(u.real) + 1j * self.domain.gather(u.imag)


def pencil(model: Model, faces: list[Face]) -> Pencil:
    """Return the matrices of small motions of a model in steady sliding; collective."""
    domain, comm = model.domain, model.domain.msh.comm
    first = domain.V.dofmap.index_map.local_range[0]
    number = first + np.arange(domain.owned)
    points = free_points(model)
    stiff, damped = [triplets(elastic_stiffness(model, model.state.u))], []
    if any(body.stiffness_damping for body in model.scene.bodies.values()):
        damped.append(triplets(damping_of_bodies(model)))
    rows = (3 * number[:, None] + np.arange(3)).ravel()
    damped += [(rows, rows, item.nodal) for item in model.items if isinstance(item, MassDamping)]
    if model.connections is not None:
        total = 3 * domain.V.dofmap.index_map.size_global
        springs, dampers = model.connections.tangent(number, total)
        stiff.append(springs)
        damped.append(dampers)
    place = numbers_of(domain, number)
    at_contacts = [contact_parts(face, place) for face in faces] if comm.rank == 0 else []
    parts = [stiff, damped, [], []]
    for found in at_contacts:
        for part, entries in zip(parts, found, strict=True):
            part.append(entries)
    T = free_motions(model, points)
    last = len(points) if comm.rank == comm.size - 1 else 0
    local = 3 * domain.owned + last
    basis = local_matrix(comm, T)
    K, C, K_f, C_f = (assembled(comm, local, part).PtAP(basis) for part in parts)
    for symmetric in (K, C):
        symmetric.setOption(SYMMETRIC, True)
    return Pencil(domain, K, C, K_f, C_f, T, faces)


def damping_of_bodies(model: Model) -> PETSc.Mat:
    """Assembled stiffness-proportional damping at the deformed shape, [N s/m]."""
    V, u = model.domain.V, model.state.u
    v, w = fem.Function(V), ufl.TestFunction(V)
    work = model.bodies.internal_work(u, w, v)
    C = assemble_matrix(compiled(ufl.derivative(work, v, ufl.TrialFunction(V))))
    C.assemble()
    return C


def triplets(A: PETSc.Mat) -> Triplets:
    """Return the entries of this rank's rows: global rows, columns and values."""
    csr: Any = A.getValuesCSR()
    start, columns, values = csr
    rows = A.getOwnershipRange()[0] + np.repeat(np.arange(len(start) - 1), np.diff(start))
    return rows, columns, values


def numbers_of(domain: Domain, number: Index) -> Index:
    """Return the global dof block of every HexMesh node, on all ranks."""
    whole = np.zeros(len(domain.source.points), dtype=np.int64)
    whole[domain.nodes[: domain.owned]] = number
    domain.msh.comm.Allreduce(MPI.IN_PLACE, whole)
    return whole


def contact_parts(face: Face, place: Index) -> list[Triplets]:
    """Return what a face adds to K, C, K_f and C_f.

    Args:
        face: The face.
        place: Global dof block of each HexMesh node.
    """
    c = face.contacts
    nodes = np.unique(c.nodes[c.nodes >= 0])
    n, t, b = rows_of(face, nodes)
    k, damper, pull = (diags_array(x) for x in (c.stiffness, c.damper, c.steepness))
    stuck, turning = diags_array(c.tangential), diags_array(c.turning)
    slope = diags_array(c.normal_force * c.slope)
    number = (3 * place[nodes][:, None] + np.arange(3)).ravel()
    matrices = (
        n.T @ k @ n + t.T @ stuck @ t + b.T @ stuck @ b,
        n.T @ damper @ n,
        -(t.T @ pull @ k @ n),
        t.T @ slope @ t + b.T @ turning @ b - t.T @ pull @ damper @ n,
    )
    return [(number[A.row], number[A.col], A.data) for A in (A.tocoo() for A in matrices)]


def rows_of(face: Face, nodes: Index) -> tuple[csr_array, csr_array, csr_array]:
    """Return the relative motions of a face along n, t and b by those of ``nodes``, ascending."""
    c = face.contacts
    n, t, b = (relative_rows(c.nodes, c.weight, d, nodes) for d in (c.normal, c.along, c.across))
    return n, t, b


def free_points(model: Model) -> Array:
    """Return the mass of each component of point masses that moves, shape ``(k,)`` [kg]."""
    if model.connections is None:
        return np.zeros(0)
    masses = model.connections.masses
    return np.repeat(masses.mass, 3)[masses.free.ravel() > 0]


def free_motions(model: Model, points: Array) -> csr_array:
    """Return the motion of this rank's dofs by its free motions of mass one.

    Args:
        model: The model.
        points: Mass of each free component of point masses, which the last rank has [kg].
    """
    owned, comm = model.domain.owned, model.domain.msh.comm
    held = np.zeros((owned, 3, 3))
    for dofs, n in zip(model.supports.dofs, model.supports.directions, strict=True):
        held[dofs] += np.outer(n, n)
    size, direction = np.linalg.eigh(held)
    per_root = 1 / np.sqrt(model.mass.array[: 3 * owned : 3])
    blocks = per_root[:, None, None] * np.where(np.abs(direction) < 1e-12, 0.0, direction)
    row = np.broadcast_to(np.arange(3 * owned).reshape(owned, 3, 1), blocks.shape)
    column = np.full((owned, 3), -1)
    free = size < 1e-9
    column[free] = np.arange(free.sum())
    column = np.broadcast_to(column[:, None, :], blocks.shape)
    kept = (column >= 0) & (blocks != 0.0)
    entries = blocks[kept], (row[kept], column[kept])
    T = csr_array(entries, shape=(3 * owned, int(free.sum())))
    if comm.rank == comm.size - 1 and len(points):
        T = block_diag([T, diags_array(1 / np.sqrt(points))]).tocsr()
    return csr_array(T)


def local_matrix(comm: MPI.Comm, T: csr_array) -> PETSc.Mat:
    """Return a matrix whose blocks of the ranks are these."""
    first = sum(comm.allgather(T.shape[1])[: comm.rank])
    start, columns = (x.astype(PETSc.IntType) for x in (T.indptr, T.indices + first))
    A: Any = PETSc.Mat()
    sizes = (T.shape[0], None), (T.shape[1], None)
    return A.createAIJ(sizes, csr=(start, columns, T.data), comm=comm)


def assembled(comm: MPI.Comm, local: int, parts: Iterable[Triplets]) -> PETSc.Mat:
    """Return the sum of entries as a matrix; collective.

    Args:
        comm: Ranks.
        local: Number of this rank's rows.
        parts: Global rows, columns and values; of any rank.
    """
    none = np.zeros(0, dtype=np.int64)
    rows, columns, values = map(np.concatenate, zip((none, none, np.zeros(0)), *parts, strict=True))
    A: Any = PETSc.Mat()
    A.create(comm)
    A.setSizes(((local, None), (local, None)))
    A.setType("aij")
    A.setPreallocationCOO(rows.astype(PETSc.IntType), columns.astype(PETSc.IntType))
    A.setValuesCOO(values)
    return A


def times(A: PETSc.Mat, rows: Array, *, transposed: bool = False) -> Array:
    """Return the products of a square matrix, or its transpose, with vectors, a row each."""
    x, y = A.createVecRight(), A.createVecLeft()
    out = np.empty_like(rows)
    multiply = A.multTranspose if transposed else A.mult
    for k, row in enumerate(rows):
        x.array[:] = row
        multiply(x, y)
        out[k] = y.array_r
    return out


def summed(A: PETSc.Mat, B: PETSc.Mat, scale: float) -> PETSc.Mat:
    """Return ``scale (A + B)``."""
    out = A.copy()
    out.axpy(1.0, B, structure=DIFFERENT)
    out.scale(scale)
    return out
