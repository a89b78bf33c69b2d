# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled cell kernels: the one place where a UFL one-form becomes native code and is applied."""

import logging
from typing import Any

from mpi4py import MPI  # noqa: F401  (before dolfinx, which is linked with its library)

import dolfinx
import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem

from forms.simd.cache import compiling
from forms.simd.native import TIMEOUT, NativeKernel, Unsupported

Array = npt.NDArray[np.float64]

# FFCx's default flags run these kernels five times slower. Fast-math still propagates a NaN through
# sums and products; the guard that looks for it is compiled without (tests/forms/test_kernel.py).
JIT_OPTIONS = {
    "cffi_extra_compile_args": ["-O3", "-march=native", "-ffast-math"],
    "cffi_libraries": ["m"],
}


def compiled(form: Any) -> Any:
    """Return a form that DOLFINx assembles, compiled with host flags; collective."""
    with compiling(form.ufl_domain().ufl_cargo().comm, form, str(JIT_OPTIONS), TIMEOUT) as folder:
        options = {**JIT_OPTIONS, "cache_dir": folder, "timeout": TIMEOUT}
        return fem.form(form, jit_options=options)


class CellKernel:
    """A rank-1 UFL form over hexahedra, compiled with host flags and applied in place.

    ``CellKernel(form).add(out)`` adds the form evaluated with its own coefficients;
    ``add(u, v, out)`` first takes the given values in the order of ``form.coefficients()``.
    The engine computes several cells at once; what it does not cover is assembled by DOLFINx, and
    the log (logger ``squealx``) and ``engine.reason`` say why.

    Args:
        form: Sum of cell integrals, linear in one test function.
        precision: Type that is computed with, ``float64`` or ``float32``; arrays keep their type.

    Raises:
        ValueError: if the form is not rank 1 or has other than cell integrals.
    """

    def __init__(self, form: Any, precision: str = "float64") -> None:
        arguments = form.arguments()
        if len(arguments) != 1:
            raise ValueError(
                f"form: expected rank 1 (one test function), got rank {len(arguments)}"
            )
        kinds = {integral.integral_type() for integral in form.integrals()}
        if kinds != {"cell"}:
            raise ValueError(f"form: expected cell integrals only, got {sorted(kinds)}")
        self.coefficients = form.coefficients()
        self.engine: NativeKernel | AssembledKernel
        try:
            self.engine = NativeKernel(form, precision)
        except Unsupported as reason:
            logging.getLogger("squealx").info("assembled by DOLFINx: %s", reason)
            self.engine = AssembledKernel(form, str(reason))

    def add(self, *arguments: Any) -> None:
        """Add this rank's cells to the last argument, the local array ``(n_local * bs,)``.

        Ghost entries hold this rank's share only: the caller reverse-scatters once for all forces.

        Args:
            arguments: Optional coefficient values (functions or local arrays) followed by ``out``,
                a local array or a ``dolfinx.la.Vector``.
        """
        self.engine.add(*arguments)


class AssembledKernel:
    """The same by DOLFINx assembly, cell after cell, for any form that DOLFINx takes.

    Attributes:
        reason: Why the form is not computed by :class:`forms.simd.native.NativeKernel`.
    """

    def __init__(self, form: Any, reason: str | None = None) -> None:
        self.reason = reason
        self.coefficients = form.coefficients()
        self.compiled = compiled(form)
        self.constants: Any = fem.pack_constants(self.compiled)

    def add(self, *arguments: Any) -> None:
        """Add this rank's cells to the last argument, as ``CellKernel.add``."""
        *values, out = arguments
        if values and len(values) != len(self.coefficients):
            raise ValueError(
                f"coefficients: expected none or {len(self.coefficients)}, got {len(values)}"
            )
        for own, value in zip(self.coefficients, values, strict=False):
            given = value.x.array if isinstance(value, fem.Function) else value
            if given is not own.x.array:
                own.x.array[:] = given
        array = out.array if isinstance(out, dolfinx.la.Vector) else out
        fem.assemble_vector(array, self.compiled, self.constants)


class CellIntegral:
    """A scalar UFL functional (an energy), compiled once and summed over all ranks.

    It is the kernel of the form times a test function that is constant on each cell.
    """

    def __init__(self, form: Any) -> None:
        msh = form.ufl_domain().ufl_cargo()
        Q = fem.functionspace(dolfinx.mesh.Mesh(msh, form.ufl_domain()), ("DG", 0))
        q = ufl.TestFunction(Q)
        terms = (i.reconstruct(integrand=i.integrand() * q) for i in form.integrals())
        self.kernel = CellKernel(ufl.Form(list(terms)))
        self.comm = msh.comm
        self.cells = np.zeros(Q.dofmap.index_map.size_local + Q.dofmap.index_map.num_ghosts)

    def __call__(self) -> float:
        """Return the integral over the whole mesh with the current coefficients."""
        self.cells[:] = 0.0
        self.kernel.add(self.cells)
        return float(self.comm.allreduce(self.cells.sum()))
