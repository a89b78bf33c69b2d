# SPDX-License-Identifier: LGPL-3.0-or-later
"""Slip waves: waves along the frictionless contact of two half spaces that stay closed.

Where they exist, Coulomb friction of any size makes steady sliding unstable, at a rate in
proportion to the wave number, and the problem ill-posed (Ranjith and Rice, J. Mech. Phys. Solids
49, 2001, 341-361). They exist where the materials differ little (Achenbach and Epstein, J. Eng.
Mech. Div. ASCE 93, 1967, 27-42).
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq


@dataclass(frozen=True)
class HalfSpace:
    """An isotropic elastic half space.

    Attributes:
        mu: Shear modulus [Pa].
        nu: Poisson ratio [-].
        rho: Density [kg/m³].
    """

    mu: float
    nu: float
    rho: float

    @property
    def shear_speed(self) -> float:
        """Speed of shear waves [m/s]."""
        return (self.mu / self.rho) ** 0.5

    @property
    def dilatational_speed(self) -> float:
        """Speed of dilatational waves [m/s]."""
        return self.shear_speed * ((2 - 2 * self.nu) / (1 - 2 * self.nu)) ** 0.5

    def rayleigh(self, c: float) -> float:
        """Return Rayleigh's function at speed c, zero at the speed of surface waves [-]."""
        a, b = self._decay(c)
        return 4 * a * b - (1 + b**2) ** 2

    def compliance(self, c: float) -> float:
        """Return amplitude of normal displacement over pressure and wave length / 2π [1/Pa].

        Of a frictionless load that travels at c, below the speed of shear waves.
        """
        a, b = self._decay(c)
        return float(a * (1 - b**2) / (self.mu * self.rayleigh(c)))

    def _decay(self, c: float) -> tuple[float, float]:
        """Return √(1 − c²/c²) for dilatational and shear waves."""
        ratios = c / self.dilatational_speed, c / self.shear_speed
        a, b = (max(1 - r**2, 0.0) ** 0.5 for r in ratios)
        return a, b

    @property
    def rayleigh_speed(self) -> float:
        """Speed of surface waves [m/s]."""
        c = self.shear_speed
        return float(brentq(self.rayleigh, 0.5 * c, c * (1 - 1e-12)))


def slip_wave(one: HalfSpace, other: HalfSpace) -> float | None:
    """Return the speed of slip waves between two half spaces [m/s], None where there are none.

    Equal materials have the surface wave itself, which carries no pressure.

    Args:
        one: One half space.
        other: The other.
    """
    slow, fast = sorted((one, other), key=lambda h: h.rayleigh_speed)
    low, high = slow.rayleigh_speed, fast.rayleigh_speed
    if high - low <= 1e-9 * high:
        return low
    top = min(high, slow.shear_speed)
    if not np.isfinite(top) or top <= low:
        return None

    def both(c: float) -> float:  # times both Rayleigh functions: no poles
        parts = [h.compliance(c) for h in (slow, fast)]
        return sum(parts) * slow.rayleigh(c) * fast.rayleigh(c)

    ends = low * (1 + 1e-9), top * (1 - 1e-9)
    if both(ends[0]) * both(ends[1]) > 0:
        return None
    return float(brentq(both, *ends))
