# SPDX-License-Identifier: LGPL-3.0-or-later
"""Positions and velocities of the nodes of a contact pair, the same on every rank.

Surfaces cross rank borders, so every rank holds the nodes of both. Between searches only the
nodes near the patch are told. Every rank then has the same closest points, found by all together
(:mod:`contact.sharing`), computes the same forces, and adds them to the dofs that it owns.
"""

from typing import TYPE_CHECKING, Any

import numpy as np

from contact._kernel import lib
from contact.arrays import Index32, view
from contact.stack import Stack
from meshes.arrays import Array

if TYPE_CHECKING:
    from mpi4py import MPI


class Exchange:
    """Gathers the nodes of a pass, numbered as in its stack, and places its points.

    Attributes:
        xv: Current position and velocity, shape ``(n, 6)`` [m, m/s].
        past: Positions at the last :meth:`mark`, shape ``(n, 3)`` [m].
        ahead: As ``xv``, one step ahead, see :meth:`predict`.
        c_xv, c_ahead: The same for the kernel.
    """

    def __init__(self, stack: Stack, comm: "MPI.Comm | None", points: Any = None) -> None:
        """Prepare for the nodes of a stack; ``points`` are those of the kernel, if there are."""
        reference, dofs, n = stack.reference, stack.dofs, stack.n
        self._target, self._points = stack.target, points
        self._nc = stack.nc
        self._on_target = np.zeros(n, dtype=bool)
        self._on_target[stack.target] = True
        self.comm = comm if comm is not None and comm.size > 1 else None
        self.xv = np.zeros((n, 6))
        self.xv[:, :3] = reference
        self.past = np.ascontiguousarray(reference, dtype=np.float64).copy()
        self.ahead = self.xv.copy()
        self._dofs = np.ascontiguousarray(dofs, dtype=np.int32)
        self._need = 3 * (int(self._dofs.max(initial=-1)) + 1)
        self._owner = np.where(self._dofs >= 0, 0, -1)
        if self.comm is not None:
            from mpi4py import MPI

            owner = np.where(self._dofs >= 0, self.comm.rank, -1)
            self.comm.Allreduce(MPI.IN_PLACE, owner, op=MPI.MAX)
            self._owner = owner
        self._reference = np.ascontiguousarray(reference, dtype=np.float64).copy()
        self._c = (
            view("dofs", self._dofs, (n,), np.int32),
            view("reference", self._reference, (n, 3)),
        )
        self._past = view("past", self.past, (n, 3))
        self.c_xv = view("xv", self.xv, (n, 6), out=True)
        self.c_ahead = view("ahead", self.ahead, (n, 6), out=True)
        self._split: tuple[Any, ...] | None = None
        self._all = self._plan(np.arange(n, dtype=np.int32))
        self._chosen = self._plan(np.empty(0, dtype=np.int32))

    def _plan(self, item: Index32) -> tuple[Any, ...]:
        """Return who sends what for these nodes, and which points to place.

        (own, its view, order, counts, buffer, points, their view).
        """
        placed = np.ascontiguousarray(item[item < self._nc]) if self._points else item[:0]
        item = item[self._owner[item] >= 0]
        own = np.ascontiguousarray(item[self._dofs[item] >= 0])
        owner = self._owner[item]
        order = item[np.argsort(owner, kind="stable")]
        ranks = self.comm.size if self.comm is not None else 1
        counts = 6 * np.bincount(owner, minlength=ranks)
        c_own, c_placed = (view("nodes", a, (-1,), np.int32) for a in (own, placed))
        return own, c_own, order, counts, np.empty((len(item), 6)), placed, c_placed

    def _gather(self, plan: tuple[Any, ...], u: Array, v: Array) -> float:
        own, c_own, order, counts, buffer, _, _ = plan
        if u.size < self._need or v.size != u.size:
            raise ValueError(
                f"state: expected u and v of at least {self._need} values, got {u.size}, {v.size}"
            )
        cu, cv = view("u", u, (-1,)), view("v", v, (-1,))
        moved = lib.wr_gather(len(own), c_own, *self._c, cu, cv, self._past, self.c_xv)
        if self.comm is None:
            self._place(plan, self.c_xv)
            return moved
        self.comm.Allgatherv(self.xv[own], (buffer, counts))
        self.xv[order] = buffer
        self._place(plan, self.c_xv)
        step = buffer[:, :3] - self.past[order]
        return float(np.sqrt(np.einsum("ia,ia->i", step, step).max(initial=0.0)))

    def _place(self, plan: tuple[Any, ...], xv: Any) -> None:
        if self._points:
            lib.wr_place(self._points, len(plan[5]), plan[6], xv)

    def wandered(self, u: Array, v: Array) -> float:
        """Return how far nodes of both surfaces can have come closer [m].

        That is the largest way of the contactor's nodes since :meth:`mark` plus that of the
        target's, over all nodes, chosen or not, both seen from the first one of the target.
        """
        first, on_target = self._target.start, self._on_target
        if self._split is None:
            own = np.flatnonzero(self._dofs >= 0).astype(np.int32)
            parts = own[~on_target[own]], own[on_target[own]]
            self._split = tuple((len(a), view("own", a, (-1,), np.int32)) for a in parts)
        ride = np.zeros(3)
        if (dof := int(self._dofs[first])) >= 0:
            ride = self._reference[first] + u[3 * dof : 3 * dof + 3] - self.past[first]
        if self.comm is not None:
            from mpi4py import MPI

            self.comm.Allreduce(MPI.IN_PLACE, ride)
        past = view("past", self.past + ride, self.past.shape)
        cu, cv = view("u", u, (-1,)), view("v", v, (-1,))
        ways = np.array(
            [lib.wr_gather(k, own, *self._c, cu, cv, past, self.c_xv) for k, own in self._split]
        )
        # a surface without dofs stands still and is seen to ride backwards
        fixed = [self._owner[~on_target].max() < 0, self._owner[on_target].max() < 0]
        ways[fixed] = np.linalg.norm(ride)
        if self.comm is not None:
            self.comm.Allreduce(MPI.IN_PLACE, ways, op=MPI.MAX)
        return float(ways.sum())

    def whole(self, u: Array, v: Array) -> float:
        """Read all nodes; return the largest distance moved since :meth:`mark` [m]."""
        return self._gather(self._all, u, v)

    def update(self, u: Array, v: Array) -> float:
        """Read the chosen nodes; return the largest distance they moved [m]."""
        return self._gather(self._chosen, u, v)

    def predict(self, c_pass: Any, force: Array, dt: float, kick: float) -> None:
        """Fill ``ahead`` for the chosen nodes.

        Args:
            c_pass: The pass, for the kernel.
            force: All forces of the step but those of the contact, flat, owned dofs [N].
            dt: Step [s].
            kick: Time over which the forces act; half of it at the start, whose v is at t [s].
        """
        own, c_own, order, counts, buffer, _, _ = self._chosen
        c_force = view("force", force, (-1,))
        lib.wr_predict(c_pass, len(own), c_own, dt, kick, c_force, self.c_ahead)
        if self.comm is not None:
            self.comm.Allgatherv(self.ahead[own], (buffer, counts))
            self.ahead[order] = buffer
        self._place(self._chosen, self.c_ahead)

    @property
    def shared(self) -> int:
        """Number of nodes that the ranks tell each other of at every step, 48 bytes each."""
        return len(self._chosen[2])

    def mark(self) -> None:
        """Measure motion from the present positions."""
        self.past[:] = self.xv[:, :3]

    def choose(self, item: Index32) -> None:
        """Make :meth:`update` read these nodes only."""
        self._chosen = self._plan(item)
