# SPDX-License-Identifier: LGPL-3.0-or-later
"""Track as a beam: on two layers spread evenly along it, or on sleepers that lie apart.

On two layers an endless Bernoulli beam, ``E I ∂⁴w/∂x⁴ + (S - m ω²) w = F δ(x)``, lies on the
dynamic stiffness per length ``S = p q / (p + q)`` of pads, ``p = k_p + i ω c_p``, and of sleepers
on ballast, ``q = k_b + i ω c_b - m_s ω²`` (D. J. Thompson, *Railway Noise and Vibration*, chapter
3). On sleepers that lie apart it is an endless Timoshenko beam, free but for the forces of the pads
(M. A. Heckl, J. Sound Vib. 184, 1995), so that there is the pinned-pinned resonance.
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
# I [m⁴], A [m²], kg/m (EN 13674-1); part of A that bears shear, of the section as meshed
RAILS = {
    "54E1": (2.3379e-5, 6.977e-3, 54.77, 0.391),
    "60E1": (3.0383e-5, 7.670e-3, 60.21, 0.398),
}
BESIDE = 25  # sleepers on either side of the blow
POINTS = 3  # that a pad is taken for


@dataclass(frozen=True)
class TrackBeam:
    """A rail on pads, sleepers and ballast.

    Attributes:
        bending: E I of the rail [N m²].
        shearing: κ G A [N].
        mass: Of the rail [kg/m].
        rotary: Rotatory inertia ρ I [kg m].
        spacing: Of the sleepers [m].
        seat: Length of a pad along the rail [m].
        sleeper: Mass of a (half) sleeper [kg].
        pad_stiffness: Vertical, of one pad [N/m].
        pad_damping: The same [N s/m].
        ballast_stiffness: Vertical, under one sleeper [N/m].
        ballast_damping: The same [N s/m].
    """

    bending: float
    shearing: float
    mass: float
    rotary: float
    spacing: float
    seat: float
    sleeper: float
    pad_stiffness: float
    pad_damping: float
    ballast_stiffness: float
    ballast_damping: float

    def layers(self, omega: Array | float) -> tuple[Complex, Complex]:
        """Return the dynamic stiffness of a pad, and of a sleeper on its ballast [N/m]."""
        w = np.asarray(omega)
        under = self.ballast_stiffness + 1j * w * self.ballast_damping - w**2 * self.sleeper
        return self.pad_stiffness + 1j * w * self.pad_damping, under

    def receptance(self, frequency: Array, distance: Array | float = 0.0) -> Complex:
        """Return displacement over force on two even layers, shape ``(..., m)`` [m/N].

        The two waves that decay away from the force, ``Σ exp(-i k |x|) / (4 i E I k³)``.

        Args:
            frequency: Shape ``(m,)`` [Hz]; 0 is at rest.
            distance: From the force, shape ``(...,)`` [m].
        """
        omega = 2 * np.pi * np.asarray(frequency)
        pad, under = self.layers(omega)
        foundation = pad * under / (pad + under) / self.spacing
        fourth = (self.mass * omega**2 - foundation) / self.bending
        k = (fourth + 0j) ** 0.25 * np.array([[1], [1j], [-1], [-1j]])
        x = np.abs(np.asarray(distance))[..., None, None]
        waves = np.where(k.imag < 0, np.exp(-1j * k * x) / (4j * self.bending * k**3), 0.0)
        return np.asarray(waves.sum(axis=-2))

    def on_sleepers(self, frequency: Array, hit: float, place: Array) -> Complex:
        """Return displacement over force on sleepers that lie apart, shape ``(p, m)`` [m/N].

        Args:
            frequency: Above zero, shape ``(m,)`` [Hz].
            hit: Place of the force, counted from a sleeper [m].
            place: Where the motion is, counted so, shape ``(p,)`` [m].
        """
        every = 2 * np.pi * np.asarray(frequency)
        found = [self.carried(omega, *self.between(omega, hit, place)) for omega in every]
        return np.stack(found, axis=-1)

    def between(self, omega: float, hit: float, place: Array) -> tuple[Complex, ...]:
        """Return receptances of the rail alone between force, seats and places [m/N].

        Force to places ``(p,)``, force to seats ``(s,)``, seats to places ``(p, s)``, seats to
        seats ``(s, s)``, with ``POINTS`` of each seat; arguments as :meth:`on_sleepers`, ω [1/s].
        """
        near = np.round(hit / self.spacing) + np.arange(-BESIDE, BESIDE + 1)
        along = self.seat * ((np.arange(POINTS) + 0.5) / POINTS - 0.5)
        x = (self.spacing * near[:, None] + along).ravel()
        place = np.asarray(place)
        ways = (place - hit, x - hit, place[:, None] - x, x[:, None] - x)
        return tuple(self.free(omega, way) for way in ways)

    def carried(
        self, omega: float, straight: Complex, to_seats: Complex, onward: Complex, among: Complex
    ) -> Complex:
        """Return the receptances of the rail on its pads, shape ``(p,)``; see :meth:`between`."""
        pad, under = self.layers(omega)
        part = pad / POINTS
        one = part * np.eye(POINTS) - part**2 / (pad + under)  # the sleeper moves along
        K = np.kron(np.eye(len(to_seats) // POINTS), one)
        w = np.linalg.solve(np.eye(len(to_seats)) + among @ K, to_seats)
        return np.asarray(straight - onward @ (K @ w))

    def free(self, omega: float, distance: Array) -> Complex:
        """Return displacement over force of the endless rail alone, shape of the distance [m/N].

        ``-i Σ N(k) / D'(k) exp(-i k |x|)`` over the waves that run or decay away, the roots of
        Timoshenko's ``D = s B k⁴ - (s J + m B) ω² k² - m ω² (s - J ω²)`` with ``s = κ G A``,
        ``B = E I``, ``J = ρ I`` and ``N = B k² + s - J ω²``.

        Args:
            omega: ω [1/s].
            distance: From the force [m].
        """
        s, B, J, m = self.shearing, self.bending, self.rotary, self.mass
        a, b = s * B, -(s * J + m * B) * omega**2
        squares = np.roots([a, b, -m * omega**2 * (s - J * omega**2)]).astype(complex)
        k = np.sqrt(squares)
        k = np.where(k.imag > 0, -k, k)
        size = -1j * (B * squares + s - J * omega**2) / (4 * a * k**3 + 2 * b * k)
        return np.asarray(np.exp(-1j * np.abs(distance)[..., None] * k) @ size)


def of_scene(scene: Scene) -> TrackBeam | None:
    """Return the beam of a rail on solid sleepers or on point masses; None of another scene."""
    mesh, track, own = scene.mesh, scene.track, owners(scene)
    if not isinstance(mesh, RailMesh) or track is None:
        return None
    inertia, area, mass, sheared = RAILS[mesh.rail_profile]
    steel = scene.bodies[own["rail_head"]].material
    if isinstance(steel, Orthotropic):
        return None
    E = steel.youngs_modulus
    sleeper, spacing = track.sleeper_mass, track.sleeper_spacing
    if (box := mesh.sleepers) is not None:
        density = scene.bodies[own["sleeper"]].material.density
        sleeper, spacing = density * box.length * box.width * box.height, box.spacing
    assert sleeper is not None and spacing is not None
    return TrackBeam(
        bending=E * inertia,
        shearing=sheared * area * E / (2 * (1 + steel.poisson_ratio)),
        mass=mass,
        rotary=mass / area * inertia,
        spacing=spacing,
        seat=track.seat_length,
        sleeper=sleeper,
        pad_stiffness=track.pad_stiffness[2],
        pad_damping=track.pad_damping[2],
        ballast_stiffness=track.ballast_stiffness,
        ballast_damping=track.ballast_damping,
    )


def fit_track(beam: TrackBeam, curve: str | Path, hit: float) -> TrackBeam:
    """Return a track whose pads and ballast give a measured receptance, on sleepers that lie apart.

    Least squares of the logarithm of the magnitude, over the logarithms of both stiffnesses and
    both dampings.

    Args:
        beam: Rail, sleepers and first guess of pads and ballast.
        curve: CSV with one line of headings: frequency [Hz], magnitude of the receptance where it
            is hit [m/N]; other columns are not read. 30 to 100 lines are enough, evenly over the
            logarithm of the frequency.
        hit: Place of the force, counted from a sleeper [m].

    Raises:
        ValueError: if the file has no such columns, or the fit does not converge.
    """
    from scipy.optimize import least_squares

    try:
        f, size = np.loadtxt(curve, delimiter=",", skiprows=1, usecols=(0, 1), unpack=True, ndmin=2)
    except (ValueError, IndexError) as error:
        raise ValueError(f"{str(curve)!r}: expected frequency, magnitude: {error}") from None
    if len(f) < len(FITTED) or not (f > 0).all() or not (size > 0).all():
        raise ValueError(f"{str(curve)!r}: expected {len(FITTED)} lines or more, all above zero")
    rail = [(w, beam.between(w, hit, np.array([hit]))) for w in 2 * np.pi * f]

    def track(x: Array) -> TrackBeam:
        return replace(beam, **dict(zip(FITTED, np.exp(x).tolist(), strict=True)))

    def off(x: Array) -> Array:
        guess = track(x)
        found = np.array([guess.carried(w, *ways)[0] for w, ways in rail])
        return np.asarray(np.log(np.abs(found) / size))

    best = least_squares(off, np.log([getattr(beam, key) for key in FITTED]))
    if not best.success:
        raise ValueError(f"{str(curve)!r}: no fit, {best.message}")
    return track(best.x)
