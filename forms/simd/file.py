# SPDX-License-Identifier: LGPL-3.0-or-later
"""Head of the generated C file: lane types, lane functions, gather, scatter."""

from typing import Any

from ffcx.codegeneration.C import file as scalar_file
from ffcx.codegeneration.C.formatter import math_table
from ffcx.codegeneration.utils import dtype_to_c_type

from forms.simd import nodes

suffixes = scalar_file.suffixes

# VECTOR_BYTES, STORED (type of the arrays in memory) and STORED_BYTES come from the command line,
# see forms/simd/native.py. Padding lanes repeat a cell, so that they compute nothing unusual.
LANES = """
typedef {real} real;
typedef STORED stored;
#define LANES ((int)(VECTOR_BYTES / sizeof(real)))
#if defined(__clang__) || __GNUC__ >= 12
#define CAN_SHUFFLE 1
#endif
typedef real vec __attribute__((vector_size(VECTOR_BYTES)));
typedef real loose __attribute__((vector_size(VECTOR_BYTES), aligned(sizeof(real)), may_alias));
typedef int{bits}_t mask __attribute__((vector_size(VECTOR_BYTES)));

static inline vec splat(real x) {{ return (vec){{0}} + x; }}

static inline vec blend(mask m, vec a, vec b) {{ return (vec)((m & (mask)a) | (~m & (mask)b)); }}

/* whether a condition holds in any lane */
static inline int any(mask m)
{{
#if defined(__AVX512DQ__) && VECTOR_BYTES == 64
  typedef {word} words __attribute__((vector_size(VECTOR_BYTES)));
  return __builtin_ia32_cvt{letter}2mask512((words)m) != 0;
#endif
  int{bits}_t found = 0;
  for (int l = 0; l < LANES; ++l)
    found |= m[l];
  return found != 0;
}}

static inline void prefetch(const loose *from, int n)
{{
#pragma GCC unroll 64
  for (int k = 0; k < n; ++k)
    __builtin_prefetch(from + k, 1);
}}

static inline vec lanes_powi(vec x, int n)
{{
  vec y = splat(1);
  for (int k = n < 0 ? -n : n; k > 0; k /= 2, x *= x)
    if (k % 2)
      y *= x;
  return n < 0 ? 1 / y : y;
}}

"""

LOOPS = """
/* to[k * bs + i] = from[dofs[k] + i] for n dofs of every lane; less the first one if relative */
static inline void gather(vec *restrict to, const stored *restrict from,
                          const uint32_t *restrict dofs, int n, int bs, int wide, int relative)
{
#ifdef SHUFFLE
  if (bs == 3)
  {
    if (relative)
      (wide ? gather_wide_relative : gather_narrow_relative)(to, from, dofs, n);
    else
      (wide ? gather_wide : gather_narrow)(to, from, dofs, n);
    return;
  }
#endif
  for (int k = 0; k < n; ++k)
    for (int i = 0; i < bs; ++i)
    {
      vec v;
#pragma GCC unroll 16
      for (int l = 0; l < LANES; ++l)
        v[l] = from[dofs[k * LANES + l] + i] - (relative ? from[dofs[l] + i] : 0);
      to[k * bs + i] = v;
    }
}

/* to[dofs[k] + i] += from[k * bs + i] for the n dofs of the first lanes: cells share nodes */
static inline void scatter(stored *restrict to, const vec *restrict from,
                           const uint32_t *restrict dofs, int n, int bs, int lanes)
{
#ifdef SHUFFLE
  if (bs == 3 && lanes == LANES)
  {
    scatter3(to, from, dofs, n);
    return;
  }
#endif
  for (int l = 0; l < lanes; ++l)
    for (int k = 0; k < n; ++k)
      for (int i = 0; i < bs; ++i)
        to[dofs[k * LANES + l] + i] += from[k * bs + i][l];
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
    word, letter = ("long long", "q") if bits == 64 else ("int", "d")
    source += LANES.format(real=real, bits=bits, word=word, letter=letter)
    source += nodes.text(bits // 8) + LOOPS
    functions = math_table["float64" if real == "double" else "float32"]
    source += VECTOR_MATH.format(**functions)
    for name, function in {**functions, "atan2": functions["atan_2"]}.items():
        source += TEMPLATES.get(name, UNARY).format(name=name, function=function)
    return (header, source), post
