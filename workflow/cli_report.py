# SPDX-License-Identifier: LGPL-3.0-or-later
"""The verb that writes a run as one page."""

import json
from pathlib import Path
from typing import Annotated

import typer

from workflow.command import Json, examples

verbs = typer.Typer()


@verbs.command(epilog=examples("squealx report runs/bar-impact"))
def report(
    folder: Annotated[Path, typer.Argument(help="Result folder of a run.")],
    modes: Annotated[
        Path | None,
        typer.Option(help="Folder of squealx modes to mark in spectra; SCENE-modes beside FOLDER."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Write FOLDER/report.html: settings, results, figures, checks, how to do it again."""
    from workflow.report import report as write

    path = write(folder, modes)
    print(json.dumps({"report": str(path)}) if as_json else path)
