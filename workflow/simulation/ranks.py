# SPDX-License-Identifier: LGPL-3.0-or-later
"""Launcher of MPI ranks: ``mpiexec`` beside python or on PATH.

It stands in the lowest room that knows of runs, and imports nothing that a command has to wait for.
"""

import os
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path


def in_mpi() -> bool:
    """Tell whether this process was started by mpiexec or srun."""
    return any(k in os.environ for k in ("PMI_RANK", "PMIX_RANK", "OMPI_COMM_WORLD_RANK"))


def mpiexec() -> str | None:
    """Return the path of ``mpiexec``, that of this python's environment first; None without."""
    beside = Path(sys.executable).with_name("mpiexec")
    return str(beside) if beside.exists() else shutil.which("mpiexec")


def mpi_command(ranks: int, words: Sequence[str]) -> list[str]:
    """Return the command that starts python with ``words`` on some ranks.

    Raises:
        FileNotFoundError: if there is no ``mpiexec``.
    """
    launcher = mpiexec()
    if launcher is None:
        raise FileNotFoundError("expected mpiexec beside python or on PATH")
    return [launcher, "-n", str(ranks), sys.executable, *words]
