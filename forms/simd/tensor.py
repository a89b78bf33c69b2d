# SPDX-License-Identifier: LGPL-3.0-or-later
"""Tables of basis functions as products of one-dimensional factors (sum factorisation)."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import permutations
from typing import Any

import ffcx.codegeneration.lnodes as L
import numpy as np
import numpy.typing as npt

from meshes.arrays import Array, Index

ROUND_OFF = 1e-14
Store = Callable[[Any], Any]  # gives an expression a name, so that it is computed once


@dataclass(frozen=True)
class Product:
    """A table ``T[q, d] = f0[i, a] f1[j, b] f2[k, c]`` over points q = (i, j, k).

    Attributes:
        factors: Distinct rows of the three factors, shapes ``(rows, m)``.
        order: Axis of the dofs ``d`` that each factor acts on.
        pick: Row of the three factors, numbered as one, at each point, shape ``(q,)``.
    """

    factors: tuple[Array, ...]
    order: tuple[int, ...]
    pick: Index

    @property
    def rows(self) -> int:
        """Number of distinct rows of the table."""
        return int(np.prod([len(f) for f in self.factors]))

    def scaled(self, factor: float) -> "Product":
        """Return the table times a number."""
        last = _by_rows(self.factors)[-1]  # its partial sums have products anyway
        factors = tuple(factor * f if i == last else f for i, f in enumerate(self.factors))
        return replace(self, factors=factors)


def factorise(table: Array) -> Product | None:
    """Return the factors of a table, shape ``(q, d)``, or ``None`` if it has none.

    Points and dofs of hexahedra are cubes of numbers, each in one of two nestings of the axes.
    """
    n, m = (round(size ** (1 / 3)) for size in table.shape)
    if (n**3, m**3) != table.shape or not np.any(table):
        return None
    for order in permutations(range(3)):
        axes = [axis for i, d in enumerate(order) for axis in (i, 3 + d)]
        cube = table.reshape(n, n, n, m, m, m).transpose(axes).reshape(n * m, n * m, n * m)
        peak = np.unravel_index(np.argmax(np.abs(cube)), cube.shape)
        fibres = [np.moveaxis(cube, i, 0)[(slice(None), *np.delete(peak, i))] for i in range(3)]
        fibres = [f / cube[peak] for f in fibres]  # the largest entry is one: no product with it
        scale = cube[peak]
        if np.allclose(
            scale * np.einsum("i,j,k", *fibres), cube, rtol=0, atol=ROUND_OFF * abs(scale)
        ):
            return _distinct([f.reshape(n, m) for f in fibres], order, scale)
    return None


def _distinct(factors: list[Array], order: tuple[int, ...], scale: float) -> Product:
    """Drop repeated rows of the factors; the scale goes to the factor that is used last."""
    kept, picks = [], []
    for factor in factors:
        factor = np.where(np.abs(factor) < ROUND_OFF, 0.0, factor)
        ones = np.isclose(np.abs(factor), 1, rtol=0, atol=ROUND_OFF)
        rounded = np.where(ones, np.sign(factor), factor)
        pick: list[int] = []
        rows: list[Array] = []
        for row in rounded:
            same = [i for i, r in enumerate(rows) if np.allclose(r, row, rtol=0, atol=ROUND_OFF)]
            pick.append(same[0] if same else len(rows))
            rows += [] if same else [row]
        kept.append(np.array(rows))
        picks.append(np.array(pick))
    shape = [len(rows) for rows in kept]
    pick3 = np.ravel_multi_index(np.meshgrid(*picks, indexing="ij"), shape).ravel()
    return Product(tuple(kept), order, pick3).scaled(scale)


def evaluate(product: Product, dofs: Sequence[Any], store: Store) -> list[Any]:
    """Return the distinct values ``Σ_d T[q, d] dofs[d]``, one factor after the other.

    Where there is a single point, the factors are sums and differences that tables have in common:
    their sizes and signs are left to the end.

    Args:
        product: The table.
        dofs: Expressions of the ``m³`` dofs.
        store: Called with each partial sum; returns what stands for it.
    """
    values = _cube(dofs).transpose(product.order)
    factors, scale = _signs(product) if product.rows == 1 else (product.factors, 1.0)
    for axis in _by_rows(factors):
        values = _apply(factors[axis], values, axis, store)
    return [store(L.LiteralFloat(scale) * value) for value in values.ravel()]


def _signs(product: Product) -> tuple[list[Array], float]:
    """Return the factors of a single row divided by their first entries, and what is left over."""
    first = [float(f[0, np.argmax(np.abs(f[0]) > ROUND_OFF)]) for f in product.factors]
    factors = [f / size for f, size in zip(product.factors, first, strict=True)]
    rounded = [np.where(np.abs(np.abs(f) - 1) < 1e-12, np.sign(f), f) for f in factors]
    scale = float(np.prod(first))
    return rounded, round(scale, 12) if abs(scale - round(scale, 12)) < 1e-14 else scale


def scatter_together(products: Sequence[Product], values: Sequence[Any], store: Store) -> list[Any]:
    """Return ``Σ_t T_t[0, d] values[t]`` for each dof d, for tables t of a single point.

    The transpose of :func:`evaluate` for all tables at once: 24 sums instead of 56.

    Args:
        products: Tables with one row.
        values: An expression for each.
        store: Called with each partial sum; returns what stands for it.
    """
    terms: dict[
        Any, Any
    ] = {}  # by the rows of axes that are not yet dofs and dofs of those that are
    for product, value in zip(products, values, strict=True):
        factors, scale = _signs(product)
        key = tuple(tuple(factors[i][0]) for i in np.argsort(product.order))
        scaled = store(L.LiteralFloat(scale) * value)
        terms[key] = terms[key] + scaled if key in terms else scaled
    for axis in range(3):
        sums: dict[Any, Any] = {}
        for key, value in terms.items():
            for dof, entry in enumerate(key[axis]):
                to = (*key[:axis], dof, *key[axis + 1 :])
                term = L.LiteralFloat(float(entry)) * value
                sums[to] = sums[to] + term if to in sums else term
        terms = {key: store(value) for key, value in sums.items()}
    return [terms[key] for key in sorted(terms)]


def scatter(product: Product, values: Sequence[Any], store: Store) -> list[Any]:
    """Return ``Σ_q T[q, d] values[q]`` for each dof d, where equal rows are summed already.

    Args:
        product: The table.
        values: Expressions of the sums over points with the same row, in the order of ``pick``.
        store: Called with each partial sum; returns what stands for it.
    """
    cube = np.empty(len(values), dtype=object)
    cube[:] = values
    cube = cube.reshape([len(f) for f in product.factors])
    for axis in reversed(_by_rows(product.factors)):
        cube = _apply(product.factors[axis].T, cube, axis, store)
    return list(cube.transpose(np.argsort(product.order)).ravel())


def _by_rows(factors: Sequence[Array]) -> list[int]:
    """Axes by number of rows: the sooner a sum shrinks, the less there is to do."""
    return sorted(range(3), key=lambda axis: len(factors[axis]))


def _cube(items: Sequence[Any]) -> npt.NDArray[Any]:
    """Return the expressions as an array of shape ``(m, m, m)``."""
    cube = np.empty(len(items), dtype=object)
    cube[:] = items
    m = round(len(items) ** (1 / 3))
    return cube.reshape(m, m, m)


def _apply(factor: Array, values: npt.NDArray[Any], axis: int, store: Store) -> npt.NDArray[Any]:
    """Multiply the expressions along one axis by a matrix, shape ``(rows, values.shape[axis])``."""
    lines = np.moveaxis(values, axis, 0)
    result = np.empty((len(factor), *lines.shape[1:]), dtype=object)
    for index in np.ndindex(lines.shape[1:]):
        for i, row in enumerate(factor):
            result[(i, *index)] = store(_dot(row, lines[(slice(None), *index)]))
    return np.moveaxis(result, 0, axis)


def _dot(row: Array, values: Any) -> Any:
    """Return ``Σ row[j] values[j]``; products with 0, 1 and -1 are left out."""
    total: Any = L.LiteralFloat(0.0)
    for coefficient, value in zip(row, values, strict=True):
        total = total + L.LiteralFloat(float(coefficient)) * value
    return total
