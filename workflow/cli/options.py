# SPDX-License-Identifier: LGPL-3.0-or-later
"""Options of the command line: scenes with changes, ranks, answers and exit codes.

Heavy modules are imported where a verb needs them, here and in the verbs: help must come at once.
"""

import json
import os
import subprocess
import sys
import tomllib
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer

from workflow.scene.scene import Scene, SceneError
from workflow.scene.units import takes_text
from workflow.simulation import interrupts
from workflow.simulation.ranks import alike, call, end, in_mpi, mpi_command

if TYPE_CHECKING:
    from workflow.results.table import Table

EXIT = (
    "Exit codes: 0 done; 2 bad input; 3 stopped by a guard, a full disk or an error on one rank, "
    "results kept; 130 interrupted by SIGINT, SIGTERM or SIGHUP, to go on with --resume."
)
EXITS = (0, 1, 2, 3, 130)

SceneName = Annotated[str, typer.Argument(help="Name of a built-in scene, or path of a TOML file.")]
Changes = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Change a key of the scene, e.g. mesh.size=2e-3 (SI, TOML value); may be repeated.",
    ),
]
Ranks = Annotated[int, typer.Option(min=1, help="MPI ranks that share the work.")]
Oversubscribe = Annotated[
    bool,
    typer.Option(
        "--oversubscribe",
        envvar="SQUEALX_OVERSUBSCRIBE",
        help="Allow more ranks than there are cores.",
    ),
]
Json = Annotated[
    bool, typer.Option("--json", help="Print one JSON object, and only that, on stdout.")
]


def examples(*lines: str) -> str:
    """Return examples as the last paragraphs of a help text."""
    return "\n\n".join(f"[dim]{line}[/dim]" for line in lines)


def load(scene: str, changes: list[str] | None) -> Scene:
    """Return the scene with the ``key=value`` changes of the command line."""
    return Scene.load(scene, **parsed(changes))


def parsed(changes: list[str] | None) -> dict[str, Any]:
    """Return the ``key=value`` changes of the command line by key."""
    found: dict[str, Any] = {}
    for change in changes or []:
        key, equals, text = change.partition("=")
        if not equals:
            raise SceneError(f"--set {change!r}: expected key.path=value")
        found[key.strip()] = value_of(key.strip(), text)
    return found


def value_of(key: str, text: str) -> Any:
    """Return the TOML value that a text is; the text itself where it is none or text is expected.

    So a rail may be called 54E1, which TOML takes for the number 540.
    """
    try:
        value = tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text
    return value if isinstance(value, str) or not takes_text(Scene, key.split(".")) else text


def scene_of(out: Path | None, resume: bool) -> str:
    """Return the scene file of the result folder that a run is to go on in."""
    if out is None or not resume:
        raise SceneError(
            "Missing argument 'SCENE': expected a built-in name or a TOML file; only --resume "
            "with --out takes it from the folder"
        )
    if not (out / "scene.toml").is_file():
        raise SceneError(f"out = {str(out)!r}: expected a result folder with scene.toml to resume")
    return str(out / "scene.toml")


def on_ranks(
    ranks: int,
    scene: str,
    changes: list[str] | None,
    folder: Path,
    as_json: bool,
    verb: tuple[str, ...] = ("run",),
) -> int:
    """Start this very command under ``mpiexec`` and return its exit code."""
    try:
        command = mpi_command(ranks, ["-m", "workflow.cli", *verb, scene])
    except FileNotFoundError as error:
        raise SceneError(f"--ranks {ranks}: {error}") from None
    for change in changes or []:
        command += ["--set", change]
    command += ["--out", str(folder)] + ["--json"] * as_json
    # launchers tell of their troubles on stdout, where JSON is to be alone
    done = call(command, stdout=subprocess.PIPE if as_json else None)
    if as_json:
        print(done.stdout, end="", file=sys.stderr if done.returncode else sys.stdout)
    if done.returncode in EXITS:
        return done.returncode
    print(
        f"squealx: the ranks ended with code {done.returncode}, killed from outside or for want of "
        f"memory; what was written is kept: {folder}",
        file=sys.stderr,
    )
    return 3


def answer(as_json: bool, found: Any, parts: Callable[[], "Iterable[str | Table]"]) -> None:
    """Print a result on stdout: as one JSON object, or as lines and tables.

    Args:
        as_json: Which of the two.
        found: What JSON has.
        parts: Called for the lines and tables.
    """
    from workflow.results import table

    if as_json:
        print(json.dumps(table.strict(found)))
        return
    from rich.console import Console

    table.show(parts(), Console())


def catalogue(kind: str, about: str, found: dict[str, dict[str, str]]) -> "Table":
    """Return the table of built-in scenes or studies: name, title, size and time."""
    from workflow.results.table import Column, Table

    heads = (kind, about, "size and time on two cores")
    columns = [Column(head, k, words=True) for k, head in enumerate(heads)]
    return Table("", columns, [(n, row["title"], row["about"]) for n, row in found.items()])


def progress(quiet: bool = False) -> Callable[[str], None]:
    """Return what prints a line of progress on stderr."""
    from rich.console import Console

    console = Console(stderr=True, quiet=quiet)
    return lambda line: console.print(line, highlight=False, soft_wrap=True)


def fail(code: int, message: str) -> NoReturn:
    """Print an error once (rank 0) and exit; one that not all ranks meet ends them all."""
    if in_mpi():
        from mpi4py import MPI

        def at_once(*_: Any) -> None:
            if interrupts.another():
                MPI.COMM_WORLD.Abort(130)

        with interrupts.handled(at_once):  # while the ranks wait for each other
            if not alike(MPI.COMM_WORLD):
                end(f"rank {MPI.COMM_WORLD.rank}: {message}", code)
    rank = os.environ.get("PMI_RANK") or os.environ.get("OMPI_COMM_WORLD_RANK") or "0"
    if rank == "0":
        print(f"squealx: {message}", file=sys.stderr)
    sys.exit(code)
