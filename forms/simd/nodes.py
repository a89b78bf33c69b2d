# SPDX-License-Identifier: LGPL-3.0-or-later
"""C text of gather and scatter of the three components of nodes, lane by lane, with shuffles.

A *block* is what a register holds of the numbers in memory: as many lanes as the kernel has, or
half of them where it computes in single precision. It is subtracted and converted here.
"""

from collections.abc import Iterable
from itertools import product
from string import Template

# Wide loads read four numbers of a lane at once and drop the fourth, the next node's first; the
# batches that hold the last node of an array are loaded narrow: a pair and one more.
# Not inlined: inside the kernel GCC would keep their addresses in vector registers.
NODES = """
#define SHUFFLE __builtin_shufflevector
#define BLOCK $block
typedef stored block __attribute__((vector_size(BLOCK * sizeof(stored))));
typedef real part __attribute__((vector_size(BLOCK * sizeof(real))));
typedef union { vec whole; part parts[LANES / BLOCK]; } joined;
typedef stored pair __attribute__((vector_size(2 * sizeof(stored)), may_alias,
                                   aligned(sizeof(stored))));
typedef stored quad __attribute__((vector_size(4 * sizeof(stored)), may_alias,
                                   aligned(sizeof(stored))));
typedef struct { block c[3]; } node;
#define P(l) (*(const pair *)(from + dofs[l]))
#define Q(l) (*(const quad *)(from + dofs[l]))
#define TWO(a, b) SHUFFLE(Q(a), Q(b), 0, 1, 2, 3, 4, 5, 6, 7)

static inline node load_narrow(const stored *restrict from, const uint32_t *restrict dofs)
{
  const __auto_type low = $low;
  const __auto_type high = $high;
  const block z = { $thirds };
  return (node){{ SHUFFLE(low, high, $even), SHUFFLE(low, high, $odd), z }};
}

static inline node load_wide(const stored *restrict from, const uint32_t *restrict dofs)
{
$wide
}

static inline __attribute__((always_inline)) void
gather3(vec *restrict to, const stored *restrict from, const uint32_t *restrict dofs, int64_t n,
        const int wide, const int relative)
{
  node first[LANES / BLOCK];
  for (int j = 0; relative && j < LANES / BLOCK; ++j)
    first[j] = load_narrow(from, dofs + j * BLOCK);
  for (int64_t k = 0; k < n; ++k)
  {
    part parts[3][LANES / BLOCK];
    for (int j = 0; j < LANES / BLOCK; ++j)
    {
      const uint32_t *own = dofs + k * LANES + j * BLOCK;
      const node p = wide ? load_wide(from, own) : load_narrow(from, own);
      for (int i = 0; i < 3; ++i)
        parts[i][j] = __builtin_convertvector(relative ? p.c[i] - first[j].c[i] : p.c[i], part);
    }
    for (int i = 0; i < 3; ++i)
      to[3 * k + i] = $join;
  }
}

#define GATHER(name, wide, relative)                                                              \\
  static __attribute__((noinline)) void name(vec *restrict to, const stored *restrict from,       \\
                                             const uint32_t *restrict dofs, int64_t n)            \\
  {                                                                                               \\
    gather3(to, from, dofs, n, wide, relative);                                                   \\
  }
GATHER(gather_wide, 1, 0)
GATHER(gather_narrow, 0, 0)
GATHER(gather_wide_relative, 1, 1)
GATHER(gather_narrow_relative, 0, 1)

/* to[dofs[k] + i] += from[k * 3 + i] for the n nodes of all lanes: a pair and one more */
static __attribute__((noinline)) void
scatter3(stored *restrict to, const vec *restrict from, const uint32_t *restrict dofs, int64_t n)
{
  for (int64_t k = 0; k < n; ++k)
    for (int j = 0; j < LANES / BLOCK; ++j)
    {
      block c[3];
      for (int i = 0; i < 3; ++i)
        c[i] = __builtin_convertvector(((joined){ from[3 * k + i] }).parts[j], block);
      union { block all; pair lane[BLOCK / 2]; } even = { SHUFFLE(c[0], c[1], $lower) },
                                                 odd = { SHUFFLE(c[0], c[1], $upper) };
      union { block all; stored lane[BLOCK]; } third = { c[2] };
      const uint32_t *own = dofs + k * LANES + j * BLOCK;
#pragma GCC unroll 16
      for (int l = 0; l < BLOCK; ++l)
      {
        stored *at = to + own[l];
        *(pair *)at += (l % 2 ? odd : even).lane[l / 2];
        at[2] += third.lane[l];
      }
    }
}
"""

WIDE = {
    4: """  const block xz = SHUFFLE(Q(0), Q(1), 0, 4, 2, 6), y = SHUFFLE(Q(0), Q(1), 1, 5, 3, 7);
  const block XZ = SHUFFLE(Q(2), Q(3), 0, 4, 2, 6), Y = SHUFFLE(Q(2), Q(3), 1, 5, 3, 7);
  return (node){{ SHUFFLE(xz, XZ, 0, 1, 4, 5), SHUFFLE(y, Y, 0, 1, 4, 5),
                  SHUFFLE(xz, XZ, 2, 3, 6, 7) }};""",
    8: """  const block a = TWO(0, 2), b = TWO(1, 3), c = TWO(4, 6), d = TWO(5, 7);
  const block xz = SHUFFLE(a, b, 0, 8, 2, 10, 4, 12, 6, 14);
  const block XZ = SHUFFLE(c, d, 0, 8, 2, 10, 4, 12, 6, 14);
  const block y = SHUFFLE(a, b, 1, 9, 3, 11, 5, 13, 7, 15);
  const block Y = SHUFFLE(c, d, 1, 9, 3, 11, 5, 13, 7, 15);
  return (node){{ SHUFFLE(xz, XZ, 0, 1, 4, 5, 8, 9, 12, 13),
                  SHUFFLE(y, Y, 0, 1, 4, 5, 8, 9, 12, 13),
                  SHUFFLE(xz, XZ, 2, 3, 6, 7, 10, 11, 14, 15) }};""",
}


def text(real_bytes: int) -> str:
    """Return the C text for every width of registers and type in memory, one of them compiled.

    Args:
        real_bytes: Size of the type that is computed with.
    """
    lines, word = [], "if"
    for width, stored_bytes in product((16, 32, 64), (8, 4)):
        block, lanes = width // stored_bytes, width // real_bytes
        if block > lanes:  # computes in double precision what is stored in single
            continue
        lines.append(
            f"#{word} VECTOR_BYTES == {width} && STORED_BYTES == {stored_bytes} && CAN_SHUFFLE"
        )
        lines.append(Template(NODES).substitute(_pieces(block, lanes)))
        word = "elif"
    return "\n".join([*lines, "#endif\n"])


def _pieces(block: int, lanes: int) -> dict[str, object]:
    """Return the pieces of ``NODES`` for a number of lanes and those of them in a block."""

    def joined(first: int, count: int) -> str:
        if count == 1:
            return f"P({first})"
        halves = (joined(first, count // 2), joined(first + count // 2, count // 2))
        return f"SHUFFLE({', '.join(halves)}, {_numbers(range(2 * count))})"

    half = block // 2
    both = f"SHUFFLE(parts[i][0], parts[i][1], {_numbers(range(lanes))})"
    return {
        "block": block,
        "low": joined(0, half),
        "high": joined(half, half),
        "even": _numbers(range(0, 2 * block, 2)),
        "odd": _numbers(range(1, 2 * block, 2)),
        "thirds": ", ".join(f"from[dofs[{lane}] + 2]" for lane in range(block)),
        "wide": WIDE.get(block, "  return load_narrow(from, dofs);"),
        "join": "parts[i][0]" if block == lanes else both,
        "lower": _numbers(i for k in range(0, block, 2) for i in (k, block + k)),
        "upper": _numbers(i for k in range(1, block, 2) for i in (k, block + k)),
    }


def _numbers(numbers: Iterable[int]) -> str:
    return ", ".join(map(str, numbers))
