# SPDX-License-Identifier: LGPL-3.0-or-later
"""The mesh of a run, coloured by region, as a whole and close up."""

from typing import TYPE_CHECKING, Any

import numpy as np

from meshes.arrays import Array
from meshes.tags import Tag
from workflow.figures import style
from workflow.figures.view3d import Frame, add_regions, halved, mesh_picture
from workflow.results.record import RAIL, Body, Record

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

OBLIQUE = (0.75, -1.0, 0.5)
WHOLE = (0.45, -1.0, 0.3)
AHEAD = (1.0, -0.3, 0.12)
TRACK = (*RAIL, Tag.SLEEPER)
SEAT = (1.0, -0.12, 0.12)
BESIDE = 0.45  # rail shown before and behind the wheel centre [m]
CLOSE = 0.045  # half size of the close-up [m]


def model(record: Record) -> "Figure | None":
    """The mesh as computed, coloured by region.

    For a wheel on a rail the whole model, the wheelset on the rail, a cut at the contact with
    its cells, and the rail seat. Positions are those before any load.
    """
    body = record.body
    if body is None:
        return None
    if record.wheel_on_rail:
        rolling = record.scene.get("rolling", {})
        fig = wheel_on_rail(body, rolling.get("angle_of_attack", 0.0))
    else:
        fig = whole(body)
    _legend(fig, body)
    return fig


def whole(body: Body) -> "Figure":
    """Return a figure of the whole mesh with its edges."""
    frame, image = mesh_picture(body, OBLIQUE, 2800)
    fig = style.figure(style.PAGE, min(style.PAGE * frame.height / frame.width, 5.0) + 0.5)
    axes = fig.subplots()
    frame.show(axes, image)
    size = np.ptp(body.points[np.unique(body.cells)], axis=0)
    scale, unit = style.prefixed(size, "m")
    extent = " × ".join(f"{length * scale:.4g}" for length in size)
    axes.set_title(f"{_count(body)}, {extent} {unit}")
    return fig


def wheel_on_rail(body: Body, yaw: float) -> "Figure":
    """Return the whole model, the wheel on a stretch of track, the cut contact zone, and a seat.

    Args:
        body: Mesh.
        yaw: Angle of attack of the wheel [rad].
    """
    frame, image = mesh_picture(body, WHOLE, 2800, edges=False)
    sleepers = bool((body.regions == Tag.SLEEPER).any())
    heights = (style.PAGE * min(frame.height / frame.width, 0.4), 3.9, 2.3)[: 2 + sleepers]
    fig = style.figure(style.PAGE, sum(heights) + 0.6)
    mosaic = "aa;bc;dd" if sleepers else "aa;bc"
    panels = fig.subplot_mosaic(mosaic, height_ratios=heights, width_ratios=(1, 1.15))
    frame.show(panels["a"], image)
    style.letter(panels["a"], "a", f"whole model: {_count(body)}")
    focus, centre = contact_point(body), body.centres
    wheel = ~np.isin(body.regions, TRACK)
    near = body.part(wheel | (np.abs(centre[:, 0] - focus[0]) < BESIDE))
    frame, image = mesh_picture(near, OBLIQUE, 1600)
    frame.show(panels["b"], image)
    style.letter(panels["b"], "b", "wheelset half on the rail")
    _contact_zone(panels["c"], body, yaw, focus)
    if sleepers:
        _seat(panels["d"], body, focus)
    return fig


def contact_point(body: Body) -> Array:
    """Return the point of the wheel nearest above the rail head, shape ``(3,)`` [m]."""
    from scipy.spatial import cKDTree

    head = body.points[np.unique(body.cells[body.regions == Tag.RAIL_HEAD])]
    tyre = body.points[np.unique(body.cells[body.regions == Tag.TYRE])]
    reach = tyre[tyre[:, 2] < head[:, 2].max() + 0.02]
    distance, _ = cKDTree(head).query(reach)
    return np.asarray(reach[np.argmin(distance)])


def _contact_zone(axes: "Axes", body: Body, yaw: float, focus: Array) -> None:
    """Show what lies behind the contact: the rail cut across, the wheel along its axle."""
    head = body.points[np.unique(body.cells[body.regions == Tag.RAIL_HEAD])]
    tyre = body.points[np.unique(body.cells[body.regions == Tag.TYRE])]
    hub = (tyre.min(axis=0) + tyre.max(axis=0)) / 2
    rail, ahead = np.isin(body.regions, RAIL), np.array([np.cos(yaw), np.sin(yaw), 0.0])
    wheel = ~np.isin(body.regions, TRACK)
    middle = np.array([focus[0], head[:, 1].mean() - CLOSE / 4, focus[2]])
    near = np.linalg.norm(body.centres - middle, axis=1) < 8 * CLOSE
    halves = (
        halved(body.part(rail & near), (focus, np.array([1.0, 0.0, 0.0]))),
        halved(body.part(wheel & near), (hub, ahead)),
    )
    frame = Frame.around(middle + CLOSE * np.array([[0, -1, -1], [0, 1, 1]]), AHEAD)

    def fill(view: Any) -> None:
        for half in halves:
            add_regions(view, half)

    frame.show(axes, frame.render(1800, fill))
    style.letter(axes, "c", f"cut at the contact, {frame.width * 1e3:.0f} mm wide")


def _seat(axes: "Axes", body: Body, focus: Array) -> None:
    """Show rail and sleeper nearest to the contact, both cut across the rail at the seat."""
    centre, sleeper = body.centres, np.flatnonzero(body.regions == Tag.SLEEPER)
    near = sleeper[np.argmin(np.abs(centre[sleeper, 0] - focus[0]))]
    mine = sleeper[np.abs(centre[sleeper, 0] - centre[near, 0]) < BESIDE / 2]
    x = centre[mine, 0].mean()
    track = np.isin(body.regions, TRACK) & (np.abs(centre[:, 0] - x) < BESIDE / 2)
    part = body.part(track)
    half = halved(part, (np.array([x, 0.0, 0.0]), np.array([1.0, 0.0, 0.0])))
    low, high = part.points[part.cells].min(axis=(0, 1)), part.points[part.cells].max(axis=(0, 1))
    frame = Frame.around(np.array([[x, *low[1:]], [x, *high[1:]], [low[0], *high[1:]]]), SEAT)
    frame.show(axes, frame.render(2400, lambda view: add_regions(view, half)))
    style.letter(axes, "d", "cut through a seat: pads are springs and dampers in the gap")


def _count(body: Body) -> str:
    cells, nodes = (f"{n:,}".replace(",", " ") for n in (len(body.cells), len(body.points)))
    return f"{cells} cells, {nodes} nodes"


def _legend(fig: "Figure", body: Body) -> None:
    from matplotlib.patches import Patch

    keys = [
        Patch(
            facecolor=style.region(region),
            edgecolor=style.INK,
            lw=0.4,
            label=body.names.get(region, str(region)).replace("_", " "),
        )
        for region in map(int, np.unique(body.regions))
    ]
    fig.legend(handles=keys, loc="outside lower center", ncols=len(keys))
