# SPDX-License-Identifier: LGPL-3.0-or-later
"""Loads that are not springs: dead loads, drive torque, mass-proportional damping.

Each is a callable ``add(state, force)`` and knows the work it has done.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
import ufl

Array = npt.NDArray[np.float64]
Dofs = npt.NDArray[np.int32]


def gravity(w: Any, rho: float, g: Sequence[float]) -> Any:
    """Virtual work of the weight, ``ρ g · w``, with the acceleration of gravity ``g`` [m/s²]."""
    return rho * ufl.inner(ufl.as_vector(list(g)), w)


def nodal_traction(points: Array, quads: npt.NDArray[np.int64], traction: Array) -> Array:
    """Return the nodal forces of a dead traction on bilinear quads, shape ``(n, 3)`` [N].

    Args:
        points: Node positions, shape ``(n, 3)`` [m].
        quads: Nodes of each quad, shape ``(q, 4)``.
        traction: Force per reference area, shape ``(3,)`` [Pa].
    """
    share = np.zeros(len(points))
    x = points[quads]
    for a, b in np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) / np.sqrt(3):
        N = (
            np.array([(1 - a) * (1 - b), (1 + a) * (1 - b), (1 + a) * (1 + b), (1 - a) * (1 + b)])
            / 4
        )
        da = np.array([b - 1, 1 - b, 1 + b, -1 - b]) / 4
        db = np.array([a - 1, -1 - a, 1 + a, 1 - a]) / 4
        area = np.linalg.norm(
            np.cross(np.einsum("i,qid->qd", da, x), np.einsum("i,qid->qd", db, x)), axis=1
        )
        np.add.at(share, quads, area[:, None] * N)
    return share[:, None] * np.asarray(traction)


@dataclass
class DeadLoad:
    """A constant nodal force: gravity, traction.

    Attributes:
        nodal: Force on every owned dof, shape ``(3 * owned,)`` [N].
    """

    comm: MPI.Comm
    nodal: Array

    def add(self, state: Any, force: Any) -> None:
        """Add the load."""
        force.array[: len(self.nodal)] += self.nodal

    def work(self, u: Array) -> float:
        """Work done since the undeformed state [J]."""
        return float(self.comm.allreduce(self.nodal @ u[: len(self.nodal)]))


@dataclass
class MassDamping:
    """Rayleigh damping in proportion to mass, ``−α m v``.

    Attributes:
        nodal: ``α m`` of every owned dof, shape ``(3 * owned,)`` [N s/m].
        dt: Step, for the energy taken [s].
    """

    comm: MPI.Comm
    nodal: Array
    dt: float
    dissipation: float = 0.0
    _last: Array | None = field(default=None, repr=False)

    def add(self, state: Any, force: Any) -> None:
        """Add the damping force and collect its work (trapezoidal, over the way ``dt v``)."""
        v = state.v.x.array[: len(self.nodal)]
        f = self.nodal * v
        force.array[: len(self.nodal)] -= f
        if self._last is not None:
            self.dissipation += self.dt * float(((self._last + f) * v).sum()) / 2
        self._last = f


@dataclass
class DriveTorque:
    """A torque on the nodes of a turning body about its own mean axis, ramped from zero.

    The force on a node is ``T m (n × r) / Σ m r²``, a rigid angular acceleration of that region.

    Attributes:
        dofs: Owned dof blocks of the region, shape ``(k,)``.
        mass: Their masses, shape ``(k,)`` [kg].
        reference: Their reference positions, shape ``(k, 3)`` [m].
        axis: Unit vector, shape ``(3,)``.
        torque: Final torque [N m].
        ramp: Time to reach it [s].
    """

    comm: MPI.Comm
    dofs: Dofs
    mass: Array
    reference: Array
    axis: Array
    torque: float
    ramp: float
    work: float = 0.0
    _last: tuple[Array, Array] | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        self.total = float(self.comm.allreduce(self.mass.sum()))
        turn = self._turn(self.reference)
        self.inertia = float(self.comm.allreduce((self.mass * (turn**2).sum(axis=1)).sum()))

    def _turn(self, x: Array) -> Array:
        """Return ``n × r`` of the nodes at ``x``, ``r`` from the mean axis, shape ``(k, 3)``."""
        moment = self.mass @ x
        centre = (self.comm.allreduce(moment) if self.comm.size > 1 else moment) / self.total
        nx, ny, nz = self.axis
        return np.asarray((x - centre) @ np.array([[0, nz, -ny], [-nz, 0, nx], [ny, -nx, 0]]))

    def add(self, state: Any, force: Any) -> None:
        """Add the torque and collect its work (trapezoidal in displacement)."""
        torque = self.torque * (min(1.0, state.t / self.ramp) if self.ramp > 0 else 1.0)
        u = state.u.x.array.reshape(-1, 3)[self.dofs]
        f = (torque / self.inertia * self.mass)[:, None] * self._turn(self.reference + u)
        force.array.reshape(-1, 3)[self.dofs] += f
        if self._last is not None:
            u0, f0 = self._last
            self.work += float(np.vdot(f0 + f, u - u0)) / 2
        self._last = (u, f)
