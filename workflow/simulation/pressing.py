# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact forces between linear elastic bodies: springs that push and never pull.

A spring with the row ``b`` has the gap ``b · u`` and pushes with ``pᵀ λ``, where ``p`` is ``b``
unless it rubs. With the compliance ``F = B K⁻¹ Pᵀ`` of the bodies where they touch, which friction
makes unsymmetric, the gaps follow from the forces, and the forces ``λ = k max(0, -gap)`` are found
with matrices as small as the number of springs that touch: an active set, as in Kunisch and Stadler
(2005), Generalized Newton methods for the 2D-Signorini contact problem.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from dolfinx import la
from scipy.linalg import solve
from scipy.sparse import csr_array, vstack

from contact.one_pass import Pass
from contact.tangent import RestSprings, relative_rows
from meshes.arrays import Array, Flags, Index
from workflow.model import Model
from workflow.simulation.elastic import Elastic

TOGETHER = 32  # springs whose columns are solved for at a time
TURNED = 1e-3  # change of a row, of unit weights and normals, that asks for a new column
ROUNDS = 100  # of the active set, at most; a few are the rule


@dataclass(frozen=True, eq=False)
class Springs:
    """Springs of all contacts near touch, the same on all ranks.

    Attributes:
        number: Of each among all that there can be, shape ``(m,)``.
        B: Gaps by displacements of the surfaces, shape ``(m, n)``.
        P: Displacements of the surfaces that their forces do work on, shape ``(m, n)``.
        gap: Negative where they touch, shape ``(m,)`` [m].
        stiffness: Shape ``(m,)`` [N/m].
    """

    number: Index
    B: csr_array
    P: csr_array
    gap: Array
    stiffness: Array

    @property
    def force(self) -> Array:
        """What they push with, shape ``(m,)`` [N]."""
        return self.stiffness * np.maximum(0.0, -self.gap)


Pushing = Callable[[Pass, RestSprings], Array]  # the force of each spring per normal force, (m, 3)


class Surfaces:
    """Surfaces in contact, and how much they yield to contact springs.

    Attributes:
        model: The model.
        elastic: Its bodies.
        count: Springs that there can be.
    """

    def __init__(self, model: Model, elastic: Elastic, pushing: Pushing | None = None) -> None:
        """Take surfaces.

        Args:
            model: The model.
            elastic: Its bodies.
            pushing: Direction in which springs push; along their normals if None.
        """
        self.model, self.pushing = model, pushing
        stacks = [side.stack for pair in model.pairs.values() for side in pair.passes]
        self.count = sum(stack.nc for stack in stacks)
        none = np.zeros(0, dtype=np.int64)
        self.nodes = np.unique(np.concatenate([none, *(stack.node for stack in stacks)]))
        self.nodes = self.nodes[self.nodes >= 0]
        own = model.domain.nodes[: model.domain.owned]
        _, place, dof = np.intersect1d(self.nodes, own, return_indices=True)
        self._place, self._dof = _axes(place), _axes(dof)
        self.take(elastic)

    def take(self, elastic: Elastic) -> None:
        """Take bodies, whose answers to all springs are to be learned."""
        self.elastic = elastic
        self._column = np.full(self.count, -1)
        self._B = self._P = csr_array((0, 3 * len(self.nodes)))
        self._U = np.zeros((3 * len(self.nodes), 0))

    def springs(self) -> Springs:
        """Return the springs near touch at the present displacement; collective."""
        first, found = 0, []
        for pair in self.model.pairs.values():
            at_rest = pair.springs_at_rest(self.model.state)
            for side, springs in zip(pair.passes, at_rest, strict=True):
                B = P = relative_rows(springs.nodes, springs.weight, springs.normal, self.nodes)
                if self.pushing is not None:
                    way = self.pushing(side, springs)
                    P = relative_rows(springs.nodes, springs.weight, way, self.nodes)
                found.append((first + springs.number, B, P, springs))
                first += side.stack.nc
        if not found:
            none = np.zeros(0)
            return Springs(none.astype(np.int64), self._B[:0], self._P[:0], none, none)
        number, B, P, parts = zip(*found, strict=True)
        gap = np.concatenate([part.gap for part in parts])
        stiffness = np.concatenate([part.stiffness for part in parts])
        rows = vstack(B).tocsr(), vstack(P).tocsr()
        return Springs(np.concatenate(number), *rows, gap, stiffness)

    def read(self, u: la.Vector) -> Array:
        """Return the displacement of the surfaces, shape ``(n,)`` [m]; collective."""
        return self._gathered(u.array[self._dof])

    def _gathered(self, own: Array) -> Array:
        whole = np.zeros((3 * len(self.nodes), *own.shape[1:]))
        whole[self._place] = own
        return np.asarray(self.elastic.comm.allreduce(whole))

    def push(self, springs: Springs, force: Array, out: la.Vector) -> None:
        """Add what springs with forces ``(m,)`` [N] push the owned dofs with."""
        out.array[self._dof] += (springs.P.T @ force)[self._place]

    def yielding(self, springs: Springs, chosen: Index) -> tuple[Array, Array]:
        """Return how far gaps and surfaces move under unit forces of the chosen springs [m/N].

        A column lasts while the spring's place and direction do, roughly.

        Returns:
            Shapes ``(k, k)``, symmetric without friction, and ``(n, k)``.
        """
        number, B, P = springs.number[chosen], springs.B[chosen], springs.P[chosen]
        column = self._column[number]
        fresh = column < 0
        known = np.flatnonzero(~fresh)
        change = P[known] - self._P[column[known]]
        fresh[known] = (change * change).sum(axis=1) > TURNED**2
        for part in np.array_split(np.flatnonzero(fresh), -(-fresh.sum() // TOGETHER) or 1):
            self._learn(number[part], B[part], P[part])
        column = self._column[number]
        U = self._U[:, column]
        F = self._B[column] @ U
        return (F + F.T) / 2 if self.pushing is None else F, U

    def _learn(self, number: Index, B: csr_array, P: csr_array) -> None:
        """Solve for the displacements under unit forces of springs."""
        if not len(number):
            return
        forces = np.zeros((self.elastic.n, len(number)))
        forces[self._dof] = P.T.toarray()[self._place]
        self._column[number] = self._U.shape[1] + np.arange(len(number))
        self._B, self._P = vstack([self._B, B]).tocsr(), vstack([self._P, P]).tocsr()
        U = self._gathered(self.elastic.solve_many(forces)[self._dof])
        self._U = np.hstack([self._U, U])

    def pressed(self, springs: Springs, before: Array, way: Array) -> Array:
        """Return the forces of the springs when the bodies have given way to them [N].

        Args:
            springs: The springs.
            before: Their forces so far, shape ``(m,)`` [N].
            way: How far the surfaces move under these, shape ``(n,)`` [m].
        """
        gap, active = springs.gap + springs.B @ way, before > 0.0
        if not active.any():
            active = first_touch(springs.gap, gap)
        force, kind = before, "pos" if self.pushing is None else "gen"
        for _ in range(ROUNDS):
            on = np.flatnonzero(active | (before > 0.0))
            F, U = self.yielding(springs, on)
            a = active[on]
            force = np.zeros_like(before)
            if a.any():
                M = F[np.ix_(a, a)] + np.diag(1.0 / springs.stiffness[on[a]])
                force[on[a]] = solve(M, (F @ before[on] - gap[on])[a], assume_a=kind)
            left = gap + springs.B @ (U @ (force - before)[on])
            pulls, overlaps = force < 0.0, ~active & (left < 0.0)
            if not (pulls | overlaps).any():
                break
            active = (active & ~pulls) | deepest(left, overlaps, max(TOGETHER, int(active.sum())))
        return np.maximum(force, 0.0)


def first_touch(now: Array, then: Array) -> Flags:
    """Return the springs that touch first, by the gaps now and as they become with no force [m].

    Round bodies that are pressed into each other touch where the overlap was half of the deepest.
    """
    overlap = min(now.min(initial=0.0), 0.0)
    if overlap < 0.0:
        return deepest(now, now <= 0.5 * overlap, TOGETHER)
    return deepest(now, np.full(len(now), then.min(initial=0.0) < 0.0), 1)


def deepest(gap: Array, among: Flags, count: int) -> Flags:
    """Return the ``count`` springs with the smallest gaps among some.

    Where they push, many others part again, and need no column.
    """
    chosen, some = np.zeros(len(gap), dtype=bool), np.flatnonzero(among)
    chosen[some[np.argsort(gap[some], kind="stable")[:count]]] = True
    return chosen


def _axes(nodes: Index) -> Index:
    """Return the scalar dofs of nodes."""
    return np.asarray((3 * nodes[:, None] + np.arange(3)).ravel())
