# SPDX-License-Identifier: LGPL-3.0-or-later
"""Figure of a run under a hammer: receptance, its phase, and the decay rate of the track."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from workflow.figures import style
from workflow.results.receptance import DB, Receptance, bands, decay_rates, rates
from workflow.results.record import Record
from workflow.theory.track_beam import TrackBeam, of_scene

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

NEAR = 0.01  # m: probes no further from the nearest one are drawn
FAINT = 0.1  # of the receptance: more cut off is drawn faintly
COLOURS = ("#0b6e99", "#e07b00", "#3a8f3a", "#d1242f")


def draw(found: Receptance, record: Record) -> Path:
    """Draw the receptances into ``figures/receptance.png`` of the run and return its path."""
    with style.style():
        return style.save(figure(found, record), record.folder / "figures" / "receptance.png")


def figure(found: Receptance, record: Record) -> "Figure":
    """Receptance where it is hit and its phase, decay rate along each row of probes.

    Behind them, for a rail on its track, a beam on two layers that sleepers are spread over evenly.
    """
    beam = of_scene(record.checked)
    rows = 2 + bool(found.rows)
    fig = style.figure(style.PAGE, 2.1 * rows + 0.9)
    every = fig.subplots(rows, 1, sharex=True)
    magnitude(every[0], every[1], found, beam)
    if found.rows:
        decay(every[2], found, beam)
    for axes in every:
        axes.set_xscale("log")
        axes.grid(True, which="minor", lw=0.25)
    every[-1].set(xlabel="frequency [Hz]", xlim=(found.frequency[0], found.frequency[-1]))
    every[-1].xaxis.set_major_formatter("{x:g}")
    return fig


def magnitude(above: "Axes", below: "Axes", found: Receptance, beam: TrackBeam | None) -> None:
    """Draw magnitude and phase of the probes nearest to the blow; thin where they are cut off."""
    f = found.frequency
    if beam is not None:
        value = beam.receptance(f)
        above.loglog(f, np.abs(value), color=style.CLOSED_FORM, lw=2.5, label="beam on two layers")
        below.plot(f, np.degrees(np.angle(value)), color=style.CLOSED_FORM, lw=2.5)
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
    below.set(ylabel="phase [°]", ylim=(-190, 190), yticks=[-180, -90, 0, 90, 180])
    above.legend()


def decay(axes: "Axes", found: Receptance, beam: TrackBeam | None) -> None:
    """Draw decay rates in third-octave bands, and what probes of that reach can tell apart."""
    middles = bands(found.frequency[0], found.frequency[-1])
    for k, (key, row) in enumerate(found.rows.items()):
        x, colour = found.distance[row], COLOURS[k % len(COLOURS)]
        if beam is not None:
            smooth = decay_rates(found.frequency, beam.receptance(found.frequency, x), x, middles)
            axes.loglog(middles, smooth, "s-", color=style.CLOSED_FORM, lw=2.5, ms=5)
        axes.loglog(middles, rates(found, row, middles), "o-", color=colour, ms=3.5, label=key)
        reach = f"least that can be told to {x[-1]:.3g} m"
        axes.axhline(DB / x[-1], color=colour, ls=":", lw=0.9, label=reach)
    style.letter(axes, "c", "decay rate along the rail in third-octave bands, after EN 15461")
    axes.set_ylabel("decay rate [dB/m]")
    axes.legend()
