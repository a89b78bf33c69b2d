# SPDX-License-Identifier: LGPL-3.0-or-later
"""Parts of a mesh as ranks would hold them: cells, nodes, ghosts, neighbours of each.

One process cuts the mesh into any number of parts with the partitioner that DOLFINx takes by
default, on the same dual graph. A run on ranks cuts it with the distributed form of that
partitioner: other cuts, of the same quality. Cells are not ghosted, so the ghosts of a part are the
nodes of its cells that another part owns. DOLFINx draws the owner of a shared node at random from
the parts that share it; the same is done here with other random numbers, so that the sum of all
ghosts is exact for a partition and its split between two parts is not.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from dolfinx import graph
from dolfinx.cpp.mesh import CellType, build_dual_graph

from meshes.arrays import Index
from meshes.domain import VTK_TO_TENSOR
from meshes.hexmesh import HexMesh

SEED = 1


@dataclass(frozen=True)
class Parts:
    """What each of ``P`` parts holds and whom it tells.

    Attributes:
        of_cell: Part of each cell, shape ``(c,)``.
        owner: Part that owns each node, shape ``(n,)``.
        cells: Cells of each part, shape ``(P,)``.
        owned: Nodes that it owns, shape ``(P,)``.
        ghosts: Nodes of its cells that others own, shape ``(P,)``.
        told: Ghosts of others that it owns, a node counted for each of them, shape ``(P,)``.
        owners: Parts that own its ghosts, shape ``(P,)``.
        holders: Parts that hold its nodes as ghosts, shape ``(P,)``.
        neighbours: Parts that are either, shape ``(P,)``.
    """

    of_cell: Index
    owner: Index
    cells: Index
    owned: Index
    ghosts: Index
    told: Index
    owners: Index
    holders: Index
    neighbours: Index

    @property
    def count(self) -> int:
        """Number of parts."""
        return len(self.cells)

    @property
    def imbalance(self) -> float:
        """Most cells of a part over their mean, 1 for an even split."""
        return float(self.cells.max() / self.cells.mean())


def dual_graph(mesh: HexMesh) -> Any:
    """Return which cells share a face, as DOLFINx finds it for the partitioner."""
    cells = np.ascontiguousarray(mesh.cells[:, VTK_TO_TENSOR], dtype=np.int64)
    return build_dual_graph(MPI.COMM_SELF, [CellType.hexahedron], [cells.ravel()], 2)


def partition(neighbours: Any, count: int) -> Index:
    """Return the part of each cell, shape ``(c,)``.

    Args:
        neighbours: What :func:`dual_graph` returned.
        count: Number of parts.
    """
    if count == 1:
        return np.zeros(neighbours.num_nodes, dtype=np.int64)
    found = graph.partitioner()(MPI.COMM_SELF, count, neighbours, False)
    return np.asarray(found.array, dtype=np.int64)


def parts_of(cells: Index, of_cell: Index, nodes: int, count: int) -> Parts:
    """Return what each part holds, given the part of each cell.

    Args:
        cells: Nodes of each cell, shape ``(c, 8)``.
        of_cell: Part of each cell, shape ``(c,)``.
        nodes: Number of nodes; each belongs to a cell.
        count: Number of parts.
    """
    # all pairs of a node and a part that has it, by node
    node, part = np.divmod(np.unique(cells * count + of_cell[:, None]), count)
    sharing = np.bincount(node, minlength=nodes)
    first = np.cumsum(sharing) - sharing
    drawn = np.random.default_rng(SEED).integers(0, np.maximum(sharing, 1))
    owner = part[first + drawn]
    ghost = part != owner[node]
    holder, source = part[ghost], owner[node[ghost]]
    links = np.unique(source * count + holder)  # from owner to holder
    both = np.unique(np.concatenate([links, links % count * count + links // count]))
    return Parts(
        of_cell=of_cell,
        owner=owner,
        cells=_counted(of_cell, count),
        owned=_counted(owner, count),
        ghosts=_counted(holder, count),
        told=_counted(source, count),
        owners=_counted(links % count, count),
        holders=_counted(links // count, count),
        neighbours=_counted(both // count, count),
    )


def _counted(parts: npt.NDArray[np.integer[Any]], count: int) -> Index:
    return np.bincount(parts, minlength=count)


def cut(mesh: HexMesh, counts: Sequence[int]) -> list[Parts]:
    """Return the parts of a mesh for each number of parts."""
    neighbours = dual_graph(mesh)
    found = (partition(neighbours, count) for count in counts)
    return [
        parts_of(mesh.cells, of_cell, len(mesh.points), count)
        for of_cell, count in zip(found, counts, strict=True)
    ]
