# SPDX-License-Identifier: LGPL-3.0-or-later
"""The tables of a report: settings, model, patches, events, energies, seconds."""

from collections.abc import Callable
from dataclasses import fields
from functools import partial
from typing import Any

import numpy as np

from workflow.results.batch import opened
from workflow.results.patch_nodes import PatchNodes
from workflow.results.record import Record
from workflow.results.table import PAIRS, Column, Table
from workflow.scene.keys import flat, is_tables
from workflow.scene.scene import Scene
from workflow.scene.units import unit_of
from workflow.simulation.energy import Energy

DEGREES = float(np.degrees(1.0))  # in a radian
ROWS = 150  # of a table of outputs; left out evenly beyond
STEPPING = ("internal_force", "contact", "update", "output")
KNOWN = {
    "scene",
    "version",
    "status",
    "cells",
    "nodes",
    "dofs",
    "ranks",
    "steps",
    "time",
    "dt",
    "dt_bound",
    "wall_seconds",
    "seconds_per_phase",
    "element_updates_per_second",
    "energy",
    "contacts",
    "expected",
}


def number(value: float, digits: int = 4, *, zeros: bool = False) -> str:
    """Return a number as text, with a true minus and powers of ten as one reads them.

    Args:
        value: The number; nothing but a dash is shown if it is not finite.
        digits: Significant digits.
        zeros: Keep zeros at the end, so that columns of numbers line up.
    """
    if value is None or not np.isfinite(value):
        return "–"
    if value == 0:
        return "0"
    text = f"{value:#.{digits}g}" if zeros else f"{value:.{digits}g}"
    mantissa, e, power = text.partition("e")
    mantissa = mantissa.removesuffix(".").replace("-", "−")
    return f"{mantissa}\u202f×\u202f10{_raised(int(power))}" if e else mantissa


def exact(value: float) -> str:
    """Return a number of a scene with all its digits, large and small ones as powers of ten."""
    if value == 0 or 1e-3 <= abs(value) < 1e5:
        return number(value, 12)
    mantissa, _, power = f"{value:.11e}".partition("e")
    mantissa = mantissa.rstrip("0").removesuffix(".").replace("-", "−")
    return f"{mantissa}\u202f×\u202f10{_raised(int(power))}"


def _raised(power: int) -> str:
    return str(power).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))


def thousands(value: float) -> str:
    """Return a whole number with thin spaces between thousands."""
    return f"{int(value):,}".replace(",", "\u202f")


SETTING = tuple(Column(head, k, words=True) for k, head in enumerate(("key", "value", "unit")))


def settings(scene: Scene) -> list[Table]:
    """Return every key of a resolved scene with its unit, one table for each table of the scene."""
    tables = scene.tables()
    groups: dict[str, dict[str, Any]] = {
        "scene": {key: value for key, value in tables.items() if not _nested(value)}
    }
    for key, value in tables.items():
        if not _nested(value):
            continue
        several = isinstance(value, list) or key in ("bodies", "contacts", "driven")
        entries = dict(enumerate(value)) if isinstance(value, list) else value
        groups |= {f"{key}.{n}": table for n, table in entries.items()} if several else {key: value}
    found = []
    for name, table in groups.items():
        above = "" if name == "scene" else f"{name}."
        leaves = [(key, value) for key, value in flat(table, lists=True) if value != {}]
        rows = [(key, _plain(value), _unit(above + key)) for key, value in leaves]
        found.append(Table(name, SETTING, rows))
    return [table for table in found if table.rows]


def _nested(value: Any) -> bool:
    return isinstance(value, dict) or is_tables(value)


def _unit(key: str) -> str:
    """Return the unit of a key of a scene, empty for a pure number."""
    unit = unit_of(Scene, key.split(".")).replace("^2", "²").replace("^3", "³")
    return "" if unit == "-" else unit


def _plain(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return exact(value)
    if isinstance(value, list):
        return ", ".join(_plain(v) for v in value) or "none"
    return str(value).replace("-", "−") if isinstance(value, int) else str(value)


def model_table(record: Record, summary: dict[str, Any]) -> Table:
    """Return what was computed and how fast."""
    seconds = summary.get("seconds_per_phase", {})
    stepping = sum(seconds.get(phase, 0.0) for phase in STEPPING)
    rows: list[tuple[str, ...]] = [
        (label, thousands(summary[key]))
        for key, label in (
            ("cells", "hexahedra"),
            ("nodes", "nodes"),
            ("dofs", "degrees of freedom"),
            ("ranks", "ranks"),
            ("steps", "steps"),
        )
        if key in summary
    ]
    if "dt" in summary:
        dt, bound = summary["dt"], summary["dt_bound"]
        share = f"{dt / bound:.3g} of the bound {number(bound * 1e9)} ns"
        rows.append(("step", f"{number(dt * 1e9)} ns, {share}"))
    if "wall_seconds" in summary:
        rows.append(("wall time", f"{number(summary['wall_seconds'])} s"))
    if stepping and summary.get("steps"):
        rows.append(("steps a second", number(summary["steps"] / stepping)))
        rate = summary["element_updates_per_second"] / 1e6
        rows.append(("element updates a second", f"{number(rate)} million"))
    if "version" in summary:
        rows.append(("squealx", summary["version"]))
    body = record.body
    if body is not None:
        counts = {
            body.names.get(int(r), str(r)): int((body.regions == r).sum())
            for r in np.unique(body.regions)
        }
        each = ", ".join(f"{n.replace('_', ' ')} {thousands(c)}" for n, c in counts.items())
        rows.append(("cells of each region", each))
    return Table("Model and computation", PAIRS, rows)


def other_table(summary: dict[str, Any]) -> Table | None:
    """Return whatever else a run tells in its summary, e.g. memory or laws of the user's own."""
    rows: list[tuple[str, ...]] = [
        (key.replace("_", " "), _plain(value))
        for key, value in flat({k: v for k, v in summary.items() if k not in KNOWN}, lists=True)
        if value != {}
    ]
    return Table("Further", PAIRS, sorted(rows)) if rows else None


def phase_table(summary: dict[str, Any]) -> Table | None:
    """Return the seconds of each phase and its share of all."""
    seconds = summary.get("seconds_per_phase")
    if not seconds:
        return None
    total = sum(seconds.values())
    columns = (
        Column("phase", lambda row: row[0].replace("_", " "), words=True),
        Column("time", 1, ".2f", "s"),
        Column("share", lambda row: row[1] / total if total else "–", ".1f", "%", 100),
    )
    note = "Phases from internal force on are the time loop. Seconds are those of rank 0."
    return Table("Where the time went", columns, list(seconds.items()), note)


ENERGY = (
    Column("term", 0, words=True),
    Column("start", 1, partial(number, digits=6, zeros=True), "J"),
    Column("end", 2, partial(number, digits=6, zeros=True), "J"),
    Column("change", lambda row: row[2] - row[1], partial(number, zeros=True), "J"),
)


def energy_table(record: Record, summary: dict[str, Any]) -> Table | None:
    """Return every term of the ledger at the first and last output."""
    history = record.history
    if not len(history.get("t", ())):
        return None
    own = (summary.get("energy") or {}).keys() - {"balance_error"}
    known = [f.name for f in fields(Energy)]
    terms = [name for name in (*known, *sorted(own - {*known})) if name in history]
    rows = [(k.replace("_", " "), *history[k][[0, -1]]) for k in terms]
    worst = float(np.max(np.abs(history["balance_error"])))
    note = (
        "Dissipations and works are sums since the start. Contact normal and contact tangential "
        "are parts of contact. The largest balance error of all outputs, the change of the sum "
        f"less external work over the largest energy exchanged, is {number(worst, 3)}."
    )
    return Table("Energy ledger", ENERGY, rows, note)


def contact_tables(record: Record) -> list[Table]:
    """Return for each pair a row for each patch and output."""
    return [_contact_table(record, name) for name in record.contacts]


def _contact_table(record: Record, name: str) -> Table:
    contact = record.contacts[name]
    outputs = [
        (t, place, patch)
        for t, patches in zip(contact.t, contact.patches, strict=True)
        for place, patch in patches.items()
    ]
    stride = -(-len(outputs) // ROWS)
    place = "Patch 2 is steeper than 45°. "
    if record.wheel_on_rail:
        place = "Patch 1 lies on the rail top, patch 2 on the gauge corner. "
    note = place + (
        "Contact angle: of the normal resultant to the vertical. θ: from the negative longitudinal "
        "axis to the mean shear on the lower body. Stress: nodal force over tributary area."
    )
    note += f" Every {stride}th row is shown." if stride > 1 else ""
    return Table(f"Contact {name} at each output", PATCH, outputs[::stride], note)


def _of_patch(
    head: str, of: Callable[[PatchNodes], float], show: Any, unit: str = "", factor: float = 1
) -> Column:
    """Return a column of rows (time, place, patch)."""
    return Column(head, lambda row: of(row[2]), show, unit, factor)


def _theta(patch: PatchNodes) -> float:
    """Return the shear angle to a tenth of a degree, NaN without shear."""
    return round(DEGREES * patch.shear_angle, 1) if patch.mean_shear else np.nan


LONG = partial(number, zeros=True)
PATCH = (
    Column("t", 0, ".4f", "ms", 1e3),
    Column("patch", 1),
    _of_patch("normal", lambda p: p.normal_force, LONG, "kN", 1e-3),
    _of_patch("tangential", lambda p: p.tangential_force, LONG, "kN", 1e-3),
    _of_patch("angle", lambda p: p.contact_angle, ".2f", "°", DEGREES),
    _of_patch("area", lambda p: p.area, LONG, "mm²", 1e6),
    _of_patch("nodes", lambda p: len(p.areas), ""),
    _of_patch("adhering", lambda p: int(p.stick.sum()), ""),
    _of_patch("largest pressure", lambda p: p.pressure.max(), LONG, "MPa", 1e-6),
    _of_patch(
        "mean shear", lambda p: p.mean_shear, partial(number, digits=3, zeros=True), "MPa", 1e-6
    ),
    _of_patch("θ", _theta, number, "°"),
)


def event_table(record: Record) -> Table | None:
    """Return births, ends, splits and merges of patches as the run told them."""
    rows: list[tuple[Any, ...]] = []
    with opened(record.folder / "results.h5") as file:
        for name, group in file.get("patches", {}).items():
            events = group.get("events", {})
            if "t" in events:
                columns = (events[k][:] for k in ("t", "patch", "kind", "other"))
                rows += [(name, *row) for row in zip(*columns, strict=True)]
    if not rows:
        return None
    note = (
        "Here patches are counted from 0 in the order of their birth, wherever they lie; one that "
        "is taken up ends."
    )
    return Table("What became of the patches", EVENT, rows[:ROWS], note)


def _became(row: tuple[Any, ...]) -> str:
    """Return in words what became of a patch."""
    kind, other = row[3], row[4]
    word = kind.decode() if isinstance(kind, bytes) else str(kind)
    words = {"split": f"broke off patch {other}", "merge": f"taken up by patch {other}"}
    return words.get(word, word)


EVENT = (
    Column("t", 1, ".4f", "ms", 1e3),
    Column("contact", 0, words=True),
    Column("patch", 2),
    Column("event", _became, words=True),
)
