# SPDX-License-Identifier: LGPL-3.0-or-later
"""Floating-point operations of the code that FFCx or :mod:`forms.simd` generates for a form."""

from typing import Any

import ffcx.codegeneration.lnodes as L
import numpy as np
from ffcx.analysis import analyze_ufl_objects
from ffcx.codegeneration.backend import FFCXBackend
from ffcx.codegeneration.integral_generator import IntegralGenerator
from ffcx.ir.representation import compute_ir
from ffcx.options import get_options

from forms.simd.contraction import Definitions, Generator


def operations(form: Any, *, native: bool) -> int:
    """Return additions, multiplications and divisions per cell in the generated code.

    Args:
        form: Rank-1 UFL form of cell integrals.
        native: Of the code of ``forms.simd``, else of FFCx's C.
    """
    options = get_options({"scalar_type": np.float64})
    ir = compute_ir(analyze_ufl_objects([form], np.float64), {}, "bench", options, False)
    total = 0
    for integral in ir.integrals:
        for cell in {key[0] for key in integral.expression.integrand}:
            backend = FFCXBackend(integral, options)
            if native:
                backend.definitions = Definitions(backend, options)
            generator = (Generator if native else IntegralGenerator)(integral, backend)
            total += live(generator.generate(cell))
    return total


def live(code: Any) -> int:
    """Return the floating-point operations of generated code without values that nobody reads."""
    names: set[str] | None = None
    while True:
        seen = read(code, names)
        if seen == names:
            return counted(code, seen)
        names = seen


def read(node: Any, names: set[str] | None) -> set[str]:
    """Return the names that the code reads, except for variables that are not among ``names``."""
    match node:
        case L.VariableDecl() if names is not None and node.symbol.name not in names:
            return set()
        case L.VariableDecl():
            return read(node.value, names)
        case L.Symbol():
            return {node.name}
        case L.ForRange():
            return read(node.body, names)
        case L.Section() | L.StatementList():
            parts = [*getattr(node, "declarations", []), *node.statements]
        case L.Declaration() | L.Comment():
            return set()
        case L.Statement():
            parts = [node.expr]
        case L.Assign():
            parts = [node.rhs]
        case L.ArrayAccess():
            parts = [node.array, *node.indices]
        case _:
            parts = [getattr(node, name) for name in ("lhs", "rhs", "arg") if hasattr(node, name)]
            parts += getattr(node, "args", [])
    return set().union(*(read(part, names) for part in parts))


def counted(node: Any, names: set[str]) -> int:
    """Return the floating-point operations of a node of FFCx's code tree."""
    match node:
        case L.ForRange():
            return (node.end.value - node.begin.value) * counted(node.body, names)
        case L.Section() | L.StatementList():
            parts = [*getattr(node, "declarations", []), *node.statements]
            return sum(counted(part, names) for part in parts)
        case L.VariableDecl():
            return counted(node.value, names) if node.symbol.name in names else 0
        case L.AssignAdd() | L.AssignSub() | L.AssignMul() | L.AssignDiv():
            return 1 + counted(node.rhs, names)
        case L.Assign():
            return counted(node.rhs, names)
        case L.ArithmeticBinOp():
            return 1 + counted(node.lhs, names) + counted(node.rhs, names)
        case L.NaryOp():
            return len(node.args) - 1 + sum(counted(arg, names) for arg in node.args)
        case L.MathFunction():  # a function is none of these operations, its arguments are
            return sum(counted(arg, names) for arg in node.args)
        case L.Neg():
            return counted(node.arg, names)
        case L.Declaration() | L.Comment():
            return 0
        case L.Statement():
            return counted(node.expr, names)
    return 0  # literals, symbols, elements of arrays
