# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cross-section of wheel and rail through each contact patch, as cells and as nodes."""

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from meshes.arrays import Array
from workflow.figures import style
from workflow.figures.view3d import volume
from workflow.results.patch_nodes import PatchNodes
from workflow.results.record import RAIL, Body, Contact, Record

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MM = 1e3
NUDGE = 1e-6  # off the nodes of a body at rest, where cells would be cut along their faces [m]


def cross_section(record: Record) -> "Figure | None":
    """The deformed cells of wheel and rail cut across the track through each patch.

    Shown is the output at which the lesser of two patches bears most, or the last one in
    contact. Arrows are the directions of the normal resultants; the contact angle is theirs to
    the vertical.
    """
    if not record.wheel_on_rail or not record.contacts or record.body is None:
        return None
    contact = next(iter(record.contacts.values()))
    k = telling_output(contact)
    patches, t = contact.patches[k], contact.t[k]
    points = record.body.points + record.displacement(t)
    fig = style.figure(style.PAGE, 2.9)
    panels = np.atleast_1d(fig.subplots(1, 1 + len(patches)))
    first = next(iter(patches.values()))
    section(panels[0], record.body, points, row(first))
    overview(panels[0], patches)
    style.letter(panels[0], "a", f"t = {t * 1e3:.2f} ms, cut at x = {row(first) * MM:.1f} mm")
    panels[0].set_ylabel("height z [mm]")
    for (place, patch), axes, mark in zip(patches.items(), panels[1:], "bc", strict=False):
        section(axes, record.body, points, row(patch))
        close_up(axes, patch, place, mark)
    _legend(fig)
    return fig


def telling_output(contact: Contact) -> int:
    """Return the output where the lesser of two patches bears most, or the last one in contact."""
    if contact.two_points.any():
        lesser = np.minimum(*(contact.series(k, "normal_force") for k in (1, 2)))
        return int(np.argmax(np.where(contact.two_points, lesser, -np.inf)))
    return int(np.flatnonzero([len(p) > 0 for p in contact.patches])[-1])


def cut(body: Body, points: Array, x: float) -> list[tuple[bool, Array]]:
    """Return the polygons in which the plane at ``x`` [m] cuts the cells.

    Returns:
        For each polygon whether it is rail, and its corners (y, z), shape ``(k, 2)`` [m].
    """
    x += NUDGE
    along = points[body.cells, 0]
    hit = np.flatnonzero((along.min(axis=1) <= x) & (along.max(axis=1) > x))
    if not len(hit):
        return []
    grid = volume(body.cells[hit], points)
    grid.cell_data["rail"] = np.isin(body.regions[hit], RAIL).astype(np.int8)
    sliced: Any = grid.slice(normal="x", origin=(x, 0, 0), generate_triangles=False)
    corners = np.asarray(sliced.points)[:, 1:]
    return [
        (bool(rail), corners[polygon])
        for rail, polygon in zip(sliced["rail"], sliced.irregular_faces, strict=True)
    ]


def section(axes: "Axes", body: Body, points: Array, x: float) -> None:
    """Fill the section of wheel and rail at ``x`` [m], cells outlined."""
    from matplotlib.collections import PolyCollection

    polygons = cut(body, points, x)
    for rail, colour in ((False, style.WHEEL), (True, style.RAIL)):
        faces = [corners * MM for is_rail, corners in polygons if is_rail == rail]
        cells = PolyCollection(faces, facecolor=colour, edgecolor="#5a5a5a", lw=0.25)
        axes.add_collection(cells)
    axes.set(xlabel="lateral y [mm]", aspect="equal")
    axes.grid(False)


def overview(axes: "Axes", patches: dict[int, PatchNodes]) -> None:
    """Show the head of the rail and the windows on each patch."""
    from matplotlib.patches import Rectangle

    y, z = np.mean([p.centre[1:] for p in patches.values()], axis=0) * MM
    axes.set(xlim=(y - 30, y + 50), ylim=(z - 40, z + 40))
    for (place, patch), mark in zip(patches.items(), "bc", strict=False):
        colour, half = style.PATCH[place], window(patch)
        y, z = patch.centre[1:] * MM
        axes.plot(y, z, "o", color=colour, ms=3.5, mec="white", mew=0.4)
        corner = (y - half, z - half)
        axes.add_patch(Rectangle(corner, 2 * half, 2 * half, fill=False, ec=colour, lw=0.9))
        axes.text(y + half + 1, z - half, mark, color=colour, fontweight="bold", va="bottom")


def close_up(axes: "Axes", patch: PatchNodes, place: int, mark: str) -> None:
    """Mark contact nodes, normal and contact angle of a patch on its section."""
    x, (y, z) = row(patch) * MM, patch.centre[1:] * MM
    half = window(patch)
    axes.set(xlim=(y - half, y + half), ylim=(z - half, z + half))
    colour, at = style.PATCH[place], patch.position[:, 1:] * MM
    here = in_plane(patch)
    axes.plot(*at[~here].T, "o", ms=2.5, mfc="none", mec=colour, mew=0.7)
    axes.plot(*at[here].T, "o", ms=3.5, color=colour, mec="white", mew=0.4)
    _angle(axes, patch, 0.72 * half, colour)
    text = (
        f"contact angle {np.degrees(patch.contact_angle):.1f}°\n"
        f"normal force {patch.normal_force / 1e3:.1f} kN\n"
        f"{len(at)} node{'s' * (len(at) > 1)}, {patch.area * 1e6:.0f} mm²"
    )
    box = {"facecolor": "white", "edgecolor": colour, "lw": 0.6, "alpha": 0.9, "pad": 2.5}
    axes.text(0.97, 0.03, text, transform=axes.transAxes, fontsize=6, ha="right", bbox=box)
    axes.locator_params(nbins=5, steps=[1, 2, 5, 10])
    style.letter(axes, mark, f"patch {place}, cut at x = {x:.1f} mm")


def row(patch: PatchNodes) -> float:
    """Return the position x of the row of nodes next to the centre of a patch [m]."""
    x = patch.position[:, 0]
    return float(x[np.argmin(np.abs(x - patch.centre[0]))])


def in_plane(patch: PatchNodes) -> npt.NDArray[np.bool_]:
    """Tell which nodes lie within half a cell of the plane of the section."""
    half_cell = np.sqrt(np.median(patch.areas)) / 2
    return np.asarray(np.abs(patch.position[:, 0] - row(patch)) <= half_cell)


def window(patch: PatchNodes) -> float:
    """Return half the width of a window that shows a patch with its surroundings [mm]."""
    reach = np.abs(patch.position[:, 1:] - patch.centre[1:]).max() * MM
    return float(np.clip(1.6 * reach + 3, 6, 20))


def _angle(axes: "Axes", patch: PatchNodes, length: float, colour: str) -> None:
    """Draw the normal of a patch and its angle from the vertical."""
    from matplotlib.patches import Arc

    centre = patch.centre[1:] * MM
    normal = patch.direction[1:] / np.linalg.norm(patch.direction[1:])
    y, z = centre
    axes.plot([y, y], [z, z + length], color=style.INK, ls=":", lw=0.8)
    arrow = {"arrowstyle": "-|>", "color": colour, "lw": 1.4, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", tuple(centre + length * normal), (y, z), arrowprops=arrow)
    turn = float(np.degrees(np.arctan2(normal[1], normal[0])))
    low, high = sorted((turn, 90.0))
    size = 1.1 * length
    axes.add_patch(Arc((y, z), size, size, theta1=low, theta2=high, color=style.INK, lw=0.8))


def _legend(fig: "Figure") -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch as Swatch

    dot: dict[str, Any] = {"marker": "o", "ls": "", "color": style.INK}
    keys = [
        Swatch(facecolor=style.WHEEL, edgecolor="#5a5a5a", lw=0.4, label="wheel"),
        Swatch(facecolor=style.RAIL, edgecolor="#5a5a5a", lw=0.4, label="rail"),
        Line2D([], [], ms=3.5, label="contact nodes in the section", **dot),
        Line2D([], [], ms=3, mfc="none", label="contact nodes before and behind", **dot),
        Line2D([], [], color=style.INK, lw=1.4, label="contact normal"),
    ]
    fig.legend(handles=keys, loc="outside lower center", ncols=len(keys))


MM, MICRO = 1e3, 1e6
FACES = np.array(
    [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]
)
NEAR = 0.06  # cells that are looked at around a patch [m]
AROUND = 0.012  # nodes that are drawn around a patch [m]
BODIES = {False: ("wheel", "#3f6f9e", "o"), True: ("rail", "#8a6a2f", "s")}


def contact_nodes(record: Record) -> "Figure | None":
    """Coordinates of the surface nodes of wheel and rail next to the section through each patch.

    (a) In the track, with the tangent of each patch and its angle to the horizontal. (b, c) In
    the frame of each patch, heights stretched: nodes in contact lie on, or by the penetration
    below, the facets of the other body.
    """
    if not record.wheel_on_rail or not record.contacts or record.body is None:
        return None
    contact = next(iter(record.contacts.values()))
    k = telling_output(contact)
    patches, t = contact.patches[k], contact.t[k]
    points = record.body.points + record.displacement(t)
    rows = {place: _rows(record.body, points, patch) for place, patch in patches.items()}
    fig = style.figure(style.PAGE, 2.9)
    panels = fig.subplots(1, 1 + len(patches), width_ratios=(1.15, *[1] * len(patches)))
    for place, patch in patches.items():
        _mark_angle(panels[0], patch, rows[place], place)
    panels[0].set(xlabel="lateral y [mm]", ylabel="height z [mm]", aspect="equal")
    panels[0].margins(0.08)
    panels[0].set_anchor("N")
    style.letter(panels[0], "a", f"node coordinates, t = {t * 1e3:.2f} ms")
    for (place, patch), axes, mark in zip(patches.items(), panels[1:], "bc", strict=False):
        _unrolled(axes, patch, rows[place], place)
        style.letter(axes, mark, f"patch {place}, x = {row(patch) * MM:.1f} mm")
    panels[1].set_ylabel("normal to the patch [µm]")
    _node_legend(fig)
    return fig


def surface_nodes(cells: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Return the nodes of the faces that only one of the hexahedra ``(c, 8)`` has."""
    faces = cells[:, FACES].reshape(-1, 4)
    _, first, count = np.unique(
        np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True
    )
    return np.unique(faces[first[count == 1]])


def _rows(body: Body, points: Array, patch: PatchNodes) -> dict[bool, Array]:
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


def _mark_angle(axes: "Axes", patch: PatchNodes, rows: dict[bool, Array], place: int) -> None:
    """Draw the rows of nodes in the track, and normal and contact angle of the patch."""
    for rail, (_, colour, marker) in BODIES.items():
        axes.plot(*rows[rail][:, 1:].T * MM, marker, color=colour, ms=2.4, mew=0)
    here = in_plane(patch)
    axes.plot(*patch.position[here, 1:].T * MM, "o", mfc="none", mec=style.PATCH[place], ms=5)
    tangent = np.array([patch.direction[2], -patch.direction[1]])
    centre = patch.centre[1:] * MM
    ends = centre + 9 * np.outer([-1, 1], tangent / np.linalg.norm(tangent))
    axes.plot(*ends.T, color=style.PATCH[place], lw=0.9)
    axes.plot(centre[0] + np.array([0, 9]), centre[[1, 1]], color=style.INK, lw=0.6, ls=":")
    axes.text(
        centre[0] + 9.4,
        centre[1],
        f"{np.degrees(patch.contact_angle):.1f}°",
        color=style.PATCH[place],
        fontsize=7,
        weight="bold",
        va="center",
    )


def _unrolled(axes: "Axes", patch: PatchNodes, rows: dict[bool, Array], place: int) -> None:
    """Draw the rows in the frame of the patch, heights over its plane in micrometres."""
    _, lateral, normal = patch.frame
    for rail, (_, colour, marker) in BODIES.items():
        rel = rows[rail] - patch.centre
        x, height = rel @ lateral * MM, rel @ normal * MICRO
        order = np.argsort(x)
        axes.plot(x[order], height[order], f"-{marker}", color=colour, ms=2.8, mew=0, lw=0.6)
    rel = patch.position[in_plane(patch)] - patch.centre
    x, height = rel @ lateral * MM, rel @ normal * MICRO
    axes.plot(x, height, "o", mfc="none", mec=style.PATCH[place], ms=6)
    reach = max(1.6 * np.abs(x).max() + 2.5, 3.5)
    low = min(-0.5 * reach**2 / 13 * 1e3 * 0.5, height.min() - 20)
    axes.set(xlabel="lateral in the patch [mm]", xlim=(-reach, reach), ylim=(low, -0.5 * low))


def _node_legend(fig: "Figure") -> None:
    from matplotlib.lines import Line2D

    dot: dict[str, Any] = {"ls": ""}
    keys = [
        Line2D([], [], color=colour, marker=marker, ms=3, label=f"{name} nodes", **dot)
        for name, colour, marker in BODIES.values()
    ]
    keys += [
        Line2D([], [], mfc="none", mec=style.PATCH[place], marker="o", ms=5, label=label, **dot)
        for place, label in ((1, "in contact, patch 1"), (2, "in contact, patch 2"))
    ]
    fig.legend(handles=keys, loc="outside lower center", ncols=len(keys))
