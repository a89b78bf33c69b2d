# SPDX-License-Identifier: LGPL-3.0-or-later
"""Records of an HDF5 file that wait beside it: one change for many, none lost, none twice."""

import os
import resource
import signal
import subprocess
import sys

import h5py
import numpy as np
import pytest

from tests.folders import BAR, assert_same
from workflow import Scene, read_run, run
from workflow.results import atomic, batch, columns
from workflow.results.batch import Batch, opened, waiting_of
from workflow.results.columns import note, rows, whole
from workflow.results.record import Record


def record(k: int) -> list[columns.Item]:
    """Rows, a dataset of its own and an attribute, all of number ``k``."""
    return [
        rows("history/t", [float(k)], "s", about="time"),
        rows("history/motion", np.full((1, 3), k), "m", quantity="displacement"),
        rows("empty/x", np.zeros((0, 2)), "m"),
        whole(f"contact/{k}/stick", np.arange(k) % 2 == 0, units="1"),
        note("probes", last=k),
    ]


def empty(path):
    """An HDF5 file that holds nothing."""
    with h5py.File(path, "w"):
        pass
    return path


def check(path, n: int) -> None:
    """The file holds the records 0 to n - 1, each once."""
    with h5py.File(path, "r") as file:
        np.testing.assert_array_equal(file["history/t"], np.arange(n))
        np.testing.assert_array_equal(file["history/motion"], np.outer(np.arange(n), [1, 1, 1]))
        assert file["empty/x"].shape == (0, 2) and len(file["contact"]) == n
        assert file["contact/3/stick"].dtype == bool
        assert dict(file["history/motion"].attrs) == {"units": "m", "quantity": "displacement"}
        assert file["history/t"].attrs["about"] == "time"
        assert file["probes"].attrs["last"] == n - 1


@pytest.fixture
def changes(monkeypatch):
    """A list with one entry for each change of an HDF5 file."""
    made, real = [], atomic.changing
    monkeypatch.setattr(atomic, "changing", lambda path: made.append(path) or real(path))
    return made


@pytest.fixture
def long(monkeypatch):
    """Records wait for an hour."""
    monkeypatch.setattr(atomic, "SYNC_INTERVAL", 3600.0)


def test_one_change_for_many_records(tmp_path, changes, long):
    """Ten records are one change, and nothing is left beside the file."""
    path = empty(tmp_path / "x.h5")
    waits = Batch(path)
    for k in range(10):
        waits.add(record(k))
        assert waiting_of(path).exists() and not changes
    waits.flush()
    assert len(changes) == 1 and os.listdir(tmp_path) == ["x.h5"]
    check(path, 10)
    waits.flush()
    assert len(changes) == 1


def test_slow_or_large_records_do_not_wait(tmp_path, changes, long, monkeypatch):
    """A record that comes a second after the last change is written, as is a large one."""
    path = empty(tmp_path / "x.h5")
    waits = Batch(path)
    waits.add([rows("big", np.zeros(batch.MOST // 8 + 1), "m")])
    assert len(changes) == 1 and not waiting_of(path).exists()
    monkeypatch.setattr(atomic, "SYNC_INTERVAL", 0.0)
    for k in range(3):
        waits.add(record(k))
        assert len(changes) == 2 + k and not waiting_of(path).exists()


def test_reader_sees_what_waits_and_changes_nothing(tmp_path, long):
    """All records are there for one who opens the file; its bytes stay as they are."""
    path = empty(tmp_path / "x.h5")
    waits = Batch(path)
    for k in range(4):
        waits.add(record(k))
    waits.flush()
    waits.add(record(4))
    before = path.read_bytes(), waiting_of(path).read_bytes()
    with opened(path) as file:
        np.testing.assert_array_equal(file["history/t"], np.arange(5))
        assert list(file["contact/4/stick"]) == [True, False, True, False]
    assert (path.read_bytes(), waiting_of(path).read_bytes()) == before
    waits.flush()
    check(path, 5)


@pytest.mark.parametrize("written", [False, True])
def test_what_a_killed_run_left_is_taken_in_once(tmp_path, written, long):
    """Killed before or after the change, with the last record cut off: all whole ones, once."""
    path = empty(tmp_path / "x.h5")
    waits = Batch(path)
    for k in range(5):
        waits.add(record(k))
    left = waiting_of(path).read_bytes()
    if written:
        waits.flush()  # and killed before the waiting records were removed
    waiting_of(path).write_bytes(left + batch.packed(6, record(5))[:-3])
    for _ in range(2):
        batch.finish(path)
        assert os.listdir(tmp_path) == ["x.h5"]
        check(path, 5)
    more = Batch(path)
    more.add(record(5))
    more.flush()
    check(path, 6)


def test_full_disk_leaves_whole_records(tmp_path, long):
    """A record that does not fit leaves those before it, and is an error."""
    path = empty(tmp_path / "x.h5")
    waits = Batch(path)
    for k in range(4):
        waits.add(record(k))
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (waiting_of(path).stat().st_size + 20, limit[1]))
    try:
        with pytest.raises(OSError, match="File too large"):
            waits.add(record(4))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limit)
    batch.finish(path)
    check(path, 4)


def test_records_keep_their_types_beside_the_file(tmp_path):
    """Numbers, flags and short text come back from the waiting file as they were."""
    path = tmp_path / "x.waiting"
    items = [
        rows("a", np.array([b"birth", b"end"], dtype="S5"), "", centre=[1.0, 0.1]),
        whole("b", np.float32([[1, 2]]), units="m"),
        whole("c", np.array([True, False])),
        note("d", t=0.1 + 0.2),
    ]
    batch.append(path, batch.packed(7, items))
    ((number, found),) = batch.records(path)
    assert number == 7 and [i.name for i in found] == list("abcd")
    for one, other in zip(items, found, strict=True):
        assert one.attrs == other.attrs and one.chunk == other.chunk
        if one.values is not None:
            np.testing.assert_array_equal(one.values, other.values, strict=True)
    assert found[-1].values is None


KILLED = """
import os, signal, sys
from workflow import Scene, run
from workflow.results import atomic
atomic.SYNC_INTERVAL = 3600.0
scene = Scene.load("bar-impact", **eval(sys.argv[2]))
def kill(model):
    if model.state.step == int(sys.argv[3]):
        os.kill(os.getpid(), signal.SIGKILL)
run(scene, sys.argv[1], quiet=True, watch=kill)
"""


def test_kill_loses_less_than_an_output_interval(run_scene, tmp_path):
    """Killed before any change of HDF5: every output is read back, and the run goes on from there.

    The checkpoint is at step 20 and what kills comes before the output of step 62: the outputs of
    all steps before can be read. Resumed, the run is the unbroken one bit by bit.
    """
    changes = {**BAR, "output.checkpoint_steps": 20}
    unbroken, folder = run_scene("bar-impact", **changes), tmp_path / "killed"
    command = [sys.executable, "-c", KILLED, str(folder), repr(changes), "62"]
    assert subprocess.run(command, check=False).returncode == -signal.SIGKILL
    whole_run = read_run(unbroken)
    n = 61 // round(1e-6 / whole_run.summary["dt"]) + 1
    assert n > 20
    for name, column in read_run(folder).history.items():
        np.testing.assert_array_equal(column, whole_run.history[name][:n])
    assert len(list(Record(folder).series("displacement"))) == n
    scene = Scene.load("bar-impact", **changes)
    run(scene, folder, quiet=True, resume=True)
    assert "resumed at step 60" in (folder / "run.log").read_text()
    assert_same(unbroken, folder)
