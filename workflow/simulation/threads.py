# SPDX-License-Identifier: LGPL-3.0-or-later
"""Threads of BLAS and OpenMP: one on each rank while a run lasts.

A step has many short products of vectors, which BLAS parts among as many threads as there are
cores. They cost more than they give, and they fight over the cores of other ranks: a damped scene
takes twice the time. Who sets ``OMP_NUM_THREADS`` is believed.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager

VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def of_environment() -> str | None:
    """Return the setting of the environment that BLAS and OpenMP follow, in words, if any."""
    found = next((name for name in VARIABLES if os.environ.get(name)), None)
    return found and f"{found} = {os.environ[found]}"


@contextmanager
def one_per_rank() -> Iterator[str]:
    """Keep BLAS and OpenMP to one thread inside; yield a line for the log.

    Libraries that are loaded already are told so, and afterwards have the threads that they had.
    What the environment sets is left as it is.
    """
    if (setting := of_environment()) is not None:
        yield f"threads of BLAS and OpenMP: left as the environment has them, {setting}"
        return
    from threadpoolctl import ThreadpoolController

    pools = ThreadpoolController()
    most = max((pool["num_threads"] for pool in pools.info()), default=1)
    with pools.limit(limits=1):
        yield f"threads of BLAS and OpenMP: one on each rank, {most} again after the run"
