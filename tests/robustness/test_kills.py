# SPDX-License-Identifier: LGPL-3.0-or-later
"""Runs that a signal ends in any phase: no process is left, and the rest comes out bit by bit."""

import itertools
import json
import random
import shutil
import signal
import time

import pytest
from PIL import Image

from tests.folders import assert_same
from tests.processes import alive, at_work, below, started, until
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
    "figures": ("figures/*.png", ""),  # of a run that is done
}
FEW = [
    ("TERM", 1, "stepping", 0), ("TERM", 2, "output", 0), ("INT", 1, "equilibrium", 0),
    ("HUP", 2, "stepping", 0), ("KILL", 1, "mesh", 0), ("KILL", 2, "checkpoint", 0),
    ("KILL", 1, "figures", 0), ("INT", 1, "figures", 0),
]  # fmt: skip
rng = random.Random(15)
EVERY = list(itertools.product(SIGNALS, (1, 2), PHASES))
MANY = [(*case, k) for k, case in enumerate(EVERY + rng.sample(EVERY, 2), 1)]  # 50 moments


def cases(figures):
    """Kills while a run is on, or while its figures are drawn: few, and with ``long`` many."""
    found = [pytest.param(*c, marks=[pytest.mark.slow] * (c[1] > 1 or figures)) for c in FEW]
    found += [pytest.param(*c, marks=[pytest.mark.long, pytest.mark.slow]) for c in MANY]
    return [case for case in found if (case.values[2] == "figures") == figures]


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
    """Tell whether a command has come to a phase."""
    name, text = PHASES[phase]
    path = next(folder.glob(name), None)
    return path is not None and (not text or text in path.read_text("utf-8"))


def killed(command, folder, name, phase, seed):
    """Exit code of a command that a signal ends in a phase, and its last words; nothing lives on.

    The signal goes to the parent alone, some time after the phase has begun.
    """
    process = started(*command)
    until(lambda: reached(folder, phase) or process.poll() is not None)
    time.sleep(random.Random(seed).uniform(0.0, 0.3))
    family = below(process.pid)
    process.send_signal(signal.Signals[f"SIG{name}"])
    _, said = process.communicate(timeout=60)
    until(lambda: not at_work(folder) and not any(map(alive, family)), 30)
    return process.returncode, said


def goes_on(folder, ranks, squealx):
    """Resume a run to its end."""
    if ranks == 1:
        run(Scene.load(NAME, **CHANGES), folder, quiet=True, resume=True)
    else:
        squealx("run", *words(ranks), "--ranks", ranks, "--resume", "--out", folder)


@pytest.mark.mpi
@pytest.mark.parametrize(("name", "ranks", "phase", "seed"), cases(figures=False))
def test_a_signal_loses_nothing(name, ranks, phase, seed, whole, squealx, tmp_path):
    """SIGTERM, SIGINT and SIGHUP exit with 130 and say how to go on, after a checkpoint if stepping
    had begun; SIGKILL of the parent alone ends its ranks as well. Resumed, all is as without.
    """
    folder = tmp_path / "cut"
    command = ("run", *words(ranks), "--ranks", ranks, "--out", folder)
    code, said = killed(command, folder, name, phase, seed)
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


@pytest.mark.parametrize(("name", "ranks", "phase", "seed"), cases(figures=True))
def test_a_signal_spoils_no_figure(name, ranks, phase, seed, whole, command, tmp_path):
    """Figures that are there when drawing ends are whole, results untouched; all can be drawn.

    A signal that comes when all are there already may find nothing left to end.
    """
    folder = tmp_path / "drawn"
    shutil.copytree(whole(ranks), folder)
    code, said = killed(("figures", folder), folder, name, phase, seed)
    assert code in (0, -signal.SIGKILL if name == "KILL" else 130), said
    there = sorted((folder / "figures").glob("*.png"))
    for path in there:
        with Image.open(path) as picture:
            picture.load()
    assert_same(whole(ranks), folder)
    done = command("figures", folder, "--json")
    drawn = {path for path in json.loads(done.stdout)["figures"] if path.endswith(".png")}
    assert {*map(str, there)} == drawn if code == 0 else {*map(str, there)} <= drawn
    shutil.rmtree(folder)
