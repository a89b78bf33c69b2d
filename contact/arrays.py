# SPDX-License-Identifier: LGPL-3.0-or-later
"""Arrays and structs of the kernel as checked views without copies, and the arrays of a model."""

from typing import Any, Protocol
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from contact._kernel import ffi
from meshes.arrays import Array

Index32 = npt.NDArray[np.int32]  # nodes and facets of the kernel

_C_TYPES = {
    np.dtype(np.float64): "double[]",
    np.dtype(np.int32): "int32_t[]",
    np.dtype(np.int64): "int64_t[]",
    np.dtype(np.uint8): "uint8_t[]",
}
_ALIVE: WeakKeyDictionary[Any, tuple[Any, ...]] = WeakKeyDictionary()


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


def struct(kind: str, /, **members: Any) -> Any:
    """Return a struct for the kernel; it keeps its arrays alive.

    Args:
        kind: Its name in ``kernel.h``.
        members: Arrays of the element type told there, numbers and other structs; what is left
            out is zero or NULL.

    Raises:
        TypeError: if an array has another element type.
    """
    filled = ffi.new(f"{kind} *")
    for name, value in members.items():
        is_array = isinstance(value, np.ndarray)
        setattr(filled, name, view(name, value, value.shape, value.dtype) if is_array else value)
    _ALIVE[filled] = tuple(members.values())
    return filled


class Vector(Protocol):
    """A flat local array, block size 3: owned dofs first, then ghosts."""

    @property
    def array(self) -> Array: ...  # noqa: D102


class Field(Protocol):
    """A finite-element function."""

    @property
    def x(self) -> Vector: ...  # noqa: D102


class State(Protocol):
    """What a contact reads of the state of a model.

    Displacement ``u`` at t, velocity ``v`` at t - dt/2, time ``t``.
    """

    @property
    def u(self) -> Field: ...  # noqa: D102
    @property
    def v(self) -> Field: ...  # noqa: D102
    @property
    def t(self) -> float: ...  # noqa: D102
