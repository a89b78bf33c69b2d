# SPDX-License-Identifier: LGPL-3.0-or-later
"""Verbs of results and of the machine: figures, view, report, compare, bench and others."""

from pathlib import Path
from typing import Annotated

import typer

from workflow.cli.options import Json, answer, examples, progress
from workflow.scene.scene import SceneError
from workflow.simulation.ranks import in_mpi

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
    if modes is not None and not (modes / "modes.json").is_file():
        raise SceneError(f"--modes {str(modes)!r}: expected a folder of squealx modes")
    from workflow.figures.gallery import draw

    paths = draw(folder, modes)
    drawn = [str(path) for path in paths]
    answer(as_json, {"figures": drawn}, lambda: drawn)


@verbs.command(
    epilog=examples(
        "squealx view runs/hertz --close",
        "squealx view runs/bar-wave --scale 1000 --quantity velocity",
        "squealx view runs/first --pictures first-pictures",
    )
)
def view(
    folder: ResultFolder,
    quantity: Annotated[
        str, typer.Option(help="What colours the bodies: displacement or velocity.")
    ] = "displacement",
    scale: Annotated[
        float, typer.Option(min=0.0, help="Factor on deformations; a turning body turns as it is.")
    ] = 1.0,
    close: Annotated[
        bool, typer.Option("--close", help="Look at the contact, through the contactor.")
    ] = False,
    pictures: Annotated[
        Path | None,
        typer.Option(help="Draw a picture for each output into this folder, without a window."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Look at a run: the mesh as it moves and the footprints, in a window with a slider."""
    from workflow.figures.view import QUANTITIES, View, open_window, write_pictures
    from workflow.results.record import whole

    if quantity not in QUANTITIES:
        raise SceneError(f"--quantity {quantity!r}: expected one of {', '.join(QUANTITIES)}")
    shown = View(whole(folder), quantity, scale, close)
    if pictures is None:
        return open_window(shown)
    paths = [str(path) for path in write_pictures(shown, pictures)]
    answer(as_json, {"pictures": paths}, lambda: paths)


@verbs.command(epilog=examples("squealx report runs/bar-impact"))
def report(folder: ResultFolder, modes: ModesFolder = None, as_json: Json = False) -> None:
    """Write FOLDER/report.html: settings, results, figures, checks, how to do it again."""
    from workflow.report.page import report as write

    path = str(write(folder, modes))
    answer(as_json, {"report": path}, lambda: [path])


@verbs.command(
    epilog=examples(
        "squealx compare runs/hertz runs/finer",
        "squealx compare runs/full runs/one-point --figure both.png --json",
    )
)
def compare(
    first: ResultFolder,
    second: Annotated[Path, typer.Argument(help="Result folder of another run.")],
    figure: Annotated[
        Path | None,
        typer.Option(help="Picture; FIRST/figures/compared-with-SECOND.png if left out."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Set two runs side by side: settings, cost, errors, patches, history; tables and a picture."""
    from workflow.report.comparison import compare as compared
    from workflow.report.comparison import tables, write
    from workflow.results.record import whole

    a, b = whole(first), whole(second)
    picture = figure or first / "figures" / f"compared-with-{second.resolve().name}.png"
    found = compared(a, b) | {"figure": str(write(a, b, picture))}
    answer(as_json, found, lambda: [*tables(found), found["figure"]])


@verbs.command(
    epilog=examples(
        "squealx growth runs/steady-curving --from 0.004 --to 3000",
        "squealx growth runs/first --until 0.01 --json",
    )
)
def growth(
    folder: ResultFolder,
    begin: Annotated[
        float | None, typer.Option("--from", metavar="S", help="Start of the window.")
    ] = None,
    end: Annotated[
        float | None, typer.Option("--until", metavar="S", help="End of the window.")
    ] = None,
    to: Annotated[
        float | None,
        typer.Option(metavar="HZ", help="Highest frequency; a fifth of the sampling rate."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Find what oscillates in a run's samples, how fast it grows, and limit cycles; a figure.

    Probes and contact forces are taken together (a matrix pencil); needs output.sample_interval.
    """
    from workflow.results.record import whole
    from workflow.squeal.figures import draw_in_time
    from workflow.squeal.in_time import in_time, printout, window

    whole(folder)
    seen = window(folder, begin, end, to)
    found = in_time(seen)
    picture = draw_in_time(seen, found)
    found |= {"figure": None if picture is None else str(picture)}
    answer(as_json, found, lambda: [*printout(found), *([str(picture)] if picture else [])])


@verbs.command(
    epilog=examples(
        "squealx export-footprints runs/hertz",
        "squealx export-footprints runs/first --csv --out first-footprints",
    )
)
def export_footprints(
    folder: ResultFolder,
    out: Annotated[
        Path | None, typer.Option(help="Folder of the files; FOLDER/footprints if left out.")
    ] = None,
    csv: Annotated[
        bool, typer.Option("--csv", help="A table of nodes for each output too.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Write the contact of both bodies over time for ParaView and pyvista: footprints.pvd.

    Facets round the nodes in contact, where they are, with pressure, shear, slip velocity, stick,
    patch, friction power and area of the nodes, SI units. On the contactor these are what the
    contact has computed, on the target the reactions as they were shared by its nodes.
    """
    from workflow.results.footprint_files import export
    from workflow.results.record import whole

    whole(folder)
    found = export(folder, out or folder / "footprints", tables=csv)
    answer(as_json, found, lambda: [f"{found['series']}: {found['outputs']} outputs"])


@verbs.command(
    epilog=examples(
        "squealx receptance runs/track-hammer",
        "squealx receptance runs/track-hammer --from 50 --to 3000 --json",
    )
)
def receptance(
    folder: ResultFolder,
    low: Annotated[float, typer.Option("--from", metavar="HZ", help="Lowest frequency.")] = 20.0,
    high: Annotated[float, typer.Option("--to", metavar="HZ", help="Highest frequency.")] = 2e3,
    as_json: Json = False,
) -> None:
    """Displacement over force of a run under a hammer: receptance, damping, decay rate of a track.

    Writes all lines to FOLDER/receptance.csv and draws FOLDER/figures/receptance.png.
    """
    from workflow.figures.receptance import draw
    from workflow.results.receptance import receptance as found_in
    from workflow.results.receptance import summary, tables, write
    from workflow.results.record import whole

    record = whole(folder)
    got = found_in(record, low, high)
    table = write(got, folder / "receptance.csv")
    found = summary(got, low, high) | {"table": str(table), "figure": str(draw(got, record))}
    answer(as_json, found, lambda: [*tables(found), found["table"], found["figure"]])


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
    from workflow.bench.speed import measure, printout
    from workflow.results.folder import check_free

    check_free(out)
    found = measure(out, quick, progress())
    answer(as_json, found, lambda: printout(found))


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
    from workflow.results.folder import kept
    from workflow.stability.figure import draw
    from workflow.stability.limits import limits
    from workflow.stability.run import counts, matrix

    log = progress()
    with kept(out, "squealx stability", resume=True):  # cells that are there are gone on from
        rows = matrix(out, quick=quick, workers=workers, log=log)
        table = limits(out, quick=quick, log=log)
        path = draw(rows, table, out / "stability.png")
    number = counts(rows)
    found = {"verdicts": number, "limits": table, "figure": str(path)}
    line = ", ".join(f"{count} {kind}" for kind, count in number.items())
    answer(as_json, found, lambda: [line, str(path)])
    if number["unseen"]:
        from workflow.simulation.guards import GuardError

        bad = [row["key"] for row in rows if row["kind"] == "unseen"]
        raise GuardError(f"no guard saw what became of {'; '.join(bad)}")
