# SPDX-License-Identifier: LGPL-3.0-or-later
"""Closest points found on some ranks and told to all.

A closest point depends on positions alone, which every rank holds. Each rank finds those of a part
of the candidates and tells the others, so that all hold the same, to the last bit, on any number of
ranks.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from contact._kernel import lib
from contact.arrays import Index32, struct, view
from contact.contact_state import ContactState
from meshes.arrays import Array, Index

if TYPE_CHECKING:
    from mpi4py import MPI

LEAST = 32  # candidates of a rank, below which telling takes longer than finding


@dataclass(frozen=True)
class Parts:
    """Parts of the candidates, one for each rank.

    Attributes:
        comm: The ranks.
        cuts: Where the part of a rank begins; the last one is their number, shape ``(ranks + 1,)``.
    """

    comm: "MPI.Comm"
    cuts: Index

    @property
    def mine(self) -> slice:
        """The part of this rank."""
        return slice(*self.cuts[self.comm.rank : self.comm.rank + 2])

    def all_of(self, rows: Array) -> Array:
        """Return the rows that all ranks have found, in their order; collective."""
        counts = self.comm.allgather(rows.size)
        whole = np.empty((sum(counts) // rows.shape[1], rows.shape[1]))
        self.comm.Allgatherv(np.ascontiguousarray(rows), (whole, counts))
        return whole

    def any_of(self, marks: npt.NDArray[np.uint8]) -> None:
        """Mark what any rank has marked; collective."""
        from mpi4py import MPI

        self.comm.Allreduce(MPI.IN_PLACE, marks, op=MPI.BOR)


def parted(comm: "MPI.Comm | None", k: int) -> Parts | None:
    """Return the parts of ``k`` candidates; None if these are too few, or there is one rank.

    Where there are fewer than ``LEAST`` for each, the last ranks have none.
    """
    if comm is None or comm.size == 1 or k < 2 * LEAST:
        return None
    takers = min(comm.size, k // LEAST)
    return Parts(comm, np.minimum(np.arange(comm.size + 1), takers) * k // takers)


class Shared:
    """Candidates whose closest points the ranks follow in parts.

    Attributes:
        c: Those of this rank, for the kernel.
    """

    def __init__(self, parts: Parts, item: Index32, **arrays: Any) -> None:
        """Prepare; ``arrays`` are the other members of ``wr_candidates``."""
        mine = parts.mine
        self._comm = parts.comm
        self.c = struct("wr_candidates", k=mine.stop - mine.start, item=item[mine], **arrays)
        self._all = struct("wr_candidates", k=len(item), item=item)
        self._rows = np.empty((len(item), lib.WR_ROW))
        self._to_all = [self._rows, np.diff(parts.cuts) * lib.WR_ROW]
        self._c_mine = view("rows", self._rows[mine], (-1, lib.WR_ROW), out=True)
        self._c_rows = view("rows", self._rows, (-1, lib.WR_ROW))

    def tell(self, state: ContactState) -> None:
        """Bring closest points, gaps and normals that this rank has found to all; collective."""
        from mpi4py import MPI

        lib.wr_pack(self.c, state.c, self._c_mine)
        self._comm.Allgatherv(MPI.IN_PLACE, self._to_all)
        lib.wr_unpack(self._all, self._c_rows, state.c)
