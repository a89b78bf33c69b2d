# SPDX-License-Identifier: LGPL-3.0-or-later
"""Elements and material laws by name, and the forms of a body made of them."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ufl import Identity, diff, dot, grad, inner, sym, variable

from forms.cells import one_point, uniform
from forms.dilatation import (
    dilatation,
    dilatation_energy,
    shape_neo_hookean,
    shape_neo_hookean_energy,
    shape_small_strain,
    shape_small_strain_energy,
)
from forms.elasticity import green_lagrange, small_strain, st_venant_kirchhoff
from forms.hourglass import hourglass_energy, one_point_residual
from forms.logarithmic import hencky, hencky_energy, shape_hencky, shape_hencky_energy
from forms.materials import hooke_energy, neo_hookean, neo_hookean_energy

ELEMENTS = ("full", "one-point", "selective")


@dataclass(frozen=True)
class Law:
    """A material law: residual and strain energy, and the parts of both that change shape only.

    Attributes:
        residual: ``residual(u, w, material, v=None)``, integrand of the internal virtual work.
        energy: ``energy(u, material)``, its potential [J/m³].
        rotating: Whether it is made for large rotations.
        shape: Residual without the work of the volume change, for the element ``selective``.
        shape_energy: Energy of that.
    """

    residual: Callable[..., Any]
    energy: Callable[..., Any]
    rotating: bool = True
    shape: Callable[..., Any] | None = None
    shape_energy: Callable[..., Any] | None = None

    @staticmethod
    def from_energy(psi: Callable[[Any, Any], Any]) -> "Law":
        """Return the law of a strain energy density, with the stress ``P = ∂ψ/∂F``.

        Stiffness-proportional damping is that of :func:`forms.elasticity.st_venant_kirchhoff`.
        ``F = I + ∇u`` has a round-off of 1e-16: the stress of a strain of 1e-10 is good to 1e-6.

        Args:
            psi: ``psi(F, material)``, objective, of the deformation gradient ``F`` in UFL [J/m³].
        """

        def energy(u: Any, material: Any) -> Any:
            return psi(Identity(3) + grad(u), material)

        def residual(u: Any, w: Any, material: Any, v: Any = None) -> Any:
            F = variable(Identity(3) + grad(u))
            P = diff(psi(F, material), F)
            if v is not None:
                P += material.damping * dot(F, material.stress(sym(dot(F.T, grad(v)))))
            return inner(P, grad(w))

        # a checkpoint tells laws by the name of their residual
        residual.__module__, residual.__qualname__ = psi.__module__, psi.__qualname__
        return Law(residual, energy)


def hooke(u: Any, material: Any) -> Any:
    """Energy density of small strain in any linear material [J/m³]."""
    return hooke_energy(sym(grad(u)), material)


def hooke_rotating(u: Any, material: Any) -> Any:
    """Energy density of the Green–Lagrange strain in any linear material [J/m³]."""
    return hooke_energy(green_lagrange(u), material)


LAWS = {
    "small-strain": Law(small_strain, hooke, False, shape_small_strain, shape_small_strain_energy),
    "total-lagrangian": Law(st_venant_kirchhoff, hooke_rotating),
    "neo-hookean": Law(
        neo_hookean, neo_hookean_energy, True, shape_neo_hookean, shape_neo_hookean_energy
    ),
}
# of cells that do not yield in a body that may, at large strain
HENCKY = Law(hencky, hencky_energy, True, shape_hencky, shape_hencky_energy)


def internal_work(
    element: str,
    law: Law,
    u: Any,
    w: Any,
    material: Any,
    dx: Any,
    v: Any = None,
    *,
    coefficient: float | None = None,
) -> Any:
    """Return the form of the internal virtual work of a body.

    Args:
        element: ``full``, ``one-point`` (with hourglass control) or ``selective`` (no locking as
            ν → 1/2).
        law: Material law, one of :data:`LAWS` or another.
        u: Displacement [m].
        w: Test function.
        material: Elastic constants.
        dx: Volume measure of the body with full quadrature.
        v: Velocity, where the material damps in proportion to its stiffness [m/s].
        coefficient: Hourglass coefficient; None for the physical stiffness [-].

    Raises:
        ValueError: if the element is unknown, or does not go with the law.
    """
    _check(element, law, material)
    if element == "full":
        return law.residual(u, w, material, v) * dx
    if element == "one-point":
        moduli = getattr(material, "isotropic", None)
        residual = one_point_residual(
            law.residual, rotating=law.rotating, coefficient=coefficient, moduli=moduli
        )
        return residual(u, w, material, v) * one_point(dx)
    assert law.shape is not None
    pressure = dilatation(u, w, material, v, rotating=law.rotating)
    return law.shape(u, w, material, v) * dx + pressure * one_point(dx, mixed=True)


def strain_energy(element: str, law: Law, u: Any, material: Any, dx: Any) -> Any:
    """Return the form of the strain energy of a body without that of hourglass control [J]."""
    _check(element, law, material)
    if element == "full":
        return law.energy(u, material) * dx
    if element == "one-point":
        return uniform(law.energy(u, material)) * one_point(dx)
    assert law.shape_energy is not None
    pressure = dilatation_energy(u, material, rotating=law.rotating)
    return law.shape_energy(u, material) * dx + pressure * one_point(dx, mixed=True)


def control_energy(
    law: Law, u: Any, material: Any, dx: Any, *, coefficient: float | None = None
) -> Any:
    """Return the form of the hourglass energy of a body of one-point elements [J]."""
    moduli = getattr(material, "isotropic", material)
    energy = hourglass_energy(u, moduli, rotating=law.rotating, coefficient=coefficient)
    return energy * one_point(dx)


def _check(element: str, law: Law, material: Any) -> None:
    if element not in ELEMENTS:
        raise ValueError(f"element: expected one of {', '.join(ELEMENTS)}, got {element!r}")
    if element == "selective" and (law.shape is None or hasattr(material, "isotropic")):
        raise ValueError(
            "element: 'selective' expects an isotropic material with the law small-strain or "
            "neo-hookean"
        )
