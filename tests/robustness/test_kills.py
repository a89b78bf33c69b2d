# SPDX-License-Identifier: LGPL-3.0-or-later
"""Runs that a signal ends in any phase: no process is left, and the rest comes out bit by bit."""

import json
import random
import shutil
import signal
import time

import pytest

from tests.folders import assert_same
from tests.processes import at_work, started, until
from workflow import Scene, run

NAME = "sliding-block"
CHANGES = {
    "mesh.size": 5e-3, "mesh.base_size": 6e-3, "time.end": 2e-4, "time.output_interval": 4e-6,
    "output.checkpoint_steps": 97,
}  # fmt: skip
# parallel static solves add in the order in which messages come: not the same bit by bit
METHOD = {1: "static", 2: "relaxation"}
SIGNALS = ("TERM", "INT", "HUP", "KILL")
PHASES = {  # what there is in the folder, or in its log
    "mesh": (".lock", ""),
    "equilibrium": ("run.log", "threads"),
    "stepping": ("run.log", "stepping:"),
    "output": ("run.log", "step 48 of 300"),
    "checkpoint": ("checkpoint", ""),
}
FEW = [
    ("TERM", 1, "stepping"), ("TERM", 2, "output"), ("INT", 1, "equilibrium"),
    ("HUP", 2, "stepping"), ("KILL", 1, "mesh"), ("KILL", 2, "checkpoint"),
]  # fmt: skip
rng = random.Random(15)
MANY = [(rng.choice(SIGNALS), rng.choice((1, 2)), rng.choice([*PHASES]), k) for k in range(50)]


def words(ranks):
    """The scene with its changes, as words of a command."""
    changes = CHANGES | {"equilibrium.method": METHOD[ranks]}
    return [NAME, *(word for k, v in changes.items() for word in ("--set", f"{k}={v}"))]


@pytest.fixture(scope="session")
def whole(run_scene, shared, squealx):
    """The folder of the run that nothing ends, on some ranks."""

    def get(ranks):
        if ranks == 1:
            return run_scene(NAME, **CHANGES)

        def make(folder):
            squealx("run", *words(ranks), "--ranks", ranks, "--out", folder / "run")
            return folder / "run"

        return shared(f"kills-{ranks}", make)

    return get


def reached(folder, phase):
    """Tell whether a run has come to a phase."""
    name, text = PHASES[phase]
    path = folder / name
    return path.exists() and (not text or text in path.read_text("utf-8"))


def killed(folder, name, ranks, phase, seed):
    """Exit code of a run that a signal ends in a phase, and its last words."""
    process = started("run", *words(ranks), "--ranks", ranks, "--out", folder)
    until(lambda: reached(folder, phase) or process.poll() is not None)
    time.sleep(random.Random(seed).uniform(0.0, 0.3))
    process.send_signal(signal.Signals[f"SIG{name}"])
    _, said = process.communicate(timeout=60)
    until(lambda: not at_work(folder), 30)
    return process.returncode, said


def goes_on(folder, ranks, squealx):
    """Resume a run to its end."""
    if ranks == 1:
        run(Scene.load(NAME, **CHANGES), folder, quiet=True, resume=True)
    else:
        squealx("run", *words(ranks), "--ranks", ranks, "--resume", "--out", folder)


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("name", "ranks", "phase", "seed"),
    [pytest.param(*case, 0, marks=[pytest.mark.slow] * (case[1] > 1)) for case in FEW]
    + [pytest.param(*case, marks=[pytest.mark.long, pytest.mark.slow]) for case in MANY],
)
def test_a_signal_loses_nothing(name, ranks, phase, seed, whole, squealx, tmp_path):
    """SIGTERM, SIGINT and SIGHUP exit with 130 and say how to go on, after a checkpoint if stepping
    had begun; SIGKILL of the parent alone ends its ranks as well. Resumed, all is as without.
    """
    folder = tmp_path / "cut"
    code, said = killed(folder, name, ranks, phase, seed)
    if name == "KILL":
        assert code == -signal.SIGKILL
    else:
        assert code in ((0, 130) if phase == "checkpoint" else (130,)), said
    if code == 130 and phase not in ("mesh", "equilibrium"):
        assert f"squealx run --resume --out {folder}" in said
        status = json.loads((folder / "summary.json").read_text("utf-8"))["status"]
        assert status.startswith("interrupted by SIG")
        assert (folder / "checkpoint" / "state.npz").exists() and not (folder / ".lock").exists()
    goes_on(folder, ranks, squealx)
    assert_same(whole(ranks), folder)
    shutil.rmtree(folder)
