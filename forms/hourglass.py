# SPDX-License-Identifier: LGPL-3.0-or-later
"""One-point hexahedra with hourglass control of the twelve modes without strain at the centre.

Hourglass amplitudes (Flanagan and Belytschko, Int. J. Numer. Meth. Engng 17, 1981, 679–706): what
a field has beyond a linear one,

    q_ab = f,ab − ∇f̄ · x,ab    (three pairs),        q_012 = f,012 − ∇f̄ · x,012,

with derivatives by the reference coordinates at the centre and the mean gradient of the cell. They
vanish for every linear field on every cell, and turn with the body. A body with this element:

    form = one_point_residual(st_venant_kirchhoff)(u, w, material) * one_point(dx)
"""

from collections.abc import Callable
from typing import Any

from ufl import as_vector, dot, outer
from ufl.domain import extract_unique_domain

from forms.cells import (
    PAIRS,
    Taylor,
    area_vectors,
    mean_stress,
    per_point,
    positions,
    scaled_integral,
    scaled_volume,
    taylor,
)

Residual = Callable[..., Any]
Modes = dict[Any, Any]  # by pair of reference axes or THIRD, vectors or components
THIRD = (0, 1, 2)
OTHERS = {0: (1, 2), 1: (0, 2), 2: (0, 1)}


def one_point_residual(
    residual: Residual,
    *,
    rotating: bool = True,
    coefficient: float | None = None,
    moduli: Any = None,
) -> Residual:
    """Return a residual with mean gradients and hourglass control, for the one-point measure.

    Args:
        residual: Any ``residual(u, w, material, v=None)``.
        rotating: Whether the residual is made for large rotations.
        coefficient: See :func:`hourglass`.
        moduli: Elastic constants of the control; those of the material if not given.
    """

    def reduced(u: Any, w: Any, material: Any, v: Any = None) -> Any:
        cell = Cell(u, moduli or material, rotating, coefficient)
        P, rest = mean_stress(residual(u, w, material, v))
        return cell.work(cell.resistance(v), w, P) + rest

    return reduced


def hourglass(
    u: Any,
    w: Any,
    material: Any,
    v: Any = None,
    *,
    rotating: bool = True,
    coefficient: float | None = None,
) -> Any:
    """Return the virtual work of the hourglass control, for the one-point measure [J/m³].

    The derivative of :func:`hourglass_energy` in direction ``w``. No force from any rigid motion if
    ``rotating``, nor from any linear field.

    Args:
        u: Displacement [m].
        w: Virtual displacement [m].
        material: With ``E``, ``nu``, ``mu``, ``lmbda`` [Pa], and ``damping`` [s] if ``v`` is given.
        v: Velocity, where the material damps in proportion to its stiffness [m/s].
        rotating: Exact under large rotation; if not, linear in ``u``.
        coefficient: None for the physical stiffness, a number for that fraction of the largest
            stiffness (:func:`flanagan_belytschko`; 0.05 to 0.15 is usual) [-].
    """
    cell = Cell(u, material, rotating, coefficient)
    return cell.work(cell.resistance(v), w)


def hourglass_energy(
    u: Any, material: Any, *, rotating: bool = True, coefficient: float | None = None
) -> Any:
    """Return the energy of the hourglass control, for the one-point measure [J/m³]."""
    cell = Cell(u, material, rotating, coefficient)
    s = cell.modes()
    f = cell.forces(s)
    return sum(f[k] * s[k] for k in s) / 2 * cell.weight


class Cell:
    """Hourglass modes of a displacement on a cell, and the forces that resist them.

    Where the body rotates, amplitudes are pulled back, ``Fᵀ q``: no rotation changes them, and they
    are the slopes of the Green–Lagrange strain. Their components along a basis of the cell at rest
    are those of ``q`` along the basis that moves with it: ``Fᵀ q · b = q · F b``.

    Attributes:
        basis: Three vectors on the cell at rest: its axes [m], or unit vectors [-].
        moved: The same on the cell as it is now.
    """

    def __init__(self, u: Any, material: Any, rotating: bool, coefficient: float | None) -> None:
        domain = extract_unique_domain(u)
        self.x = positions(domain)
        self.V = scaled_volume(self.x)
        self.weight = per_point(domain)
        self.material, self.rotating, self.coefficient = material, rotating, coefficient
        unit = [as_vector([float(i == a) for i in range(3)]) for a in range(3)]
        self.basis = self.x.first if coefficient is None else unit
        H, self.q = self._amplitudes(u)
        self.moved = [b + dot(H, b) for b in self.basis] if rotating else self.basis

    def _amplitudes(self, f: Any) -> tuple[Any, Modes]:
        """Mean gradient of a field, shape ``(3, 3)``, and its hourglass amplitudes."""
        t = taylor(f)
        H = scaled_integral(t, self.x) / self.V
        q: Modes = {p: t.second[p] - dot(H, self.x.second[p]) for p in PAIRS}
        q[THIRD] = t.third - dot(H, self.x.third)
        return H, q

    def modes(self) -> Modes:
        """Components of the amplitudes along the moved basis, by mode and axis [m²] or [m]."""
        return {(k, a): dot(q, b) for k, q in self.q.items() for a, b in enumerate(self.moved)}

    def rate(self, v: Any) -> Modes:
        """Rate of the modes at velocity ``v`` [m²/s] or [m/s]."""
        H, rate = self._amplitudes(v)
        s = {(k, a): dot(q, b) for k, q in rate.items() for a, b in enumerate(self.moved)}
        if self.rotating:
            turned = [dot(H, b) for b in self.basis]
            for k, a in s:
                s[k, a] += dot(self.q[k], turned[a])
        return s

    def forces(self, s: Modes) -> Modes:
        """Forces against modes ``s``: their derivative of the energy."""
        if self.coefficient is None:
            return physical(s, self.x, self.V, self.material)
        kappa = flanagan_belytschko(self.x, self.V, self.material, self.coefficient)
        return {key: kappa / 8 * component for key, component in s.items()}

    def resistance(self, v: Any = None) -> Modes:
        """Forces against the modes, and against their rate where the material damps."""
        s = self.modes()
        if v is not None:
            rate = self.rate(v)
            s = {k: s[k] + self.material.damping * rate[k] for k in s}
        return self.forces(s)

    def work(self, f: Modes, w: Any, P: Any = 0) -> Any:
        """Virtual work of the forces and of a mean stress, by the derivatives of ``w`` [J/m³].

        ``P : δH V + Σ f δ(q · F b)`` with ``δq = δf − δH x`` and ``δF = δH``. Collected by ``δH``
        and then by the derivatives of ``w``, that is one coefficient for each of them: half of the
        operations of the products written out.
        """
        x, t = self.x, taylor(w)
        p = {k: sum(f[k, a] * self.moved[a] for a in range(3)) for k in self.q}
        behind: Modes = {**x.second, THIRD: x.third}
        M = sum(-outer(p[k], behind[k]) for k in p)
        if self.rotating:
            for a, b in enumerate(self.basis):
                M += outer(sum(f[k, a] * q for k, q in self.q.items()), b)
        N = P / 64 + M / self.V
        single, double = area_vectors(x)
        total = sum(dot(dot(N, single[a]), t.first[a]) for a in range(3))
        total += sum(dot(p[k] + dot(N, double[k]), t.second[k]) for k in PAIRS)
        return (total + dot(p[THIRD], t.third)) * self.weight


def flanagan_belytschko(x: Taylor, V: Any, material: Any, coefficient: float) -> Any:
    """Return ``κ = coefficient (λ + 2μ) B : B / (3 V)``, a fraction of the cell's stiffness [N/m].

    It acts on the normalised ``γ · u``, which is ``q / √2``, and ``q / √8`` for the third mode, or
    ``q / √8`` for all with the scaled derivatives of :class:`forms.cells.Taylor`.

    Args:
        x: Derivatives of the coordinates [m].
        V: 64 volumes of the cell [m³].
        material: With ``lmbda`` and ``mu`` [Pa].
        coefficient: That fraction [-].
    """
    single, double = area_vectors(x)
    BB = sum(dot(a, a) for a in [*single, *double.values()]) / 512
    return coefficient * (material.lmbda + 2 * material.mu) * BB * 64 / (3 * V)


def physical(s: Modes, x: Taylor, V: Any, material: Any) -> Modes:
    """Return the forces against modes by the moduli of the material [N/m].

    Assumed strains and no parameter (after Belytschko and Bindeman, Comput. Methods Appl. Mech.
    Engng 105, 1993, 225–260). With edges h, components of the modes along them, and means over the
    cell of the squares of what varies linearly (1/12) and bilinearly (1/144), the energy density is
    the half of

    - bending, strains ``ε_a = s_ab,a / h_a`` and ``ε_c = s_cb,c / h_c`` that vary along b, free of
      stress along b and of shear: ``E / (1 − ν²) (ε_a² + ε_c² + 2 ν ε_a ε_c) / 12``, so that one
      layer of cells bends like a plate, and the volume does not lock;
    - twist, shears ``γ_ac = s_bc,a / h_c + s_ab,c / h_a`` that vary along b: ``μ γ_ac² / 12``;
    - third mode, strains ``ε_a = s_012,a / h_a`` that vary along b and c: ``E ε_a² / 144``.

    Args:
        s: Components of the modes along the vectors of the edges, by mode and axis: those along
            the edges times h, scaled as in :class:`forms.cells.Taylor` [m²].
        x: Derivatives of the coordinates [m].
        V: 64 volumes of the cell [m³].
        material: With ``E``, ``nu`` and ``mu`` [Pa].
    """
    r = [1 / dot(e, e) for e in x.first]  # 1 / h²: no root is needed
    # Of the scales 2 × 4 of the modes and 4² of 1 / r, (16 / 8)² is left, and (16 / 4)² in THIRD.
    plate = V * (material.E / (1 - material.nu**2) / 12 * 4 / 64)
    f: Modes = {}
    for b, (a, c) in OTHERS.items():
        ab, bc = pair(a, b), pair(b, c)
        strain_a, strain_c = s[ab, a] * r[a], s[bc, c] * r[c]
        f[ab, a] = plate * (strain_a + material.nu * strain_c) * r[a]
        f[bc, c] = plate * (strain_c + material.nu * strain_a) * r[c]
        shear = V * (material.mu / 12 * 4 / 64) * (s[bc, a] + s[ab, c]) * (r[a] * r[c])
        for key in ((bc, a), (ab, c)):
            f[key] = f[key] + shear if key in f else shear
        f[THIRD, b] = V * (material.E / 144 * 256 / 16 / 64) * s[THIRD, b] * r[b] ** 2
    return f


def pair(a: int, b: int) -> tuple[int, int]:
    """Return two axes as the key of their mode."""
    return (a, b) if a < b else (b, a)
