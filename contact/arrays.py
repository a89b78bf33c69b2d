# SPDX-License-Identifier: LGPL-3.0-or-later
"""The border between NumPy and the kernel: checked views of arrays, without copies."""

from typing import Any

import numpy as np
import numpy.typing as npt

from contact._kernel import ffi

_C_TYPES = {
    np.dtype(np.float64): "double[]",
    np.dtype(np.int32): "int32_t[]",
    np.dtype(np.int64): "int64_t[]",
    np.dtype(np.uint8): "uint8_t[]",
}


def view(
    name: str,
    a: npt.NDArray[Any],
    shape: tuple[int, ...],
    dtype: npt.DTypeLike = np.float64,
    *,
    out: bool = False,
) -> Any:
    """Return the memory of ``a`` for the kernel; it keeps ``a`` alive.

    Args:
        name: Name of the array for the error message.
        a: C-contiguous array.
        shape: Expected shape; -1 accepts any length.
        dtype: Expected element type.
        out: The kernel writes to it.

    Raises:
        ValueError: if the type, shape or memory order is another one, or an output is read-only.
    """
    fits = a.ndim == len(shape) and all(
        want in (-1, got) for want, got in zip(shape, a.shape, strict=False)
    )
    if a.dtype != dtype or not fits:
        raise ValueError(f"{name}: expected {np.dtype(dtype)} {shape}, got {a.dtype} {a.shape}")
    if not a.flags.c_contiguous:
        raise ValueError(f"{name}: expected C order, got strides {a.strides}")
    if out and not a.flags.writeable:
        raise ValueError(f"{name}: expected a writeable array, got a read-only one")
    return ffi.from_buffer(_C_TYPES[a.dtype], a, require_writable=out)
