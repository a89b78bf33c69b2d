# SPDX-License-Identifier: LGPL-3.0-or-later
"""Figures of natural modes: frequency against nodal diameters, and a page of mode shapes."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from meshes.arrays import Array
from workflow.figures import style
from workflow.figures.view3d import Frame, volume
from workflow.modes.labels import RIGID, Mode
from workflow.modes.modes import Modes, title

if TYPE_CHECKING:
    from matplotlib.figure import Figure

KIND = {
    "axial": ("#0b6e99", "o"),
    "radial": ("#d1242f", "s"),
    "circumferential": ("#3a8f3a", "^"),
}
SHOWN = 16  # mode shapes on the page
COLUMNS = 4
OBLIQUE = (-0.55, 1.0, 0.25)  # wheel: from the field side
ASIDE = (0.5, -1.0, 0.45)
AMPLITUDE = 0.07  # of the largest size of the part


def draw(result: Modes, folder: Path) -> list[Path]:
    """Draw the figures of the modes into ``folder/figures`` and return their paths."""
    paths = []
    with style.style():
        for name, figure in (("modes", frequencies), ("mode_shapes", shapes)):
            fig = figure(result)
            if fig is not None:
                paths.append(style.save(fig, folder / "figures" / f"{name}.png"))
    return paths


def frequencies(result: Modes) -> "Figure | None":
    """Frequency against nodal diameters, independent values behind; None without axle."""
    found = [mode for mode in single(result.modes) if mode.diameters is not None]
    if not found:
        return None
    fig = style.figure(style.PAGE, 4.6)
    axes = fig.subplots()
    for kind, (colour, marker) in KIND.items():
        ours = [(m.diameters, m.frequency / 1e3) for m in found if m.kind == kind]
        if ours:
            label = f"{kind}, squealx"
            axes.plot(*zip(*ours, strict=True), marker, color=colour, ms=4.5, label=label, zorder=3)
        families(axes, found, kind, colour)
    if result.reference:
        n, f, _ = zip(*result.reference, strict=True)
        label = "independent Fourier elements (not measured)"
        axes.plot(n, np.array(f) / 1e3, "o", mfc="none", mec=style.INK, mew=0.7, ms=9, label=label)
    axes.set_xlabel("nodal diameters n")
    axes.set_ylabel("frequency [kHz]")
    axes.set_xticks(range(max(m.diameters for m in found) + 1))  # type: ignore[type-var, operator]
    axes.set_ylim(0, result.summary["top"] / 1e3)
    axes.set_title(described(result))
    fig.legend(loc="outside lower center", ncols=4)
    return fig


def families(axes: Any, found: list[Mode], kind: str, colour: str) -> None:
    """Join the k-th mode of a direction over n, from n = 2 on, where families are apart."""
    rows: dict[int, list[tuple[int, float]]] = {}
    for n in range(2, max(m.diameters for m in found) + 1):  # type: ignore[type-var, operator]
        same = [m for m in found if m.diameters == n and m.kind == kind]
        for k, mode in enumerate(same):
            rows.setdefault(k, []).append((n, mode.frequency / 1e3))
    for row in rows.values():
        axes.plot(*zip(*row, strict=True), "-", color=colour, lw=0.8, alpha=0.45, zorder=1)


def shapes(result: Modes) -> "Figure":
    """A page of mode shapes, one of each pair, coloured by the motion that dominates."""
    chosen = [mode for mode in single(result.modes) if mode.frequency >= RIGID][:SHOWN]
    rows = -(-len(chosen) // COLUMNS)
    points = result.mesh.points
    reach = AMPLITUDE * np.ptp(points, axis=0).max()
    wheel = chosen[0].diameters is not None
    frame = Frame.around(
        points + reach * np.sign(points - points.mean(axis=0)), OBLIQUE if wheel else ASIDE
    )
    width = style.PAGE / COLUMNS
    height = min(max(width * frame.height / frame.width, 0.5), 2.4)
    fig = style.figure(style.PAGE, rows * (height + 0.33) + 0.5)
    panels = fig.subplots(rows, COLUMNS, squeeze=False).ravel()
    for axes in panels[len(chosen) :]:
        axes.set_axis_off()
    for axes, mode in zip(panels, chosen, strict=False):
        shape = result.shapes[mode.number - 1]
        frame.show(axes, picture(result, mode, shape, reach, frame))
        axes.set_title(title(mode).replace("circumferential", "circumf."), loc="center", fontsize=7)
    fig.suptitle(described(result), x=0.01, ha="left", fontsize=8)
    key(fig, wheel)
    return fig


def picture(result: Modes, mode: Mode, shape: Array, reach: float, frame: Frame) -> Any:
    """Return the picture of a deformed part, coloured by its motion over the largest."""
    largest = float(np.linalg.norm(shape, axis=1).max())
    moved = volume(result.mesh.cells, result.mesh.points + shape * (reach / largest))
    colour = motion(result, mode, shape)
    moved["motion"] = colour[np.unique(result.mesh.cells)] / np.abs(colour).max()
    skin = moved.extract_surface(algorithm="dataset_surface")
    edges = skin.extract_feature_edges(35.0, boundary_edges=False)

    def fill(view: Any) -> None:
        view.add_mesh(
            skin,
            scalars="motion",
            cmap="RdBu_r",
            clim=(-1, 1),
            show_scalar_bar=False,
            ambient=0.25,
            specular=0.05,
            smooth_shading=False,
        )
        if edges.n_points:
            view.add_mesh(edges, color=style.INK, line_width=1.0)

    return frame.render(900, fill)


def motion(result: Modes, mode: Mode, shape: Array) -> Array:
    """Return the signed motion of each node that a mode is coloured by, shape ``(n,)``."""
    if mode.diameters is None:
        return np.asarray(shape[:, "xyz".index(mode.kind[-1])])
    y = result.axis_motion(shape)
    return np.asarray(y[:, list(KIND).index(mode.kind)])


def key(fig: "Figure", wheel: bool) -> None:
    """Add the colour bar of the shapes."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    bar = fig.colorbar(
        ScalarMappable(Normalize(-1, 1), "RdBu_r"),
        ax=fig.axes,
        orientation="horizontal",
        shrink=0.4,
        aspect=40,
        pad=0.01,
        ticks=[-1, 0, 1],
    )
    words = "axial, radial or circumferential motion" if wheel else "motion along the named axis"
    bar.set_label(f"{words} over its largest", fontsize=7)


def single(modes: list[Mode]) -> list[Mode]:
    """Return one mode of each pair, and the others."""
    return [mode for mode in modes if not (mode.partner and mode.partner < mode.number)]


def described(result: Modes) -> str:
    """Return part, how it is held and its mesh in words."""
    told = result.summary
    held = {"wheel_bore": "bore clamped", "supports": "on its supports"}.get(
        told["held"], told["held"]
    )
    mesh = f"{told['cells']} cells, element {told['element']}"
    pairs = "; n nodal diameters, m nodal circles" if result.modes[0].diameters is not None else ""
    return f"{told['part']}, {held}: {mesh}{pairs}"
