# SPDX-License-Identifier: LGPL-3.0-or-later
"""Footprints on the rail at successive outputs, from the gauge side and developed."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial import cKDTree

from meshes.arrays import Array
from meshes.tags import Tag
from workflow.figures import style
from workflow.figures.view3d import EDGE, Frame, halved, surface
from workflow.results.patch_nodes import STEEP, PatchNodes
from workflow.results.record import Body, Contact, Record

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MM = 1e3
OBLIQUE = (-0.55, -1.0, 0.85)  # from where the rail is seen
LIFT = 3e-4  # of the outlines off the rail [m]
STRIDE = 6e-3  # least way between footprints that are outlined; the trails have all [m]
BEYOND = 0.012  # rail shown beyond the footprints [m]
PIXELS = 2400  # width of the picture


@dataclass(frozen=True)
class Development:
    """Running surface of the rail rolled out flat.

    Attributes:
        s: Arc length, 0 at the rail top, positive to the field side, increasing ``(n,)`` [m].
        points: Profile points (y, z), shape ``(n, 2)`` [m].
    """

    s: Array
    points: Array

    def flat(self, positions: Array) -> Array:
        """Return (x, s) of positions on or near the rail, shape ``(n, 2)`` [m]."""
        start, step = self.points[:-1], np.diff(self.points, axis=0)
        rel = positions[:, None, 1:] - start
        part = np.clip((rel * step).sum(-1) / (step**2).sum(-1), 0, 1)
        off = np.linalg.norm(rel - part[..., None] * step, axis=-1)
        k = np.argmin(off, axis=1)
        s = self.s[k] + part[np.arange(len(k)), k] * np.diff(self.s)[k]
        return np.column_stack([positions[:, 0], s])

    def on_rail(self, flat: Array, lift: float = 0.0) -> Array:
        """Return positions of (x, s) lifted off the rail by ``lift`` [m], shape ``(n, 3)`` [m]."""
        y, z = (np.interp(flat[:, 1], self.s, c) for c in self.points.T)
        slope = np.interp(flat[:, 1], self.s, self.slope)
        return np.column_stack([flat[:, 0], y - lift * np.sin(slope), z + lift * np.cos(slope)])

    @property
    def slope(self) -> Array:
        """Direction of the profile, positive on the gauge side, shape ``(n,)`` [rad]."""
        y, z = np.gradient(self.points, self.s, axis=0).T
        return np.asarray(np.arctan2(z, y))


def footprints(record: Record) -> "Figure | None":
    """Nodes in contact at some of the outputs, at the places of the undeformed rail.

    A node counts if its normal force is not zero. Outlines enclose the tributary areas of the
    nodes. Blue: contact in one patch; red: in two. The lower panel is the running surface
    rolled out flat; lines are trails of the centres of normal force at every output.
    """
    if not record.wheel_on_rail or not record.contacts or record.body is None:
        return None
    rail = record.body.part(record.body.regions == Tag.RAIL_HEAD)
    contact = undeformed(record, rail, next(iter(record.contacts.values())))
    every = np.vstack([p.position for output in contact.patches for p in output.values()])
    around = every[:, 0].min() - BEYOND, every[:, 0].max() + BEYOND
    along = rail.points[rail.cells, 0]
    rail = rail.part((along.max(axis=1) > around[0]) & (along.min(axis=1) < around[1]))
    flat = development(rail, float(np.median(every[:, 0])))
    fig = style.figure(style.PAGE, 5.6)
    upper, lower = fig.subplots(2, 1, height_ratios=(1.7, 1))
    seen(upper, rail, flat, contact, around)
    developed(lower, rail, flat, contact)
    lower.set_xlim(around[0] * MM, around[1] * MM)
    _legend(fig, contact)
    return fig


def undeformed(record: Record, rail: Body, contact: Contact) -> Contact:
    """Return footprints where they lie on the undeformed rail.

    Each node is moved back by the displacement of the rail node next to it.
    """
    nodes = np.unique(rail.cells)
    outputs = []
    for t, patches in zip(contact.t, contact.patches, strict=True):
        u = record.displacement(t)[nodes]
        tree = cKDTree(rail.points[nodes] + u)
        back = {k: p.position - u[tree.query(p.position)[1]] for k, p in patches.items()}
        outputs.append({k: replace(p, position=back[k]) for k, p in patches.items()})
    return Contact(contact.t, outputs)


def development(head: Body, x: float) -> Development:
    """Return the running surface of a rail head, rolled out at the section nearest to ``x`` [m]."""
    mesh = surface(head)
    middle = mesh.cell_centers().points[:, 0]
    x = float(middle[np.argmin(np.abs(middle - x))])
    line: Any = mesh.slice(normal="x", origin=(x, 0, 0)).strip(join=True)
    loop = np.asarray(line.points)[np.asarray(line.get_cell(0).point_ids)][:, 1:]
    loop = loop[:-1] if np.allclose(loop[0], loop[-1]) else loop
    loop = np.roll(loop, -int(np.argmax(loop[:, 1])), axis=0)
    one, other = _down(loop), _down(np.roll(loop[::-1], 1, axis=0))
    gauge, field = (one, other) if one[1, 0] < other[1, 0] else (other, one)
    points, top = np.vstack([gauge[::-1], field[1:]]), len(gauge) - 1
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    return Development(s - s[top], points)


def _down(points: Array) -> Array:
    """Return the points from the rail top down one side, as far as the head does not turn in."""
    step = np.diff(points, axis=0)
    outward = np.sign(step[0, 0]) * step[:, 0] / np.linalg.norm(step, axis=1)
    turned = np.flatnonzero(outward < -0.3)
    return points[: turned[0] + 1] if len(turned) else points


def seen(
    axes: "Axes", rail: Body, flat: Development, contact: Contact, around: tuple[float, float]
) -> None:
    """Show the rail head obliquely from the gauge side, footprints and scale on it."""
    x = np.array([1.0, 0.0, 0.0])
    mesh = halved(rail, (around[0] * x, -x), (around[1] * x, x))
    points = np.asarray(mesh.points)
    frame = Frame.around(points[points[:, 2] > flat.points[0, 1] - 0.002], OBLIQUE, pad=0.03)

    def fill(view: Any) -> None:
        view.add_mesh(
            mesh, color="#b4b9bf", show_edges=True, edge_color=EDGE, edge_opacity=0.5, ambient=0.2
        )
        for patches, colour in shown(contact):
            for patch in patches.values():
                lifted = flat.on_rail(flat.flat(patch.position), LIFT)
                view.add_points(
                    lifted, color=colour, point_size=8, render_points_as_spheres=True, ambient=0.5
                )
                for ring in outlines(flat.flat(patch.position), patch.areas):
                    line = flat.on_rail(ring, LIFT)
                    view.add_lines(line, color=colour, width=4, connected=True)

    frame.show(axes, frame.render(PIXELS, fill))
    _scale(axes, frame, points, flat)
    style.letter(axes, "a", "rail head from the gauge side, x in mm")


def _scale(axes: "Axes", frame: Frame, points: Array, flat: Development) -> None:
    """Draw ticks of x along the lower edge of the gauge face."""
    from matplotlib.ticker import MaxNLocator

    y, z = flat.points[0]
    low, high = points[:, 0].min() * MM, points[:, 0].max() * MM
    for x in MaxNLocator(8, steps=[1, 2, 2.5, 5, 10]).tick_values(low, high):
        if low <= x <= high:
            at, below = frame.flat(np.array([[x / MM, y, z], [x / MM, y - 0.004, z]]))
            axes.plot(*np.column_stack([at, below]), color=style.INK, lw=0.8)
            axes.annotate(f"{x:g}", below, (-1, -1), textcoords="offset points", **_TICK)


_TICK: dict[str, Any] = {"ha": "right", "va": "top", "fontsize": 7, "annotation_clip": False}


def developed(axes: "Axes", rail: Body, flat: Development, contact: Contact) -> None:
    """Draw mesh, footprints and trails on the running surface rolled out flat."""
    from matplotlib.collections import LineCollection, PolyCollection

    axes.add_collection(LineCollection(_mesh_lines(rail, flat), colors="#dddddd", lw=0.4))
    for patches, colour in shown(contact):
        for patch in patches.values():
            nodes = flat.flat(patch.position)
            for ring in outlines(nodes, patch.areas):
                axes.add_collection(PolyCollection([ring * MM], facecolor=colour, alpha=0.10))
                axes.plot(*ring.T * MM, color=colour, lw=0.8)
            axes.plot(*(nodes * MM).T, ".", color=colour, ms=1.4, mew=0)
    for place in (1, 2):
        _trail(axes, flat, [(t, p[place]) for t, p in _outputs(contact) if place in p], place)
    every = np.vstack([p.position for _, o in _outputs(contact) for p in o.values()])
    s = flat.flat(every)[:, 1] * MM
    bend = np.interp(STEEP, flat.slope[::-1], flat.s[::-1]) * MM
    axes.set_ylim(min(s.min(), bend) - 9, s.max() + 9)
    axes.axhline(bend, color=style.INK, ls=":", lw=0.8)
    axes.text(0.995, bend, "rail slopes 45°", transform=axes.get_yaxis_transform(), **_BEND)
    axes.set(xlabel="along the rail x [mm]", ylabel="arc length s [mm]")
    axes.set_aspect("equal")
    axes.grid(False)
    style.letter(axes, "b", "developed surface, s from the rail top, gauge side below")


def _trail(
    axes: "Axes", flat: Development, path: list[tuple[float, PatchNodes]], place: int
) -> None:
    """Draw the trail of a patch and label the times of its ends, away from the other patch."""
    if not path:
        return
    centres = flat.flat(np.array([patch.centre for _, patch in path])) * MM
    axes.plot(*centres.T, "-", color=style.INK, lw=0.7)
    for k in (0, -1):
        t, patch = path[k]
        s = boxes(flat.flat(patch.position), patch.areas)[..., 1] * MM
        edge, up, side = (s.max(), 4, "bottom") if place == 1 else (s.min(), -4, "top")
        axes.annotate(
            f"{t * 1e3:.2f} ms",
            (centres[k, 0], edge),
            (0, up),
            textcoords="offset points",
            ha="right" if k == 0 else "left",
            va=side,
            fontsize=6.5,
        )


_BEND: dict[str, Any] = {"ha": "right", "va": "bottom", "fontsize": 6, "color": style.INK}


def shown(contact: Contact) -> list[tuple[dict[int, PatchNodes], str]]:
    """Return patches and colour of the outputs that are outlined.

    Those are the first, the last, births, and so many between that outlines do not pile up.
    """
    outputs = [patches for _, patches in _outputs(contact)]
    kept, before, x = [], -1, -np.inf
    for k, patches in enumerate(outputs):
        first = next(iter(patches.values()))
        ahead = first.centre[0] - x
        length = max(np.ptp(patch.position[:, 0]) for patch in patches.values())
        if ahead >= max(length / 2, STRIDE) or len(patches) != before or k == len(outputs) - 1:
            kept.append((patches, (style.ONE_POINT, style.TWO_POINT)[len(patches) - 1]))
            before, x = len(patches), first.centre[0]
    return kept


def _outputs(contact: Contact) -> list[tuple[float, dict[int, PatchNodes]]]:
    return [(t, p) for t, p in zip(contact.t, contact.patches, strict=True) if p]


def _mesh_lines(rail: Body, flat: Development) -> list[Array]:
    """Return the edges of the running surface as lines (x, s), shape ``(k, 5, 2)`` [mm]."""
    mesh = surface(rail)
    quads = mesh.regular_faces
    points = np.asarray(mesh.points, dtype=np.float64)
    where = flat.flat(points)
    off = np.linalg.norm(points - flat.on_rail(where), axis=1)
    on = (off < 2e-3)[quads].all(axis=1)
    return list(where[quads[on][:, [0, 1, 2, 3, 0]]] * MM)


def _legend(fig: "Figure", contact: Contact) -> None:
    from matplotlib.lines import Line2D

    alone = [set(p) for p in contact.patches if len(p) == 1]
    kinds = [(bool(alone), style.ONE_POINT, one_point_name(alone))]
    both = bool(contact.two_points.any())
    kinds += [(both, style.TWO_POINT, "two-point contact: rail top and gauge corner")]
    keys = [Line2D([], [], color=c, marker=".", label=label) for there, c, label in kinds if there]
    keys.append(Line2D([], [], color=style.INK, lw=0.7, label="trail of the patch centres"))
    fig.legend(handles=keys, loc="outside lower center", ncols=len(keys), columnspacing=1.2)


def one_point_name(alone: list[set[int]]) -> str:
    """Name the outputs with a single patch by where it lies, at any of them."""
    places = set[int]().union(*alone)
    where = " or ".join(name for place, name in _PLACES.items() if place in places)
    return f"one-point contact: {where} alone"


_PLACES = {1: "rail top", 2: "gauge corner"}

STEPS = 8  # raster points along half a cell
ROUND = 6.0  # exponent of the rounded rectangle around a node: 2 an ellipse, more a box
REACH = 0.57  # half size of that rectangle in cells, so that those of neighbours overlap


def cell_sizes(at: Array, areas: Array) -> Array:
    """Return length and width of the rectangle that stands for each node, shape ``(n, 2)`` [m].

    The length is how far columns of nodes are apart, the width makes up the area.

    Args:
        at: Longitudinal and lateral position of the nodes, shape ``(n, 2)`` [m].
        areas: Tributary areas, shape ``(n,)`` [m2].
    """
    x = at[:, 0]
    apart = np.abs(x[:, None] - x)
    apart[apart < 0.5 * np.sqrt(areas)] = np.inf  # same column, or the node itself
    near = apart.min(axis=1)
    alone = not np.isfinite(near).any()
    length = np.sqrt(np.median(areas)) if alone else np.median(near[np.isfinite(near)])
    length = min(max(length, 0.5 * np.sqrt(areas.max())), 2 * np.sqrt(areas.min()))
    return np.column_stack([np.full(len(x), length), areas / length])


def boxes(at: Array, areas: Array) -> Array:
    """Return the corners of the rectangle of each node, shape ``(n, 4, 2)`` [m]."""
    corners = 0.5 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    return at[:, None] + cell_sizes(at, areas)[:, None] * corners


def outlines(at: Array, areas: Array) -> list[Array]:
    """Return the closed lines around the cells of a patch, one for each part of it.

    The cells are rounded rectangles drawn on a raster; the lines are its contour.

    Args:
        at: Longitudinal and lateral position of the nodes, shape ``(n, 2)`` [m].
        areas: Tributary areas, shape ``(n,)`` [m2].

    Returns:
        Lines of shape ``(k, 2)`` [m], the first point repeated as the last.
    """
    from contourpy import contour_generator

    half = REACH * cell_sizes(at, areas)
    low, high = (at - 1.3 * half).min(axis=0), (at + 1.3 * half).max(axis=0)
    step = half.min(axis=0) / STEPS
    x, y = (np.arange(a, b + d, d) for a, b, d in zip(low, high, step, strict=True))
    depth = np.full((len(y), len(x)), -1.0)
    for (cx, cy), (hx, hy) in zip(at, half, strict=True):
        i, j = (
            slice(*np.searchsorted(line, (c - 1.3 * h, c + 1.3 * h)))
            for line, c, h in ((x, cx, hx), (y, cy, hy))
        )
        off = np.abs((x[i] - cx) / hx) ** ROUND + np.abs((y[j, None] - cy) / hy) ** ROUND
        depth[j, i] = np.maximum(depth[j, i], 1.0 - off ** (1 / ROUND))
    return [np.asarray(line) for line in contour_generator(x, y, depth).lines(0.0)]
