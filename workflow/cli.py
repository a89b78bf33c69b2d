# SPDX-License-Identifier: LGPL-3.0-or-later
"""The ``squealx`` command."""

import contextlib
import json
import os
from importlib.metadata import version as package_version
from pathlib import Path
from typing import Annotated

import typer

# one thread per rank: the threads of BLAS would fight over the cores of the other ranks
os.environ.setdefault("OMP_NUM_THREADS", "1")

from workflow.command import (
    EXIT,
    Changes,
    Json,
    SceneName,
    abort,
    examples,
    fail,
    in_mpi,
    load,
    on_ranks,
    print_summary,
    scene_of,
)
from workflow.scene import Scene, SceneError, names

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
    if as_json:
        print(json.dumps({n: {"title": s.title, "about": s.about} for n, s in listed.items()}))
        return
    from rich.console import Console
    from rich.table import Table

    table = Table("scene", "what it shows", "size and time on two cores")
    for name, scene in listed.items():
        table.add_row(name, scene.title, scene.about)
    Console().print(table)


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
    ranks: Annotated[int, typer.Option(min=1, help="MPI ranks that share the run.")] = 1,
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
        from workflow.results import check_free

        check_free(folder, resume)
        verb = ("run", "--resume") if resume else ("run",)
        raise typer.Exit(on_ranks(ranks, scene, changes, folder, as_json, verb))
    from mpi4py import MPI

    from workflow.running import run as run_scene

    result = run_scene(checked, folder, resume=resume)
    if MPI.COMM_WORLD.rank == 0:
        print(json.dumps(result.summary)) if as_json else print_summary(result.summary, folder)


@app.command(
    epilog=examples(
        "squealx validate my-scene.toml",
        "squealx validate flange-transition --set rolling.angle_of_attack=0.03",
    )
)
def validate(scene: SceneName, changes: Changes = None, as_json: Json = False) -> None:
    """Check a scene without meshing: an error names the key, what it got and expects."""
    checked = load(scene, changes)
    from workflow.geometry import check_profiles

    check_profiles(checked)
    if as_json:
        print(json.dumps({"scene": checked.name, "valid": True}))
    else:
        print(f"{checked.name}: valid")


@app.command(
    epilog=examples(
        "squealx export hertz hertz.msh",
        "squealx export flange-transition wheel.vtu --set mesh.size=0.002",
    )
)
def export(
    scene: SceneName,
    file: Annotated[
        Path, typer.Argument(help="Mesh file to write: .msh, .vtu, .vtk, .xdmf or .inp.")
    ],
    changes: Changes = None,
    as_json: Json = False,
) -> None:
    """Write the mesh of a scene with its regions and surfaces as named groups."""
    checked = load(scene, changes)
    from workflow import foreign

    told = foreign.export(checked, file)
    print(json.dumps(told) if as_json else foreign.in_words(told))


@app.command(
    epilog=examples(
        "squealx mesh flange-transition",
        "squealx mesh flange-transition --set mesh.size=0.001 --out runs/fine-mesh",
    )
)
def mesh(
    scene: SceneName,
    changes: Changes = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder for mesh.json and mesh.png; runs/mesh-NAME.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Make the mesh of a scene and show its sizes, its shapes and which cells set the step."""
    checked = load(scene, changes)
    from rich.console import Console

    from workflow import mesh_report

    progress = Console(stderr=True)
    found = mesh_report.report(checked, lambda line: progress.print(line, highlight=False))
    folder = out or Path("runs") / f"mesh-{checked.name}"
    paths = mesh_report.write(found, folder)
    if as_json:
        print(json.dumps(mesh_report.summary(found)))
    else:
        mesh_report.show(found, Console())
        print("\n".join(map(str, paths)))


@app.command(
    epilog=examples(
        "squealx modes flange-transition --set bodies.wheelset.element=one-point",
        "squealx modes flange-transition --held free --to 6000 --ranks 2",
        "squealx modes flange-transition --part wheelset --to 2000",
        "squealx modes bar-wave --to 70000",
    )
)
def modes(
    scene: SceneName,
    changes: Changes = None,
    out: Annotated[
        Path | None, typer.Option(help="New folder; runs/NAME-modes if left out.")
    ] = None,
    part: Annotated[
        str | None,
        typer.Option(help="'wheel' (without axle) or a body; the wheel, or the first body."),
    ] = None,
    held: Annotated[
        str | None,
        typer.Option(help="'free', 'bore' (wheel), 'supports' (of the scene) or SURFACE,..."),
    ] = None,
    to: Annotated[float, typer.Option(metavar="HZ", help="Highest frequency.")] = 10e3,
    size: Annotated[
        float, typer.Option(metavar="M", help="Cells of the section of the wheel.")
    ] = 0.026 / 3,
    most: Annotated[int, typer.Option(min=1, help="Refuse to look for more modes.")] = 500,
    ranks: Annotated[int, typer.Option(min=1, help="MPI ranks that share the work.")] = 1,
    as_json: Json = False,
) -> None:
    """Find all natural modes of a wheel or body up to a frequency: table, shapes, figures."""
    checked = load(scene, changes)
    folder = out or Path("runs") / f"{checked.name}-modes"
    if ranks > 1 and not in_mpi():
        from workflow.results import check_free

        check_free(folder)
        words = ["modes", "--to", str(to), "--size", str(size), "--most", str(most)]
        words += [f"--part={part}"] * bool(part) + [f"--held={held}"] * bool(held)
        raise typer.Exit(on_ranks(ranks, scene, changes, folder, as_json, tuple(words)))
    from mpi4py import MPI

    from rich.console import Console

    from workflow.modes import modes as find
    from workflow.modes import show

    root = MPI.COMM_WORLD.rank == 0
    progress = Console(stderr=True, quiet=not root)
    found = find(
        checked, folder, part=part, held=held, top=to, size=size, most=most,
        log=lambda line: progress.print(line, highlight=False),
    )  # fmt: skip
    if not root:
        return
    from workflow.figures_modes import draw

    draw(found, folder)
    print(json.dumps(found.summary)) if as_json else show(found.summary, Console())


@app.command(epilog=examples("squealx figures runs/bar-impact"))
def figures(
    folder: Annotated[Path, typer.Argument(help="Result folder of a run.")], as_json: Json = False
) -> None:
    """Draw the figures of a run into its folder figures/."""
    if not (folder / "results.h5").is_file():
        raise SceneError(f"folder = {str(folder)!r}: expected a result folder with results.h5")
    from workflow.figures import draw

    paths = draw(folder)
    if as_json:
        print(json.dumps({"figures": [str(p) for p in paths]}))
    else:
        print("\n".join(map(str, paths)))


@app.command(epilog=examples("squealx bench --quick", "squealx bench --out runs/bench --json"))
def bench(
    out: Annotated[
        Path, typer.Option(help="Folder for bench.json and bench.png; replaces those there.")
    ] = Path("runs/bench"),
    quick: Annotated[
        bool, typer.Option("--quick", help="Small blocks: rough numbers in seconds.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Measure how fast this machine runs kernels, steps and contact: a table and a figure."""
    if in_mpi():
        raise SceneError("bench: expected to be started without mpiexec; it starts its own ranks")
    from rich.console import Console

    from workflow.bench import measure, show
    from workflow.results import check_free

    check_free(out)
    progress = Console(stderr=True)
    found = measure(out, quick, lambda line: progress.print(line, highlight=False))
    print(json.dumps(found)) if as_json else show(found, Console())


@app.command(epilog=examples("squealx version --json"))
def version(as_json: Json = False) -> None:
    """Print the version of squealx and of what it stands on."""
    found = {p: _version(p) for p in ("squealx", "fenics-dolfinx", "dolfinx-solver-real", "numpy")}
    found = {k: v for k, v in found.items() if v}
    print(json.dumps(found) if as_json else "\n".join(f"{k} {v}" for k, v in found.items()))


def _version(package: str) -> str:
    with contextlib.suppress(ModuleNotFoundError):
        return package_version(package)
    return ""


def main() -> None:
    """Run the command line; bad input exits with 2, a run stopped by a guard with 3."""
    try:
        app()
    except SceneError as error:
        fail(2, str(error))
    except RuntimeError as error:
        from workflow.guards import GuardError

        if isinstance(error, GuardError):
            fail(3, str(error))
        if in_mpi():
            abort()
        raise


if __name__ == "__main__":
    main()
