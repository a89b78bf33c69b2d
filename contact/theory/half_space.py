# SPDX-License-Identifier: LGPL-3.0-or-later
"""Frictionless contact of two half-spaces with any distance between their surfaces.

What Hertz solves for an elliptic paraboloid, solved numerically for any smooth shape, as half-space
codes of rail vehicle dynamics do: the pressure is constant on each rectangle of a grid, Love's
solution gives the displacement of one rectangle at all others, their sum is a convolution done by
FFT, and a conjugate gradient method finds the pressure.

Sources: A. E. H. Love (1929), as given by K. L. Johnson, Contact Mechanics (1985), equation 3.25;
I. A. Polonsky and L. M. Keer, Wear 231 (1999) 206-219.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import fft

from meshes.arrays import Array

TOLERANCE = 1e-6  # change of pressure in an iteration over the load
ITERATIONS = 500


@dataclass(frozen=True)
class HalfSpace:
    """Pressure between two half-spaces.

    Attributes:
        pressure: On each rectangle, shape ``(n, m)`` [Pa].
        spacing: Sides of the rectangles [m].
        approach: How far the bodies come together from where ``gap`` is 0 [m].
        iterations: Iterations used.
    """

    pressure: Array
    spacing: tuple[float, float]
    approach: float
    iterations: int

    @property
    def area(self) -> float:
        """Area of the rectangles under pressure [m2]."""
        return float(np.count_nonzero(self.pressure) * self.spacing[0] * self.spacing[1])

    @property
    def reaches_the_edge(self) -> bool:
        """Tell whether there is pressure on the outermost rectangles, so the grid is too small."""
        p = self.pressure
        return bool(p[[0, -1]].any() or p[:, [0, -1]].any())


def half_space_contact(
    gap: Array, spacing: tuple[float, float], load: float, modulus: float, layer: float = 0.0
) -> HalfSpace:
    """Return the pressure between two half-spaces pressed together by a force.

    A thin soft layer between them, as penalty springs are, gives way under its own pressure only.

    Args:
        gap: Distance of the surfaces before loading in the middle of each rectangle, from any
            plane of reference, shape ``(n, m)`` [m].
        spacing: Sides of the rectangles along both axes [m].
        load: Normal force [N].
        modulus: Contact modulus E* [Pa].
        layer: How much the layer gives way under a unit pressure [m/Pa].

    Raises:
        ValueError: if the load, modulus or a spacing is not positive or the gap not finite.
        RuntimeError: if the iteration does not converge.
    """
    _check(gap, spacing, load, modulus)
    displacement = _displacements(gap.shape, spacing, modulus, layer)
    total = load / (spacing[0] * spacing[1])  # sum of the pressures
    p = np.full(gap.shape, total / gap.size)
    way, before, conjugate = np.zeros_like(gap), 1.0, 0.0
    for iteration in range(1, ITERATIONS + 1):
        g = displacement(p) + gap
        touching = p > 0
        approach = float(g[touching].mean())
        g -= approach
        square = float((g[touching] ** 2).sum())
        way = np.where(touching, g + conjugate * square / before * way, 0.0)
        before = square
        r = displacement(way)
        r -= r[touching].mean()
        step = float((g * way)[touching].sum() / (r * way)[touching].sum())
        new = np.maximum(np.where(touching, p - step * way, 0.0), 0.0)
        overlap = (new == 0) & (g < 0)
        conjugate = 0.0 if overlap.any() else 1.0
        new[overlap] -= step * g[overlap]
        new *= total / new.sum()
        change, p = float(np.abs(new - p).sum()) / total, new
        if change < TOLERANCE:
            return HalfSpace(p, spacing, approach, iteration)
    raise RuntimeError(f"half-space contact: no convergence in {ITERATIONS} iterations")


def _check(gap: Array, spacing: tuple[float, float], load: float, modulus: float) -> None:
    if not (load > 0 and modulus > 0 and min(spacing) > 0):
        raise ValueError(
            f"load, modulus, spacing: expected values > 0, got {load} N, {modulus} Pa, {spacing} m"
        )
    if gap.ndim != 2 or not np.isfinite(gap).all():
        raise ValueError(f"gap: expected finite distances of a grid, got shape {gap.shape}")


def _displacements(
    shape: tuple[int, ...], spacing: tuple[float, float], modulus: float, layer: float
) -> Callable[[Array], Array]:
    """Return the map from pressures to displacements, a convolution on a grid of twice the size."""
    n, m = shape
    x, y = (np.minimum(np.arange(2 * k), 2 * k - np.arange(2 * k)) for k in (n, m))
    kernel = _love(x[:, None] * spacing[0], y * spacing[1], spacing) / modulus
    kernel[0, 0] += layer
    factor = fft.rfft2(kernel)

    def displacement(p: Array) -> Array:
        wide = fft.rfft2(p, s=(2 * n, 2 * m))
        return np.asarray(fft.irfft2(wide * factor, s=(2 * n, 2 * m))[:n, :m])

    return displacement


def _love(x: Array, y: Array, sides: tuple[float, float]) -> Array:
    """Return E* times the displacement at ``x, y`` of a unit pressure on a rectangle about 0 [m].

    Johnson (3.25), with E* = E / (1 - nu**2); not on a line through a side of the rectangle.
    """
    right, left = x + sides[0] / 2, x - sides[0] / 2
    above, below = y + sides[1] / 2, y - sides[1] / 2

    def term(one: Array, other: Array, minus: Array) -> Array:
        # ln of (other + r) / (minus + r'), r and r' the distances of two corners of a side
        return np.asarray(one * (np.arcsinh(other / np.abs(one)) - np.arcsinh(minus / np.abs(one))))

    return np.asarray(
        (
            term(right, above, below)
            - term(left, above, below)
            + term(above, right, left)
            - term(below, right, left)
        )
        / np.pi
    )
