# SPDX-License-Identifier: LGPL-3.0-or-later
"""Figure of a run under a hammer: receptance, its phase, and the decay rate of the track."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from workflow.figures import style
from workflow.results.receptance import (
    DB,
    HIGHEST,
    REACH,
    Receptance,
    bands,
    blow,
    decay_rates,
    rates,
    struck,
)
from workflow.results.receptance import receptance as receptances
from workflow.results.record import Record
from workflow.results.samples import read
from workflow.results.spectra import FEWEST
from workflow.theory.track_beam import TrackBeam, of_scene

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

NEAR = 0.01  # m: probes no further from the nearest one are drawn
FAINT = 0.1  # of the receptance: more cut off is drawn faintly
BEAM = 300  # frequencies that beams are drawn at
COLOURS = ("#0b6e99", "#e07b00", "#3a8f3a", "#d1242f")


def draw(found: Receptance, record: Record) -> Path:
    """Draw the receptances into ``figures/receptance.png`` of the run and return its path."""
    with style.style():
        return style.save(figure(found, record), record.folder / "figures" / "receptance.png")


def receptance(record: Record) -> "Figure | None":
    """Displacement over force where a hammer hits, its phase, decay rate along rows of probes.

    Behind them, for a rail on its track, beams on sleepers spread evenly and on sleepers apart.
    """
    samples = read(record.folder) if struck(record.checked) else None
    if samples is None or len(samples.t) < FEWEST:
        return None
    high = min(HIGHEST, REACH / samples.interval)
    return figure(receptances(record, high / 100, high), record)


def figure(found: Receptance, record: Record) -> "Figure":
    """Return the figure of :func:`receptance` over the frequencies that were found."""
    beam, scene = of_scene(record.checked), record.checked
    hit = blow(scene).point[0] + getattr(scene.mesh, "start", 0.0)  # a sleeper is in the middle
    rows = 2 + bool(found.rows)
    fig = style.figure(style.PAGE, 2.1 * rows + 0.9)
    every = fig.subplots(rows, 1, sharex=True)
    if beam is not None:
        behind(every, found, beam, hit)
    magnitude(every[0], every[1], found)
    if found.rows:
        decay(every[2], found)
    for axes in every:
        axes.set_xscale("log")
        axes.grid(True, which="minor", lw=0.25)
    every[-1].set(xlabel="frequency [Hz]", xlim=(found.frequency[0], found.frequency[-1]))
    every[-1].xaxis.set_major_formatter("{x:g}")
    return fig


def behind(every: Sequence["Axes"], found: Receptance, beam: TrackBeam, hit: float) -> None:
    """Draw what beams have: on two even layers, and on sleepers that lie apart."""
    f = np.geomspace(found.frequency[0], found.frequency[-1], BEAM)
    middles = bands(found.frequency[0], found.frequency[-1])
    x = found.distance[next(iter(found.rows.values()))] if found.rows else np.zeros(1)
    apart = beam.on_sleepers(f, hit, hit + x)
    for name, value, colour in (
        ("beam on two even layers", beam.receptance(f, x), style.CLOSED_FORM),
        ("beam on sleepers apart, point masses", apart, style.CLOSED_FORMS[1]),
    ):
        look: dict[str, Any] = {"color": colour, "lw": 2.5}
        every[0].loglog(f, np.abs(value[0]), label=name, **look)
        every[1].plot(f, np.degrees(np.angle(value[0])), **look)
        if found.rows:
            every[2].loglog(middles, decay_rates(f, value, x, middles), label=name, **look)


def magnitude(above: "Axes", below: "Axes", found: Receptance) -> None:
    """Draw magnitude and phase of the probes nearest to the blow; thin where they are cut off."""
    f = found.frequency
    away = np.abs(found.distance)
    for k, i in enumerate(np.flatnonzero(away <= away.min() + NEAR)):
        colour = COLOURS[k % len(COLOURS)]
        sure = np.where(found.cut_off[i] < FAINT, 1.0, np.nan)
        size, phase = np.abs(found.value[i]), np.degrees(np.angle(found.value[i]))
        above.loglog(f, size, color=colour, lw=0.5)
        above.loglog(f, size * sure, color=colour, label=found.names[i])
        below.plot(f, phase, color=colour, lw=0.5)
        below.plot(f, phase * sure, color=colour)
    thin = f"; thin where the end of the record of {found.length * 1e3:.3g} ms cuts off a tenth"
    style.letter(above, "a", f"displacement over force{thin}")
    style.letter(below, "b", "its phase")
    above.set_ylabel("receptance [m/N]")
    below.set(ylabel="phase [°]", ylim=(-190, 20), yticks=[-180, -90, 0])
    above.legend()


def decay(axes: "Axes", found: Receptance) -> None:
    """Draw decay rates in third-octave bands, and what probes of that reach can tell apart."""
    middles = bands(found.frequency[0], found.frequency[-1])
    for k, (key, row) in enumerate(found.rows.items()):
        x, colour = found.distance[row], COLOURS[k % len(COLOURS)]
        axes.loglog(middles, rates(found, row, middles), "o-", color=colour, ms=3.5, label=key)
        reach = f"least that can be told to {x[-1]:.3g} m"
        axes.axhline(DB / x[-1], color=colour, ls=":", lw=0.9, label=reach)
    style.letter(axes, "c", "decay rate along the rail in third-octave bands, after EN 15461")
    axes.set_ylabel("decay rate [dB/m]")
    axes.legend()
