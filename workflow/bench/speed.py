# SPDX-License-Identifier: LGPL-3.0-or-later
"""``squealx bench``: how fast this machine runs kernels, steps and contact, as table and figure."""

import json
import os
import platform
import shlex
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mpi4py import MPI
from petsc4py import PETSc

import dolfinx
import ffcx
import numpy as np
from dolfinx import jit

from forms import kernel
from forms.simd import native
from workflow.bench import roofline as roofline
from workflow.bench import speed_cases as cases

if TYPE_CHECKING:
    from rich.console import Console

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
    out.mkdir(parents=True, exist_ok=True)
    (out / "bench.json").write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")
    from workflow.bench.speed_figure import draw

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
    beside = Path(sys.executable).with_name("mpiexec")
    launcher = str(beside) if beside.exists() else shutil.which("mpiexec")
    if launcher is None:
        return None
    rates: dict[int, list[float]] = {1: [], 2: []}
    for _ in range(count):
        for number in rates:
            command = [
                launcher,
                "-n",
                str(number),
                sys.executable,
                "-m",
                "workflow.bench.speed_cases",
            ]
            try:
                done = subprocess.run(
                    [*command, str(n), str(PER_RUN)],
                    check=True,
                    capture_output=True,
                    text=True,
                    timeout=TIMEOUT,
                )
            except (subprocess.SubprocessError, OSError):
                return None
            rates[number].append(json.loads(done.stdout.splitlines()[-1])["rate"])
    one, two = np.array(rates[1]), np.array(rates[2])
    return {
        "cells": n**3,
        "one": float(np.median(one)),
        "two": float(np.median(two)),
        "ratio": float(np.median(two / one)),
    }


def show(found: dict[str, Any], console: "Console") -> None:
    """Print the tables of a bench."""
    h = found["host"]
    console.print(
        f"{h['cores']} cores, {h['vector_bits']}-bit vectors, {h['compiler']}; load before "
        f"{h['load_before']:.1f}; one core unless stated; M/s are million element updates a second",
        highlight=False,
    )
    _kernel_table(found, console)
    _step_table(found, console)
    _contact_table(found, console)


def _kernel_table(found: dict[str, Any], console: "Console") -> None:
    core = found["roofline"]["core"]
    console.print(
        f"peak {core['peak_float64'] / 1e9:.0f} Gflop/s (float32: {core['peak_float32'] / 1e9:.0f})"
        f", memory {core['bandwidth'] / 1e9:.0f} GB/s; flop and byte are per cell and "
        "estimated, f/B is flop per byte, roof is the share of what these allow: see roofline.how "
        "in bench.json",
        highlight=False,
    )
    console.print(
        "own: times the rate of assemble_vector, default flags, of the same form; full SVK: times "
        f"that of {cases.REFERENCE} quadrature, which a one-point form replaces; MatMult is with "
        "the stiffness of full quadrature; hourglass stiffness: from the elastic moduli, no "
        "parameter",
        highlight=False,
    )
    heads = ("M/s", "own", "full SVK", "error", "flop", "byte", "f/B", "roof")
    for title, engines in found["kernels"]["forms"].items():
        table = _table(f"{title}, {found['kernels']['cells']} cells", heads, first="engine")
        for name, row in engines.items():
            load = found["roofline"]["forms"][title][name]
            table.add_row(
                name,
                f"{row['rate'] / 1e6:.1f}",
                f"{row['ratio']:.1f}",
                f"{row['ratio_reference']:.1f}",
                f"{row['difference']:.0e}" if "difference" in row else "",
                f"{load['operations']:.0f}",
                f"{load['bytes']:.0f}",
                f"{load['intensity']:.1f}",
                f"{load['share']:.0%}",
            )
        console.print(table)


def _table(title: str, heads: tuple[str, ...], first: str = "") -> Any:
    """Return an empty table; ``first`` is the heading of a column of text."""
    from rich import box
    from rich.table import Table

    table = Table(
        title=title, title_justify="left", box=box.SIMPLE, pad_edge=False, collapse_padding=True
    )
    if first:
        table.add_column(first, no_wrap=True)
    for head in heads:
        table.add_column(head, justify="right")
    return table


def _step_table(found: dict[str, Any], console: "Console") -> None:
    heads = ("cells", "M/s", "its kernel alone M/s", "share of the kernel's rate")
    table = _table("whole step, St. Venant-Kirchhoff", heads)
    for row in found["steps"]:
        rate, alone = row["rate"] / 1e6, row["kernel_rate"] / 1e6
        table.add_row(str(row["cells"]), f"{rate:.2f}", f"{alone:.2f}", f"{row['share']:.0%}")
    console.print(table)
    over, both = found["overhead"], found["ranks"]
    console.print(
        f"step of {over['cells']} cells: {over['step'] * 1e6:.1f} µs, of which "
        f"{over['kernel'] * 1e6:.1f} in the kernel's call; {over['fixed'] * 1e6:.1f} µs more than "
        "its cells take at the kernel's rate",
        highlight=False,
    )
    text = "could not be started"
    if both is not None:
        text = f"{both['one'] / 1e6:.2f} and {both['two'] / 1e6:.2f} M/s, ratio {both['ratio']:.2f}"
    console.print(f"1 and 2 ranks: {text}", highlight=False)


def _contact_table(found: dict[str, Any], console: "Console") -> None:
    heads = ("nodes in reach", "µs per step", "none in reach µs", "µs per node and step")
    table = _table("contact with friction, searches counted in", heads)
    for row in found["contact"]["sizes"]:
        times = (row["seconds"], row["fixed"], row["per_node"])
        table.add_row(str(row["nodes"]), *(f"{1e6 * t:.3g}" for t in times))
    console.print(table)
