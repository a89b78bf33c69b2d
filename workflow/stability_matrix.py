# SPDX-License-Identifier: LGPL-3.0-or-later
"""Run the stability matrix on a few processes, keep every verdict, go on where it was left."""

import csv
import json
import multiprocessing
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

from workflow.stability import Case, cases
from workflow.stability_run import judge, row

WORKERS = 2
SLOW = ("roll", "drift", "load")  # bases of thousands of cells
KINDS = ("accurate", "wrong", "refused", "caught", "unseen")
COLUMNS = (
    "panel", "x", "y", "kind", "measure", "value", "steps", "step_over_bound", "seconds", "message"
)  # fmt: skip


def matrix(
    out: Path, *, quick: bool = False, workers: int = WORKERS, log: Callable[[str], Any]
) -> list[dict[str, Any]]:
    """Run all cases that the folder has no verdict of yet; return the rows of all.

    Every verdict is written to ``cells.jsonl`` as it comes; ``cells.csv`` holds them in order.

    Args:
        out: Folder, made if missing.
        quick: A part of the cases.
        workers: Processes.
        log: Called with a line of progress.
    """
    out.mkdir(parents=True, exist_ok=True)
    file = out / "cells.jsonl"
    known = {r["key"]: r for r in read(file)}
    wanted = cases(quick)
    due = [case for case in wanted if case.key not in known]
    due.sort(key=lambda case: case.base in SLOW)  # most verdicts first
    log(f"{len(wanted)} cells, {len(wanted) - len(due)} of them known")
    began = time.perf_counter()
    with file.open("a", encoding="utf-8") as keep:
        for done, one in enumerate(judged(due, workers), 1):
            keep.write(json.dumps(one) + "\n")
            keep.flush()
            known[one["key"]] = one
            left = (time.perf_counter() - began) / done * (len(due) - done)
            value = f" {one['measure']} {one['value']:.2g}" if one["measure"] else ""
            log(f"{done}/{len(due)}, {left:.0f} s left: {one['key']}: {one['kind']}{value}")
    rows = [known[case.key] for case in wanted]
    with (out / "cells.csv").open("w", encoding="utf-8", newline="") as table:
        writer = csv.DictWriter(table, COLUMNS, extrasaction="ignore")
        writer.writeheader()
        writer.writerows(rows)
    return rows


def judged(due: Iterable[Case], workers: int) -> Iterator[dict[str, Any]]:
    """Yield the rows of cases as they are done; in this process with one worker."""
    if workers == 1:
        yield from map(judged_row, due)
        return
    # MPI does not survive a fork, so workers start afresh
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, mp_context=spawn) as pool:
        for future in as_completed([pool.submit(judged_row, case) for case in due]):
            yield future.result()


def judged_row(case: Case) -> dict[str, Any]:
    """Return the row of a case after running it."""
    return row(case, judge(case))


def read(file: Path) -> list[dict[str, Any]]:
    """Return the rows of a file of verdicts; a line cut short by a stop is left out."""
    rows = []
    for line in file.read_text("utf-8").splitlines() if file.is_file() else ():
        try:
            rows.append(json.loads(line))
        except json.JSONDecodeError:
            continue
    return rows


def counts(rows: Iterable[dict[str, Any]]) -> dict[str, int]:
    """Return how many cells got each verdict."""
    kinds = [r["kind"] for r in rows]
    return {kind: kinds.count(kind) for kind in KINDS}
