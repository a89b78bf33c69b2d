# SPDX-License-Identifier: LGPL-3.0-or-later
"""Verb of a scene on more ranks than there are: scaling."""

from pathlib import Path
from typing import Annotated

import typer

from workflow.cli.options import Changes, Json, SceneName, answer, examples, load, progress
from workflow.scene.scene import SceneError
from workflow.simulation.ranks import in_mpi

verbs = typer.Typer()


@verbs.command(
    epilog=examples(
        "squealx scaling flange-transition",
        "squealx scaling flange-transition --set mesh.size=0.001 --out runs/scaling",
        "squealx scaling hertz --parts 2,4,8 --latency 5e-6 --bandwidth 1e9 --json",
    )
)
def scaling(
    scene: SceneName,
    parts: Annotated[
        str, typer.Option(metavar="N,N,...", help="Numbers of ranks, of which 1 is always one.")
    ] = "4,16,64,256,1024",
    changes: Changes = None,
    latency: Annotated[float, typer.Option(metavar="S", help="Of a message.")] = 1.5e-6,
    bandwidth: Annotated[float, typer.Option(metavar="B/S", help="Of one rank.")] = 10e9,
    cells: Annotated[
        int | None, typer.Option(min=1, help="Extrapolate to a finer mesh of so many cells.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder for scaling.csv and a figure; none if left out.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Cut a scene into parts and predict its step on as many ranks: where they stop paying."""
    if in_mpi():
        raise SceneError("scaling: expected to be started without mpiexec; it cuts in one process")
    counts = counts_of(parts)
    if not (latency >= 0 and bandwidth > 0):
        raise SceneError(f"--latency {latency}, --bandwidth {bandwidth}: expected positive numbers")
    checked = load(scene, changes)
    if out is not None:
        try:
            out.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise SceneError(f"--out {str(out)!r}: expected a folder, {error.strerror}") from error
    from workflow.bench.scaling import Network, measure, printout, write
    from workflow.bench.scaling_figure import draw

    found = measure(checked, counts, Network(latency, bandwidth), cells, progress())
    files = []
    if out is not None:
        files = [str(write(found, out / "scaling.csv"))]
        files += map(str, draw(found, out / "scaling.png"))
    answer(as_json, found | {"files": files}, lambda: [*printout(found), *files])


def counts_of(text: str) -> list[int]:
    """Return the numbers of ranks in ``--parts``."""
    try:
        counts = [int(word) for word in text.split(",")]
    except ValueError:
        counts = [0]
    if min(counts) < 1:
        raise SceneError(f"--parts {text!r}: expected positive numbers with commas, as in 4,16,64")
    return counts
