# SPDX-License-Identifier: LGPL-3.0-or-later
"""The verb that runs the stability matrix."""

import json
from pathlib import Path
from typing import Annotated

import typer

from workflow.command import Json, examples, in_mpi
from workflow.scene import SceneError

verbs = typer.Typer()


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

    from workflow.figures_stability import draw
    from workflow.results import check_free
    from workflow.stability_limits import limits
    from workflow.stability_matrix import counts, matrix

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
        from workflow.guards import GuardError

        bad = [row["key"] for row in rows if row["kind"] == "unseen"]
        raise GuardError(f"no guard saw what became of {'; '.join(bad)}")
