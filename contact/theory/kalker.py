# SPDX-License-Identifier: LGPL-3.0-or-later
"""Kalker's linear theory of steady rolling at small creepage: coefficients and forces.

Table of the creep coefficients: J. J. Kalker, Three-Dimensional Elastic Bodies in Rolling Contact
(1990), table E3. Between its columns: linear in log(a/b), quadratic in Poisson's ratio.
"""

import numpy as np
import numpy.typing as npt

# half axis along the rolling direction over the one across it
RATIO = np.array([k / 10 for k in range(1, 10)] + [10 / k for k in range(10, 0, -1)])
POISSON = np.array([0.0, 0.25, 0.5])

# fmt: off
TABLE = {name: np.array(rows) for name, rows in {
    "c11": [
        [2.51, 2.59, 2.68, 2.78, 2.88, 2.98, 3.09, 3.19, 3.29,
         3.40, 3.51, 3.65, 3.82, 4.06, 4.37, 4.84, 5.57, 6.96, 10.7],
        [3.31, 3.37, 3.44, 3.53, 3.62, 3.72, 3.81, 3.91, 4.01,
         4.12, 4.22, 4.36, 4.54, 4.78, 5.10, 5.57, 6.34, 7.78, 11.7],
        [4.85, 4.81, 4.80, 4.82, 4.83, 4.91, 4.97, 5.05, 5.12,
         5.20, 5.30, 5.42, 5.58, 5.80, 6.11, 6.57, 7.34, 8.82, 12.9],
    ],
    "c22": [
        [2.51, 2.59, 2.68, 2.78, 2.88, 2.98, 3.09, 3.19, 3.29,
         3.40, 3.51, 3.65, 3.82, 4.06, 4.37, 4.84, 5.57, 6.96, 10.7],
        [2.52, 2.63, 2.75, 2.88, 3.01, 3.14, 3.28, 3.41, 3.54,
         3.67, 3.81, 3.99, 4.21, 4.50, 4.90, 5.48, 6.40, 8.14, 12.8],
        [2.53, 2.66, 2.81, 2.98, 3.14, 3.31, 3.48, 3.65, 3.82,
         3.98, 4.16, 4.39, 4.67, 5.04, 5.56, 6.31, 7.51, 9.79, 16.0],
    ],
    "c23": [
        [0.334, 0.483, 0.607, 0.720, 0.827, 0.930, 1.03, 1.13, 1.23,
         1.33, 1.44, 1.58, 1.76, 2.01, 2.35, 2.88, 3.79, 5.72, 12.2],
        [0.473, 0.603, 0.715, 0.823, 0.929, 1.03, 1.14, 1.25, 1.36,
         1.47, 1.59, 1.75, 1.95, 2.23, 2.62, 3.24, 4.32, 6.63, 14.6],
        [0.731, 0.809, 0.889, 0.977, 1.07, 1.18, 1.29, 1.40, 1.51,
         1.63, 1.77, 1.94, 2.18, 2.50, 2.96, 3.70, 5.01, 7.89, 18.0],
    ],
}.items()}
# fmt: on


def coefficient(name: str, ratio: float, poisson: float) -> float:
    """Return a creep coefficient [-].

    Args:
        name: ``c11`` (longitudinal), ``c22`` (lateral) or ``c23`` (lateral force of spin).
        ratio: Half axis of the patch along the rolling direction over that across it, a/b [-].
        poisson: Poisson's ratio of both bodies [-].

    Raises:
        ValueError: if the name is unknown or a number is outside of the table.
    """
    if name not in TABLE:
        raise ValueError(f"name: expected one of {', '.join(TABLE)}, got {name!r}")
    if not RATIO[0] <= ratio <= RATIO[-1]:
        raise ValueError(f"ratio: expected {RATIO[0]} to {RATIO[-1]:.0f}, got {ratio}")
    if not 0 <= poisson <= 0.5:
        raise ValueError(f"poisson: expected 0 to 0.5, got {poisson}")
    rows = [np.interp(np.log(ratio), np.log(RATIO), row) for row in TABLE[name]]
    return float(np.polyval(np.polyfit(POISSON, rows, 2), poisson))


def creep_force(
    creepage: tuple[float, float, float],
    semi_axes: tuple[float, float],
    shear_modulus: float,
    poisson: float,
) -> npt.NDArray[np.float64]:
    """Return the force on the wheel along and across the rolling direction, shape ``(2,)`` [N].

    ``F_x = −c² G c₁₁ ξ``, ``F_y = −c² G c₂₂ η − c³ G c₂₃ φ`` with ``c² = a b``.

    Args:
        creepage: Longitudinal ξ [-], lateral η [-], spin φ [1/m].
        semi_axes: Half axes of the patch, a along and b across the rolling direction [m].
        shear_modulus: Of both bodies [Pa].
        poisson: Of both bodies [-].
    """
    (xi, eta, phi), (a, b) = creepage, semi_axes
    c11, c22, c23 = (coefficient(name, a / b, poisson) for name in ("c11", "c22", "c23"))
    c = np.sqrt(a * b)
    along, across = c11 * xi, c22 * eta + c * c23 * phi
    return np.asarray(-(c**2) * shear_modulus * np.array([along, across]))


def saturated(linear: float, limit: float) -> float:
    """Return a creep force with the part of the patch that slips (Vermeulen and Johnson 1964).

    ``limit (1 − (1 − s)³)`` with ``s = linear / (3 limit)``, and the limit beyond ``s = 1``.

    Args:
        linear: Size of the force of the linear theory [N].
        limit: Coefficient of friction times normal force [N].

    Raises:
        ValueError: if a force is negative or the limit zero.
    """
    if not (linear >= 0 and limit > 0):
        raise ValueError(f"expected linear >= 0 and limit > 0 N, got {linear} N and {limit} N")
    return float(limit * (1 - (1 - min(linear / (3 * limit), 1)) ** 3))
