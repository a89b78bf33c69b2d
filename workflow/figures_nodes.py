# SPDX-License-Identifier: LGPL-3.0-or-later
"""Where the nodes of wheel and rail lie in and around both patches, and the contact angles.

A row of surface nodes of each body is drawn, next to the plane through the middle of each patch.
"""

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from workflow import theme
from workflow.figures_section import in_plane, row, telling_output
from workflow.recorded import RAIL, Body, Patch, Record
from workflow.theme import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MM, MICRO = 1e3, 1e6
FACES = np.array(
    [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]
)
NEAR = 0.06  # cells that are looked at around a patch [m]
AROUND = 0.012  # nodes that are drawn around a patch [m]
BODIES = {False: ("wheel", "#3f6f9e", "o"), True: ("rail", "#8a6a2f", "s")}


def contact_nodes(record: Record) -> "Figure | None":
    """Nodes of wheel and rail through each patch when both bear most, and from their plane."""
    if not record.wheel_on_rail or not record.contacts or record.body is None:
        return None
    contact = next(iter(record.contacts.values()))
    k = telling_output(contact)
    patches, t = contact.patches[k], contact.t[k]
    points = record.body.points + record.displacement(t)
    rows = {place: _rows(record.body, points, patch) for place, patch in patches.items()}
    fig = theme.figure(theme.PAGE, 2.9)
    panels = fig.subplots(1, 1 + len(patches), width_ratios=(1.15, *[1] * len(patches)))
    for place, patch in patches.items():
        _angle(panels[0], patch, rows[place], place)
    panels[0].set(xlabel="lateral y [mm]", ylabel="height z [mm]", aspect="equal")
    panels[0].margins(0.08)
    panels[0].set_anchor("N")
    theme.letter(panels[0], "a", f"node coordinates, t = {t * 1e3:.2f} ms")
    for (place, patch), axes, mark in zip(patches.items(), panels[1:], "bc", strict=False):
        _unrolled(axes, patch, rows[place], place)
        theme.letter(axes, mark, f"patch {place}, x = {row(patch) * MM:.1f} mm")
    panels[1].set_ylabel("normal to the patch [µm]")
    _legend(fig)
    return fig


def surface_nodes(cells: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Return the nodes of the faces that only one of the hexahedra ``(c, 8)`` has."""
    faces = cells[:, FACES].reshape(-1, 4)
    _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True,
                                return_counts=True)  # fmt: skip
    return np.unique(faces[first[count == 1]])


def _rows(body: Body, points: Array, patch: Patch) -> dict[bool, Array]:
    """Return the nodes of wheel (False) and rail (True) next to the section of a patch."""
    away = np.linalg.norm(points[body.cells].mean(axis=1) - patch.centre, axis=1)
    on_rail, found = np.isin(body.regions, RAIL), {}
    for rail in BODIES:
        at = points[surface_nodes(body.cells[(away < NEAR) & (on_rail == rail)])]
        at = at[np.linalg.norm(at[:, 1:] - patch.centre[1:], axis=1) < AROUND]
        planes = np.unique(np.round(at[:, 0], 4))
        apart = np.median(np.diff(planes)[np.diff(planes) > 5e-4]) if len(planes) > 1 else 0.0
        found[rail] = at[np.abs(at[:, 0] - _nearest(at[:, 0], row(patch))) < 0.5 * apart + 1e-4]
    return found


def _nearest(x: Array, wanted: float) -> float:
    return float(x[np.argmin(np.abs(x - wanted))]) if len(x) else wanted


def _angle(axes: "Axes", patch: Patch, rows: dict[bool, Array], place: int) -> None:
    """Draw the rows of nodes in the track, and normal and contact angle of the patch."""
    for rail, (_, colour, marker) in BODIES.items():
        axes.plot(*rows[rail][:, 1:].T * MM, marker, color=colour, ms=2.4, mew=0)
    here = in_plane(patch)
    axes.plot(*patch.position[here, 1:].T * MM, "o", mfc="none", mec=theme.PATCH[place], ms=5)
    tangent = np.array([patch.direction[2], -patch.direction[1]])
    centre = patch.centre[1:] * MM
    ends = centre + 9 * np.outer([-1, 1], tangent / np.linalg.norm(tangent))
    axes.plot(*ends.T, color=theme.PATCH[place], lw=0.9)
    axes.plot(centre[0] + np.array([0, 9]), centre[[1, 1]], color=theme.INK, lw=0.6, ls=":")
    axes.text(
        centre[0] + 9.4, centre[1], f"{patch.angle:.1f}°",
        color=theme.PATCH[place], fontsize=7, weight="bold", va="center",
    )  # fmt: skip


def _unrolled(axes: "Axes", patch: Patch, rows: dict[bool, Array], place: int) -> None:
    """Draw the rows in the frame of the patch, heights over its plane in micrometres."""
    _, lateral, normal = patch.frame
    for rail, (_, colour, marker) in BODIES.items():
        rel = rows[rail] - patch.centre
        x, height = rel @ lateral * MM, rel @ normal * MICRO
        order = np.argsort(x)
        axes.plot(x[order], height[order], f"-{marker}", color=colour, ms=2.8, mew=0, lw=0.6)
    rel = patch.position[in_plane(patch)] - patch.centre
    x, height = rel @ lateral * MM, rel @ normal * MICRO
    axes.plot(x, height, "o", mfc="none", mec=theme.PATCH[place], ms=6)
    reach = max(1.6 * np.abs(x).max() + 2.5, 3.5)
    low = min(-0.5 * reach**2 / 13 * 1e3 * 0.5, height.min() - 20)
    axes.set(xlabel="lateral in the patch [mm]", xlim=(-reach, reach), ylim=(low, -0.5 * low))


def _legend(fig: "Figure") -> None:
    from matplotlib.lines import Line2D

    dot: dict[str, Any] = {"ls": ""}
    keys = [
        Line2D([], [], color=colour, marker=marker, ms=3, label=f"{name} nodes", **dot)
        for name, colour, marker in BODIES.values()
    ]
    keys += [
        Line2D([], [], mfc="none", mec=theme.PATCH[place], marker="o", ms=5, label=label, **dot)
        for place, label in ((1, "in contact, patch 1"), (2, "in contact, patch 2"))
    ]
    fig.legend(handles=keys, loc="outside lower center", ncols=len(keys))
