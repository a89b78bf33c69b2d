# SPDX-License-Identifier: LGPL-3.0-or-later
"""What stops a run that has gone wrong, and what it says."""

import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from workflow.model import Model


class GuardError(RuntimeError):
    """A run stopped by a physics guard; its results up to there are kept."""


def check_finite(model: "Model") -> None:
    """Raise on every rank if an acceleration is NaN or infinite, naming body, node and position."""
    vector = model.state.a.petsc_vec
    # over all ranks at once; NaN and infinity survive a sum of squares
    if math.isfinite(vector.dot(vector)):
        return
    comm, a = model.domain.msh.comm, model.state.a.array[: 3 * model.domain.owned]
    size = np.nan_to_num(np.abs(a).reshape(-1, 3).max(axis=1), nan=np.inf)
    worst = int(np.argmax(size)) if len(size) else -1
    found = comm.allgather((float(size[worst]), _place(model, worst)) if len(size) else (-1.0, ""))
    _, where = max(found)
    raise GuardError(
        f"non-finite acceleration at step {model.state.step}, t = {model.state.t:.6e} s, {where}; "
        f"dt = {model.dt:.3e} s, bound {model.dt_bound:.3e} s: a smaller time.safety or contact "
        "penalty is the usual remedy"
    )


def _place(model: "Model", dof: int) -> str:
    domain = model.domain
    node = int(domain.nodes[dof])
    cell = int(np.flatnonzero((domain.source.cells == node).any(axis=1))[0])
    region = domain.source.name(int(domain.source.regions[cell]))
    bodies = model.scene.bodies.items()
    body = next((name for name, b in bodies if region in [r.lower() for r in b.regions]), region)
    x, y, z = domain.source.points[node]
    return f"body {body!r} ({region}), node {node}, at x = {x:.5f}, y = {y:.5f}, z = {z:.5f} m"


def check_energy(model: "Model", error: float) -> None:
    """Raise if the balance error of the ledger is over the scene's share."""
    limit = model.scene.guards.energy_error
    if not abs(error) <= limit:
        raise GuardError(
            f"energy balance error {error:.2%} at step {model.state.step}, "
            f"t = {model.state.t:.6e} s is over guards.energy_error = {limit:.2%}; "
            f"likely an unstable step: dt = {model.dt:.3e} s, bound {model.dt_bound:.3e} s; "
            "try a smaller time.safety or penalty"
        )
