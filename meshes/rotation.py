# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rotation of a body that has moved and deformed: the best fit in least squares (Kabsch 1976)."""

import numpy as np

from meshes.arrays import Array


def nearest_rotation(X: Array, x: Array) -> Array:
    """Return the rotation R for which ``x − x̄`` is nearest to ``R (X − X̄)``, shape ``(3, 3)``.

    It is the polar part of ``Σ (x − x̄) (X − X̄)ᵀ``.

    Args:
        X: Places before, shape ``(n, 3)`` [m].
        x: Places after, shape ``(n, 3)`` [m].
    """
    left, _, right = np.linalg.svd((x - x.mean(axis=0)).T @ (X - X.mean(axis=0)))
    left[:, 2] *= np.linalg.det(left @ right)  # no reflection
    return np.asarray(left @ right)
