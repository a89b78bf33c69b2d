# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sum factorisation around the loop over quadrature points: values before it, vector after it.

FFCx sums over dofs at each quadrature point. Where a table is a product of one-dimensional factors
(Lagrange elements on hexahedra with Gauss quadrature), doing so one direction after the other for
all points takes a quarter of the operations. Other tables are left to FFCx.
"""

from functools import reduce
from operator import mul
from typing import Any

import basix.ufl
import ffcx.codegeneration.lnodes as L
import numpy as np
from ffcx.codegeneration.access import FFCXBackendAccess
from ffcx.codegeneration.backend import FFCXBackend
from ffcx.codegeneration.definitions import FFCXBackendDefinitions
from ffcx.codegeneration.integral_generator import IntegralGenerator
from ffcx.codegeneration.symbols import FFCXBackendSymbols
from ffcx.ir.elementtables import piecewise_ttypes
from ufl.classes import Division
from ufl.classes import Product as UflProduct

from forms.simd.branches import Prefetch, add_branches
from forms.simd.tensor import Product, evaluate, factorise, scatter, scatter_together

OLD, NEW = (L.Symbol(name, L.DataType.SCALAR) for name in ("old", "new"))  # history
LARGEST = 4**3  # points or dofs whose sums are written out


class Plan:
    """Statements before and after the loop of one quadrature rule, and their names."""

    def __init__(self) -> None:
        self.before: list[Any] = []
        self.after: list[Any] = []
        self.names = 0
        self.picks: dict[bytes, Any] = {}

    def name(self, prefix: str, kind: L.DataType = L.DataType.SCALAR) -> L.Symbol:
        """Return a symbol that no other has."""
        self.names += 1
        return L.Symbol(f"{prefix}_{self.names}", kind)

    def store(self, statements: list[Any]) -> Any:
        """Return a function that appends a variable for each expression it is given."""

        def store(expression: Any) -> Any:
            if isinstance(expression, L.Symbol | L.ArrayAccess | L.LiteralFloat):
                return expression
            symbol = self.name("s")
            statements.append(L.VariableDecl(symbol, expression))
            return symbol

        return store

    def row(self, product: Product, point: Any) -> Any:
        """Return the index of the distinct row at a quadrature point."""
        if np.array_equal(product.pick, np.arange(len(product.pick))):
            return point
        key = product.pick.tobytes()
        if key not in self.picks:
            self.picks[key] = self.name("pick", L.DataType.INT)
            self.before.append(L.ArrayDecl(self.picks[key], values=product.pick, const=True))
        return L.ArrayAccess(self.picks[key], [point])


class Symbols(FFCXBackendSymbols):
    """Names of arrays, with those of history.

    Attributes:
        history: Coefficients that are history: at most one.
    """

    history: list[Any]

    def coefficient_dof_access(self, coefficient: Any, dof_index: Any) -> Any:
        """Return a number of a coefficient, or of the history at the only point."""
        if coefficient in self.history:
            return OLD[dof_index]
        return super().coefficient_dof_access(coefficient, dof_index)


class Backend(FFCXBackend):
    """FFCx's backend with :class:`Symbols` and :class:`Definitions`."""

    symbols: Symbols

    def __init__(self, ir: Any, options: dict[str, Any]) -> None:
        expression = ir.expression
        numbers = expression.coefficient_numbering
        kind = (expression.entity_type, expression.integral_type)
        self.symbols = Symbols(
            numbers, expression.coefficient_offsets, expression.original_constant_offsets
        )
        self.symbols.history = [
            k for k in numbers if options.get("history") and is_history(k.ufl_element())
        ]
        self.access = FFCXBackendAccess(*kind, self.symbols, options)
        self.definitions = Definitions(*kind, self.access, options)


class Definitions(FFCXBackendDefinitions):
    """Values of coefficients and geometry at the quadrature points."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.plan = Plan()

    def coefficient(self, mt: Any, tabledata: Any, quadrature_rule: Any, access: Any) -> Any:
        """Return the definition of a coefficient's value at a point."""
        w, offset = self.symbols.coefficients, self.symbols.coefficient_offsets[mt.terminal]
        if mt.terminal in self.symbols.history:
            w, offset = OLD, 0
        block = tabledata.block_size
        tabulated = self._tabulate(w, offset, block, tabledata, quadrature_rule, access)
        return tabulated or super().coefficient(mt, tabledata, quadrature_rule, access)

    def _define_coordinate_dofs_lincomb(
        self, mt: Any, tabledata: Any, quadrature_rule: Any, access: Any
    ) -> Any:
        """Return the definition of a component of ``x`` or its Jacobian at a point."""
        x = L.Symbol("coordinate_dofs", L.DataType.REAL)
        tabulated = self._tabulate(x, 0, 3, tabledata, quadrature_rule, access)
        return tabulated or super()._define_coordinate_dofs_lincomb(
            mt, tabledata, quadrature_rule, access
        )

    def _tabulate(
        self, array: Any, offset: int, block: int, tabledata: Any, rule: Any, access: Any
    ) -> Any:
        """Return ``access = values[point]`` and compute the values before the loop, if possible."""
        if tabledata.ttype == "quadrature" and isinstance(access, L.Symbol):
            at = array[offset + tabledata.offset + block * self.symbols.quadrature_loop_index]
            return L.Section("Value", [], [L.VariableDecl(access, at)], [array], [access])
        product = _product(tabledata)
        if product is None or not isinstance(access, L.Symbol):
            return None
        first, count = offset + tabledata.offset, tabledata.values.shape[3]
        dofs = [array[first + block * i] for i in range(count)]
        inside = rule is None or tabledata.ttype in piecewise_ttypes
        statements: list[Any] = []
        values = evaluate(product, dofs, self.plan.store(statements))
        if inside:  # the same at every point: no array
            result = values[0]
        else:
            table = self.plan.name("at")
            self.plan.before.append(L.ArrayDecl(table, sizes=product.rows))
            statements += [L.Assign(table[i], value) for i, value in enumerate(values)]
            self.plan.before.append(L.Section("Tabulate", statements, [], [array], [table]))
            result = table[self.plan.row(product, self.symbols.quadrature_loop_index)]
            return L.Section("Value", [], [L.VariableDecl(access, result)], [table], [access])
        statements.append(L.Assign(access, result))
        zero = [L.VariableDecl(access, 0.0)]
        return L.Section("Value", statements, zero, [array], [access])


class Generator(IntegralGenerator):
    """FFCx's generator of a cell kernel with sums over dofs outside the quadrature loop.

    Args:
        ir: FFCx's representation of the integral.
        backend: A :class:`Backend`.
        size: Entries of the element vector, all if not given; what the test function has beyond
            them are the values of history at the quadrature points, which are stored, not summed.
    """

    def __init__(self, ir: Any, backend: Any, size: int | None = None) -> None:
        super().__init__(ir, backend)
        self.size = ir.expression.tensor_shape[0] if size is None else size

    def generate(self, domain: Any) -> Any:
        """Return the code of the kernel; what renews history does so where something flows."""
        code = super().generate(domain)
        if self.size < self.ir.expression.tensor_shape[0]:
            add_branches(code)
        return code

    def generate_quadrature_loop(self, quadrature_rule: Any, domain: Any) -> list[Any]:
        """Return the loop over one quadrature rule with what goes before and after it."""
        plan = self.backend.definitions.plan
        plan.before, plan.after, plan.picks = [], [], {}
        loop = super().generate_quadrature_loop(quadrature_rule, domain)
        return [*plan.before, *loop, *plan.after]

    def generate_block_parts(
        self, quadrature_rule: Any, domain: Any, blockmap: tuple[Any, ...], blocklist: list[Any]
    ) -> tuple[list[Any], list[Any]]:
        """Return statements in the loop that collect what multiplies the test function."""
        own = [b for b in blocklist if b.ma_data[0].tabledata.offset >= self.size]
        if own:  # grouped by FFCx with the sums, if there are as many dofs as points
            rest = [b for b in blocklist if b not in own]
            stored, values = self._history(quadrature_rule, domain, own)
            if not rest:
                return [stored], values
            parts, others = self.generate_block_parts(quadrature_rule, domain, blockmap, rest)
            return [*parts, stored], [*others, *values]
        products = [_product(block.ma_data[0].tabledata) for block in blocklist]
        if None in products:
            return super().generate_block_parts(quadrature_rule, domain, blockmap, blocklist)
        intermediates: list[Any] = []
        groups: dict[tuple[Any, ...], list[Any]] = {}
        for block, product in zip(blocklist, products, strict=True):
            table = block.ma_data[0].tabledata
            key = (table.name, table.block_size, table.offset)
            factor, variable = self._weighted(quadrature_rule, domain, block)
            intermediates += variable
            groups.setdefault(key, [product]).append(factor)
        weight = _common_weight(quadrature_rule)
        if weight is not None and len(quadrature_rule.weights) == 1:
            statements = self._single(weight, groups)
        else:
            statements = [self._collect(key, weight, *group) for key, group in groups.items()]
        symbols = [i.symbol for i in intermediates]
        A = self.backend.symbols.element_tensor
        return [L.Section("Collect", statements, [], symbols, [A])], intermediates

    def _history(self, rule: Any, domain: Any, blocklist: list[Any]) -> tuple[Any, list[Any]]:
        """Return what stores new history at a point, and variables for its values.

        Weight and Jacobian do not belong to it: the form has the inverse of the latter
        (:func:`forms.cells.per_point`), and both are left out, so that what does not change is
        kept to the last bit.
        """
        point = self.backend.symbols.quadrature_loop_index
        nodes = self.ir.expression.integrand[(domain, rule)]["factorization"].nodes
        statements: list[Any] = []
        variables: list[Any] = []
        for block in blocklist:
            table = block.ma_data[0].tabledata
            index = block.factor_indices_comp_indices[0][0]
            above, below = _factors(nodes[index]["expression"])
            common = [f for f in below if f in above]
            for f in common:
                above.remove(f)
                below.remove(f)
            factors = [self.get_var(rule, domain, f) for f in above]
            factors += [L.LiteralFloat(1.0) / self.get_var(rule, domain, f) for f in below]
            value = reduce(mul, factors, L.LiteralFloat(1.0))
            symbol, known = self.get_temp_symbol("new", (rule, index))
            variables += [] if known else [L.VariableDecl(symbol, value)]
            at = table.block_size * point + (table.offset - self.size)
            statements.append(L.Assign(NEW[at], symbol))
        width = (self.ir.expression.tensor_shape[0] - self.size) // len(rule.weights)
        next_batch = width * (point + len(rule.weights))
        statements.append(Prefetch(OLD, next_batch, width))
        symbols = [v.symbol for v in variables]
        return L.Section("History", statements, [], symbols, [NEW]), variables

    def _weighted(self, rule: Any, domain: Any, block: Any) -> tuple[Any, list[Any]]:
        """Return what multiplies the test function at a point, and a variable for it if new."""
        index = block.factor_indices_comp_indices[0][0]
        nodes = self.ir.expression.integrand[(domain, rule)]["factorization"].nodes
        f = self._without_jacobian(rule, domain, nodes[index]["expression"])
        if _common_weight(rule) is None:
            symbols = self.backend.symbols
            f = f * symbols.weights_table(rule)[symbols.quadrature_loop_index]
        symbol, known = self.get_temp_symbol("fw", (rule, index, block.all_factors_piecewise))
        return symbol, [] if known else [L.VariableDecl(symbol, f)]

    def _without_jacobian(self, rule: Any, domain: Any, expression: Any) -> Any:
        """Return the code of an expression; a factor and its own inverse are left out."""
        above, below = _factors(expression)
        common = [f for f in below if f in above]
        parts = [self.get_var(rule, domain, f) for f in above if f not in common]
        if not common or len(common) < len(below) or len(set(above)) < len(above) or None in parts:
            return self.get_var(rule, domain, expression)
        return reduce(mul, parts, L.LiteralFloat(1.0))

    def _single(self, weight: float, groups: dict[tuple[Any, ...], list[Any]]) -> list[Any]:
        """Add all that a single point has to ``A``, all tables of a component together."""
        A, plan = self.backend.symbols.element_tensor, self.backend.definitions.plan
        components: dict[tuple[int, int], list[list[Any]]] = {}
        for (_, block, offset), group in groups.items():
            components.setdefault((block, offset), []).append(group)
        statements: list[Any] = []
        for (block, offset), found in components.items():
            tables = [group[0].scaled(weight) for group in found]
            values = [sum(group[2:], start=group[1]) for group in found]
            for i, value in enumerate(scatter_together(tables, values, plan.store(statements))):
                statements.append(L.AssignAdd(A[block * i + offset], value))
        return statements

    def _collect(
        self, key: tuple[Any, ...], weight: float | None, product: Product, *factors: Any
    ) -> Any:
        """Return the sum in the loop of what has one table; add its share to ``A`` after it."""
        plan, A = self.backend.definitions.plan, self.backend.symbols.element_tensor
        _, block, offset = key
        total = plan.name("sum")
        plan.before.append(L.ArrayDecl(total, sizes=product.rows))
        zeros: list[Any] = [L.Assign(total[i], 0.0) for i in range(product.rows)]
        plan.before.append(L.Section("Clear", zeros, [], [], [total]))
        statements: list[Any] = []
        sums = [total[i] for i in range(product.rows)]
        weighted = product if weight is None else product.scaled(weight)
        for i, value in enumerate(scatter(weighted, sums, plan.store(statements))):
            statements.append(L.AssignAdd(A[block * i + offset], value))
        plan.after.append(L.Section("Element vector", statements, [], [total], [A]))
        row = plan.row(product, self.backend.symbols.quadrature_loop_index)
        return L.AssignAdd(total[row], sum(factors[1:], start=factors[0]))


def is_history(element: Any) -> bool:
    """Return whether an element is one of values at quadrature points."""
    while element.block_size > 1:
        element = element.sub_elements[0]
    return isinstance(element, basix.ufl._QuadratureElement)


def _factors(expression: Any) -> tuple[list[Any], list[Any]]:
    """Return numerators and denominators of a UFL product."""
    if isinstance(expression, UflProduct):
        parts = [_factors(operand) for operand in expression.ufl_operands]
        return [f for above, _ in parts for f in above], [f for _, below in parts for f in below]
    if isinstance(expression, Division) and expression.ufl_operands[0] == 1:
        return [], [expression.ufl_operands[1]]
    return [expression], []


def _common_weight(rule: Any) -> float | None:
    """Return the weight of all points, which can wait until after the loop, if they have one."""
    first = float(rule.weights[0])
    return first if np.allclose(rule.weights, first, rtol=1e-15, atol=0) else None


def _product(tabledata: Any) -> Product | None:
    """Return the factors of a table of one cell, if it has factors and is small."""
    values = tabledata.values
    if tabledata.is_permuted or values.shape[:2] != (1, 1) or max(values.shape[2:]) > LARGEST:
        return None
    return factorise(values[0, 0])
