# SPDX-License-Identifier: LGPL-3.0-or-later
"""Machines that lack something: compiler, cache, optional packages, room, a reader."""

import os
import subprocess
import sys

import pytest

from workflow.cli.errors import LONGEST, told
from workflow.scene import SceneError


def alone(*words, code="from workflow.cli import main; main()", **options):
    """The command in a process of its own; ``env`` is put over that of this process."""
    env = os.environ | options.pop("env", {})
    command = [sys.executable, "-c", code, *map(str, words)]
    return subprocess.run(
        command, **({"capture_output": True} | options), text=True, env=env, timeout=300
    )


@pytest.mark.parametrize("compiler", ["no-such-compiler", "false"])
def test_no_compiler(tmp_path, compiler):
    """``CC`` is no program, or one that fails: exit 2 before meshing, what to install is said."""
    done = alone("run", "bar-wave", "--out", tmp_path / "out", env={"CC": compiler})
    assert done.returncode == 2 and "Traceback" not in done.stderr
    assert compiler in done.stderr and "expected a C compiler" in done.stderr
    assert "mesh:" not in done.stderr and not (tmp_path / "out").exists()


def test_a_cache_that_cannot_be_written(tmp_path):
    """The cache folder would lie in a file: the run is done, forms go to a temporary folder."""
    (tmp_path / "taken").write_text("a file")
    env = {"XDG_CACHE_HOME": str(tmp_path / "taken"), "TMPDIR": str(tmp_path)}
    short = ("--set", "time.end=2e-6", "--set", "time.output_interval=1e-6")
    done = alone("run", "bar-wave", *short, "--out", tmp_path / "out", env=env)
    assert done.returncode == 0, done.stderr
    assert "not kept for the next run" in done.stderr
    assert not list(tmp_path.glob("squealx-forms-*"))


@pytest.mark.parametrize(
    ("missing", "words", "extra"),
    [
        ("meshio", ("export", "bar-wave", "OUT/a.vtu"), "mesh"),
        ("mpi4py", ("run", "bar-wave", "--out", "OUT/r"), "fenicsx"),
    ],
)
def test_a_package_is_missing(tmp_path, missing, words, extra):
    """An optional package is not there: exit 2 and what to install."""
    code = f"import sys; sys.modules[{missing!r}] = None; from workflow.cli import main; main()"
    words = [word.replace("OUT", str(tmp_path)) for word in words]
    done = alone(*words, code=code)
    assert done.returncode == 2 and "Traceback" not in done.stderr
    assert f"pip install 'squealx[{extra}]'" in done.stderr


def test_stdout_is_full_or_closed():
    """A full disk behind stdout ends with 3 in words; a reader who leaves is no error."""
    with open("/dev/full", "w") as full:
        done = alone("scenes", stdout=full, stderr=subprocess.PIPE, capture_output=False)
    assert done.returncode == 3 and "No space left" in done.stderr
    assert "Traceback" not in done.stderr
    read, write = os.pipe()
    os.close(read)
    done = alone("scenes", "--json", stdout=write, stderr=subprocess.PIPE, capture_output=False)
    os.close(write)
    assert done.returncode == 0 and done.stderr == ""


def test_a_terminal_of_few_letters():
    """ASCII alone: letters beyond it are written as escapes."""
    done = alone("validate", "ä.toml", env={"PYTHONIOENCODING": "ascii", "PYTHONUTF8": "0"})
    assert done.returncode == 2 and "\\xe4.toml" in done.stderr


def test_long_messages_are_cut():
    """10 000 characters: begin and end of them."""
    code, message = told(SceneError("key = " + "x" * 10_000 + ": expected less"))
    assert code == 2 and len(message) <= LONGEST
    assert message.startswith("key = x") and message.endswith("expected less")


def test_an_error_that_nobody_expected(tmp_path, monkeypatch):
    """Exit 3; what led to it is kept in a file that the message names."""
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    try:
        {}["no such key"]
    except KeyError as error:
        code, message = told(error)
    (file,) = tmp_path.glob("squealx-error-*.txt")
    assert code == 3 and str(file) in message and "KeyError: 'no such key'" in file.read_text()
