# SPDX-License-Identifier: LGPL-3.0-or-later
"""Processes of a command: MPI ranks, their launcher, and errors that only one of them meets.

A process that is started here ends with the one that started it, however that comes about, and
imports no files of the current folder. It stands in the lowest room that knows of runs, and imports
nothing that a command has to wait for.
"""

import contextlib
import ctypes
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from workflow.scene.units import SceneError
from workflow.simulation import interrupts

if TYPE_CHECKING:
    from mpi4py import MPI

MOST_PER_CORE = 8  # ranks on a core, asked for by name: more is taken for a slip
PATIENCE = 5.0  # s that ranks wait for each other where all of them must meet the same error
GRACE = 60.0  # s that ranks have for their checkpoint once they are to end
TAG = 21_000  # of messages about an error
# files of the current folder, numbers.py or struct.py, must not take the place of modules
OWN_MODULES = {"PYTHONSAFEPATH": "1"}
# Open MPI, unlike MPICH, refuses root, which containers have, and ranks that share a core, which
# ``check`` has allowed; and it binds two ranks to two cores, whatever else runs there
OPEN_MPI = {
    "OMPI_ALLOW_RUN_AS_ROOT": "1",
    "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
    "OMPI_MCA_rmaps_base_oversubscribe": "1",
    "OMPI_MCA_hwloc_base_binding_policy": "none",
    "PRTE_MCA_rmaps_default_mapping_policy": ":oversubscribe",
    "PRTE_MCA_hwloc_default_binding_policy": "none",
}
PR_SET_PDEATHSIG = 1

with contextlib.suppress(OSError, AttributeError):
    prctl = ctypes.CDLL(None).prctl  # Linux alone; looked up here, as a forked child must not


class Alone(RuntimeError):
    """An error of this rank that the others do not meet: they wait for it, and must be ended."""


def in_mpi() -> bool:
    """Tell whether this process was started by mpiexec or srun."""
    return any(k in os.environ for k in ("PMI_RANK", "PMIX_RANK", "OMPI_COMM_WORLD_RANK"))


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0))


def check(ranks: int, oversubscribe: bool) -> None:
    """Refuse more ranks than there are cores, unless they are asked for.

    Raises:
        SceneError: saying how many there may be.
    """
    most = MOST_PER_CORE * cores()
    if ranks > most:
        raise SceneError(
            f"--ranks {ranks}: expected at most {most} on {cores()} cores; over several machines "
            "start squealx itself by mpiexec or srun"
        )
    if ranks > cores() and not oversubscribe:
        raise SceneError(
            f"--ranks {ranks}: expected at most {cores()}, the cores there are; with "
            "--oversubscribe ranks share a core, which takes longer than fewer of them"
        )


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


def tied() -> dict[str, Any]:
    """Return the options of ``subprocess`` for a Python or its launcher, tied to this process."""
    return {"preexec_fn": tie(), "env": OPEN_MPI | os.environ | OWN_MODULES}


def tie(number: int = signal.SIGTERM) -> Callable[[], None]:
    """Return what a child calls first, so that it gets a signal when this process is gone."""
    parent = os.getpid()

    def first() -> None:
        end_with_parent(number)
        if os.getppid() != parent:  # gone already
            os.kill(os.getpid(), number)

    return first


def end(message: str, code: int) -> None:
    """Tell an error of this rank alone and end all of them."""
    from mpi4py import MPI

    print(f"squealx: {message}", file=sys.stderr, flush=True)
    MPI.COMM_WORLD.Abort(code)


def end_with_parent(number: int = signal.SIGTERM) -> None:
    """Have the kernel send a signal to this process when its parent ends; on Linux."""
    if "prctl" in globals():
        prctl(PR_SET_PDEATHSIG, number, 0, 0, 0)


def call(command: Sequence[str], **options: Any) -> "subprocess.CompletedProcess[str]":
    """Run ranks to their end, which a signal to this process, or its death, brings about.

    They have a session of their own, so that an interrupt from the terminal comes to them once;
    standard input stays here. A second signal, or ``GRACE`` after the first, kills them.
    """
    process = subprocess.Popen(
        command, stdin=subprocess.DEVNULL, start_new_session=True, text=True, **options, **tied()
    )
    with interrupts.noted() as asked:
        try:
            out = _followed(process, asked)
        except BaseException:
            process.kill()  # its ranks end with it
            process.wait()
            raise
    return subprocess.CompletedProcess(list(command), process.returncode, out)


def _followed(process: "subprocess.Popen[str]", asked: Callable[[], int]) -> str | None:
    """Wait for a process and return what it printed, if that is kept; pass a signal on."""
    end = None
    while True:
        with contextlib.suppress(subprocess.TimeoutExpired):
            out, _ = process.communicate(timeout=interrupts.POLL)
            return out
        if asked() and end is None:
            # to the ranks: the launcher of Open MPI would not let them end by themselves
            for pid in ranks_of(process.pid) or [process.pid]:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGTERM)
            end = time.monotonic() + GRACE
        if end is not None and time.monotonic() > end:
            process.kill()


def ranks_of(launcher: int) -> list[int]:
    """Return the processes below a launcher that run this Python; none where there is no /proc."""
    found: list[int] = []
    above = [launcher]
    while above:
        for task in Path(f"/proc/{above.pop()}/task").glob("*/children"):
            with contextlib.suppress(OSError):  # one that has just ended
                for pid in map(int, task.read_text().split()):
                    words = Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0")
                    ours = os.fsdecode(words[0]) == sys.executable
                    (found if ours else above).append(pid)
    return found


def alike(comm: "MPI.Comm", patience: float = PATIENCE) -> bool:
    """Tell whether all ranks come here within some seconds: whether an error is one of all.

    Ranks that do not come wait in some other call for this one, which must then not enter any.
    """
    if comm.size == 1:
        return True
    from mpi4py import MPI

    others = [rank for rank in range(comm.size) if rank != comm.rank]
    requests = [comm.Irecv(bytearray(1), rank, TAG) for rank in others]
    requests += [comm.Isend(bytes(1), rank, TAG) for rank in others]
    end = time.monotonic() + patience
    while not MPI.Request.Testall(requests):
        if time.monotonic() > end:
            return False
        time.sleep(1e-3)
    return True
