# SPDX-License-Identifier: LGPL-3.0-or-later
"""Fixtures of the whole suite: processes and ranks, results shared by tests, round-off."""

import fcntl
import functools
import hashlib
import json
import os
import pickle
import signal
import subprocess
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mpi4py import MPI

import pytest
from dolfinx import jit

from tests.round_off import perturbed
from workflow import Scene
from workflow.cli import main
from workflow.model.model import Model, build
from workflow.simulation import initial
from workflow.simulation import run as running
from workflow.simulation.interrupts import Interrupted
from workflow.simulation.ranks import OPEN_MPI, mpi_command, mpiexec, tie
from workflow.stability import limits

# two ranks on a machine with one core are a test as well
os.environ["SQUEALX_OVERSUBSCRIBE"] = "1"
os.environ.update(OPEN_MPI)

# workers that compile the same form wait for each other for as long as it takes
_, _words = jit.DOLFINX_DEFAULT_JIT_OPTIONS["timeout"]
jit.DOLFINX_DEFAULT_JIT_OPTIONS["timeout"] = (300, _words)

Done = subprocess.CompletedProcess[str]


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add ``--perturb``."""
    parser.addoption(
        "--perturb",
        type=int,
        default=0,
        metavar="SEED",
        help="start every run with its velocities changed in the last digit (tests/round_off.py)",
    )


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put files with slow tests first: at the end no worker is left alone with a long one."""
    slow = Counter(item.path for item in items if item.get_closest_marker("slow"))
    size = Counter(item.path for item in items)
    items.sort(key=lambda item: -slow[item.path] / size[item.path])


def pytest_exception_interact(call: pytest.CallInfo[Any]) -> None:
    """End the tests where a signal has ended a run in this process."""
    if call.excinfo is not None and isinstance(call.excinfo.value, Interrupted):
        pytest.exit(str(call.excinfo.value), 130)


@pytest.fixture
def round_off(monkeypatch: pytest.MonkeyPatch) -> Callable[[int], None]:
    """Give the runs to come, in this process, a round-off of their own: ``round_off(seed)``."""

    def choose(seed: int) -> None:
        def start(model: Model, log: Callable[[str], Any]) -> None:
            initial.start(model, log)
            perturbed(model, seed)

        for module in (running, limits):
            monkeypatch.setattr(module, "start", start)

    return choose


@pytest.fixture(autouse=True)
def _perturbed(request: pytest.FixtureRequest) -> None:
    if seed := request.config.getoption("--perturb"):
        request.getfixturevalue("round_off")(seed)


@pytest.fixture(scope="session")
def mpirun() -> Callable[..., Done]:
    """Run Python on ranks: ``mpirun(2, "-m", "workflow.cli", "run", "bar-wave")``.

    The words are those of the interpreter (``-c`` and a snippet, ``-m`` and a module, a file). One
    rank is a process without ``mpiexec``. A process that fails is an error, unless ``check=False``;
    none outlives the tests.
    """
    launcher = mpiexec()

    def call(
        ranks: int, *words: object, timeout: float = 300, check: bool = True, **options: Any
    ) -> Done:
        if ranks > 1 and launcher is None:
            pytest.skip("needs mpiexec beside python or on PATH")
        python = mpi_command(ranks, []) if ranks > 1 else [sys.executable]
        command = [*python, *map(str, words)]
        options = {"preexec_fn": tie(signal.SIGKILL), "timeout": timeout} | options
        done = subprocess.run(command, capture_output=True, text=True, check=False, **options)
        assert not check or done.returncode == 0, done.stdout + done.stderr
        return done

    return call


@pytest.fixture(scope="session")
def tests_on(mpirun: Callable[..., Done]) -> Callable[..., Done]:
    """Run the tests of a file on ranks: ``tests_on(2, __file__, "-k", "ranks_agree")``."""

    def call(ranks: int, *words: object) -> Done:
        return mpirun(ranks, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *words)

    return call


@pytest.fixture(scope="session")
def squealx(mpirun: Callable[..., Done]) -> Callable[..., Done]:
    """Run the command in a process of its own: ``squealx("run", "bar-wave", "--ranks", 2)``."""
    return functools.partial(mpirun, 1, "-m", "workflow.cli")


@pytest.fixture
def command(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> Callable[..., Done]:
    """Run the command in this process, which has its imports already; else like ``squealx``."""

    def call(*words: object, check: bool = True) -> Done:
        monkeypatch.setattr(sys, "argv", ["squealx", *map(str, words)])
        capfd.readouterr()
        try:
            main()
            code = 0
        except SystemExit as stop:
            code = int(stop.code or 0)
        done = subprocess.CompletedProcess(sys.argv, code, *capfd.readouterr())
        assert not check or code == 0, done.stdout + done.stderr
        return done

    return call


@pytest.fixture(scope="session")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str, Callable[[Path], Any]], Any]:
    """Make something once per session: ``shared(name, make)`` returns what ``make(folder)`` did.

    Workers of pytest-xdist share it: one makes it in a folder that stays, the others wait and read
    a copy of what was returned, which is pickled.
    """
    base = tmp_path_factory.getbasetemp()
    base = base.parent if os.environ.get("PYTEST_XDIST_WORKER") else base

    def get(name: str, make: Callable[[Path], Any]) -> Any:
        folder = base / "shared" / name
        folder.mkdir(parents=True, exist_ok=True)
        kept = folder.with_suffix(".pickle")
        with folder.with_suffix(".lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not kept.exists():
                kept.write_bytes(pickle.dumps(make(folder)))
        return pickle.loads(kept.read_bytes())

    return get


def key(scene: Scene) -> str:
    """Return a name for a scene with all its settings."""
    tables = json.dumps(scene.tables(), sort_keys=True, default=str)
    return f"{scene.name}-{hashlib.sha256(tables.encode()).hexdigest()[:12]}"


@pytest.fixture(scope="session")
def run_scene(shared: Callable[..., Any]) -> Callable[..., Path]:
    """Run a scene quietly and return its folder, once per session and changes.

    ``run_scene("bar-impact", **{"mesh.size": 5e-3})``. The folder is for reading: a test that
    writes in it copies it first.
    """

    def get(name: str, **changes: Any) -> Path:
        scene = Scene.load(name, **changes)

        def make(folder: Path) -> Path:
            running.run(scene, folder / "run", quiet=True)
            return folder / "run"

        return shared(key(scene), make)

    return get


@pytest.fixture(scope="session")
def resting() -> Callable[..., Model]:
    """Return a scene brought to rest: ``resting("hertz", **{"mesh.size": 1e-3})``.

    Solved once per process and changes, so the model is for reading. A test that steps it or
    changes it asks for ``fresh=True`` and gets one of its own.
    """
    kept: dict[str, tuple[Model, bytes]] = {}

    def at_rest(scene: Scene) -> Model:
        model = build(scene, MPI.COMM_SELF)
        initial.start(model, lambda line: None)
        return model

    def get(name: str, *, fresh: bool = False, **changes: Any) -> Model:
        scene = Scene.load(name, **changes)
        if fresh:
            return at_rest(scene)
        if key(scene) not in kept:
            model = at_rest(scene)
            kept[key(scene)] = model, model.state.u.x.array.tobytes()
        model, at_first = kept[key(scene)]
        assert model.state.u.x.array.tobytes() == at_first, f"{name}: a test moved what is shared"
        return model

    return get
