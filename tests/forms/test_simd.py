# SPDX-License-Identifier: LGPL-3.0-or-later
"""The FFCx backend: its C text, and the factors of its tables. test_native.py runs it."""

from mpi4py import MPI

import basix
import dolfinx
import ffcx.codegeneration.lnodes as L
import ffcx.compiler
import ffcx.options
import numpy as np
import pytest
import ufl
from dolfinx import fem
from hypothesis import given, settings
from hypothesis import strategies as st

from forms.simd import Formatter
from forms.simd.batches import batches, by_lane, integral_cells, last_to_the_end
from forms.simd.tensor import evaluate, factorise, scatter, scatter_together

X, Y = (L.Symbol(name, L.DataType.SCALAR) for name in "xy")
C = L.Symbol("c", L.DataType.SCALAR)


@pytest.mark.parametrize(
    "node, text",
    [
        (L.VariableDecl(X, L.LiteralFloat(0.0)), "vec x = splat((real)0.0);\n"),
        (L.VariableDecl(X, C[0]), "vec x = splat(c[0]);\n"),
        (L.Assign(X, Y * C[2]), "x = y * c[2];\n"),
        (L.Mul(L.LiteralInt(2), X), "(real)2.0 * x"),
        (L.MathFunction("power", (X, L.LiteralInt(3))), "lanes_powi(x, 3)"),
        (L.MathFunction("power", (X, L.LiteralFloat(0.5))), "lanes_power(x, splat((real)0.5))"),
        (L.MathFunction("sqrt", (C[0],)), "sqrt(c[0])"),
        (
            L.Conditional(L.LT(X, L.LiteralInt(1)), Y, L.LiteralInt(0)),
            "blend((mask)((x) < (splat(1))), y, splat(0))",
        ),
        (L.ArrayDecl(C, values=np.array([0.5]), const=True), "static const real c[1] = {0.5};\n"),
    ],
)
def test_statements_have_lanes_where_cells_differ(node, text):
    """Tables, literals and constants stay scalar until lanes are needed."""
    assert Formatter(np.float64)(node) == text


def test_forms_of_another_kind_have_no_text():
    """A matrix is refused when FFCx asks for it."""
    msh = dolfinx.mesh.create_unit_cube(MPI.COMM_SELF, 1, 1, 1, dolfinx.mesh.CellType.hexahedron)
    V = fem.functionspace(msh, ("Lagrange", 1))
    mass = ufl.inner(ufl.TrialFunction(V), ufl.TestFunction(V)) * ufl.dx
    options = ffcx.options.get_options({"language": "forms.simd", "scalar_type": "float64"})
    with pytest.raises(NotImplementedError, match="cell integrals of rank 1"):
        ffcx.compiler.compile_ufl_objects([mass], options)


def tables(degree: int, derivative: int) -> np.ndarray:
    """P1 basis functions or a derivative at Gauss points of a hexahedron, shape ``(q, 8)``."""
    points, _ = basix.make_quadrature(basix.CellType.hexahedron, degree)
    element = basix.create_element(
        basix.ElementFamily.P, basix.CellType.hexahedron, 1, basix.LagrangeVariant.gll_warped
    )
    return element.tabulate(1, points)[derivative, :, :, 0]


@pytest.mark.parametrize("degree", [1, 2, 4, 6])
@pytest.mark.parametrize("derivative", range(4))
def test_tables_of_hexahedra_are_products(degree, derivative):
    """Both directions of the table: dofs to points and, transposed, points to dofs."""
    table = tables(degree, derivative)
    product = factorise(table)
    assert product is not None
    assert product.rows == len(np.unique(table.round(12), axis=0))
    random = np.random.default_rng(degree)
    dofs, values = random.random(8), random.random(len(table))
    seen = numbers(evaluate(product, [L.LiteralFloat(v) for v in dofs], fold))
    np.testing.assert_allclose(seen[product.pick], table @ dofs, atol=1e-13)
    sums = np.bincount(product.pick, values, product.rows)
    back = numbers(scatter(product.scaled(3.0), [L.LiteralFloat(float(s)) for s in sums], fold))
    np.testing.assert_allclose(back, 3 * table.T @ values, atol=1e-12)


def test_tables_of_one_point_scatter_together():
    """Seven derivatives of eight basis functions: the sum of what each gives alone."""
    element = basix.create_element(
        basix.ElementFamily.P, basix.CellType.hexahedron, 1, basix.LagrangeVariant.gll_warped
    )
    seen = element.tabulate(3, np.array([[0.5, 0.5, 0.5]]))[:, :, :, 0]
    orders = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0), (1, 0, 1), (0, 1, 1), (1, 1, 1)]
    rows = [seen[basix.index(*order)] for order in orders]
    products = [factorise(row) for row in rows]
    values = np.random.default_rng(0).random(7)
    literals = [L.LiteralFloat(float(v)) for v in values]
    found = numbers(scatter_together(products, literals, fold))
    np.testing.assert_allclose(found, values @ np.concatenate(rows), atol=1e-14)


def fold(node):
    """The literal that an expression of literals is equal to."""
    if isinstance(node, L.LiteralFloat):
        return node
    if isinstance(node, L.Neg):
        return L.LiteralFloat(-fold(node.arg).value)
    left, right = fold(node.lhs).value, fold(node.rhs).value
    return L.LiteralFloat({"+": left + right, "-": left - right, "*": left * right}[node.op])


def numbers(literals) -> np.ndarray:
    """Values of literals."""
    return np.array([literal.value for literal in literals])


@pytest.mark.parametrize("shape", [(8, 8), (27, 8), (6, 8), (1, 1), (4, 4)])
def test_tables_without_factors_are_left_alone(shape):
    """Random numbers, and sizes that are no cubes; a single number is its own factor."""
    product = factorise(np.random.default_rng(0).random(shape))
    assert (product is None) == (shape != (1, 1))


@settings(max_examples=30, deadline=None, derandomize=True)
@given(st.integers(0, 40), st.sampled_from([2, 4, 8, 16]))
def test_batches_hold_every_cell_once_and_repeat_the_last(n, lanes):
    """Lane l of batch b is cell b * lanes + l; dofmaps with the same numbers share memory."""
    dofmap = np.random.default_rng(n).integers(0, 99, (50, 8)).astype(np.int32)
    cells = np.random.default_rng(n).permutation(50)[:n].astype(np.int32)
    first, same, threes = batches([(dofmap, 1), (dofmap.copy(), 1), (dofmap, 3)], cells, lanes)
    assert first is same
    np.testing.assert_array_equal(threes, 3 * first)
    assert first.shape == (-(-n // lanes), 8, lanes)
    flat = first.transpose(0, 2, 1).reshape(-1, 8)
    np.testing.assert_array_equal(flat[:n], dofmap[cells])
    np.testing.assert_array_equal(flat[n:], np.repeat(flat[n - 1 : n], len(flat) - n, axis=0))
    np.testing.assert_array_equal(by_lane(dofmap, cells, lanes), first)


@pytest.mark.parametrize("lanes", [4, 8])
def test_wide_batches_have_no_last_dof(lanes):
    """All cells are kept; the batches counted hold neither dof 98 of one nor 48 of the other."""
    random = np.random.default_rng(lanes)
    one, two = (random.integers(0, n, (50, 8)).astype(np.int32) for n in (99, 49))
    given = np.arange(50, dtype=np.int32)
    cells, wide = last_to_the_end([(one, 99), (two, 49)], given, lanes)
    np.testing.assert_array_equal(np.sort(cells), given)
    has = (one[cells] == 98).any(axis=1) | (two[cells] == 48).any(axis=1)
    assert not has[: wide * lanes].any() and 0 < wide == (~has).sum() // lanes < 50 // lanes


def test_cells_of_integrals_are_those_of_dolfinx():
    """Everywhere, a tag, and a tag that no cell has."""
    msh = dolfinx.mesh.create_unit_cube(MPI.COMM_SELF, 2, 1, 1, dolfinx.mesh.CellType.hexahedron)
    tags = dolfinx.mesh.meshtags(msh, 3, np.array([1], np.int32), np.array([4], np.int32))
    w = ufl.TestFunction(fem.functionspace(msh, ("Lagrange", 1)))
    dx = ufl.Measure("dx", domain=msh, subdomain_data=tags)
    cells = integral_cells(w * dx + w * dx((4, 5)), [-1, 4, 5])
    assert [list(c) for c in cells] == [[0, 1], [1], []]


def test_different_tags_in_one_form_are_refused():
    """DOLFINx has one set of tags per form; the first would be taken silently."""
    msh = dolfinx.mesh.create_unit_cube(MPI.COMM_SELF, 2, 1, 1, dolfinx.mesh.CellType.hexahedron)
    one, two = (
        dolfinx.mesh.meshtags(msh, 3, np.array([i], np.int32), np.array([4], np.int32))
        for i in range(2)
    )
    w = ufl.TestFunction(fem.functionspace(msh, ("Lagrange", 1)))
    form = sum(w * ufl.Measure("dx", msh, subdomain_data=tags)(4) for tags in (one, two))
    with pytest.raises(ValueError, match="same tags in all measures"):
        integral_cells(form, [4])
