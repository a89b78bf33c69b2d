# SPDX-License-Identifier: LGPL-3.0-or-later
"""Supports of a scene: surfaces held along directions."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import numpy.typing as npt
from dolfinx import la

from meshes.arrays import Array, Dofs
from meshes.domain import Domain
from workflow.model.regions import surface_nodes
from workflow.model.state import State
from workflow.scene import Scene
from workflow.scene.settings import Support


@dataclass(frozen=True)
class Supports:
    """Held directions: node groups whose acceleration loses its component along a unit vector.

    Attributes:
        dofs: Owned dof blocks of each group.
        directions: Unit vector of each group, shape ``(3,)``.
        names: Surface and direction of each group.
    """

    dofs: list[Dofs]
    directions: list[Array]
    names: list[str] = field(default_factory=list)

    def __call__(self, a: la.Vector) -> None:
        """Remove the held components, in place."""
        x = a.array
        for index, n in self.groups:
            if n is None:
                x[index] = 0.0
            else:
                held = x[index]
                x[index] = held - np.multiply.outer(n, n @ held)

    @cached_property
    def groups(self) -> list[tuple[npt.NDArray[np.int64], Array | None]]:
        """Entries of a flat vector ``(3, k)`` and direction; entries ``(k,)`` along an axis."""
        groups: list[tuple[npt.NDArray[np.int64], Array | None]] = []
        for dofs, n in zip(self.dofs, self.directions, strict=True):
            index = 3 * dofs.astype(np.int64) + np.arange(3)[:, None]
            axis = np.flatnonzero(n)
            groups.append((index[axis[0]], None) if len(axis) == 1 else (index, n))
        return groups


class Withheld:
    """Forces that supports bear, kept from those that read the sum of all forces.

    What is held must not be foreseen to move. It is given back afterwards, because the reactions
    of what moves the supports are found from the whole force.
    """

    def __init__(self, held: Supports) -> None:
        self._held = held
        self._index = np.unique(np.concatenate([i.ravel() for i, _ in held.groups]))
        self._kept: Array = np.zeros(len(self._index))

    def take(self, state: State, force: la.Vector) -> None:
        """Remove the held components, in place."""
        self._kept = force.array[self._index]
        self._held(force)
        self._kept -= force.array[self._index]

    def give(self, state: State, force: la.Vector) -> None:
        """Add what was taken."""
        force.array[self._index] += self._kept


def axle(scene: Scene) -> Array:
    """Return the unit vector along the axle, at its angle of attack and roll, shape ``(3,)``."""
    yaw = scene.rolling.angle_of_attack if scene.rolling else 0.0
    roll = getattr(scene.mesh, "roll", 0.0)
    level = np.array([-np.sin(yaw), np.cos(yaw), 0.0])
    return np.cos(roll) * level + np.array([0.0, 0.0, np.sin(roll)])


def supports(entries: list[Support], scene: Scene, domain: Domain) -> Supports:
    """Return supports as listed in a scene."""
    axes = {"x": np.eye(3)[0], "y": np.eye(3)[1], "z": np.eye(3)[2], "axle": axle(scene)}
    dofs, directions, names = [], [], []
    for entry in entries:
        local = domain.local_dofs(surface_nodes(domain, entry.surface))
        for direction in entry.directions:
            dofs.append(local[local >= 0])
            directions.append(axes[direction])
            names.append(f"{entry.surface}_{direction}")
    return Supports(dofs, directions, names)
