# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact springs of a state at rest, and the stiffness of such springs."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from meshes.arrays import Array, Index


@dataclass(frozen=True, eq=False)
class RestSprings:
    """Normal springs of all nodes near the target, whether they touch or not.

    Attributes:
        number: Contactor node or point of each, shape ``(m,)``.
        nodes: HexMesh nodes that it joins: contactor, then facet; negative for rigid ones,
            shape ``(m, n)``.
        weight: Their weights in the gap, shape ``(m, n)``.
        normal: Normals of the target, shape ``(m, 3)``.
        gap: Negative where they touch, shape ``(m,)`` [m].
        stiffness: That they have or would have on touch, shape ``(m,)`` [N/m].
    """

    number: Index
    nodes: Index
    weight: Array
    normal: Array
    gap: Array
    stiffness: Array


def shape_functions(xi: Array) -> Array:
    """Return the bilinear shape functions at ``xi`` ``(m, 2)``, shape ``(m, 4)``."""
    a, b = xi[:, 0], xi[:, 1]
    return 0.25 * np.stack(
        [(1 - a) * (1 - b), (1 + a) * (1 - b), (1 + a) * (1 + b), (1 - a) * (1 + b)], axis=1
    )


def relative_rows(nodes: Index, weight: Array, direction: Array, columns: Index) -> csr_array:
    """Return the matrix from displacements to relative displacements along a direction.

    Along the normals of the target these are the gaps; its transpose spreads forces over the nodes.

    Args:
        nodes: HexMesh nodes: contactor, then facet; negative for rigid ones, ``(m, n)``.
        weight: Their weights in the gap, ``(m, n)``.
        direction: Unit vectors, ``(m, 3)``.
        columns: Nodes that have columns, three each, ascending, ``(k,)``; rigid ones have none.

    Returns:
        Shape ``(m, 3 k)``.
    """
    contact, _ = np.nonzero(nodes >= 0)
    real = nodes >= 0
    place = 3 * np.searchsorted(columns, nodes[real])[:, None] + np.arange(3)
    entries = weight[real][:, None] * direction[contact]
    shape = len(nodes), 3 * len(columns)
    return csr_array((entries.ravel(), (np.repeat(contact, 3), place.ravel())), shape=shape)


def stiffness_blocks(
    nodes: Index, weight: Array, normal: Array, kn: Array, kt: float | Array
) -> tuple[Index, Index, Array]:
    """Return the stiffness between a contactor node and its four facet nodes as triplets.

    With the weights B = (1, -N_1 ... -N_4), or with those of the nodes round a point instead of 1,
    a block is B_i B_j (k_n n n^T + k_t (I - n n^T)); the turning of n with the facet is left out.
    It is the derivative of minus the force.

    Args:
        nodes: HexMesh nodes: contactor, then facet; negative for rigid ones, ``(m, n)``.
        weight: Their weights in the gap, ``(m, n)``.
        normal: Normals of the target, ``(m, 3)``.
        kn: Normal stiffness, ``(m,)`` [N/m].
        kt: Tangential stiffness, ``(m,)`` or 0 [N/m].

    Returns:
        Row nodes ``(k,)``, column nodes ``(k,)`` and blocks ``(k, 3, 3)`` [N/m]; entries of the
        same place are to be summed. Rigid nodes are left out.
    """
    nn = np.einsum("ma,mb->mab", normal, normal)
    core = kn[:, None, None] * nn
    core += np.broadcast_to(kt, kn.shape)[:, None, None] * (np.eye(3) - nn)
    blocks = np.einsum("mi,mj,mab->mijab", weight, weight, core).reshape(-1, 3, 3)
    size = nodes.shape[1]
    row = np.repeat(nodes, size, axis=1).ravel()
    column = np.tile(nodes, (1, size)).ravel()
    real = (row >= 0) & (column >= 0)
    return row[real], column[real], blocks[real]
