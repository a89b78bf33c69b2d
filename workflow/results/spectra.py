# SPDX-License-Identifier: LGPL-3.0-or-later
"""Spectra of samples that are means over windows: one-sided amplitude densities by Welch."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from meshes.arrays import Array

SEGMENT = 0.02  # longer records are averaged over segments of that length [s]
TREND = 3  # degree of the polynomial taken from each segment
WINDOW = "hann"
FEWEST = 16  # samples that a spectrum is made of


@dataclass(frozen=True)
class Spectrum:
    """A one-sided amplitude spectral density.

    Attributes:
        frequency: From one line above zero to half the sampling rate, shape ``(m,)`` [Hz].
        density: Shape ``(m, ...)`` [unit/√Hz]; its square integrates to the mean square.
        resolution: Distance of two lines, one over the length of a segment [Hz].
        segments: How many of them were averaged, half overlapped.
    """

    frequency: Array
    density: Array
    resolution: float
    segments: int


def filtering(frequency: Array | float, interval: float) -> Array:
    """Return what a mean over ``interval`` leaves of an amplitude: ``sin(π f T) / (π f T)``."""
    return np.asarray(np.sinc(np.asarray(frequency) * interval))


def leakage(frequency: float, interval: float) -> float:
    """Return how much of an amplitude at ``1/T - f`` shows up at f once f is corrected.

    ``sinc(1 - f T) / sinc(f T) = f T / (1 - f T)``.
    """
    x = frequency * interval
    return x / (1 - x)


def detrended(x: Any, axis: int = -1) -> Any:
    """Return samples less the cubic that fits them best along an axis.

    A wheel that rolls on turns about its own axes by a fraction of a turn, along which velocities
    change; a straight line would leave much of that.
    """
    x = np.moveaxis(np.asarray(x, dtype=np.float64), axis, -1)
    basis = np.polynomial.legendre.legvander(np.linspace(-1, 1, x.shape[-1]), TREND)
    q, _ = np.linalg.qr(basis)
    return np.moveaxis(x - (x @ q) @ q.T, -1, axis)


def spectrum(x: Array, interval: float) -> Spectrum | None:
    """Return the amplitude density of samples, the filter of their windows taken out.

    Welch's method (P. D. Welch, IEEE Trans. Audio Electroacoust. 15, 1967) with a Hann window,
    whose lines are 1.5 lines wide; a record shorter than ``SEGMENT`` is one segment.

    Args:
        x: Means over windows, one behind the other, shape ``(k, ...)``.
        interval: Length of a window [s].

    Returns:
        None if there are fewer than ``FEWEST`` samples.
    """
    from scipy import signal

    if len(x) < FEWEST:
        return None
    length = min(len(x), max(FEWEST, round(SEGMENT / interval)))
    f, power = signal.welch(
        x,
        1 / interval,
        window=WINDOW,
        nperseg=length,
        noverlap=length // 2,
        detrend=detrended,
        scaling="density",
        axis=0,
    )
    kept = (f > 0) & (f < 0.5 / interval * (1 - 1e-9))
    gain = filtering(f[kept], interval).reshape(-1, *[1] * (x.ndim - 1))
    segments = 1 + (len(x) - length) // (length - length // 2)
    return Spectrum(f[kept], np.sqrt(power[kept]) / gain, 1 / (length * interval), segments)


def as_velocity(found: Spectrum, quantity: str) -> Array:
    """Return the density of velocity from that of a displacement, velocity or acceleration.

    Args:
        found: Of the quantity.
        quantity: ``displacement``, ``velocity`` or ``acceleration``.
    """
    power = {"displacement": 1, "velocity": 0, "acceleration": -1}[quantity]
    omega = 2 * np.pi * found.frequency
    return found.density * (omega**power).reshape(-1, *[1] * (found.density.ndim - 1))


def turned(x: Array, t: Array, spin: Array) -> Array:
    """Return vectors in axes that turn with a steady spin and are those of the track at t = 0.

    Args:
        x: In the axes of the track, shape ``(k, 3)``.
        t: Times, shape ``(k,)`` [s].
        spin: Angular velocity, shape ``(3,)`` [rad/s].
    """
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_rotvec(-np.multiply.outer(t, spin)).apply(x))
