# SPDX-License-Identifier: LGPL-3.0-or-later
"""Jobs of a study, done by Snakemake, with a line of progress."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

import rich.console
import rich.progress as bar

from workflow.results.lock import locked
from workflow.scene.scene import SceneError
from workflow.simulation import ranks
from workflow.study import folder as study_folder
from workflow.study.study import Run, Study

POLL = 0.5  # s between looks at the folder
LOG = "snakemake.log"


def check(runs: Sequence[Run], cores: int | None, profile: Path | None) -> None:
    """Refuse what Snakemake could not do.

    Raises:
        SceneError: if it is missing, or if a run has more ranks than there are cores for it.
    """
    if find_spec("snakemake") is None:
        raise SceneError(
            "study: expected Snakemake to be installed: pip install 'squealx[study]' "
            "(--dry-run works without)"
        )
    if profile is not None and not any(profile.glob("config*.yaml")):
        raise SceneError(
            f"--profile {str(profile)!r}: expected the folder of a Snakemake profile with "
            "config.yaml"
        )
    most = cores or ranks.cores()
    if profile is None and (big := [run for run in runs if run.ranks > most]):
        raise SceneError(
            f"run {big[0].name}: ranks = {big[0].ranks}: expected at most {most} cores (--cores), "
            "or the --profile of a cluster"
        )


def command(folder: Path, cores: int | None, profile: Path | None) -> list[str]:
    """Return the call of Snakemake: quiet, and independent runs go on when one fails."""
    words = [sys.executable, "-m", "snakemake", "--directory", str(folder)]
    words += ["--snakefile", str(folder / "Snakefile"), "--keep-going", "--rerun-incomplete"]
    words += ["--rerun-triggers", "mtime", "--scheduler", "greedy", "--quiet", "all"]
    words += ["--nolock"]  # the study has a lock of its own, which a killed process does not leave
    if profile is not None:
        words += ["--profile", str(profile.absolute())]
    if profile is None or cores is not None:
        words += ["--cores", str(cores or ranks.cores())]
    return words


def work(
    study: Study,
    runs: Sequence[Run],
    folder: Path,
    cores: int | None = None,
    profile: Path | None = None,
    quiet: bool = False,
) -> list[str]:
    """Do what is missing of a study and return the names of the runs that did not finish.

    Args:
        study: The study.
        runs: All its runs.
        folder: Its folder.
        cores: Cores to use at once; all if left out.
        profile: Snakemake profile of a cluster.
        quiet: No progress on the terminal.

    Raises:
        SceneError: if the folder is in use, or holds runs of other scenes.
        RuntimeError: if Snakemake failed though no run did.
    """
    console = rich.console.Console(stderr=True, quiet=quiet)
    with locked(folder, "squealx study") as lock:
        study_folder.write(study, runs, folder)
        code = _call(command(folder, cores, profile), lock.fileno(), runs, folder, console)
    failed = [run.name for run in runs if not study_folder.done(folder, run.name)]
    undrawn = [n for n in _undrawn(runs, folder) if n not in failed]
    if undrawn:
        console.print(f"without figures: {', '.join(undrawn)}; see {folder / 'logs'}")
    if code and not failed and not undrawn:
        last = (folder / LOG).read_text("utf-8", errors="replace").strip().splitlines()[-1:]
        raise RuntimeError(f"snakemake: {''.join(last) or f'exit code {code}'}")
    return failed


def _call(
    words: list[str], lock: int, runs: Sequence[Run], folder: Path, console: rich.console.Console
) -> int:
    """Call Snakemake, follow it and return its exit code; if this is stopped, so is all of that."""
    began = time.time()
    with (folder / LOG).open("w", encoding="utf-8") as log:
        process = subprocess.Popen(
            words,
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=subprocess.STDOUT,
            pass_fds=(lock,),  # held for as long as Snakemake is alive
            start_new_session=True,  # so that it and its jobs are interrupted once, below
            env=os.environ | ranks.OWN_MODULES,
        )
    try:
        _follow(process, runs, folder, console, began)
    except BaseException:
        # Snakemake alone would wait for its jobs; their checkpoints stay
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGINT)
        process.wait()
        console.print("stopped; the same command goes on from here")
        raise
    return process.returncode


def _undrawn(runs: Sequence[Run], folder: Path) -> list[str]:
    """Return the runs whose figures failed: they have a log of it but no mark that it is done."""
    return [
        run.name
        for run in runs
        if (folder / "logs" / f"{run.name}-figures.log").is_file()
        and not (folder / "runs" / run.name / "figures" / "done").is_file()
    ]


def _follow(
    process: "subprocess.Popen[bytes]",
    runs: Sequence[Run],
    folder: Path,
    console: rich.console.Console,
    began: float,
) -> None:
    """Show how far the runs are until Snakemake ends; a line for each run that ends."""
    before = {run.name for run in runs if study_folder.done(folder, run.name)}
    left = [run.name for run in runs if run.name not in before]
    console.print(
        f"{len(runs)} runs, {len(before)} done before, {len(left)} to do; results in {folder}",
        highlight=False,
        soft_wrap=True,
    )
    columns = bar.TextColumn("{task.completed:.1f} of {task.total:.0f} runs"), bar.BarColumn()
    after = bar.TimeElapsedColumn(), bar.TimeRemainingColumn(elapsed_when_finished=True)
    active = bar.TextColumn("{task.fields[active]}")
    told: set[str] = set()
    with bar.Progress(*columns, *after, active, console=console, auto_refresh=False) as line:
        task = line.add_task("", total=len(left), active="", visible=bool(left))
        while True:
            ended = process.poll() is not None
            shares = {name: study_folder.share(folder, name) for name in left}
            for name in left:
                if name not in told and (word := _ended(folder, name, began)):
                    told.add(name)
                    line.console.print(f"{name}: {word}", highlight=False, soft_wrap=True)
            going = [f"{n} {s:.0%}" for n, s in shares.items() if 0 < s < 1 and n not in told]
            whole = sum(1.0 if n in told else s for n, s in shares.items())
            words = ", ".join(going[:3]) or ("figures" if whole == len(left) else "")
            line.update(task, completed=whole, active=words, refresh=True)
            if ended:
                return
            time.sleep(POLL)


def _ended(folder: Path, name: str, began: float) -> str:
    """Return in words how a run ended since the study began, empty while it goes on."""
    path = folder / "runs" / name / "summary.json"
    if not path.is_file() or path.stat().st_mtime < began:
        return ""
    if study_folder.done(folder, name):
        return f"done in {study_folder.summary(folder, name)['wall_seconds']:.1f} s"
    word = study_folder.state(folder, name)
    return "" if word in ("begun", "to do") else word
