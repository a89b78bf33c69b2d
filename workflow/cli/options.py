# SPDX-License-Identifier: LGPL-3.0-or-later
"""What the verbs of the command line share: options, scenes with changes, ranks, ways to end."""

import math
import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from workflow.scene.scene import Scene, SceneError
from workflow.scene.units import takes_text

if TYPE_CHECKING:
    from rich.table import Table

EXIT = "Exit codes: 0 done; 2 bad input; 3 stopped by a guard or a full disk, results kept."

SceneName = Annotated[str, typer.Argument(help="Name of a built-in scene, or path of a TOML file.")]
Changes = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Change a key of the scene, e.g. mesh.size=2e-3 (SI, TOML value); may be repeated.",
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


def in_mpi() -> bool:
    """Tell whether this process was started by mpiexec or srun."""
    return any(k in os.environ for k in ("PMI_RANK", "PMIX_RANK", "OMPI_COMM_WORLD_RANK"))


def on_ranks(
    ranks: int,
    scene: str,
    changes: list[str] | None,
    folder: Path,
    as_json: bool,
    verb: tuple[str, ...] = ("run",),
) -> int:
    """Start this very command under ``mpiexec`` and return its exit code."""
    beside = Path(sys.executable).with_name("mpiexec")
    launcher = str(beside) if beside.exists() else shutil.which("mpiexec")
    if launcher is None:
        raise SceneError(f"--ranks {ranks}: expected mpiexec beside python or on PATH")
    command = [
        launcher,
        "-n",
        str(ranks),
        sys.executable,
        "-m",
        "workflow.cli",
        *verb,
        scene,
    ]
    for change in changes or []:
        command += ["--set", change]
    command += ["--out", str(folder)] + ["--json"] * as_json
    return subprocess.run(command, check=False).returncode


def print_summary(summary: dict[str, Any], folder: Path) -> None:
    """Print the summary table of a run."""
    from rich.console import Console
    from rich.table import Table

    table = Table(title=f"{summary['scene']} → {folder}", show_header=False)
    table.add_row("cells, nodes", f"{summary['cells']}, {summary['nodes']}")
    table.add_row("steps, step", f"{summary['steps']}, {summary['dt'] * 1e9:.1f} ns")
    table.add_row("wall time, ranks", f"{summary['wall_seconds']:.1f} s, {summary['ranks']}")
    rate = summary["element_updates_per_second"]
    table.add_row("element updates", f"{rate / 1e6:.2f} M/s")
    phases = summary["seconds_per_phase"].items()
    table.add_row("seconds per phase", "\n".join(f"{k} {v:.1f}" for k, v in phases))
    for key, value in (summary["energy"] or {}).items():
        table.add_row(key.replace("_", " "), f"{value:.3%}" if "error" in key else f"{value:.4g} J")
    for name, contact in summary["contacts"].items():
        text = f"{contact['normal_force'] / 1e3:.2f} kN in {contact['patches']} patches"
        angles = [f"{math.degrees(angle):.0f}°" for angle in contact["contact_angles"]]
        text += f" at {', '.join(angles)}" if angles else ""
        table.add_row(f"contact {name}", f"{text}, {contact['max_penetration'] * 1e6:.1f} µm deep")
    Console().print(table)
    if summary["expected"]:
        Console().print(expected_table(summary["expected"]))


def expected_table(answers: list[dict[str, Any]]) -> "Table":
    """Return the table of what theory expects of a run."""
    from rich.table import Table

    table = Table("quantity", "unit", title="against theory")
    for name in ("run", "expected", "error"):
        table.add_column(name, justify="right", no_wrap=True)
    for a in answers:
        error = f"{a['error']:+.2%}" if a["expected"] else f"{a['error']:.2g}"
        cells = (f"{a['value']:.5g}", f"{a['expected']:.5g}", error)
        table.add_row(a["quantity"], a["unit"], *cells)
    for source in dict.fromkeys(a["source"] for a in answers):
        table.caption = f"{table.caption}; {source}" if table.caption else source
    return table


def abort() -> None:
    """End all ranks after an unexpected error on this one: the others would wait for ever."""
    import traceback

    from mpi4py import MPI

    traceback.print_exc()
    sys.stderr.flush()
    MPI.COMM_WORLD.Abort(1)


def fail(code: int, message: str) -> None:
    """Print an error once (rank 0) and exit."""
    rank = os.environ.get("PMI_RANK") or os.environ.get("OMPI_COMM_WORLD_RANK") or "0"
    if rank == "0":
        print(f"squealx: {message}", file=sys.stderr)
    sys.exit(code)
