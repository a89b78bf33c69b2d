# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pressure and shear of smooth bodies at the last output against closed forms."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from meshes.arrays import Array
from workflow.figures import style
from workflow.results.patch_nodes import PatchNodes
from workflow.results.record import Record
from workflow.theory.smooth import Smooth, smooth

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from contact.theory.closed_forms import Hertz
    from workflow.theory.wheel_on_rail import OnHalfSpaces

MM, MPA = 1e3, 1e-6
EXACT: dict[str, Any] = {"color": style.CLOSED_FORM, "lw": 3.5}
INNER = 0.9  # of the contact, where nodes are compared: the edge is a matter of half a cell


def pressure(record: Record) -> "Figure | None":
    """Nodal pressure and shear at the last output in contact, closed forms behind.

    Pressure (normal force over tributary area) against Hertz under the same normal force; shear
    against Carter or Cattaneo and Mindlin under the same tangential force. Root mean squares
    are of the nodes within 0.9 of the contact, over the largest value.
    """
    bodies = smooth(record)
    if bodies is None or not record.contacts:
        return None
    patch = last_patch(record)
    hertz, at = bodies.hertz(patch.normal_force), bodies.local(patch)
    where, line, label = _abscissa(bodies, hertz, at)
    sheared = _traction(record, bodies, patch, hertz)
    fig = style.figure(style.PAGE if sheared else style.COLUMN, 2.8)
    panels = fig.subplots(1, 1 + bool(sheared), squeeze=False)[0]
    exact = hertz.pressure(line[:, 0] * hertz.a)
    nodal, there = patch.pressure, hertz.pressure(*at.T)
    inside = np.hypot(at[:, 0] / hertz.a, at[:, 1] / hertz.b) < INNER
    error = _rms(nodal, there, inside, hertz.p0)
    _compare(panels[0], (line[:, 1], exact), (where, nodal), "Hertz", error)
    panels[0].set(xlabel=label, ylabel="pressure [MPa]")
    if sheared:
        name, theory, shear = sheared
        exact = theory(line[:, 0] * hertz.a)
        radius = at[:, 0] if bodies.plane else np.hypot(*at.T)
        error = _rms(shear, theory(radius), inside, float(exact.max()))
        _compare(panels[1], (line[:, 1], exact), (where, shear), name, error)
        panels[1].set(xlabel=label, ylabel="shear stress [MPa]")
        style.letter(panels[0], "a", "pressure")
        style.letter(panels[1], "b", "shear")
    return fig


def last_patch(record: Record) -> PatchNodes:
    """Return the patch with most force of the last output in contact."""
    contact = next(iter(record.contacts.values()))
    patches = next(p for p in reversed(contact.patches) if p)
    return max(patches.values(), key=lambda p: p.normal_force)


def _abscissa(bodies: Smooth, hertz: "Hertz", at: Array) -> tuple[Array, Array, str]:
    """Return where nodes are drawn, where the closed form is (x/a and abscissa), and the label."""
    share = np.linspace(-1 if bodies.plane and not bodies.halved[0] else 0, 1, 401)
    if bodies.plane:
        return at[:, 0] * MM, np.column_stack([share, share * hertz.a * MM]), "along x [mm]"
    if np.isclose(hertz.a, hertz.b):
        line = np.column_stack([share, share * hertz.a * MM])
        return np.hypot(*at.T) * MM, line, "distance from the centre [mm]"
    r = np.hypot(at[:, 0] / hertz.a, at[:, 1] / hertz.b)
    return r, np.column_stack([share, share]), "distance from the centre / half axis [-]"


def _traction(
    record: Record, bodies: Smooth, patch: PatchNodes, hertz: "Hertz"
) -> tuple[str, Callable[[Array], Array], Array] | None:
    """Return name, closed form and nodal values of the shear along x [Pa], None if there is none.

    The closed form takes x in plane strain, the distance from the centre else [m].
    """
    from contact.theory.closed_forms import carter_stick_ratio, carter_traction, cattaneo_mindlin

    scene = record.checked
    friction = next(iter(scene.contacts.values())).friction
    resultant = patch.tangential_forces[:, 0].sum()
    P, Q = bodies.whole(patch.normal_force), bodies.whole(abs(resultant))
    if not isinstance(friction, float) or not 0 < Q <= friction * P or not scene.driven:
        return None
    shear = np.sign(resultant) * patch.tangential_forces[:, 0] / patch.areas
    if bodies.plane and bodies.rolls:
        below = [d.velocity[0] for d in scene.driven.values() if not any(d.spin)]
        ahead = -np.sign(below[0]) if below and below[0] else 1.0
        ratio = carter_stick_ratio(Q, P, friction)
        return "Carter", lambda x: carter_traction(ahead * x, hertz, ratio, friction), shear
    if not bodies.plane and not bodies.rolls and np.isclose(hertz.a, hertz.b):
        return "Cattaneo, Mindlin", lambda r: cattaneo_mindlin(r, hertz, Q, P, friction), shear
    return None


def _rms(nodal: Array, exact: Array, inside: npt.NDArray[np.bool_], scale: float) -> float:
    """Return the root mean square of the error inside, over ``scale``."""
    off = (nodal - exact)[inside]
    return float(np.sqrt((off**2).mean())) / scale if len(off) else float("nan")


def _compare(
    axes: "Axes", exact: tuple[Array, Array], nodal: tuple[Array, Array], name: str, error: float
) -> None:
    axes.plot(exact[0], exact[1] * MPA, **EXACT, label=f"{name}, same force")
    axes.plot(
        nodal[0],
        nodal[1] * MPA,
        ".",
        color=style.PATCH[1],
        ms=3.5,
        label=f"contact nodes, {100 * error:.1f} % rms",
    )
    axes.set_ylim(bottom=min(0.0, 1.05 * float(nodal[1].min()) * MPA))
    axes.set_ylim(top=1.28 * axes.get_ylim()[1])
    axes.legend(loc="upper right", ncols=1)


HALF_SPACE, HERTZ = style.CLOSED_FORMS[1], style.CLOSED_FORM
LINES: dict[str, Any] = {
    "half-space": {"color": HALF_SPACE, "lw": 3.5},
    "layer": {"color": style.PATCH[2], "lw": 1.0},
    "Hertz": {"color": HERTZ, "lw": 1.5, "ls": "--"},
}
NODES: dict[str, Any] = {"color": style.PATCH[1], "ms": 4.5, "ls": "", "marker": "o"}
MEANS: dict[str, Any] = {"mfc": "none", "mec": style.PATCH[2], "ms": 6.5, "ls": "", "marker": "s"}
OUTPUTS = 30  # of a run that are compared with half-spaces
BESIDE = ("nodes", "half-space")
AXES = ("longitudinal [mm]", "lateral [mm]")


def at_rest(record: Record) -> "Figure | None":
    """Outline and pressure of each patch at rest, Hertz and the half-space under the same force."""
    from workflow.theory.wheel_on_rail import at_rest as contact_at_rest

    patches = contact_at_rest(record)
    if not patches:
        return None
    fig = style.figure(style.PAGE, 0.4 + 2.7 * len(patches))
    rows = fig.subplots(len(patches), 3, squeeze=False)
    marks = iter("abcdef")
    for (plan, *panels), rest in zip(rows, patches, strict=True):
        at = rest.at
        middle = at[np.argmax(rest.pressure)]
        _plan(plan, rest, at, middle, next(marks))
        for k, axes in enumerate(panels):
            _line(axes, rest, at, middle, k)
            style.letter(axes, next(marks), f"{AXES[k].split()[0]} line")
        top = 1.05 * max(axes.get_ylim()[1] for axes in panels)
        for axes in panels:
            axes.set_ylim(0, top)
        panels[0].set_ylabel("pressure [MPa]")
    _legend(fig, any(rest.expected.hertz for rest in patches))
    return fig


def half_spaces(record: Record) -> "Figure | None":
    """Area and peak pressure of each patch of a rolling wheel, and those of half-spaces.

    The half-spaces have the drawn profiles as they stand at that time and the normal force found.
    Areas are those of ellipses of the same second moments of the pressure.
    """
    rolling = record.checked.rolling if record.wheel_on_rail else None
    if rolling is None or not rolling.speed or not record.contacts:
        return None
    from workflow.theory.wheel_on_rail import on_half_spaces, spread

    contact = next(iter(record.contacts.values()))
    outputs = spread([k for k, patches in enumerate(contact.patches) if patches], OUTPUTS)
    seen = [(t, patch) for t, patches in on_half_spaces(record, outputs) for patch in patches]
    if not seen:
        return None
    fig = style.figure(style.PAGE, 2.8)
    area, peak = fig.subplots(1, 2)
    scale, unit = style.prefixed(contact.t, "s")
    for place in sorted({patch.place for _, patch in seen}):
        there = [(t * scale, patch.found) for t, patch in seen if patch.place == place]
        t = [time for time, _ in there]
        for axes, k, factor in ((area, 3, 1e6), (peak, 0, MPA)):
            rows = {name: [found[name][k] * factor for _, found in there] for name in BESIDE}
            axes.plot(t, rows["half-space"], color=style.PATCH[place], lw=1.2)
            axes.plot(
                t, rows["nodes"], "o", color=style.PATCH[place], ms=3.5, label=f"patch {place}"
            )
    for axes, mark, title, label in (
        (area, "a", "contact area", "area [mm²]"),
        (peak, "b", "largest pressure", "pressure [MPa]"),
    ):
        style.letter(axes, mark, title)
        axes.set(xlabel=f"time [{unit}]", ylabel=label, ylim=(0, None))
    area.plot([], [], color=style.INK, lw=1.2, label="half-spaces, same force")
    fig.legend(*area.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return fig


def _plan(axes: "Axes", rest: "OnHalfSpaces", at: Array, middle: Array, mark: str) -> None:
    """Draw the outlines, and the nodes with the areas they stand for, dark under pressure."""
    from matplotlib.collections import PolyCollection

    e, half = rest.expected, rest.sides[:, None] / 2
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    cells = PolyCollection(list((at[:, None] + half * corners) * MM), alpha=0.8, lw=0)
    cells.set_array(rest.pressure * MPA)
    cells.set_cmap(style.COLOUR_MAP["pressure"])
    axes.add_collection(cells)
    touching = (e.half_space.pressure > 0).T.astype(float)
    axes.contour(e.x * MM, e.y * MM, touching, [0.5], colors=HALF_SPACE, linewidths=2)
    if e.hertz:
        turn = np.linspace(0, 2 * np.pi, 200)
        ring = np.array([e.hertz.a * np.cos(turn), e.hertz.b * np.sin(turn)])
        axes.plot(*ring * MM, **LINES["Hertz"])
    axes.plot(*at.T * MM, ".", color=style.INK, ms=2)
    axes.axhline(middle[1] * MM, color=style.FAINT, lw=0.6)
    axes.axvline(middle[0] * MM, color=style.FAINT, lw=0.6)
    axes.set(xlabel=AXES[0], ylabel=AXES[1])
    axes.autoscale_view()
    axes.grid(False)
    axes.figure.colorbar(cells, ax=axes, location="top", label="nodal pressure [MPa]", shrink=0.9)
    angle = np.degrees(rest.patch.contact_angle)
    force = rest.patch.normal_force / 1e3
    style.letter(axes, mark, f"{force:.1f} kN, {angle:.1f}°, {rest.error:.1%} rms")


def _line(axes: "Axes", rest: "OnHalfSpaces", at: Array, middle: Array, k: int) -> None:
    """Draw the pressures along axis ``k`` of the frame through a node."""
    e = rest.expected
    other = 1 - k
    row = np.abs(at[:, other] - middle[other]) < 0.4 * np.median(rest.sides[:, other])
    touching = (e.half_space.pressure > 0).any(axis=other)
    reach = np.append((e.x, e.y)[k][touching], at[row, k])
    line = np.zeros((400, 2))
    line[:, k] = np.linspace(reach.min() - 1e-3, reach.max() + 1e-3, len(line))
    line[:, other] = np.mean(at[row, other])
    axes.plot(line[:, k] * MM, e.pressure(line) * MPA, **LINES["half-space"])
    axes.plot(line[:, k] * MM, rest.softened.pressure(line) * MPA, **LINES["layer"])
    if e.hertz:
        axes.plot(line[:, k] * MM, e.hertz.pressure(*line.T) * MPA, **LINES["Hertz"])
    means = e.pressure(at[row], rest.sides[row])
    axes.plot(at[row, k] * MM, means * MPA, **MEANS)
    axes.plot(at[row, k] * MM, rest.pressure[row] * MPA, **NODES)
    axes.set_xlabel(AXES[k])


def _legend(fig: "Figure", hertz: bool) -> None:
    from matplotlib.lines import Line2D

    keys = [
        Line2D([], [], label="contact nodes", **NODES),
        Line2D([], [], label="half-space, as a node sees it", **MEANS),
        Line2D([], [], label="half-space of the profiles", **LINES["half-space"]),
        Line2D([], [], label="with a layer as soft as the penalty", **LINES["layer"]),
        Line2D([], [], label="Hertz", **LINES["Hertz"]),
    ]
    fig.legend(
        handles=keys[: 5 if hertz else 4], loc="outside lower center", ncols=3, columnspacing=1.2
    )
