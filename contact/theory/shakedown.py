# SPDX-License-Identifier: LGPL-3.0-or-later
"""Limits of rolling and sliding line contact on a half-plane that yields: first yield, shakedown.

Hertz's pressure with a shear traction in proportion to it, as full slip has (elastic stresses:
Johnson, Contact Mechanics, 1985, sections 4.2 and 7.1). In a half-plane over which it rolls, only
the residual stresses along and across the way that depend on depth alone can stay. By Melan's
theorem steel without hardening shakes down if some of them keep every point within yield: at each
depth the path of stress must fit into a ball of radius k in the space of stresses, its centre in
the plane of those residual ones.
"""

from collections.abc import Callable
from functools import cache

import numpy as np

from meshes.arrays import Array

DEPTHS = np.concatenate([[1e-6], np.linspace(0.05, 1.2, 24)])  # over the half width
ALONG = np.sort(np.concatenate([np.linspace(-3.0, 3.0, 241), [-1.0, 1.0]]))
HALVINGS = 24  # of the intervals of both residual stresses, by a third each
# Without traction under a circular patch, over k: p0 = 1.60 Y (Poisson's ratio 0.3, von Mises), and
# Johnson, 1985, chapter 9, as it is commonly quoted.
POINT_FIRST_YIELD, POINT_SHAKEDOWN = 1.60 * 3**0.5, 4.7


def line_contact_stresses(x: Array, z: Array, friction: float) -> tuple[Array, Array, Array]:
    """Return σx, σz and τxz of a sliding line contact in plane strain, over its largest pressure.

    Args:
        x: Places along the way over the half width.
        z: Depths over the half width, above 0.
        friction: Shear traction along x, on the half-plane, over pressure.
    """
    square = 1 - x**2 + z**2
    root = np.sqrt(square**2 + 4 * x**2 * z**2)
    m = np.sqrt((root + square) / 2)
    n = np.sign(x) * np.sqrt(np.maximum(root - square, 0) / 2)
    share = (z**2 + n**2) / (m**2 + n**2)
    sx, sz = -(m * (1 + share) - 2 * z), -m * (1 - share)
    txz = -n * (m**2 - z**2) / (m**2 + n**2)
    slid = n * (2 - (z**2 - m**2) / (m**2 + n**2)) - 2 * x  # σx of the shear traction
    return sx + friction * slid, sz + friction * txz, txz + friction * sx


def _path(friction: float, nu: float) -> tuple[Array, Array, Array]:
    """Return the coordinates of the stress in units of shear, each ``(depths, places)``.

    Half the difference in the plane, what the stress across the plane differs from the mean in it,
    and shear: the sum of their squares is that of von Mises' stress over √3.
    """
    sx, sz, txz = line_contact_stresses(ALONG, DEPTHS[:, None], friction)
    return (sx - sz) / 2, (nu - 0.5) * (sx + sz) / 3**0.5, txz


@cache
def line_first_yield(friction: float, nu: float = 0.3) -> float:
    """Return the largest pressure at first yield over the yield stress in shear, p₀/k."""
    a, b, c = _path(friction, nu)
    return float(1 / np.sqrt((a**2 + b**2 + c**2).max()))


@cache
def line_shakedown(friction: float, nu: float = 0.3) -> float:
    """Return the largest p₀/k that shakes down."""
    a, b, c = _path(friction, nu)

    def level(r: Array, s: Array) -> Array:
        squares = (a + r[:, None]) ** 2 + (b + s[:, None]) ** 2 + c**2
        return np.asarray(squares.max(axis=1))

    def across(r: Array) -> Array:
        return _least(lambda s: level(r, s), len(DEPTHS))

    return float(1 / np.sqrt(_least(across, len(DEPTHS)).max()))


def _least(function: Callable[[Array], Array], count: int) -> Array:
    """Return the least values of convex functions between -2 and 2, shape ``(count,)``."""
    low, high = np.full(count, -2.0), np.full(count, 2.0)
    for _ in range(HALVINGS):
        third = (high - low) / 3
        left = function(low + third) < function(high - third)
        low, high = np.where(left, low, low + third), np.where(left, high - third, high)
    return np.asarray(function((low + high) / 2))
