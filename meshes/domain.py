# SPDX-License-Identifier: LGPL-3.0-or-later
"""Distributed meshes: a :class:`HexMesh` over the ranks as DOLFINx mesh and vector P1 space."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import basix.ufl
import dolfinx
import numpy as np
import numpy.typing as npt
import ufl

from meshes.arrays import Array, Index
from meshes.hexmesh import HexMesh

# Node order of a DOLFINx (tensor-product) hexahedron in terms of the VTK order.
VTK_TO_TENSOR = np.array([0, 1, 3, 2, 4, 5, 7, 6])


@dataclass(frozen=True)
class Domain:
    """The distributed mesh, and how its rank-local pieces map back to the nodes of the HexMesh.

    Attributes:
        msh: DOLFINx mesh.
        V: Vector P1 space on it.
        regions: Cell tags (``dx(tag)``).
        source: The HexMesh it was made from, on every rank (contact surfaces are read from it).
        nodes: HexMesh node of each local dof block, owned first, then ghosts, shape ``(n_local,)``.
        owned: Number of dof blocks owned by this rank.
    """

    msh: dolfinx.mesh.Mesh
    V: dolfinx.fem.FunctionSpace
    regions: dolfinx.mesh.MeshTags
    source: HexMesh
    nodes: Index
    owned: int

    def local_dofs(self, nodes: Index) -> npt.NDArray[np.int32]:
        """Return the owned dof block of each HexMesh node, -1 where another rank owns it."""
        dof = np.full(len(self.source.points), -1, dtype=np.int32)
        dof[self.nodes[: self.owned]] = np.arange(self.owned, dtype=np.int32)
        return dof[nodes]

    def region_dofs(self, names: Iterable[str]) -> npt.NDArray[np.int32]:
        """Return the owned dof blocks of the cells in the regions called ``names``."""
        dofs = self.local_dofs(self.source.nodes(*self.source.tags(names)))
        return dofs[dofs >= 0]

    def gather(self, local: npt.NDArray[Any]) -> Array:
        """Return a local vector field by HexMesh node on rank 0, shape ``(n, 3)``; collective.

        Args:
            local: Values on the dofs of this rank, ghosts behind, shape ``(3 * n_local,)``.
        """
        own = local.reshape(-1, 3)[: self.owned]
        parts = self.msh.comm.gather((self.nodes[: self.owned], own))
        out = np.zeros((len(self.source.points) if parts else 0, 3))
        for nodes, values in parts or ():
            out[nodes] = values
        return out


def distribute(mesh: HexMesh | None, comm: MPI.Comm = MPI.COMM_WORLD) -> Domain:
    """Return ``mesh`` (given on rank 0, ``None`` elsewhere is fine) spread over ``comm``.

    Cells are partitioned by DOLFINx; every rank keeps the whole HexMesh as arrays, because
    contact surfaces cross rank borders.
    """
    mesh = comm.bcast(mesh, root=0)
    assert mesh is not None
    element = basix.ufl.element("Lagrange", "hexahedron", 1, shape=(3,))
    share = np.array_split(np.arange(len(mesh.cells)), comm.size)[comm.rank]
    points = np.array_split(np.arange(len(mesh.points)), comm.size)[comm.rank]
    msh = dolfinx.mesh.create_mesh(
        comm, mesh.cells[share][:, VTK_TO_TENSOR], ufl.Mesh(element), mesh.points[points]
    )
    V = dolfinx.fem.functionspace(msh, ("Lagrange", 1, (3,)))
    cells = np.arange(len(msh.topology.original_cell_index), dtype=np.int32)
    # create_mesh numbers the input cells rank by rank in the order they were passed
    regions = dolfinx.mesh.meshtags(
        msh, 3, cells, mesh.regions[msh.topology.original_cell_index].astype(np.int32)
    )
    imap = V.dofmap.index_map
    nodes = np.empty(imap.size_local + imap.num_ghosts, dtype=np.int64)
    nodes[V.dofmap.list] = msh.geometry.input_global_indices[msh.geometry.dofmaps[0]]
    return Domain(msh, V, regions, mesh, nodes, imap.size_local)
