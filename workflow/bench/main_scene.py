# SPDX-License-Identifier: LGPL-3.0-or-later
"""The main scene by phases: made and brought to rest once, then a window of steps on 1 and 2 ranks.

As a module: runs the scene into a folder up to a checkpoint. The window, an output interval with
its one output, goes on from copies of that by ``squealx run --resume``: each number of ranks has
the same steps, the static solve is made and timed once, and what is timed is what a user runs.
"""

import json
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import tomli_w

from workflow.model import Model
from workflow.scene import Scene
from workflow.simulation import checkpoint
from workflow.simulation.ranks import mpi_command, tied
from workflow.simulation.run import run

SCENE = "flange-transition"
QUICK = {  # coarse, on a short rail, not brought to rest
    "mesh.size": 0.008, "mesh.rail_length": 3.0, "mesh.strip": None, "mass_scaling": None,
    "equilibrium": None, "time.bound": "cell", "time.output_interval": 1e-5,
}  # fmt: skip
MADE = ("mesh", "compile", "equilibrium")
STEPPED = ("internal_force", "contact", "update", "output")
START = 100  # steps before the window
TIMEOUT = 900  # for one run [s]


class Stop(Exception):
    """Raised in a run that has come to its checkpoint."""


def begin(folder: Path, quick: bool) -> None:
    """Run the scene into a folder up to its first checkpoint, the only one."""
    scene = Scene.load(SCENE, **{"output.fields": False, "output.checkpoint_minutes": 0})
    scene = scene.with_(**(QUICK if quick else {}))

    def watch(model: Model) -> None:
        if model.state.step > START:
            raise Stop

    try:
        first = scene.with_(**{"output.checkpoint_steps": START})
        run(first, folder, watch=watch, quiet=True)
    except Stop:
        pass
    (folder / "scene.toml").write_text(tomli_w.dumps(scene.tables()), "utf-8")


def measure(quick: bool, count: int, log: Callable[[str], Any]) -> dict[str, Any] | None:
    """Return seconds of each phase, per step where it is part of one; None if a run fails.

    Args:
        quick: A coarse mesh that is not brought to rest, and a short window.
        count: Windows on each number of ranks, in turn.
        log: Takes the reason if a run fails.
    """
    with tempfile.TemporaryDirectory() as place:
        start = Path(place) / "start"
        words = [sys.executable, "-m", "workflow.bench.main_scene", str(start), str(int(quick))]
        try:
            told(words)
            about = read(start)
            runs: dict[int, list[dict[str, Any]]] = {1: [], 2: []}
            for _ in range(count):
                for ranks, found in runs.items():
                    found.append(stepped(start, about, ranks))
        except (subprocess.SubprocessError, OSError) as error:
            log(f"main scene: {getattr(error, 'stderr', None) or error}")
            return None
    one, two = (by_phase(found) for found in runs.values())
    seconds = {phase: about["seconds"][phase] for phase in MADE}
    return {
        "scene": SCENE,
        "cells": runs[1][0]["cells"],
        "steps": runs[1][0]["steps"],
        "dt": about["dt"],
        "seconds": seconds,
        "one": one,
        "two": two,
        "ratio": two["rate"] / one["rate"],
    }


def told(words: list[str]) -> str:
    """Run a command and return what it printed."""
    options = tied()
    options["env"] = {"OMP_NUM_THREADS": "1"} | options["env"]
    done = subprocess.run(
        words, check=True, capture_output=True, text=True, timeout=TIMEOUT, **options
    )
    return done.stdout


def read(folder: Path) -> dict[str, Any]:
    """Return what the checkpoint in a folder tells of its run.

    Raises:
        FileNotFoundError: if there is none.
    """
    point = checkpoint.read(folder, MPI.COMM_SELF)
    if point is None:
        raise FileNotFoundError(f"{folder}: expected a checkpoint")
    return point.about


def stepped(start: Path, about: dict[str, Any], ranks: int) -> dict[str, Any]:
    """Return cells, steps and seconds of each phase of a window that goes on from ``start``."""
    folder = start.with_name("window")
    shutil.copytree(start, folder)
    end = about["t"] + about["scene"]["time"]["output_interval"]
    words = ["-m", "workflow.cli", "run", "--resume", "--out", str(folder), "--json"]
    words += ["--set", f"time.end={end!r}"]
    summary = json.loads(told(mpi_command(ranks, words)))
    shutil.rmtree(folder)
    seconds = {
        phase: summary["seconds_per_phase"][phase] - about["seconds"][phase] for phase in STEPPED
    }
    return {"cells": summary["cells"], "steps": summary["steps"] - about["step"], **seconds}


def by_phase(runs: list[dict[str, Any]]) -> dict[str, float]:
    """Return the medians over runs: seconds of each phase in a step, cells a second, shares."""
    steps, cells = runs[0]["steps"], runs[0]["cells"]
    found = {phase: float(np.median([r[phase] for r in runs])) / steps for phase in STEPPED}
    step = float(np.median([sum(r[phase] for phase in STEPPED) for r in runs])) / steps
    return found | {"step": step, "rate": cells / step, "share": found["internal_force"] / step}


if __name__ == "__main__":
    begin(Path(sys.argv[1]), bool(int(sys.argv[2])))
