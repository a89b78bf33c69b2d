# SPDX-License-Identifier: LGPL-3.0-or-later
"""The forms whose kernels ``squealx bench`` times: elements and material laws of the scenes."""

from functools import partial
from typing import Any

from forms.elasticity import Elastic
from forms.elements import LAWS, internal_work

STEEL = Elastic(E=210e9, nu=0.3, rho=7800.0)
HOURGLASS = "one point, physical hourglass stiffness"
CASES = {  # element and law by title
    "St. Venant-Kirchhoff, full": ("full", "total-lagrangian"),
    f"St. Venant-Kirchhoff, {HOURGLASS}": ("one-point", "total-lagrangian"),
    "small strain, full": ("full", "small-strain"),
    f"small strain, {HOURGLASS}": ("one-point", "small-strain"),
    "small strain, selective (B-bar)": ("selective", "small-strain"),
    "neo-Hookean, full": ("full", "neo-hookean"),
}
REFERENCE = "St. Venant-Kirchhoff, full"  # what one-point forms replace


def work(element: str, law: str, u: Any, w: Any, dx: Any) -> Any:
    """Return the form of the internal virtual work; ``dx`` has full quadrature."""
    return internal_work(element, LAWS[law], u, w, STEEL, dx)


FORMS = {title: partial(work, *case) for title, case in CASES.items()}
