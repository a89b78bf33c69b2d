# SPDX-License-Identifier: LGPL-3.0-or-later
"""Motion of a turning body at a place that stays in the frame of the track.

Probes are material points. Those evenly round a rim give the motion between them by its Fourier
series, and so that of the material which just passes a place of the track. A wave of n nodal
diameters is seen there at its frequency plus and minus n turns per second, less what Coriolis
forces take (:func:`workflow.modes.labels.carried`).
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from meshes.arrays import Array
from workflow.results.samples import Samples
from workflow.results.spectra import turned

UNEVEN = 1e-3  # rad


@dataclass(frozen=True)
class Rim:
    """Motion round a rim, in axes that turn with the body.

    Attributes:
        t: Shape ``(k,)`` [s].
        waves: Amplitudes ``q`` of ``Σ q exp(i n θ)``, axial, radial and circumferential, of n from
            0 upwards and then the negative ones as ``numpy.fft.fft`` has them, shape ``(k, p, 3)``.
        spin: How fast the body turns [rad/s].
    """

    t: Array
    waves: npt.NDArray[np.complex128]
    spin: float

    def order(self, n: int) -> npt.NDArray[np.complex128]:
        """Return the waves of n nodal diameters seen from the track, shape ``(k, 3)``.

        Positive frequencies are of waves that run against the spin, negative ones along it.
        """
        return np.asarray(self.waves[:, n] * np.exp(-1j * n * self.spin * self.t)[:, None])

    def at(self, angle: float) -> Array:
        """Return axial, radial and circumferential motion at an angle of the track, ``(k, 3)``.

        Args:
            angle: About the spin, counted from where the first probe was at t = 0 [rad].
        """
        n = np.fft.fftfreq(self.waves.shape[1], 1 / self.waves.shape[1])
        phase = np.exp(1j * np.outer(angle - self.spin * self.t, n))
        return np.asarray(np.einsum("kn,knc->kc", phase, self.waves).real)


def rim(samples: Samples, names: list[str], spin: Array, centre: Array) -> Rim:
    """Return the motion round a rim from probes of velocity that are evenly round it.

    Args:
        samples: Of a run.
        names: Probes, in any order.
        spin: Angular velocity of the body, shape ``(3,)`` [rad/s].
        centre: A point of its axle, which stays where it is, shape ``(3,)`` [m].

    Raises:
        ValueError: if the probes are not even, or no velocities.
    """
    if wrong := [name for name in names if samples.quantity[name] != "velocity"]:
        raise ValueError(f"probes: expected quantity = 'velocity', got others of {wrong}")
    size = float(np.linalg.norm(spin))
    axle = np.asarray(spin) / size
    arms = np.array([samples.place[name] - centre for name in names])
    arms -= np.outer(arms @ axle, axle)
    first = arms[0] / np.linalg.norm(arms[0])
    angle = np.arctan2(arms @ np.cross(axle, first), arms @ first)
    angle = (angle + UNEVEN) % (2 * np.pi) - UNEVEN
    order = np.argsort(angle)
    even = 2 * np.pi * np.arange(len(names)) / len(names)
    if np.abs(angle[order] - even).max() > UNEVEN:
        raise ValueError(f"probes: expected {len(names)} evenly round the rim, got {angle[order]}")
    frames = [np.stack([axle, r, np.cross(axle, r)]) for r in arms / np.linalg.norm(arms[0])]
    moved = np.stack(
        [turned(samples.motion[names[i]], samples.t, spin) @ frames[i].T for i in order], axis=1
    )
    waves = np.asarray(np.fft.fft(moved, axis=1) / len(names), dtype=np.complex128)
    return Rim(samples.t, waves, size)
