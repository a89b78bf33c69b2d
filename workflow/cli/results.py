# SPDX-License-Identifier: LGPL-3.0-or-later
"""Verbs that draw, tell or measure: figures, report, bench."""

import json
from pathlib import Path
from typing import Annotated

import typer

from workflow.cli.options import Json, examples, in_mpi
from workflow.scene.scene import SceneError

verbs = typer.Typer()

ResultFolder = Annotated[Path, typer.Argument(help="Result folder of a run.")]
ModesFolder = Annotated[
    Path | None,
    typer.Option(help="Folder of squealx modes to mark in spectra; SCENE-modes beside FOLDER."),
]


@verbs.command(
    epilog=examples(
        "squealx figures runs/bar-impact",
        "squealx figures runs/steady-curving --modes runs/flange-transition-modes",
    )
)
def figures(folder: ResultFolder, modes: ModesFolder = None, as_json: Json = False) -> None:
    """Draw the figures of a run into its folder figures/."""
    if not (folder / "results.h5").is_file():
        raise SceneError(f"folder = {str(folder)!r}: expected a result folder with results.h5")
    if modes is not None and not (modes / "modes.json").is_file():
        raise SceneError(f"--modes {str(modes)!r}: expected a folder of squealx modes")
    from workflow.figures.gallery import draw

    paths = draw(folder, modes)
    if as_json:
        print(json.dumps({"figures": [str(p) for p in paths]}))
    else:
        print("\n".join(map(str, paths)))


@verbs.command(epilog=examples("squealx report runs/bar-impact"))
def report(folder: ResultFolder, modes: ModesFolder = None, as_json: Json = False) -> None:
    """Write FOLDER/report.html: settings, results, figures, checks, how to do it again."""
    from workflow.report.page import report as write

    path = write(folder, modes)
    print(json.dumps({"report": str(path)}) if as_json else path)


@verbs.command(epilog=examples("squealx bench --quick", "squealx bench --out runs/bench --json"))
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

    from workflow.bench.speed import measure, show
    from workflow.results.folder import check_free

    check_free(out)
    progress = Console(stderr=True)
    found = measure(out, quick, lambda line: progress.print(line, highlight=False))
    print(json.dumps(found)) if as_json else show(found, Console())


@verbs.command(
    epilog=examples("squealx stability --quick", "squealx stability --out runs/stability --json")
)
def stability(
    out: Annotated[
        Path, typer.Option(help="Folder of verdicts and figure; cells that are there are kept.")
    ] = Path("runs/stability"),
    quick: Annotated[bool, typer.Option("--quick", help="A part of the cells.")] = False,
    workers: Annotated[int, typer.Option(min=1, help="Processes that share the cells.")] = 2,
    as_json: Json = False,
) -> None:
    """Run stiff and extreme cases: a verdict for every cell, limits found against the audit's."""
    if in_mpi():
        raise SceneError("stability: expected to be started without mpiexec; its cells are serial")
    from rich.console import Console

    from workflow.results.folder import check_free
    from workflow.stability.figure import draw
    from workflow.stability.limits import limits
    from workflow.stability.run import counts, matrix

    check_free(out, resume=True)  # cells that are there are gone on from
    progress = Console(stderr=True)

    def log(line: str) -> None:
        progress.print(line, highlight=False, soft_wrap=True)

    rows = matrix(out, quick=quick, workers=workers, log=log)
    table = limits(out, quick=quick, log=log)
    path = draw(rows, table, out / "stability.png")
    told = counts(rows)
    if as_json:
        print(json.dumps({"verdicts": told, "limits": table, "figure": str(path)}))
    else:
        print(", ".join(f"{number} {kind}" for kind, number in told.items()))
        print(path)
    if told["unseen"]:
        from workflow.simulation.guards import GuardError

        bad = [row["key"] for row in rows if row["kind"] == "unseen"]
        raise GuardError(f"no guard saw what became of {'; '.join(bad)}")
