# SPDX-License-Identifier: LGPL-3.0-or-later
"""The tables of a report: settings, model, patches, events, energies, seconds."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import h5py
import numpy as np

from workflow.results.record import Patch, Record
from workflow.scene.scene import Scene
from workflow.scene.units import unit_of
from workflow.simulation.energy import Energy

ROWS = 150  # of a table of outputs; left out evenly beyond
STEPPING = ("internal_force", "contact", "update", "output")
KNOWN = {
    "scene", "version", "status", "cells", "nodes", "dofs", "ranks", "steps", "time", "dt",
    "dt_bound", "wall_seconds", "seconds_per_phase", "element_updates_per_second", "energy",
    "contacts", "expected",
}  # fmt: skip


@dataclass(frozen=True)
class Table:
    """A table of a report.

    Attributes:
        title: What it shows.
        head: Names of the columns, with units.
        rows: Cells as text.
        note: A remark below it.
        words: Columns of words, set flush left; the others are numbers.
    """

    title: str
    head: tuple[str, ...]
    rows: list[tuple[str, ...]]
    note: str = ""
    words: tuple[int, ...] = field(default=(0,))


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
        inner = _items(value) if several else [("", value)]
        groups |= {f"{key}.{name}".removesuffix("."): table for name, table in inner}
    found = []
    for name, table in groups.items():
        above = [] if name == "scene" else name.split(".")
        rows = [_setting(above, keys, value) for keys, value in _leaves([], table)]
        found.append(Table(name, ("key", "value", "unit"), rows, words=(0, 1, 2)))
    return [table for table in found if table.rows]


def _items(value: Any) -> list[tuple[str, Any]]:
    return list(value.items()) if isinstance(value, dict) else [
        (str(k), v) for k, v in enumerate(value)
    ]  # fmt: skip


def _nested(value: Any) -> bool:
    return isinstance(value, dict) or (
        isinstance(value, list) and any(isinstance(v, dict) for v in value)
    )


def _leaves(keys: list[str], value: Any) -> Iterator[tuple[list[str], Any]]:
    if not _nested(value):
        yield keys, value
        return
    for key, inner in _items(value):
        yield from _leaves([*keys, key], inner)


def _setting(above: list[str], keys: list[str], value: Any) -> tuple[str, ...]:
    unit = unit_of(Scene, [*above, *keys]).replace("^2", "²").replace("^3", "³")
    return ".".join(keys), _plain(value), "" if unit == "-" else unit


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
        for key, label in (("cells", "hexahedra"), ("nodes", "nodes"),
                           ("dofs", "degrees of freedom"), ("ranks", "ranks"), ("steps", "steps"))
        if key in summary
    ]  # fmt: skip
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
        counts = {body.names.get(int(r), str(r)): int((body.regions == r).sum())
                  for r in np.unique(body.regions)}  # fmt: skip
        each = ", ".join(f"{n.replace('_', ' ')} {thousands(c)}" for n, c in counts.items())
        rows.append(("cells of each region", each))
    return Table("Model and computation", ("", ""), rows, words=(0, 1))


def other_table(summary: dict[str, Any]) -> Table | None:
    """Return whatever else a run tells in its summary, e.g. memory or laws of the user's own."""
    rows: list[tuple[str, ...]] = [
        (".".join(keys).replace("_", " "), _plain(value))
        for key in summary.keys() - KNOWN
        for keys, value in _leaves([key], summary[key])
    ]
    return Table("Further", ("", ""), sorted(rows), words=(0, 1)) if rows else None


def expected_table(summary: dict[str, Any]) -> Table | None:
    """Return what theory expects of the run beside what came out."""
    rows: list[tuple[str, ...]] = []
    for a in summary.get("expected", ()):
        error = number(100 * a["error"], 2) + " %" if a["expected"] else number(a["error"], 2)
        unit = "" if a["unit"] == "1" else a["unit"].replace("^2", "²")
        values = (number(a["value"], 5), number(a["expected"], 5))
        rows.append((a["quantity"], *values, unit, error, a["source"]))
    head = ("quantity", "run", "expected", "unit", "error", "source")
    return Table("Against theory", head, rows, words=(0, 3, 5)) if rows else None


def phase_table(summary: dict[str, Any]) -> Table | None:
    """Return the seconds of each phase and its share of all."""
    seconds = summary.get("seconds_per_phase")
    if not seconds:
        return None
    total = sum(seconds.values())
    rows: list[tuple[str, ...]] = [
        (phase.replace("_", " "), f"{s:.2f}", f"{100 * s / total:.1f}" if total else "–")
        for phase, s in seconds.items()
    ]
    note = "Phases from internal force on are the time loop. Seconds are those of rank 0."
    return Table("Where the time went", ("phase", "time [s]", "share [%]"), rows, note)


def energy_table(record: Record) -> Table | None:
    """Return every term of the ledger at the first and last output."""
    history = record.history
    if not len(history.get("t", ())):
        return None
    terms = [f.name for f in fields(Energy) if f.name in history]
    rows = [
        (k.replace("_", " "), *(number(v, 6, zeros=True) for v in history[k][[0, -1]]),
         number(history[k][-1] - history[k][0], 4, zeros=True))
        for k in terms
    ]  # fmt: skip
    worst = float(np.max(np.abs(history["balance_error"])))
    note = (
        "Dissipations and works are sums since the start. Contact normal and contact tangential "
        "are parts of contact. The largest balance error of all outputs, the change of the sum "
        f"less external work over the largest energy exchanged, is {number(worst, 3)}."
    )
    head = ("term", "start [J]", "end [J]", "change [J]")
    return Table("Energy ledger", head, rows, note)


def contact_tables(record: Record) -> list[Table]:
    """Return for each pair a row for each patch and output."""
    return [_contact_table(record, name) for name in record.contacts]


def _contact_table(record: Record, name: str) -> Table:
    contact = record.contacts[name]
    outputs = [(t, k, p) for t, o in zip(contact.t, contact.patches, strict=True)
               for k, p in o.items()]  # fmt: skip
    stride = -(-len(outputs) // ROWS)
    rows = [_patch_row(t, k, p) for t, k, p in outputs[::stride]]
    place = "Patch 1 lies on the rail top, patch 2 on the gauge corner. " if record.wheel_on_rail \
        else "Patch 2 is steeper than 45°. "  # fmt: skip
    note = place + (
        "Contact angle: of the normal resultant to the vertical. θ: from the negative longitudinal "
        "axis to the mean shear on the lower body. Stress: nodal force over tributary area."
    )
    note += f" Every {stride}th row is shown." if stride > 1 else ""
    head = ("t [ms]", "patch", "normal [kN]", "tangential [kN]", "angle [°]", "area [mm²]", "nodes",
            "adhering", "largest pressure [MPa]", "mean shear [MPa]", "θ [°]")  # fmt: skip
    return Table(f"Contact {name} at each output", head, rows, note, ())


def _patch_row(t: float, place: int, p: Patch) -> tuple[str, ...]:
    shear = np.hypot(p.longitudinal_shear, p.lateral_shear) / 1e6
    forces = (p.normal_force / 1e3, p.tangential_force / 1e3)
    pressure = float((p.pressing / p.areas).max()) / 1e6
    return (
        f"{t * 1e3:.4f}", str(place), *(number(v, zeros=True) for v in forces),
        f"{p.angle:.2f}", number(p.area * 1e6, zeros=True), str(len(p.areas)),
        str(int(p.stick.sum())), number(pressure, zeros=True),
        number(shear, 3, zeros=True), number(round(p.shear_angle, 1) if shear else np.nan),
    )  # fmt: skip


def event_table(record: Record) -> Table | None:
    """Return births, ends, splits and merges of patches as the run told them."""
    rows: list[tuple[str, ...]] = []
    with h5py.File(record.folder / "results.h5", "r", locking=False) as file:
        for name, group in file.get("patches", {}).items():
            events = group.get("events", {})
            if "t" in events:
                columns = (events[k][:] for k in ("t", "kind", "patch", "other"))
                rows += [_event(name, *row) for row in zip(*columns, strict=True)]
    if not rows:
        return None
    note = (
        "Here patches are counted from 0 in the order of their birth, wherever they lie; one that "
        "is taken up ends."
    )
    shown: Sequence[tuple[str, ...]] = rows[:ROWS]
    return Table("What became of the patches", ("t [ms]", "contact", "patch", "event"),
                 list(shown), note, (1, 3))  # fmt: skip


def _event(name: str, t: float, kind: bytes, patch: int, other: int) -> tuple[str, ...]:
    word = kind.decode() if isinstance(kind, bytes) else str(kind)
    told = {"split": f"broke off patch {other}", "merge": f"taken up by patch {other}"}
    return f"{t * 1e3:.4f}", name, str(int(patch)), told.get(word, word)
