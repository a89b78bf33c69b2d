# SPDX-License-Identifier: LGPL-3.0-or-later
"""Curves over time: patch forces, energy ledger, contact force against its closed form."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from meshes.arrays import Array
from workflow.figures import style
from workflow.figures.closed_forms import closed_forms
from workflow.figures.shear import FEWEST
from workflow.results.patch_nodes import STEEP
from workflow.results.record import Contact, Record

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

HISTORY_FORCES = ("normal_force", "tangential_x_force", "tangential_y_force", "tangential_z_force")


def patch_forces(record: Record) -> "Figure | None":
    """Normal force, tangential force, contact angle and area of each patch at every output.

    The tangential force is the size of the vector sum, the area the sum of tributary areas. The
    static wheel load is the vertical contact force at the first output.
    """
    if not record.wheel_on_rail or not record.contacts:
        return None
    contact = next(iter(record.contacts.values()))
    fig = style.figure(style.PAGE, 4.6)
    panels = fig.subplots(2, 2, sharex=True).ravel()
    scale, unit = style.prefixed(contact.t, "s")
    _normal_forces(panels[0], contact, scale, static="equilibrium" in record.scene)
    _by_patch(panels[1], contact, "tangential_force", scale, 1e-3)
    _by_patch(panels[2], contact, "contact_angle", scale, style.DEGREES)
    _by_patch(panels[3], contact, "area", scale, 1e6)
    titles = ("normal force", "tangential force", "contact angle", "contact area")
    labels = ("force [kN]", "force [kN]", "angle to the vertical [°]", "area [mm²]")
    for axes, mark, title, label in zip(panels, "abcd", titles, labels, strict=True):
        style.letter(axes, mark, title)
        axes.set_ylabel(label)
        axes.set_ylim(bottom=0, top=1.06 * max(axes.dataLim.y1, 1e-9))
        _mark_birth(axes, contact, scale)
    panels[2].set_ylim(0, 90)
    panels[2].set_yticks(range(0, 91, 15))
    for axes in panels[2:]:
        axes.set_xlabel(f"time [{unit}]")
    handles, names = panels[0].get_legend_handles_labels()
    fig.legend(handles, names, loc="outside lower center", ncols=3)
    return fig


def patch_means(record: Record) -> "Figure | None":
    """Mean shear stress on the rail in the frame of each patch, its angle θ, and the creepages.

    The stress, along and across the rolling direction, is the sum of nodal forces over the sum
    of tributary areas; θ is its angle from the negative longitudinal axis. Creepage is the
    rigid slip of wheel on rail at the patch over the rolling speed. Patches of one or two nodes
    are left out of the stresses.
    """
    if not record.wheel_on_rail or not record.contacts:
        return None
    from matplotlib.ticker import MultipleLocator

    contact = next(iter(record.contacts.values()))
    fig = style.figure(style.PAGE, 4.6)
    panels = fig.subplots(2, 2, sharex=True).ravel()
    scale, unit = style.prefixed(contact.t, "s")
    several = [{k: p for k, p in o.items() if len(p.areas) >= FEWEST} for o in contact.patches]
    ample = Contact(contact.t, several)
    quantities = ("lateral_shear", "longitudinal_shear", "shear_angle")
    titles = ("mean lateral shear", "mean longitudinal shear", "angle θ of the mean shear")
    labels = ("stress on the rail [MPa]", "stress on the rail [MPa]", "from −longitudinal [°]")
    for k, factor in enumerate((1e-6, 1e-6, style.DEGREES)):
        _by_patch(panels[k], ample, quantities[k], scale, factor)
        style.letter(panels[k], "abc"[k], titles[k])
        panels[k].set_ylabel(labels[k])
    panels[2].yaxis.set_major_locator(MultipleLocator(30))
    low, high = panels[2].dataLim.intervaly / 30 if np.isfinite(panels[2].dataLim.y1) else (0, 1)
    panels[2].set_ylim(30 * min(np.floor(low), 0) - 3, 30 * max(np.ceil(high), 1) + 3)
    _creepages(panels[3], record, scale)
    for axes in panels:
        axes.axhline(0, color=style.FAINT, lw=0.6)
        _mark_birth(axes, contact, scale)
    for axes in panels[2:]:
        axes.set_xlabel(f"time [{unit}]")
    handles, names = panels[0].get_legend_handles_labels()
    fig.legend(handles, names, loc="outside lower center", ncols=3)
    return fig


def _creepages(axes: "Axes", record: Record, scale: float) -> None:
    """Draw the creepages at each output, lateral ones dashed: patches weighted by normal force."""
    table = record.patches
    if not table:
        axes.set_axis_off()
        return
    steep = table["contact_angle"] >= STEEP
    for place, mine in ((1, ~steep), (2, steep)):
        t, row = np.unique(table["t"][mine], return_inverse=True)
        force = table["normal_force"][mine]
        for along, line in ((0, "-"), (1, "--")):
            if mine.any():
                carried = np.bincount(row, force * table["creepage"][mine, along])
                percent = 100 * carried / np.bincount(row, force)
                colour = style.PATCH[place]
                axes.plot(t * scale, percent, line, color=colour, marker="o", ms=2.8)
    axes.plot([], [], "-", color=style.INK, label="longitudinal")
    axes.plot([], [], "--", color=style.INK, label="lateral")
    axes.legend(loc="best")
    style.letter(axes, "d", "creepages of wheel on rail")
    axes.set_ylabel("creepage [%]")


def energy(record: Record) -> "Figure | None":
    """Change of each energy since the start, and the error of their balance.

    (a) Dissipations and works are sums. The dashed sum less external work would be zero in
    exact arithmetic of the time stepping. (b) That sum over the largest energy exchanged so
    far.
    """
    history = record.history
    t = history.get("t", np.zeros(0))
    terms = {k: history[k] - history[k][0] for k in style.ENERGY if k in history and len(t)}
    terms = {k: values for k, values in terms.items() if np.any(values != 0)}
    if not terms:
        return None
    fig = style.figure(style.PAGE, 4.2)
    upper, lower = fig.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    time_scale, time_unit = style.prefixed(t, "s")
    scale, unit = style.prefixed(np.concatenate(list(terms.values())), "J")
    for name, values in terms.items():
        label = f"{name.replace('_', ' ')}  {_short(values[-1], 'J')}"
        upper.plot(t * time_scale, values * scale, color=style.ENERGY[name], label=label)
    total = sum(-v if k == "external_work" else v for k, v in terms.items())
    label = "sum, less external work" if "external_work" in terms else "sum"
    label = f"{label}  {_short(total[-1], 'J')}"
    upper.plot(t * time_scale, total * scale, color=style.INK, ls="--", lw=1, label=label)
    upper.set_ylabel(f"energy since the start [{unit}]")
    upper.legend(
        loc="upper left",
        bbox_to_anchor=(1, 1),
        title="at the end",
        alignment="left",
        title_fontsize=7,
    )
    style.letter(upper, "a", "energy ledger")
    _error(lower, t * time_scale, history["balance_error"])
    lower.set_xlabel(f"time [{time_unit}]")
    return fig


def history(record: Record) -> "Figure | None":
    """Resultants of each contact at every output.

    Wide pale lines are closed forms: ρ c v A for a bar, the dead load, Hertz's impact, Carter's
    and Kalker's tangential force at the creepage that is imposed.
    """
    history, pairs = record.history, list(record.scene.get("contacts", {}))
    if record.wheel_on_rail or not pairs or not len(history.get("t", ())):
        return None
    t = history["t"]
    fig = style.figure(style.PAGE, 2.6 * len(pairs))
    time_scale, time_unit = style.prefixed(t, "s")
    for name, axes in zip(pairs, fig.subplots(len(pairs), 1, squeeze=False)[:, 0], strict=True):
        normal, *parts = (history[f"{name}_{key}"] for key in HISTORY_FORCES)
        tangential = np.linalg.norm(parts, axis=0)
        scale, unit = style.prefixed(normal, "N")
        for (label, when, force), tint in zip(
            closed_forms(record, name), style.CLOSED_FORMS, strict=False
        ):
            axes.plot(when * time_scale, force * scale, color=tint, lw=4, label=label)
        axes.plot(t * time_scale, normal * scale, color=style.PATCH[1], label="normal force")
        if np.any(tangential > 1e-6 * np.max(normal)):
            axes.plot(
                t * time_scale, tangential * scale, color=style.PATCH[2], label="tangential force"
            )
        axes.set(xlabel=f"time [{time_unit}]", ylabel=f"contact force [{unit}]")
        axes.set_ylim(bottom=0, top=1.08 * axes.get_ylim()[1])
        axes.set_title(f"contact pair {name}")
        axes.legend(loc="upper left", bbox_to_anchor=(1, 1))
    return fig


def _normal_forces(axes: "Axes", contact: Contact, scale: float, static: bool) -> None:
    """Draw normal forces, their vertical sum and the static wheel load."""
    _by_patch(axes, contact, "normal_force", scale, 1e-3)
    vertical = np.nansum([contact.series(k, "vertical_force") for k in (1, 2)], axis=0)
    t = contact.t * scale
    axes.plot(t, vertical / 1e3, color=style.INK, lw=0.9, label="vertical force, sum")
    if static:
        load = vertical[0] / 1e3
        axes.axhline(load, color=style.FAINT, ls="--", lw=0.9, label="static wheel load")


def _by_patch(axes: "Axes", contact: Contact, quantity: str, scale: float, factor: float) -> None:
    for place, colour in style.PATCH.items():
        values = contact.series(place, quantity) * factor
        if np.isfinite(values).any():
            marker = "o" if len(values) <= 80 else ""
            name = style.PATCH_NAME[place]
            axes.plot(contact.t * scale, values, color=colour, marker=marker, ms=2.8, label=name)


def _mark_birth(axes: "Axes", contact: Contact, scale: float) -> None:
    """Mark the first output with both patches."""
    if contact.two_points.any():
        label = "first output with two patches"
        birth = contact.t[int(np.argmax(contact.two_points))]
        axes.axvline(birth * scale, color=style.TWO_POINT, ls=":", lw=1, label=label)


def _short(value: float, unit: str) -> str:
    scale, unit = style.prefixed(value, unit)
    return f"{value * scale:.3g} {unit}".replace("-", "−")


def _error(axes: "Axes", t: Array, error: Sequence[float] | Array) -> None:
    percent = 100 * np.asarray(error)
    axes.plot(t, percent, color=style.INK)
    axes.axhline(0, color=style.FAINT, lw=0.6)
    reach = max(1.2 * float(np.nanmax(np.abs(percent))), 1e-12)
    axes.set_ylim(-reach, reach)
    axes.set_ylabel("error [%]")
    style.letter(axes, "b", "balance error of the exchanged energy")
