# SPDX-License-Identifier: LGPL-3.0-or-later
"""Track as a beam on two layers, pads, sleepers and ballast all spread evenly along it.

An endless Bernoulli beam, ``E I ∂⁴w/∂x⁴ + (S - m ω²) w = F δ(x)``, on the dynamic stiffness per
length ``S = p q / (p + q)`` of pads, ``p = k_p + i ω c_p``, and of sleepers on ballast,
``q = k_b + i ω c_b - m_s ω²`` (D. J. Thompson, *Railway Noise and Vibration*, chapter 3). It knows
no sleepers that lie apart, and no pinned-pinned resonance between them.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from meshes.arrays import Array
from workflow.model.regions import owners
from workflow.scene.bodies import Orthotropic
from workflow.scene.mesh import RailMesh
from workflow.scene.scene import Scene

Complex = npt.NDArray[np.complex128]

FITTED = ("pad_stiffness", "pad_damping", "ballast_stiffness", "ballast_damping")
RAILS = {"54E1": (2.3379e-5, 54.77), "60E1": (3.0383e-5, 60.21)}  # I [m⁴], kg/m (EN 13674-1)


@dataclass(frozen=True)
class TrackBeam:
    """A track as a beam on two layers.

    Attributes:
        bending: E I of the rail [N m²].
        mass: Of the rail [kg/m].
        spacing: Of the sleepers [m].
        sleeper: Mass of a (half) sleeper [kg].
        pad_stiffness, pad_damping: Vertical, of one pad [N/m, N s/m].
        ballast_stiffness, ballast_damping: Vertical, under one sleeper [N/m, N s/m].
    """

    bending: float
    mass: float
    spacing: float
    sleeper: float
    pad_stiffness: float
    pad_damping: float
    ballast_stiffness: float
    ballast_damping: float

    def foundation(self, frequency: Array) -> Complex:
        """Return the dynamic stiffness under the rail, shape ``(m,)`` [N/m²]."""
        omega = 2 * np.pi * np.asarray(frequency)
        pad = self.pad_stiffness + 1j * omega * self.pad_damping
        under = self.ballast_stiffness + 1j * omega * self.ballast_damping
        under = under - omega**2 * self.sleeper
        return np.asarray(pad * under / (pad + under) / self.spacing)

    def receptance(self, frequency: Array, distance: Array | float = 0.0) -> Complex:
        """Return displacement over force at distances from it, shape ``(..., m)`` [m/N].

        The two waves that decay away from the force, ``Σ exp(-i k |x|) / (4 i E I k³)``.

        Args:
            frequency: Shape ``(m,)`` [Hz]; 0 is at rest.
            distance: Shape ``(...,)`` [m].
        """
        omega = 2 * np.pi * np.asarray(frequency)
        fourth = (self.mass * omega**2 - self.foundation(frequency)) / self.bending
        k = (fourth + 0j) ** 0.25 * np.array([[1], [1j], [-1], [-1j]])
        x = np.abs(np.asarray(distance))[..., None, None]
        waves = np.where(k.imag < 0, np.exp(-1j * k * x) / (4j * self.bending * k**3), 0.0)
        return np.asarray(waves.sum(axis=-2))


def of_scene(scene: Scene) -> TrackBeam | None:
    """Return the beam of a rail on solid sleepers or on point masses; None of another scene."""
    mesh, track, own = scene.mesh, scene.track, owners(scene)
    if not isinstance(mesh, RailMesh) or track is None:
        return None
    inertia, mass = RAILS[mesh.rail_profile]
    steel = scene.bodies[own["rail_head"]].material
    if isinstance(steel, Orthotropic):
        return None
    sleeper, spacing = track.sleeper_mass, track.sleeper_spacing
    if (box := mesh.sleepers) is not None:
        density = scene.bodies[own["sleeper"]].material.density
        sleeper, spacing = density * box.length * box.width * box.height, box.spacing
    assert sleeper is not None and spacing is not None
    return TrackBeam(
        bending=steel.youngs_modulus * inertia,
        mass=mass,
        spacing=spacing,
        sleeper=sleeper,
        pad_stiffness=track.pad_stiffness[2],
        pad_damping=track.pad_damping[2],
        ballast_stiffness=track.ballast_stiffness,
        ballast_damping=track.ballast_damping,
    )


def fit_track(beam: TrackBeam, curve: str | Path) -> TrackBeam:
    """Return a track whose pads and ballast give a measured receptance.

    Least squares of the logarithm of the magnitude, over the logarithms of both stiffnesses and
    both dampings. The curve should end below the pinned-pinned frequency, about 1 kHz.

    Args:
        beam: Rail, sleepers and first guess of pads and ballast.
        curve: CSV with one line of headings: frequency [Hz], magnitude of the receptance where it
            is hit [m/N]; other columns are not read.

    Raises:
        ValueError: if the file has no such columns, or the fit does not converge.
    """
    from scipy.optimize import least_squares

    try:
        f, size = np.loadtxt(curve, delimiter=",", skiprows=1, usecols=(0, 1), unpack=True, ndmin=2)
    except (ValueError, IndexError) as error:
        raise ValueError(
            f"{str(curve)!r}: expected columns frequency, magnitude: {error}"
        ) from None
    if len(f) < len(FITTED) or not (f > 0).all() or not (size > 0).all():
        raise ValueError(f"{str(curve)!r}: expected {len(FITTED)} lines or more, all above zero")

    def track(x: Array) -> TrackBeam:
        return replace(beam, **dict(zip(FITTED, np.exp(x).tolist(), strict=True)))

    def off(x: Array) -> Array:
        return np.asarray(np.log(np.abs(track(x).receptance(f)) / size))

    found = least_squares(off, np.log([getattr(beam, key) for key in FITTED]))
    if not found.success:
        raise ValueError(f"{str(curve)!r}: no fit, {found.message}")
    return track(found.x)
