# SPDX-License-Identifier: LGPL-3.0-or-later
"""Frames that turn with bodies, in which their displacement is small enough for single precision.

The strain of a body that turns is a small part of its displacement gradient, and rounding the
gradient to float32 leaves 1e-7 of a radian in it. In a frame that has turned by a rotation R near
that of the body, the displacement ``Rᵀ (X + u) − X`` has the same strain, as every objective law
says, and a gradient that is small itself; the forces found there are turned back.

R need not be the body's own rotation to the last digit, so it is taken anew every :data:`INTERVAL`
steps only, by each rank from its own nodes.
"""

from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from forms.nodal import lib, pointer
from meshes.arrays import Array, Dofs
from meshes.rotation import nearest_rotation

INTERVAL = 64  # steps; a wheel turns by 1e-3 rad in ten times as many


class TurningFrames:
    """Displacement and velocity in the frames of turning bodies, and forces turned back.

    Attributes:
        relative: Displacement in the frames: ``u`` itself outside of turning bodies [m].
        velocity: Velocity by axes of the frames, if it is asked for [m/s].
        turn: Rotation of each frame, the first that of what does not turn, shape ``(k, 3, 3)``.
    """

    def __init__(self, space: Any, bodies: list[Dofs], *, velocity: bool = False) -> None:
        """Take the local dof blocks of each turning body; no two of them share a node."""
        self.relative = fem.Function(space)
        self.velocity = fem.Function(space) if velocity else None
        self._place = np.ascontiguousarray(space.tabulate_dof_coordinates())
        self._frame = np.zeros(len(self._place), dtype=np.uint8)
        self._bodies = bodies
        for k, dofs in enumerate(bodies, 1):
            self._frame[dofs] = k
        self.turn = np.tile(np.eye(3), (len(bodies) + 1, 1, 1))
        self._own = np.zeros(3 * len(self._place))

    @property
    def force(self) -> Array:
        """Forces in the frames, where a kernel adds; emptied by :meth:`release` [N]."""
        return self._own

    def follow(self, u: Array) -> None:
        """Turn the frames as far as the bodies have turned."""
        for k, dofs in enumerate(self._bodies, 1):
            if len(dofs) < 3:
                continue
            X = self._place[dofs]
            self.turn[k] = nearest_rotation(X, X + u.reshape(-1, 3)[dofs])

    def enter(self, u: Array, v: Array) -> None:
        """Set displacement and velocity from those of the bodies, ``(3 n_local,)`` each."""
        args = len(self._place), pointer(self._frame), pointer(self.turn)
        relative = pointer(self.relative.x.array)
        lib.nd_relative(*args, pointer(self._place), pointer(u), relative)
        if self.velocity is not None:
            lib.nd_turned_back(*args, pointer(v), pointer(self.velocity.x.array))

    def release(self, force: Array) -> None:
        """Add the forces found in the frames, turned back, and empty them."""
        args = len(self._place), pointer(self._frame), pointer(self.turn)
        lib.nd_release(*args, pointer(self._own), pointer(force))

    def memory(self, comm: MPI.Comm) -> Array:
        """Return the rotations on each rank, shape ``(ranks, k, 3, 3)``; collective."""
        return np.array(comm.allgather(self.turn))

    def restore(self, comm: MPI.Comm, turns: npt.NDArray[np.float64]) -> None:
        """Go on from what :meth:`memory` returned.

        On other ranks than then each body has the rotation of the rank that saw it turn furthest:
        ranks without nodes of it saw none.
        """
        if len(turns) == comm.size:
            self.turn[:] = turns[comm.rank]
            return
        furthest = np.argmin(np.trace(turns, axis1=2, axis2=3), axis=0)
        self.turn[:] = turns[furthest, np.arange(len(self.turn))]
