# SPDX-License-Identifier: LGPL-3.0-or-later
"""Nodes of a contact patch, read back: stresses, resultants and angles."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from contact.footprint import contact_angle, frame_of, shear_angle
from meshes.arrays import Array

STEEP = np.pi / 4  # contact angle from which on a patch counts as gauge corner [rad]


@dataclass(frozen=True)
class PatchNodes:
    """Nodes of one patch at one output; normals point, and forces act, on the upper body.

    Resultants as in :class:`contact.footprint.Patch`, of nodes as they were written.

    Attributes:
        position: Current positions, shape ``(n, 3)`` [m].
        normal: Unit normals, shape ``(n, 3)``.
        normal_forces: Normal forces, shape ``(n,)`` [N].
        tangential_forces: Tangential forces, shape ``(n, 3)`` [N].
        areas: Tributary areas, shape ``(n,)`` [m2].
        friction: Coefficients of friction, shape ``(n,)`` [-].
        stick: Where nodes adhere, shape ``(n,)``.
    """

    position: Array
    normal: Array
    normal_forces: Array
    tangential_forces: Array
    areas: Array
    friction: Array
    stick: npt.NDArray[np.bool_]

    @property
    def normal_force(self) -> float:
        """Sum of the normal forces [N]."""
        return float(self.normal_forces.sum())

    @property
    def tangential_force(self) -> float:
        """Size of the vector sum of the tangential forces [N]."""
        return float(np.linalg.norm(self.tangential_forces.sum(axis=0)))

    @property
    def vertical_force(self) -> float:
        """Vertical part of all forces [N]."""
        return float(self.normal_forces @ self.normal[:, 2] + self.tangential_forces[:, 2].sum())

    @property
    def pressure(self) -> Array:
        """Normal force over tributary area, shape ``(n,)`` [Pa]."""
        return self.normal_forces / self.areas

    @property
    def area(self) -> float:
        """Sum of the tributary areas [m2]."""
        return float(self.areas.sum())

    @property
    def centre(self) -> Array:
        """Mean position weighted with the normal force, shape ``(3,)`` [m]."""
        return np.asarray(self.normal_forces @ self.position / self.normal_forces.sum())

    @property
    def direction(self) -> Array:
        """Unit normal of the patch: direction of its normal resultant, shape ``(3,)``."""
        resultant = self.normal_forces @ self.normal
        return np.asarray(resultant / np.linalg.norm(resultant))

    @property
    def frame(self) -> Array:
        """Longitudinal, lateral and normal direction as rows, shape ``(3, 3)``."""
        return frame_of(self.direction)

    @property
    def local(self) -> Array:
        """Longitudinal and lateral position of the nodes from the centre, ``(n, 2)`` [m]."""
        return np.asarray((self.position - self.centre) @ self.frame[:2].T)

    @property
    def shear(self) -> Array:
        """Longitudinal and lateral shear stress on the lower body, shape ``(n, 2)`` [Pa]."""
        return np.asarray(-self.tangential_forces @ self.frame[:2].T / self.areas[:, None])

    @property
    def mean_friction(self) -> float:
        """Mean coefficient of friction, weighted with the normal force [-]."""
        return float(self.normal_forces @ self.friction / self.normal_force)

    @property
    def mean_shear(self) -> float:
        """Size of the tangential force over the sum of the tributary areas [Pa]."""
        return self.tangential_force / self.area

    @property
    def longitudinal_shear(self) -> float:
        """Mean longitudinal shear stress on the lower body [Pa]."""
        return float(self.areas @ self.shear[:, 0] / self.area)

    @property
    def lateral_shear(self) -> float:
        """Mean lateral shear stress on the lower body [Pa]."""
        return float(self.areas @ self.shear[:, 1] / self.area)

    @property
    def shear_angle(self) -> float:
        """Angle of the mean shear on the lower body from the negative longitudinal axis [rad].

        Positive towards the negative lateral axis: on a rail to the gauge side and downwards. NaN
        where shear is less than a thousandth of the normal force.
        """
        if self.tangential_force < 1e-3 * self.normal_force:
            return float("nan")
        return shear_angle(np.array([-self.longitudinal_shear, -self.lateral_shear]))

    @property
    def contact_angle(self) -> float:
        """Angle of the normal from the vertical, in the y-z plane [rad]."""
        return float(contact_angle(self.direction))


def patches_of(arrays: Any) -> dict[int, PatchNodes]:
    """Return the patches of a footprint by place: 1 rail top, 2 gauge corner.

    Patches less steep than 45° count as rail top together, the rest as gauge corner, so a
    place keeps its number through all outputs.

    Args:
        arrays: Per-node arrays by name, as in ``results.h5``.
    """
    touching = arrays["normal_force"][:] > 0
    names = ("position", "normal", "normal_force", "tangential_force", "area")
    nodal = [np.asarray(arrays[name][:], dtype=np.float64)[touching] for name in names]
    if nodal[1][:, 2].sum() < 0:  # the target is the upper body: look at it the other way round
        nodal[1], nodal[3] = -nodal[1], -nodal[3]
    unknown = np.full(touching.sum(), np.nan)
    friction = arrays["friction"][:][touching] if "friction" in arrays else unknown
    stick = arrays["stick"][:][touching] if "stick" in arrays else unknown > 0
    label = arrays["patch"][:][touching]
    place = np.zeros(len(label), dtype=int)
    for k in np.unique(label):
        part = PatchNodes(*(a[label == k] for a in (*nodal, friction, stick)))
        place[label == k] = 1 if part.contact_angle < STEEP else 2
    return {
        int(k): PatchNodes(*(a[place == k] for a in (*nodal, friction, stick)))
        for k in np.unique(place)
    }
