# SPDX-License-Identifier: LGPL-3.0-or-later
"""One thread of BLAS a rank while a run lasts, and what the user has set left alone."""

import os
import subprocess
import sys

import pytest

from workflow.simulation import threads

RUN = """
import sys
from threadpoolctl import threadpool_info, threadpool_limits
from workflow import Scene, run
import workflow.simulation.run  # loads all of BLAS

def most():
    return max(pool["num_threads"] for pool in threadpool_info())

if sys.argv[2] == "limited":
    threadpool_limits(3)  # what a user has chosen at run time
seen = set()
def watch(model):
    seen.add(most())
    if sys.argv[3] == "fails":
        raise KeyError("watch")
scene = Scene.load("bar-impact", **{"mesh.size": 5e-3, "time.end": 2e-6, "output.fields": False})
before = most()
try:
    run(scene, sys.argv[1], quiet=True, watch=watch)
except KeyError:
    pass
print(before, *seen, most())
"""


def numbers(folder, *words, **environment) -> list[int]:
    """Threads before, during and after a run in a process of its own."""
    command = [sys.executable, "-c", RUN, str(folder), *words]
    env = unset() | environment
    done = subprocess.run(command, env=env, check=True, capture_output=True, text=True)
    return list(map(int, done.stdout.split()))


def unset() -> dict[str, str]:
    """The environment without a number of threads."""
    return {k: v for k, v in os.environ.items() if k not in threads.VARIABLES}


@pytest.mark.parametrize("ending", ["ends", "fails"])
def test_one_thread_in_a_run_and_as_before_behind_it(tmp_path, ending):
    """Three threads before the run and after it, one in between, told in one line of the log."""
    assert numbers(tmp_path / "run", "limited", ending) == [3, 1, 3]
    log = (tmp_path / "run" / "run.log").read_text("utf-8")
    assert log.count("threads of BLAS") == 1 and "one on each rank, 3 again" in log


def test_what_the_environment_sets_is_left_alone(tmp_path):
    """OMP_NUM_THREADS = 2: two threads all the time, and the log says whose they are."""
    assert numbers(tmp_path / "run", "free", "ends", OMP_NUM_THREADS="2") == [2, 2, 2]
    log = (tmp_path / "run" / "run.log").read_text("utf-8")
    assert "left as the environment has them, OMP_NUM_THREADS = 2" in log


def test_command_line_sets_one(tmp_path):
    """``squealx run`` sets it before BLAS is loaded."""
    words = ("mesh.size=5e-3", "time.end=2e-6", "output.fields=false")
    changes = [w for word in words for w in ("--set", word)]
    command = [sys.executable, "-m", "workflow.cli", "run", "bar-impact", *changes]
    subprocess.run(
        [*command, "--out", str(tmp_path / "run")], env=unset(), check=True, capture_output=True
    )
    log = (tmp_path / "run" / "run.log").read_text("utf-8")
    assert "left as the environment has them, OMP_NUM_THREADS = 1" in log
