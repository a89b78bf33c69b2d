# SPDX-License-Identifier: LGPL-3.0-or-later
"""Growth in a run: frequencies and growth rates from its samples, and limit cycles.

The samples are taken for a sum of oscillations ``a exp(λ t)``, whose λ all channels share. A matrix
pencil finds them (Y. Hua and T. K. Sarkar, IEEE Trans. Acoust. Speech Signal Process. 38, 814-824,
1990): windows of the samples, one behind the other, span a space that a shift by one sample turns
by ``exp(λ Δt)``. It is made of the largest singular vectors. Fewer of them, and a part of the
record, should give the same λ; how far they do not is told as its spread.
"""

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy import linalg, signal

from meshes.arrays import Array
from workflow.results import samples
from workflow.results.spectra import detrended, spectrum, turned
from workflow.results.table import Column, Table
from workflow.scene.scene import SceneError

Complex = np.ndarray[Any, np.dtype[np.complex128]]

FEWEST = 48  # samples in the window, after thinning
ROWS = 600  # samples in the window, at most: the pencil is dense
OVER = 2.6  # sampling rate over the highest frequency, after thinning
HALF = 10  # samples after thinning that half of its filter spans
KEPT = 1e-3  # singular values that count, over the largest
MOST = 48  # of them, at most
TRIED = ((1.0, 0.0, 1.0), (0.7, 0.0, 1.0), (1.0, 0.0, 0.75), (1.0, 0.25, 1.0))  # share, from, to
ALIKE = 0.01  # distance in frequency below which two pencils found the same oscillation
SMALL = 1e-9  # range of an axis over the largest of all three, below which it is no channel
SHARE = 1e-3  # of the variance of the channel where it is largest, that a row has at least
LEVEL = 0.1  # what the envelope of a limit cycle may swing by, over its mean
PERIODS = 10  # that a limit cycle lasts at least
WIDTH = 0.15  # half width of the band about an oscillation, over its frequency
OCTAVE = 2 ** (1 / 6)  # edge of a third octave over its middle


@dataclass(frozen=True)
class Oscillation:
    """A part ``a exp(growth_rate t) cos(2π frequency t + phase)`` of the samples.

    Attributes:
        frequency, growth_rate: [Hz, 1/s].
        frequency_spread, growth_spread: Half the range over pencils [Hz, 1/s].
        channel: Where it has the largest share of the variance.
        share: That share [-].
        amplitude: There, at the end of the window, in the unit of the channel.
    """

    frequency: float
    growth_rate: float
    frequency_spread: float
    growth_spread: float
    channel: str
    share: float
    amplitude: float

    @property
    def grows(self) -> bool:
        """Whether it grows beyond doubt of the pencil."""
        return self.growth_rate > 2 * self.growth_spread


@dataclass(frozen=True)
class Cycle:
    """A limit cycle: an oscillation that has grown and stays.

    Attributes:
        since: From when on its envelope stays [s].
        amplitude: Mean of the envelope since then, in the unit of the channel.
        grown: That over the smallest envelope before [-].
        harmonics: Amplitudes at twice and three times the frequency, over that at it [-].
    """

    since: float
    amplitude: float
    grown: float
    harmonics: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class Window:
    """Samples of a run in a window of time.

    Attributes:
        folder: Result folder.
        t: Times, shape ``(k,)`` [s].
        channels: Samples by name, shape ``(k,)`` each.
        units: Of each.
        interval: Between two of them [s].
        top: Highest frequency that is looked for [Hz].
    """

    folder: Path
    t: Array
    channels: dict[str, Array]
    units: dict[str, str]
    interval: float
    top: float


def window(
    folder: Path, begin: float | None = None, end: float | None = None, top: float | None = None
) -> Window:
    """Return the samples of a run in a window.

    Args:
        folder: Result folder of a run with samples.
        begin: Start of the window; that of the samples if left out [s].
        end: Its end; that of the samples if left out [s].
        top: Highest frequency; a fifth of the sampling rate if left out [Hz].

    Raises:
        SceneError: if there are no samples, or too few in the window.
    """
    found = samples.read(folder)
    if found is None:
        raise SceneError(f"{folder}: no samples; expected a run with output.sample_interval")
    most = 1 / (OVER * found.interval)
    top = 0.2 / found.interval if top is None else top
    if not 0 < top <= most:
        raise SceneError(f"--to {top:g}: expected a frequency above 0 and up to {most:.4g} Hz")
    inside = (found.t >= (begin or 0.0)) & (found.t <= (found.t[-1] if end is None else end))
    t = found.t[inside]
    if len(t) < FEWEST:
        raise SceneError(
            f"{folder}: {len(t)} samples in the window; expected {FEWEST} or more, of "
            f"{len(found.t)} from {found.t[0]:.3g} to {found.t[-1]:.3g} s"
        )
    channels = {name: x[inside] for name, x in channels_of(found).items()}
    probed = {name: samples.UNITS[quantity] for name, quantity in found.quantity.items()}
    units = {name: probed.get(name.rsplit(" ", 2)[0], "N") for name in channels}
    return Window(folder, t, channels, units, found.interval, top)


def in_time(seen: Window) -> dict[str, Any]:
    """Return what oscillates in the samples of a run, and how fast it grows.

    Returns:
        ``{"oscillations": [...], "bands": [...], ...}`` as ``squealx growth --json`` prints it.
    """
    t, channels = seen.t, seen.channels
    rows = oscillations(channels, seen.interval, seen.top)
    return {
        "folder": str(seen.folder),
        "from": float(t[0]),
        "to": float(t[-1]),
        "top": float(seen.top),
        "oscillations": [
            asdict(row) | {"grows": row.grows, "limit_cycle": as_table(cycle(t, channels, row))}
            for row in rows
        ],
        "bands": list(bands(channels, seen.interval)),
    }


def as_table(found: Cycle | None) -> dict[str, Any] | None:
    """Return a limit cycle as a table for JSON."""
    return None if found is None else asdict(found)


def channels_of(found: samples.Samples) -> dict[str, Array]:
    """Return everything that was sampled as one channel each, by name and axis.

    Probes of a body that turns are taken in its own axes.
    """
    vectors: dict[str, Array] = {}
    bodies = {pair.body for pair in found.pairs.values()}
    for name, x in found.motion.items():
        turns = found.body[name] in bodies
        own = turned(x, found.t, found.spin) if turns else x
        vectors[f"{name} {found.quantity[name]}"] = own
    for name, pair in found.pairs.items():
        vectors |= {f"{name} normal force": pair.normal, f"{name} friction": pair.tangential}
    return {
        f"{name} {axis}": x[:, i]
        for name, x in vectors.items()
        for i, axis in enumerate("xyz")
        if np.ptp(x[:, i]) > SMALL * np.abs(x).max()
    }


def oscillations(channels: Mapping[str, Array], interval: float, top: float) -> list[Oscillation]:
    """Return the oscillations that some channels share, by frequency.

    Args:
        channels: Samples by name, shape ``(k,)`` each.
        interval: Between two of them [s].
        top: Highest frequency [Hz].
    """
    x = detrended(np.array([*channels.values()]))
    scale = np.sqrt((x**2).mean(axis=1))
    x, step, ahead = thinned(x / scale[:, None], interval, top)
    tried = []
    for share, begin, end in TRIED:
        part = x[:, round(begin * x.shape[1]) : round(end * x.shape[1])]
        tried.append(rates(part, step, share))
    seen = [found[(found.imag > 0) & (found.imag < 2 * np.pi * top)] for found in tried]
    found = sorted((λ for λ in seen[0]), key=lambda λ: λ.imag)
    near = [alike(complex(λ), seen[1:]) for λ in found]
    values = np.array([λ for λ, others in zip(found, near, strict=True) if others is not None])
    if not len(values):
        return []
    spreads = [others for others in near if others is not None]
    parts = shares(x, values, step)
    rows = []
    for λ, others, (channel, share, amplitude) in zip(values, spreads, parts, strict=True):
        if share < SHARE:
            continue
        both = np.array([λ, *others])
        rows.append(
            Oscillation(
                frequency=float(λ.imag / (2 * np.pi)),
                growth_rate=float(λ.real),
                frequency_spread=float(np.ptp(both.imag) / (4 * np.pi)),
                growth_spread=float(np.ptp(both.real) / 2),
                channel=list(channels)[channel],
                share=float(share),
                amplitude=float(amplitude * np.exp(λ.real * ahead) * scale[channel]),
            )
        )
    return rows


def thinned(x: Array, interval: float, top: float) -> tuple[Array, float, float]:
    """Return samples at a rate that is enough for a frequency, the last ones of a long record.

    With them come their distance and that of the last one from the end of the record [s].

    A filter without delay leaves the growth of what passes as it is; its ends are cut off.

    Args:
        x: Shape ``(m, k)``.
        interval: Between two samples [s].
        top: Highest frequency [Hz].
    """
    by, count, cut = max(1, int(1 / (OVER * top * interval))), x.shape[1], 0
    while by > 1 and count / by < FEWEST + 2 * HALF:
        by -= 1
    if by > 1:
        x = signal.decimate(x, by, ftype="fir", axis=1)
        cut = HALF
        x = x[:, cut:-cut]
    last = (int(np.ceil(count / by)) - 1 - cut) * by
    return x[:, -ROWS:], by * interval, (count - 1 - last) * interval


def rates(x: Array, step: float, share: float) -> Complex:
    """Return the λ by which a shift of one sample turns the space of windows [1/s].

    Args:
        x: Channels, shape ``(m, k)``.
        step: Between two samples [s].
        share: How many of the singular vectors that count are taken, over all of these.
    """
    length = x.shape[1] // 2
    windows = np.lib.stride_tricks.sliding_window_view(x, length + 1, axis=1)
    _, size, rows = linalg.svd(windows.reshape(-1, length + 1), full_matrices=False)
    order = min(MOST, int((size > KEPT * size[0]).sum()))
    vectors = rows[: max(2, round(share * order))].T
    turn = np.linalg.lstsq(vectors[:-1], vectors[1:], rcond=None)[0]
    z = np.linalg.eigvals(turn).astype(complex)
    return np.asarray(np.log(z[np.abs(z) > 0]) / step)


def alike(value: complex, others: list[Complex]) -> list[complex] | None:
    """Return the λ of other pencils next to one; None if some pencil has none that is near."""
    found = []
    for values in others:
        if not len(values):
            return None
        near = complex(values[np.argmin(np.abs(values - value))])
        if abs(near.imag - value.imag) > ALIKE * value.imag:
            return None
        found.append(near)
    return found


def shares(x: Array, values: Complex, step: float) -> Iterator[tuple[int, float, float]]:
    """Yield of each λ the channel where it is largest, its share and its amplitude at the end.

    Args:
        x: Scaled channels, shape ``(m, k)``.
        values: λ with positive imaginary part, shape ``(p,)`` [1/s].
        step: Between two samples [s].
    """
    t = step * (np.arange(x.shape[1]) - (x.shape[1] - 1))  # up to the end
    basis = np.exp(np.minimum(np.outer(t, values).real, 50.0)) * np.exp(
        1j * np.outer(t, values).imag
    )
    real = np.hstack([basis.real, -basis.imag])
    weight = np.linalg.norm(real, axis=0)
    both = np.linalg.lstsq(real / weight, x.T, rcond=None)[0] / weight[:, None]
    amplitude = both[: len(values)] + 1j * both[len(values) :]  # (p, m)
    for k in range(len(values)):
        part = (amplitude[k][:, None] * basis[:, k]).real
        share = (part**2).sum(axis=1) / np.maximum((x**2).sum(axis=1), 1e-300)
        best = int(np.argmax(share))
        yield best, min(1.0, float(share[best])), float(abs(amplitude[k, best]))


def envelope(t: Array, x: Array, frequency: float) -> tuple[Array, Array]:
    """Return times and the amplitude of what is in the band about a frequency, without its ends.

    Means over two periods; nothing where the record is too short or the band beyond its rate.
    """
    interval = float(t[1] - t[0])
    edges = np.array([1 - WIDTH, 1 + WIDTH]) * frequency * 2 * interval
    smooth = max(1, int(2 / (frequency * interval)))
    cut = int(1 / (2 * WIDTH * frequency * interval)) + smooth  # what the filter knows of the ends
    if edges[1] >= 1.0 or edges[0] <= 0.0 or len(t) <= 2 * cut:
        return np.zeros(0), np.zeros(0)
    band = signal.butter(2, edges, "bandpass", output="sos")
    size = np.abs(signal.hilbert(signal.sosfiltfilt(band, detrended(x))))
    size = np.convolve(size, np.ones(smooth) / smooth, mode="same")
    return t[cut:-cut], size[cut:-cut]


def cycle(t: Array, channels: Mapping[str, Array], row: Oscillation) -> Cycle | None:
    """Return the limit cycle that an oscillation has come to at the end of a window, if it has.

    Args:
        t: Times, shape ``(k,)`` [s].
        channels: Samples by name.
        row: The oscillation.
    """
    x, f = channels[row.channel], row.frequency
    inside, size = envelope(t, x, f)
    if len(size) < FEWEST:
        return None
    final = float(size[-len(size) // 4 :].mean())
    out = np.flatnonzero(np.abs(size - final) > LEVEL * final)
    since = 0 if not len(out) else int(out[-1]) + 1
    lasts = (len(size) - since) * (t[1] - t[0]) * f
    least = float(size[: max(1, since)].min())
    if lasts < PERIODS or final < 2 * least:
        return None
    overtones = [envelope(t, x, n * f) for n in (2, 3)]
    harmonics = tuple(
        float(over[when >= inside[since]].mean() / final) if len(over) else 0.0
        for when, over in overtones
    )
    return Cycle(float(inside[since]), final, final / max(least, 1e-300), harmonics)


def bands(channels: Mapping[str, Array], interval: float) -> Iterator[dict[str, Any]]:
    """Yield the mean square of every channel in each third octave that the record resolves.

    Of a velocity normal to a surface that is what its sound is reckoned from.
    """
    found = {name: spectrum(x, interval) for name, x in channels.items()}
    for name, spec in found.items():
        if spec is None:
            continue
        power = spec.density**2 * spec.resolution
        middle = 1000.0 * 2.0 ** (np.arange(-20, 20) / 3)
        for f in middle[(middle > 4 * spec.resolution) & (middle * OCTAVE < spec.frequency[-1])]:
            inside = (spec.frequency >= f / OCTAVE) & (spec.frequency < f * OCTAVE)
            yield {"channel": name, "band": float(f), "mean_square": float(power[inside].sum())}


def printout(found: dict[str, Any]) -> Iterator[Table]:
    """Yield the table of oscillations, fastest growth first."""
    rows = sorted(found["oscillations"], key=lambda row: -row["growth_rate"])
    columns = [
        Column("kHz", "frequency", ".4f", factor=1e-3),
        Column("± Hz", "frequency_spread", ".2g"),
        Column("growth 1/s", "growth_rate", "+.4g"),
        Column("± 1/s", "growth_spread", ".2g"),
        Column("largest in", "channel", words=True),
        Column("share", "share", ".1%"),
        Column("amplitude at the end", "amplitude", ".3g"),
        Column("limit cycle", _cycle, words=True),
    ]
    title = f"{found['folder']}: {found['from']:.4g} to {found['to']:.4g} s"
    note = "growth is beyond doubt of the pencil where it is more than twice its ±"
    yield Table(title, columns, rows, note)


def _cycle(row: dict[str, Any]) -> str:
    found = row["limit_cycle"]
    return "" if found is None else f"since {found['since']:.3g} s, {found['amplitude']:.3g}"
