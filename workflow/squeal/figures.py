# SPDX-License-Identifier: LGPL-3.0-or-later
"""Figures of what grows: root locus over friction, map over angles, samples of a run."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from workflow.figures import style
from workflow.results.spectra import detrended
from workflow.squeal.in_time import Window, envelope
from workflow.squeal.squeal import UNSTABLE, Squeal

if TYPE_CHECKING:
    from matplotlib.figure import Figure

GROWING = "#d1242f"


def draw(result: Squeal, folder: Path) -> list[Path]:
    """Draw the figures of a sliding state into ``folder/figures`` and return their paths."""
    with style.style():
        paths = [style.save(root_locus(result.summary), folder / "figures" / "root_locus.png")]
        if result.summary["map"]:
            fig = growth_map(result.summary)
            paths.append(style.save(fig, folder / "figures" / "growth_map.png"))
    return paths


def root_locus(summary: dict[str, Any]) -> "Figure":
    """Growth rate against frequency for rising friction, and both against friction.

    Rings are the modes at the friction of the scene, red where they grow.
    """
    points = np.array(
        [
            (row["friction"], mode["frequency"] / 1e3, mode["growth_rate"])
            for row in summary["locus"]
            for mode in row["modes"]
        ]
    ).reshape(-1, 3)
    friction, frequency, growth = points.T
    grows = growth > UNSTABLE * 2e3 * np.pi * frequency
    fig = style.figure(style.PAGE, 3.2)
    plane, pitch, rate = fig.subplots(1, 3)
    shown = plane.scatter(frequency, growth, c=friction, s=5, cmap="viridis", linewidths=0)
    own = summary["modes"]
    plane.scatter(
        [m["frequency"] / 1e3 for m in own],
        [m["growth_rate"] for m in own],
        s=22,
        facecolors="none",
        edgecolors=[GROWING if m["kind"] != "stable" else style.INK for m in own],
        linewidths=0.7,
    )
    plane.axhline(0.0, color=style.INK, lw=0.6)
    plane.set_yscale("symlog", linthresh=threshold(growth))
    plane.set_xlabel("frequency [kHz]")
    plane.set_ylabel("growth rate [1/s]")
    fig.colorbar(shown, ax=plane, location="top", label="coefficient of friction", shrink=0.8)
    pitch.plot(friction[~grows], frequency[~grows], ".", color=style.INK, ms=2)
    pitch.plot(friction[grows], frequency[grows], ".", color=GROWING, ms=4)
    pitch.set_xlabel("coefficient of friction")
    pitch.set_ylabel("frequency [kHz]")
    rate.plot(friction[grows], growth[grows], ".", color=GROWING, ms=4)
    rate.set_xlabel("coefficient of friction")
    rate.set_ylabel("growth rate [1/s]")
    rate.set_xlim(pitch.get_xlim())
    rate.set_ylim(bottom=0.0)
    fig.suptitle(f"{summary['scene']}: red grows", x=0.01, ha="left", fontsize=8)
    return fig


def growth_map(summary: dict[str, Any]) -> "Figure":
    """Growth rate and frequency of the audible mode that grows fastest, over friction and angle.

    White where nothing grows. The normal forces are those of the scene, every patch slides.
    """
    rows = summary["map"]
    angles = sorted({row["angle"] for row in rows})
    friction = sorted({row["friction"] for row in rows})
    growth, pitch = (np.full((len(angles), len(friction)), np.nan) for _ in range(2))
    for row in rows:
        if row.get("growth_rate", 0.0) > UNSTABLE * 2e3 * np.pi * row.get("frequency", 0.0):
            at = angles.index(row["angle"]), friction.index(row["friction"])
            growth[at], pitch[at] = row["growth_rate"], row["frequency"] / 1e3
    fig = style.figure(style.PAGE, 3.0)
    left, right = fig.subplots(1, 2, sharey=True)
    for axes, values, title, colours in (
        (left, growth, "growth rate [1/s]", "magma_r"),
        (right, pitch, "frequency [kHz]", "viridis"),
    ):
        shown = axes.pcolormesh(
            friction, 1e3 * np.array(angles), values, cmap=colours, shading="nearest"
        )
        fig.colorbar(shown, ax=axes, location="top", label=title, shrink=0.8)
        axes.set_xlabel("coefficient of friction")
    left.set_ylabel("angle of attack [mrad]")
    return fig


def threshold(growth: np.ndarray) -> float:
    """Return up to which growth rate an axis is linear: a hundredth of the largest [1/s]."""
    return float(max(1e-2 * np.abs(growth).max(initial=0.0), 1e-9))


def draw_in_time(seen: Window, found: dict[str, Any]) -> Path | None:
    """Draw what grows in a run into ``figures`` of its folder; nothing if nothing oscillates."""
    if not found["oscillations"]:
        return None
    with style.style():
        return style.save(growth_in_time(seen, found), seen.folder / "figures" / "growth.png")


def growth_in_time(seen: Window, found: dict[str, Any]) -> "Figure":
    """Samples where the fastest growth is largest, their envelope and what the pencil says of it.

    Besides, the mean square of that channel by third octaves.
    """
    rows = found["oscillations"]
    sure = [row for row in rows if row["grows"]]
    row = max(sure or rows, key=lambda row: row["growth_rate" if sure else "share"])
    x, f, rate = detrended(seen.channels[row["channel"]]), row["frequency"], row["growth_rate"]
    scale, unit = style.prefixed(seen.t, "s")
    fig = style.figure(style.PAGE, 2.8)
    over_time, by_band = fig.subplots(1, 2, width_ratios=[2, 1])
    over_time.plot(seen.t * scale, np.abs(x), color=style.INK, lw=0.3, alpha=0.5, label="samples")
    when, size = envelope(seen.t, x, f)
    over_time.plot(when * scale, size, color=GROWING, lw=1.0, label=f"about {f / 1e3:.3f} kHz")
    line = row["amplitude"] * np.exp(rate * (seen.t - seen.t[-1]))
    over_time.plot(seen.t * scale, line, "--", color=GROWING, lw=0.8, label=f"{rate:+.3g} per s")
    newton = seen.units[row["channel"]]
    over_time.set(xlabel=f"time [{unit}]", ylabel=f"{row['channel']} [{newton}]", yscale="log")
    over_time.set_ylim(bottom=1e-3 * np.abs(x).max())
    over_time.legend(loc="best")
    square = f"({newton})²" if "/" in newton else f"{newton}²"
    own = [band for band in found["bands"] if band["channel"] == row["channel"]]
    by_band.plot(
        [band["band"] for band in own],
        [band["mean_square"] for band in own],
        drawstyle="steps-mid",
        color=style.INK,
    )
    by_band.axvline(f, color=GROWING, lw=0.8)
    by_band.set(
        xscale="log", yscale="log", xlabel="third octave [Hz]", ylabel=f"mean square [{square}]"
    )
    style.letter(over_time, "a", "growth")
    style.letter(by_band, "b", "bands")
    return fig
