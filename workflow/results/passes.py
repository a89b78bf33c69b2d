# SPDX-License-Identifier: LGPL-3.0-or-later
"""Passes over the same steel: the depth profile of each, and the table that tells of all.

A pass leaves ``section.csv``, the cells below one place of the surface in their residual state; the
folder of several passes has ``passes.csv``. Where steel shakes down, what a pass adds to the
plastic strain falls to nothing; where it ratchets, each adds as much as the one before.
"""

import csv
import io
import json
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from meshes.arrays import Array
from workflow.model.residual import passes_in
from workflow.results import atomic
from workflow.results.batch import opened
from workflow.results.shakedown import heaviest
from workflow.results.table import Column, Table
from workflow.scene import Scene

SECTION, PASSES = "section.csv", "passes.csv"
COLUMNS = (
    Column("pass", "pass", ".0f"),
    Column("strain", "section_plastic_strain", ".3f", "%", 100),
    Column("added", "added_plastic_strain", ".1e", "%", 100),
    Column("γxz", "section_shear", ".3f", "%", 100),
    Column("added", "added_section_shear", ".1e", "%", 100),
    Column("work", "plastic_work", ".3g", "J"),
    Column("σx", "residual_stress_xx", ".0f", "MPa", 1e-6),
    Column("σy", "residual_stress_yy", ".0f", "MPa", 1e-6),
)
NOTE = (
    "Equivalent plastic strain, plastic shear γxz and residual stress are the largest below one "
    "place of the surface, and what a pass has added most to a cell there; plastic work is of all"
)
MAP = (
    Column("pass", "pass", ".0f"),
    Column("p₀/k", "pressure_over_k", ".2f"),
    Column("T/N", "traction_coefficient", ".3f"),
    Column("Tγ", "t_gamma", ".3g", "N"),
    Column("largest plastic strain", "largest_plastic_strain", ".3f", "%", 100),
)
MAP_NOTE = (
    "p₀/k is the largest pressure of a patch or a travelling load over the yield stress in shear "
    "of the weaker body, T/N and Tγ (tangential over normal force, wear number) are those of that "
    "patch then"
)
ADDED = {
    "added_plastic_strain": "equivalent_plastic_strain",
    "added_section_shear": "plastic_shear_xz",
}


def write_section(folder: Path, profile: Mapping[str, Array]) -> None:
    """Write the depth profile of a pass; SI units."""
    rows = np.column_stack([*profile.values()]) if profile else np.zeros((0, 0))
    _write(folder / SECTION, [*profile], rows.tolist())


def read_section(folder: Path) -> dict[str, Array]:
    """Return the depth profile of a pass, by column."""
    with (folder / SECTION).open(encoding="utf-8", newline="") as file:
        head, *rows = csv.reader(file)
    return dict(zip(head, np.array(rows, dtype=float).reshape(-1, len(head)).T, strict=True))


def rows_of(folder: Path) -> list[dict[str, Any]]:
    """Return a row for each pass in a folder that is done, with the most it has added anywhere."""
    rows: list[dict[str, Any]] = []
    before: Mapping[str, Array] = {}
    for path in passes_in(folder):
        summary = path / "summary.json"
        if not summary.is_file() or json.loads(summary.read_text("utf-8"))["status"] != "done":
            break
        section = read_section(path)
        row = {"pass": len(rows) + 1} | _row(path, section)
        for name, column in ADDED.items():
            row[name] = _largest({column: section[column] - before.get(column, 0.0)}, column)
        rows.append(row)
        before = section
    return rows


def _row(folder: Path, section: Mapping[str, Array]) -> dict[str, Any]:
    """Return the results of a pass: its largest strain, its work, and what is largest below."""
    with opened(folder / "results.h5") as file:
        history = file["history"]
        largest = [history[n][-1] for n in history if n.endswith("_largest_plastic_strain")]
        lost = history["plastic_dissipation"][:] if "plastic_dissipation" in history else [0.0]
    return {
        "largest_plastic_strain": float(max(largest, default=0.0)),
        **heaviest(folder, Scene.check(tomllib.loads((folder / "scene.toml").read_text("utf-8")))),
        "plastic_work": float(lost[-1] - lost[0]),
        "section_plastic_strain": _largest(section, "equivalent_plastic_strain"),
        "section_shear": _largest(section, "plastic_shear_xz"),
        "residual_stress_xx": _largest(section, "stress_xx"),
        "residual_stress_yy": _largest(section, "stress_yy"),
    }


def _largest(section: Mapping[str, Array], name: str) -> float:
    """Return the value of the largest size in a column, with its sign; 0 if there is none."""
    values = section.get(name, np.zeros(0))
    return float(values[np.abs(values).argmax()]) if len(values) else 0.0


def write_table(folder: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write ``passes.csv``; SI units."""
    head = list(rows[0]) if rows else []
    _write(folder / PASSES, head, [[row[name] for name in head] for row in rows])


def tables(rows: Sequence[Mapping[str, Any]]) -> list[Table]:
    """Return the table of passes, and that of their points on the shakedown map if there are."""
    found = [Table("passes", COLUMNS, rows, NOTE)]
    if any(row.get("pressure_over_k") is not None for row in rows):
        found.append(Table("points on the shakedown map", MAP, rows, MAP_NOTE))
    return found


def _write(path: Path, head: Sequence[str], rows: Sequence[Sequence[Any]]) -> None:
    text = io.StringIO()
    csv.writer(text).writerows([head, *rows])
    atomic.replace(path, text.getvalue().encode())
