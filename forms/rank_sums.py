# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sums that every rank keeps of its own nodes, as a checkpoint holds them."""

from mpi4py import MPI

import numpy as np
import numpy.typing as npt


def gathered(comm: MPI.Comm, value: float) -> npt.NDArray[np.float64]:
    """Return the values of all ranks, shape ``(ranks,)``; collective."""
    return np.array(comm.allgather(value))


def own_part(comm: MPI.Comm, parts: npt.NDArray[np.float64]) -> float:
    """Return this rank's value of :func:`gathered`; on other ranks than then, rank 0 has them all.

    On as many ranks as before a run goes on bit by bit, which one total would not do.
    """
    if len(parts) == comm.size:
        return float(parts[comm.rank])
    return float(parts.sum()) if comm.rank == 0 else 0.0
