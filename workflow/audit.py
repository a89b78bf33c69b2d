# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a run tells of its step before it begins: what sets it, and what contact and damping take.

The stiffest motion is found by some products with the scene's own stiffness, a moment beside the
run. Its place is that of its largest displacement; its frequency is from below.
"""

from collections.abc import Iterator

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem, la

from forms.kernel import CellKernel
from forms.stability import stable_step
from workflow.guards import place
from workflow.model import Model

PRODUCTS = 40


def audit(model: Model) -> Iterator[str]:
    """Yield lines for the log; collective."""
    scene, bodies = model.scene, model.scene.bodies.values()
    omega, where = stiffest(model)
    yield (
        f"audit: step {model.dt * 1e9:.1f} ns of at most {model.dt_bound * 1e9:.1f} ns "
        f"({scene.time.bound} bound); the stiffest motion, 2/ω = {2 / omega * 1e9:.1f} ns, is in "
        f"{where}"
    )
    if scene.contacts and scene.time.bound == "assembled":
        p = sum(contact.penalty for contact in scene.contacts.values())
        left = np.sqrt(max(1 - p / 4, 0.0))
        yield f"audit: contact penalties, {p:.2g} of 4, shorten the step to {left:.1%}"
    beta, alpha = (
        max(getattr(b, k) for b in bodies) for k in ("stiffness_damping", "mass_damping")
    )
    if alpha or beta:
        share = stable_step(omega, beta, alpha) * omega / 2
        yield (
            f"audit: damping shortens the step to {share:.1%} (stiffness {beta:.2g} s, mass "
            f"{alpha:.2g} 1/s)"
        )


def stiffest(model: Model) -> tuple[float, str]:
    """Return frequency [rad/s] and place, in words, of the stiffest motion of the bodies alone."""
    V, n = model.domain.V, 3 * model.domain.owned
    comm: MPI.Comm = model.domain.msh.comm
    u, q, w = fem.Function(V), fem.Function(V), ufl.TestFunction(V)
    kernel = CellKernel(ufl.derivative(model.bodies.internal_work(u, w), u, q))
    scale, out = 1 / np.sqrt(model.mass.array[:n]), la.vector(V.dofmap.index_map, 3)
    x = np.random.default_rng(1).standard_normal((len(model.domain.source.points), 3))
    x = x[model.domain.nodes[: model.domain.owned]].ravel()
    value = 0.0
    for _ in range(PRODUCTS):
        x /= np.sqrt(comm.allreduce(float(x @ x)))
        q.x.array[:n] = scale * x
        q.x.scatter_forward()
        out.array[:] = 0.0
        kernel.add(out)
        out.scatter_reverse(la.InsertMode.add)
        y = scale * out.array[:n]
        value, x = comm.allreduce(float(x @ y)), y
    size = (x.reshape(-1, 3) ** 2).sum(axis=1)
    top = int(np.argmax(size)) if len(size) else -1
    found = comm.allgather((float(size[top]), place(model, top)) if len(size) else (-1.0, ""))
    return float(np.sqrt(value)), max(found)[1]
