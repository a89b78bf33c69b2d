# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sampled contact forces over time, their spectra and those of probes, modal participation.

Spectra say what they are made with: window, length of record and what is left of aliases.
"""

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from contact.footprint import contact_angle
from meshes.arrays import Array
from workflow.figures import style
from workflow.figures.shear import FEWEST, centre_row
from workflow.results import spectra
from workflow.results.participation import (
    ModeShapes,
    Participation,
    fits,
    found,
    participation,
    together,
)
from workflow.results.patch_nodes import STEEP
from workflow.results.receptance import struck
from workflow.results.record import Record
from workflow.results.samples import PairSamples, Samples, read

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

TOP = 10e3  # Hz
AXES = ("longitudinal, x", "lateral, y", "vertical, z")
WHEEL_AXES = ("axial", "radial", "circumferential")
COLOURS = ("#3a8f3a", "#e07b00", "#0b6e99")
KINDS = {
    "axial": "#0b6e99",
    "radial": "#d1242f",
    "circumferential": "#3a8f3a",
    "along x": "#3a8f3a",
    "along y": "#e07b00",
    "along z": "#0b6e99",
}
SMALL = 1e-6  # of the largest force or density: not drawn
NAMED = 14  # modes of most energy that are labelled
APART = 0.04  # of the range: names are no closer
BANDS = 5  # the strongest mode of each is drawn over time


def sampled_forces(record: Record) -> "Figure | None":
    """Contact forces of each pair over time as they were sampled, by patch on a rail."""
    samples = read(record.folder)
    if samples is None or not samples.pairs:
        return None
    fig = style.figure(style.PAGE, 2.5 * len(samples.pairs))
    panels = fig.subplots(len(samples.pairs), 2, squeeze=False, sharex=True)
    scale, unit = style.prefixed(samples.t, "s")
    for (name, pair), (left, right) in zip(samples.pairs.items(), panels, strict=True):
        size, newton = style.prefixed(np.linalg.norm(pair.normal, axis=1), "N")
        for label, colour, force in parts(record, pair):
            left.plot(samples.t * scale, force * size, color=colour, lw=0.9, label=label)
        total = (pair.normal + pair.tangential) * size
        for i in np.flatnonzero(np.abs(total).max(axis=0) > SMALL * np.abs(total).max()):
            right.plot(samples.t * scale, total[:, i], color=COLOURS[i], lw=0.9, label=AXES[i])
        style.letter(left, "a", f"{name}: normal force")
        style.letter(right, "b", "total force on the contactor")
        for axes in (left, right):
            axes.set(xlabel=f"time [{unit}]", ylabel=f"force [{newton}]")
            axes.legend(loc="best")
            axes.margins(x=0.01)
        left.set_ylim(bottom=0)
    fig.suptitle(f"means over {samples.interval * 1e6:.3g} µs", x=0.01, ha="left", fontsize=7)
    return fig


def parts(record: Record, pair: PairSamples) -> list[tuple[str, str, Array]]:
    """Return label, colour and sums of the nodal normal forces, by place for a wheel on a rail."""
    size = np.linalg.norm(pair.normal_forces, axis=1)

    def total(mine: npt.NDArray[np.bool_]) -> Array:
        force = np.bincount(pair.sample[mine], size[mine], len(pair.start) - 1)
        return np.asarray(force, dtype=np.float64)

    if not record.wheel_on_rail:
        return [("normal force", style.PATCH[1], total(np.ones(len(size), dtype=bool)))]
    angle = contact_angle(pair.normal_forces)
    out = []
    for place, mine in ((1, angle < STEEP), (2, angle >= STEEP)):
        if mine.any():
            out.append((style.PATCH_NAME[place], style.PATCH[place], total(mine)))
    return out


def sampled_spectra(record: Record) -> "Figure | None":
    """Spectra of contact forces and of velocities at probes; modes marked where there are such."""
    samples = read(record.folder)
    if samples is None or len(samples.t) < spectra.FEWEST or struck(record.checked):
        return None  # of a blow there are receptances
    panels = [(f"{n}: contact force", "force [N/√Hz]", p) for n, p in samples.pairs.items()]
    rows = len(panels) + len(samples.motion)
    if not rows:
        return None
    fig = style.figure(style.PAGE, 1.9 * rows + 0.7)
    every = fig.subplots(rows, 1, squeeze=False, sharex=True)[:, 0]
    for axes, (title, label, pair) in zip(every, panels, strict=False):
        force = spectra.spectrum(pair.normal + pair.tangential, samples.interval)
        assert force is not None
        lines(axes, force.frequency, force.density, AXES, reach(samples))
        axes.set(ylabel=label, title=title)
    for axes, name in zip(every[len(panels) :], samples.motion, strict=True):
        probe(axes, record, samples, name)
    if (modes := found(record.folder, record.checked, record.modes)) is not None:
        for axes in every:
            mark(axes, modes)
    every[-1].set_xlabel("frequency [kHz]")
    every[-1].set_xlim(0, reach(samples) / 1e3)
    nodes_pass = passing(record)
    for axes in every:
        mark_passing(axes, nodes_pass)
    told = made(samples)
    if modes is not None:
        told += f"; ticks: modes of {modes.summary['part']}, coloured by direction"
    fig.suptitle(told, x=0.01, ha="left", fontsize=7)
    return fig


def probe(axes: "Axes", record: Record, samples: Samples, name: str) -> None:
    """Draw the velocity spectrum of a probe, in the axes of the wheel if it turns with it."""
    x, labels = samples.motion[name], AXES
    rolling = record.scene.get("rolling")
    if (
        rolling
        and samples.body[name] == rolling["body"]
        and samples.quantity[name] != "displacement"
    ):
        x, labels = in_wheel(samples, name), WHEEL_AXES
    got = spectra.spectrum(x, samples.interval)
    assert got is not None
    density = spectra.as_velocity(got, samples.quantity[name])
    lines(axes, got.frequency, density, labels, reach(samples))
    from_what = "" if samples.quantity[name] == "velocity" else f" (from {samples.quantity[name]})"
    axes.set(ylabel="velocity [m/s/√Hz]", title=f"probe {name}, {samples.body[name]}{from_what}")


def in_wheel(samples: Samples, name: str) -> Array:
    """Return what a probe on a rolling wheelset measured as axial, radial, circumferential."""
    own = spectra.turned(samples.motion[name], samples.t, samples.spin)
    axle = samples.spin / np.linalg.norm(samples.spin)
    arm = samples.place[name] - samples.centre
    radial = arm - (arm @ axle) * axle
    radial /= np.linalg.norm(radial)
    return np.asarray(own @ np.column_stack([axle, radial, np.cross(axle, radial)]))


def reach(samples: Samples) -> float:
    """Return the highest frequency drawn: 10 kHz, more if a record is too short for that [Hz]."""
    most = 0.4 / samples.interval
    return min(TOP, most) if len(samples.t) * samples.interval * TOP > 20 else most


def lines(axes: "Axes", f: Array, density: Array, labels: tuple[str, ...], top: float) -> None:
    """Draw densities over frequency up to ``top``, on a scale of six decades at most."""
    shown = f <= 1.02 * top
    most = density[shown].max()
    drawn = np.flatnonzero(density[shown].max(axis=0) > SMALL * most)
    for i in drawn:
        colour = KINDS.get(labels[i], COLOURS[i])  # as the modes of that direction
        axes.semilogy(f[shown] / 1e3, density[shown, i], color=colour, lw=1, label=labels[i])
    if len(drawn):
        least = density[np.ix_(shown, drawn)].min()
        axes.set_ylim(max(least, SMALL * most) / 1.5, 4 * most)
    axes.legend(loc="upper right", ncols=3)


def passing(record: Record) -> float | None:
    """Return how often nodes come to the contact of a rolling wheel [Hz]: speed over spacing.

    There each spectrum has a line of the mesh's, whatever rolls.
    """
    rolling = record.scene.get("rolling")
    patches = [p for c in record.contacts.values() for at in c.patches for p in at.values()]
    rows = [np.diff(p.local[centre_row(p), 0]) for p in patches if len(p.areas) > FEWEST]
    if not rolling or not rows or not len(along := np.concatenate(rows)):
        return None
    return float(abs(rolling["speed"]) / np.median(along))


def mark_passing(axes: "Axes", frequency: float | None) -> None:
    """Mark the frequency at which nodes pass, where the panel reaches as far."""
    if frequency is None or not axes.get_xlim()[0] < frequency / 1e3 < axes.get_xlim()[1]:
        return
    axes.axvline(frequency / 1e3, color=style.INK, ls=":", lw=0.9, zorder=0)
    where: dict[str, Any] = {"transform": axes.get_xaxis_transform(), "rotation": 90}
    text = " nodes pass"
    axes.text(frequency / 1e3, 0.1, text, fontsize=6, ha="right", va="bottom", **where)


def mark(axes: "Axes", modes: ModeShapes) -> None:
    """Mark natural frequencies at the foot of a panel."""
    for row in modes.rows:
        colour = KINDS[row["kind"]]
        at = row["frequency"] / 1e3
        axes.plot([at, at], [0, 0.06], color=colour, lw=0.9, transform=axes.get_xaxis_transform())


def made(samples: Samples) -> str:
    """Return in words how the spectra are made, what they resolve and what is aliased."""
    got = spectra.spectrum(samples.t, samples.interval)
    assert got is not None
    top = reach(samples)
    leak = 100 * spectra.leakage(top, samples.interval)
    return (
        f"one-sided amplitude density, Welch, {spectra.WINDOW.capitalize()} window, cubic trend "
        f"taken out; segments: {got.segments}, lines every {got.resolution:.0f} Hz and 1.5 lines "
        f"wide;\nmeans over {samples.interval * 1e6:.3g} µs, corrected for; of an amplitude at "
        f"{(1 / samples.interval - top) / 1e3:.0f} kHz {leak:.0f} % shows at {top / 1e3:.0f} kHz"
    )


def modal_participation(record: Record) -> "Figure | None":
    """Vibration energy that contact forces give each mode, over frequency and over time."""
    samples = read(record.folder)
    modes = found(record.folder, record.checked, record.modes)
    if samples is None or modes is None or len(samples.t) < spectra.FEWEST:
        return None
    pairs = {n: p for n, p in samples.pairs.items() if fits(modes, record.checked, p)}
    if not any(len(p.node) for p in pairs.values()):
        return None
    fig = style.figure(style.PAGE, 3.1 * len(pairs) + 0.5)
    panels = fig.subplots(len(pairs), 2, squeeze=False, width_ratios=(5, 3))
    for (name, pair), (left, right) in zip(pairs.items(), panels, strict=True):
        part = participation(modes, samples, pair, record.checked)
        by_mode = together(modes.rows, part.energy)
        peak = np.array([energy.max() for _, energy in by_mode])
        stems(left, by_mode, peak)
        mark_passing(left, passing(record))
        over_time(right, part, by_mode, peak)
        style.letter(left, "a", f"{name}: largest vibration energy of each mode")
        style.letter(right, "b", "the strongest of each band over time")
    fig.suptitle(described(modes.summary), x=0.01, ha="left", fontsize=7)
    return fig


def stems(axes: "Axes", by_mode: list[tuple[dict[str, Any], Array]], peak: Array) -> None:
    """Draw the largest energy of each mode over its frequency, the strongest with their name."""
    f = np.array([row["frequency"] for row, _ in by_mode]) / 1e3
    floor = max(peak.max() * 1e-7, peak.min() / 3)
    for kind in dict.fromkeys(row["kind"] for row, _ in by_mode):
        mine = np.array([row["kind"] == kind for row, _ in by_mode])
        colour = KINDS[kind]
        axes.vlines(f[mine], floor, peak[mine], color=colour, lw=0.9)
        axes.plot(f[mine], peak[mine], "o", color=colour, ms=2.5, label=kind)
    named: list[int] = []
    for i in np.argsort(peak)[::-1]:
        if len(named) < NAMED and all(abs(f[i] - f[j]) > APART * f.max() for j in named):
            named.append(int(i))
            at, text = (f[i], peak[i]), label(by_mode[i][0])
            axes.annotate(text, at, (0, 3), textcoords="offset points", ha="center", fontsize=6)
    axes.set_yscale("log")
    axes.set_ylim(floor, 5 * peak.max())
    axes.set_xlim(left=-0.03 * f.max())
    axes.set(xlabel="frequency [kHz]", ylabel="energy [J]")
    axes.legend(loc="upper right")


def over_time(
    axes: "Axes", part: Participation, by_mode: list[tuple[dict[str, Any], Array]], peak: Array
) -> None:
    """Draw the vibration energy of the strongest mode of each band of frequencies over time."""
    import matplotlib as mpl

    scale, unit = style.prefixed(part.t, "s")
    f = np.array([row["frequency"] for row, _ in by_mode])
    band = np.minimum(f / f.max() * BANDS, BANDS - 1).astype(int)
    for k in np.unique(band):
        i = int(np.argmax(np.where(band == k, peak, -1.0)))
        row, energy = by_mode[i]
        name = f"{row['frequency'] / 1e3:.2f} kHz {label(row)}"
        colour = mpl.colormaps["viridis"](0.9 * k / BANDS)
        axes.semilogy(part.t * scale, energy, color=colour, lw=0.9, label=name)
    axes.set(xlabel=f"time [{unit}]", ylabel="energy [J]")
    axes.set_ylim(peak.max() * 1e-7, peak.max() * 1e3)
    axes.legend(loc="upper left", ncols=2, columnspacing=0.8)


def label(row: dict[str, Any]) -> str:
    """Return the name of a mode: nodal diameters and circles, or its direction."""
    if row["diameters"] is None:
        return str(row["kind"])
    circles = "–" if row["circles"] is None else row["circles"]
    return f"({row['diameters']}, {circles})"


def described(summary: dict[str, Any]) -> str:
    """Return in words which modes they are and what the energy is."""
    held = {"wheel_bore": "bore clamped"}.get(summary["held"], summary["held"])
    wheel = any(row["diameters"] is not None for row in summary["modes"])
    named = ";\n(n, m): nodal diameters, nodal circles; both modes of a pair together" * wheel
    return (
        f"modes of {summary['part']}, {held}, undamped; vibration about the quasi-static motion, "
        f"none at the start{named}"
    )
