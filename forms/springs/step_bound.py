# SPDX-License-Identifier: LGPL-3.0-or-later
"""Stable step of bodies on springs and dampers, to the ground, each other or point masses.

For bodies with ``ω_max ≤ frequency``, and connections as in :mod:`forms.springs.connections`:

    springs, dampers = attached(comm, masses, links, mass)
    dt = joined_step(frequency, springs, dampers, stiffness_damping, mass_damping)

The frequency may have the springs in it already (``assembled_frequency(..., springs.nodal)``,
``held=True``), which is sharper than adding the largest of each.
"""

from collections.abc import Iterable
from dataclasses import dataclass

from mpi4py import MPI

import numpy as np

from forms.springs.point_masses import PointMasses
from forms.springs.springs import Springs
from meshes.arrays import Array


@dataclass(frozen=True)
class Attached:
    """All springs, or all dampers, over the masses at their ends; rates alike on all ranks.

    Attributes:
        nodal: Sum on every local dof, ghosts left out, shape ``(3 * n_local,)`` [N/m] or [N s/m].
        rate: The largest of it over the mass of its dof [1/s²] or [1/s].
        tied: Sum between bodies and each free component of a point mass, over its mass, ``(f,)``.
        base: That between these components and the ground, over their mass, shape ``(f,)``.
    """

    nodal: Array
    rate: float
    tied: Array
    base: Array


NONE = Attached(np.zeros(0), 0.0, np.zeros(0), np.zeros(0))


def attached(
    comm: MPI.Comm, masses: PointMasses, links: Iterable[Springs], mass: Array
) -> tuple[Attached, Attached]:
    """Return springs and dampers of connections; collective.

    A damping matrix is bounded by dampers along the axes, the sums of the sizes in each row: the
    rest of a row is what a diagonally dominant matrix has to have (Gershgorin).

    Args:
        comm: Ranks that share the bodies.
        masses: Point masses.
        links: Springs and dampers between them and the bodies.
        mass: Lumped mass of every local dof, shape ``(3 * n_local,)`` [kg].
    """
    links = list(links)
    springs = [(link, link.stiffness) for link in links]
    dampers = [(link, _along_axes(link.damping)) for link in links]
    return (
        _attached(comm, masses, springs, masses.base_stiffness, mass),
        _attached(comm, masses, dampers, masses.base_damping, mass),
    )


def _along_axes(damping: Array) -> Array:
    """Return dampers ``(n, 3)`` as they are, damping matrices ``(n, 3, 3)`` as dampers."""
    return damping if damping.ndim == 2 else np.asarray(np.abs(damping).sum(axis=2))


def _attached(
    comm: MPI.Comm,
    masses: PointMasses,
    links: list[tuple[Springs, Array]],
    ground: Array,
    mass: Array,
) -> Attached:
    """Sum the links' coefficients on both sides."""
    nodal, tied = np.zeros_like(mass), np.zeros_like(masses.u)
    for link, coefficient in links:
        nodal.reshape(-1, 3)[link.dofs] += link.majorant(coefficient, mass)
        link.add_at_points(coefficient, tied)
    if comm.size > 1:
        comm.Allreduce(MPI.IN_PLACE, tied)
    rate = comm.allreduce(float((nodal / mass).max(initial=0.0)), op=MPI.MAX)
    free = masses.free > 0
    per_mass = 1 / masses.mass[:, None]
    return Attached(nodal, rate, (tied * per_mass)[free], (ground * per_mass)[free])


def as_springs(springs: Attached, dampers: Attached, dt: float) -> Attached:
    """Return springs that bound central difference as springs and lagged dampers do together.

    ``dt²/4 K + dt/2 C < M`` is ``dt²/4 (K + 2/dt C) < M``.
    """
    factor = 2 / dt
    return Attached(
        springs.nodal + factor * dampers.nodal,
        springs.rate + factor * dampers.rate,
        springs.tied + factor * dampers.tied,
        springs.base + factor * dampers.base,
    )


def joined(value: float, attachments: Attached, *, held: bool = False) -> float:
    """Return a bound of the largest eigenvalue of bodies, connections and point masses.

    Springs to the ground add at most their largest ``k / m``. One between a node and a point mass
    is parted, ``(x - q)² ≤ (1 + θ) x² + (1 + 1/θ) q²`` for any θ > 0, which leaves bodies with
    ``value + (1 + θ) rate`` and each point mass with ``base + (1 + 1/θ) tied``; θ is taken where
    both are alike. For one mass on another this is ``k (1/m + 1/M)``, exactly.

    Args:
        value: Bound for the bodies alone: ω² [1/s²] with springs, that of ``M⁻¹ C`` with dampers
            [1/s].
        attachments: The springs or the dampers.
        held: Whether ``value`` has them in it already, with all point masses held.
    """
    rate, tied, base = attachments.rate, attachments.tied, attachments.base
    start = value if held else value + rate
    if not len(tied):
        return start
    gap = start - base - tied  # rate θ² + gap θ - tied = 0; of its two ways the one without loss
    root = np.sqrt(gap**2 + 4 * rate * tied)
    raised = np.where(
        gap > 0, 2 * rate * tied / np.where(gap > 0, gap + root, 1.0), (root - gap) / 2
    )
    return float(np.max(start + raised))


def joined_step(
    frequency: float,
    springs: Attached,
    dampers: Attached,
    stiffness_damping: float = 0.0,
    mass_damping: float = 0.0,
    *,
    held: bool = False,
    room: float = 1.0,
) -> float:
    """Return a stable step of central difference with all damping lagged by half a step [s].

    The scheme is stable while ``dt²/4 K + dt/2 C < M``: with the largest eigenvalues ω² of
    ``M⁻¹ K`` and c of ``M⁻¹ C`` up to the root of ``ω² dt²/4 + c dt/2 = 1``, which is
    ``dt = 2/ω (√(1 + ζ²) − ζ)`` with ``ζ = c / (2 ω)``.

    Where only the step of damped bodies is known (:func:`forms.viscosity.damped_step`), frequency 0
    and ``mass_damping = 2 / dt`` are on the safe side: damping counts most at smaller steps.

    Args:
        frequency: Bound of the bodies' largest frequency [rad/s].
        springs: Springs (:func:`attached`).
        dampers: Dampers.
        stiffness_damping: Largest stiffness-proportional damping β of a body [s].
        mass_damping: Largest mass-proportional damping α of a body [1/s].
        held: Whether ``frequency`` has the springs in it already.
        room: What is left of the 1 by springs that are in proportion to ``m / dt²``, as those of
            contact: 1 less a quarter of their factors [-].
    """
    square = joined(frequency**2, springs, held=held)
    lag = joined(stiffness_damping * frequency**2 + mass_damping, dampers)
    return float(2 * room / (np.sqrt(lag**2 / 4 + room * square) + lag / 2))
