# SPDX-License-Identifier: LGPL-3.0-or-later
"""Run-time guards: non-finite values, energy balance, penetration, lost contact."""

from typing import TYPE_CHECKING

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from workflow.model.regions import place

if TYPE_CHECKING:
    from contact.one_pass import Pass
    from contact.pair import ContactPair
    from workflow.model.model import Model
    from workflow.simulation.energy import Ledger


class GuardError(RuntimeError):
    """A run stopped by a physics guard; its results up to there are kept."""


def check_finite(model: "Model", asked: int = 0) -> int:
    """Raise on every rank if an acceleration is NaN or infinite, naming body, node and position.

    Args:
        model: The model.
        asked: Number of the signal that asks this rank to end, or 0.

    Returns:
        That of any rank, the same on all: one message tells of both.
    """
    comm, told = model.domain.msh.comm, np.array([model.state.not_finite, asked])
    if comm.size > 1:  # of a buffer: a pickled number takes four times as long
        comm.Allreduce(MPI.IN_PLACE, told, MPI.MAX)
    if not told[0]:
        return int(told[1])
    a = model.state.a.array[: 3 * model.domain.owned]
    size = np.nan_to_num(np.abs(a).reshape(-1, 3).max(axis=1), nan=np.inf)
    worst = int(np.argmax(size)) if len(size) else -1
    here = (
        (float(size[worst]), place(model.domain, model.scene, worst)) if len(size) else (-1.0, "")
    )
    _, where = max(comm.allgather(here))
    raise GuardError(
        f"non-finite acceleration at step {model.state.step}, t = {model.state.t:.6e} s, {where}; "
        f"dt = {model.dt:.3e} s, bound {model.dt_bound:.3e} s: a smaller time.safety or contact "
        "penalty is the usual remedy"
    )


class Watch:
    """Guards of energy and contact, at every output and between.

    Args:
        model: The model.
    """

    def __init__(self, model: "Model") -> None:
        self.model = model
        self.sizes = {
            name: [node_sizes(side) for side in pair.passes] for name, pair in model.pairs.items()
        }
        self.seen: dict[str, str] = {}

    def check(self, ledger: "Ledger") -> None:
        """Raise on every rank if the energy or a contact is beyond what the scene allows.

        Args:
            ledger: The ledger as it was measured last.

        Raises:
            GuardError: telling time, place, likely cause and remedy.
        """
        check_energy(self.model, ledger)
        self.check_contacts()

    def check_contacts(self) -> None:
        """Raise if a contact is too deep, or lost where it is to be kept."""
        for name, pair in self.model.pairs.items():
            for side, sizes in zip(pair.passes, self.sizes[name], strict=True):
                self._depth(name, side, sizes)
            if self.model.scene.contacts[name].keep:
                self._touch(name, pair)

    def _depth(self, name: str, side: "Pass", sizes: npt.NDArray[np.float64]) -> None:
        c, h = side.contact_state.touching[: side.active], side.contact_state
        if not len(c):
            return
        share = -h.gap[c] / sizes[c]
        worst, limit = int(np.argmax(share)), self.model.scene.guards.penetration
        if share[worst] > limit:
            node = int(c[worst])
            raise GuardError(
                f"contact {name}: penetration {-h.gap[node]:.3e} m, {share[worst]:.0%} of the "
                f"cell, is over guards.penetration = {limit:.0%} at {self._when()}, "
                f"{where(side, node)}; "
                "likely a load or an approach too fast for the contact springs: a larger "
                f"contacts.{name}.penalty, a smaller time.safety (it stiffens them) or a slower "
                "start is the usual remedy"
            )

    def _touch(self, name: str, pair: "ContactPair") -> None:
        if pair.normal_force > 0.0:
            side = max(pair.passes, key=lambda one: one.contact_state.totals.normal_force)
            c = side.contact_state.touching[: side.active]
            top = int(c[np.argmax(side.contact_state.normal_force[c])])
            self.seen[name] = f"seen last at t = {self.model.state.t:.6e} s, {where(side, top)}"
        elif name in self.seen:
            raise GuardError(
                f"contact {name}: lost at {self._when()}, {self.seen[name]}, where "
                f"contacts.{name}.keep asks it to stay; likely the load is too small for the "
                "motion, or the start has a jerk: check loads, [equilibrium] and initial "
                "velocities, or leave keep out if it may bounce"
            )

    def _when(self) -> str:
        return f"step {self.model.state.step}, t = {self.model.state.t:.6e} s"


def node_sizes(side: "Pass") -> npt.NDArray[np.float64]:
    """Return the edge of the cells around each contactor node or point [m], shape ``(nc,)``.

    That is the mean edge of the facets around it; of the target's, if the contactor is rigid.
    """
    from contact.search import typical_edge

    surface = side.contactor
    n = len(surface.nodes)
    if surface.rigid:
        return np.full(side.stack.nc, typical_edge(side.target))
    quads = surface.facets
    corners = surface.reference[quads]
    edges = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).mean(axis=1)
    total = np.bincount(quads.ravel(), np.repeat(edges, quads.shape[1]), n)
    sizes = total / np.maximum(np.bincount(quads.ravel(), minlength=n), 1)
    return np.asarray(sizes[side.stack.nearest])


def where(side: "Pass", node: int) -> str:
    """Return which node of a contactor is meant and where it is, in words."""
    x, y, z = side.candidates.exchange.xv[node, :3]
    return f"node {side.stack.node[node]}, at x = {x:.5f}, y = {y:.5f}, z = {z:.5f} m"


def check_energy(model: "Model", ledger: "Ledger") -> None:
    """Raise if the guarded error of the ledger is over the scene's share."""
    error, limit = ledger.guarded_error, model.scene.guards.energy_error
    if not abs(error) <= limit:
        work = ledger.contact_work
        told = f" of the work of the contact, {work:.3g} J," if work else ""
        remedy = " or penalty" if work else ""
        raise GuardError(
            f"energy balance error {error:.2%}{told} at step {model.state.step}, "
            f"t = {model.state.t:.6e} s is over guards.energy_error = {limit:.2%}; "
            f"likely an unstable step: dt = {model.dt:.3e} s, bound {model.dt_bound:.3e} s; "
            f"try a smaller time.safety{remedy}"
        )
