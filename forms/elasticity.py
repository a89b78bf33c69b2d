# SPDX-License-Identifier: LGPL-3.0-or-later
"""Isotropic linear elasticity at small strain and in total Lagrangian form, in UFL.

A residual is any function ``residual(u, w, material, v=None)`` that returns the integrand of the
internal virtual work of displacement ``u`` in direction ``w``. ``v``, the velocity, is passed only
where the material damps in proportion to its stiffness.
"""

from dataclasses import dataclass
from typing import Any

import ufl
from ufl import Identity, dot, grad, inner, sym, tr


@dataclass(frozen=True)
class Elastic:
    """Isotropic linear elastic material.

    Attributes:
        E: Young's modulus [Pa].
        nu: Poisson's ratio [-].
        rho: Density [kg/m³].
        damping: Stiffness-proportional damping β [s]: stress ``C : (ε + β ε̇)``.
    """

    E: float
    nu: float
    rho: float
    damping: float = 0.0

    @property
    def lmbda(self) -> float:
        """First Lamé parameter [Pa]."""
        return self.E * self.nu / ((1 + self.nu) * (1 - 2 * self.nu))

    @property
    def mu(self) -> float:
        """Shear modulus [Pa]."""
        return self.E / (2 * (1 + self.nu))

    @property
    def dilatational_speed(self) -> float:
        """Speed of pressure waves [m/s]."""
        return float(((self.lmbda + 2 * self.mu) / self.rho) ** 0.5)

    def stress(self, strain: Any) -> Any:
        """Hooke's law ``λ tr(ε) I + 2 μ ε``."""
        return self.lmbda * tr(strain) * Identity(3) + 2 * self.mu * strain


def small_strain(u: Any, w: Any, material: Elastic, v: Any = None) -> Any:
    """Internal virtual work of linear elasticity, ``σ(u) : ε(w)``."""
    strain = sym(grad(u)) if v is None else sym(grad(u)) + material.damping * sym(grad(v))
    return inner(material.stress(strain), sym(grad(w)))


def green_lagrange(u: Any) -> Any:
    """Green–Lagrange strain ``(∇u + ∇uᵀ + ∇uᵀ∇u) / 2``: zero for any rotation.

    Written with the displacement gradient, so that strains of 1e-10 do not drown in ``FᵀF − I``.
    """
    H = grad(u)
    return sym(H) + dot(H.T, H) / 2


def st_venant_kirchhoff(u: Any, w: Any, material: Elastic, v: Any = None) -> Any:
    """Internal virtual work in total Lagrangian form, ``S(E) : δE`` with ``S = C : E``.

    Exact under large rotation; the damping stress ``β C : Ė`` is objective too (Bonet and Wood,
    Nonlinear Continuum Mechanics for Finite Element Analysis, section 6.4).
    """
    F = Identity(3) + grad(u)
    strain = green_lagrange(u)
    if v is not None:
        strain = strain + material.damping * sym(dot(F.T, grad(v)))
    return inner(dot(F, material.stress(strain)), grad(w))


def full(msh: Any, tags: Any = None, region: tuple[int, ...] | None = None) -> Any:
    """Return the volume measure with full 2×2×2 quadrature on hexahedra."""
    dx = ufl.Measure("dx", domain=msh, subdomain_data=tags, metadata={"quadrature_degree": 2})
    return dx if region is None else dx(region)


def exact(msh: Any, tags: Any = None) -> Any:
    """Return the volume measure that is exact for ``∫ N_i`` on any trilinear hexahedron."""
    return full(msh, tags)(metadata={"quadrature_degree": 3})
