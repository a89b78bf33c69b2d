# SPDX-License-Identifier: LGPL-3.0-or-later
"""Mean dilatation elements: hexahedra without volumetric locking as ν → 1/2.

The volume changes by its mean over the cell only: the work of the shape is taken at 2×2×2 points,
that of the volume at one point with the exact mean of the cell. For small strain this is the B-bar
element (Hughes, Int. J. Numer. Meth. Engng 15, 1980, 1413–1418), for neo-Hookean solids the mean
dilatation ``J̄ = v / V`` (Simo, Taylor and Pister, Comput. Methods Appl. Mech. Engng 51, 1985,
177–208), the counterpart of F-bar that has an energy.

    form = shape(u, w, material) * dx + dilatation(u, w, material) * one_point(dx, mixed=True)
"""

from typing import Any

from ufl import Identity, dev, dot, grad, inner, inv, sym, tr
from ufl.domain import extract_unique_domain

from forms.cells import gradient_integral, per_point, positions, taylor, volume
from forms.elasticity import Elastic, green_lagrange
from forms.materials import volume_change


def bulk(material: Elastic) -> Any:
    """Bulk modulus [Pa]."""
    return material.lmbda + 2 * material.mu / 3


def shape_small_strain(u: Any, w: Any, material: Elastic, v: Any = None) -> Any:
    """Work of the deviatoric stress, ``2 μ dev ε(u) : dev ε(w)``, for the full measure."""
    strain = grad(u) if v is None else grad(u) + material.damping * grad(v)
    return 2 * material.mu * inner(dev(sym(strain)), dev(sym(grad(w))))


def shape_small_strain_energy(u: Any, material: Elastic) -> Any:
    """Energy density ``μ dev ε : dev ε`` [J/m³]."""
    return shape_small_strain(u, u, material) / 2


def shape_neo_hookean(u: Any, w: Any, material: Elastic, v: Any = None) -> Any:
    """Work of the volume-preserving part, ``J^(−2/3) F⁻ᵀ 2 μ dev E : ∇w``, full measure."""
    F = Identity(3) + grad(u)
    J = 1 + volume_change(u)
    P = J ** (-2 / 3) * dot(inv(F).T, 2 * material.mu * dev(green_lagrange(u)))
    if v is not None:
        rate = sym(dot(F.T, grad(v)))
        P += material.damping * dot(F, 2 * material.mu * dev(rate))
    return inner(P, grad(w))


def shape_neo_hookean_energy(u: Any, material: Elastic) -> Any:
    """Energy density ``μ/2 (J^(−2/3) tr FᵀF − 3)`` [J/m³]."""
    C = 3 + 2 * tr(green_lagrange(u))
    return material.mu / 2 * ((1 + volume_change(u)) ** (-2 / 3) * C - 3)


class MeanVolume:
    """Volume of a cell before and after a displacement, and how it varies.

    Attributes:
        change: ``v / V − 1`` if the body moves far; its linear part if not [-].
        weight: Takes the Jacobian of the rule away [1/m³].
    """

    def __init__(self, u: Any, rotating: bool) -> None:
        domain = extract_unique_domain(u)
        x, t = positions(domain), taylor(u)
        self.V = volume(x)
        self.now = x + t if rotating else x
        if rotating:
            self.change = (volume(self.now) - self.V) / self.V
        else:
            self.change = tr(gradient_integral(t, x)) / self.V
        self.weight = per_point(domain)

    def variation(self, w: Any) -> Any:
        """Derivative of the volume in direction ``w``, exactly [m³ per unit of w]."""
        return tr(gradient_integral(taylor(w), self.now))


def dilatation(u: Any, w: Any, material: Elastic, v: Any = None, *, rotating: bool = False) -> Any:
    """Work of the mean pressure, ``κ (J̄ − 1) δv``, for the mixed one-point measure.

    Args:
        u: Displacement [m].
        w: Virtual displacement [m].
        material: Elastic constants [Pa], ``damping`` [s].
        v: Velocity, where the material damps in proportion to its stiffness [m/s].
        rotating: ``J̄ = v / V`` of the displaced cell; if not, ``1 + tr ε̄``.
    """
    cell = MeanVolume(u, rotating)
    strain = cell.change
    if v is not None:
        strain += material.damping * cell.variation(v) / cell.V
    return bulk(material) * strain * cell.variation(w) * cell.weight


def mean_stress(u: Any, material: Elastic, *, rotating: bool = False) -> Any:
    """Mean stress of the volume, ``κ (J̄ − 1)``, for the one-point measure as a sum over cells."""
    cell = MeanVolume(u, rotating)
    return bulk(material) * cell.change * cell.weight


def dilatation_energy(u: Any, material: Elastic, *, rotating: bool = False) -> Any:
    """Energy ``κ/2 (J̄ − 1)²`` of the mean volume, for the mixed one-point measure [J/m³]."""
    cell = MeanVolume(u, rotating)
    return bulk(material) / 2 * cell.change**2 * cell.V * cell.weight
