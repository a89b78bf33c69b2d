# SPDX-License-Identifier: LGPL-3.0-or-later
"""The ``squealx`` command."""

import contextlib
import io
import math
import os
import sys
from collections.abc import Iterator
from importlib.metadata import version as package_version
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

# one thread per rank: the threads of BLAS would fight over the cores of the other ranks
os.environ.setdefault("OMP_NUM_THREADS", "1")
# signals are ours: UCX, the transport of MPI, would take SIGHUP for a wish to be told more
os.environ.setdefault("UCX_DEBUG_SIGNO", "0")
# and PETSc would print a page and exit with their number
os.environ["PETSC_OPTIONS"] = f"-no_signal_handler {os.environ.get('PETSC_OPTIONS', '')}"

from workflow.cli import model, profile, results, scaling, study, writing
from workflow.cli.errors import told
from workflow.cli.options import (
    EXIT,
    Changes,
    Json,
    Oversubscribe,
    Ranks,
    answer,
    catalogue,
    examples,
    fail,
    load,
    on_ranks,
    scene_of,
)
from workflow.scene.scene import Scene, names
from workflow.simulation import interrupts
from workflow.simulation.ranks import Alone, end, end_with_parent, in_mpi
from workflow.simulation.ranks import check as check_ranks

if TYPE_CHECKING:
    from workflow.results.table import Table

app = typer.Typer(
    help="Explicit finite elements for wheel-rail rolling contact. A scene (TOML, SI units) goes "
    "in, a folder of results and figures comes out.",
    epilog=examples(
        "squealx scenes",
        "squealx run bar-impact",
        "squealx figures runs/bar-impact",
        EXIT,
    ),
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
)


@app.command(epilog=examples("squealx scenes", "squealx scenes --json"))
def scenes(as_json: Json = False) -> None:
    """List the built-in scenes with their size and usual run time."""
    listed = {name: Scene.load(name) for name in names()}
    found = {n: {"title": s.title, "about": s.about} for n, s in listed.items()}
    answer(as_json, found, lambda: [catalogue("scene", "what it shows", found)])


@app.command(
    epilog=examples(
        "squealx run hertz",
        "squealx run flange-transition --ranks 2 --out runs/first",
        "squealx run flange-transition --set mesh.size=0.002",
        "squealx run runs/first/scene.toml --out runs/again",
        "squealx run --resume --out runs/first --set time.end=0.006",
        EXIT,
    )
)
def run(
    scene: Annotated[
        str | None,
        typer.Argument(help="Built-in scene or TOML file; with --resume that of the folder."),
    ] = None,
    changes: Changes = None,
    out: Annotated[
        Path | None, typer.Option(help="New folder for the results; runs/NAME if left out.")
    ] = None,
    ranks: Ranks = 1,
    oversubscribe: Oversubscribe = False,
    resume: Annotated[
        bool,
        typer.Option("--resume", help="Go on from the folder's checkpoint, on any ranks."),
    ] = False,
    as_json: Json = False,
) -> None:
    """Run a scene: results into a new folder, progress on the terminal."""
    if scene is None:
        scene = scene_of(out, resume)
    checked = load(scene, changes)
    folder = out or Path("runs") / checked.name
    if ranks > 1 and not in_mpi():
        from workflow.results.folder import kept

        check_ranks(ranks, oversubscribe)
        with kept(folder, "squealx run", resume=resume):
            pass  # refused once, before there are ranks
        verb = ("run", "--resume") if resume else ("run",)
        raise typer.Exit(on_ranks(ranks, scene, changes, folder, as_json, verb))
    from mpi4py import MPI

    from workflow.simulation.run import run as run_scene

    result = run_scene(checked, folder, resume=resume)
    if MPI.COMM_WORLD.rank == 0:
        answer(as_json, result.summary, lambda: tables(result.summary, folder))


def tables(summary: dict[str, Any], folder: Path) -> Iterator["Table"]:
    """Yield the summary of a run and, where theory has answers, both side by side."""
    from workflow.theory.quantity import answers

    yield summary_table(summary, folder)
    if "passes" in summary:
        from workflow.results.passes import tables

        yield from tables(summary["passes"])
    if (beside := answers(summary["expected"])) is not None:
        yield beside


def summary_table(summary: dict[str, Any], folder: Path) -> Any:
    """Return the summary of a run as table."""
    from workflow.results.table import PAIRS, Table

    rate, phases = summary["element_updates_per_second"], summary["seconds_per_phase"].items()
    rows = [
        ("cells, nodes", f"{summary['cells']}, {summary['nodes']}"),
        ("steps, step", f"{summary['steps']}, {summary['dt'] * 1e9:.1f} ns"),
        ("wall time, ranks", f"{summary['wall_seconds']:.1f} s, {summary['ranks']}"),
        ("element updates", f"{rate / 1e6:.2f} M/s"),
        ("seconds per phase", "\n".join(f"{k} {v:.1f}" for k, v in phases)),
    ]
    for key, value in (summary["energy"] or {}).items():
        size = f"{value:.3%}" if "error" in key else f"{value:.4g} J"
        rows.append((key.replace("_", " "), size))
    for name, contact in summary["contacts"].items():
        text = f"{contact['normal_force'] / 1e3:.2f} kN in {contact['patches']} patches"
        angles = [f"{math.degrees(angle):.0f}°" for angle in contact["contact_angles"]]
        text += f" at {', '.join(angles)}" if angles else ""
        depth = f"{contact['max_penetration'] * 1e6:.1f} µm deep"
        rows.append((f"contact {name}", f"{text}, {depth}"))
    return Table(f"{summary['scene']} → {folder}", PAIRS, rows)


@app.command(epilog=examples("squealx version --json"))
def version(as_json: Json = False) -> None:
    """Print the version of squealx and of what it stands on."""
    found = {p: _version(p) for p in ("squealx", "fenics-dolfinx", "dolfinx-solver-real", "numpy")}
    found = {k: v for k, v in found.items() if v}
    answer(as_json, found, lambda: (f"{k} {v}" for k, v in found.items()))


def _version(package: str) -> str:
    with contextlib.suppress(ModuleNotFoundError):
        return package_version(package)
    return ""


for module in (model, profile, results, scaling, study, writing):
    app.add_typer(module.verbs)


def main() -> None:
    """Run the command line; its exit codes are those of ``options.EXIT``."""
    if in_mpi():
        end_with_parent()  # the launcher's proxy
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # terminals that know few letters
    with interrupts.raised():
        try:
            app()
        except SystemExit as stop:
            if type(sys.stdout).__name__ == "PacifyFlushWrapper":
                drop_rest()
                sys.exit(0)  # so typer leaves a reader that has seen enough, as head; with 1
            try:
                sys.stdout.flush()
            except BrokenPipeError:
                drop_rest()
            except OSError as error:
                drop_rest()
                fail(*told(error))
            raise stop
        except interrupts.Interrupted as stop:
            fail(130, str(stop))
        except Alone as error:
            end(str(error), 3)
        except Exception as error:
            drop_rest()
            fail(*told(error))


def drop_rest() -> None:
    """Drop what stdout cannot take: Python 3.14 would try again at the end, and exit with 120."""
    stdout = sys.__stdout__  # typer may have put a wrapper that says nothing in its place
    if stdout is None:
        return
    try:
        stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), stdout.fileno())
