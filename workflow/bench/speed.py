# SPDX-License-Identifier: LGPL-3.0-or-later
"""Speed of this machine: kernels, steps and contact, as tables and figure of ``squealx bench``."""

import json
import os
import platform
import shlex
import subprocess
import sys
import sysconfig
from collections.abc import Callable, Iterator
from importlib.metadata import version
from pathlib import Path
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import dolfinx
import ffcx
import numpy as np
from dolfinx import jit

from forms import kernel
from forms.simd import native
from workflow.bench import main_scene, memory_cases, roofline
from workflow.bench import speed_cases as cases
from workflow.bench.speed_figure import draw
from workflow.results.table import Column, Table
from workflow.simulation.ranks import mpi_command, tied

TIMEOUT = 300  # for one run on ranks [s]
PER_RUN = 3  # rounds of steps in each of these runs


def measure(out: Path, quick: bool, log: Callable[[str], Any] = lambda line: None) -> Any:
    """Measure everything; write ``bench.json`` and ``bench.png`` and return what the first holds.

    Args:
        out: Folder, made if missing; files of an earlier bench are replaced.
        quick: Small blocks and few rounds, to see that everything works.
        log: Takes a line of progress.
    """
    count = 3 if quick else 11
    n, sizes = (12, [6, 12]) if quick else (40, [8, 16, 32, 46])
    found: dict[str, Any] = {"host": host(), "quick": quick, "rounds": count}
    log(f"kernels on {n}³ cells")
    domain = cases.cube((n, n, n))
    matrix = cases.stiffness(domain)
    found["kernels"] = {"cells": n**3, "forms": cases.kernels(domain, matrix, count)}
    log("multiply-adds and bandwidth of one core")
    core, asked = roofline.core(count), roofline.loads(domain, matrix)
    shares = roofline.roofline(core, asked, found["kernels"]["forms"])
    found["roofline"] = {"core": core, "forms": shares, "how": roofline.HOW}
    log("cells with a memory, and the same by stock DOLFINx (minutes to compile at first)")
    found["memory"] = memory_cases.memory(domain, core["bandwidth"], count)
    del domain, matrix
    log(f"whole steps on {', '.join(f'{size}³' for size in sizes)} cells")
    found["steps"] = cases.steps(sizes, count)
    found["overhead"] = cases.overhead(count)
    found["overhead"]["fixed"] = (
        found["overhead"]["step"] - found["overhead"]["cells"] / found["steps"][-1]["kernel_rate"]
    )
    log("contact")
    found["contact"] = cases.contact([6, 12] if quick else [10, 20, 40], count)
    log("steps on 1 and 2 ranks")
    found["ranks"] = ranks(sizes[-1], 1 if quick else 3)
    log("other codes on the same job")
    found["peers"] = others(8 if quick else 24, count)
    log(f"main scene, {main_scene.SCENE}: at rest once, then steps on 1 and 2 ranks")
    found["main_scene"] = main_scene.measure(quick, 1 if quick else 3, log)
    out.mkdir(parents=True, exist_ok=True)
    (out / "bench.json").write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")
    draw(found, out / "bench.png")
    return found


def host() -> dict[str, Any]:
    """Return what the numbers depend on: processor, compiler, flags, versions."""
    compiler = shlex.split(os.environ.get("CC") or sysconfig.get_config_var("CC") or "cc")
    said = subprocess.run([*compiler, "--version"], check=False, capture_output=True, text=True)
    return {
        "machine": platform.machine(),
        "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else None,
        "load_before": os.getloadavg()[0],
        "vector_bits": 8 * native.this_host().vector_bytes,
        "compiler": (said.stdout.splitlines() or ["?"])[0],
        "flags_stock": jit.get_options(None)["cffi_extra_compile_args"],
        "flags_tuned": kernel.JIT_OPTIONS["cffi_extra_compile_args"],
        "flags_native": list(native.FLAGS),
        "threads": os.environ.get("OMP_NUM_THREADS", ""),
        "mpi": " ".join(MPI.Get_library_version().splitlines()[0].split()),
        "python": platform.python_version(),
        "versions": {
            "squealx": version("squealx"),
            "dolfinx": dolfinx.__version__,
            "ffcx": ffcx.__version__,
            "numpy": np.__version__,
            "petsc": ".".join(map(str, PETSc.Sys.getVersion())),
        },
    }


def ranks(n: int, count: int) -> dict[str, Any] | None:
    """Return the rate of the whole step on 1 and 2 ranks, or None if they cannot be started.

    Args:
        n: Cells along each edge of the block.
        count: Runs of each, in turn.
    """
    rates: dict[int, list[float]] = {1: [], 2: []}
    module = ["-m", "workflow.bench.speed_cases", str(n), str(PER_RUN)]
    try:
        for _ in range(count):
            for number, found in rates.items():
                done = subprocess.run(
                    mpi_command(number, module),
                    check=True,
                    capture_output=True,
                    text=True,
                    timeout=TIMEOUT,
                    **tied(),
                )
                found.append(json.loads(done.stdout.splitlines()[-1])["rate"])
    except (subprocess.SubprocessError, OSError):
        return None
    one, two = np.array(rates[1]), np.array(rates[2])
    return {
        "cells": n**3,
        "one": float(np.median(one)),
        "two": float(np.median(two)),
        "ratio": float(np.median(two / one)),
    }


def others(n: int, count: int) -> dict[str, Any] | None:
    """Return what :func:`workflow.bench.peers.measure` finds in a process of its own, or None."""
    words = [sys.executable, "-m", "workflow.bench.peers", str(n), str(count)]
    try:
        done = subprocess.run(
            words, check=True, capture_output=True, text=True, timeout=TIMEOUT, **tied()
        )
    except (subprocess.SubprocessError, OSError):
        return None
    return dict(json.loads(done.stdout.splitlines()[-1]))


def printout(found: dict[str, Any]) -> Iterator[str | Table]:
    """Yield the lines and tables of a bench."""
    h = found["host"]
    yield (
        f"{h['cores']} cores, {h['vector_bits']}-bit vectors, {h['compiler']}; load before "
        f"{h['load_before']:.1f}; one core unless stated; M/s are million element updates a second"
    )
    core = found["roofline"]["core"]
    yield (
        f"peak {core['peak_float64'] / 1e9:.0f} Gflop/s (float32: {core['peak_float32'] / 1e9:.0f})"
        f", memory {core['bandwidth'] / 1e9:.0f} GB/s; flop and byte are per cell and "
        "estimated, f/B is flop per byte, roof is the share of what these allow: see roofline.how "
        "in bench.json"
    )
    yield (
        "own: times the rate of assemble_vector, default flags, of the same form; full SVK: times "
        f"that of {cases.REFERENCE} quadrature, which a one-point form replaces; MatMult is with "
        "the stiffness of full quadrature; hourglass stiffness: from the elastic moduli, no "
        "parameter"
    )
    for title, engines in found["kernels"]["forms"].items():
        loads = found["roofline"]["forms"][title]
        rows = [{"engine": name} | row | loads[name] for name, row in engines.items()]
        yield Table(f"{title}, {found['kernels']['cells']} cells", KERNEL, rows)
    yield Table("materials with a memory", MEMORY, found["memory"], MEMORY_NOTE)
    yield Table("whole step, St. Venant-Kirchhoff", STEP, found["steps"])
    yield from _overhead(found["overhead"], found["ranks"])
    title = "contact with friction, searches counted in"
    yield Table(title, CONTACT, found["contact"]["sizes"])
    yield from _peers(found["peers"])
    yield from _main_scene(found["main_scene"])


KERNEL = (
    Column("engine", "engine", words=True),
    Column("M/s", "rate", ".1f", factor=1e-6),
    Column("own", "ratio", ".1f"),
    Column("full SVK", "ratio_reference", ".1f"),
    Column("error", "difference", ".0e"),
    Column("flop", "operations", ".0f"),
    Column("byte", "bytes", ".0f"),
    Column("f/B", "intensity", ".1f"),
    Column("roof", "share", ".0%"),
)
MEMORY = (
    Column("law", "law", words=True),
    Column("strain", "strain", words=True),
    Column("element", "element", words=True),
    Column("M/s", "rate", ".1f", factor=1e-6),
    Column("of elastic", "ratio", ".2f"),
    Column("none flows", "ratio_resting", ".2f"),
    Column("stock", "ratio_stock", ".0f"),
    Column("error", "difference", ".0e"),
    Column("byte", "bytes", ".0f"),
    Column("bandwidth M/s", "bandwidth_rate", ".0f", factor=1e-6),
)
MEMORY_NOTE = (
    "All cells flow, or none does; of elastic: over the rate of elastic cells of the same element "
    "and strain; stock: times the rate of assemble_vector and Expression, default flags; byte: "
    "history of a cell; bandwidth: the rate that memory allows"
)
STEP = (
    Column("cells", "cells"),
    Column("M/s", "rate", ".2f", factor=1e-6),
    Column("its kernel alone M/s", "kernel_rate", ".2f", factor=1e-6),
    Column("share of the kernel's rate", "share", ".0%"),
)
CONTACT = (
    Column("nodes in reach", "nodes"),
    Column("µs per step", "seconds", ".3g", factor=1e6),
    Column("none in reach µs", "fixed", ".3g", factor=1e6),
    Column("µs per node and step", "per_node", ".3g", factor=1e6),
)


PEER = (
    Column("code", "code", words=True),
    Column("M/s", "rate", ".3g", factor=1e-6),
    Column("times assemble_vector", "ratio", ".3g"),
    Column("error", "difference", ".0e"),
)
PHASE = (
    Column("phase", "phase", words=True),
    Column("1 rank, ms a step", "one", ".3f", factor=1e3),
    Column("2 ranks", "two", ".3f", factor=1e3),
)


def _peers(found: dict[str, Any] | None) -> Iterator[str | Table]:
    """Yield the table of other codes, and a line for each that was skipped."""
    if found is None:
        yield "other codes: could not be run"
        return
    codes = found["codes"].items()
    rows = [{"code": name} | row for name, row in codes if "skipped" not in row]
    yield Table(f"{cases.REFERENCE}, {found['cells']} cells, other codes", PEER, rows)
    yield from (f"{name}: {row['skipped']}" for name, row in codes if "skipped" in row)


def _main_scene(found: dict[str, Any] | None) -> Iterator[str | Table]:
    """Yield the phases of the main scene, and a line of what comes before its steps."""
    if found is None:
        yield "main scene: could not be run"
        return
    one, two = found["one"], found["two"]
    rows = [{"phase": p, "one": one[p], "two": two[p]} for p in (*main_scene.STEPPED, "step")]
    yield Table(f"{found['scene']}, {found['cells']} cells, {found['steps']} steps", PHASE, rows)
    made = ", ".join(f"{phase} {value:.1f} s" for phase, value in found["seconds"].items())
    yield (
        f"made once on one rank: {made}; {one['rate'] / 1e6:.2f} and {two['rate'] / 1e6:.2f} M/s, "
        f"ratio {found['ratio']:.2f}; internal force {one['share']:.0%} of a step"
    )


def _overhead(over: dict[str, Any], ranks: dict[str, Any] | None) -> Iterator[str]:
    """Yield lines of a small step and of steps on ranks."""
    yield (
        f"step of {over['cells']} cells: {over['step'] * 1e6:.1f} µs, of which "
        f"{over['kernel'] * 1e6:.1f} in the kernel's call; {over['fixed'] * 1e6:.1f} µs more than "
        "its cells take at the kernel's rate"
    )
    text = "could not be started"
    if ranks is not None:
        one, two = ranks["one"] / 1e6, ranks["two"] / 1e6
        text = f"{one:.2f} and {two:.2f} M/s, ratio {ranks['ratio']:.2f}"
    yield f"1 and 2 ranks: {text}"
