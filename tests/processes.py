# SPDX-License-Identifier: LGPL-3.0-or-later
"""Processes that tests start, signal and look for afterwards."""

import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from workflow.simulation.ranks import tie

SQUEALX = [sys.executable, "-P", "-m", "workflow.cli"]


def started(*words: object, **options: Any) -> "subprocess.Popen[str]":
    """Start the command; it ends with this process, and signals do to it what they do by default.

    A shell that runs tests in the background has them ignore SIGINT.
    """
    tied = tie(signal.SIGKILL)

    def first() -> None:
        for number in (signal.SIGINT, signal.SIGHUP):
            signal.signal(number, signal.SIG_DFL)
        tied()

    kept = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True} | options
    return subprocess.Popen([*SQUEALX, *map(str, words)], preexec_fn=first, **kept)


def until(happens: Callable[[], Any], seconds: float = 200.0) -> None:
    """Wait until something is so."""
    end = time.monotonic() + seconds
    while not happens():
        assert time.monotonic() < end, "did not happen"
        time.sleep(0.005)


def below(parent: int) -> list[int]:
    """Processes that a process has started, and those that they have, parents first."""
    found = subprocess.run(["ps", "-eo", "pid=,ppid="], capture_output=True, text=True, check=True)
    pairs = [tuple(map(int, line.split())) for line in found.stdout.splitlines()]
    family = [parent]
    for member in family:
        family += [pid for pid, above in pairs if above == member]
    return family[1:]


def at_work(folder: Path) -> list[int]:
    """Processes whose command names a folder."""
    found = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            if str(folder).encode() in path.read_bytes():
                found.append(int(path.parent.name))
        except OSError:  # it has just ended
            continue
    return found


def alive(process: int) -> bool:
    """Tell whether a process is there and is not just waiting to be buried."""
    try:
        status = Path(f"/proc/{process}/stat").read_text()
    except OSError:
        return False
    return status.rpartition(")")[2].split()[0] != "Z"
