# SPDX-License-Identifier: LGPL-3.0-or-later
"""Springs and dampers of a model with their point masses, as one load."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from mpi4py import MPI

import numpy as np
from scipy.sparse import block_diag, bsr_array, csr_array, diags_array, hstack, kron

from forms.rank_sums import own_part
from forms.springs.point_masses import PointMasses
from forms.springs.springs import Springs
from meshes.arrays import Array, Dofs, Index

Triplets = tuple[Index, Index, Array]


@dataclass
class Connections:
    """All springs and dampers of a model with their point masses, as one load.

    Attributes:
        comm: Ranks.
        masses: Point masses.
        links: Springs and dampers.
        dt: Step [s].
        names: What each of the links is called.
    """

    comm: MPI.Comm
    masses: PointMasses
    links: list[Springs]
    dt: float
    names: list[str] = field(default_factory=list)

    def rest(self, state: Any, force: Any) -> None:
        """Add the forces on the nodes with the point masses settled under their displacement."""
        self.settle(state.u.x.array)
        self.add(state, force)

    def back(self, dt: float) -> None:
        """Take the velocity of the point masses back by ``dt`` [s]."""
        self.masses.back(dt)

    def step(self, dt: float) -> None:
        """Kick and drift the point masses over ``dt`` [s]."""
        self.masses.step(dt)

    def retime(self, dt: float) -> None:
        """Go on with another step [s]."""
        self.dt = dt

    def energy(self, state: Any) -> dict[str, float]:
        """Return kinetic energy, spring energy, energy taken and work done [J]; collective."""
        return {
            "spring": self.stored_energy(state.u.x.array),
            "damping": self.dissipation(),
            "external_work": self.masses.work,
            "kinetic": self.masses.kinetic_energy(self.dt),
        }

    def memory(self) -> dict[str, Array]:
        """Return the motion of the point masses and the sums of each rank; collective."""
        m, taken = self.masses, [link.dissipation for link in self.links]
        sums = np.array([m.dissipation, m.work])
        return {"u": m.u, "v": m.v, "sums": sums, "links": np.array(self.comm.allgather(taken))}

    def restore(self, memory: Mapping[str, Array]) -> None:
        """Go on from what :meth:`memory` returned."""
        m = self.masses
        m.u[:], m.v[:] = memory["u"], memory["v"]
        m.dissipation, m.work = map(float, memory["sums"])
        for link, parts in zip(self.links, memory["links"].T, strict=True):
            link.dissipation = own_part(self.comm, parts)

    def add(self, state: Any, force: Any) -> None:
        """Add the forces on the nodes and collect those on the point masses."""
        reaction = np.zeros_like(self.masses.u)
        dt = self.dt if state.step > 0 else 0.0  # nothing has moved yet
        u, v = state.u.x.array, state.v.x.array
        for link in self.links:
            link.add(u, v, self.masses, force.array, reaction, dt)
        if self.comm.size > 1:
            self.comm.Allreduce(MPI.IN_PLACE, reaction)
        self.masses.take(reaction + self.masses.base_force(), dt)

    def forces(self) -> Iterator[tuple[str, Array]]:
        """Yield name and force of each link at the last step, ``(3,)`` [N]; collective.

        It acts on the body, or from the ground on point masses.
        """
        for name, link in zip(self.names, self.links, strict=True):
            yield name, self.comm.allreduce(link.force)
        if self.masses.base_stiffness.any() or self.masses.base_damping.any():
            m = self.masses
            yield "ballast", -(m.base_stiffness * m.u + m.base_damping * m.v).sum(axis=0)

    def stored_energy(self, u: Array) -> float:
        """Energy of all springs less the work of gravity on the point masses [J]."""
        links = sum(link.stored_energy(u, self.masses.u) for link in self.links)
        return float(self.comm.allreduce(links)) + self.masses.stored_energy()

    def dissipation(self) -> float:
        """Energy taken by all dampers so far [J]."""
        links = sum(link.dissipation for link in self.links)
        return float(self.comm.allreduce(links)) + self.masses.dissipation

    def settle(self, u: Array) -> None:
        """Move the point masses to rest at the displacement ``u`` of the nodes."""
        pull = np.zeros_like(self.masses.u)
        for link in self.links:
            link.pull(u, pull)
        if self.comm.size > 1:
            self.comm.Allreduce(MPI.IN_PLACE, pull)
        pull += self.masses.mass[:, None] * self.masses.gravity
        total = self.point_stiffness()
        settled = (self.masses.free > 0) & (total > 0)
        self.masses.u[:] = np.where(settled, pull / np.where(total > 0, total, 1.0), 0.0)

    def point_stiffness(self) -> Array:
        """Sum of all springs on each point mass, shape ``(m, 3)`` [N/m]."""
        total = np.zeros_like(self.masses.u)
        for link in self.links:
            link.add_at_points(link.stiffness, total)
        if self.comm.size > 1:
            self.comm.Allreduce(MPI.IN_PLACE, total)
        return np.asarray(total + self.masses.base_stiffness)

    def stiffness(self, number: Index) -> Triplets:
        """Stiffness on the nodes with the point masses condensed out, as triplets on rank 0.

        A mass between the springs ``k_i`` to the nodes and the rest of its springs leaves
        ``diag(k) - k kᵀ / Σk``; a held mass leaves ``diag(k)``, a floating one no stiffness at all.

        Args:
            number: Global dof block of each owned dof block, shape ``(owned,)``.

        Returns:
            Global scalar rows, columns and values [N/m].
        """
        total = self.point_stiffness()
        if (found := self._whole(number)) is None:
            none = np.zeros(0, dtype=np.int64)
            return none, none, np.zeros(0)
        B, node, point, k, _ = found
        settling = np.where(self.masses.free > 0, total, 0.0)
        triplets = _condensed(B, node, point, k, settling)
        rows, columns, values = map(np.concatenate, zip(*triplets, strict=True))
        return rows, columns, values

    def _whole(self, number: Index) -> "tuple[csr_array, Index, Dofs, Array, Array] | None":
        """Return all springs on rank 0, None elsewhere or without any; collective.

        Returns:
            Stretches by nodes, global dof block of each node; point mass at the other end (-1:
            none), stiffness ``(n, 3)`` and damping ``(n, 3, 3)`` of each spring.
        """
        gathered: list[Any] = []
        first = 0
        for link in self.links:
            gathered += self.comm.gather(link.entries(number, first)) or []
            first += link.count
        if not gathered:
            return None
        row, node, weight, own, point, k, c = map(np.concatenate, zip(*gathered, strict=True))
        order = np.argsort(own)
        node, column = np.unique(node, return_inverse=True)
        B = csr_array((weight, (row, column)), shape=(first, len(node)))
        return B, node, point[order], k[order], c[order]

    def tangent(self, number: Index, first: int) -> tuple[Triplets, Triplets]:
        """Return stiffness and damping on nodes and free point masses, as triplets on rank 0.

        Args:
            number: Global dof block of each owned dof block, shape ``(owned,)``.
            first: Number of the first free component of a point mass, in the order of ``free``.

        Returns:
            Global scalar rows, columns and values [N/m], and the same of the dampers [N s/m].
        """
        found, m, none = self._whole(number), self.masses, np.zeros(0, dtype=np.int64)
        if self.comm.rank:
            return (none, none, np.zeros(0)), (none, none, np.zeros(0))
        parts = diags_array(m.base_stiffness.ravel()), diags_array(m.base_damping.ravel())
        place = np.where(m.free.ravel() > 0, first - 1 + np.cumsum(m.free.ravel() > 0), -1)
        if found is not None:
            B, node, point, k, c = found
            on = np.flatnonzero(point >= 0)
            ends = csr_array((-np.ones(len(on)), (on, point[on])), (len(point), len(m.mass)))
            stretch = kron(hstack([B, ends]), np.eye(3)).tocsr()
            place = np.concatenate([(3 * node[:, None] + np.arange(3)).ravel(), place])
            parts = tuple(
                stretch.T @ blocks @ stretch + block_diag([csr_array((3 * len(node),) * 2), base])
                for blocks, base in zip((diags_array(k.ravel()), _blocks(c)), parts, strict=True)
            )
        K, C = (_placed(part, place) for part in parts)
        return K, C


def _blocks(c: Array) -> bsr_array:
    """Return matrices ``(n, 3, 3)`` along a diagonal."""
    n = len(c)
    return bsr_array((c, np.arange(n), np.arange(n + 1)), shape=(3 * n, 3 * n))


def _placed(matrix: Any, place: Index) -> Triplets:
    """Return the entries of a matrix by the number of each row and column, -1 for none."""
    entries = matrix.tocoo()
    row, column = place[entries.row], place[entries.col]
    kept = (row >= 0) & (column >= 0)
    return row[kept], column[kept], entries.data[kept]


def _condensed(
    B: "csr_array", node: Index, point: Dofs, k: Array, total: Array
) -> Iterator[Triplets]:
    """Yield ``Bᵀ k B`` of each direction, and what it loses where the point masses settle.

    Args:
        B: Stretches by nodes.
        node: Global dof block of each node.
        point: Point mass at the other end of each spring, -1 for none, shape ``(n,)``.
        k: Springs, shape ``(n, 3)`` [N/m].
        total: Stiffness on each point mass, 0 where it is held, shape ``(m, 3)`` [N/m].
    """
    for axis in range(3):
        on = np.flatnonzero(k[:, axis])
        springs = diags_array(k[on, axis])
        parts = [B[on].T @ springs @ B[on]]
        settle = on[point[on] >= 0]
        settle = settle[total[point[settle], axis] > 0]
        if len(settle):
            ends = np.arange(len(settle)), point[settle]
            pull = B[settle].T @ csr_array((k[settle, axis], ends), (len(settle), len(total)))
            compliance = 1 / np.where(total[:, axis] > 0, total[:, axis], np.inf)
            parts.append(pull @ diags_array(-compliance) @ pull.T)
        for K in (part.tocoo() for part in parts):
            yield 3 * node[K.row] + axis, 3 * node[K.col] + axis, K.data
