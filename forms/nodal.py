# SPDX-License-Identifier: LGPL-3.0-or-later
"""Arrays of nodes as the passes of ``forms/native/nodal.h`` take them, without copies."""

from typing import Any

import numpy as np
import numpy.typing as npt

from forms._nodal import ffi, lib

__all__ = ["lib", "pointer", "struct"]

# by the types themselves: their names take as long as a pass over a thousand nodes
_TYPES = {np.dtype(t): c for t, c in [("f8", "double[]"), ("i4", "int32_t[]"), ("u1", "uint8_t[]")]}


def pointer(a: npt.NDArray[Any]) -> Any:
    """Return the memory of a C-contiguous array; it keeps the array alive.

    Raises:
        TypeError: if its type is none of float64, int32 and uint8.
    """
    kind = _TYPES.get(a.dtype)
    if kind is None or not a.flags.c_contiguous:
        raise TypeError(f"array: expected float64, int32 or uint8 in C order, got {a.dtype}")
    return ffi.from_buffer(kind, a)


def struct(kind: str, /, **members: Any) -> Any:
    """Return a struct of nodal.h with these members; keep it as long as its arrays are used.

    Args:
        kind: Its name.
        members: Numbers and arrays, which the caller keeps alive.
    """
    made = ffi.new(f"{kind} *")
    for name, value in members.items():
        setattr(made, name, pointer(value) if isinstance(value, np.ndarray) else value)
    return made
