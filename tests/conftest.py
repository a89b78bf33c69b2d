# SPDX-License-Identifier: LGPL-3.0-or-later
"""Workers that compile the same form wait for each other for as long as it takes."""

from mpi4py import MPI  # noqa: F401

from dolfinx import jit

_, _words = jit.DOLFINX_DEFAULT_JIT_OPTIONS["timeout"]
jit.DOLFINX_DEFAULT_JIT_OPTIONS["timeout"] = (300, _words)
