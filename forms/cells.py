# SPDX-License-Identifier: LGPL-3.0-or-later
"""Exact cell means of gradients, from derivatives by the coordinates of the reference cell.

On a trilinear hexahedron every field of the vector P1 space is

    f(η) = f₀ + f,a ηₐ + f,ab ηₐ η_b (a < b) + f,012 η₀ η₁ η₂,    −½ ≤ ηₐ ≤ ½,

with the derivatives at the centre. They are all that a one-point rule needs: means over the whole
cell follow from them in closed form, so they come without further quadrature points.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import ufl
from ufl import as_matrix, as_vector, cross, outer
from ufl.algorithms.apply_algebra_lowering import apply_algebra_lowering
from ufl.algorithms.apply_derivatives import GateauxDerivativeRuleset, apply_derivatives
from ufl.algorithms.map_integrands import map_integrand_dags
from ufl.classes import (
    Argument,
    FormArgument,
    Jacobian,
    JacobianDeterminant,
    ReferenceGrad,
    ReferenceValue,
    Zero,
)
from ufl.core.ufl_type import ufl_type
from ufl.corealg.multifunction import MultiFunction
from ufl.domain import extract_unique_domain

CYCLIC = ((0, 1, 2), (1, 2, 0), (2, 0, 1))
PAIRS = ((0, 1), (0, 2), (1, 2))


@ufl_type(num_ops=1, is_terminal_modifier=True, is_in_reference_frame=True)
class CellGrad(ReferenceValue):
    """Gradient of a P1 field by the coordinates of the reference cell, ``∂f/∂ξ``; nests.

    UFL has this operator (``ReferenceGrad``) but takes it only after its own pull-back and does not
    differentiate it by a field. This one waits for the pull-back and is differentiated; there is no
    Jacobian in it, unlike in ``grad(grad(f))``, which costs five times as much.
    """

    __slots__ = ()

    def __init__(self, f: Any) -> None:
        if not isinstance(f, FormArgument | CellGrad):
            raise ValueError(f"cell gradient: expected a function or an argument, got {f!r}")
        ufl.core.operator.Operator.__init__(self, (f,))

    @property
    def ufl_shape(self) -> tuple[int, ...]:  # type: ignore[override]
        """Shape of the field and one axis of three."""
        return (*self.ufl_operands[0].ufl_shape, 3)

    def _ufl_expr_reconstruct_(self, op: Any) -> Any:
        """Return the operator on ``op``: UFL's own once the pull-back has been applied."""
        if isinstance(op, Zero):
            return Zero((*op.ufl_shape, 3))
        waiting = isinstance(op, FormArgument) or type(op) is CellGrad
        return CellGrad(op) if waiting else ReferenceGrad(op)

    def __str__(self) -> str:
        return f"cell_grad({self.ufl_operands[0]})"


@GateauxDerivativeRuleset.process.register(CellGrad)  # type: ignore[attr-defined]
def _(self: Any, o: CellGrad) -> Any:
    """Derivative in a direction: the operator is linear."""
    return o._ufl_expr_reconstruct_(self(o.ufl_operands[0]))


@dataclass(frozen=True)
class Taylor:
    """Derivatives of a field by the reference coordinates, at the centre of the cell.

    They are scaled to be sums of the nodal values with signs, ``Σ ±f_I``: fewer multiplications.

    Attributes:
        first: ``4 f,a``, three vectors ``(3,)``.
        second: ``2 f,ab`` by pair in the order of :data:`PAIRS`, vectors ``(3,)``.
        third: ``f,012``, shape ``(3,)``.
    """

    first: list[Any]
    second: dict[tuple[int, int], Any]
    third: Any

    def __add__(self, other: "Taylor") -> "Taylor":
        """Derivatives of the sum of two fields."""
        return Taylor(
            [a + b for a, b in zip(self.first, other.first, strict=True)],
            {p: self.second[p] + other.second[p] for p in PAIRS},
            self.third + other.third,
        )


def taylor(f: Any) -> Taylor:
    """Return the derivatives of a function or an argument of a vector P1 space."""
    D1 = CellGrad(f)
    D2 = CellGrad(D1)
    return _taylor(D1, D2, CellGrad(D2))


def positions(domain: Any) -> Taylor:
    """Return the derivatives of the coordinates of a mesh [m].

    Raises:
        ValueError: if the mesh is not of hexahedra with eight nodes.
    """
    element = domain.ufl_coordinate_element()
    cell = domain.ufl_cell().cellname
    if cell != "hexahedron" or element.embedded_subdegree != 1:
        raise ValueError(f"mesh: expected trilinear hexahedra, got {cell} of {element}")
    D1 = Jacobian(domain)
    D2 = ReferenceGrad(D1)
    return _taylor(D1, D2, ReferenceGrad(D2))


def _taylor(D1: Any, D2: Any, D3: Any) -> Taylor:
    """Derivatives as vectors from the tensors of first, second and third order."""

    def vector(scale: float, D: Any, *axes: int) -> Any:
        return as_vector([scale * D[(i, *axes)] for i in range(3)])

    return Taylor(
        [vector(4.0, D1, a) for a in range(3)],
        {(a, b): vector(2.0, D2, a, b) for a, b in PAIRS},
        vector(1.0, D3, 0, 1, 2),
    )


def area_vectors(x: Taylor) -> tuple[list[Any], dict[tuple[int, int], Any]]:
    """Return the vectors that the derivatives of a field meet in its volume integral [m²].

    ``64 ∫ ∇f dV = fₐ ⊗ Aₐ + f_ab ⊗ A_ab`` with the scaled derivatives of :class:`Taylor` and, for
    (a, b, c) cyclic, ``Aₐ = x_b × x_c + x_ab × x_ac / 3`` and
    ``A_ab = (x_b × x_bc + x_ac × x_a) / 3``: the exact integral of the trilinear cell, that is the
    B matrix of Flanagan and Belytschko (1981). The value of the centre would not pass the patch
    test on cells with warped faces.
    """
    X = x.first
    third = {p: x.second[p] / 3 for p in PAIRS}

    def p(a: int, b: int) -> tuple[int, int]:
        return (a, b) if a < b else (b, a)

    single = [cross(X[b], X[c]) + cross(third[p(a, b)], x.second[p(a, c)]) for a, b, c in CYCLIC]
    double = {
        p(a, b): cross(X[b], third[p(b, c)]) + cross(third[p(a, c)], X[a]) for a, b, c in CYCLIC
    }
    return single, double


def scaled_integral(f: Taylor, x: Taylor) -> Any:
    """Return ``64 ∫ ∇f dV`` over the cell, exactly, shape ``(3, 3)`` [m³ times that of ∇f]."""
    single, double = area_vectors(x)
    first = sum(outer(f.first[a], single[a]) for a in range(3))
    return first + sum(outer(f.second[p], double[p]) for p in PAIRS)


def scaled_volume(x: Taylor) -> Any:
    """Return 64 times the exact volume of the cell with the given positions [m³].

    ``∫ ∇x dV = V I``: any entry of the diagonal is the volume.
    """
    single, double = area_vectors(x)
    first = sum(x.first[a][0] * single[a][0] for a in range(3))
    return first + sum(x.second[p][0] * double[p][0] for p in PAIRS)


def gradient_integral(f: Taylor, x: Taylor) -> Any:
    """Return ``∫ ∇f dV`` over the cell, exactly, shape ``(3, 3)`` [m³ times that of ∇f]."""
    return scaled_integral(f, x) / 64


def volume(x: Taylor) -> Any:
    """Return the exact volume of the cell with the given positions [m³]."""
    return scaled_volume(x) / 64


def mean_gradient(f: Any) -> Any:
    """Return the mean gradient of a P1 field over the cell, ``∫ ∇f dV / V``, shape ``(3, 3)``.

    Args:
        f: Function or argument of a vector P1 space on hexahedra.
    """
    x = positions(extract_unique_domain(f))
    return scaled_integral(taylor(f), x) / scaled_volume(x)


class _MeanGrad(MultiFunction):
    """Replaces every gradient by its mean over the cell."""

    expr = MultiFunction.reuse_if_untouched

    def grad(self, o: Any) -> Any:
        """Return the mean gradient of a P1 vector field."""
        (f,) = o.ufl_operands
        if not isinstance(f, FormArgument) or f.ufl_shape != (3,):
            raise ValueError(f"mean gradient: expected grad of a vector field, got grad({f})")
        return mean_gradient(f)


class _Virtual(_MeanGrad):
    """The same, but the test function and its gradient are replaced by what is given."""

    def __init__(self, value: Any, gradient: Any) -> None:
        super().__init__()
        self.value, self.gradient = value, gradient

    def argument(self, o: Any) -> Any:
        """Return what stands for the test function."""
        return o if self.value is None else self.value

    def grad(self, o: Any) -> Any:
        """Return what stands for its gradient, and the mean gradient of other fields."""
        return self.gradient if isinstance(o.ufl_operands[0], Argument) else super().grad(o)


def uniform(integrand: Any) -> Any:
    """Return an integrand with all gradients replaced by their cell means, for one-point rules.

    ``∫ P(∇u) : ∇w dV`` becomes ``P(∇ū) : ∇w̄ V`` for any residual, energy or derivative of one.
    The exact cell volume is a factor of the result, over the Jacobian that the rule brings.

    Args:
        integrand: UFL integrand of vector P1 fields on hexahedra.

    Returns:
        Integrand for :func:`one_point`.
    """
    domain = extract_unique_domain(integrand)
    means = map_integrand_dags(_MeanGrad(), _expanded(integrand))
    return means * volume(positions(domain)) * per_point(domain)


def mean_stress(integrand: Any) -> tuple[Any, Any]:
    """Return the stress of the cell means and, for one-point rules, the work of all else.

    An integrand that is linear in the test function w is ``P : ∇w + b · w``; its entries ``P_ij``
    are what it is for unit tensors in place of ``∇w``.

    Args:
        integrand: UFL integrand of vector P1 fields on hexahedra, linear in one argument.

    Returns:
        ``P`` of shape ``(3, 3)`` [Pa], and the integrand ``b · w`` [J/m³].
    """
    domain = extract_unique_domain(integrand)
    expanded = _expanded(integrand)
    rest = map_integrand_dags(_Virtual(None, Zero((3, 3))), expanded)
    rows = [[_Virtual(Zero((3,)), _unit(i, j)) for j in range(3)] for i in range(3)]
    P = as_matrix([[map_integrand_dags(rule, expanded) for rule in row] for row in rows])
    return P, rest * volume(positions(domain)) * per_point(domain)


def _unit(i: int, j: int) -> Any:
    """Return the tensor with one entry of one."""
    return as_matrix([[float((m, n) == (i, j)) for n in range(3)] for m in range(3)])


def _expanded(integrand: Any) -> Any:
    """Return an integrand with products and derivatives written out, but for gradients."""
    return apply_derivatives(apply_algebra_lowering(integrand))


def per_point(domain: Any) -> Any:
    """Return the factor that makes the one-point rule a sum over cells [1/m³]."""
    return 1 / ufl.algebra.Abs(JacobianDeterminant(domain))


def one_point(dx: Any, *, mixed: bool = False) -> Any:
    """Return the measure with one point at the centre of each cell.

    FFCx 0.11 computes geometry and fields at a single point once for the whole integral and then
    takes them at the points of every other rule of that integral too: the sum of a one-point form
    and one with more points on the same cells is silently wrong. ``mixed`` adds a point without
    weight next to the centre, which keeps the rules apart at the price of one more evaluation.

    Args:
        dx: Volume measure, with or without regions.
        mixed: Whether forms with other rules are added on the same cells.
    """
    if not mixed:
        return dx(metadata={"quadrature_degree": 0})
    points = np.array([[0.5, 0.5, 0.5], [0.501, 0.501, 0.501]])
    rule = {"quadrature_points": points, "quadrature_weights": np.array([1.0, 0.0])}
    return dx(metadata={"quadrature_rule": "custom", "quadrature_degree": 0, **rule})
