# SPDX-License-Identifier: LGPL-3.0-or-later
"""The springs that a pair would press with, of every node that can touch soon, for audits."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from contact.arrays import view
from contact.contact_state import ContactState
from contact.normal_law import node_foundation
from contact.one_pass import Pass
from contact.state import State
from contact.surface import Surface
from contact.tangent import shape_functions, stiffness_blocks

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Springs:
    """Springs of ``m`` contactor nodes and the facets next to them; the same on all ranks.

    Attributes:
        nodes: HexMesh nodes, contactor then facet, negative for rigid ones, shape ``(m, 5)``.
        xi: Local coordinates on the facet, shape ``(m, 2)``.
        normal: Normals of the target, shape ``(m, 3)``.
        gap: Distance from the facet, negative = penetration, shape ``(m,)`` [m].
        mass: Effective mass, shape ``(m,)`` [kg].
        area: Tributary area of the contactor node, shape ``(m,)`` [m²].
        foundation: Stiffness over the factor of ``modulus-penalty``, zero where moduli are not
            known, shape ``(m,)`` [N/m].
    """

    nodes: Index
    xi: Array
    normal: Array
    gap: Array
    mass: Array
    area: Array
    foundation: Array

    def blocks(self, normal: Array, tangential: Array) -> tuple[Index, Index, Array]:
        """Return the stiffness as triplets, see :func:`contact.tangent.stiffness_blocks`."""
        return stiffness_blocks(self.nodes, self.xi, self.normal, normal, tangential)


def springs(
    pair: Pass, state: State, foundations: tuple[Surface, Surface] | None = None
) -> Springs:
    """Return the springs of all nodes within a cell of the target; collective.

    The pair and its candidates are left as they are.

    Args:
        pair: One pass of a contact.
        state: Displacements; velocities are not read.
        foundations: Its surfaces with the bulk moduli behind them, if its own do not have them
            and the foundation is wanted.
    """
    near, search = pair.candidates, pair.candidates.search
    near.exchange.whole(state.u.x.array, state.u.x.array)
    live, outward, probe = search.live.copy(), search.outward.copy(), ContactState(search.nc)
    xv = near.exchange.xv
    c = search.candidates(xv, near.margin, near.reach, probe.stiffness, probe.facet, probe.xi)
    search.neighbourhood(c)
    search.track(len(c), view("item", c, (-1,), np.int32), view("xv", xv, xv.shape), probe.c)
    search.live[:], search.outward[:] = live, outward
    search.neighbourhood(near.item)
    c = c[np.isfinite(probe.gap[c])]
    quads, N = search.quad[probe.facet[c]], shape_functions(probe.xi[c])
    mass, area = np.concatenate([pair.contactor.mass, pair.target.mass]), pair.area
    facing = (N * area[quads]).sum(axis=1)
    crowd = np.maximum(1.0, facing / area[c])  # as effective_mass of kernel/force.c
    effective = 1 / (1 / mass[c] + crowd * (N / mass[quads]).sum(axis=1))
    bed = np.zeros(len(c))
    if pair.options.method == "modulus-penalty":
        foundations = pair.contactor, pair.target
    if foundations is not None and foundations[1].foundation is not None:
        softer = np.minimum(
            node_foundation(foundations[0])[c], foundations[1].foundation[probe.facet[c]]
        )
        bed = np.minimum(area[c], facing) * softer
    nodes = np.column_stack([near.nodes[c], near.nodes[quads]])
    return Springs(nodes, probe.xi[c], probe.normal[c], probe.gap[c], effective, area[c], bed)
