# SPDX-License-Identifier: LGPL-3.0-or-later
"""A compilation that was killed does not keep the next one waiting."""

import fcntl
import logging
import os
import signal
import subprocess
import sys
import time

from mpi4py import MPI

import dolfinx
import pytest
import ufl
from dolfinx import fem

from forms import kernel
from forms.simd import cache, native

FORM = """
from mpi4py import MPI
import sys, time, ufl, dolfinx
from dolfinx import fem
from forms import kernel
from forms.simd import native
import ffcx.codegeneration.jit as ffcx_jit
def compile_objects(*args, **kwargs):  # the C file is there, the library never comes
    print("compiling", flush=True)
    time.sleep(60)
ffcx_jit._compile_objects = compile_objects
msh = dolfinx.mesh.create_unit_cube(MPI.COMM_SELF, 1, 1, 1, dolfinx.mesh.CellType.hexahedron)
w = ufl.TestFunction(fem.functionspace(msh, ("Lagrange", 1)))
{maker}(w * ufl.dx)
"""
MAKERS = {"native.NativeKernel": native.NativeKernel, "kernel.compiled": kernel.compiled}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A cache of its own for this process and those that it starts."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(
        "dolfinx.jit.get_options",
        lambda given, real=dolfinx.jit.get_options: {
            **real(given),
            "cache_dir": (given or {}).get("cache_dir", tmp_path / "fenics"),
        },
    )
    return tmp_path / "fenics"


def constant():
    """∫ w over a cube of one cell."""
    msh = dolfinx.mesh.create_unit_cube(MPI.COMM_SELF, 1, 1, 1, dolfinx.mesh.CellType.hexahedron)
    return ufl.TestFunction(fem.functionspace(msh, ("Lagrange", 1))) * ufl.dx


@pytest.mark.parametrize("maker", MAKERS)
def test_a_killed_compilation_is_removed_and_logged(folder, caplog, maker):
    """SIGKILL while FFCx compiles; the next call compiles at once, far below the 120 s."""
    started = subprocess.Popen(
        [sys.executable, "-c", FORM.format(maker=maker)], stdout=subprocess.PIPE, text=True
    )
    assert started.stdout is not None
    assert started.stdout.readline() == "compiling\n"
    os.kill(started.pid, signal.SIGKILL)
    started.wait()
    (left,) = folder.glob("squealx_*/libffcx_*.c")
    assert not left.with_suffix(".c.cached").exists()
    begin = time.monotonic()
    with caplog.at_level(logging.WARNING, logger="squealx"):
        MAKERS[maker](constant())
    assert time.monotonic() - begin < 30
    assert "left by a compilation that was killed" in caplog.text
    assert left.with_suffix(".c.cached").exists()


def test_what_another_process_compiles_is_left_alone(folder):
    """While the lock is held, nothing is removed, and the wait ends after the time limit."""
    key, form = "key", constant()
    with cache.compiling(MPI.COMM_SELF, form, key, 0.0) as own:
        (own / "libffcx_forms_0.c").touch()
        with (own / cache.LOCK).open("a") as other, pytest.raises(BlockingIOError):
            fcntl.flock(other, fcntl.LOCK_EX | fcntl.LOCK_NB)
        begin = time.monotonic()
        with cache.compiling(MPI.COMM_SELF, form, key, 0.2) as again:
            assert again == own and (own / "libffcx_forms_0.c").exists()
        assert 0.2 <= time.monotonic() - begin < 5
    with cache.compiling(MPI.COMM_SELF, form, key, 0.2):
        assert not (own / "libffcx_forms_0.c").exists()


def test_finished_compilations_stay(folder):
    """Compiled once, found again."""
    native.NativeKernel(constant())
    before = sorted(folder.rglob("*"))
    native.NativeKernel(constant())
    assert sorted(folder.rglob("*")) == before and len(before) > 3
