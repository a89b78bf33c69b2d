# SPDX-License-Identifier: LGPL-3.0-or-later
"""Table of a study: a row of parameters and results for each run, as CSV and on a terminal."""

import csv
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from workflow.model.residual import last_pass
from workflow.results.record import Record
from workflow.results.table import Column, Table
from workflow.study import folder as study_folder

Row = dict[str, Any]

# what a screen has room for
SHOWN = (
    Column("run", "run", words=True),
    Column("cells", "cells", ".0f"),
    Column("steps", "steps", ".0f"),
    Column("wall", "wall_seconds", ".1f", "s"),
    Column("CPU", "processor_seconds", ".1f", "s"),
    Column("error", "closed_form_error", ".2%"),
    Column("energy error", "balance_error", "+.0e"),
    Column("normal", "normal_force", ".2f", "kN", 1e-3),
    Column("vertical", "vertical_force", ".2f", "kN", 1e-3),
    Column("θ₁", "theta_1", ".0f", "°"),
    Column("θ₂", "theta_2", ".0f", "°"),
)
OF_PATCHES = (
    ("angle", "contact_angle", math.degrees(1.0)),
    ("theta", "shear_angle", math.degrees(1.0)),
    ("mean_shear", "mean_shear", 1.0),
)
TIMES = ("wall_seconds", "processor_seconds")  # the second hardly sees other work on the machine
ALIKE = 0.05  # what times of the same work may differ by


def rows(folder: Path, names: Sequence[str] | None = None) -> list[Row]:
    """Return a row for each run of a study: parameters, then what its results say.

    Args:
        folder: The folder of the study.
        names: The runs to take; all if left out.
    """
    about = json.loads((folder / "study.json").read_text("utf-8"))["runs"]
    return [_row(folder, name, about[name]) for name in (names or about)]


def _row(folder: Path, name: str, about: Mapping[str, Any]) -> Row:
    """Return the row of a run; one that is not done has only parameters and status."""
    row: Row = {"run": name, "group": about["group"], "label": about["label"]}
    row |= {"scene": about["scene"], "ranks": about["ranks"]} | about["changes"]
    row["status"] = study_folder.reason(folder, name)
    if row["status"] != "done":
        return row
    summary, record = study_folder.summary(folder, name), Record(last_pass(folder / "runs" / name))
    row |= dict(_numbers(summary)) | dict(_patches(record))
    row |= summary["passes"][-1] if "passes" in summary else {}
    if answers := summary.get("expected"):
        first = worst_of_patches(answers) if record.wheel_on_rail else answers[0]
        row |= {"closed_form": first["quantity"], "closed_form_error": abs(first["error"])}
    return row


def worst_of_patches(answers: Sequence[Mapping[str, Any]]) -> Mapping[str, Any]:
    """Return the area or peak pressure of a patch that is farthest off, while rolling if it rolls.

    Args:
        answers: What is expected of a wheel on a rail; its first entry if it knows no patches.
    """
    of_patches = [a for a in answers if a["quantity"].endswith((": area", ": peak pressure"))]
    rolling = [a for a in of_patches if " rolling" in a["quantity"]]
    return max(rolling or of_patches or answers[:1], key=lambda a: abs(a["error"]))


def _numbers(summary: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield cost, energies and contact forces of a summary."""
    for key in ("cells", "nodes", "steps", "dt", "dt_bound", *TIMES):
        yield key, summary.get(key, math.nan)
    yield "cell_steps", summary["cells"] * summary["steps"]
    for key, value in (summary["energy"] or {}).items():
        yield (key if key == "balance_error" else f"{key}_energy"), value
    pairs = summary["contacts"]
    for pair, contact in pairs.items():
        before = f"{pair}_" if len(pairs) > 1 else ""
        for key in ("normal_force", "max_penetration", "patches", "area"):
            yield f"{before}{key}", contact[key]
        for axis, value in zip("xyz", contact["tangential_force"], strict=True):
            yield f"{before}tangential_{axis}_force", value


def _patches(record: Record) -> Iterator[tuple[str, float]]:
    """Yield vertical force; contact angle and θ [°], mean shear [Pa] of each patch last seen."""
    if not record.contacts:
        return
    contact = next(iter(record.contacts.values()))
    vertical = np.nansum([contact.series(k, "vertical_force") for k in (1, 2)], axis=0)
    yield "vertical_force", float(vertical[-1])
    if record.wheel_on_rail:
        if contact.two_points.any():
            yield "second_patch_at", float(contact.t[int(np.argmax(contact.two_points))])
        for place in (1, 2):
            for name, quantity, factor in OF_PATCHES:
                seen = factor * contact.series(place, quantity)
                seen = seen[np.isfinite(seen)]
                if len(seen):
                    yield f"{name}_{place}", float(seen[-1])


def write(table: Sequence[Row], path: Path) -> Path:
    """Write the rows as CSV, a column for every key, and return the path."""
    keys = list(dict.fromkeys(key for row in table for key in row))
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, keys)
        writer.writeheader()
        writer.writerows(table)
    return path


def front(table: Sequence[Row], cost: str = "processor_seconds") -> list[Row]:
    """Return the rows that no other beats, cheapest first: the Pareto front of error and cost.

    To beat a row is to be better in one by more than ``ALIKE`` and not worse in the other.
    """
    able = [r for r in table if math.isfinite(r.get("closed_form_error", math.nan))]

    def beats(one: Row, other: Row) -> bool:
        shares = [one[key] / max(other[key], 1e-300) for key in (cost, "closed_form_error")]
        return max(shares) <= 1 and min(shares) < 1 - ALIKE

    best = [row for row in able if not any(beats(other, row) for other in able)]
    return sorted(best, key=lambda row: row[cost])


def grouped(table: Sequence[Row]) -> dict[str, list[Row]]:
    """Return the rows by their group."""
    return {
        g: [r for r in table if r["group"] == g] for g in dict.fromkeys(r["group"] for r in table)
    }


def shipped(row: Row, table: Sequence[Row]) -> bool:
    """Tell whether a run changes no parameter: its scene with its defaults."""
    return not any(key in row for key in parameters(table))


def parameters(table: Sequence[Row]) -> list[str]:
    """Return the dotted keys that some run of the table changes."""
    return list(dict.fromkeys(key for row in table for key in row if "." in key))


def verdicts(table: Sequence[Row], cost: str = "processor_seconds") -> dict[str, str]:
    """Return for each group with closed forms its front, and where the scene as shipped stands."""
    found = {}
    for group, own in grouped(table).items():
        best = front(own, cost)
        if not best:
            continue
        text = ", ".join(row["label"] for row in best)
        for row in (r for r in own if shipped(r, own) and r["status"] == "done"):
            if row in best:
                text += f"; {row['label']} is on it"
            else:
                better = [
                    r
                    for r in own
                    if r.get("closed_form_error", math.inf) <= row["closed_form_error"]
                ]
                rival = min(better, key=lambda r: r[cost])
                text += (
                    f"; {row['label']} is not: {rival['label']} has an error of "
                    f"{rival['closed_form_error']:.2%} for {row['closed_form_error']:.2%} in "
                    f"{rival[cost] / row[cost]:.2f} of the cost"
                )
        found[group] = text
    return found


def printout(table: Sequence[Row], title: str) -> Iterator[str | Table]:
    """Yield the main columns of the rows, those that any of them has, and the fronts."""
    columns = [c for c in SHOWN if any(c.of in row for row in table)]
    if any(c.of == "closed_form_error" for c in columns):
        columns = [c for c in columns if c.unit != "kN"]
    yield Table(title, columns, [row for row in table if row["status"] == "done"])
    yield from (f"{row['run']}: {row['status']}" for row in table if row["status"] != "done")
    for group, text in verdicts(table).items():
        yield f"front{f' of {group}' if group else ''}: {text}"
