# SPDX-License-Identifier: LGPL-3.0-or-later
"""A quantity of a run beside the answer that theory gives for it, and the sources cited."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from workflow.results.table import Column, Table

HERTZ = "Hertz 1882; Johnson, Contact Mechanics (1985), sec. 4.2"
LINE = "Hertz 1882; Johnson, Contact Mechanics (1985), eq. 4.43 to 4.46"
WAVES = "Waves in a bar; Johnson, Contact Mechanics (1985), sec. 11.1"
IMPACT = "Hertz 1882; Johnson, Contact Mechanics (1985), sec. 11.4"
CATTANEO = "Cattaneo 1938, Mindlin 1949; Johnson, Contact Mechanics (1985), sec. 7.2"
CARTER = "Carter 1926; Johnson, Contact Mechanics (1985), sec. 8.3"
KALKER = "Kalker 1967, table E3 of 1990; Vermeulen and Johnson 1964"
CONTACT = "Half-space code CONTACT (Kalker 1990), interpolated"
COULOMB = "Newton's law with Coulomb's friction"
WEAKENING = "Newton's law with friction that falls over a length of slip"
HILL = "Hill, The Mathematical Theory of Plasticity (1950), ch. 5.2"
FLATTENING = "Kogut and Etsion, J. Appl. Mech. 69 (2002)"
TAYLOR = "Two independent codes, converged"
STATICS = "Equilibrium of forces"
MOMENTUM = "Conservation of momentum"
ENERGY = "Conservation of energy"
HALF_SPACE = "Half-spaces of the drawn profiles; Polonsky and Keer, Wear 231 (1999)"


@dataclass(frozen=True)
class Expected:
    """A quantity of a run and what theory expects of it.

    Attributes:
        quantity: What it is.
        unit: Unit of both values; 1 for a number.
        value: Its value in the run.
        expected: The answer.
        source: Where the answer is from.
    """

    quantity: str
    unit: str
    value: float
    expected: float
    source: str

    @property
    def error(self) -> float:
        """Error of the value, relative to the answer; the value itself where that is 0."""
        return self.value / self.expected - 1 if self.expected else self.value

    @property
    def finite(self) -> bool:
        """Whether there is a number to compare."""
        return math.isfinite(self.value) and math.isfinite(self.expected)

    def entry(self) -> dict[str, Any]:
        """Return the entry of ``summary.json``."""
        return asdict(self) | {"error": self.error}


def answers(entries: Sequence[Mapping[str, Any]]) -> Table | None:
    """Return the table of what theory expects of a run, None if it expects nothing.

    Args:
        entries: ``expected`` of ``summary.json``.
    """
    columns = [
        Column("quantity", "quantity", words=True),
        Column("run", "value", ".5g"),
        Column("expected", "expected", ".5g"),
        Column("unit", lambda a: "" if a["unit"] == "1" else a["unit"], words=True),
        Column("error", lambda a: f"{a['error']:+.2%}" if a["expected"] else f"{a['error']:.2g}"),
    ]
    sources = "; ".join(dict.fromkeys(a["source"] for a in entries))
    return Table("Against theory", columns, entries, sources) if entries else None
