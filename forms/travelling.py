# SPDX-License-Identifier: LGPL-3.0-or-later
"""Travelling load: a semi-elliptic traction, as Hertz's pressure, that passes over a surface."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

from mpi4py import MPI

import numpy as np
from scipy.sparse import csr_array

from forms.loads import smooth_step
from forms.rank_sums import gathered, own_part
from meshes.arrays import Array, Dofs, Index

POINTS = 6  # of Gauss along each edge of a facet: the total within 0.5 % at 4 facets per half width


@dataclass
class TravellingLoad:
    """A traction that travels along x, semi-elliptic over its width as Hertz's pressure.

    ``traction · A(t) √(1 − ((x − x₀ − V t) / a)²)`` at the undeformed places, zero outside; A goes
    smoothly from 0 to 1 within ``ramp`` and back to 0 within ``ramp`` before ``until``.

    Attributes:
        dofs: Owned dof blocks that bear it, shape ``(k,)``.
        shares: Of their forces by the values at points of the surface, shape ``(k, m)`` [m²].
        x: Of these points, shape ``(m,)`` [m].
        traction: Largest force per area, shape ``(3,)`` [Pa].
        half_width, start, speed: a and x₀ [m], V [m/s].
        ramp, until: Times [s].
        dt: Step, for the work [s].
    """

    rest: ClassVar = None  # it comes up from zero after the start

    comm: MPI.Comm
    dofs: Dofs
    shares: csr_array
    x: Array
    traction: Array
    half_width: float
    start: float
    speed: float
    ramp: float
    until: float
    dt: float
    work: float = 0.0
    _before: Array | None = field(default=None, repr=False)

    def at(self, t: float) -> Array:
        """Return the area that bears the full traction at a time by node, shape ``(k,)`` [m²]."""
        size = smooth_step(t / self.ramp) * smooth_step((self.until - t) / self.ramp)
        xi = (self.x - (self.start + self.speed * t)) / self.half_width
        return np.asarray(self.shares @ (size * np.sqrt(np.maximum(0.0, 1.0 - xi * xi))))

    def add(self, state: Any, force: Any) -> None:
        """Add the load and collect its work (trapezoidal, over the way ``dt v``)."""
        area = self.at(state.t)
        force.array.reshape(-1, 3)[self.dofs] += area[:, None] * self.traction
        if self._before is not None:
            way = self.dt * (state.v.x.array.reshape(-1, 3)[self.dofs] @ self.traction)
            self.work += float((self._before + area) @ way) / 2
        self._before = area

    def retime(self, dt: float) -> None:
        """Go on with another step [s]."""
        self.dt = dt

    def energy(self, state: Any) -> dict[str, float]:
        """Return the work done so far [J]; collective."""
        return {"external_work": self.comm.allreduce(self.work)}

    def memory(self) -> dict[str, Array]:
        """Return the work done on each rank; collective."""
        return {"work": gathered(self.comm, self.work)}

    def restore(self, memory: Mapping[str, Array]) -> None:
        """Go on from what :meth:`memory` returned."""
        self.work = own_part(self.comm, memory["work"])


def surface_shares(points: Array, quads: Index) -> tuple[csr_array, Array]:
    """Return what turns tractions at points of a surface into nodal forces, and the points' x.

    Args:
        points: Node positions, shape ``(n, 3)`` [m].
        quads: Nodes of each bilinear quad, shape ``(q, 4)``.

    Returns:
        Shape functions times weights ``(n, m)`` [m²], and ``(m,)`` [m].
    """
    gauss, weight = np.polynomial.legendre.leggauss(POINTS)
    r, s = (g.ravel() for g in np.meshgrid((1 + gauss) / 2, (1 + gauss) / 2))
    w = np.outer(weight, weight).ravel() / 4
    N = np.stack([(1 - r) * (1 - s), r * (1 - s), r * s, (1 - r) * s])
    along_r = np.stack([s - 1, 1 - s, s, -s])
    along_s = np.stack([r - 1, -r, r, 1 - r])
    corners = points[quads]
    normal = np.cross(
        np.einsum("qai,am->qmi", corners, along_r), np.einsum("qai,am->qmi", corners, along_s)
    )
    area = np.linalg.norm(normal, axis=2) * w
    values = area[:, None, :] * N
    m = area.size
    column = np.broadcast_to(np.arange(m).reshape(len(quads), 1, -1), values.shape)
    row = np.broadcast_to(quads[:, :, None], values.shape)
    entries = (values.ravel(), (row.ravel(), column.ravel()))
    x = np.einsum("qa,am->qm", corners[:, :, 0], N).ravel()
    return csr_array(entries, shape=(len(points), m)), x
