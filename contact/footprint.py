# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact patches: nodes, pressures, stick and slip zones, and the resultants of each patch."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Patch:
    """Resultants of one patch; forces act on the contactor.

    Attributes:
        nodes: Number of nodes in contact.
        sticking: Number of nodes that adhere.
        area: Sum of the tributary areas [m2].
        centre: Mean position weighted with the normal force, shape ``(3,)`` [m].
        normal_force: Sum of the nodal normal forces [N].
        normal_resultant: Their vector sum, shape ``(3,)`` [N].
        tangential_force: Vector sum of the tangential forces, shape ``(3,)`` [N].
        contact_angle: Angle of ``normal_resultant`` from the vertical in the y-z plane [rad].
        max_pressure: Largest normal force over tributary area [Pa].
    """

    nodes: int
    sticking: int
    area: float
    centre: Array
    normal_force: float
    normal_resultant: Array
    tangential_force: Array
    contact_angle: float
    max_pressure: float


@dataclass(frozen=True)
class Footprint:
    """Nodes in contact, ascending by node, and their patches from high y to low y.

    Attributes:
        node: HexMesh node, shape ``(n,)``.
        position: Current position, shape ``(n, 3)`` [m].
        normal: Outward normal of the target, shape ``(n, 3)``.
        normal_force: Normal force, shape ``(n,)`` [N].
        tangential_force: Tangential force on the contactor, shape ``(n, 3)`` [N].
        area: Tributary area, undeformed, shape ``(n,)`` [m2].
        slip_velocity: Tangential velocity relative to the target, shape ``(n, 3)`` [m/s].
        friction: Coefficient of friction, shape ``(n,)`` [-].
        stick: Where ``friction * F_n - |F_t|`` exceeds the tolerance, shape ``(n,)``.
        patch: Patch of each node, shape ``(n,)``.
        patches: Resultants, by patch number.
    """

    node: Index
    position: Array
    normal: Array
    normal_force: Array
    tangential_force: Array
    area: Array
    slip_velocity: Array
    friction: Array
    stick: npt.NDArray[np.bool_]
    patch: Index
    patches: tuple[Patch, ...]

    @property
    def pressure(self) -> Array:
        """Normal force over tributary area, shape ``(n,)`` [Pa]."""
        return self.normal_force / self.area


def stick_zone(limit: Array, tangential: Array, tolerance: float) -> npt.NDArray[np.bool_]:
    """Return which nodes adhere: the friction left exceeds a part of the largest traction.

    Args:
        limit: friction * F_n, shape ``(n,)`` [N].
        tangential: Tangential forces, shape ``(n, 3)`` [N].
        tolerance: Fraction of the largest tangential nodal force [-].
    """
    size = np.linalg.norm(tangential, axis=1)
    return limit - size > tolerance * size.max(initial=0.0)


def connected(facets: npt.NDArray[np.int32], touching: Index, n: int) -> Index:
    """Return the component of each touching node; nodes of one facet are connected.

    Args:
        facets: Contactor facets, shape ``(q, 4)``.
        touching: Surface nodes in contact, shape ``(k,)``.
        n: Number of surface nodes.
    """
    place = np.full(n, -1, dtype=np.int64)
    place[touching] = np.arange(len(touching))
    corner = place[facets]
    corner = corner[(corner >= 0).sum(axis=1) > 1]
    i, j = np.repeat(corner, 4, axis=1).ravel(), np.tile(corner, (1, 4)).ravel()
    both = (i >= 0) & (j >= 0)
    shape = (len(touching), len(touching))
    graph = coo_array((np.ones(both.sum()), (i[both], j[both])), shape=shape)
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)


def _patch(
    nodes: Index, position: Array, normal: Array, pressing: Array, traction: Array, area: Array,
    stick: npt.NDArray[np.bool_],
) -> Patch:  # fmt: skip
    force = pressing[nodes]
    resultant = force @ normal[nodes]
    return Patch(
        nodes=len(nodes),
        sticking=int(stick[nodes].sum()),
        area=float(area[nodes].sum()),
        centre=force @ position[nodes] / force.sum(),
        normal_force=float(force.sum()),
        normal_resultant=resultant,
        tangential_force=traction[nodes].sum(axis=0),
        contact_angle=float(np.arctan2(abs(resultant[1]), abs(resultant[2]))),
        max_pressure=float((force / area[nodes]).max()),
    )


def footprint_of(
    node: Index, position: Array, normal: Array, pressing: Array, traction: Array, area: Array,
    slip_velocity: Array, friction: Array, component: Index, stick_tolerance: float,
) -> Footprint:  # fmt: skip
    """Return the footprint of nodes in contact; arrays as in :class:`Footprint`.

    ``component`` ``(n,)`` tells connected nodes; patches are numbered from high y to low y.
    """
    stick = stick_zone(friction * pressing, traction, stick_tolerance)
    count = int(component.max(initial=-1)) + 1
    parts = [
        _patch(np.flatnonzero(component == k), position, normal, pressing, traction, area, stick)
        for k in range(count)
    ]
    order = sorted(range(count), key=lambda k: (-parts[k].centre[1], parts[k].centre[0]))
    rank = np.empty(count, dtype=np.int64)
    rank[order] = np.arange(count)
    return Footprint(
        node, position, normal, pressing, traction, area, slip_velocity, friction, stick,
        rank[component], tuple(parts[k] for k in order),
    )  # fmt: skip
