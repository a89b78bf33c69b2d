# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact patches: nodes, pressures, stick and slip zones, and the resultants of each patch."""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from meshes.arrays import Array, Index


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
        frame: Longitudinal, lateral and normal direction, see :func:`frame_of`, shape ``(3, 3)``.
        spin_moment: Moment of the tangential forces about the normal through ``centre`` [N m].
        friction_power: Power of the tangential forces on the slip, turned into heat [W].
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
    frame: Array
    spin_moment: float
    friction_power: float

    @property
    def force(self) -> Array:
        """Vector sum of all forces, shape ``(3,)`` [N]."""
        return self.normal_resultant + self.tangential_force

    @property
    def force_in_frame(self) -> Array:
        """Its longitudinal, lateral and normal part, shape ``(3,)`` [N]."""
        return self.frame @ self.force

    @property
    def shear_stress(self) -> Array:
        """Longitudinal and lateral tangential force over area, shape ``(2,)`` [Pa]."""
        return self.frame[:2] @ self.tangential_force / self.area

    @property
    def mean_shear(self) -> float:
        """Size of the tangential force over area [Pa]."""
        return float(np.linalg.norm(self.tangential_force)) / self.area

    @property
    def shear_angle(self) -> float:
        """Angle of the shear on the target from the negative longitudinal axis [rad].

        Positive towards the negative lateral axis. Where the contactor is a driven wheel the shear
        on the rail points backwards and the angle is small.
        """
        return shear_angle(self.shear_stress)


@dataclass(frozen=True)
class Footprint:
    """Nodes in contact, ascending by node, and their patches from high y to low y.

    The nodes are those of one body, the contactor unless told; forces act on it.

    Attributes:
        node: HexMesh node, shape ``(n,)``.
        position: Current position, shape ``(n, 3)`` [m].
        normal: Outward normal of the target, shape ``(n, 3)``.
        normal_force: Normal force, shape ``(n,)`` [N].
        tangential_force: Tangential force on the contactor, shape ``(n, 3)`` [N].
        area: Tributary area, undeformed, shape ``(n,)`` [m2].
        slip_velocity: Tangential velocity relative to the target, shape ``(n, 3)`` [m/s].
        friction: Coefficient of friction, shape ``(n,)`` [-].
        friction_power: Power of the tangential force on the slip, shape ``(n,)`` [W].
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
    friction_power: Array
    stick: npt.NDArray[np.bool_]
    patch: Index
    patches: tuple[Patch, ...]

    @property
    def pressure(self) -> Array:
        """Normal force over tributary area, shape ``(n,)`` [Pa]."""
        return self.normal_force / self.area


def stick_zone(limit: Array, tangential: Array, tolerance: float) -> npt.NDArray[np.bool_]:
    """Return which nodes adhere: the friction left exceeds a part of the largest tangential one.

    Args:
        limit: friction * F_n, shape ``(n,)`` [N].
        tangential: Tangential forces, shape ``(n, 3)`` [N].
        tolerance: Fraction of the largest tangential nodal force [-].
    """
    size = np.linalg.norm(tangential, axis=1)
    return limit - size > tolerance * size.max(initial=0.0)


def frame_of(normal: Array) -> Array:
    """Return the frame of a patch as rows: longitudinal, lateral, normal; shape ``(3, 3)``.

    Longitudinal is the x axis of the track laid into the tangent plane (the y axis, where the
    normal is along x), and lateral = normal x longitudinal.
    """
    axis = np.eye(3)[1 if abs(normal[0]) > 0.9 else 0]
    along = axis - (axis @ normal) * normal
    along /= np.linalg.norm(along)
    return np.array([along, np.cross(normal, along), normal])


def contact_angle(normal: Array) -> Array:
    """Return the angle of normals from the vertical in the y-z plane, shape ``(...)`` [rad].

    Args:
        normal: Normals or normal resultants, shape ``(..., 3)``.
    """
    return np.arctan2(np.abs(normal[..., 1]), np.abs(normal[..., 2]))


def shear_angle(shear: Array) -> float:
    """Return the angle of the shear on the lower body from the negative longitudinal axis [rad].

    Args:
        shear: Longitudinal and lateral shear on the upper body, shape ``(2,)``.
    """
    return float(np.arctan2(shear[1], shear[0]))


def _patch(foot: Footprint, nodes: Index) -> Patch:
    """Return the resultants of some nodes of a footprint."""
    force, tangential_force = foot.normal_force[nodes], foot.tangential_force[nodes]
    position, area = foot.position[nodes], foot.area[nodes]
    resultant = force @ foot.normal[nodes]
    frame = frame_of(resultant / np.linalg.norm(resultant))
    centre = force @ position / force.sum()
    moment = np.cross(position - centre, tangential_force).sum(axis=0)
    return Patch(
        nodes=len(nodes),
        sticking=int(foot.stick[nodes].sum()),
        area=float(area.sum()),
        centre=centre,
        normal_force=float(force.sum()),
        normal_resultant=resultant,
        tangential_force=tangential_force.sum(axis=0),
        contact_angle=float(contact_angle(resultant)),
        max_pressure=float((force / area).max()),
        frame=frame,
        spin_moment=float(frame[2] @ moment),
        friction_power=float(foot.friction_power[nodes].sum()),
    )


def footprint_of(
    node: Index,
    position: Array,
    normal: Array,
    normal_force: Array,
    tangential_force: Array,
    area: Array,
    slip_velocity: Array,
    friction: Array,
    friction_power: Array,
    component: Index,
    stick_tolerance: float,
) -> Footprint:
    """Return the footprint of nodes in contact; arrays as in :class:`Footprint`.

    ``component`` ``(n,)`` tells which nodes belong together; patches are numbered
    from high y to low y.
    """
    nodal = Footprint(
        node=node,
        position=position,
        normal=normal,
        normal_force=normal_force,
        tangential_force=tangential_force,
        area=area,
        slip_velocity=slip_velocity,
        friction=friction,
        friction_power=friction_power,
        stick=stick_zone(friction * normal_force, tangential_force, stick_tolerance),
        patch=component,
        patches=(),
    )
    count = int(component.max(initial=-1)) + 1
    parts = [_patch(nodal, np.flatnonzero(component == k)) for k in range(count)]
    order = sorted(range(count), key=lambda k: (-parts[k].centre[1], parts[k].centre[0]))
    rank = np.empty(count, dtype=np.int64)
    rank[order] = np.arange(count)
    return replace(nodal, patch=rank[component], patches=tuple(parts[k] for k in order))
