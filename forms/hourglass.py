# SPDX-License-Identifier: LGPL-3.0-or-later
"""Hexahedra with one quadrature point, and the stiffness of the twelve modes it does not see.

Hourglass amplitudes (Flanagan and Belytschko, Int. J. Numer. Meth. Engng 17, 1981, 679–706): what
a field has beyond a linear one,

    q_ab = f,ab − ∇f̄ · x,ab    (three pairs),        q_012 = f,012 − ∇f̄ · x,012,

with derivatives by the reference coordinates at the centre and the mean gradient of the cell. They
vanish for every linear field on every cell, and turn with the body. A body with this element:

    form = one_point_residual(st_venant_kirchhoff)(u, w, material) * one_point(dx)
"""

from collections.abc import Callable
from typing import Any

from ufl import Identity, dot, outer, sqrt
from ufl.domain import extract_unique_domain

from forms.cells import (
    PAIRS,
    Taylor,
    area_vectors,
    gradient_integral,
    per_point,
    positions,
    taylor,
    uniform,
    volume,
)

Residual = Callable[..., Any]
Modes = dict[Any, Any]  # a vector by pair of reference axes, and one for THIRD
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
        control = hourglass(u, w, moduli or material, v, rotating=rotating, coefficient=coefficient)
        return uniform(residual(u, w, material, v)) + control

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
    s = cell.modes()
    if v is not None:
        rate = cell.rate(v)
        s = {k: s[k] + material.damping * rate[k] for k in s}
    return cell.work(cell.forces(s), w)


def hourglass_energy(
    u: Any, material: Any, *, rotating: bool = True, coefficient: float | None = None
) -> Any:
    """Return the energy of the hourglass control, for the one-point measure [J/m³]."""
    cell = Cell(u, material, rotating, coefficient)
    s = cell.modes()
    R = cell.forces(s)
    return sum(dot(R[k], s[k]) for k in s) / 2 * cell.weight


class Cell:
    """Hourglass modes of a displacement on a cell, and the forces that resist them.

    Where the body rotates, amplitudes are pulled back, ``Fᵀ q``: no rotation changes them, and they
    are the slopes of the Green–Lagrange strain.
    """

    def __init__(self, u: Any, material: Any, rotating: bool, coefficient: float | None) -> None:
        domain = extract_unique_domain(u)
        self.x = positions(domain)
        self.V = volume(self.x)
        self.weight = per_point(domain)
        self.material, self.rotating, self.coefficient = material, rotating, coefficient
        H, self.q = self._amplitudes(u)
        self.F = Identity(3) + H

    def _amplitudes(self, f: Any) -> tuple[Any, Modes]:
        """Mean gradient of a field, shape ``(3, 3)``, and its hourglass amplitudes."""
        t = taylor(f)
        H = gradient_integral(t, self.x) / self.V
        q: Modes = {p: t.second[p] - dot(H, self.x.second[p]) for p in PAIRS}
        q[THIRD] = t.third - dot(H, self.x.third)
        return H, q

    def modes(self) -> Modes:
        """Amplitudes of the displacement, pulled back if the body rotates [m]."""
        return {k: dot(self.F.T, a) if self.rotating else a for k, a in self.q.items()}

    def rate(self, v: Any) -> Modes:
        """Rate of the modes at velocity ``v`` [m/s]."""
        H, q = self._amplitudes(v)
        if not self.rotating:
            return q
        return {k: dot(H.T, self.q[k]) + dot(self.F.T, q[k]) for k in q}

    def forces(self, s: Modes) -> Modes:
        """Forces against modes ``s``, their derivative of the energy, vectors ``(3,)`` [N]."""
        if self.coefficient is None:
            return physical(s, self.x, self.V, self.material)
        kappa = flanagan_belytschko(self.x, self.V, self.material, self.coefficient)
        return {k: (kappa / 8 if k == THIRD else kappa / 2) * s[k] for k in s}

    def work(self, R: Modes, w: Any) -> Any:
        """Virtual work of the forces, collected by the derivatives of ``w`` [J/m³].

        ``Σ R · δs`` with ``δs = δHᵀ q + Fᵀ δq`` and ``δq = δf − δH · x``: one coefficient for each
        derivative keeps the kernel short (three times as fast as the products written out).
        """
        x, t = self.x, taylor(w)
        p = {k: dot(self.F, R[k]) if self.rotating else R[k] for k in R}
        behind: Modes = {**x.second, THIRD: x.third}
        M = sum(-outer(p[k], behind[k]) for k in p)
        if self.rotating:
            M += sum(outer(self.q[k], R[k]) for k in R)
        M = M / self.V
        single, double = area_vectors(x)
        total = sum(dot(dot(M, single[a]), t.first[a]) for a in range(3))
        total += sum(dot(p[k] + dot(M, double[k]), t.second[k]) for k in PAIRS)
        return (total + dot(p[THIRD], t.third)) * self.weight


def flanagan_belytschko(x: Taylor, V: Any, material: Any, coefficient: float) -> Any:
    """Return ``κ = coefficient (λ + 2μ) B : B / (3 V)``, a fraction of the cell's stiffness [N/m].

    It acts on the normalised ``γ · u``, which is ``q / √2``, and ``q / √8`` for the third mode.
    """
    single, double = area_vectors(x)
    BB = sum(dot(a, a) for a in single) / 2 + 2 * sum(dot(a, a) for a in double.values())
    return coefficient * (material.lmbda + 2 * material.mu) * BB / (3 * V)


def physical(s: Modes, x: Taylor, V: Any, material: Any) -> Modes:
    """Return the forces against modes by the moduli of the material, vectors ``(3,)`` [N].

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
        s: Modes, vectors ``(3,)`` [m].
        x: Derivatives of the coordinates [m].
        V: Volume of the cell [m³].
        material: With ``E``, ``nu`` and ``mu`` [Pa].
    """
    per_length = [1 / sqrt(dot(e, e)) for e in x.first]
    edge = [e * k for e, k in zip(x.first, per_length, strict=True)]
    along = {(k, a): dot(edge[a], m) for k, m in s.items() for a in range(3)}
    force: dict[Any, Any] = {}

    def add(key: tuple[int, ...], a: int, stress: Any, over: int) -> None:
        force[key, a] = force.get((key, a), 0) + stress * per_length[over]

    plate = V * material.E / (1 - material.nu**2) / 12
    for b, (a, c) in OTHERS.items():
        ab, bc = pair(a, b), pair(b, c)
        strain_a, strain_c = along[ab, a] * per_length[a], along[bc, c] * per_length[c]
        add(ab, a, plate * (strain_a + material.nu * strain_c), a)
        add(bc, c, plate * (strain_c + material.nu * strain_a), c)
        shear = along[bc, a] * per_length[c] + along[ab, c] * per_length[a]
        add(bc, a, V * material.mu / 12 * shear, c)
        add(ab, c, V * material.mu / 12 * shear, a)
        add(THIRD, b, V * material.E / 144 * along[THIRD, b] * per_length[b], b)
    return {k: sum(force[k, a] * edge[a] for a in range(3)) for k in s}


def pair(a: int, b: int) -> tuple[int, int]:
    """Return two axes as the key of their mode."""
    return (a, b) if a < b else (b, a)
