# SPDX-License-Identifier: LGPL-3.0-or-later
"""Comparison of two runs: settings that differ, cost, answers, history and contact side by side."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from meshes.arrays import Array
from workflow.figures import style
from workflow.report.page import read_summary
from workflow.report.tables import number
from workflow.results.record import Record
from workflow.results.table import Column, Table
from workflow.scene.keys import flat
from workflow.scene.scene import SceneError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from workflow.results.patch_nodes import PatchNodes

NAMES = {"name", "title", "about"}  # keys of a scene that change nothing of the run
COST = ("cells", "steps", "dt", "ranks", "wall_seconds", "processor_seconds")
QUANTITIES: dict[str, Callable[["PatchNodes"], float]] = {
    "normal force [N]": lambda p: p.normal_force,
    "area [m²]": lambda p: p.area,
    "largest pressure [Pa]": lambda p: float(p.pressure.max()),
    "mean longitudinal shear [Pa]": lambda p: p.longitudinal_shear,
    "mean lateral shear [Pa]": lambda p: p.lateral_shear,
}
LINES = ("-", "--")
PARTS = (("normal_force", "kN", 1e-3), ("area", "mm²", 1e6))


def settings(a: Record, b: Record) -> list[dict[str, Any]]:
    """Return the keys whose values differ; None where a scene does not have the key."""
    scenes = [dict(flat(record.checked.tables(), lists=True)) for record in (a, b)]
    keys = [key for key in dict.fromkeys([*scenes[0], *scenes[1]]) if key not in NAMES]
    rows = [{"key": key, "a": scenes[0].get(key), "b": scenes[1].get(key)} for key in keys]
    return [row for row in rows if row["a"] != row["b"]]


def cost(a: Record, b: Record) -> list[dict[str, Any]]:
    """Return cells, steps and times of both runs, with the ratio of the second to the first."""
    first, second = read_summary(a.folder), read_summary(b.folder)
    return [_pair(key, first.get(key), second.get(key)) for key in COST]


def _pair(quantity: str, a: float | None, b: float | None) -> dict[str, Any]:
    return {"quantity": quantity, "a": a, "b": b, "ratio": b / a if a and b is not None else None}


def expected(a: Record, b: Record) -> list[dict[str, Any]]:
    """Return what theory expects of both runs and their errors; quantities that both have."""
    entries = [
        {e["quantity"]: e for e in read_summary(r.folder).get("expected", ())} for r in (a, b)
    ]
    return [
        {"quantity": name, "unit": entry["unit"], "a": entry["error"], "b": other["error"]}
        for name, entry in entries[0].items()
        if (other := entries[1].get(name)) is not None
    ]


def history(a: Record, b: Record) -> list[dict[str, Any]]:
    """Return how far apart the columns of both histories are over the time that both have.

    Between outputs the second run is interpolated. The difference is over the largest value of
    the first; columns that both have and that are not zero throughout.
    """
    t = a.history.get("t", np.zeros(0))
    u = b.history.get("t", np.zeros(0))
    if not len(t) or not len(u):
        return []
    common = t[(t >= u[0]) & (t <= u[-1])]
    rows = []
    for name, column in a.history.items():
        other = b.history.get(name)
        if name == "t" or other is None or column.ndim > 1 or not len(common):
            continue
        first = np.interp(common, t, column)
        second = np.interp(common, u, other)
        size = float(np.max(np.abs(first)))
        if size or np.any(second):
            rows.append(
                {
                    "quantity": name,
                    "a": float(first[-1]),
                    "b": float(second[-1]),
                    "largest": float(np.max(np.abs(second - first))) / size if size else None,
                    "rms": float(np.sqrt(np.mean((second - first) ** 2))) / size if size else None,
                }
            )
    return rows


def patches(a: Record, b: Record) -> list[dict[str, Any]]:
    """Return means of the patches of wheel on rail over the outputs at which both runs have them.

    Outputs of both that are within a thousandth of their interval are the same.
    """
    rows = []
    for name, contact in a.contacts.items():
        other = b.contacts.get(name)
        if other is None or not a.wheel_on_rail or not b.wheel_on_rail:
            continue
        pairs = _same_times(contact.t, other.t)
        for place in (1, 2):
            both = [
                (contact.patches[i][place], other.patches[j][place])
                for i, j in pairs
                if place in contact.patches[i] and place in other.patches[j]
            ]
            for quantity, of in QUANTITIES.items() if both else ():
                means = [float(np.mean([of(pair[k]) for pair in both])) for k in (0, 1)]
                label = f"{name} patch {place}: {quantity}"
                rows.append(_pair(label, *means) | {"outputs": len(both)})
    return rows


def _same_times(t: Array, u: Array) -> list[tuple[int, int]]:
    """Return the numbers of outputs that two runs have in common."""
    if not len(t) or not len(u):
        return []
    near = np.abs(t[:, None] - u[None, :]).argmin(axis=1)
    step = np.min(np.diff(t)) if len(t) > 1 else abs(t[0]) + 1e-300
    return [(i, int(j)) for i, j in enumerate(near) if abs(u[j] - t[i]) <= 1e-3 * step]


def compare(a: Record, b: Record) -> dict[str, Any]:
    """Return all that two runs differ in, by kind, as JSON has it."""
    return {
        "a": str(a.folder),
        "b": str(b.folder),
        "settings": settings(a, b),
        "cost": cost(a, b),
        "expected": expected(a, b),
        "patches": patches(a, b),
        "history": history(a, b),
    }


def tables(found: Mapping[str, Any]) -> list[Table]:
    """Return the tables of a comparison; those without a row are left out."""
    first, second = _labels(found["a"], found["b"])

    def values(show: str | Callable[[float], str]) -> list[Column]:
        return [Column(first, "a", show), Column(second, "b", show)]

    words = [
        Column(first, lambda row: _setting(row["a"]), words=True),
        Column(second, lambda row: _setting(row["b"]), words=True),
    ]
    ratio = Column("ratio", lambda row: "" if row["ratio"] is None else f"{row['ratio']:.3f}")
    heads = {
        "settings": ("key", "key", words),
        "cost": ("cost", "quantity", [*values(_value), ratio]),
        "expected": ("error against theory", "quantity", values("+.2%")),
        "patches": (
            "mean over outputs of both",
            "quantity",
            [*values(_value), ratio, Column("outputs", "outputs")],
        ),
        "history": (
            "last time of both",
            "quantity",
            [*values(_value), Column("largest", "largest", ".1e"), Column("rms", "rms", ".1e")],
        ),
    }
    notes = {"history": "largest and rms: of the difference at all times, over the largest value"}
    return [
        Table("", [Column(head, key, words=True), *columns], found[kind], notes.get(kind, ""))
        for kind, (head, key, columns) in heads.items()
        if found[kind]
    ]


def _labels(a: str, b: str) -> tuple[str, str]:
    """Return the names of two folders, or their paths where the names are the same."""
    names = Path(a).name, Path(b).name
    return names if names[0] != names[1] else (a, b)


def _setting(value: Any) -> str:
    return "–" if value is None else str(value)


def _value(value: float) -> str:
    return number(value, 5)


def overlay(a: Record, b: Record) -> "Figure":
    """Normal force and area of each contact, and the error of the balance, of two runs.

    Full lines are the first run, dashed ones the second.
    """
    names = [name for name in a.scene.get("contacts", {}) if name in b.scene.get("contacts", {})]
    columns = {
        f"{name}_{part}": (f"{name}: {part.replace('_', ' ')}", unit, factor)
        for name in names
        for part, unit, factor in PARTS
    }
    columns["balance_error"] = ("error of the energy balance", "–", 1.0)
    fig = style.figure(style.PAGE, 1.9 * len(columns))
    panels = fig.subplots(len(columns), 1, sharex=True, squeeze=False)[:, 0]
    times = np.concatenate([r.history.get("t", np.zeros(0)) for r in (a, b)])
    scale, unit = style.prefixed(times, "s")
    labels = _labels(str(a.folder), str(b.folder))
    for axes, (column, (title, of, factor)) in zip(panels, columns.items(), strict=True):
        for k, run in enumerate((a, b)):
            if column in run.history:
                t, y = run.history["t"] * scale, run.history[column] * factor
                axes.plot(t, y, LINES[k], color=style.PATCH[k + 1], label=labels[k])
        axes.set_title(title)
        axes.set_ylabel(f"[{of}]")
    panels[-1].set_xlabel(f"time [{unit}]")
    panels[0].legend(loc="best")
    return fig


def write(a: Record, b: Record, path: Path) -> Path:
    """Draw the figure of two runs into a file and return its path.

    Raises:
        SceneError: if the name ends in no kind of picture, or the file cannot be written.
    """
    with style.style():
        try:
            return style.save(overlay(a, b), path)
        except (OSError, ValueError) as error:
            raise SceneError(f"--figure {str(path)!r}: expected a .png to write: {error}") from None
