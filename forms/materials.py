# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compressible neo-Hookean and orthotropic linear materials.

Residuals are as in :mod:`forms.elasticity`: ``residual(u, w, material, v=None)`` is the integrand
of the internal virtual work, the derivative of ``energy(u, material)`` in direction ``w``.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np
from ufl import Identity, as_matrix, det, dot, grad, inner, inv, ln, sym, tr

from forms.elasticity import Elastic, green_lagrange
from meshes.arrays import Array

AXES = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
VOIGT = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))  # order of the six strains here


def volume_change(u: Any) -> Any:
    """Return ``det F − 1``, without the round-off of a difference."""
    H = grad(u)
    return tr(H) + (tr(H) ** 2 - tr(dot(H, H))) / 2 + det(H)


def neo_hookean(u: Any, w: Any, material: Elastic, v: Any = None) -> Any:
    """Internal virtual work ``P : ∇w`` of a compressible neo-Hookean solid.

    ``P = F⁻ᵀ (2 μ E + λ J (J − 1) I)``: no difference of large numbers at small strain, and no
    logarithm. The damping stress is that of :func:`forms.elasticity.st_venant_kirchhoff`.
    """
    F = Identity(3) + grad(u)
    y = volume_change(u)
    kirchhoff = 2 * material.mu * green_lagrange(u) + material.lmbda * (1 + y) * y * Identity(3)
    P = dot(inv(F).T, kirchhoff)
    if v is not None:
        P += material.damping * dot(F, material.stress(sym(dot(F.T, grad(v)))))
    return inner(P, grad(w))


def neo_hookean_energy(u: Any, material: Elastic) -> Any:
    """Strain energy density ``μ/2 (tr FᵀF − 3 − 2 ln J) + λ/2 (J − 1)²`` [J/m³].

    Hooke's at small strain; infinite at J → 0 (Bonet and Wood, Nonlinear Continuum Mechanics for
    Finite Element Analysis, section 6.4.3, with ``J − 1`` for ``ln J``). Its round-off is
    ``1e-16 μ``.
    """
    y = volume_change(u)
    return material.mu * (tr(green_lagrange(u)) - ln(1 + y)) + material.lmbda / 2 * y**2


def hooke_energy(strain: Any, material: Any) -> Any:
    """Energy density ``σ(ε) : ε / 2`` of any material with a linear ``stress`` [J/m³]."""
    return inner(material.stress(strain), strain) / 2


@dataclass(frozen=True)
class Orthotropic:
    """Linear elastic material with three planes of symmetry, as wood, rolled sheet or a composite.

    Takes the place of :class:`forms.elasticity.Elastic` in ``small_strain`` (or, for large
    rotations, in ``st_venant_kirchhoff``). Pairs of directions are in the order 12, 13, 23.

    Attributes:
        youngs: Young's moduli of the directions 1, 2, 3 [Pa].
        poisson: ν₁₂, ν₁₃, ν₂₃: contraction along the second under tension along the first [-].
        shear: Shear moduli G₁₂, G₁₃, G₂₃ [Pa].
        rho: Density [kg/m³].
        damping: Stiffness-proportional damping β [s].
        axes: Directions 1, 2, 3 as rows, orthonormal, shape ``(3, 3)``.

    Raises:
        ValueError: if the axes are not orthonormal or the energy is not positive.
    """

    youngs: tuple[float, float, float]
    poisson: tuple[float, float, float]
    shear: tuple[float, float, float]
    rho: float
    damping: float = 0.0
    axes: tuple[tuple[float, float, float], ...] = AXES

    def __post_init__(self) -> None:
        A = np.array(self.axes)
        if A.shape != (3, 3) or not np.allclose(A @ A.T, np.eye(3), atol=1e-10):
            raise ValueError(f"axes: expected three orthonormal rows, got {self.axes}")
        if not (min(*self.youngs, *self.shear) > 0 and np.linalg.eigvalsh(self.compliance)[0] > 0):
            raise ValueError(
                "youngs, poisson, shear: expected a positive energy of every strain, got "
                f"{self.youngs}, {self.poisson}, {self.shear}"
            )

    @cached_property
    def compliance(self) -> Array:
        """Strains (11, 22, 33, and twice 12, 13, 23) by stresses, material axes, (6, 6) [1/Pa]."""
        S = np.diag(1 / np.array([*self.youngs, *self.shear]))
        for (i, j), nu in zip(((0, 1), (0, 2), (1, 2)), self.poisson, strict=True):
            S[i, j] = S[j, i] = -nu / self.youngs[i]
        return S

    @cached_property
    def tensor(self) -> Array:
        """Elasticity tensor ``C_ijkl`` in global axes, shape ``(3, 3, 3, 3)`` [Pa]."""
        C6 = np.linalg.inv(self.compliance)
        C = np.zeros((3, 3, 3, 3))
        for (row, (i, j)), (column, (m, n)) in product(enumerate(VOIGT), repeat=2):
            C[i, j, m, n] = C[j, i, m, n] = C[i, j, n, m] = C[j, i, n, m] = C6[row, column]
        A = np.array(self.axes)
        C = np.einsum("ai,bj,ck,dl,abcd->ijkl", A, A, A, A, C)
        return np.where(np.abs(C) > 1e-14 * np.abs(C).max(), C, 0.0)

    @cached_property
    def isotropic(self) -> Elastic:
        """The isotropic material nearest in stiffness (Voigt average), for hourglass control."""
        K = np.einsum("iijj", self.tensor) / 9
        mu = (np.einsum("ijij", self.tensor) - 3 * K) / 10
        E = 9 * K * mu / (3 * K + mu)
        return Elastic(float(E), float(E / (2 * mu) - 1), self.rho, self.damping)

    def stress(self, strain: Any) -> Any:
        """Hooke's law ``C : ε`` of a symmetric strain."""
        C = self.tensor
        sums = {
            (i, j): sum(
                float(C[i, j, m, n]) * (1 if m == n else 2) * strain[m, n]
                for m, n in VOIGT
                if C[i, j, m, n] != 0
            )
            for i, j in VOIGT
        }
        return as_matrix([[sums[min(i, j), max(i, j)] for j in range(3)] for i in range(3)])
