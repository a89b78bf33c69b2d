# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cell kernel over lanes, and the loop over batches of cells around it."""

from typing import Any

import basix.ufl
import numpy as np
from ffcx.codegeneration.C import integral_template
from ffcx.ir.representation import IntegralIR
from ufl import Argument, Coefficient, Jacobian
from ufl.classes import GeometricQuantity

from forms.simd.contraction import Backend, Generator, Symbols
from forms.simd.formatter import Formatter

# The loop takes its addresses as ``custom_data``, an array of 64-bit integers in this order:
# number of cells, number of batches with wide loads (forms/simd/nodes.py), coordinates, their dofs,
# dofs of the test function, then values and dofs of each coefficient, then the values of each
# constant, and last whether history is written. Dofs are numbers of first entries, uint32
# ``[batch][dof][lane]``. History is no array of dofs but a table of its own, of the type that is
# computed with, ``[batch][entry][lane]``: the kernel reads it where it stands (``old``), and writes
# it there (``new``), or to a place that nobody reads.
LOOP = """
static inline void cell_{name}(vec *restrict A, const vec *restrict w, const real *restrict c,
                               const vec *restrict coordinate_dofs, const loose *old, loose *new)
{{
{kernel}
}}

static void tabulate_tensor_{name}(real *restrict values, const real *restrict w_,
                                   const real *restrict c_, const real *restrict x_,
                                   const int *restrict entity, const uint8_t *restrict permutation,
                                   void *custom_data)
{{
  const int64_t *data = custom_data;
  const int64_t batches = (data[0] + LANES - 1) / LANES;
  const stored *x = (const stored *)data[2];
  stored *out = (stored *)values;
  real c[{constants} + 1];
  for (int i = 0, j = 0; i < {constant_count}; ++i)
    for (int k = 0; k < ((const int[]){constant_sizes})[i]; ++k)
      c[j++] = ((const stored *)data[{first_constant} + i])[k];
  for (int64_t b = 0; b < batches; ++b)
  {{
    const int wide = b < data[1];
    vec coordinate_dofs[{coordinates}], w[{coefficients} + 1], A[{size}];
{history}
    gather(coordinate_dofs, x, (const uint32_t *)data[3] + b * {coordinates} / 3 * LANES,
           {coordinates} / 3, 3, wide, {relative});
{gathers}
    for (int i = 0; i < {size}; ++i)
      A[i] = splat(0);
    cell_{name}(A, w, c, coordinate_dofs, old, new);
    const uint32_t *rows = (const uint32_t *)data[4] + b * {size} / {block} * LANES;
    if (b + 1 < batches)
      scatter(out, A, rows, {size} / {block}, {block}, LANES);
    else
      scatter(out, A, rows, {size} / {block}, {block}, (int)(data[0] - b * LANES));
  }}
}}

{enabled_init}

ufcx_integral {name} =
{{
  .enabled_coefficients = {enabled},
  .tabulate_tensor_{dtype} = tabulate_tensor_{name},
  .coordinate_element_hash = UINT64_C({coordinate_hash}),
  .domain = {domain},
}};
"""

GATHER = """    gather(w + {offset}, (const stored *)data[{data}],
           (const uint32_t *)data[{data} + 1] + b * {count} * LANES, {count}, {block}, wide,
           {relative});"""

HISTORY = """    loose elsewhere[{written} + 1];
    loose *old = (loose *)data[{data}] + b * {count};
    loose *new = {written} && data[{flag}] ? old : elsewhere;"""
NO_HISTORY = "    loose *old = 0, *new = 0;"

FIRST_COEFFICIENT = 5  # position of the first coefficient among the addresses


def generator(ir: IntegralIR, domain: basix.CellType, options: dict[str, Any]) -> tuple[str, str]:
    """Return declaration and implementation of one integral (interface of FFCx's languages).

    Raises:
        NotImplementedError: if it is not a cell integral of rank 1.
    """
    expression = ir.expression
    if expression.integral_type != "cell" or len(expression.tensor_shape) != 1:
        raise NotImplementedError("forms.simd: expected cell integrals of rank 1")
    name = f"{expression.name}_{domain.name}"
    element = _argument_element(ir)
    size, block = (element.dim, element.block_size)
    if options.get("history") and element.num_sub_elements > 1 and block == 1:
        size, block = (element.sub_elements[0].dim, element.sub_elements[0].block_size)
    backend = Backend(ir, options)
    kernel = Formatter(options["scalar_type"])(Generator(ir, backend, size).generate(domain))
    constants = expression.original_constant_offsets
    shifts = differences(ir) if np.dtype(options["scalar_type"]) == np.float32 else set()
    sizes = [int(np.prod(k.ufl_shape, dtype=int)) for k in constants]
    first_constant = FIRST_COEFFICIENT + 2 * len(expression.coefficient_numbering)
    implementation = LOOP.format(
        name=name,
        kernel=kernel,
        constants=sum(sizes),
        constant_count=len(sizes),
        constant_sizes="{" + ", ".join(map(str, [*sizes, 0])) + "}",
        first_constant=first_constant,
        coordinates=expression.number_coordinate_dofs,
        coefficients=sum(k.ufl_element().dim for k in expression.coefficient_offsets),
        size=size,
        block=block,
        relative=int(None in shifts),
        gathers=_gathers(ir, shifts, backend.symbols.history),
        history=_history(backend.symbols, element.dim - size, first_constant + len(sizes)),
        enabled=f"enabled_{name}" if ir.enabled_coefficients else "NULL",
        enabled_init=_enabled(ir, name),
        dtype=np.dtype(options["scalar_type"]).name,
        coordinate_hash=expression.coordinate_element_hash,
        domain=int(domain),
    )
    return integral_template.declaration.format(factory_name=name), implementation


def differences(ir: IntegralIR) -> set[Any]:
    """Return the coefficients of which only derivatives are used; None stands for the coordinates.

    A cell may then take them less the value at its first node: the basis functions of Lagrange
    elements add up to one. In single precision that keeps the digits of what differs in the cell.
    """
    used: dict[Any, bool] = {}  # whether all uses are derivatives
    for integrand in ir.expression.integrand.values():
        for attributes in integrand["factorization"].nodes.values():
            mt = attributes.get("mt")
            terminal = getattr(mt, "terminal", None)
            if isinstance(terminal, Coefficient):
                lagrange = terminal.ufl_element().element_family == basix.ElementFamily.P
                derived = bool(mt.local_derivatives) and lagrange
                used[terminal] = used.get(terminal, True) and derived
            elif isinstance(terminal, GeometricQuantity):
                used[None] = used.get(None, True) and isinstance(terminal, Jacobian)
    return {key for key, derived in used.items() if derived}


def _gathers(ir: IntegralIR, shifts: set[Any], history: list[Any]) -> str:
    """Return the calls that gather the coefficients which the integral uses, but the history."""
    numbers = ir.expression.coefficient_numbering
    lines = []
    for k, offset in ir.expression.coefficient_offsets.items():
        element = k.ufl_element()
        if not ir.enabled_coefficients[numbers[k]] or k in history:
            continue
        lines.append(
            GATHER.format(
                offset=offset,
                data=FIRST_COEFFICIENT + 2 * numbers[k],
                count=element.dim // element.block_size,
                block=element.block_size,
                relative=int(k in shifts),
            )
        )
    return "\n".join(lines)


def _history(symbols: Symbols, written: int, flag: int) -> str:
    """Return where the history of a batch stands, and where it is written.

    Args:
        symbols: Names of the coefficients of the integral.
        written: Numbers that the integral writes.
        flag: Position among the addresses of whether they are kept.
    """
    if not symbols.history:
        return NO_HISTORY
    (history,) = symbols.history
    data = FIRST_COEFFICIENT + 2 * symbols.coefficient_numbering[history]
    count = history.ufl_element().dim
    return HISTORY.format(data=data, count=count, written=written, flag=flag)


def _argument_element(ir: IntegralIR) -> Any:
    """Return the element of the test function."""
    terminals = [
        mt.terminal
        for integrand in ir.expression.integrand.values()
        for mt in integrand["modified_arguments"]
    ]
    (element,) = {t.ufl_element() for t in terminals if isinstance(t, Argument)}
    return element


def _enabled(ir: IntegralIR, name: str) -> str:
    """Return the table of which coefficients the integral uses."""
    if not ir.enabled_coefficients:
        return ""
    values = ", ".join(str(int(e)) for e in ir.enabled_coefficients)
    return f"static bool enabled_{name}[{len(ir.enabled_coefficients)}] = {{{values}}};"
