# SPDX-License-Identifier: LGPL-3.0-or-later
"""Native kernels of forms with history: values at quadrature points that each call may renew."""

from typing import Any

import numpy as np
import numpy.typing as npt

from forms.simd.batches import Indices, batches, batches_before_the_end, last_to_the_end
from forms.simd.native import (
    CTYPES,
    check,
    coefficient_order,
    compile_form,
    integrals,
    length,
)
from meshes.arrays import Array

CACHE_LINE = 64  # byte


class History:
    """Values at the quadrature points of some cells, laid out in the batches of a kernel.

    Attributes:
        coefficient: The UFL coefficient that stands for them in forms, ``(size,)`` at a point.
        cells: This rank's cells that have them, in the order of the batches, shape ``(n,)``.
        points: Quadrature points of a cell.
        size: Numbers at a point.
    """

    def __init__(self, coefficient: Any, points: int, size: int) -> None:
        self.coefficient, self.points, self.size = coefficient, points, size
        self.cells: Indices = np.empty(0, dtype=np.int32)
        self.table: npt.NDArray[Any] = np.empty((0, points * size, 1))

    def lay_out(self, cells: Indices, lanes: int, dtype: npt.DTypeLike, initial: Array) -> None:
        """Make the table for the cells of a kernel, the same initial values everywhere."""
        self.cells = cells
        shape = (-(-len(cells) // lanes), self.points * self.size, lanes)
        self.table = _aligned(shape, np.dtype(dtype))
        self.table[:] = np.tile(initial, self.points)[:, None]

    def values(self) -> npt.NDArray[Any]:
        """Return the values of :attr:`cells`, a copy of shape ``(n, points, size)``."""
        by_cell = self.table.transpose(0, 2, 1).reshape(-1, self.points, self.size)
        return by_cell[: len(self.cells)].copy()

    def set(self, values: npt.NDArray[Any]) -> None:
        """Set the values of :attr:`cells`, shape ``(n, points, size)``."""
        lanes = self.table.shape[2]
        missing = -len(self.cells) % lanes
        padded = np.concatenate([values, values[-1:].repeat(missing, axis=0)])
        by_lane = padded.reshape(-1, lanes, self.points * self.size)
        self.table[:] = by_lane.transpose(0, 2, 1)


class MemoryKernel:
    """A rank-1 form with history, compiled for this machine and applied in place.

    The test function is that of the space of the result or, where history is renewed, of a mixed
    element of that and the element of the history: what the form multiplies the second part by,
    times :func:`forms.cells.per_point`, is the new history of the point. One pass over the cells
    reads the history, adds the result, and writes the history where it stood.

    Args:
        form: Cell integrals with one set of cells; its coefficients are DOLFINx functions and the
            history.
        space: DOLFINx space of the result.
        history: The history; the first kernel lays it out, later ones have the same cells.
        initial: Initial values at a point, shape ``(size,)``; given to the first kernel only.
        dtype: Type that is computed with, and that of the history.

    Raises:
        CompilerError: if it cannot be compiled on this machine.
        Unsupported: for other cells than hexahedra.
    """

    def __init__(
        self,
        form: Any,
        space: Any,
        history: History,
        initial: Array | None = None,
        dtype: npt.DTypeLike = np.float64,
    ) -> None:
        real = np.dtype(dtype)
        check(form, real, spaces=[space], history=history.coefficient)
        compiled, self._module, lanes = compile_form(form, real, history=True)
        ((self._function, cells),) = integrals(form, compiled, real)
        self._size = space.dofmap.bs * length(space)
        self._stored = np.dtype(form.ufl_domain().ufl_cargo().geometry.x.dtype)
        self._real = f"{CTYPES[real.name]} *"
        self._used = [form.coefficients()[k] for k in coefficient_order(compiled)]
        self._history = history
        tables = self._tables(form, space)
        ends = [(dofmap, number) for dofmap, _, number in tables]
        if initial is not None:
            cells, wide = last_to_the_end(ends, cells, lanes)
            history.lay_out(cells, lanes, real, initial)
        elif not np.array_equal(np.sort(history.cells), np.sort(cells)):
            raise ValueError("history: expected the cells of the kernel that laid it out")
        else:
            wide = batches_before_the_end(ends, history.cells, lanes)
        dofs = batches([(d, size) for d, size, _ in tables], history.cells, lanes)
        self._keep: list[Any] = []  # what the addresses point to
        self._data = self._addresses(form, dofs, wide)

    def add(self, out: Array, *, renew: bool = False) -> None:
        """Add this rank's cells to ``out``, shape ``(n_local * bs,)``; renew the history if asked.

        Raises:
            ValueError: if the type or size of ``out`` is wrong.
        """
        if out.dtype != self._stored or out.shape != (self._size,):
            raise ValueError(
                f"out: expected {self._stored} ({self._size},), got {out.dtype} {out.shape}"
            )
        if not len(self._history.cells):
            return
        if self._at is not None:
            self._data[self._at] = self._history.table.ctypes.data
        self._data[-1] = renew
        ffi, null = self._module.ffi, self._module.ffi.NULL
        address = ffi.cast(self._real, ffi.from_buffer(out, require_writable=True))
        data = ffi.cast("void *", self._data.ctypes.data)
        self._function(address, null, null, null, null, null, data)

    def _tables(self, form: Any, space: Any) -> list[tuple[Any, int, int]]:
        """Return dofs by cell, block size and number of dofs of all arrays but the history."""
        geometry = form.ufl_domain().ufl_cargo().geometry
        given = [f for f in self._used if f is not self._history.coefficient]
        spaces = [space, *(f.function_space for f in given)]
        tables = [(geometry.dofmaps[0], 3, len(geometry.x))]
        return tables + [(V.dofmap.list, V.dofmap.bs, length(V)) for V in spaces]

    def _addresses(self, form: Any, dofs: list[Any], wide: int) -> npt.NDArray[np.int64]:
        """Return the addresses as C takes them (forms/simd/integral)."""
        x, own = form.ufl_domain().ufl_cargo().geometry.x, iter(dofs[2:])
        arrays: list[Any] = [x, dofs[0], dofs[1]]
        self._at: int | None = None  # where the address of the history stands
        for f in self._used:
            if f is self._history.coefficient:
                self._at = 2 + len(arrays)
                arrays += [None, None]
            else:
                arrays += [f.x.array, next(own)]
        arrays += [constant.value for constant in form.constants()]
        self._keep += arrays
        addresses = [0 if a is None else a.ctypes.data for a in arrays]
        return np.array([len(self._history.cells), wide, *addresses, 0], dtype=np.int64)


def _aligned(shape: tuple[int, ...], dtype: np.dtype[Any]) -> npt.NDArray[Any]:
    """Return an array that begins on a cache line, so that vector loads do not cross two."""
    count = int(np.prod(shape))
    spare = CACHE_LINE // dtype.itemsize
    raw = np.empty(count + spare, dtype=dtype)
    start = -raw.ctypes.data % CACHE_LINE // dtype.itemsize
    return raw[start : start + count].reshape(shape)
