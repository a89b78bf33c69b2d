# SPDX-License-Identifier: LGPL-3.0-or-later
"""Verbs of studies: study, studies."""

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from workflow.cli.options import EXIT, Changes, Json, examples, in_mpi, parsed
from workflow.scene.scene import SceneError

verbs = typer.Typer()


@verbs.command(epilog=examples("squealx studies", "squealx studies --json"))
def studies(as_json: Json = False) -> None:
    """List the built-in studies with their size and usual time."""
    from workflow.study.study import load, names

    listed = {name: load(name) for name in names()}
    if as_json:
        print(json.dumps({n: {"title": s.title, "about": s.about} for n, s in listed.items()}))
        return
    from rich.console import Console
    from rich.table import Table

    table = Table("study", "what it compares", "size and time on two cores")
    for name, study in listed.items():
        table.add_row(name, study.title, study.about)
    Console().print(table)


@verbs.command(
    epilog=examples(
        "squealx study error-vs-runtime --cores 1",
        "squealx study angle-of-attack --set mesh.size=0.008 --out runs/coarse-angles",
        "squealx study my-study.toml --profile my-cluster",
        "squealx study mesh-convergence --dry-run",
        EXIT + " Started again, a study does only what is missing.",
    )
)
def study(
    study: Annotated[str, typer.Argument(help="Name of a built-in study, or path of a TOML file.")],
    changes: Changes = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder, new or to go on in; runs/NAME if left out.")
    ] = None,
    cores: Annotated[
        int | None, typer.Option(min=1, help="Cores to use at once; all of them if left out.")
    ] = None,
    profile: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Snakemake profile, e.g. of a cluster.")
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Check all and list the runs; write nothing.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Run all scenes of a study side by side, then compare: a table and figures."""
    if in_mpi():
        raise SceneError("study: expected to be started without mpiexec; its runs have ranks")
    from workflow.study import folder as study_folder
    from workflow.study import jobs
    from workflow.study.study import load, runs_of

    asked = load(study)
    runs = runs_of(asked, parsed(changes))
    folder = out or Path("runs") / asked.name
    study_folder.check(runs, folder)
    if dry_run:
        _list(runs, folder, as_json)
        return
    jobs.check(runs, cores, profile)
    failed = jobs.work(asked, runs, folder, cores, profile)
    _compare(asked.title, folder, as_json)
    if failed:
        from workflow.simulation.guards import GuardError

        why = (f"{name}: {study_folder.reason(folder, name)}" for name in failed)
        raise GuardError("\n  ".join((f"{len(failed)} of {len(runs)} runs did not finish", *why)))


def _list(runs: Any, folder: Path, as_json: bool) -> None:
    """Print the runs, their parameters and how far they are."""
    from workflow.study.folder import state

    listed = [
        {"run": r.name, "scene": r.scene.name, "ranks": r.ranks, "state": state(folder, r.name)}
        | {"changes": r.changes}
        for r in runs
    ]
    if as_json:
        print(json.dumps({"folder": str(folder), "runs": listed}))
        return
    from rich.console import Console
    from rich.table import Table

    table = Table("run", "scene", "ranks", "changes", "state", title=f"in {folder}")
    for row in listed:
        keys = "\n".join(f"{key} = {value}" for key, value in row["changes"].items())
        table.add_row(row["run"], row["scene"], str(row["ranks"]), keys, row["state"])
    Console().print(table)


def _compare(title: str, folder: Path, as_json: bool) -> None:
    """Write table.csv and the figures of a study; print what they say."""
    from rich.console import Console

    from workflow.results.folder import strict
    from workflow.study import table
    from workflow.study.figures import draw

    rows = table.rows(folder)
    paths = [table.write(rows, folder / "table.csv"), *draw(folder, rows)]
    if as_json:
        found = {"folder": str(folder), "runs": rows, "fronts": table.verdicts(rows)}
        print(json.dumps(strict(found | {"files": list(map(str, paths))})))
        return
    table.show(rows, f"{title} → {folder}", Console())
    print("\n".join(map(str, paths)))
