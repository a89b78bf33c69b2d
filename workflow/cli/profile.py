# SPDX-License-Identifier: LGPL-3.0-or-later
"""Verb of a profile file before any scene names it: profile."""

from pathlib import Path
from typing import Annotated, Any, get_args

import typer

from workflow.cli.options import Json, answer, examples
from workflow.scene.mesh import ProfileAxes
from workflow.scene.scene import SceneError

verbs = typer.Typer()


@verbs.command(
    epilog=examples(
        "squealx profile measured.whl",
        "squealx profile worn.csv --kind rail --smoothing 1e-5",
        "squealx profile left.ban --inner right --out rail.csv",
    )
)
def profile(
    file: Annotated[
        Path, typer.Argument(help="Text, MiniProf (.ban, .whl, .mpt) or SIMPACK (.prr, .prw).")
    ],
    kind: Annotated[
        str | None, typer.Option(help="'wheel' or 'rail'; by the file, else by its width.")
    ] = None,
    unit: Annotated[str, typer.Option(help="'m', 'cm', 'mm' or 'inch'.")] = "auto",
    origin: Annotated[
        str,
        typer.Option(
            help="What lies at lateral 0: 'tape-circle', 'flange-back', 'rail-axis', 'gauge-face'."
        ),
    ] = "auto",
    inner: Annotated[
        str, typer.Option(help="Where flange or gauge side lie: 'left' or 'right'.")
    ] = "auto",
    outward: Annotated[str, typer.Option(help="Where the outside lies: 'up' or 'down'.")] = "auto",
    part: Annotated[
        int | None, typer.Option(min=1, help="Which profile of a file that holds several.")
    ] = None,
    flange_back: Annotated[
        float, typer.Option(metavar="M", help="From the flange back to the tape circle.")
    ] = 0.070,
    gauge_depth: Annotated[
        float, typer.Option(metavar="M", help="The gauge is measured this far below the top.")
    ] = 0.014,
    smoothing: Annotated[
        float, typer.Option(metavar="M", help="Distance (rms) the curve may keep from the points.")
    ] = 0.0,
    out: Annotated[
        Path | None, typer.Option(help="CSV file to write the profile to as understood, in mm.")
    ] = None,
    figure: Annotated[
        Path | None, typer.Option(help="Figure to write; runs/profile-FILE.png if left out.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Show what is understood of a profile file: axes, unit, shape, corners, resolution."""
    asked = {"unit": unit, "origin": origin, "inner": inner, "outward": outward}
    for name, value in asked.items():
        _check(name, value, ProfileAxes.model_fields[name].annotation)
    if kind not in (None, "wheel", "rail"):
        raise SceneError(f"--kind {kind!r}: expected 'wheel' or 'rail'")
    lengths = {"flange-back": flange_back, "gauge-depth": gauge_depth, "smoothing": smoothing}
    for name, length in lengths.items():
        if not 0 <= length < 1:
            raise SceneError(f"--{name} {length}: expected a length in m, 0 to 1")
    from workflow.audit import profile as report
    from workflow.audit.profile_figure import draw

    axes = report.axes(asked, part, flange_back, gauge_depth)
    found = report.reading(file, kind, axes, smoothing)  # type: ignore[arg-type]
    told = report.summary(found, axes)
    if out is not None:
        told["out"] = str(report.write(found, out))
    told["figure"] = str(draw(found, axes, figure or Path("runs") / f"profile-{file.stem}.png"))
    paths = [told[key] for key in ("out", "figure") if key in told]
    answer(as_json, told, lambda: [*report.printout(told), *paths])


def _check(name: str, value: str, choices: Any) -> None:
    """Refuse a word that is none of the choices of a scene's key."""
    if value not in get_args(choices):
        expected = ", ".join(map(repr, get_args(choices)))
        raise SceneError(f"--{name} {value!r}: expected one of {expected}")
