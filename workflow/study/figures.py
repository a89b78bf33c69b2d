# SPDX-License-Identifier: LGPL-3.0-or-later
"""Figures that compare the runs of a study, drawn from its folder alone.

Each function named in ``COMPARISONS`` draws one figure of the rows of a study and the records of
the runs that are done, or returns None if they do not have what it shows.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from meshes.arrays import Array
from workflow.figures import style
from workflow.figures.shear import FEWEST
from workflow.results.record import Contact, Record
from workflow.scene.scene import Scene
from workflow.scene.units import unit_of
from workflow.study.table import Row, front, grouped, parameters, shipped

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Records = Mapping[str, Record]
LINE = {1: "-", 2: "--"}  # of each patch
MARK = {1: "o", 2: "s"}
SETTINGS = "svD^P*X<>dph"  # markers of settings, in turn
MEGAPASCAL = 1e-6

# quantity of a patch, its factor, panel title, axis label
SHEAR = (
    ("lateral_shear", MEGAPASCAL, "mean lateral shear", "stress on the rail [MPa]"),
    ("longitudinal_shear", MEGAPASCAL, "mean longitudinal shear", "stress on the rail [MPa]"),
)
MEASURES = (
    ("vertical_force", 1e-3, "vertical force", "force [kN]"),
    ("normal_force", 1e-3, "normal force", "force [kN]"),
    ("contact_angle", style.DEGREES, "contact angle", "to the vertical [°]"),
    ("shear_angle", style.DEGREES, "shear angle θ", "from −longitudinal [°]"),
)


def shear_of_patches(table: Sequence[Row], records: Records) -> "Figure | None":
    """Mean lateral and longitudinal shear stress of both patches, θ₁ and θ₂ over time, every run.

    Figure 9 of the reference study. Patches of one or two nodes are left out.
    """
    found = _contacts(table, records)
    if not found:
        return None
    fig = style.figure(style.PAGE, 4.8)
    panels = fig.subplots(2, 2, sharex=True).ravel()
    scale, unit = style.prefixed(np.concatenate([contact.t for _, contact in found]), "s")
    for colour, (label, contact) in zip(_colours(len(found)), found, strict=True):
        for axes, (quantity, factor, *_) in zip(panels[:2], SHEAR, strict=True):
            for place in (1, 2):
                _curve(axes, contact, place, quantity, scale, factor, colour)
        for axes, place in zip(panels[2:], (1, 2), strict=True):
            _curve(axes, contact, place, "shear_angle", scale, style.DEGREES, colour)
        panels[0].plot([], [], color=colour, lw=2.5, label=label)
    for place in (1, 2):
        name, line = style.PATCH_NAME[place], LINE[place]
        panels[0].plot([], [], line, color=style.INK, marker=MARK[place], ms=2.8, label=name)
    titles = [entry[2] for entry in SHEAR] + ["θ₁: angle of patch 1", "θ₂: angle of patch 2"]
    labels = [entry[3] for entry in SHEAR] + ["from −longitudinal [°]"] * 2
    for axes, mark, title, label in zip(panels, "abcd", titles, labels, strict=True):
        style.letter(axes, mark, title)
        axes.set_ylabel(label)
        axes.axhline(0, color=style.FAINT, lw=0.6)
    _same_angles(panels[2:])
    for axes in panels[2:]:
        axes.set_xlabel(f"time [{unit}]")
    fig.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=5)
    return fig


def convergence(table: Sequence[Row], records: Records) -> "Figure | None":
    """Forces and angles of both patches over time for every run, and their means over a parameter.

    A patch has its means over the outputs at which it is there. The parameter is ``mesh.size`` if
    it varies, else the first that is a number.
    """
    found, key = _contacts(table, records), _number(table)
    if not found or key is None:
        return None
    rows = {row["label"]: row for row in table if row["run"] in records}
    fig = style.figure(style.PAGE, 4.4)
    panels = fig.subplots(2, len(MEASURES), sharex="row")
    scale, unit = style.prefixed(np.concatenate([contact.t for _, contact in found]), "s")
    at, x_unit = _scaled(key, [row.get(key) for row in rows.values()])
    for column, (quantity, factor, title, label) in enumerate(MEASURES):
        upper, lower = panels[:, column]
        means: dict[int, list[tuple[float, float, Any]]] = {1: [], 2: []}
        for colour, (name, contact) in zip(_colours(len(found)), found, strict=True):
            for place, points in means.items():
                _curve(upper, contact, place, quantity, scale, factor, colour)
                series = contact.series(place, quantity) * factor
                if np.isfinite(series).any() and key in rows[name]:
                    points.append((rows[name][key] * at, float(np.nanmean(series)), colour))
        for place, points in means.items():
            _joined(lower, sorted(points, key=lambda point: point[0]), place)
        style.letter(upper, "abcd"[column], title)
        style.letter(lower, "efgh"[column], "mean while there")
        for axes in (upper, lower):
            axes.set_ylabel(label)
        upper.set_xlabel(f"time [{unit}]")
        lower.set_xlabel(f"{key.split('.')[-1].replace('_', ' ')}{x_unit}")
        lower.margins(0.15)
    handles = _handles(found)
    fig.legend(handles=handles, loc="outside lower center", ncols=len(handles))
    return fig


def error_against_time(table: Sequence[Row], records: Records) -> "Figure | None":
    """Error against the closed form over processor time, and over cells times steps.

    A row of panels for each group; runs that no other beats in both make the front, in grey.
    """
    groups = [rows for rows in grouped(table).values() if front(rows)]
    if not groups:
        return None
    fig = style.figure(style.PAGE, 2.3 * len(groups) + 0.3)
    panels = fig.subplots(len(groups), 2, squeeze=False, sharey="row")
    costs = (
        ("processor_seconds", 1.0, "processor time [s]"),
        ("cell_steps", 1e-6, "cells × steps [millions]"),
    )
    letters = iter("abcdefghijklmnopqrstuvwxyz")
    for own, line in zip(groups, panels, strict=True):
        for axes, (cost, scale, label) in zip(line, costs, strict=True):
            _errors(axes, own, cost, scale)
            axes.set_xlabel(label)
            style.letter(axes, next(letters), _of(own))
        line[0].set_ylabel("error [%]")
        line[1].legend(loc="center left", bbox_to_anchor=(1.01, 0.5), fontsize=6)
    return fig


COMPARISONS: dict[str, Callable[[Sequence[Row], Records], "Figure | None"]] = {
    figure.__name__: figure for figure in (shear_of_patches, convergence, error_against_time)
}


def draw(folder: Path, table: Sequence[Row]) -> list[Path]:
    """Draw the comparisons of a study into its ``figures/`` and return their paths."""
    asked = json.loads((folder / "study.json").read_text("utf-8"))["compare"]
    done = [row["run"] for row in table if row["status"] == "done"]
    records = {name: Record(folder / "runs" / name) for name in done}
    paths: list[Path] = []
    if not asked or not done:
        return paths
    with style.style():
        for name in asked:
            fig = COMPARISONS[name](table, records)
            if fig is not None:
                paths.append(style.save(fig, folder / "figures" / f"{name}.png"))
    return paths


def _contacts(table: Sequence[Row], records: Records) -> list[tuple[str, Contact]]:
    """Return label and first contact of each run that touched, without patches about to end."""
    found = []
    for row in table:
        if row["run"] in records and records[row["run"]].contacts:
            contact = next(iter(records[row["run"]].contacts.values()))
            ample = [
                {k: p for k, p in output.items() if len(p.areas) >= FEWEST}
                for output in contact.patches
            ]
            found.append((row["label"], Contact(contact.t, ample)))
    return found


def _curve(
    axes: "Axes",
    contact: Contact,
    place: int,
    quantity: str,
    scale: float,
    factor: float,
    colour: Any,
) -> None:
    """Draw a quantity of a patch over time."""
    values = contact.series(place, quantity) * factor
    if np.isfinite(values).any():
        marker = MARK[place] if len(values) <= 40 else ""
        axes.plot(contact.t * scale, values, LINE[place], color=colour, marker=marker, ms=2.8)


def _joined(axes: "Axes", points: Sequence[tuple[float, float, Any]], place: int) -> None:
    """Draw points of several colours, joined by a thin line."""
    axes.plot(
        [p[0] for p in points], [p[1] for p in points], LINE[place], color=style.FAINT, lw=0.8
    )
    for x, y, colour in points:
        axes.plot(x, y, MARK[place], color=colour, ms=5)


def _errors(axes: "Axes", own: Sequence[Row], cost: str, scale: float) -> None:
    """Draw the error of each run of a group over its cost, the front behind."""
    best = front(own, cost)
    axes.loglog(
        [row[cost] * scale for row in best],
        [100 * row["closed_form_error"] for row in best],
        color="#cccccc",
        lw=4,
        zorder=1,
        solid_capstyle="round",
        label="front",
    )
    able = [row for row in own if np.isfinite(row.get("closed_form_error", np.nan))]
    for number, row in enumerate(able):
        plain = shipped(row, own)
        axes.plot(
            row[cost] * scale,
            100 * row["closed_form_error"],
            ls="",
            marker="o" if plain else SETTINGS[number % len(SETTINGS)],
            ms=8 if plain else 4.5,
            color=style.INK if plain else f"C{number % 10}",
            mfc="none" if plain else None,
            mew=1.5 if plain else 0,
            zorder=3 if plain else 2,
            label=row["label"],
        )
    _decades(axes)


def _decades(axes: "Axes") -> None:
    """Label logarithmic axes with plain numbers, also where they span less than a decade."""
    from matplotlib.ticker import LogLocator, NullFormatter

    for axis in (axes.xaxis, axes.yaxis):
        low, high = sorted(axis.get_view_interval())
        fine = (1, 1.5, 2, 3, 5, 7) if high < 10 * low else (1, 2, 5)
        axis.set_major_locator(LogLocator(subs=fine if high < 200 * low else (1,), numticks=12))
        axis.set_major_formatter(lambda value, _: f"{value:g}")
        axis.set_minor_formatter(NullFormatter())


def _of(own: Sequence[Row]) -> str:
    return next(row["closed_form"] for row in own if "closed_form" in row)


def _number(table: Sequence[Row]) -> str | None:
    """Return the parameter to draw over."""
    numbers = [
        key
        for key in parameters(table)
        if all(isinstance(row.get(key, 0.0), int | float) for row in table)
    ]
    return "mesh.size" if "mesh.size" in numbers else next(iter(numbers), None)


def _scaled(key: str, values: Sequence[float | None]) -> tuple[float, str]:
    """Return factor and unit in brackets in which a parameter reads well."""
    unit = unit_of(Scene, key.split("."))
    if unit in ("", "-"):
        return 1.0, ""
    factor, prefixed = style.prefixed([value for value in values if value is not None], unit)
    return factor, f" [{prefixed}]"


def _same_angles(panels: Sequence["Axes"]) -> None:
    """Give panels of angles one range, in steps of 30 degrees."""
    from matplotlib.ticker import MultipleLocator

    ends: Array = np.array([axes.get_ylim() for axes in panels])
    for axes in panels:
        axes.set_ylim(min(0.0, float(ends[:, 0].min())), max(90.0, float(ends[:, 1].max())))
        axes.yaxis.set_major_locator(MultipleLocator(30))


def _colours(count: int) -> list[Any]:
    """Return a colour for each run, from dark to light."""
    import matplotlib as mpl

    return [mpl.colormaps["viridis"](k) for k in np.linspace(0.0, 0.82, count)]


def _handles(found: Sequence[tuple[str, Contact]]) -> list[Any]:
    """Return legend entries for the runs and for the two patches."""
    from matplotlib.lines import Line2D

    runs = [
        Line2D([], [], color=colour, lw=2.5, label=label)
        for colour, (label, _) in zip(_colours(len(found)), found, strict=True)
    ]
    places = [
        Line2D([], [], color=style.INK, ls=LINE[k], marker=MARK[k], ms=2.8, label=name)
        for k, name in style.PATCH_NAME.items()
        if any(k in output for _, contact in found for output in contact.patches)
    ]
    return [*runs, *places]
