# SPDX-License-Identifier: LGPL-3.0-or-later
"""Steels of rails and wheels by grade: when they first yield, and how well that is known.

Standards of delivery ask for strength in one pull and say nothing of hardening under repeated load.
So there is none here: a grade is perfectly plastic unless a scene gives its hardening. Where and
when it first yields is as good as the yield stress; how much strain each pass leaves is not known
without cyclic constants, which are for a scene to bring.
"""

from dataclasses import dataclass
from typing import Literal

Grade = Literal["R260", "R350HT", "ER7", "ER8"]

YOUNGS_MODULUS, POISSON_RATIO, DENSITY = 210e9, 0.3, 7800.0  # of all of them [Pa], [-], [kg/m³]


@dataclass(frozen=True)
class Steel:
    """Strength of a grade in one pull.

    Attributes:
        yield_stress: What it is taken to yield at [Pa].
        tensile_strength: Least and, where there is one, largest [Pa].
        source: Where both are from.
        confidence: How far the yield stress may be trusted.
    """

    yield_stress: float
    tensile_strength: tuple[float, ...]
    source: str
    confidence: str


RAIL = (
    "tensile strength: EN 13674-1, which asks for no proof stress; proof stress: a usual one of "
    "tensile tests, held against no publication"
)
WHEEL = "EN 13262, rim: least upper yield stress and range of the tensile strength"
QUOTED = "as the standard is commonly quoted, its text was not at hand"
STEELS: dict[str, Steel] = {
    "R260": Steel(480e6, (880e6,), RAIL, "low, within 10 %: only a proof stress is public"),
    "R350HT": Steel(770e6, (1175e6,), RAIL, "low, within 10 %: only a proof stress is public"),
    "ER7": Steel(520e6, (820e6, 940e6), WHEEL, f"fair: a least value, {QUOTED}"),
    "ER8": Steel(540e6, (860e6, 980e6), WHEEL, f"fair: a least value, {QUOTED}"),
}


def constants(grade: str) -> dict[str, float | str]:
    """Return the table of a material that is this steel; of a name that is none, any steel's."""
    steel = next((steel for name, steel in STEELS.items() if name == grade), STEELS["R260"])
    return {
        "law": "j2",
        "youngs_modulus": YOUNGS_MODULUS,
        "poisson_ratio": POISSON_RATIO,
        "density": DENSITY,
        "yield_stress": steel.yield_stress,
    }
