# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cross-section of wheel and rail through both contact patches."""

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from workflow import theme
from workflow.figures_view import volume
from workflow.recorded import RAIL, Body, Contact, Patch, Record
from workflow.theme import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MM = 1e3
NUDGE = 1e-6  # off the nodes of a body at rest, where cells would be cut along their faces [m]


def cross_section(record: Record) -> "Figure | None":
    """Deformed wheel and rail cut through each patch when both bear most.

    With one patch only, the last output in contact is drawn.
    """
    if not record.wheel_on_rail or not record.contacts or record.body is None:
        return None
    contact = next(iter(record.contacts.values()))
    k = telling_output(contact)
    patches, t = contact.patches[k], contact.t[k]
    points = record.body.points + record.displacement(t)
    fig = theme.figure(theme.PAGE, 2.9)
    panels = np.atleast_1d(fig.subplots(1, 1 + len(patches)))
    first = next(iter(patches.values()))
    section(panels[0], record.body, points, row(first))
    overview(panels[0], patches)
    theme.letter(panels[0], "a", f"t = {t * 1e3:.2f} ms, cut at x = {row(first) * MM:.1f} mm")
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
    for rail, colour in ((False, theme.WHEEL), (True, theme.RAIL)):
        faces = [corners * MM for is_rail, corners in polygons if is_rail == rail]
        cells = PolyCollection(faces, facecolor=colour, edgecolor="#5a5a5a", lw=0.25)
        axes.add_collection(cells)
    axes.set(xlabel="lateral y [mm]", aspect="equal")
    axes.grid(False)


def overview(axes: "Axes", patches: dict[int, Patch]) -> None:
    """Show the head of the rail and the windows on each patch."""
    from matplotlib.patches import Rectangle

    y, z = np.mean([p.centre[1:] for p in patches.values()], axis=0) * MM
    axes.set(xlim=(y - 30, y + 50), ylim=(z - 40, z + 40))
    for (place, patch), mark in zip(patches.items(), "bc", strict=False):
        colour, half = theme.PATCH[place], window(patch)
        y, z = patch.centre[1:] * MM
        axes.plot(y, z, "o", color=colour, ms=3.5, mec="white", mew=0.4)
        corner = (y - half, z - half)
        axes.add_patch(Rectangle(corner, 2 * half, 2 * half, fill=False, ec=colour, lw=0.9))
        axes.text(y + half + 1, z - half, mark, color=colour, fontweight="bold", va="bottom")


def close_up(axes: "Axes", patch: Patch, place: int, mark: str) -> None:
    """Mark contact nodes, normal and contact angle of a patch on its section."""
    x, (y, z) = row(patch) * MM, patch.centre[1:] * MM
    half = window(patch)
    axes.set(xlim=(y - half, y + half), ylim=(z - half, z + half))
    colour, at = theme.PATCH[place], patch.position[:, 1:] * MM
    here = in_plane(patch)
    axes.plot(*at[~here].T, "o", ms=2.5, mfc="none", mec=colour, mew=0.7)
    axes.plot(*at[here].T, "o", ms=3.5, color=colour, mec="white", mew=0.4)
    _angle(axes, patch, 0.72 * half, colour)
    text = (
        f"contact angle {patch.angle:.1f}°\n"
        f"normal force {patch.normal_force / 1e3:.1f} kN\n"
        f"{len(at)} node{'s' * (len(at) > 1)}, {patch.area * 1e6:.0f} mm²"
    )
    box = {"facecolor": "white", "edgecolor": colour, "lw": 0.6, "alpha": 0.9, "pad": 2.5}
    axes.text(0.97, 0.03, text, transform=axes.transAxes, fontsize=6, ha="right", bbox=box)
    axes.locator_params(nbins=5, steps=[1, 2, 5, 10])
    theme.letter(axes, mark, f"patch {place}, cut at x = {x:.1f} mm")


def row(patch: Patch) -> float:
    """Return the position x of the row of nodes next to the centre of a patch [m]."""
    x = patch.position[:, 0]
    return float(x[np.argmin(np.abs(x - patch.centre[0]))])


def in_plane(patch: Patch) -> npt.NDArray[np.bool_]:
    """Tell which nodes lie within half a cell of the plane of the section."""
    half_cell = np.sqrt(np.median(patch.areas)) / 2
    return np.asarray(np.abs(patch.position[:, 0] - row(patch)) <= half_cell)


def window(patch: Patch) -> float:
    """Return half the width of a window that shows a patch with its surroundings [mm]."""
    reach = np.abs(patch.position[:, 1:] - patch.centre[1:]).max() * MM
    return float(np.clip(1.6 * reach + 3, 6, 20))


def _angle(axes: "Axes", patch: Patch, length: float, colour: str) -> None:
    """Draw the normal of a patch and its angle from the vertical."""
    from matplotlib.patches import Arc

    centre = patch.centre[1:] * MM
    normal = patch.direction[1:] / np.linalg.norm(patch.direction[1:])
    y, z = centre
    axes.plot([y, y], [z, z + length], color=theme.INK, ls=":", lw=0.8)
    arrow = {"arrowstyle": "-|>", "color": colour, "lw": 1.4, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", tuple(centre + length * normal), (y, z), arrowprops=arrow)
    turn = float(np.degrees(np.arctan2(normal[1], normal[0])))
    low, high = sorted((turn, 90.0))
    size = 1.1 * length
    axes.add_patch(Arc((y, z), size, size, theta1=low, theta2=high, color=theme.INK, lw=0.8))


def _legend(fig: "Figure") -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch as Swatch

    dot: dict[str, Any] = {"marker": "o", "ls": "", "color": theme.INK}
    keys = [
        Swatch(facecolor=theme.WHEEL, edgecolor="#5a5a5a", lw=0.4, label="wheel"),
        Swatch(facecolor=theme.RAIL, edgecolor="#5a5a5a", lw=0.4, label="rail"),
        Line2D([], [], ms=3.5, label="contact nodes in the section", **dot),
        Line2D([], [], ms=3, mfc="none", label="contact nodes before and behind", **dot),
        Line2D([], [], color=theme.INK, lw=1.4, label="contact normal"),
    ]
    fig.legend(handles=keys, loc="outside lower center", ncols=len(keys))
