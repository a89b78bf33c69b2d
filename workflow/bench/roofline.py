# SPDX-License-Identifier: LGPL-3.0-or-later
"""Roofline of one core: peak multiply-adds and bandwidth, operations and traffic of each kernel."""

import importlib.util
import tempfile
from pathlib import Path
from typing import Any

import cffi
import ffcx.codegeneration.lnodes as L
import numpy as np
import ufl
from ffcx.analysis import analyze_ufl_objects
from ffcx.codegeneration.backend import FFCXBackend
from ffcx.codegeneration.integral_generator import IntegralGenerator
from ffcx.ir.representation import compute_ir
from ffcx.options import get_options

from forms.elasticity import full
from forms.simd.contraction import Backend, Generator
from forms.simd.native import this_host
from meshes.domain import Domain
from workflow.bench.speed_cases import (
    FORMS,
    MATRIX,
    NATIVE,
    STOCK,
    TUNED,
    Call,
    deformed,
    index_bytes,
    rounds,
)

HOW = (
    "Peak: independent chains of multiply-adds in registers, in vectors of the native kernels' "
    "width. Bandwidth: a[i] = b[i] + s c[i] with 24 bytes per entry, no write-allocate counted. "
    "Both are the best of the rounds, rates of kernels are medians. "
    "Operations of a kernel: additions, multiplications and divisions in the code that FFCx or "
    "forms.simd generates, loops multiplied out, unused values left out, before the compiler "
    "simplifies; of MatMult 2 per stored entry. "
    "Bytes per cell: every array once (coordinates, displacement, force read and "
    "written, dof indices; for assemble_vector also its packed coefficients, written and read; "
    "for MatMult entries and one index per block row of three): a lower bound."
)
CHAINS, TURNS = 12, 100_000
ENTRIES = 8 * 2**20  # of each of the three arrays of the triad, 64 MiB

SOURCE = """
#define PEAK(real)                                                                      \\
  double peak_##real(long turns, double factor, double shift)                           \\
  {                                                                                     \\
    typedef real vec __attribute__((vector_size(VECTOR_BYTES)));                        \\
    vec x[CHAINS], f = (vec){0} + (real)factor, s = (vec){0} + (real)shift;             \\
    for (int k = 0; k < CHAINS; ++k)                                                    \\
      x[k] = s + (real)k;                                                               \\
    for (long i = 0; i < turns; ++i)                                                    \\
      _Pragma("GCC unroll 16") for (int k = 0; k < CHAINS; ++k) x[k] = x[k] * f + s;     \\
    for (int k = 1; k < CHAINS; ++k)                                                    \\
      x[0] += x[k];                                                                     \\
    return x[0][0];                                                                     \\
  }
PEAK(double)
PEAK(float)

void triad(double *restrict a, const double *restrict b, const double *restrict c, double s, long n)
{
  for (long i = 0; i < n; ++i)
    a[i] = b[i] + s * c[i];
}
"""
DECLARED = """
double peak_double(long, double, double);
double peak_float(long, double, double);
void triad(double *, const double *, const double *, double, long);
"""


def core(count: int) -> dict[str, Any]:
    """Return peak operations and bandwidth of one core.

    Args:
        count: Number of rounds.
    """
    width = this_host().vector_bytes
    a, b, c = np.zeros(ENTRIES), np.ones(ENTRIES), np.ones(ENTRIES)
    with tempfile.TemporaryDirectory() as folder:
        module = compiled(Path(folder), width)
        pointers = [module.ffi.from_buffer("double[]", array) for array in (a, b, c)]
        calls: dict[str, Call] = {
            "double": lambda: module.lib.peak_double(TURNS, 0.999, 1e-3),
            "float": lambda: module.lib.peak_float(TURNS, 0.999, 1e-3),
            "triad": lambda: module.lib.triad(*pointers, 3.0, ENTRIES),
        }
        best = {name: float(times.min()) for name, times in rounds(calls, count).items()}
    per_call = 2 * CHAINS * TURNS * width
    return {
        "peak_float64": per_call / 8 / best["double"],
        "peak_float32": per_call / 4 / best["float"],
        "bandwidth": 24 * ENTRIES / best["triad"],
        "array_bytes": 8 * ENTRIES,
    }


def compiled(folder: Path, width: int) -> Any:
    """Return the C loops as a module, compiled in ``folder`` for this machine."""
    builder = cffi.FFI()
    builder.cdef(DECLARED)
    defines: list[tuple[str, str | None]] = [("VECTOR_BYTES", str(width)), ("CHAINS", str(CHAINS))]
    builder.set_source(
        "_bench",
        SOURCE,
        define_macros=defines,
        extra_compile_args=["-O3", "-march=native", "-ffast-math"],
    )
    spec = importlib.util.spec_from_file_location("_bench", builder.compile(tmpdir=str(folder)))
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def loads(domain: Domain, matrix: Any) -> dict[str, Any]:
    """Return operations and bytes per cell of each form and engine of the kernel table."""
    w, u = ufl.TestFunction(domain.V), deformed(domain.V)
    moved = bytes_per_cell(domain, matrix)
    entries = matrix.getInfo()["nz_used"] / len(domain.source.cells)
    found = {}
    for title, work in FORMS.items():
        form = work(u, w, full(domain.msh))
        scalar, lanes = operations(form, native=False), operations(form, native=True)
        flops = {STOCK: scalar, TUNED: scalar, **dict.fromkeys(NATIVE, lanes), MATRIX: 2 * entries}
        found[title] = {name: {"operations": flops[name], "bytes": moved[name]} for name in flops}
    return found


def bytes_per_cell(domain: Domain, matrix: Any) -> dict[str, float]:
    """Return the least traffic per cell of each engine [byte], see ``HOW``."""
    cells = len(domain.source.cells)
    nodes = len(domain.source.points) / cells
    shared = np.array_equal(domain.msh.geometry.dofmaps[0], domain.V.dofmap.list)
    vectors = (24 + 24 + 48) * nodes  # coordinates, displacement, force read and written
    native = vectors + 32 * (1 if shared else 2)
    stock = vectors + 3 * 32 + 2 * 24 * 8  # dofs of geometry, packing and force; packed values
    entries = matrix.getInfo()["nz_used"] / cells
    product = entries * (8 + index_bytes() / 3) + (24 + 24 + 3 * index_bytes()) * nodes
    return {STOCK: stock, TUNED: stock, **dict.fromkeys(NATIVE, native), MATRIX: product}


def roofline(host: dict[str, Any], asked: dict[str, Any], rates: dict[str, Any]) -> dict[str, Any]:
    """Return for each kernel its intensity, speed and share of what the core allows.

    Args:
        host: What :func:`core` found.
        asked: What :func:`loads` found.
        rates: What :func:`workflow.bench.speed_cases.kernels` found.
    """
    found: dict[str, Any] = {}
    for title, engines in asked.items():
        for name, load in engines.items():
            peak = host["peak_float32" if name.endswith("float32") else "peak_float64"]
            intensity = load["operations"] / load["bytes"]
            speed = load["operations"] * rates[title][name]["rate"]
            ceiling = min(peak, intensity * host["bandwidth"])
            found.setdefault(title, {})[name] = {
                **load,
                "intensity": intensity,
                "speed": speed,
                "ceiling": ceiling,
                "share": speed / ceiling,
            }
    return found


def operations(form: Any, *, native: bool) -> int:
    """Return additions, multiplications and divisions per cell in the generated code.

    Args:
        form: Rank-1 UFL form of cell integrals.
        native: Of the code of ``forms.simd``, else of FFCx's C.
    """
    options = get_options({"scalar_type": np.float64})
    ir = compute_ir(analyze_ufl_objects([form], np.float64), {}, "bench", options, False)
    total = 0
    for integral in ir.integrals:
        for cell in {key[0] for key in integral.expression.integrand}:
            backend = (Backend if native else FFCXBackend)(integral, options)
            generator = (Generator if native else IntegralGenerator)(integral, backend)
            total += live(generator.generate(cell))
    return total


def live(code: Any) -> int:
    """Return the floating-point operations of generated code without values that nobody reads."""
    names: set[str] | None = None
    while True:
        seen = read(code, names)
        if seen == names:
            return counted(code, seen)
        names = seen


def read(node: Any, names: set[str] | None) -> set[str]:
    """Return the names that the code reads, except for variables that are not among ``names``."""
    match node:
        case L.VariableDecl() if names is not None and node.symbol.name not in names:
            return set()
        case L.VariableDecl():
            return read(node.value, names)
        case L.Symbol():
            return {node.name}
        case L.ForRange():
            return read(node.body, names)
        case L.Section() | L.StatementList():
            parts = [*getattr(node, "declarations", []), *node.statements]
        case L.Declaration() | L.Comment():
            return set()
        case L.Statement():
            parts = [node.expr]
        case L.Assign():
            parts = [node.rhs]
        case L.ArrayAccess():
            parts = [node.array, *node.indices]
        case _:
            parts = [getattr(node, name) for name in ("lhs", "rhs", "arg") if hasattr(node, name)]
            parts += getattr(node, "args", [])
    return set().union(*(read(part, names) for part in parts))


def counted(node: Any, names: set[str]) -> int:
    """Return the floating-point operations of a node of FFCx's code tree."""
    match node:
        case L.ForRange():
            return (node.end.value - node.begin.value) * counted(node.body, names)
        case L.Section() | L.StatementList():
            parts = [*getattr(node, "declarations", []), *node.statements]
            return sum(counted(part, names) for part in parts)
        case L.VariableDecl():
            return counted(node.value, names) if node.symbol.name in names else 0
        case L.AssignAdd() | L.AssignSub() | L.AssignMul() | L.AssignDiv():
            return 1 + counted(node.rhs, names)
        case L.Assign():
            return counted(node.rhs, names)
        case L.ArithmeticBinOp():
            return 1 + counted(node.lhs, names) + counted(node.rhs, names)
        case L.NaryOp():
            return len(node.args) - 1 + sum(counted(arg, names) for arg in node.args)
        case L.MathFunction():  # a function is none of these operations, its arguments are
            return sum(counted(arg, names) for arg in node.args)
        case L.Neg():
            return counted(node.arg, names)
        case L.Declaration() | L.Comment():
            return 0
        case L.Statement():
            return counted(node.expr, names)
    return 0  # literals, symbols, elements of arrays
