# SPDX-License-Identifier: LGPL-3.0-or-later
"""Resuming replaces no results: finished runs, other scenes, folders without a checkpoint."""

import json
import shutil

import pytest

from tests.folders import BAR, arrays, assert_same, copied
from workflow import Scene, run
from workflow.results import atomic
from workflow.scene.scene import SceneError

SCENE = Scene.load("bar-impact", **BAR)
BARE = SCENE.with_(**{"output.checkpoint_steps": None, "output.checkpoint_minutes": 0.0})


def contents(folder):
    """Every file of a folder, but for the log."""
    files = [p for p in folder.rglob("*") if p.is_file() and p.name != "run.log"]
    return {str(p.relative_to(folder)): p.read_bytes() for p in files}


@pytest.fixture
def finished(run_scene, tmp_path):
    """A copy of a finished run; ``checkpoint=False`` as one that kept none."""

    def get(*, checkpoint=True):
        folder = tmp_path / f"finished-{checkpoint}"
        shutil.copytree(run_scene("bar-impact", **BAR), folder)
        if not checkpoint:
            shutil.rmtree(folder / "checkpoint")
        return folder

    return get


@pytest.mark.parametrize("checkpoint", [True, False])
def test_a_finished_run_is_left_as_it_is(finished, capsys, checkpoint):
    """Nothing is written; its summary is returned, and how to go on is told."""
    folder = finished(checkpoint=checkpoint)
    before = contents(folder)
    result = run(SCENE, folder, resume=True)
    assert contents(folder) == before
    assert result.summary == json.loads((folder / "summary.json").read_text())
    said = " ".join(capsys.readouterr().err.split())
    assert "finished before, left as it is" in said
    assert ("a later time.end goes on from its checkpoint" in said) == checkpoint


@pytest.mark.parametrize("checkpoint", [True, False])
def test_another_scene_is_refused_with_its_key(finished, checkpoint):
    """Another cell size in the folder of a run: refused, whether or not there is a checkpoint."""
    folder = finished(checkpoint=checkpoint)
    before = contents(folder)
    other = SCENE.with_(**{"mesh.size": 2.5e-3, "output.fields": False})
    with pytest.raises(SceneError, match=r"mesh\.size: 0\.005 in the folder, 0\.0025 in the") as e:
        run(other, folder, quiet=True, resume=True)
    assert "output" not in str(e.value).splitlines()[-1]
    assert contents(folder) == before


def test_no_checkpoint_to_prolong_from(finished):
    """A later end would have to replace what there is."""
    folder = finished(checkpoint=False)
    before = contents(folder)
    later = SCENE.with_(**{"time.end": 6e-5})
    with pytest.raises(SceneError, match=r"time\.end = 6e-05 s: .*left no checkpoint .*new folder"):
        run(later, folder, quiet=True, resume=True)
    assert contents(folder) == before


def test_killed_before_its_first_checkpoint(run_scene, tmp_path):
    """It begins from the start; the outputs that were there are put aside, each time."""
    killed = copied(BARE, tmp_path / "whole", 45)
    (killed / "checkpoint").mkdir()
    (killed / "checkpoint" / "results.h5").write_bytes(b"of a checkpoint that never was")
    before = {name: data for name, data in contents(killed).items() if name != ".lock"}
    run(BARE, killed, quiet=True, resume=True)
    assert_same(tmp_path / "whole", killed)
    assert contents(killed / "aside-1") == before
    assert "are kept in" in (killed / "run.log").read_text()


def test_a_folder_without_outputs_begins_anew(tmp_path):
    """Killed before step 0 was written: there is nothing to keep, and nothing is put aside."""
    killed = copied(BARE, tmp_path / "whole", 0)
    with pytest.raises(SceneError, match=r"mesh\.size"):
        run(BARE.with_(**{"mesh.size": 2.5e-3}), killed, quiet=True, resume=True)
    run(BARE, killed, quiet=True, resume=True)
    assert_same(tmp_path / "whole", killed)
    assert not [*killed.glob("aside-*")]


@pytest.mark.parametrize("left", [b"", b"no json", b'{"end": 3}\n', b"\xff\x00" * 100])
def test_a_broken_journal_was_never_applied(run_scene, tmp_path, left):
    """Of a disk that lost power: it is dropped, and the file is as it was before."""
    path = tmp_path / "results.h5"
    shutil.copy(run_scene("bar-impact", **BAR) / "results.h5", path)
    before = path.read_bytes()
    atomic.journal_of(path).write_bytes(left)
    atomic.finish(path)
    assert path.read_bytes() == before and not atomic.journal_of(path).exists()


@pytest.mark.parametrize("resume", [False, True])
def test_results_without_a_scene_are_not_replaced(finished, resume):
    """Somebody removed scene.toml and summary.json: neither a run nor a resumed one goes there."""
    folder = finished()
    for name in ("scene.toml", "summary.json"):
        (folder / name).unlink()
    times = arrays(folder / "results.h5")["history/t"]
    with pytest.raises(SceneError, match="new folder"):
        run(SCENE, folder, quiet=True, resume=resume)
    assert len(arrays(folder / "results.h5")["history/t"]) == len(times) > 1


def test_the_command_says_that_a_run_is_finished(command, finished):
    """Exit code 0, the summary as ever, so that a script may try again and again."""
    folder = finished()
    done = command("run", "--resume", "--out", folder, "--json")
    assert json.loads(done.stdout) == json.loads((folder / "summary.json").read_text())
    words = ("--set", "mesh.size=1e-3", "--ranks", 2)
    refused = command("run", "--resume", "--out", folder, *words, check=False)
    assert refused.returncode == 2 and refused.stderr.count("mesh.size: 0.005") == 1
