# SPDX-License-Identifier: LGPL-3.0-or-later
"""Curves over time: patch forces, energy ledger, contact force against its closed form."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from workflow import theme
from workflow.figures_shear import FEWEST
from workflow.recorded import STEEP, Contact, Record
from workflow.theme import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

HISTORY_FORCES = ("normal_force", "tangential_x_force", "tangential_y_force", "tangential_z_force")


def patch_forces(record: Record) -> "Figure | None":
    """Forces, contact angle and area of each patch over time, for a wheel on a rail."""
    if not record.wheel_on_rail or not record.contacts:
        return None
    contact = next(iter(record.contacts.values()))
    fig = theme.figure(theme.PAGE, 4.6)
    panels = fig.subplots(2, 2, sharex=True).ravel()
    scale, unit = theme.prefixed(contact.t, "s")
    _normal_forces(panels[0], contact, scale, static="equilibrium" in record.scene)
    _by_patch(panels[1], contact, "tangential_force", scale, 1e-3)
    _by_patch(panels[2], contact, "angle", scale, 1.0)
    _by_patch(panels[3], contact, "area", scale, 1e6)
    titles = ("normal force", "tangential force", "contact angle", "contact area")
    labels = ("force [kN]", "force [kN]", "angle to the vertical [°]", "area [mm²]")
    for axes, mark, title, label in zip(panels, "abcd", titles, labels, strict=True):
        theme.letter(axes, mark, title)
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
    """Mean shear stress of each patch, its angle θ and the creepages of the bodies over time.

    Patches of one or two nodes, about to be born or to end, are left out of the stresses.
    """
    if not record.wheel_on_rail or not record.contacts:
        return None
    from matplotlib.ticker import MultipleLocator

    contact = next(iter(record.contacts.values()))
    fig = theme.figure(theme.PAGE, 4.6)
    panels = fig.subplots(2, 2, sharex=True).ravel()
    scale, unit = theme.prefixed(contact.t, "s")
    several = [{k: p for k, p in o.items() if len(p.areas) >= FEWEST} for o in contact.patches]
    ample = Contact(contact.t, several)
    quantities = ("lateral_shear", "longitudinal_shear", "shear_angle")
    titles = ("mean lateral shear", "mean longitudinal shear", "angle θ of the mean shear")
    labels = ("stress on the rail [MPa]", "stress on the rail [MPa]", "from −longitudinal [°]")
    for k, factor in enumerate((1e-6, 1e-6, 1.0)):
        _by_patch(panels[k], ample, quantities[k], scale, factor)
        theme.letter(panels[k], "abc"[k], titles[k])
        panels[k].set_ylabel(labels[k])
    panels[2].yaxis.set_major_locator(MultipleLocator(30))
    _creepages(panels[3], record, scale)
    for axes in panels:
        axes.axhline(0, color=theme.FAINT, lw=0.6)
        _mark_birth(axes, contact, scale)
    for axes in panels[2:]:
        axes.set_xlabel(f"time [{unit}]")
    handles, names = panels[0].get_legend_handles_labels()
    fig.legend(handles, names, loc="outside lower center", ncols=3)
    return fig


def _creepages(axes: "Axes", record: Record, scale: float) -> None:
    """Draw the creepages of every patch in the table, lateral ones dashed."""
    table = record.patches
    if not table:
        axes.set_axis_off()
        return
    steep = np.degrees(table["contact_angle"]) >= STEEP
    for place, mine in ((1, ~steep), (2, steep)):
        t, creepage = table["t"][mine] * scale, 100 * table["creepage"][mine]
        for along, line in ((0, "-"), (1, "--")):
            if mine.any():
                axes.plot(t, creepage[:, along], line, color=theme.PATCH[place], marker="o", ms=2.8)
    axes.plot([], [], "-", color=theme.INK, label="longitudinal")
    axes.plot([], [], "--", color=theme.INK, label="lateral")
    axes.legend(loc="best")
    theme.letter(axes, "d", "creepages of wheel on rail")
    axes.set_ylabel("creepage [%]")


def energy(record: Record) -> "Figure | None":
    """Change of every energy since the start, and the error of their balance."""
    history = record.history
    t = history.get("t", np.zeros(0))
    terms = {k: history[k] - history[k][0] for k in theme.ENERGY if k in history and len(t)}
    terms = {k: values for k, values in terms.items() if np.any(values != 0)}
    if not terms:
        return None
    fig = theme.figure(theme.PAGE, 4.2)
    upper, lower = fig.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    time_scale, time_unit = theme.prefixed(t, "s")
    scale, unit = theme.prefixed(np.concatenate(list(terms.values())), "J")
    for name, values in terms.items():
        colour = theme.ENERGY[name]
        upper.plot(t * time_scale, values * scale, color=colour, label=name.replace("_", " "))
    total = sum(-v if k == "external_work" else v for k, v in terms.items())
    label = "sum, less external work" if "external_work" in terms else "sum"
    upper.plot(t * time_scale, total * scale, color=theme.INK, ls="--", lw=1, label=label)
    upper.set_ylabel(f"energy since the start [{unit}]")
    upper.legend(loc="upper left", bbox_to_anchor=(1, 1))
    theme.letter(upper, "a", "energy ledger")
    _error(lower, t * time_scale, history["balance_error"])
    lower.set_xlabel(f"time [{time_unit}]")
    return fig


def history(record: Record) -> "Figure | None":
    """Contact force of each pair over time, its closed form behind where there is one."""
    history, pairs = record.history, list(record.scene.get("contacts", {}))
    if record.wheel_on_rail or not pairs or not len(history.get("t", ())):
        return None
    t = history["t"]
    fig = theme.figure(theme.PAGE, 2.6 * len(pairs))
    time_scale, time_unit = theme.prefixed(t, "s")
    for name, axes in zip(pairs, fig.subplots(len(pairs), 1, squeeze=False)[:, 0], strict=True):
        normal, *parts = (history[f"{name}_{key}"] for key in HISTORY_FORCES)
        tangential = np.linalg.norm(parts, axis=0)
        scale, unit = theme.prefixed(normal, "N")
        for (label, when, force), tint in zip(
            closed_forms(record, name), theme.CLOSED_FORMS, strict=False
        ):
            axes.plot(when * time_scale, force * scale, color=tint, lw=4, label=label)
        axes.plot(t * time_scale, normal * scale, color=theme.PATCH[1], label="normal force")
        if np.any(tangential > 1e-6 * np.max(normal)):
            axes.plot(
                t * time_scale, tangential * scale, color=theme.PATCH[2], label="tangential force"
            )
        axes.set(xlabel=f"time [{time_unit}]", ylabel=f"contact force [{unit}]")
        axes.set_ylim(bottom=0)
        axes.set_title(f"contact pair {name}")
        axes.legend(loc="upper left", bbox_to_anchor=(1, 1))
    return fig


def pressure(record: Record) -> "Figure | None":
    """Pressure of a sphere on a flat over the radius at the last output, Hertz behind."""
    if record.scene["mesh"]["kind"] != "cap-on-block" or not record.contacts:
        return None
    from contact.closed_forms import contact_modulus, hertz_sphere

    contact = next(iter(record.contacts.values()))
    patch = next(p for p in reversed(contact.patches) if p)[1]
    materials = [b["material"] for b in record.scene["bodies"].values()]
    moduli = [(m["youngs_modulus"], m["poisson_ratio"]) for m in materials]
    modulus = contact_modulus(*moduli[0], *moduli[-1])
    hertz = hertz_sphere(4 * patch.vertical_force, record.scene["mesh"]["radius"], modulus)
    r = np.linspace(0, hertz.a, 200)
    fig = theme.figure(theme.COLUMN, 2.8)
    axes = fig.subplots()
    exact = hertz.p0 * np.sqrt(1 - (r / hertz.a) ** 2)
    axes.plot(r * 1e3, exact / 1e6, color=theme.CLOSED_FORM, lw=3.5, label="Hertz, same force")
    at, nodal = np.hypot(*patch.position[:, :2].T), patch.pressing / patch.areas
    axes.plot(at * 1e3, nodal / 1e6, ".", color=theme.PATCH[1], ms=3.5, label="contact nodes")
    axes.set(xlabel="distance from the centre [mm]", ylabel="pressure [MPa]")
    axes.set_ylim(bottom=0)
    axes.legend()
    return fig


def closed_forms(record: Record, pair: str) -> list[tuple[str, Array, Array]]:
    """Return what theory says of a pair's forces: label, times [s], forces [N]; or nothing."""
    from contact.closed_forms import bar_impact, sliding_stop
    from workflow.body_tables import Isotropic
    from workflow.mesh_tables import BarMesh, BlocksMesh, CapMesh
    from workflow.scene import Scene
    from workflow.sections import RigidWall

    scene = Scene.check(record.scene)
    contact, mesh, whole = scene.contacts[pair], scene.mesh, np.array([0.0, scene.time.end])
    body = next(iter(scene.bodies.values()))
    if not isinstance(body.material, Isotropic):
        return []
    E, rho = body.material.youngs_modulus, body.material.density
    speed = abs((body.velocity or (0.0,))[0])
    pressure = -sum(load.traction[2] for load in scene.loads)
    if isinstance(mesh, BarMesh) and isinstance(contact.target, RigidWall):
        force, stay = bar_impact(speed, E, rho, mesh.width**2, mesh.length)
        times = np.array([0.0, 0.0, stay, stay, scene.time.end])
        return [("ρ c v A during 2L/c", times, force * np.array([0, 1, 1, 0, 0]))]
    if isinstance(mesh, BlocksMesh) and pressure > 0:
        normal = pressure * mesh.block[0] * mesh.block[1] * np.ones(2)
        forms = [("load on the block", whole, normal)]
        friction = contact.friction
        if speed and isinstance(friction, float) and friction:
            _, stop = sliding_stop(speed, friction, pressure / (rho * mesh.block[2]))
            slide = np.array([0.0, min(stop, scene.time.end)])
            forms.append(("friction × load until rest", slide, friction * normal))
        return forms
    if isinstance(mesh, CapMesh) and pressure > 0:
        return [("load on the quarter", whole, pressure * mesh.extent**2 * np.ones(2))]
    return []


def _normal_forces(axes: "Axes", contact: Contact, scale: float, static: bool) -> None:
    """Draw normal forces, their vertical sum and the static wheel load."""
    _by_patch(axes, contact, "normal_force", scale, 1e-3)
    vertical = np.nansum([contact.series(k, "vertical_force") for k in (1, 2)], axis=0)
    t = contact.t * scale
    axes.plot(t, vertical / 1e3, color=theme.INK, lw=0.9, label="vertical force, sum")
    if static:
        load = vertical[0] / 1e3
        axes.axhline(load, color=theme.FAINT, ls="--", lw=0.9, label="static wheel load")


def _by_patch(axes: "Axes", contact: Contact, quantity: str, scale: float, factor: float) -> None:
    for place, colour in theme.PATCH.items():
        values = contact.series(place, quantity) * factor
        if np.isfinite(values).any():
            marker = "o" if len(values) <= 80 else ""
            name = theme.PATCH_NAME[place]
            axes.plot(contact.t * scale, values, color=colour, marker=marker, ms=2.8, label=name)


def _mark_birth(axes: "Axes", contact: Contact, scale: float) -> None:
    """Mark the first output with both patches."""
    if contact.two_points.any():
        label = "first output with two patches"
        birth = contact.t[int(np.argmax(contact.two_points))]
        axes.axvline(birth * scale, color=theme.TWO_POINT, ls=":", lw=1, label=label)


def _error(axes: "Axes", t: Array, error: Sequence[float] | Array) -> None:
    percent = 100 * np.asarray(error)
    axes.plot(t, percent, color=theme.INK)
    axes.axhline(0, color=theme.FAINT, lw=0.6)
    reach = max(1.2 * float(np.nanmax(np.abs(percent))), 1e-12)
    axes.set_ylim(-reach, reach)
    axes.set_ylabel("error [%]")
    theme.letter(axes, "b", "balance error of the exchanged energy")
