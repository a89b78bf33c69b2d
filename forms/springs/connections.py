# SPDX-License-Identifier: LGPL-3.0-or-later
"""Springs and dampers that hold bodies to point masses, to each other or to the ground."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from forms.rank_sums import own_part
from forms.springs.dashpots import Dashpots
from forms.springs.node_to_facet import Between
from forms.springs.point_masses import PointMasses, damper_work

Array = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


@dataclass
class Spread:
    """Springs and dampers spread over nodes, each node to its point mass (a pad under a rail).

    Attributes:
        dofs: Owned dof block of each node on this rank, shape ``(n,)``.
        point: Point mass of each node, -1 for the ground, shape ``(n,)``.
        stiffness, damping: Share of each node and direction, shape ``(n, 3)`` [N/m], [N s/m].
        masses: The point masses.
    """

    dofs: npt.NDArray[np.int32]
    point: npt.NDArray[np.int32]
    stiffness: Array
    damping: Array
    masses: PointMasses
    dissipation: float = 0.0
    _damping: Array | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        self._index = entries(self.dofs)
        self._tied = (self.point >= 0).astype(np.float64)[:, None]
        # forces are summed by point mass, those on the ground behind the last one
        self._sums = entries(np.where(self.point >= 0, self.point, len(self.masses.mass))).ravel()

    def stretch(self, u: Array, q: Array) -> Array:
        """Node value less that of its point mass, shape ``(n, 3)``."""
        e = u.take(self._index)
        if len(q):
            e -= self._tied * q.take(self.point, axis=0, mode="clip")
        return e

    def add(self, u: Array, v: Array, force: Array, reaction: Array, dt: float) -> None:
        """Add to the nodal ``force`` and to this rank's share of the ``reaction`` on the masses."""
        rate = self.stretch(v, self.masses.v)
        damping = self.damping * rate
        f = -self.stiffness * self.stretch(u, self.masses.u) - damping
        np.add.at(force, self._index.ravel(), f.ravel())
        ends = np.bincount(self._sums, f.ravel(), reaction.size + 3)[: reaction.size]
        reaction -= ends.reshape(reaction.shape)
        if self._damping is not None:
            self.dissipation += damper_work(self._damping, damping, rate, dt)
        self._damping = damping

    def pull(self, u: Array, out: Array) -> None:
        """Add the pull of the nodes on the masses at rest at zero, this rank's share [N]."""
        tied = self.point >= 0
        np.add.at(out, self.point[tied], (self.stiffness * u.reshape(-1, 3)[self.dofs])[tied])

    def add_stiffness(self, out: Array) -> None:
        """Add this rank's springs to the stiffness on each mass [N/m]."""
        tied = self.point >= 0
        np.add.at(out, self.point[tied], self.stiffness[tied])

    def share(self, number: Ints) -> tuple[Ints, Ints, Array]:
        """This rank's nodes (global), their masses and spring stiffness ``(n, 3)``."""
        return number[self.dofs], self.point.astype(np.int64), self.stiffness

    def stored_energy(self, u: Array) -> float:
        """This rank's share of the spring energy [J]."""
        return float((self.stiffness * self.stretch(u, self.masses.u) ** 2).sum() / 2)


@dataclass
class Mean:
    """One spring and damper on the mean motion of many nodes (an axle box on a turning journal).

    The mean of a ring does not feel the ring turn, which a spring on each node would.

    Attributes:
        dofs: Owned dof blocks on this rank, shape ``(n,)``.
        weight: Share of each node in the mean (sums to 1 over all ranks), shape ``(n,)``.
        point: Point mass at the other end, -1 for the ground.
        stiffness, damping: Shape ``(3,)`` [N/m], [N s/m].
    """

    comm: MPI.Comm
    dofs: npt.NDArray[np.int32]
    weight: Array
    point: int
    stiffness: Array
    damping: Array
    masses: PointMasses
    dissipation: float = 0.0
    _damping: Array | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        self._index = entries(self.dofs)

    def stretch(self, u: Array, q: Array) -> Array:
        """Mean node value less that of the point mass, shape ``(3,)``, alike on all ranks."""
        return self.stretches((u, q))[0]

    def stretches(self, *pairs: tuple[Array, Array]) -> Array:
        """Return :meth:`stretch` of several pairs at once, shape ``(pairs, 3)``."""
        mean = np.array([self.weight @ u.take(self._index) for u, _ in pairs])
        if self.comm.size > 1:
            self.comm.Allreduce(MPI.IN_PLACE, mean)
        if self.point >= 0:
            mean -= [q[self.point] for _, q in pairs]
        return mean

    def add(self, u: Array, v: Array, force: Array, reaction: Array, dt: float) -> None:
        """Add to the nodal ``force`` and, on rank 0, to the ``reaction`` on the masses."""
        e, rate = self.stretches((u, self.masses.u), (v, self.masses.v))
        damping = self.damping * rate
        f = -self.stiffness * e - damping
        np.add.at(force, self._index.ravel(), np.multiply.outer(self.weight, f).ravel())
        if self.comm.rank == 0:
            if self.point >= 0:
                reaction[self.point] -= f
            if self._damping is not None:
                self.dissipation += damper_work(self._damping, damping, rate, dt)
            self._damping = damping

    def pull(self, u: Array, out: Array) -> None:
        """Add the pull of the mean on the mass at rest at zero, all on rank 0 [N]."""
        f = self.stiffness * self.stretch(u, np.zeros_like(self.masses.u))
        if self.comm.rank == 0 and self.point >= 0:
            out[self.point] += f

    def add_stiffness(self, out: Array) -> None:
        """Add the spring to the stiffness on its mass, all on rank 0 [N/m]."""
        if self.comm.rank == 0 and self.point >= 0:
            out[self.point] += self.stiffness

    def share(self, number: Ints) -> tuple[Ints, Ints, Array]:
        """This rank's nodes (global), their mass and weighted stiffness ``(n, 3)``."""
        point = np.full(len(self.dofs), self.point, dtype=np.int64)
        return number[self.dofs], point, np.outer(self.weight, self.stiffness)

    def stored_energy(self, u: Array) -> float:
        """This rank's share (all on rank 0) of the spring energy [J]."""
        energy = float((self.stiffness * self.stretch(u, self.masses.u) ** 2).sum() / 2)
        return energy if self.comm.rank == 0 else 0.0


Link = Spread | Mean | Between | Dashpots


@dataclass
class Connections:
    """All springs and dampers of a model with their point masses, as one load."""

    comm: MPI.Comm
    masses: PointMasses
    links: list[Link]
    dt: float

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
        return {
            "u": m.u, "v": m.v, "sums": np.array([m.dissipation, m.work]),
            "links": np.array(self.comm.allgather(taken)),
        }  # fmt: skip

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
        for link in self.links:
            link.add(state.u.x.array, state.v.x.array, force.array, reaction, dt)
        if self.comm.size > 1:
            self.comm.Allreduce(MPI.IN_PLACE, reaction)
        self.masses.take(reaction + self.masses.base_force(), dt)

    def stored_energy(self, u: Array) -> float:
        """Energy of all springs less the work of gravity on the point masses [J]."""
        links = sum(link.stored_energy(u) for link in self.links)
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
            link.add_stiffness(total)
        if self.comm.size > 1:
            self.comm.Allreduce(MPI.IN_PLACE, total)
        return np.asarray(total + self.masses.base_stiffness)

    def stiffness(self, number: Ints) -> tuple[Ints, Ints, Array]:
        """Stiffness on the nodes with the point masses condensed out, as triplets on rank 0.

        A mass between the springs ``k_i`` to the nodes and the rest of its springs leaves
        ``diag(k) - k kᵀ / Σk``; a held mass leaves ``diag(k)``, a floating one no stiffness at all.

        Args:
            number: Global dof block of each owned dof block, shape ``(owned,)``.

        Returns:
            Global scalar rows, columns and values [N/m].
        """
        total = self.point_stiffness()
        none = np.zeros(0, dtype=np.int64)
        triplets = [(none, none, np.zeros(0))]
        springs = []
        for link in self.links:
            if isinstance(link, Between | Dashpots):  # without point masses
                triplets += self.comm.gather(link.triplets(number)) or []
                continue
            parts = self.comm.gather(link.share(number))
            if parts is not None:
                node, point, k = (np.concatenate(x) for x in zip(*parts, strict=True))
                dof = 3 * node[:, None] + np.arange(3)
                springs.append((dof, point, k))
                triplets += _held(dof, k, isinstance(link, Mean))
        if springs:
            dof, point, k = (np.concatenate(x) for x in zip(*springs, strict=True))
            for m, axis in np.argwhere((self.masses.free > 0) & (total > 0)):
                mine = point == m
                b = k[mine, axis]
                triplets.append(_dense(dof[mine, axis], -np.outer(b, b) / total[m, axis]))
        rows, columns, values = (np.concatenate(x) for x in zip(*triplets, strict=True))
        return rows, columns, values


def entries(dofs: npt.NDArray[np.int32]) -> Ints:
    """Return the entries of dof blocks in a flat vector, shape ``(n, 3)``."""
    return np.asarray(3 * dofs.astype(np.int64)[:, None] + np.arange(3))


def _held(dof: Ints, k: Array, mean: bool) -> Iterator[tuple[Ints, Ints, Array]]:
    """Stiffness of springs whose other end is held, ``dof`` and ``k`` of shape ``(n, 3)``."""
    if not mean:
        yield dof.ravel(), dof.ravel(), k.ravel()
        return
    for axis in np.flatnonzero(k.any(axis=0)):
        b = k[:, axis]
        yield _dense(dof[:, axis], np.outer(b, b) / b.sum())


def _dense(dof: Ints, block: Array) -> tuple[Ints, Ints, Array]:
    return np.repeat(dof, len(dof)), np.tile(dof, len(dof)), block.ravel()
