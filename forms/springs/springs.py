# SPDX-License-Identifier: LGPL-3.0-or-later
"""Springs and dampers between nodes, point masses and the ground, ``f = −Bᵀ (k B u + c B v)``.

The kinds differ in the matrix B alone: a node and the other end (:func:`spread`), the mean of many
nodes (:func:`mean`), a node and a point of a facet (:func:`node_to_facet`).
"""

from typing import Any

from mpi4py import MPI

import dolfinx
import numpy as np
import numpy.typing as npt
from dolfinx import la
from scipy.sparse import csr_array

from forms.nodal import lib, pointer, struct
from forms.springs.point_masses import PointMasses
from meshes.arrays import Array, Dofs, Index

TAG = 4711  # of the messages that set up the exchange


class Springs:
    """Springs with dampers beside them, each on one stretch of the nodes and point masses.

    A rank has the columns of the nodes it owns. A row with nodes of several ranks is on each of
    them; its partial sums are added up between these ranks, and each then knows the force on its
    own nodes. The first rows are owned, and only these count point masses and energies.

    Attributes:
        B: Stretches by nodes, then point masses; one matrix for all directions.
        dofs: Owned dof block of each node of B, distinct, shape ``(m,)``.
        points: Point mass of each further column of B, distinct.
        rows: Number of each row of this rank among those of all, shape ``(n,)``.
        owned: How many of them this rank owns.
        point: Point mass at the other end, -1 for the ground or a facet, shape ``(n,)``.
        stiffness: Of each and direction, shape ``(n, 3)`` [N/m].
        damping: The same, or symmetric matrices, shape ``(n, 3)`` or ``(n, 3, 3)`` [N s/m].
        dissipation: Energy taken by the dampers that this rank owns [J].
    """

    def __init__(
        self,
        comm: MPI.Comm,
        weights: tuple[Index, Dofs, Array],
        point: Dofs,
        stiffness: Array,
        damping: Array,
    ) -> None:
        """Take all springs, the same on every rank but for the dofs.

        Args:
            comm: Ranks.
            weights: Row, owned dof block (-1 where another rank owns it) and weight of each node in
                each stretch.
            point: Point mass whose motion is taken off each stretch, -1 for none.
            stiffness: Springs of all rows, as above.
            damping: Dampers of all rows, as above.
        """
        row, dofs, weight = (x[weights[1] >= 0] for x in weights)
        self.comm, self.count = comm, len(point)
        self.rows, self.owned, index_map = _distributed(comm, self.count, np.unique(row))
        self.point = point[self.rows]
        self.stiffness, self.damping = (
            np.ascontiguousarray(x[self.rows], dtype=float) for x in (stiffness, damping)
        )
        self.dissipation = 0.0
        self._began = False
        self._sums = {n: la.vector(index_map, 3 * n) for n in (1, 2)} if index_map else {}
        place = np.full(self.count, -1)
        place[self.rows] = np.arange(len(self.rows))
        tied = np.flatnonzero(self.point[: self.owned] >= 0)
        self.dofs, column = np.unique(dofs, return_inverse=True)
        self.points, end = np.unique(self.point[tied], return_inverse=True)
        entries = np.concatenate([weight, np.full(len(tied), -1.0)])
        places = np.append(place[row], tied), np.append(column, len(self.dofs) + end)
        shape = len(self.rows), len(self.dofs) + len(self.points)
        self.B = csr_array((entries, places), shape=shape)
        self._c, self._alive = self._struct()
        self._both = np.zeros((len(self.rows), 2, 3))

    def _struct(self) -> tuple[Any, Any]:
        """Return the springs for the native passes, and the arrays that these use."""
        m = len(self.dofs)
        nodes, points = _rows(self.B[:, :m], self.dofs), _rows(self.B[:, m:], self.points)
        arrays = {
            "stiffness": self.stiffness,
            "damping": self.damping,
            "pull": np.zeros((len(self.rows), 3)),
        }
        made = struct("nd_springs", n=len(self.rows), owned=self.owned, **arrays)
        made.full = int(self.damping.ndim == 3)
        made.on_nodes, made.on_points = nodes[0][0], points[0][0]
        return made, (arrays, nodes, points)

    def stretch(self, u: Array, points: Array) -> Array:
        """Return the stretches, shape ``(n, 3)``; collective if a row is on several ranks.

        Args:
            u: Values on the nodes, shape ``(3 * n_local,)``.
            points: Those on the point masses, shape ``(masses, 3)``.
        """
        found = np.zeros((len(self.rows), 3))
        lib.nd_stretch(self._c, pointer(u), pointer(points), 3, pointer(found))
        self._complete(found, 1)
        return found

    def _complete(self, found: Array, motions: int) -> None:
        """Add up the rows that are on several ranks, in place; collective."""
        if self._sums:
            total = self._sums[motions]
            total.array[:] = found.ravel()
            total.scatter_reverse(la.InsertMode.add)
            total.scatter_forward()
            found[:] = total.array.reshape(found.shape)

    def add(
        self, u: Array, v: Array, masses: PointMasses, force: Array, reaction: Array, dt: float
    ) -> None:
        """Add to the nodal ``force`` and to this rank's share of the ``reaction`` on the masses."""
        both = self._both
        out = pointer(both)
        lib.nd_stretch(self._c, pointer(u), pointer(masses.u), 6, out)
        lib.nd_stretch(self._c, pointer(v), pointer(masses.v), 6, out + 3)
        self._complete(both, 2)
        work = lib.nd_pull(self._c, out, pointer(force), pointer(reaction))
        if self._began:
            self.dissipation += dt / 2 * work
        self._began = True

    @property
    def force(self) -> Array:
        """This rank's share of the force at the last :meth:`add` on the nodes, ``(3,)`` [N].

        Of springs to a facet it is that on the nodes; the facet has the opposite one.
        """
        e, rate = self._both[: self.owned].swapaxes(0, 1)
        k, c = self.stiffness[: self.owned], self.damping[: self.owned]
        damped = c * rate if c.ndim == 2 else np.einsum("nij,nj->ni", c, rate)
        return -np.asarray((k * e + damped).sum(axis=0))

    def stored_energy(self, u: Array, points: Array) -> float:
        """This rank's share of the spring energy [J]."""
        e = self.stretch(u, points)[: self.owned]
        return float((self.stiffness[: self.owned] * e**2).sum() / 2)

    def pull(self, u: Array, out: Array) -> None:
        """Add the pull of the nodes on the masses at rest at zero, this rank's share [N]."""
        self.add_at_points(self.stiffness * self.stretch(u, np.zeros_like(out)), out)

    def add_at_points(self, values: Array, out: Array) -> None:
        """Add a value of each spring ``(n, 3)`` to those on each mass, this rank's share."""
        lib.nd_onto_points(self._c, pointer(values), pointer(out))

    def entries(
        self, number: Index, first: int = 0
    ) -> tuple[Index, Index, Array, Index, Dofs, Array, Array]:
        """Return B on the nodes as entries with global numbers, and the springs this rank owns.

        Args:
            number: Global dof block of each owned dof block, shape ``(owned,)``.
            first: Number of the first row.

        Returns:
            Row, dof block and weight of each entry; row, point mass, stiffness ``(k, 3)`` and
            damping ``(k, 3, 3)`` of each owned spring.
        """
        B, own, rows = self.B[:, : len(self.dofs)].tocoo(), slice(self.owned), first + self.rows
        node = number[self.dofs][B.col]
        c = self.damping[own]
        matrix = c if c.ndim == 3 else c[:, :, None] * np.eye(3)
        return rows[B.row], node, B.data, rows[own], self.point[own], self.stiffness[own], matrix

    def majorant(self, coefficient: Array, mass: Array) -> Array:
        """Return springs to the ground at the nodes that are at least as stiff; collective.

        With stretches ``x − y`` of means ``x = Σ b x_i`` and ``y`` likewise (facet), for any θ > 0,

            (x − y)² ≤ (1 + θ) s Σ b x_i² + (1 + 1/θ) t Σ c y_j²,  s = Σ b, t = Σ c

        (Young, then Cauchy–Schwarz). θ is taken where the worst nodes of both sides have the same
        rate: of one mass on another that is ``k (1/m + 1/M)``, exactly. Without y it is
        ``s Σ b x_i²``. Ends at point masses are left to :func:`forms.springs.step_bound.joined`.

        Args:
            coefficient: Springs or dampers, shape ``(n, 3)``.
            mass: Lumped mass of every local dof, shape ``(3 * n_local,)`` [kg].

        Returns:
            Springs at :attr:`dofs`, shape ``(m, 3)``.
        """
        B = self.B[:, : len(self.dofs)].tocoo()
        weight, at = np.abs(B.data), ((B.data < 0).astype(int), self.rows[B.row])
        size, worst = np.zeros((2, 2, self.count))
        np.add.at(size, at, weight)
        np.maximum.at(worst, at, weight / mass[::3][self.dofs[B.col]])
        self.comm.Allreduce(MPI.IN_PLACE, size, op=MPI.SUM)
        self.comm.Allreduce(MPI.IN_PLACE, worst, op=MPI.MAX)
        worst *= size
        factor = worst.sum(axis=0) / np.where(worst > 0, worst, 1.0) * size
        nodal = np.zeros((len(self.dofs), 3))
        np.add.at(nodal, B.col, (weight * factor[at])[:, None] * coefficient[B.row])
        return nodal


def _rows(B: "csr_array", number: npt.NDArray[Any]) -> tuple[Any, tuple[Array, ...]]:
    """Return a matrix of stretches as ``nd_rows``, with its columns numbered, and its arrays."""
    arrays = B.indptr.astype(np.int32), number[B.indices].astype(np.int32), B.data
    names = "first", "node", "weight"
    return struct("nd_rows", **dict(zip(names, arrays, strict=True))), arrays


def spread(
    comm: MPI.Comm, dofs: Dofs, stiffness: Array, damping: Array, point: Dofs | None = None
) -> Springs:
    """Return a spring and damper at each node (a pad under a rail).

    Args:
        comm: Ranks.
        dofs: Owned dof block of each node, -1 where another rank owns it, shape ``(n,)``.
        stiffness: Of each and direction, shape ``(n, 3)`` [N/m].
        damping: The same, or symmetric matrices, shape ``(n, 3)`` or ``(n, 3, 3)`` [N s/m].
        point: Point mass at the other end, -1 for the ground, shape ``(n,)``; none: all ground.
    """
    n = len(dofs)
    if point is None:
        point = np.full(n, -1, dtype=np.int32)
    return Springs(comm, (np.arange(n), dofs, np.ones(n)), point, stiffness, damping)


def mean(
    comm: MPI.Comm, dofs: Dofs, share: Array, stiffness: Array, damping: Array, point: int = -1
) -> Springs:
    """Return one spring and damper on the mean motion of nodes (an axle box on a turning journal).

    The mean of a ring does not feel the ring turn, which a spring on each node would.

    Args:
        comm: Ranks.
        dofs: Owned dof block of each node, -1 where another rank owns it, shape ``(n,)``.
        share: Weight of each node, their sum is 1, shape ``(n,)``.
        stiffness: Spring of each direction, shape ``(3,)`` [N/m].
        damping: Damper of each direction, shape ``(3,)`` [N s/m].
        point: Point mass at the other end, -1 for the ground.
    """
    weights = np.zeros(len(dofs), dtype=np.int64), dofs, share
    return Springs(comm, weights, np.full(1, point, np.int32), stiffness[None], damping[None])


def node_to_facet(
    comm: MPI.Comm, dofs: Dofs, facets: tuple[Dofs, Array], stiffness: Array, damping: Array
) -> Springs:
    """Return springs and dampers from nodes to points of facets (pads on a solid sleeper).

    The pull on a point goes to the nodes of its facet with their bilinear weights, so that forces
    are equal and opposite, and collinear where the spring is.

    Args:
        comm: Ranks.
        dofs: Owned dof block of each node, -1 where another rank owns it, shape ``(n,)``.
        facets: Those of the nodes of each facet, and the weights of the point, shape ``(n, 4)``.
        stiffness: Of each and direction, shape ``(n, 3)`` [N/m].
        damping: The same, shape ``(n, 3)`` [N s/m].
    """
    ends, weight = facets
    n = len(dofs)
    blocks = np.column_stack([dofs, ends])
    weights = np.column_stack([np.ones(n), -weight])
    rows = np.repeat(np.arange(n), blocks.shape[1])
    ground = np.full(n, -1, dtype=np.int32)
    return Springs(comm, (rows, blocks.ravel(), weights.ravel()), ground, stiffness, damping)


def _distributed(
    comm: MPI.Comm, count: int, here: Index
) -> tuple[Index, int, "dolfinx.common.IndexMap | None"]:
    """Return the rows of this rank, the owned ones first, how many those are, and their map.

    Args:
        comm: Ranks.
        count: Number of all rows.
        here: Rows with a node of this rank.

    Returns:
        Rows, number of owned ones, and the map for the sum of partial rows; None if every row is on
        one rank.
    """
    owner = np.full(count, -1, dtype=np.int32)
    owner[here] = comm.rank
    comm.Allreduce(MPI.IN_PLACE, owner, op=MPI.MAX)
    np.maximum(owner, 0, out=owner)  # of a row without nodes
    own, borrowed = np.flatnonzero(owner == comm.rank), here[owner[here] != comm.rank]
    rows = np.concatenate([own, borrowed])
    if not comm.allreduce(len(borrowed)):
        return rows, len(own), None
    number = np.empty(count, dtype=np.int64)  # global: by owner, then by row
    number[np.argsort(owner, kind="stable")] = np.arange(count)
    index_map = dolfinx.common.IndexMap(comm, len(own), number[borrowed], owner[borrowed], TAG)
    return rows, len(own), index_map
