# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rank-1 UFL forms over hexahedra as native code over batches of cells."""

import hashlib
import os
import shlex
import subprocess
import sysconfig
from functools import cache
from pathlib import Path
from typing import Any

import dolfinx
import numpy as np
import numpy.typing as npt
from dolfinx import fem, jit

from forms.batches import by_lane, integral_cells

# With finite-math on, the compiler may assume that no NaN occurs; the guards rely on them.
FLAGS = ("-O3", "-march=native", "-ffast-math", "-fno-finite-math-only", "-w")
CTYPES = {"float64": "double", "float32": "float"}


class Unsupported(ValueError):
    """The form is beyond the native engine; DOLFINx can still assemble it."""


@cache
def host_macros() -> str:
    """Return what the C compiler predefines for this machine: its own version and the CPU."""
    compiler = shlex.split(os.environ.get("CC") or sysconfig.get_config_var("CC") or "cc")
    command = [*compiler, "-march=native", "-dM", "-E", "-x", "c", os.devnull]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def vector_bytes(macros: str) -> int:
    """Return the width of the widest vector registers [byte]."""
    for macro, width in (("__AVX512F__", 64), ("__AVX__", 32)):
        if f"#define {macro} " in macros:
            return width
    return 16


def compile_arguments(stored: str) -> list[str]:
    """Return the compiler's arguments; they name all that the code depends on beside the form."""
    macros = host_macros()
    sources = b"".join(p.read_bytes() for p in sorted((Path(__file__).parent / "simd").glob("*.py")))
    host = hashlib.sha1(macros.encode() + sources).hexdigest()[:16]
    return [
        *FLAGS,
        f"-DVECTOR_BYTES={vector_bytes(macros)}",
        f"-DSTORED={CTYPES[stored]}",
        f"-DSQUEALX_HOST=0x{host}",
    ]


class NativeKernel:
    def __init__(self, form: Any, dtype: npt.DTypeLike = np.float64) -> None:
        self.dtype = np.dtype(dtype)
        msh = form.ufl_domain().ufl_cargo()
        stored = np.dtype(msh.geometry.x.dtype)
        arguments = compile_arguments(stored.name)
        compiled, self._module, _ = jit.ffcx_jit(
            msh.comm,
            form,
            form_compiler_options={"scalar_type": self.dtype.name, "language": "forms.simd"},
            jit_options={"cffi_extra_compile_args": arguments, "cffi_libraries": ["m"], "timeout": 300},
        )
        self.coefficients = form.coefficients()
        lanes = vector_bytes(host_macros()) // self.dtype.itemsize
        ffi = self._module.ffi
        ids = [compiled.form_integral_ids[i] for i in range(compiled.form_integral_offsets[1])]
        (argument,) = form.arguments()
        self.calls = []
        keep = self._keep = []
        order = [compiled.original_coefficient_positions[i] for i in range(compiled.num_coefficients)]
        for i, cells in enumerate(integral_cells(form, ids)):
            addr = [len(cells)]
            def add(a):
                keep.append(a); addr.append(a.ctypes.data)
            add(msh.geometry.x)
            add(by_lane(msh.geometry.dofmaps[0], cells, lanes))
            add(by_lane(argument.ufl_function_space().dofmap.list, cells, lanes))
            for k in order:
                f = self.coefficients[k]
                add(f.x.array)
                add(by_lane(f.function_space.dofmap.list, cells, lanes))
            for c in form.constants():
                add(c.value)
            data = np.array(addr, dtype=np.int64)
            keep.append(data)
            self.calls.append((getattr(compiled.form_integrals[i], f"tabulate_tensor_{self.dtype.name}"), ffi.cast("void *", data.ctypes.data)))
        self.ffi = ffi
        self.real = f"{CTYPES[self.dtype.name]} *"

    def add(self, *arguments: Any) -> None:
        *values, out = arguments
        array = out.array if isinstance(out, dolfinx.la.Vector) else out
        p = self.ffi.cast(self.real, self.ffi.from_buffer(array))
        null = self.ffi.NULL
        for f, d in self.calls:
            f(p, null, null, null, null, null, d)
