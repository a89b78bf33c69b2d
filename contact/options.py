# SPDX-License-Identifier: LGPL-3.0-or-later
"""Options of a contact pair, checked once."""

from dataclasses import dataclass

import numpy as np

from contact.friction import Law

METHODS = ("penalty", "modulus-penalty", "implicit-penalty", "lagrange")
IMPLICIT = METHODS[2:]  # forces that fit the gaps at the end of the step
OVERLAPS = ("offset", "push")


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
        for key, known in (("method", METHODS), ("initial_overlap", OVERLAPS)):
            if (word := getattr(self, key)) not in known:
                raise ValueError(f"{key}: expected one of {', '.join(known)}, got {word!r}")
        if self.method in IMPLICIT and self.damping > 0.0:
            raise ValueError(
                f"damping: expected 0 with method = {self.method!r}, got {self.damping}"
            )
