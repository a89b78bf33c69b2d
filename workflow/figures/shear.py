# SPDX-License-Identifier: LGPL-3.0-or-later
"""Adhesion and slip, stresses on the centre line and shear vectors of the patches that roll.

Patches are drawn in their own tangent plane: longitudinal to the right, lateral up, from the centre
of the normal force. Stresses are those on the lower body, nodal forces over tributary areas.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from workflow.figures import style
from workflow.figures.footprint import boxes
from workflow.results.patch_nodes import PatchNodes
from workflow.results.record import Contact, Record

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

MM = 1e3
MPA = 1e-6
PANELS = 4  # outputs side by side, and one of rolling on one patch
FEWEST = 3  # nodes of a patch worth drawing
FINE = 60  # nodes of a patch of fine cells
OTHER_NAME = {1: "contact patch", 2: "steep patch"}


def adhesion(record: Record) -> "Figure | None":
    """Nodes of each patch in its tangent plane, each as a rectangle of its tributary area.

    A node adheres if friction × normal force less tangential force exceeds ε, the given part of
    the largest nodal tangential force of the output. Times: the last output before a second
    patch, and the first, middle and last with two; with one patch, four over the run.
    """
    contact = rolling_contact(record)
    if contact is None:
        return None
    tolerance = stick_tolerance(record)

    def draw(axes: "Axes", place: int, patches: dict[int, PatchNodes]) -> None:
        patch = patches[place]
        _cells(axes, patch, [style.ADHESION if s else style.SLIP for s in patch.stick])
        largest = max(np.linalg.norm(p.tangential_forces, axis=1).max() for p in patches.values())
        adhering = f"{patch.stick.sum()} of {len(patch.stick)} adhere"
        _note(axes, f"{adhering}, ε {tolerance * largest:.0f} N")

    fig = _panels(record, contact, draw)
    colours = {"adhesion": style.ADHESION, "slip": style.SLIP}
    keys = [_key(name, color=c, marker="s", ls="") for name, c in colours.items()]
    about = f"slip: friction × normal − shear < ε, {100 * tolerance:g} % of the largest shear force"
    _legend(fig, keys, about)
    return fig


def shear_vectors(record: Record) -> "Figure | None":
    """Shear stress on the lower body at each node of the patches, in their tangent planes.

    θ is the angle of the mean to the negative longitudinal axis.
    """
    contact = rolling_contact(record)
    if contact is None:
        return None
    scale = {place: arrow_scale(contact, place) for place in style.PATCH}
    keyless = set(scale)

    def draw(axes: "Axes", place: int, patches: dict[int, PatchNodes]) -> None:
        patch, (unit, key) = patches[place], scale[place]
        _cells(axes, patch, ["#e6e6e6"] * len(patch.areas))
        x, y = patch.local.T * MM
        arrows = axes.quiver(
            x,
            y,
            *(patch.shear.T * MPA),
            angles="xy",
            scale_units="xy",
            scale=unit,
            color=style.INK,
            units="inches",
            width=0.012,
            headwidth=3.6,
            headlength=4.2,
            zorder=3,
        )
        mean = np.hypot(patch.longitudinal_shear, patch.lateral_shear) * MPA
        _note(axes, f"θ {np.degrees(patch.shear_angle):.0f}°, mean {mean:.0f} MPa")
        if place in keyless:
            keyless.remove(place)
            axes.quiverkey(arrows, 0.84, 0.12, key, f"{key:g} MPa", labelpos="W", **_KEY)

    fig = _panels(record, contact, draw)
    _legend(fig, [], "θ: from the negative longitudinal axis to the mean shear")
    return fig


_KEY: dict[str, Any] = {"fontproperties": {"size": 6}, "labelsep": 0.04}


def centre_line(record: Record) -> "Figure | None":
    """Pressure, friction × pressure and shear stress at nodes of a longitudinal row of each patch.

    The row is the one next to the centre of the patch. Where shear meets friction × pressure
    the surfaces slip. Stress is nodal force over tributary area.
    """
    contact = rolling_contact(record)
    if contact is None:
        return None
    limit: dict[str, Any] = {"color": style.SLIP, "lw": 3.2, "solid_capstyle": "round"}

    def draw(axes: "Axes", place: int, patches: dict[int, PatchNodes]) -> None:
        patch = patches[place]
        line = centre_row(patch)
        x, pressure = patch.local[line, 0] * MM, patch.pressure[line] * MPA
        shear, stick = np.linalg.norm(patch.shear, axis=1)[line] * MPA, patch.stick[line]
        axes.plot(x, pressure, color=style.FAINT, marker="o", ms=2.6)
        axes.plot(x, patch.friction[line] * pressure, **limit)
        axes.plot(x, shear, color=style.ADHESION)
        axes.plot(x[stick], shear[stick], **_MARK, mfc=style.ADHESION)
        axes.plot(x[~stick], shear[~stick], **_MARK, mfc="white")

    fig = _panels(record, contact, draw, plane=False)
    keys = [
        _key("pressure", color=style.FAINT, marker="o", ms=2.6),
        _key("friction × pressure", **limit),
        _key("shear stress", color=style.ADHESION),
        _key("node that adheres", **_MARK, mfc=style.ADHESION),
        _key("that slips", **_MARK, mfc="white"),
    ]
    _legend(fig, keys, "row of nodes next to the centre")
    return fig


_MARK: dict[str, Any] = {"ls": "", "marker": "o", "ms": 3.6, "mec": style.ADHESION, "zorder": 3}


def arrow_scale(contact: Contact, place: int) -> tuple[float, float]:
    """Return stress per length of arrow [MPa/mm] and the stress of a key [MPa] for one place.

    The longest arrow of all moments spans two cells, or a fifth of the length of the patches.
    """
    shown = [patches[place] for _, patches in moments(contact) if place in patches]
    largest = max((float(np.linalg.norm(p.shear, axis=1).max()) for p in shown), default=1.0) * MPA
    cell = float(np.median([np.sqrt(np.median(p.areas)) for p in shown] or [1e-3])) * MM
    length = max((float(np.ptp(p.local[:, 0])) for p in shown), default=0.0) * MM
    decade = 10.0 ** np.floor(np.log10(max(largest, 1e-12)))
    key = max(k for k in (1.0, 2.0, 5.0) if k * decade <= largest) * decade
    return max(largest, 1e-12) / max(2 * cell, 0.2 * length), float(key)


def rolling_contact(record: Record) -> Contact | None:
    """Return the contact of a scene in which something rolls and shear is passed on, or None."""
    rolls = record.scene.get("rolling") or record.scene.get("driven")
    if not rolls or not record.contacts:
        return None
    contact = next(iter(record.contacts.values()))
    sheared = [p.tangential_force > 0 for patches in contact.patches for p in patches.values()]
    return contact if any(sheared) and moments(contact) else None


def stick_tolerance(record: Record) -> float:
    """Return the tolerance of adhesion, a part of the largest tangential nodal force [-]."""
    name = next(iter(record.contacts))
    return float(record.scene["contacts"][name].get("stick_tolerance", 0.05))


def moments(contact: Contact) -> list[tuple[float, dict[int, PatchNodes]]]:
    """Return time and patches of the outputs to show.

    Those are a third of the way to the birth of a second patch, the last before it, and the first,
    middle and last with two; or, where there is one patch only, four spread over the run. Patches
    of a few nodes do not count.
    """
    outputs = [
        (float(t), {k: p for k, p in patches.items() if len(p.areas) >= FEWEST})
        for t, patches in zip(contact.t, contact.patches, strict=True)
    ]
    two = [k for k, (_, patches) in enumerate(outputs) if len(patches) == 2]
    one = [k for k, (_, patches) in enumerate(outputs) if len(patches) == 1]
    if two:
        before = [k for k in one if 0 < k < two[0]] or [k for k in one if k < two[0]]
        before = [before[len(before) // 3], before[-1]] if before else []
        chosen = [*before, *(two[round(i * (len(two) - 1) / 2)] for i in range(PANELS - 1))]
    else:
        last = one[1:] or one  # the first is at rest
        chosen = (
            [last[round(i * (len(last) - 1) / (PANELS - 1))] for i in range(PANELS)] if one else []
        )
    return [outputs[k] for k in sorted(set(chosen))]


def centre_row(patch: PatchNodes) -> npt.NDArray[np.int64]:
    """Return the nodes of the longitudinal row next to the centre, from the rear to the front."""
    half = 0.5 * np.sqrt(np.median(patch.areas))
    x, y = patch.local.T
    rows = [np.flatnonzero(np.abs(y - level) < half) for level in y]
    # the row with most nodes of those within half a cell of the centre, then the nearest one
    near = [k for k, row in enumerate(rows) if abs(y[row].mean()) <= 1.01 * half] or range(len(y))
    best = max(near, key=lambda k: (len(rows[k]), -abs(y[rows[k]].mean())))
    line: list[int] = []
    for k in rows[best][np.argsort(np.abs(y[rows[best]] - y[best]), kind="stable")]:
        if (np.abs(x[line] - x[k]) > half).all():  # rows may lie closer than half a cell
            line.append(int(k))
    return np.array(sorted(line, key=lambda k: float(x[k])), dtype=np.int64)


def _panels(
    record: Record, contact: Contact, draw: Callable[..., None], plane: bool = True
) -> "Figure":
    """Return panels: a row for each place, gauge corner below, a column for each moment."""
    shown = moments(contact)
    places = sorted({k for _, patches in shown for k in patches})
    limits = {k: _limits([p[k] for _, p in shown if k in p]) for k in places}
    heights = [_height(limits[k], len(shown)) if plane else 1.5 for k in places]
    fig = style.figure(style.PAGE, sum(heights) + 0.45 * len(places) + 0.6)
    panels = fig.subplots(
        len(places), len(shown), sharex="row", sharey="row", squeeze=False, height_ratios=heights
    )
    scale, unit = style.prefixed(contact.t, "s")
    names = style.PATCH_NAME if record.wheel_on_rail else OTHER_NAME
    for k, (row, place) in enumerate(zip(panels, places, strict=True)):
        for axes, (t, patches) in zip(row, shown, strict=True):
            if k == 0:
                axes.set_title(f"t = {t * scale:.2f} {unit}", pad=14 if plane else 6)
            if place in patches:
                draw(axes, place, patches)
            else:
                axes.text(0.5, 0.5, "no contact", transform=axes.transAxes, **_ABSENT)
        name = names[place].replace(", ", "\n") if plane else names[place]
        row[0].set_ylabel(f"{name}\n{'lateral [mm]' if plane else 'stress [MPa]'}")
        (left, right), (low, high) = limits[place]
        row[0].set_xlim(left, right)
        if plane:
            row[0].set_ylim(low, high)
            for axes in row:
                axes.set_aspect("equal", adjustable="box")
                axes.grid(False)
        else:
            row[0].set_ylim(bottom=0)
    for axes in panels[-1]:
        axes.set_xlabel("longitudinal [mm]")
    return fig


_ABSENT: dict[str, Any] = {"ha": "center", "va": "center", "color": style.FAINT, "fontsize": 7}


def _limits(patches: list[PatchNodes]) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return limits for all patches of a row [mm], with room for arrows beyond the cells."""
    corners = np.vstack([boxes(p.local, p.areas).reshape(-1, 2) for p in patches]) * MM
    (left, low), (right, high) = corners.min(axis=0), corners.max(axis=0)
    edge = 0.06 * (right - left)
    return (left - edge, right + edge), (low - 2 * edge, high + edge)


def _height(limits: tuple[tuple[float, float], tuple[float, float]], columns: int) -> float:
    """Return the height of a panel whose axes are equal [inch]."""
    (left, right), (low, high) = limits
    return (style.PAGE - 0.7) / columns * 0.92 * (high - low) / (right - left)


def _cells(axes: "Axes", patch: PatchNodes, colours: list[str]) -> None:
    """Draw each node as a rectangle of its tributary area, as long as rows are spaced."""
    from matplotlib.collections import PolyCollection

    faces = list(boxes(patch.local, patch.areas) * MM)
    width = 0.6 if len(faces) < FINE else 0.2  # fine cells would be all edge
    axes.add_collection(
        PolyCollection(faces, facecolors=colours, edgecolors="white", linewidths=width)
    )
    axes.plot(0, 0, "+", color=style.INK, ms=5, mew=0.7)


def _note(axes: "Axes", text: str) -> None:
    """Put a line above a panel."""
    axes.text(0.0, 1.02, text, transform=axes.transAxes, ha="left", va="bottom", fontsize=6.5)


def _key(name: str, **style: Any) -> "Line2D":
    from matplotlib.lines import Line2D

    return Line2D([], [], label=name, **style)


def _legend(fig: "Figure", keys: "list[Line2D]", about: str) -> None:
    about = f"{about}; the wheel rolls to the right"
    fig.legend(
        handles=keys or [_key("", ls="")],
        title=about,
        title_fontsize=7,
        loc="outside lower center",
        ncols=max(len(keys), 1),
    )
