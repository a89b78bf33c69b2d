# SPDX-License-Identifier: LGPL-3.0-or-later
"""A run that is killed anywhere goes on from its checkpoint and comes to the same, bit by bit."""

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import h5py
import numpy as np
import pytest

from tests.folders import BAR, arrays, assert_same, copied
from workflow import Scene, run
from workflow.results import atomic
from workflow.scene.scene import SceneError
from workflow.simulation.guards import GuardError
from workflow.simulation.ranks import tie

SCENES = {
    "bar-impact": {
        **BAR, "bodies.bar.stiffness_damping": 1e-8, "bodies.bar.mass_damping": 100.0,
        "bodies.bar.bulk_viscosity": {},
    },
    "sliding-block": {"mesh.size": 5e-3, "mesh.base_size": 6e-3, "output.checkpoint_steps": 7},
    "plastic-bar": {"mesh.size": 2.5e-3, "time.end": 2e-5, "output.checkpoint_steps": 7},
    "plastic-sphere": {
        "mesh.size": 2e-3, "mesh.across": 2, "time.end": 1.6e-5, "output.checkpoint_steps": 7,
        "loads": [{"surface": "inside", "pressure": 6e8, "ramp": 8e-6}], "output.fields": True,
        "bodies.sphere.yielding": {"box": [[-1.0, -1.0, -1.0], [0.012, 1.0, 1.0]]},
    },
    "flattened": {
        "mesh.size": 2.5e-3, "time.end": 5e-6, "output.checkpoint_steps": 7, "time.safety": 0.3,
        "bodies.bar.kinematics": "total-lagrangian", "bodies.bar.velocity": [-400.0, 0.0, 0.0],
        "bodies.bar.mass_damping": 100.0, "output.sample_interval": 1e-6,
        "probes": [{"name": "end", "surface": "xmax", "quantity": "displacement"}],
    },
}  # fmt: skip
BASE = {"flattened": "plastic-bar"}  # the built-in scene, where it has another name


@pytest.mark.parametrize("name", SCENES)
def test_row_23_resumed_run_is_the_same_bit_by_bit(name, tmp_path):
    """The folder as it was at a step between checkpoints and outputs is enough to go on from."""
    scene = Scene.load(BASE.get(name, name), **SCENES[name])
    killed = copied(scene, tmp_path / "whole", 45)
    assert "summary.json" not in os.listdir(killed)
    result = run(scene, killed, quiet=True, resume=True)
    assert_same(tmp_path / "whole", killed)
    whole = json.loads((tmp_path / "whole" / "summary.json").read_text())
    assert result.summary["energy"] == whole["energy"]
    assert result.summary["step_changes"] == whole["step_changes"]
    assert (name == "flattened") == any(c["step"] < 42 for c in whole["step_changes"])
    assert result.summary["contacts"] == whole["contacts"]
    assert "resumed at step 42" in (killed / "run.log").read_text()


DRIVER = """
import os, signal, sys
from workflow import Scene, run
from workflow.results import atomic
scene = Scene.load(sys.argv[1], **eval(sys.argv[3]))
{before}
run(scene, sys.argv[2], quiet=True, resume=True)
"""


def driver(name: str, folder: Path, before: str = "") -> list[str]:
    """Command that starts or resumes a run after the lines ``before``."""
    code = DRIVER.format(before=textwrap.dedent(before))
    return [sys.executable, "-c", code, name, str(folder), repr(SCENES[name])]


@pytest.mark.slow
def test_row_23_power_cuts(run_scene, tmp_path):
    """Killed ten times wherever it happens to be, resumed each time: the same bit by bit."""
    name, folder, rng = "sliding-block", tmp_path / "cut", random.Random(4)
    scene = Scene.load(name, **SCENES[name])
    whole = run_scene(name, **SCENES[name])
    slow = """
        import time
        from workflow.simulation import guards
        old = guards.check_finite
        guards.check_finite = lambda *words: (time.sleep(0.02), old(*words))[1]
    """
    log, cuts = folder / "run.log", 0
    while cuts < 10:
        log.unlink(missing_ok=True)
        process = subprocess.Popen(
            driver(name, folder, slow), stderr=subprocess.DEVNULL, preexec_fn=tie(signal.SIGKILL)
        )
        began = time.monotonic()
        while time.monotonic() - began < 60:
            if log.exists() and "stepping:" in log.read_text("utf-8"):
                break
            time.sleep(0.01)
        time.sleep(rng.uniform(0.0, 0.3))
        process.kill()
        status = process.wait()
        assert status in (0, -signal.SIGKILL)
        if status == 0:  # it had come to its end: once more
            assert_same(whole, folder)
            shutil.rmtree(folder)
            continue
        cuts += 1
        atomic.finish(folder / "results.h5")  # as whoever reads a run that was killed
        with h5py.File(folder / "results.h5", "r") as file:
            assert {"history", "contact"} <= file.keys()
    run(scene, folder, quiet=True, resume=True)
    assert_same(whole, folder)


STRIKE = """
count = 0
def strike(call):
    def struck(*arguments, **words):
        global count
        count += 1
        if count == {at}:
            os.kill(os.getpid(), signal.SIGKILL)
        return call(*arguments, **words)
    return struck
class Struck:
    def __getattr__(self, name):
        call = getattr(os, name)
        return strike(call) if name in ("pwrite", "replace", "fsync") else call
atomic.os = Struck()
atomic.SYNC_INTERVAL = 0.0
"""


@pytest.mark.slow
@pytest.mark.parametrize("first", [40, 300, 1000])
def test_killed_at_every_kind_of_write(first, run_scene, tmp_path):
    """Killed before a system call that writes, for several in a row: nothing is ever lost.

    The calls in a row cover new data, journals, their application and the checkpoint itself.
    """
    name, folder = "bar-impact", tmp_path / "cut"
    scene = Scene.load(name, **SCENES[name])
    whole = run_scene(name, **SCENES[name])
    for at in range(first, first + 7):
        struck = driver(name, folder, STRIKE.format(at=at))
        process = subprocess.run(struck, stderr=subprocess.PIPE, check=False)
        assert process.returncode == -signal.SIGKILL, process.stderr.decode()
        run(scene, folder, quiet=True, resume=True)
        assert_same(whole, folder)
        shutil.rmtree(folder)


@pytest.mark.parametrize("grows", [False, True])
def test_change_of_a_file_is_whole_or_not_there(tmp_path, grows, monkeypatch):
    """Cut off before any write of its application, the file is the new one after finishing."""
    path = tmp_path / "x.h5"
    with h5py.File(path, "w") as file:
        file.create_dataset("a", data=np.arange(3000.0), maxshape=(None,), chunks=(100,))
    old, calls = path.read_bytes(), 0

    def change():
        with atomic.changing(path) as file:
            file["a"].resize(4000 if grows else 50, axis=0)
            file["a"][:40] = 7.0

    class Cut(BaseException):
        pass

    def pwrite(handle, data, offset):
        nonlocal calls
        calls += 1
        if calls == stop:
            raise Cut
        return os.pwrite(handle, data, offset)

    class Module:
        def __getattr__(self, name):
            return pwrite if name == "pwrite" else getattr(os, name)

    monkeypatch.setattr(atomic, "os", Module())
    stop, expected = 0, np.arange(3000.0)
    change()
    total, new = calls, arrays(path)["a"]
    assert total > 2 and len(new) == (4000 if grows else 50) and (new[:40] == 7).all()
    for stop in range(1, total + 1):
        path.write_bytes(old)
        atomic.journal_of(path).unlink(missing_ok=True)
        calls = 0
        with pytest.raises(Cut):
            change()
        applying = atomic.journal_of(path).exists()
        calls, stop = 0, 0
        atomic.finish(path)
        np.testing.assert_array_equal(arrays(path)["a"], new if applying else expected)


def test_broken_files_are_replaced(tmp_path):
    """A results.h5 that is garbage comes from the checkpoint, broken fields begin again."""
    scene = Scene.load("bar-impact", **BAR)
    killed = copied(scene, tmp_path / "whole", 45)
    (killed / "results.h5").write_bytes(b"nothing")
    (killed / "fields.vtkhdf").write_bytes(b"nothing")
    run(scene, killed, quiet=True, resume=True)
    assert_same(tmp_path / "whole", killed, files=["results.h5"])
    late = arrays(killed / "fields.vtkhdf")["VTKHDF/Steps/Values"]
    all_times = arrays(tmp_path / "whole" / "fields.vtkhdf")["VTKHDF/Steps/Values"]
    np.testing.assert_array_equal(late, all_times[-len(late) :])
    assert 0 < len(late) < len(all_times)
    log = (killed / "run.log").read_text()
    assert "results.h5 was broken" in log and "fields.vtkhdf was broken" in log


def test_checkpoint_that_cannot_be_read(run_scene, tmp_path):
    """A damaged checkpoint is bad input, not a wrong answer."""
    scene = Scene.load("bar-impact", **BAR)
    shutil.copytree(run_scene("bar-impact", **BAR), tmp_path / "run")
    path = tmp_path / "run" / "checkpoint" / "state.npz"
    content = bytearray(path.read_bytes())
    content[content.index(b"NUMPY") + 500] ^= 0xFF  # in the first array, not between two
    path.write_bytes(content)
    longer = scene.with_(**{"time.end": 6e-5})
    with pytest.raises(SceneError, match="no checkpoint that can be read"):
        run(longer, tmp_path / "run", quiet=True, resume=True)


def test_changed_scene_is_refused(tmp_path):
    """Keys that alter the past are named with both values; a later end goes on."""
    scene = Scene.load("bar-impact", **BAR)
    run(scene, tmp_path / "short", quiet=True)
    changed = scene.with_(**{"contacts.wall.penalty": 0.2, "guards.energy_error": 0.1})
    with pytest.raises(SceneError, match=r"contacts.wall.penalty: 0.3 in .*, 0.2 in") as caught:
        run(changed, tmp_path / "short", quiet=True, resume=True)
    assert "energy_error:" not in str(caught.value)
    with pytest.raises(SceneError, match=r"time.end = 2e-05 s: expected later"):
        run(scene.with_(**{"time.end": 2e-5}), tmp_path / "short", quiet=True, resume=True)
    longer = scene.with_(**{"time.end": 6e-5})
    run(longer, tmp_path / "long", quiet=True)
    result = run(longer, tmp_path / "short", quiet=True, resume=True)
    assert_same(tmp_path / "long", tmp_path / "short")
    again = run(longer, tmp_path / "short", quiet=True, resume=True)
    assert again.summary["energy"] == result.summary["energy"]


def test_command_line_resumes(command, tmp_path):
    """``run --resume --out DIR`` takes the scene from the folder, on two ranks as well."""
    scene = Scene.load("bar-impact", **BAR)
    killed = copied(scene, tmp_path / "whole", 45)
    done = command("run", "--resume", "--out", killed, "--ranks", 2, "--json")
    summary = json.loads(done.stdout)
    assert summary["ranks"] == 2 and summary["status"] == "done"
    a, b = arrays(tmp_path / "whole" / "results.h5"), arrays(killed / "results.h5")
    for key in ("history/wall_normal_force", "history/kinetic", "history/internal"):
        np.testing.assert_allclose(b[key], a[key], rtol=1e-9, atol=1e-9 * np.abs(a[key]).max())
    failed = command("run", "--resume", "--out", tmp_path / "nowhere", check=False)
    assert failed.returncode == 2 and "scene.toml to resume" in failed.stderr


LIMITED = """
import resource, sys
from mpi4py import MPI  # wants shared memory of its own
from workflow.cli import main
resource.setrlimit(resource.RLIMIT_FSIZE, ({size}, {size}))
main()
"""


def test_no_room_left(run_scene, tmp_path):
    """Files that cannot grow end the run with code 3; what is there can be read and resumed."""
    folder, scene = tmp_path / "full", Scene.load("bar-impact", **BAR)
    words = [w for k, v in BAR.items() for w in ("--set", f"{k}={v}")]

    def with_room(size: int, out: Path) -> "subprocess.CompletedProcess[str]":
        command = [sys.executable, "-c", LIMITED.format(size=size), "run", "bar-impact", *words]
        return subprocess.run(
            [*command, "--out", str(out)], capture_output=True, check=False, text=True
        )

    stopped = with_room(600_000, folder)
    assert stopped.returncode == 3, stopped.stderr
    assert "results cannot be written" in stopped.stderr and "--resume" in stopped.stderr
    assert len(arrays(folder / "results.h5")["history/t"]) > 3
    run(scene, folder, quiet=True, resume=True)
    assert_same(run_scene("bar-impact", **BAR), folder)
    at_once = with_room(1000, tmp_path / "none")
    assert at_once.returncode == 2 and "cannot be written" in at_once.stderr


def test_guard_of_penetration(tmp_path):
    """A wall hit far too fast for its springs: the message names share, node, time and remedy."""
    scene = Scene.load("bar-impact", **BAR).with_(
        **{"guards.penetration": 1e-4, "contacts.wall.penalty": 0.01}
    )
    with pytest.raises(GuardError, match=r"wall: penetration .* % of the cell|penetration") as told:
        run(scene, tmp_path / "run", quiet=True)
    text = str(told.value)
    for part in ("guards.penetration", "step ", "t = ", "node ", "x = ", "contacts.wall.penalty"):
        assert part in text
    assert json.loads((tmp_path / "run/summary.json").read_text())["status"].startswith("stopped")


def test_guard_of_lost_contact(tmp_path):
    """The bar rebounds; with ``keep`` that ends the run where the wall was touched last."""
    scene = Scene.load("bar-impact", **BAR).with_(**{"contacts.wall.keep": True, "time.end": 6e-5})
    with pytest.raises(
        GuardError, match=r"contact wall: lost at step .* seen last at t = "
    ) as told:
        run(scene, tmp_path / "run", quiet=True)
    assert "contacts.wall.keep" in str(told.value)
    history = arrays(tmp_path / "run" / "results.h5")
    assert history["history/wall_normal_force"][-2] > 0 == history["history/wall_normal_force"][-1]
