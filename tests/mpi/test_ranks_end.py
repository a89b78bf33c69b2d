# SPDX-License-Identifier: LGPL-3.0-or-later
"""Ranks end together: an error that one of them meets alone, a parent that dies, too many ranks."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time

from mpi4py import MPI

import pytest

from tests.folders import BAR
from tests.processes import started, until
from workflow.scene.scene import SceneError
from workflow.simulation import ranks

WORDS = ["bar-impact", *(w for k, v in BAR.items() for w in ("--set", f"{k}={v}"))]
alone = pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="starts mpiexec itself")

STRUCK = """
import sys, time
from mpi4py import MPI
from workflow.cli import main
from workflow.simulation import guards
whole = guards.check_finite
def check_finite(model, asked=0):
    if model.state.step == 50 and MPI.COMM_WORLD.rank == {rank}:
        print("struck at", time.time(), file=sys.stderr, flush=True)
        raise {error}
    return whole(model, asked)
guards.check_finite = check_finite
main()
"""


SIGNALLED = """
import os, signal, threading, time
from mpi4py import MPI
from workflow.cli import main
from workflow.simulation import run
def build(*words):
    if MPI.COMM_WORLD.rank:
        MPI.COMM_WORLD.Barrier()
    for later in {moments}:
        threading.Timer(later, os.kill, (os.getpid(), signal.SIGTERM)).start()
    time.sleep(60)
run.build = build
main()
"""


@alone
@pytest.mark.mpi
@pytest.mark.slow
@pytest.mark.parametrize("moments", [(0.5, 0.6), (0.5, 2.5)])
def test_a_signal_that_comes_twice_to_one_rank_ends_all(mpirun, tmp_path, moments):
    """The other waits where no signal is seen. Sent twice at once, as launchers do, it is one; the
    second of an impatient user ends all at once, without a traceback.
    """
    code, out = SIGNALLED.format(moments=moments), tmp_path / "out"
    words = ("-c", code, "run", *WORDS, "--out", out)
    done = mpirun(2, *words, timeout=60, check=False)
    assert done.returncode == 130, done.stderr
    assert "Traceback" not in done.stderr
    assert ("rank 0: interrupted by SIGTERM" in done.stderr) == (moments[1] < 1)


@alone
@pytest.mark.mpi
@pytest.mark.parametrize(
    ("rank", "error", "status"),
    [
        (0, "MemoryError()", "stopped: out of memory"),
        pytest.param(1, "KeyError('lost')", "failed: KeyError: 'lost'", marks=pytest.mark.slow),
    ],
)
def test_an_error_on_one_rank_ends_all(mpirun, tmp_path, rank, error, status):
    """The others wait for it in a reduction; within 10 s all are gone, and what to do is told."""
    code, out = STRUCK.format(rank=rank, error=error), tmp_path / "out"
    done = mpirun(2, "-c", code, "run", *WORDS, "--out", out, timeout=100, check=False)
    ended = time.time()
    (struck,) = (x.split()[-1] for x in done.stderr.splitlines() if x.startswith("struck at"))
    assert ended - float(struck) < 10
    assert done.returncode == 3
    told = f"squealx: rank {rank}: {status}; go on with: squealx run --resume --out {out}"
    assert told in done.stderr
    assert json.loads((out / "summary.json").read_text())["status"] == status
    assert (out / "checkpoint" / "state.npz").exists()


@alone
@pytest.mark.mpi
def test_a_broken_checkpoint_is_told_once(command, run_scene, tmp_path):
    """Rank 0 alone reads it: exit code 2 on all, at once."""
    shutil.copytree(run_scene("bar-impact", **BAR), tmp_path / "out")
    (tmp_path / "out" / "checkpoint" / "state.npz").write_bytes(b"PK\x03\x04 and no more")
    words = ("--out", tmp_path / "out", "--set", "time.end=6e-5", "--ranks", 2)
    done = command("run", "--resume", *words, check=False)
    assert done.returncode == 2
    assert done.stderr.count("no checkpoint that can be read") == 1


def test_too_many_ranks_are_refused(command, tmp_path, monkeypatch):
    """Beyond the cores they are to be asked for; a slip of some digits starts nothing."""
    monkeypatch.setattr(ranks, "cores", lambda: 1)
    done = command("run", "bar-wave", "--ranks", 100_000, "--out", tmp_path / "out", check=False)
    assert done.returncode == 2 and "--ranks 100000: expected at most 8" in done.stderr
    monkeypatch.delenv("SQUEALX_OVERSUBSCRIBE")
    done = command("run", "bar-wave", "--ranks", 2, "--out", tmp_path / "out", check=False)
    assert done.returncode == 2 and "--oversubscribe" in done.stderr
    done = command("modes", "bar-wave", "--ranks", 2, "--out", tmp_path / "out", check=False)
    assert done.returncode == 2 and "--oversubscribe" in done.stderr
    assert not (tmp_path / "out").exists()
    ranks.check(2, oversubscribe=True)
    with pytest.raises(SceneError, match="expected at most 8"):
        ranks.check(9, oversubscribe=True)


@alone
@pytest.mark.mpi
def test_files_of_the_current_folder_are_not_imported(tmp_path):
    """A folder with a numbers.py and a struct.py of the user's: the ranks do not run them."""
    for name in ("numbers", "struct", "workflow"):
        (tmp_path / f"{name}.py").write_text(f"open('{name} was imported', 'w')\n")
    process = started("run", *WORDS, "--ranks", 2, "--out", "out", cwd=tmp_path)
    _, said = process.communicate(timeout=200)
    assert process.returncode == 0, said
    assert not [*tmp_path.glob("*imported")]


PARENT = """
import subprocess, sys, time
from workflow.simulation.ranks import tied
child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(100)"], **tied())
print(child.pid, flush=True)
time.sleep(100)
"""


def test_a_child_does_not_outlive_its_parent():
    """SIGKILL, of which the parent cannot tell: the kernel ends the child."""
    command = [sys.executable, "-c", PARENT]
    parent = subprocess.Popen(
        command, stdout=subprocess.PIPE, text=True, preexec_fn=ranks.tie(signal.SIGKILL)
    )
    assert parent.stdout is not None
    child = int(parent.stdout.readline())
    os.kill(child, 0)
    parent.kill()
    parent.communicate()
    until(lambda: not os.path.exists(f"/proc/{child}"), 10)
