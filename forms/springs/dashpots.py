# SPDX-License-Identifier: LGPL-3.0-or-later
"""Viscous dashpots on a surface that let waves out: Lysmer and Kuhlemeyer's boundary."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import numpy.typing as npt

from forms.elasticity import Elastic
from forms.loads import nodal_traction
from forms.springs.point_masses import damper_work

Array = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Dofs = npt.NDArray[np.int32]


@dataclass
class Dashpots:
    """Dampers from nodes to the ground with a matrix each; at rest they carry nothing.

    Attributes:
        dofs: Owned dof block of each node on this rank, shape ``(n,)``.
        matrix: Damping of each, symmetric, shape ``(n, 3, 3)`` [N s/m].
        dissipation: Energy taken on this rank [J].
    """

    dofs: Dofs
    matrix: Array
    dissipation: float = 0.0
    _before: Array | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        self._index = 3 * self.dofs.astype(np.int64)[:, None] + np.arange(3)
        self.stiffness = np.zeros((len(self.dofs), 3))

    @property
    def damping(self) -> Array:
        """Sums of the sizes in each row: dampers along the axes that are at least as strong.

        The rest of a row is what a diagonally dominant matrix has to have (Gershgorin).
        """
        return np.asarray(np.abs(self.matrix).sum(axis=2))

    def add(self, u: Array, v: Array, force: Array, reaction: Array, dt: float) -> None:
        """Add to the nodal ``force``."""
        rate = v.take(self._index)
        damping = np.einsum("nij,nj->ni", self.matrix, rate)
        np.subtract.at(force, self._index.ravel(), damping.ravel())
        if self._before is not None:
            self.dissipation += damper_work(self._before, damping, rate, dt)
        self._before = damping

    def pull(self, u: Array, out: Array) -> None:
        """No point mass is pulled."""

    def add_stiffness(self, out: Array) -> None:
        """No point mass is held."""

    def triplets(self, number: Ints) -> tuple[Ints, Ints, Array]:
        """Return the stiffness, which is none."""
        none = np.zeros(0, dtype=np.int64)
        return none, none, np.zeros(0)

    def stored_energy(self, u: Array) -> float:
        """Return the energy stored, which is none [J]."""
        return 0.0


def absorbing(
    points: Array, quads: Ints, material: Elastic, waves: Literal["plane", "bar"] = "plane"
) -> Array:
    """Return the damping matrices of all nodes that let waves out of a surface, ``(n, 3, 3)``.

    ``ρ c`` per area along the normal and ``ρ c_s`` across it (Lysmer and Kuhlemeyer, J. Eng. Mech.
    Div. 95, 1969, 859-877, with a = b = 1). A plane wave at right angles has c = c_p, so nothing of
    it comes back; in a slender bar the stress is uniaxial and c = √(E/ρ), and dashpots with c_p
    would send back (c_p − c)/(c_p + c), 7 % at ν = 0.3.

    Args:
        points: Node positions, shape ``(n, 3)`` [m].
        quads: Facets of the surface, shape ``(q, 4)``.
        material: Of the body behind.
        waves: What the body carries, ``plane`` waves or those of a ``bar``.
    """
    lmbda, mu, rho = material.lmbda, material.mu, material.rho
    modulus = lmbda + 2 * mu if waves == "plane" else material.E
    normal, shear = np.sqrt(modulus * rho), np.sqrt(mu * rho)
    x = points[quads]
    n = np.cross(x[:, 2] - x[:, 0], x[:, 3] - x[:, 1])
    n /= np.linalg.norm(n, axis=1)[:, None]
    matrix = np.zeros((len(points), 3, 3))
    for facet, direction in zip(quads, n, strict=True):
        share = nodal_traction(points[facet], np.arange(4)[None], np.ones(3))[:, 0]
        impedance = shear * np.eye(3) + (normal - shear) * np.outer(direction, direction)
        matrix[facet] += share[:, None, None] * impedance
    return matrix
