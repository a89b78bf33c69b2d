# SPDX-License-Identifier: LGPL-3.0-or-later
"""Receptance of a run under a hammer: displacement over force, damping of peaks, decay rate.

The force is known in closed form and the response begins at rest, so that the quotient of their
Fourier integrals is the receptance itself, without windows and averages. What the end of the record
cuts off of a response that still rings is told by what its last tenth changes.
"""

import csv
import io
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from forms.loads import pulse_spectrum
from meshes.arrays import Array
from workflow.results import atomic
from workflow.results.record import Record
from workflow.results.samples import Samples, read
from workflow.results.spectra import filtering
from workflow.results.table import Column, Table
from workflow.scene.scene import Scene, SceneError
from workflow.scene.settings import Hammer

Complex = npt.NDArray[np.complex128]

LINES = 8  # for each line that the length of the record resolves
LAST = 0.1  # of the record
LOWEST, HIGHEST = 20.0, 2000.0  # Hz, unless asked for otherwise
REACH = 0.399  # of the rate of samples, to which their filter can be taken out
PEAK = 3.0  # dB above its feet, from which it is one
EDGE = 10**0.05  # of a band of a third of an octave, over its middle
FEWEST = 3  # probes in a row
DB = 10 * np.log10(np.e)  # of a decay by e in energy
NEAR = 0.01  # m: probes no further from the nearest one are listed
LINE = (
    Column("frequency", 0, ".4g", "Hz"),
    Column("receptance", 1, ".3f", "nm/N", 1e9),
    Column("phase", 2, ".0f", "°", float(np.degrees(1.0))),
    Column("cut off", 3, ".2g", "%", 100.0),
)
PEAKS = (
    Column("peak", "frequency", ".1f", "Hz"),
    Column("receptance", "magnitude", ".3f", "nm/N", 1e9),
    Column("damping", "damping", ".2g", "%", 100.0),
)
RATES = (Column("band", 0, ".4g", "Hz"), Column("decay rate", 1, ".2f", "dB/m"))
ORDER = {"displacement": 0, "velocity": 1, "acceleration": 2}


@dataclass(frozen=True)
class Receptance:
    """Displacement over force along the blow.

    Attributes:
        names: Probes.
        distance: Of each from the point that is hit, along x, shape ``(p,)`` [m].
        frequency: Shape ``(m,)`` [Hz].
        value: Shape ``(p, m)`` [m/N].
        cut_off: What the last tenth of the record changes, as a part, shape ``(p, m)``.
        rows: Probes in a row on one surface or region, from the blow on: their numbers.
        length: Of the record [s].
    """

    names: list[str]
    distance: Array
    frequency: Array
    value: Complex
    cut_off: Array
    rows: dict[str, list[int]]
    length: float


def receptance(record: Record, low: float = LOWEST, high: float = HIGHEST) -> Receptance:
    """Return the receptances of a run under a hammer.

    Args:
        record: Its folder.
        low: Middle of the first third-octave band [Hz].
        high: Middle of the last one [Hz].

    Raises:
        SceneError: if there was no blow, or no probe.
    """
    scene, samples = record.checked, read(record.folder)
    hammer = blow(scene)
    if samples is None or not samples.motion:
        raise SceneError("probes: expected some in a run under a hammer, got none")
    if not 0 < low < high <= REACH / samples.interval:
        raise SceneError(
            f"--from {low:g} --to {high:g}: expected rising frequencies up to "
            f"{REACH / samples.interval:.4g} Hz, 0.4 over output.sample_interval"
        )
    length = float(samples.t[-1] + samples.interval / 2)
    f = np.arange(low / EDGE, high * EDGE, 1 / (LINES * length))
    names = list(samples.motion)
    whole, part = (
        np.array([transfer(samples, name, hammer, f, share) for name in names])
        for share in (1.0, 1.0 - LAST)
    )
    distance = np.array([samples.place[name][0] - hammer.point[0] for name in names])
    rows = dict(in_rows(scene, names, distance))
    return Receptance(names, distance, f, whole, np.abs(part / whole - 1), rows, length)


def blow(scene: Scene) -> Hammer:
    """Return the one blow of a scene.

    Raises:
        SceneError: if there are none or several, or other loads.
    """
    found = [load for load in scene.loads if load.hammer is not None]
    if len(found) != 1:
        raise SceneError(f"loads: expected one with a hammer, got {len(found)}")
    if scene.equilibrium or scene.gravity or len(scene.loads) > 1:
        raise SceneError(
            "loads: expected a blow alone, without gravity, equilibrium and other loads, whose "
            "response is not its own"
        )
    if scene.driven or scene.rolling or any(b.velocity for b in scene.bodies.values()):
        raise SceneError(
            "loads: expected a blow on bodies at rest, got such that are driven, roll or move"
        )
    assert found[0].hammer is not None
    return found[0].hammer


def struck(scene: Scene) -> bool:
    """Whether a scene has a blow alone, and probes to see what it does."""
    try:
        blow(scene)
    except SceneError:
        return False
    return bool(scene.probes)


def transfer(samples: Samples, name: str, hammer: Hammer, f: Array, share: float) -> Complex:
    """Return displacement over force of a probe along the blow, shape ``(m,)`` [m/N].

    Args:
        samples: Of the run.
        name: Probe.
        hammer: The blow.
        f: Evenly spaced frequencies [Hz].
        share: Of the record that is used, from its start.
    """
    from scipy.signal import zoom_fft

    size = float(np.linalg.norm(hammer.force))
    motion = samples.motion[name] @ (np.array(hammer.force) / size)
    T, count = samples.interval, int(share * len(motion))
    ends = [f[0], f[-1] + f[1] - f[0]]
    found = T * zoom_fft(motion[:count], ends, len(f), fs=1 / T)
    found = found * np.exp(-2j * np.pi * f * samples.t[0]) / filtering(f, T)
    found /= (2j * np.pi * f) ** ORDER[samples.quantity[name]]
    return np.asarray(found / (size * pulse_spectrum(f, hammer.duration)))


def in_rows(scene: Scene, names: list[str], distance: Array) -> Iterator[tuple[str, list[int]]]:
    """Yield the probes that lie in a row along x, from the blow on, by their surface or region."""
    places: dict[str, list[int]] = {}
    for probe in scene.probes:
        if probe.point is not None:
            key = probe.surface or probe.region or ""
            places.setdefault(key, []).append(names.index(probe.name))
    for key, row in places.items():
        ahead = sorted((i for i in row if distance[i] > -1e-3), key=lambda i: distance[i])
        if len(ahead) >= FEWEST:
            yield key, ahead


def bands(low: float, high: float) -> Array:
    """Return the middles of the third-octave bands between two frequencies [Hz]."""
    first, last = (10 * np.log10(x) for x in (low, high))
    return np.asarray(10 ** (np.arange(np.ceil(first - 0.2), np.floor(last + 0.2) + 1) / 10))


def decay_rates(frequency: Array, value: Complex, x: Array, middles: Array) -> Array:
    """Return the decay rate along a row of probes in third-octave bands, NaN without lines [dB/m].

    As EN 15461: 4.343 over the sum of ``|A(x)|² / |A(0)|²`` times the length that a probe stands
    for, half way to its neighbours, from the blow to as far beyond the last as before it.

    Args:
        frequency: Shape ``(m,)`` [Hz].
        value: Receptances of the row, shape ``(p, m)`` [m/N].
        x: Distances from the blow, ascending from about zero, shape ``(p,)`` [m].
        middles: Of the bands, shape ``(b,)`` [Hz].
    """
    between = (x[1:] + x[:-1]) / 2
    length = np.diff(np.concatenate([[0.0], between, [2 * x[-1] - between[-1]]]))
    out = np.full(len(middles), np.nan)
    for k, middle in enumerate(middles):
        inside = (frequency >= middle / EDGE) & (frequency <= middle * EDGE)
        if inside.any():
            energy = (np.abs(value[:, inside]) ** 2).mean(axis=1)
            out[k] = DB / float(energy / energy[0] @ length)
    return out


def peaks(frequency: Array, value: Complex) -> list[dict[str, float]]:
    """Return the peaks of a receptance that stand 3 dB out, with their half-power damping.

    Between the two frequencies where half of its power is left lies 2 ζ f, for ζ up to about 0.1.
    Damping is NaN where one of them is not there.

    Args:
        frequency: Evenly spaced, shape ``(m,)`` [Hz].
        value: Shape ``(m,)`` [m/N].
    """
    from scipy.signal import find_peaks, peak_widths

    power = np.abs(value) ** 2
    found, _ = find_peaks(10 * np.log10(power), prominence=PEAK)
    prominence = (power[found], np.zeros_like(found), np.full_like(found, len(power) - 1))
    width, height, left, right = peak_widths(power, found, 0.5, prominence_data=prominence)
    step = frequency[1] - frequency[0]
    whole = (power[np.floor(left).astype(int)] <= height * 1.5) & (
        power[np.ceil(right).astype(int)] <= height * 1.5
    )
    damping = np.where(whole, width * step / (2 * frequency[found]), np.nan)
    return [
        {"frequency": float(frequency[i]), "magnitude": float(abs(value[i])), "damping": float(z)}
        for i, z in zip(found, damping, strict=True)
    ]


def summary(found: Receptance, low: float, high: float) -> dict[str, Any]:
    """Return what JSON has: of each probe peaks and values at bands, decay rates of rows."""
    middles = bands(low, high)
    at = np.abs(found.frequency[:, None] - middles).argmin(axis=0)
    probes = {
        name: {
            "distance": float(found.distance[i]),
            "magnitude": np.abs(found.value[i, at]).tolist(),
            "phase": np.angle(found.value[i, at]).tolist(),
            "cut_off": found.cut_off[i, at].tolist(),
            "peaks": peaks(found.frequency, found.value[i]),
        }
        for i, name in enumerate(found.names)
    }
    decay = {
        key: {
            "reach": float(found.distance[row[-1]]),
            "rate": rates(found, row, middles).tolist(),
        }
        for key, row in found.rows.items()
    }
    return {
        "length": found.length,
        "frequency": found.frequency[at].tolist(),
        "band": middles.tolist(),
        "probes": probes,
        "decay": decay,
    }


def rates(found: Receptance, row: list[int], middles: Array) -> Array:
    """Return the decay rates along one row of probes, see :func:`decay_rates`."""
    return decay_rates(found.frequency, found.value[row], found.distance[row], middles)


def write(found: Receptance, path: Path) -> Path:
    """Write all lines as CSV, SI units: frequency, and of each probe magnitude, phase, cut-off."""
    head = ["frequency [Hz]"]
    columns = [found.frequency]
    for name, value, lost in zip(found.names, found.value, found.cut_off, strict=True):
        head += [f"{name} magnitude [m/N]", f"{name} phase [rad]", f"{name} cut off [1]"]
        columns += [np.abs(value), np.angle(value), lost]
    text = io.StringIO()
    table = csv.writer(text)
    table.writerow(head)
    table.writerows([f"{x:.7g}" for x in row] for row in zip(*columns, strict=True))
    atomic.replace(path, text.getvalue().encode())
    return path


def tables(told: dict[str, Any]) -> Iterator[Table]:
    """Yield the receptance at the probes nearest to the blow, their peaks, and the decay rates."""
    near = min(abs(p["distance"]) for p in told["probes"].values())
    for name, probe in told["probes"].items():
        if abs(probe["distance"]) <= near + NEAR:
            yield lines_table(name, probe, told["frequency"])
            if probe["peaks"]:
                yield Table(f"{name}: peaks, damping by half power", PEAKS, probe["peaks"])
    for key, row in told["decay"].items():
        rows = list(zip(told["band"], row["rate"], strict=True))
        note = f"to {row['reach']:.2f} m: least that can be told {DB / row['reach']:.2f} dB/m"
        yield Table(f"decay rate along {key}", RATES, rows, note)


def lines_table(name: str, probe: dict[str, Any], frequency: list[float]) -> Table:
    """Return the receptance of a probe at the middles of the bands."""
    keys = ("magnitude", "phase", "cut_off")
    rows = list(zip(frequency, *(probe[k] for k in keys), strict=True))
    return Table(f"{name}, {probe['distance']:.2f} m from the blow", LINE, rows)
