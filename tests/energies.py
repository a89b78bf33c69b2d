# SPDX-License-Identifier: LGPL-3.0-or-later
"""Laws for the tests: those of the library, and neo-Hookean from its strain energy alone."""

from ufl import det, inner, ln

from forms.elements import LAWS as BUILT_IN
from forms.elements import Law


def neo_hookean(F, material):
    """Strain energy density ``μ/2 (tr FᵀF − 3 − 2 ln J) + λ/2 (J − 1)²`` [J/m³]."""
    J = det(F)
    return material.mu / 2 * (inner(F, F) - 3 - 2 * ln(J)) + material.lmbda / 2 * (J - 1) ** 2


LAWS = BUILT_IN | {"energy": Law.from_energy(neo_hookean)}
