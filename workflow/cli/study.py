# SPDX-License-Identifier: LGPL-3.0-or-later
"""Verbs of studies: study, studies."""

from pathlib import Path
from typing import Annotated, Any

import typer

from workflow.cli.options import EXIT, Changes, Json, answer, catalogue, examples, parsed
from workflow.scene.scene import SceneError
from workflow.simulation.ranks import in_mpi

verbs = typer.Typer()


@verbs.command(epilog=examples("squealx studies", "squealx studies --json"))
def studies(as_json: Json = False) -> None:
    """List the built-in studies with their size and usual time."""
    from workflow.study.study import load, names

    listed = {name: load(name) for name in names()}
    found = {n: {"title": s.title, "about": s.about} for n, s in listed.items()}
    answer(as_json, found, lambda: [catalogue("study", "what it compares", found)])


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
    from workflow.results.table import Column, Table
    from workflow.study.folder import state

    listed = [
        {"run": r.name, "scene": r.scene.name, "ranks": r.ranks, "state": state(folder, r.name)}
        | {"changes": r.changes}
        for r in runs
    ]

    def changes(row: dict[str, Any]) -> str:
        return "\n".join(f"{key} = {value}" for key, value in row["changes"].items())

    columns = [
        Column("run", "run", words=True),
        Column("scene", "scene", words=True),
        Column("ranks", "ranks"),
        Column("changes", changes, words=True),
        Column("state", "state", words=True),
    ]
    found = {"folder": str(folder), "runs": listed}
    answer(as_json, found, lambda: [Table(f"in {folder}", columns, listed)])


def _compare(title: str, folder: Path, as_json: bool) -> None:
    """Write table.csv and the figures of a study; print what they say."""
    from workflow.study import table
    from workflow.study.figures import draw

    rows = table.rows(folder)
    paths = [table.write(rows, folder / "table.csv"), *draw(folder, rows)]
    files = list(map(str, paths))
    found = {"folder": str(folder), "runs": rows, "fronts": table.verdicts(rows), "files": files}
    answer(as_json, found, lambda: [*table.printout(rows, f"{title} → {folder}"), *files])
