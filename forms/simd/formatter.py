# SPDX-License-Identifier: LGPL-3.0-or-later
"""C text of FFCx's statements with one lane per cell."""

from functools import singledispatchmethod
from typing import Any

import ffcx.codegeneration.lnodes as L
from ffcx.codegeneration.C.formatter import Formatter as ScalarFormatter
from ffcx.codegeneration.C.formatter import math_table

from forms.simd.branches import If, Prefetch

MASKS = {"&&": "&", "||": "|"}
COMPARISONS = (L.LT, L.LE, L.GT, L.GE, L.EQ, L.NE)


class Formatter(ScalarFormatter):
    """FFCx's C formatter with lanes: ``vec`` variables, scalar tables and constants.

    An expression has lanes if anything in it has. Where C needs lanes on both sides (initial
    values, assignments, comparisons, functions), scalars are broadcast by ``splat``.
    """

    def __init__(self, dtype: Any) -> None:
        super().__init__(dtype)
        self.scalars = {"c"}

    def has_lanes(self, node: Any) -> bool:
        """Return whether the value of an expression differs from lane to lane."""
        match node:
            case L.LiteralFloat() | L.LiteralInt():
                return False
            case L.Symbol():
                return node.dtype != L.DataType.INT and node.name not in self.scalars
            case L.ArrayAccess():
                return node.array.name not in self.scalars
            case L.MathFunction() | L.NaryOp():
                return any(self.has_lanes(arg) for arg in node.args)
            case L.ArithmeticBinOp():
                return self.has_lanes(node.lhs) or self.has_lanes(node.rhs)
            case L.Neg():
                return self.has_lanes(node.arg)
        return True  # conditions are masks, and conditionals blend lanes

    def lanes(self, node: Any) -> str:
        """Return the expression as lanes."""
        return self(node) if self.has_lanes(node) else f"splat({self(node)})"

    def _dtype_to_name(self, dtype: L.DataType) -> str:
        names = {L.DataType.SCALAR: "vec", L.DataType.REAL: "vec", L.DataType.BOOL: "mask"}
        return names.get(dtype) or super()._dtype_to_name(dtype)

    @singledispatchmethod
    def __call__(self, obj: Any) -> str:
        """Return the C text of a node; what is not registered below is as in FFCx's C."""
        return super().__call__(obj)

    @__call__.register
    def _(self, arr: L.ArrayDecl) -> str:
        if not arr.const:
            return super().__call__(arr)
        self.scalars.add(arr.symbol.name)
        number = "int" if arr.symbol.dtype == L.DataType.INT else "real"
        dims = "".join(f"[{n}]" for n in arr.sizes)
        values = self._build_initializer_lists(arr.values)
        return f"static const {number} {arr.symbol.name}{dims} = {values};\n"

    @__call__.register
    def _(self, v: L.VariableDecl) -> str:
        kind = self._dtype_to_name(v.symbol.dtype)
        return f"{kind} {self(v.symbol)} = {self.lanes(v.value)};\n"

    @__call__.register
    def _(self, expr: L.Assign) -> str:
        return f"{self(expr.lhs)} = {self.lanes(expr.rhs)};\n"

    @__call__.register
    def _(self, value: L.LiteralFloat) -> str:
        return f"(real){self._format_number(float(value.value))}"

    @__call__.register
    def _(self, oper: L.ArithmeticBinOp) -> str:
        """Format ``a op b``; an integer beside lanes is written as a real number."""
        if self.has_lanes(oper):
            oper = type(oper)(_real(oper.lhs), _real(oper.rhs))
        return super().__call__(oper)

    @__call__.register
    def _(self, oper: L.NaryOp) -> str:
        if self.has_lanes(oper):
            oper = type(oper)([_real(arg) for arg in oper.args])
        return super().__call__(oper)

    @__call__.register(L.LT)
    @__call__.register(L.LE)
    @__call__.register(L.GT)
    @__call__.register(L.GE)
    @__call__.register(L.EQ)
    @__call__.register(L.NE)
    def _(self, oper: Any) -> str:
        return f"(mask)(({self.lanes(oper.lhs)}) {oper.op} ({self.lanes(oper.rhs)}))"

    @__call__.register(L.And)
    @__call__.register(L.Or)
    def _(self, oper: Any) -> str:
        return f"(({self(oper.lhs)}) {MASKS[oper.op]} ({self(oper.rhs)}))"

    @__call__.register
    def _(self, oper: L.Not) -> str:
        return f"(~({self(oper.arg)}))"

    @__call__.register
    def _(self, s: L.Conditional) -> str:
        return f"blend({self(s.condition)}, {self.lanes(s.true)}, {self.lanes(s.false)})"

    @__call__.register
    def _(self, branch: If) -> str:
        body = "".join(map(self, branch.body))
        return f"if (any({self(branch.condition)}))\n{{\n{body}}}\n"

    @__call__.register
    def _(self, request: Prefetch) -> str:
        first = f"{self(request.array)} + {self(request.first)}"
        return f"prefetch({first}, {request.count});\n"

    @__call__.register
    def _(self, call: L.MathFunction) -> str:
        """Format a function; powers with a small integer exponent are products."""
        function, args = call.function, call.args
        if not self.has_lanes(call):
            name = math_table[self.scalar_type.name].get(function, function)
            return f"{name}({', '.join(map(self, args))})"
        if function == "power" and (exponent := _small_integer(args[1])) is not None:
            return f"lanes_powi({self(args[0])}, {exponent})"
        if function in ("bessel_j", "bessel_y"):
            return f"lanes_{function}({self(args[0])}, {self.lanes(args[1])})"
        return f"lanes_{function}({', '.join(map(self.lanes, args))})"


def _real(node: Any) -> Any:
    """Return an integer literal as a floating-point one, anything else as it is."""
    return L.LiteralFloat(float(node.value)) if isinstance(node, L.LiteralInt) else node


def _small_integer(node: Any) -> int | None:
    """Return the value of a literal that is an integer of at most 16, else ``None``."""
    if isinstance(node, L.Neg):
        value = _small_integer(node.arg)
        return None if value is None else -value
    if not isinstance(node, L.LiteralInt | L.LiteralFloat) or abs(node.value) > 16:
        return None
    return int(node.value) if float(node.value).is_integer() else None
