# SPDX-License-Identifier: LGPL-3.0-or-later
"""Native kernels of rank-1 UFL forms over hexahedra, several cells at once."""

import hashlib
import os
import re
import shlex
import subprocess
import sysconfig
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import dolfinx
import numpy as np
import numpy.typing as npt
from dolfinx import fem, jit

from forms.simd.batches import Indices, batches, integral_cells, last_to_the_end
from forms.simd.cache import NEEDED, CompilerError, compiling

# Fast-math, but NaN and infinity keep their meaning: the guards look for them.
FLAGS = ("-O3", "-march=native", "-ffast-math", "-fno-finite-math-only", "-w")
GCC_FLAGS = ("-fschedule-insns", "-fsched-pressure")  # 4 % on long straight-line code
# A root of all lanes in one instruction: two halves that meet again in memory cost 20 cycles more.
WIDE = "-mprefer-vector-width=512"
CTYPES = {"float64": "double", "float32": "float"}
TIMEOUT = 120  # for another process that compiles the same form [s]


class Unsupported(ValueError):
    """The form is beyond the native engine, but DOLFINx may assemble it."""


@dataclass(frozen=True)
class Host:
    """What generated code depends on beside the form: one per run, that of rank 0.

    Attributes:
        vector_bytes: Width of the widest vector registers [byte].
        gcc: Whether the compiler is GCC rather than Clang.
        tune: CPU whose timings the compiler is told to assume, or none.
        key: Hash of compiler, CPU and the code generator.
    """

    vector_bytes: int
    gcc: bool
    tune: str
    key: str

    def flags(self, stored: str) -> list[str]:
        """Return the compiler's arguments for arrays of type ``stored``."""
        defines = {
            "VECTOR_BYTES": self.vector_bytes,
            "STORED": CTYPES[stored],
            "STORED_BYTES": np.dtype(stored).itemsize,
            "SQUEALX_HOST": f"0x{self.key}",  # read by nobody: FFCx's cache goes by the arguments
        }
        flags = [*FLAGS, *(GCC_FLAGS if self.gcc else ()), *([self.tune] if self.tune else [])]
        flags += [WIDE] if self.vector_bytes == 64 else []
        return [*flags, *(f"-D{name}={value}" for name, value in defines.items())]


@cache
def this_host() -> Host:
    """Return this machine as the C compiler sees it with ``-march=native``.

    Raises:
        CompilerError: if there is no compiler, or it does not work.
    """
    compiler = shlex.split(os.environ.get("CC") or sysconfig.get_config_var("CC") or "cc")
    command = [*compiler, "-march=native", "-dM", "-E", "-x", "c", os.devnull]
    try:
        macros = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    except OSError as error:
        raise CompilerError(f"{compiler[0]!r}: {error.strerror}; {NEEDED}") from error
    except subprocess.CalledProcessError as error:
        said = error.stderr.strip().splitlines()[-1:]
        raise CompilerError(
            f"{shlex.join(command)} ends with exit code {error.returncode} {said}; {NEEDED}"
        ) from error
    widths = {"__AVX512F__": 64, "__AVX__": 32}
    width = next((w for m, w in widths.items() if f"#define {m} " in macros), 16)
    sources = sorted(Path(__file__).parent.glob("*.py"))
    state = macros.encode() + b"".join(path.read_bytes() for path in sources)
    gcc = "__clang__" not in macros
    # A GCC that is older than the CPU assumes one without these registers: 5 % slower.
    older = gcc and width == 64 and re.search("__tune_znver[123]__|__tune_haswell__", macros)
    generic = gcc and width == 64 and "__tune_" not in macros
    tune = "-mtune=skylake-avx512" if older or generic else ""
    return Host(width, gcc, tune, hashlib.sha256(state).hexdigest()[:16])


def host_of(comm: Any) -> Host:
    """Return the machine of rank 0; collective.

    Raises:
        CompilerError: on all ranks, if its compiler does not work.
    """
    found: Host | CompilerError | None = None
    if comm.rank == 0:
        try:
            found = this_host()
        except CompilerError as error:
            found = error
    found = comm.bcast(found, root=0)
    if isinstance(found, CompilerError):
        raise found
    return found


class NativeKernel:
    """A rank-1 UFL form over hexahedra, compiled for this machine and applied in place.

    ``NativeKernel(form).add(out)`` adds the form evaluated with the present values of its
    coefficients and constants; ``add(u, v, out)`` first takes the given values in the order of
    ``form.coefficients()``. Coordinates, coefficients and ``out`` are read and written where they
    are; what is stored beside them is the dofs of the cells in batches, 32 bytes per cell for each
    P1 space. Compiled code is kept in DOLFINx's cache folder; construction is collective.

    Args:
        form: Sum of cell integrals with any tags and quadrature degrees.
        dtype: Type that is computed with, float64 or float32; arrays keep the type of the mesh.
            float32 takes coordinates, and coefficients of which the form has only derivatives,
            less their values at the first node of the cell, subtracted in the type of the mesh.
            Cells of 1 mm with strains of 1e-4, also 5 m from the origin and displaced by 0.2 m:
            error 2e-7 of the largest entry (3e-4 and 1e-1 if the values themselves were rounded).
            A rotation is part of the gradient, whose round-off of 1e-7 then is an error of strain:
            1e-3 of that largest entry at 1.2 rad.

    Raises:
        CompilerError: if it cannot be compiled on this machine.
        Unsupported: if the form is not rank 1, has other than cell integrals, or other cells than
            hexahedra, or a space whose dofs depend on the orientation of the cell.
    """

    reason: str | None = None  # as AssembledKernel has it: nothing was refused

    def __init__(self, form: Any, dtype: npt.DTypeLike = np.float64) -> None:
        check(form, np.dtype(dtype))
        self.coefficients = form.coefficients()
        msh = form.ufl_domain().ufl_cargo()
        self._stored = np.dtype(msh.geometry.x.dtype)
        compiled, self._module, lanes = compile_form(form, np.dtype(dtype))
        (argument,) = form.arguments()
        V = argument.ufl_function_space()
        self._size = V.dofmap.bs * length(V)
        self._values = [f.x.array for f in self.coefficients]
        self._real = f"{CTYPES[np.dtype(dtype).name]} *"
        self._keep: list[Any] = []  # what the addresses point to
        order = coefficient_order(compiled)
        self._calls = [
            (function, self._addresses(form, order, cells, lanes))
            for function, cells in integrals(form, compiled, np.dtype(dtype))
        ]

    def add(self, *arguments: Any) -> None:
        """Add this rank's cells to the last argument, the local array ``(n_local * bs,)``.

        Ghost entries hold this rank's share only: the caller reverse-scatters once for all forces.

        Args:
            arguments: Optional coefficient values (functions or local arrays) followed by ``out``,
                a local array or a ``dolfinx.la.Vector``.

        Raises:
            ValueError: if the number of values or the type or size of ``out`` is wrong.
        """
        *values, out = arguments
        if values:
            self._take(values)
        array = out.array if isinstance(out, dolfinx.la.Vector) else out
        if array.dtype != self._stored or array.shape != (self._size,):
            raise ValueError(
                f"out: expected {self._stored} ({self._size},), got {array.dtype} {array.shape}"
            )
        ffi, null = self._module.ffi, self._module.ffi.NULL
        address = ffi.cast(self._real, ffi.from_buffer(array, require_writable=True))
        for function, data in self._calls:
            function(address, null, null, null, null, null, data)

    def _take(self, values: list[Any]) -> None:
        """Copy the given values into the coefficients, unless they are the same memory."""
        if len(values) != len(self._values):
            raise ValueError(
                f"coefficients: expected none or {len(self._values)}, got {len(values)}"
            )
        for own, value in zip(self._values, values, strict=True):
            given = np.asarray(value.x.array if isinstance(value, fem.Function) else value)
            if given.ctypes.data != own.ctypes.data:
                own[:] = given

    def _addresses(self, form: Any, order: list[int], cells: Any, lanes: int) -> Any:
        """Return the addresses of one integral as C takes them."""
        geometry = form.ufl_domain().ufl_cargo().geometry
        (argument,) = form.arguments()
        spaces = [argument.ufl_function_space()]
        spaces += [self.coefficients[k].function_space for k in order]
        dofmaps = [geometry.dofmaps[0], *(V.dofmap.list for V in spaces)]
        sizes = [3, *(V.dofmap.bs for V in spaces)]
        lengths = [len(geometry.x), *(length(V) for V in spaces)]
        cells, wide = last_to_the_end(list(zip(dofmaps, lengths, strict=True)), cells, lanes)
        dofs = batches(list(zip(dofmaps, sizes, strict=True)), cells, lanes)
        arrays = [geometry.x, dofs[0], dofs[1]]
        for k, own in zip(order, dofs[2:], strict=True):
            arrays += [self._values[k], own]
        arrays += [constant.value for constant in form.constants()]
        data = np.array([len(cells), wide, *(a.ctypes.data for a in arrays)], dtype=np.int64)
        self._keep += [*arrays, data]
        return self._module.ffi.cast("void *", data.ctypes.data)


def compile_form(form: Any, dtype: np.dtype[Any], *, history: bool = False) -> tuple[Any, Any, int]:
    """Return a form compiled for this machine, its module, and the number of lanes; collective.

    Args:
        form: UFL form of cell integrals.
        dtype: Type that is computed with.
        history: Coefficients at quadrature points are history (:mod:`forms.simd.memory`).

    Raises:
        CompilerError: if it cannot be compiled on this machine.
    """
    msh = form.ufl_domain().ufl_cargo()
    host = host_of(msh.comm)
    options: dict[str, Any] = {"scalar_type": dtype.name, "language": "forms.simd"}
    if history:
        options["history"] = True
    arguments = {
        "cffi_extra_compile_args": host.flags(np.dtype(msh.geometry.x.dtype).name),
        "cffi_libraries": ["m"],
        "timeout": TIMEOUT,
    }
    with compiling(msh.comm, form, f"{options}{arguments}", TIMEOUT) as folder:
        compiled, module, _ = jit.ffcx_jit(
            msh.comm,
            form,
            form_compiler_options=options,
            jit_options={**arguments, "cache_dir": folder},
        )
    return compiled, module, host.vector_bytes // dtype.itemsize


def integrals(form: Any, compiled: Any, dtype: np.dtype[Any]) -> list[tuple[Any, Indices]]:
    """Return each compiled integral of a form with this rank's cells of it."""
    name = f"tabulate_tensor_{dtype}"
    found = [compiled.form_integrals[i] for i in range(compiled.form_integral_offsets[1])]
    ids = [compiled.form_integral_ids[i] for i in range(len(found))]
    cells: dict[Any, list[Any]] = {}  # dx((1, 2)) is one integral with two ids
    for integral, own in zip(found, integral_cells(form, ids), strict=True):
        cells.setdefault(getattr(integral, name), []).append(own)
    return [(function, np.concatenate(parts)) for function, parts in cells.items()]


def coefficient_order(compiled: Any) -> list[int]:
    """Return the place in ``form.coefficients()`` of each coefficient of the compiled form."""
    positions = compiled.original_coefficient_positions
    return [positions[i] for i in range(compiled.num_coefficients)]


def length(V: Any) -> int:
    """Return the number of dofs, each of block size, in an array of this rank."""
    return int(V.dofmap.index_map.size_local + V.dofmap.index_map.num_ghosts)


def check(
    form: Any, dtype: np.dtype[Any], *, spaces: list[Any] | None = None, history: Any = None
) -> None:
    """Raise ``Unsupported`` for what the generated code does not cover.

    Args:
        form: UFL form.
        dtype: Type that is computed with.
        spaces: DOLFINx spaces of the result; that of the test function if left out.
        history: Coefficient of the history, if there is one.
    """
    arguments = form.arguments()
    if len(arguments) != 1:
        raise Unsupported(f"form: expected rank 1 (one test function), got rank {len(arguments)}")
    kinds = {integral.integral_type() for integral in form.integrals()}
    if kinds != {"cell"}:
        raise Unsupported(f"form: expected cell integrals only, got {sorted(kinds)}")
    if dtype.name not in CTYPES:
        raise Unsupported(f"dtype: expected float64 or float32, got {dtype}")
    domains = {integral.ufl_domain() for integral in form.integrals()}
    cell = ", ".join(sorted({domain.ufl_cell().cellname for domain in domains}))
    if len(domains) > 1 or cell != "hexahedron":
        raise Unsupported(f"form: expected one mesh of hexahedra, got {len(domains)} of {cell}")
    msh = domains.pop().ufl_cargo()
    for constant in form.constants():
        if constant.value.dtype != msh.geometry.x.dtype:
            raise Unsupported(f"constant: expected the mesh's type, got {constant.value.dtype}")
    given = [f for f in form.coefficients() if f is not history]
    for f in given:
        if not isinstance(f, fem.Function) or f.x.array.dtype != msh.geometry.x.dtype:
            raise Unsupported(f"coefficient: expected a Function of the mesh's type, got {f!r}")
    results = [a.ufl_function_space() for a in arguments] if spaces is None else spaces
    for V in [*results, *(f.ufl_function_space() for f in given)]:
        if V.mesh._cpp_object is not msh or V.element.needs_dof_transformations:
            raise Unsupported(f"space: expected the form's mesh and plain dofs, got {V!r}")
