# SPDX-License-Identifier: LGPL-3.0-or-later
"""Options of a contact pair, checked once."""

from dataclasses import dataclass

import numpy as np

from contact.friction import Law

METHODS = ("penalty", "modulus-penalty", "implicit-penalty", "lagrange")
IMPLICIT = METHODS[2:]  # forces that fit the gaps at the end of the step
OVERLAPS = ("offset", "push")
POINTS = ("nodes", "quadrature")
WITH_QUADRATURE = ("penalty", "implicit-penalty")


@dataclass(frozen=True, kw_only=True)
class Options:
    """Options of one pass; their meaning is told by :class:`contact.pair.ContactPair`."""

    dt: float
    law: Law
    penalty: float
    damping: float
    tangential: float
    reach: float | None
    method: str
    smooth: bool
    sharp_angle: float
    initial_overlap: str
    offset_time: float
    points: str

    def __post_init__(self) -> None:
        """Raise ValueError naming the option that does not fit."""
        for key in ("dt", "penalty", "tangential"):
            value = getattr(self, key)
            if not (np.isfinite(value) and value > 0.0):
                raise ValueError(f"{key}: expected a finite value > 0, got {value}")
        for key in ("damping", "offset_time"):
            value = getattr(self, key)
            if not (np.isfinite(value) and value >= 0.0):
                raise ValueError(f"{key}: expected a finite value >= 0, got {value}")
        if not 0.0 < self.sharp_angle < np.pi:
            raise ValueError(
                f"sharp_angle: expected an angle in (0, pi) rad, got {self.sharp_angle}"
            )
        for key, known in (
            ("method", METHODS),
            ("initial_overlap", OVERLAPS),
            ("points", POINTS),
        ):
            if (word := getattr(self, key)) not in known:
                raise ValueError(f"{key}: expected one of {', '.join(known)}, got {word!r}")
        if self.points == "quadrature" and self.method not in WITH_QUADRATURE:
            raise ValueError(
                f"points = 'quadrature': expected method {' or '.join(WITH_QUADRATURE)}, "
                f"got {self.method!r}"
            )
        if self.method in IMPLICIT and self.damping > 0.0:
            raise ValueError(
                f"damping: expected 0 with method = {self.method!r}, got {self.damping}"
            )
