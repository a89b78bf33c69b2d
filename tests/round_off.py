# SPDX-License-Identifier: LGPL-3.0-or-later
"""Round-off as an ensemble: one model many times, its velocities changed in the last digit.

Nodes that hop under friction take chaotic paths, and which one is decided by the order of sums,
so by the width of the CPU's vectors and by the compiler. A test asks what holds for all of them.
``pytest --perturb SEED`` starts every run of the suite from such a change; ``CC="cc -mno-avx"``
and ``CC="cc -D__AVX512F__"`` have forms compiled for 2 and for 8 cells at once on any x86-64.
"""

from types import SimpleNamespace

from mpi4py import MPI

import numpy as np

from workflow.model.model import Model

LAST_DIGIT = 1e-15  # of the largest velocity


def perturbed(model: Model, seed: int) -> Model:
    """Return the model with its velocities changed by round-off; not at all for seed 0.

    A node gets the same change on any number of ranks; what supports hold stays held.

    Args:
        model: A model that was started; changed in place.
        seed: Which of the changes.
    """
    if seed == 0:
        return model
    domain, v = model.domain, model.state.v.x
    every = np.random.default_rng(seed).uniform(-1, 1, (len(domain.source.points), 3))
    fastest = domain.msh.comm.allreduce(np.abs(v.array).max(initial=0.0), MPI.MAX)
    change = SimpleNamespace(array=(LAST_DIGIT * fastest * every[domain.nodes]).ravel())
    model.supports(change)
    v.array[:] += change.array
    v.scatter_forward()
    return model
