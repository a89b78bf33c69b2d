# SPDX-License-Identifier: LGPL-3.0-or-later
"""Lock of a folder: who is at work there is told, who has died does not keep others waiting."""

import fcntl
import json
import os
import platform
import signal
import subprocess
import sys

import pytest

from tests.folders import BAR, assert_same
from workflow import Scene, run
from workflow.results.lock import locked
from workflow.scene.scene import SceneError
from workflow.simulation.ranks import tie

HOLD = """
import sys, time
from pathlib import Path
from workflow.results.lock import locked
with locked(Path(sys.argv[1]), "squealx run"):
    (Path(sys.argv[1]) / "something").touch()
    print("held", flush=True)
    time.sleep(60)
"""


def test_who_is_at_work_is_told(tmp_path):
    """The second one hears of process, machine and time; the lock goes with its holder."""
    out = tmp_path / "out"
    with locked(out, "squealx run"):
        since = json.loads((out / ".lock").read_text())["since"]
        with pytest.raises(SceneError) as told, locked(out, "squealx study"):
            pass
        for part in (str(out), "another squealx run", str(os.getpid()), platform.node(), since):
            assert part in str(told.value)
        assert (out / ".lock").exists()
    assert not out.exists()
    out.mkdir()
    with locked(out, "squealx run"):
        pass
    assert out.exists() and not [*out.iterdir()]


def test_a_holder_that_died_is_followed(tmp_path):
    """SIGKILL: the kernel lets the lock go, and what the file says of this machine is not asked."""
    command = [sys.executable, "-c", HOLD, tmp_path / "out"]
    holder = subprocess.Popen(
        command, stdout=subprocess.PIPE, text=True, preexec_fn=tie(signal.SIGKILL)
    )
    assert holder.stdout is not None and holder.stdout.readline() == "held\n"
    with pytest.raises(SceneError, match=f"process {holder.pid} on "), locked(tmp_path / "out", ""):
        pass
    holder.kill()
    holder.communicate()
    assert (tmp_path / "out" / ".lock").exists()
    with locked(tmp_path / "out", "squealx run"):
        assert json.loads((tmp_path / "out" / ".lock").read_text())["process"] == os.getpid()
    assert [p.name for p in (tmp_path / "out").iterdir()] == ["something"]


def test_a_holder_on_another_machine_is_asked_for(tmp_path):
    """Its lock may not reach here: it is believed to live, and the file to remove is named."""
    about = {"who": "squealx run", "host": "elsewhere", "process": 1, "since": "yesterday"}
    (tmp_path / ".lock").write_text(json.dumps(about))
    for _ in range(2):
        with pytest.raises(SceneError) as told, locked(tmp_path, "squealx run"):
            pass
        assert "process 1 on elsewhere, since yesterday" in str(told.value)
        assert f"remove {str(tmp_path / '.lock')!r}" in str(told.value)
    (tmp_path / ".lock").unlink()
    with locked(tmp_path, "squealx run"):
        pass


def test_a_disk_without_locks(tmp_path, monkeypatch):
    """There the file alone tells: of a process that lives, of one that is gone."""

    def no_lock(file, how):
        raise OSError(95, "Operation not supported")

    monkeypatch.setattr(fcntl, "flock", no_lock)
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    about = {"who": "squealx run", "host": platform.node(), "since": "now"}
    (tmp_path / ".lock").write_text(json.dumps(about | {"process": os.getppid()}))
    with pytest.raises(SceneError, match="at work here"), locked(tmp_path, "squealx run"):
        pass
    (tmp_path / ".lock").write_text(json.dumps(about | {"process": gone.pid}))
    with locked(tmp_path, "squealx run"):
        pass


def test_a_second_run_does_not_harm_the_first(run_scene, tmp_path):
    """Started in the same folder while the first one steps, it is refused; the first comes out."""
    scene = Scene.load("bar-impact", **BAR)

    def watch(model):
        for resume in (False, True) if model.state.step == 40 else ():
            with pytest.raises(SceneError, match="another squealx run is at work here"):
                run(scene, tmp_path / "out", quiet=True, resume=resume)

    run(scene, tmp_path / "out", quiet=True, watch=watch)
    assert_same(run_scene("bar-impact", **BAR), tmp_path / "out")
    with pytest.raises(SceneError, match="already holds a run"):
        run(scene, tmp_path / "out", quiet=True)


def test_exit_code_of_who_comes_second(command, tmp_path):
    """2, of a run and of a study, with who is at work."""
    pytest.importorskip("snakemake")
    study = tmp_path / "study.toml"
    study.write_text(
        'name = "few"\ntitle = "few"\nscene = "bar-wave"\nvary."time.safety" = [0.5]\n'
    )
    with locked(tmp_path / "out", "squealx study"):
        for words in (("run", "bar-wave"), ("study", study), ("run", "bar-wave", "--ranks", 2)):
            done = command(*words, "--out", tmp_path / "out", check=False)
            assert done.returncode == 2
            told = f"another squealx study is at work here (process {os.getpid()} on"
            assert told in done.stderr
