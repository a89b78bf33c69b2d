# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact springs of all nodes that can touch soon, for the audit of the time step."""

from dataclasses import dataclass

import numpy as np

from contact.arrays import State
from contact.normal_law import node_foundation
from contact.one_pass import Pass
from contact.surface import Surface
from contact.tangent import stiffness_blocks
from meshes.arrays import Array, Index


@dataclass(frozen=True)
class Springs:
    """Springs of ``m`` contactor nodes and the facets next to them; the same on all ranks.

    Attributes:
        nodes: HexMesh nodes, contactor then facet, negative for rigid ones, shape ``(m, k)``.
        weight: Their weights in the gap, those of the facet negative, shape ``(m, k)``.
        normal: Normals of the target, shape ``(m, 3)``.
        gap: Distance from the facet, negative = penetration, shape ``(m,)`` [m].
        mass: Effective mass, shape ``(m,)`` [kg].
        area: Tributary area of the contactor node, shape ``(m,)`` [m²].
        foundation: Stiffness over the factor of ``modulus-penalty``, zero where moduli are not
            known, shape ``(m,)`` [N/m].
    """

    nodes: Index
    weight: Array
    normal: Array
    gap: Array
    mass: Array
    area: Array
    foundation: Array

    def blocks(self, normal: Array, tangential: Array) -> tuple[Index, Index, Array]:
        """Return the stiffness as triplets, see :func:`contact.tangent.stiffness_blocks`."""
        return stiffness_blocks(self.nodes, self.weight, self.normal, normal, tangential)


def springs(
    side: Pass, state: State, foundations: tuple[Surface, Surface] | None = None
) -> Springs:
    """Return the springs of all nodes within a cell of the target; collective.

    The pass and its candidates are left as they are.

    Args:
        side: One pass of a contact.
        state: Displacements; velocities are not read.
        foundations: Its surfaces with the bulk moduli behind them, if its own do not have them
            and the foundation is wanted.
    """
    near = side.candidates
    near.exchange.whole(state.u.x.array, state.u.x.array)
    found, there = near.probe(near.margin, near.reach)
    mass, shared = side.effective_mass(found, there)
    here = np.isfinite(there.gap[found.item])
    c, mass, shared = found.item[here], mass[here], shared[here]
    foundation = np.zeros(len(c))
    if side.options.method == "modulus-penalty":
        foundations = side.contactor, side.target
    if foundations is not None and foundations[1].foundation is not None:
        facet = foundations[1].foundation[there.facet[c]]
        foundation = shared * np.minimum(
            node_foundation(foundations[0])[near.stack.nearest[c]], facet
        )
    return Springs(
        *side.joined(c, there), there.normal[c], there.gap[c], mass, side.stack.area[c], foundation
    )
