# SPDX-License-Identifier: LGPL-3.0-or-later
"""What stands at the head of the generated C file: lane types, lane functions, gather, scatter."""

from collections.abc import Iterable
from typing import Any

from ffcx.codegeneration.C import file as scalar_file
from ffcx.codegeneration.C.formatter import math_table
from ffcx.codegeneration.utils import dtype_to_c_type

suffixes = scalar_file.suffixes

# VECTOR_BYTES and STORED (type of the arrays in memory) come from the command line, see
# forms/native.py. Padding lanes repeat a cell, so that they compute nothing unusual.
LANES = """
typedef {real} real;
typedef STORED stored;
#define LANES ((int)(VECTOR_BYTES / sizeof(real)))
#if defined(__clang__) || __GNUC__ >= 12
#define CAN_SHUFFLE 1
#endif
typedef real vec __attribute__((vector_size(VECTOR_BYTES)));
typedef int{bits}_t mask __attribute__((vector_size(VECTOR_BYTES)));

static inline vec splat(real x) {{ return (vec){{0}} + x; }}

static inline vec blend(mask m, vec a, vec b) {{ return (vec)((m & (mask)a) | (~m & (mask)b)); }}

static inline vec lanes_powi(vec x, int n)
{{
  vec y = splat(1);
  for (int k = n < 0 ? -n : n; k > 0; k /= 2, x *= x)
    if (k % 2)
      y *= x;
  return n < 0 ? 1 / y : y;
}}

"""

# Three components of a node are a pair and one more: two loads for three numbers of a lane, where
# the compiler shuffles vectors (GCC from 12, Clang).
VECTORS = """
typedef stored pair __attribute__((vector_size(2 * sizeof(stored)), may_alias,
                                   aligned(sizeof(stored))));
typedef stored many __attribute__((vector_size(LANES * sizeof(stored))));
#define SHUFFLE __builtin_shufflevector
#define P(l) (*(const pair *)(from + 3 * dofs[l]))
static inline void gather3(vec *restrict to, const stored *restrict from,
                           const int32_t *restrict dofs)
{{
  const __auto_type low = {low};
  const __auto_type high = {high};
  const many z = {{ {thirds} }};
  to[0] = __builtin_convertvector(SHUFFLE(low, high, {even}), vec);
  to[1] = __builtin_convertvector(SHUFFLE(low, high, {odd}), vec);
  to[2] = __builtin_convertvector(z, vec);
}}
"""

LOOPS = """
/* to[k * bs + i] = from[bs * dofs[k] + i] for the n dofs of every lane */
static inline void gather(vec *restrict to, const stored *restrict from,
                          const int32_t *restrict dofs, int n, int bs)
{
#ifdef SHUFFLE
  if (bs == 3)
  {
    for (int k = 0; k < n; ++k)
      gather3(to + 3 * k, from, dofs + k * LANES);
    return;
  }
#endif
  for (int k = 0; k < n; ++k)
    for (int i = 0; i < bs; ++i)
    {
      vec v;
#pragma GCC unroll 16
      for (int l = 0; l < LANES; ++l)
        v[l] = from[bs * dofs[k * LANES + l] + i];
      to[k * bs + i] = v;
    }
}

/* to[bs * dofs[k] + i] += from[k * bs + i] for the n dofs of the first lanes: cells share nodes */
static inline void scatter(stored *restrict to, const vec *restrict from,
                           const int32_t *restrict dofs, int n, int bs, int lanes)
{
  for (int l = 0; l < lanes; ++l)
    for (int k = 0; k < n; ++k)
      for (int i = 0; i < bs; ++i)
        to[bs * dofs[k * LANES + l] + i] += from[k * bs + i][l];
}
"""

# Functions that every glibc has for whole vectors (libmvec); with fast-math incomplete, for NaN's
# sake, its header does not say so.
VECTOR_MATH = """
#if defined(__x86_64__) && defined(__GLIBC__) && defined(__GNUC__) && !defined(__clang__)
#pragma GCC diagnostic ignored "-Wattributes"
#define MVEC __attribute__((simd("notinbranch")))
extern real {sin}(real) MVEC;
extern real {cos}(real) MVEC;
extern real {exp}(real) MVEC;
extern real {ln}(real) MVEC;
extern real {power}(real, real) MVEC;
#endif
"""

UNARY = """
static inline vec lanes_{name}(vec x)
{{
  union {{ vec v; real l[LANES]; }} a = {{x}};
  for (int l = 0; l < LANES; ++l)
    a.l[l] = {function}(a.l[l]);
  return a.v;
}}
"""

# Not inlined: GCC would turn a power with a known exponent into cube roots, lane by lane.
BINARY = """
static __attribute__((noinline, noclone)) vec lanes_{name}(vec x, vec y)
{{
  union {{ vec v; real l[LANES]; }} a = {{x}}, b = {{y}};
  for (int l = 0; l < LANES; ++l)
    a.l[l] = {function}(a.l[l], b.l[l]);
  return a.v;
}}
"""

BESSEL = """
static inline vec lanes_{name}(int n, vec x)
{{
  for (int l = 0; l < LANES; ++l)
    x[l] = {function}(n, x[l]);
  return x;
}}
"""

TEMPLATES = {
    **dict.fromkeys(("power", "atan2", "atan_2", "min_value", "max_value"), BINARY),
    **dict.fromkeys(("bessel_j", "bessel_y"), BESSEL),
}


def generator(options: dict[str, Any]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return start and end of header and source: FFCx's own, then the lanes."""
    (header, source), post = scalar_file.generator(options)
    real = dtype_to_c_type(options["scalar_type"])
    bits = 64 if real == "double" else 32
    source += LANES.format(real=real, bits=bits)
    for number, width in enumerate((16, 32, 64)):
        source += f"\n#{'elif' if number else 'if'} VECTOR_BYTES == {width} && CAN_SHUFFLE"
        source += VECTORS.format(**_shuffles(8 * width // bits))
    source += "#endif\n" + LOOPS
    functions = math_table["float64" if real == "double" else "float32"]
    source += VECTOR_MATH.format(**functions)
    for name, function in {**functions, "atan2": functions["atan_2"]}.items():
        source += TEMPLATES.get(name, UNARY).format(name=name, function=function)
    return (header, source), post


def _shuffles(lanes: int) -> dict[str, str]:
    """Return the pieces of ``VECTORS`` for a number of lanes."""

    def joined(first: int, count: int) -> str:
        if count == 1:
            return f"P({first})"
        halves = (joined(first, count // 2), joined(first + count // 2, count // 2))
        return f"SHUFFLE({', '.join(halves)}, {_numbers(range(2 * count))})"

    half = lanes // 2
    return {
        "low": joined(0, half),
        "high": joined(half, half),
        "even": _numbers(range(0, 2 * lanes, 2)),
        "odd": _numbers(range(1, 2 * lanes, 2)),
        "thirds": ", ".join(f"from[3 * dofs[{lane}] + 2]" for lane in range(lanes)),
    }


def _numbers(numbers: Iterable[int]) -> str:
    return ", ".join(map(str, numbers))
