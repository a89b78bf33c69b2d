# SPDX-License-Identifier: LGPL-3.0-or-later
"""Springs and dampers between nodes and points of facets of another body (pads on a sleeper)."""

from mpi4py import MPI

import dolfinx
import numpy as np
import numpy.typing as npt
from dolfinx import la
from scipy.sparse import csr_array

from forms.springs.point_masses import damper_work

Array = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Dofs = npt.NDArray[np.int32]

TAG = 4711  # of the messages that set up the exchange


class Between:
    """Springs and dampers from nodes to points of facets, given by their bilinear weights.

    The pull on a point goes to the nodes of its facet with the same weights, so that forces are
    equal and opposite, and collinear where the spring is. The rank of the node computes; of the
    facets only nodes that are owned elsewhere are exchanged, with the ranks they belong to.

    Attributes:
        dofs: Owned dof blocks of the nodes of this rank, shape ``(n,)``.
        stiffness, damping: Of each and direction, shape ``(n, 3)`` [N/m], [N s/m].
        dissipation: Energy taken by the dampers on this rank [J].
    """

    def __init__(
        self,
        comm: MPI.Comm,
        dofs: Dofs,
        facets: tuple[Ints, Dofs, Array],
        stiffness: Array,
        damping: Array,
    ) -> None:
        """Take all links, the same on every rank but for the dofs.

        Args:
            comm: Ranks.
            dofs: Owned dof block of each node, -1 where another rank owns it, shape ``(n,)``.
            facets: Mesh nodes of the facet of each link, their owned dof blocks or -1, and the
                weights of the point, all of shape ``(n, 4)``.
            stiffness: Springs, shape ``(n, 3)`` [N/m].
            damping: Dampers, shape ``(n, 3)`` [N s/m].
        """
        nodes, ends, weights = facets
        here = dofs >= 0
        self.comm, self.dofs = comm, dofs[here]
        self.stiffness, self.damping = stiffness[here], damping[here]
        self.dissipation = 0.0
        self._before: Array | None = None
        _, first, number = np.unique(nodes, return_index=True, return_inverse=True)
        number, end = number.reshape(nodes.shape)[here], ends.ravel()[first]
        local, table = _table(comm, end, np.unique(number))
        self._own = end[end >= 0]
        self._columns = local[number]
        self.weights = weights[here]
        self._size = table.size_local + table.num_ghosts
        self._at = self._matrix(self.weights)
        self._from = csr_array(self._at.T)
        self._both, self._one = la.vector(table, 6), la.vector(table, 3)
        self._index = 3 * self.dofs.astype(np.int64)[:, None] + np.arange(3)
        self._own_index = 3 * self._own.astype(np.int64)[:, None] + np.arange(3)

    def _matrix(self, weights: Array) -> "csr_array":
        """Return the weights ``(n, 4)`` as a matrix of links by owned and borrowed facet nodes."""
        row = np.repeat(np.arange(len(weights)), 4)
        entry = row, self._columns.ravel()
        return csr_array((weights.ravel(), entry), shape=(len(weights), self._size))

    def stretches(self, u: Array, v: Array) -> Array:
        """Return node less point of two nodal vectors side by side, shape ``(n, 6)``."""
        table = self._both.array.reshape(-1, 6)
        table[: len(self._own), :3] = u.take(self._own_index)
        table[: len(self._own), 3:] = v.take(self._own_index)
        if self.comm.size > 1:
            self._both.scatter_forward()
        both = self._at @ table
        np.negative(both, out=both)
        both[:, :3] += u.take(self._index)
        both[:, 3:] += v.take(self._index)
        return np.asarray(both)

    def stretch(self, u: Array) -> Array:
        """Return node less point, shape ``(n, 3)`` [m]; collective."""
        return self.stretches(u, u)[:, :3]

    def add(self, u: Array, v: Array, force: Array, reaction: Array, dt: float) -> None:
        """Add to the nodal ``force``; no point mass is touched."""
        both = self.stretches(u, v)
        rate = both[:, 3:]
        damping = self.damping * rate
        f = -self.stiffness * both[:, :3] - damping
        np.add.at(force, self._index.ravel(), f.ravel())
        force[self._own_index] -= self._sum(self._from, f)
        if self._before is not None:
            self.dissipation += damper_work(self._before, damping, rate, dt)
        self._before = damping

    def _sum(self, onto: "csr_array", values: Array) -> Array:
        """Return weighted sums of values of the links on the owned facet nodes, ``(m, 3)``."""
        self._one.array[:] = (onto @ values).ravel()
        if self.comm.size > 1:
            self._one.scatter_reverse(la.InsertMode.add)
        return self._one.array.reshape(-1, 3)[: len(self._own)]

    def _facet_values(self, nodal: Array) -> Array:
        """Return a scalar of every owned dof block at the facet nodes of each link, ``(n, 4)``."""
        self._one.array[: 3 * len(self._own)] = np.repeat(nodal[self._own], 3)
        self._one.scatter_forward()
        return self._one.array[::3][self._columns]

    def pull(self, u: Array, out: Array) -> None:
        """No point mass is pulled."""

    def add_stiffness(self, out: Array) -> None:
        """No point mass is held."""

    def triplets(self, number: Ints) -> tuple[Ints, Ints, Array]:
        """Return this rank's part of the stiffness on the nodes; collective.

        Args:
            number: Global dof block of each owned dof block, shape ``(owned,)``.

        Returns:
            Global scalar rows, columns and values [N/m].
        """
        facet = self._facet_values(number.astype(np.float64)).astype(np.int64)
        block = np.hstack([number[self.dofs][:, None], facet])
        weight = np.hstack([np.ones((len(block), 1)), -self.weights])
        value = np.einsum("ni,nj,na->nija", weight, weight, self.stiffness)
        dof = 3 * block[:, :, None] + np.arange(3)
        rows = np.broadcast_to(dof[:, :, None], value.shape)
        columns = np.broadcast_to(dof[:, None], value.shape)
        return rows.ravel(), columns.ravel(), value.ravel()

    def majorant(self, coefficient: Array, mass: Array) -> tuple[Dofs, Array]:
        """Return springs to the ground that are at least as stiff as the links; collective.

        With weights ``b``, ``s = Σ|b|`` and any θ > 0,

            (x − Σ b y)² ≤ (1 + θ) x² + (1 + 1/θ) s Σ |b| y²

        (Young, then Cauchy–Schwarz). θ is taken where the node and the worst of its facet's nodes
        have the same rate: of one mass on another that is ``k (1/m + 1/M)``, exactly.

        Args:
            coefficient: Springs or dampers, shape ``(n, 3)``.
            mass: Lumped mass of every local dof, shape ``(3 * n_local,)`` [kg].

        Returns:
            Dof blocks, with repeats, and their springs, shapes ``(k,)`` and ``(k, 3)``.
        """
        size = np.abs(self.weights)
        size = size * size.sum(axis=1, keepdims=True)
        theta = mass[::3][self.dofs] * (size / self._facet_values(mass[::3])).max(axis=1)
        onto = csr_array(self._matrix(size).T)
        ends = self._sum(onto, (1 + 1 / theta[:, None]) * coefficient).copy()
        both = (1 + theta[:, None]) * coefficient, ends
        return np.concatenate([self.dofs, self._own]), np.vstack(both)

    def stored_energy(self, u: Array) -> float:
        """This rank's share of the spring energy [J]; collective."""
        return float((self.stiffness * self.stretch(u) ** 2).sum() / 2)


def _table(comm: MPI.Comm, end: Dofs, needed: Ints) -> tuple[Ints, "dolfinx.common.IndexMap"]:
    """Return the place of each facet node among the owned and borrowed ones, and their map.

    Args:
        comm: Ranks.
        end: Owned dof block of each facet node or -1, shape ``(m,)``.
        needed: Those that this rank's links hang on.
    """
    owner = np.where(end >= 0, comm.rank, -1).astype(np.int32)
    comm.Allreduce(MPI.IN_PLACE, owner, op=MPI.MAX)
    counts = np.bincount(owner, minlength=comm.size)
    order = np.argsort(owner, kind="stable")  # the global number: by owner, then by node
    number = np.empty(len(end), dtype=np.int64)
    number[order] = np.arange(len(end))
    ghosts = needed[owner[needed] != comm.rank]
    owned = int(counts[comm.rank])
    local = np.full(len(end), -1, dtype=np.int64)
    local[owner == comm.rank] = np.arange(owned)
    local[ghosts] = owned + np.arange(len(ghosts))
    where = dolfinx.common.IndexMap(comm, owned, number[ghosts], owner[ghosts], TAG)
    return local, where
