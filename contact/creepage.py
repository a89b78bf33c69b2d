# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rigid motion of two bodies against each other at a patch: slip, creepages and spin.

Creepage is what two rigid bodies would slip. Inside the patch the surfaces also creep elastically,
which is why they can adhere; there the mean slip is no creepage. So each body's rigid motion is
fitted to its surface *around* the patch, where the elastic velocities have fallen off and, being
odd along the direction of rolling, nearly cancel in the mean.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from contact.footprint import Patch
from meshes.arrays import Array

AROUND = (3.0, 8.0)  # nodes that show the rigid motion: distance in radii of the patch
FEWEST = 24  # of them; the nearest ones, where a coarse mesh has fewer


@dataclass(frozen=True)
class Motion:
    """A rigid motion.

    Attributes:
        about: Point, shape ``(3,)`` [m].
        velocity: Of that point, shape ``(3,)`` [m/s].
        spin: Angular velocity, shape ``(3,)`` [rad/s].
    """

    about: Array
    velocity: Array
    spin: Array

    def at(self, position: Array) -> Array:
        """Return the velocity at a position, shape ``(3,)`` [m/s]."""
        return np.asarray(self.velocity + np.cross(self.spin, position - self.about))


@dataclass(frozen=True)
class Creepage:
    """Rigid motion of the contactor against the target, in the frame of the patch.

    Attributes:
        slip: Slip at the centre, longitudinal and lateral, shape ``(2,)`` [m/s].
        spin_rate: Relative rotation about the normal of the target [rad/s].
        speed: Rolling speed: of the contact against the mean of both surfaces [m/s]; NaN where
            the contact does not travel.
    """

    slip: Array
    spin_rate: float
    speed: float

    @property
    def longitudinal(self) -> float:
        """Longitudinal creepage: slip over rolling speed [-]."""
        return float(self.slip[0] / self.speed)

    @property
    def lateral(self) -> float:
        """Lateral creepage [-]."""
        return float(self.slip[1] / self.speed)

    @property
    def spin(self) -> float:
        """Spin creepage [1/m]."""
        return self.spin_rate / self.speed


def rigid_motion(position: Array, velocity: Array, about: Array) -> Motion:
    """Return the rigid motion nearest to nodal velocities in the sense of least squares.

    Args:
        position: Positions, shape ``(n, 3)`` [m].
        velocity: Velocities there, shape ``(n, 3)`` [m/s].
        about: Point whose velocity is asked for, shape ``(3,)`` [m].
    """
    arm = position - position.mean(axis=0)
    # angular momentum and inertia of unit masses; nodes in a line show no spin about it
    momentum = np.cross(arm, velocity).sum(axis=0)
    inertia = np.eye(3) * (arm**2).sum() - arm.T @ arm
    spin = np.linalg.pinv(inertia, rcond=1e-9, hermitian=True) @ momentum
    mean = velocity.mean(axis=0)
    return Motion(about, mean + np.cross(spin, about - position.mean(axis=0)), spin)


def surroundings(position: Array, patch: Patch) -> npt.NDArray[np.int64]:
    """Return the nodes that lie around a patch, 3 to 8 of its radii away; if few, the nearest.

    Args:
        position: Nodes of one surface, shape ``(n, 3)`` [m].
        patch: The patch; the radius is that of a circle of its area.
    """
    radius = np.sqrt(patch.area / np.pi)
    distance = np.linalg.norm(position - patch.centre, axis=1)
    near, far = np.array(AROUND) * radius
    chosen = np.flatnonzero((distance > near) & (distance < far))
    if len(chosen) >= FEWEST:
        return chosen
    outside = np.flatnonzero(distance > radius)
    return outside[np.argsort(distance[outside], kind="stable")[:FEWEST]]


def creepage_of(patch: Patch, contactor: Array, target: Array, travel: Array | None) -> Creepage:
    """Return the relative rigid motion of two surfaces at a patch.

    Args:
        patch: Where, and the frame to see it in.
        contactor: Position and velocity of all contactor nodes, shape ``(n, 6)`` [m, m/s].
        target: Those of the target, shape ``(m, 6)`` [m, m/s].
        travel: Velocity of the contact itself, shape ``(3,)`` [m/s]; None if it does not travel.
    """
    one, two = (_motion(xv, patch) for xv in (contactor, target))
    slip = patch.frame @ (one.velocity - two.velocity)
    spin = float(patch.frame[2] @ (one.spin - two.spin))
    speed = np.nan
    if travel is not None:
        speed = float(np.linalg.norm(travel - (one.velocity + two.velocity) / 2))
    return Creepage(slip[:2], spin, speed)


def _motion(xv: Array, patch: Patch) -> Motion:
    chosen = surroundings(xv[:, :3], patch)
    return rigid_motion(xv[chosen, :3], xv[chosen, 3:], patch.centre)
