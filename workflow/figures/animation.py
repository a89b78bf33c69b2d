# SPDX-License-Identifier: LGPL-3.0-or-later
"""Animation of a contact that moves: a frame for each output, nothing made up between them.

Above, the footprints on the rail surface rolled out flat: pressure, shear on the lower body,
adhesion and slip. Below, the cut through the contact and the forces, the present time marked.
"""

import io
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from meshes.arrays import Array
from meshes.tags import Tag
from workflow.figures import style
from workflow.figures.footprint import boxes, development, undeformed
from workflow.figures.section import cut, row
from workflow.results import atomic
from workflow.results.patch_nodes import PatchNodes
from workflow.results.record import Contact, Record

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from PIL.Image import Image

MM, MPA = 1e3, 1e-6
DPI = 110
FRAMES = 40  # at most; outputs are left out evenly beyond
MILLISECONDS, LAST = 400, 2000  # how long a frame stays, and the last one
LARGEST = 3_000_000  # bytes
NEAR = 0.06  # of the cells that are cut, across the track [m]
PLANE = (0.085, 0.565, 0.80, 0.36)  # panels: left, bottom, width, height
BELOW = ((0.085, 0.1, 0.28, 0.34), (0.475, 0.1, 0.505, 0.34))
SIZE = (style.PAGE, 5.2)
EDGES = ("#12a594", style.INK)  # of the cells of nodes that adhere and slip


@dataclass(frozen=True)
class Scenery:
    """What all frames share.

    Attributes:
        contact: Footprints, at the outputs in contact.
        flat: Positions of the nodes of each patch in the plane that is drawn [m], per output.
        labels: Names of the axes of that plane.
        largest: Pressure and shear that colour and length of arrows end at [Pa].
        cut: Sections (rail or not, polygons) per output; none at all without a mesh.
    """

    contact: Contact
    flat: list[dict[int, Array]]
    labels: tuple[str, str]
    largest: tuple[float, float]
    cut: list[list[tuple[bool, Array]]]


def transition(record: Record) -> Path | None:
    """A frame for each output, nothing between them.

    Above: the contact surface rolled out flat (for a wheel on a rail; else the plane of the
    first patch), cells coloured by pressure, arrows the shear on the lower body, cells that
    adhere outlined in green. Below: cut across the track through the patch that bears most;
    normal and tangential force of each patch.
    """
    if not record.contacts:
        return None
    contact = next(iter(record.contacts.values()))
    if not worth_showing(contact):
        return None
    scenery = scenery_of(record, contact)
    frames = [picture(frame(scenery, k)) for k in range(len(scenery.contact.t))]
    path = record.folder / "figures" / "transition.gif"
    path.parent.mkdir(parents=True, exist_ok=True)
    atomic.replace(path, animation(frames))
    return path


def worth_showing(contact: Contact) -> bool:
    """Tell whether there are three outputs in contact and the nodes that touch or adhere change."""
    touching = [p for p in contact.patches if p]
    states = {
        tuple((place, len(p.areas), int(p.stick.sum())) for place, p in sorted(patches.items()))
        for patches in touching
    }
    firsts = [next(iter(patches.values())) for patches in touching]
    moved = np.ptp([p.centre for p in firsts], axis=0).max() if firsts else 0.0
    return len(touching) > 2 and (len(states) > 1 or bool(moved**2 > firsts[0].areas.max() / 4))


def scenery_of(record: Record, contact: Contact) -> Scenery:
    """Return what all frames share."""
    touching = np.flatnonzero([len(p) > 0 for p in contact.patches])
    stride = -(-len(touching) // FRAMES)
    kept = touching[::-1][::stride][::-1]  # with the last one
    body = record.body if record.wheel_on_rail else None
    some = Contact(contact.t[kept], [contact.patches[k] for k in kept])
    cuts: list[list[tuple[bool, Array]]] = []
    if body is None:
        frame_ = next(iter(some.patches[0].values())).frame[:2]
        flat = [{i: p.position @ frame_.T for i, p in o.items()} for o in some.patches]
        labels = ("longitudinal [mm]", "lateral [mm]")
    else:
        head = body.part(body.regions == Tag.RAIL_HEAD)
        still = undeformed(record, head, some)
        x = float(
            np.median(np.concatenate([p.position[:, 0] for o in still.patches for p in o.values()]))
        )
        rolled = development(head, x)
        flat = [{i: rolled.flat(p.position) for i, p in o.items()} for o in still.patches]
        labels = ("along the rail x [mm]", "arc length s [mm]")
        for t, patches in zip(some.t, some.patches, strict=True):
            first = max(patches.values(), key=lambda p: p.normal_force)
            points = body.points + record.displacement(t)
            away = np.linalg.norm(points[body.cells].mean(axis=1)[:, 1:] - _middle(some), axis=1)
            cuts.append(cut(body.part(away < NEAR), points, row(first)))
    every = [p for o in some.patches for p in o.values()]
    pressure = max(float(p.pressure.max()) for p in every)
    shear = max(float(np.linalg.norm(p.shear, axis=1).max()) for p in every)
    return Scenery(some, flat, labels, (pressure, shear), cuts)


def _middle(contact: Contact) -> Array:
    return np.mean([p.centre[1:] for o in contact.patches for p in o.values()], axis=0)


def frame(scenery: Scenery, k: int) -> "Figure":
    """Return the picture of output ``k`` of those kept."""
    from matplotlib.figure import Figure

    fig = Figure(figsize=SIZE)
    with_cut = bool(scenery.cut)
    plane = fig.add_axes(PLANE)
    _plane(plane, scenery, k)
    scale, unit = style.prefixed(scenery.contact.t, "s")
    fig.text(0.01, 0.965, f"t = {scenery.contact.t[k] * scale:.3f} {unit}", weight="bold")
    forces = fig.add_axes(BELOW[1] if with_cut else (0.085, 0.1, 0.895, 0.34))
    _forces(forces, scenery, k, scale, unit)
    if with_cut:
        _cut(fig.add_axes(BELOW[0]), scenery, k)
    _keys(fig, plane, scenery)
    return fig


def _plane(axes: "Axes", scenery: Scenery, k: int) -> None:
    """Draw pressure, shear, adhesion and slip in a window that goes with the contact."""
    from matplotlib.collections import PolyCollection

    pressure, shear = scenery.largest
    for place, patch in scenery.contact.patches[k].items():
        at = scenery.flat[k][place]
        edges = np.where(patch.stick, *EDGES)
        cells = PolyCollection(
            list(boxes(at, patch.areas) * MM),
            array=patch.pressure * MPA,
            cmap=style.COLOUR_MAP["pressure"],
            clim=(0, 1.25 * pressure * MPA),
            edgecolors=list(edges),
            linewidths=np.where(patch.stick, 1.8, 0.5),
        )
        axes.add_collection(cells)
        if shear > 0:
            _arrows(axes, at, patch, shear)
    for place, colour in style.PATCH.items():
        trail = [_centre(scenery, j, place) for j in range(k + 1) if place in scenery.flat[j]]
        if trail:
            axes.plot(*np.array(trail).T * MM, "-", color=colour, lw=0.8, zorder=1)
    _window(axes, scenery, k)
    axes.grid(False)
    axes.set_xlabel(scenery.labels[0], labelpad=1)
    axes.set_ylabel(scenery.labels[1])
    axes.set_title("footprints: pressure, shear on the lower body, adhesion and slip", loc="right")


def _arrows(axes: "Axes", at: Array, patch: PatchNodes, largest: float) -> None:
    """Draw the shear at each node, the largest of all frames as long as 1.8 cells."""
    from matplotlib.patheffects import withStroke

    cell = np.sqrt(np.median(patch.areas)) * MM
    arrows = axes.quiver(
        *at.T * MM,
        *patch.shear.T,
        angles="xy",
        scale_units="xy",
        scale=largest / (1.8 * cell),
        units="inches",
        width=0.014,
        headwidth=3.5,
        color=style.INK,
        zorder=3,
    )
    arrows.set_path_effects([withStroke(linewidth=1.2, foreground="white")])


def _window(axes: "Axes", scenery: Scenery, k: int) -> None:
    """Show what all footprints reach across, and as much along, centred on the present ones."""
    every = np.vstack([at for output in scenery.flat for at in output.values()]) * MM
    now = np.vstack(list(scenery.flat[k].values())) * MM
    cell = MM * max(np.sqrt(p.areas.max()) for o in scenery.contact.patches for p in o.values())
    low, high = every[:, 1].min() - 1.8 * cell, every[:, 1].max() + 1.2 * cell
    shape = PLANE[2] * SIZE[0] / (PLANE[3] * SIZE[1])
    longest = max(np.ptp(np.vstack(list(o.values()))[:, 0]) for o in scenery.flat) * MM
    half = max(shape * (high - low), longest + 4 * cell) / 2
    low, high = (low + high) / 2 - half / shape, (low + high) / 2 + half / shape
    middle = (now[:, 0].min() + now[:, 0].max()) / 2
    if np.ptp(every[:, 0]) + 4 * cell <= 2 * half:  # it all fits: stand still
        middle = (every[:, 0].min() + every[:, 0].max()) / 2
    axes.set(xlim=(middle - half, middle + half), ylim=(low, high), aspect="equal")


def _centre(scenery: Scenery, k: int, place: int) -> Array:
    patch: PatchNodes = scenery.contact.patches[k][place]
    return np.asarray(patch.normal_forces @ scenery.flat[k][place] / patch.normal_force)


def _forces(axes: "Axes", scenery: Scenery, k: int, scale: float, unit: str) -> None:
    """Draw normal and tangential force of each patch over time, and where in time this is."""
    contact, t = scenery.contact, scenery.contact.t * scale
    series = {
        (place, key): contact.series(place, key)
        for place in style.PATCH
        for key in ("normal_force", "tangential_force")
    }
    factor, force = style.prefixed(np.concatenate(list(series.values())), "N")
    for (place, key), values in series.items():
        if np.isfinite(values).any():
            line = "-" if key == "normal_force" else "--"
            axes.plot(t, values * factor, line, color=style.PATCH[place], lw=1.1)
            axes.plot(t[k], values[k] * factor, "o", color=style.PATCH[place], ms=4, clip_on=False)
    axes.axvline(t[k], color=style.INK, lw=0.8)
    axes.set_ylim(bottom=0)
    axes.set_xlim(t[0], t[-1])
    axes.set(xlabel=f"time [{unit}]", ylabel=f"force [{force}]")
    axes.set_title("normal force, tangential force dashed")


def _cut(axes: "Axes", scenery: Scenery, k: int) -> None:
    """Draw wheel and rail in the plane of the patch that bears most, and both patches."""
    from matplotlib.collections import PolyCollection

    y, z = _middle(scenery.contact) * MM
    every = np.vstack([p.position for o in scenery.contact.patches for p in o.values()]) * MM
    half = max(np.abs(every[:, 1:] - (y, z)).max() + 3, 8.0)
    for rail, colour in ((False, style.WHEEL), (True, style.RAIL)):
        faces = [c * MM for is_rail, c in scenery.cut[k] if is_rail == rail]
        axes.add_collection(PolyCollection(faces, facecolor=colour, edgecolor="#6a6a6a", lw=0.3))
    for place, patch in scenery.contact.patches[k].items():
        colour = style.PATCH[place]
        axes.plot(*patch.position[:, 1:].T * MM, "o", color=colour, ms=3, mec="white", mew=0.3)
        tip = patch.centre[1:] * MM + 0.45 * half * patch.direction[1:]
        arrow = {"arrowstyle": "-|>", "color": colour, "lw": 1.2, "shrinkA": 0, "shrinkB": 0}
        axes.annotate("", tuple(tip), tuple(patch.centre[1:] * MM), arrowprops=arrow)
    axes.set(xlim=(y - half, y + half), ylim=(z - half, z + half), aspect="equal")
    axes.set(xlabel="lateral y [mm]", ylabel="height z [mm]")
    axes.set_title("cut through the contact")
    axes.grid(False)


def _keys(fig: "Figure", plane: "Axes", scenery: Scenery) -> None:
    """Add the colour bar of the pressure and the keys of patches and edges."""
    from matplotlib.lines import Line2D

    if plane.collections:
        bar: Any = fig.add_axes((0.90, PLANE[1], 0.014, PLANE[3]))
        scale = fig.colorbar(plane.collections[0], cax=bar)
        scale.set_label("pressure [MPa]")
        scale.outline.set_linewidth(0.5)
    keys = [
        Line2D([], [], marker="s", ls="", mfc="none", mec=colour, mew=wide, label=name)
        for colour, wide, name in zip(EDGES, (1.8, 0.5), ("adheres", "slips"), strict=True)
    ]
    shear = float(f"{scenery.largest[1] * MPA:.3g}")
    keys.append(Line2D([], [], color=style.INK, label=f"shear, at most {shear:g} MPa"))
    names = style.PATCH_NAME if scenery.cut else {1: "patch 1", 2: "patch 2"}
    places = {place for output in scenery.contact.patches for place in output}
    keys += [Line2D([], [], color=style.PATCH[p], label=names[p]) for p in sorted(places)]
    fig.legend(handles=keys, loc="lower center", ncols=len(keys), bbox_to_anchor=(0.5, -0.015))


def picture(fig: "Figure") -> "Image":
    """Return a figure as picture."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    fig.set_dpi(DPI)
    fig.set_facecolor("white")
    canvas = FigureCanvasAgg(fig)
    canvas.draw()
    return Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3].copy())


def animation(frames: "list[Image]") -> bytes:
    """Return frames as GIF, of common colours; frames are left out evenly while it is too large."""
    from PIL import Image

    width, height = frames[0].size
    some = frames[:: -(-len(frames) // 6)]
    sheet = Image.new("RGB", (width, height * len(some)))
    for k, one in enumerate(some):
        sheet.paste(one, (0, k * height))
    colours = sheet.quantize(colors=128, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
    shades = np.array(colours.getpalette()).reshape(-1, 3)
    shades[shades.min(axis=1) > 246] = 255  # the mean of the ground and of what shines through
    colours.putpalette(shades.ravel().tolist())
    indexed = [f.quantize(palette=colours, dither=Image.Dither.NONE) for f in frames]
    while True:
        out, stay = io.BytesIO(), [*[MILLISECONDS] * (len(indexed) - 1), LAST]
        indexed[0].save(
            out,
            "GIF",
            save_all=True,
            append_images=indexed[1:],
            duration=stay,
            loop=0,
            optimize=True,
        )
        if out.tell() <= LARGEST or len(indexed) < 4:
            return out.getvalue()
        indexed = indexed[::-1][::2][::-1]
