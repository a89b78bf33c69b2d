# SPDX-License-Identifier: LGPL-3.0-or-later
"""Step that follows the shape of cells: it falls with the bound of the deformed mesh.

Cells are looked at after spans of equal length, about ten first steps, with which outputs and
samples end too; in one span all steps are equal. A cell that is stretched by s since the bound was
found brings it down by s at most. Where the smallest stretch has come to 0.9, it is found anew: by
Lanczos' method on the mesh as it is deformed, with the elastic moduli, which plastic flow only
lowers. The step never rises: contact springs keep the stiffness of their birth, and those that were
born with a longer step are soft enough for a shorter one.
"""

from collections.abc import Mapping
from typing import Any

from mpi4py import MPI

import numpy as np

from forms.elements import LAWS
from forms.stretch import Stretch
from forms.time_step import largest_eigenvalue, scaled_stiffness
from meshes.arrays import Array
from workflow.model import Model
from workflow.model.regions import owners
from workflow.model.step import bodies_followed, even_step
from workflow.simulation.guards import GuardError
from workflow.simulation.stepping import retime

GROWN = 1.27  # of the measure since cells were looked at closely: a stretch is 3 % smaller
FRESH = 0.9  # stretch since the bound was found by which it is found anew
SHARP = 0.05  # how far a bound may be below the stable step
FLAT = 0.1  # stretch since then below which a cell is as good as turned inside out


class Following:
    """The bound of the step by the shape of the bodies, and the steps that it has led to.

    Attributes:
        shrunk: The bound in the shape that stretches are counted from, over the first one [-].
        changes: Step number, time [s], old and new step [s], bound over the first one, number of
            the cell in the mesh that is stretched least, of each change of the step.
    """

    def __init__(self, model: Model) -> None:
        bodies, V = model.bodies, model.domain.V
        self.model = model
        self.bodies = bodies_followed(bodies)
        tags = [bodies.tags(model.scene.bodies[name]) for name in self.bodies]
        self.stretch = Stretch(model.state.u, [bodies.dx(own) for own in tags])
        self._moving = np.zeros((len(model.domain.nodes), 1))
        self._moving[np.isin(model.domain.nodes, model.domain.source.nodes(*sum(tags, ())))] = 1.0
        mass = model.mass.array
        self._stiffness = scaled_stiffness(V, self._work, mass, precision="float32")
        self._dof = np.empty(len(V.mesh.geometry.x), dtype=np.int64)
        self._dof[V.mesh.geometry.dofmaps[0]] = V.dofmap.list
        self.bound, self.first = model.dt_bound, model.dt
        self.frequency, self.shrunk, self.seen = 0.0, 1.0, 0.0
        self.changes: list[list[float]] = []
        self.power = 2 if any(b.stiffness_damping for b in model.scene.bodies.values()) else 1

    def look(self) -> str | None:
        """Let the model go on with a shorter step if its shape asks for one; collective.

        To be called at the end of a span.

        Returns:
            What has changed, in words; None if nothing has.

        Raises:
            GuardError: on all ranks, if a cell is turned inside out.
        """
        model = self.model
        measure = model.domain.msh.comm.allreduce(self.stretch.look(), MPI.MAX)
        rough = self.shrunk * measure ** (-1 / 8)
        if measure < GROWN * self.seen or self._step_at(rough) >= model.dt:
            return None
        self.seen = measure
        stretch, cell = self._closely()
        if stretch <= FLAT:
            raise GuardError(self._inside_out(stretch, cell))
        if stretch <= FRESH:
            self._renew()
            stretch = 1.0
        return self._shorten(self.shrunk * stretch, cell)

    def _shorten(self, share: float, cell: int) -> str | None:
        """Take the step that a bound of this share of the first one allows; tell of it."""
        model, before, dt = self.model, self.model.dt, self._step_at(share)
        model.dt_bound = min(model.dt_bound, self._bound(share))
        if not dt < before:
            return None
        retime(model, dt)
        self.changes.append([model.state.step, model.state.t, before, dt, share, cell])
        return (
            f"step {model.state.step}, t = {model.state.t:.6e} s: dt {before * 1e9:.2f} -> "
            f"{dt * 1e9:.2f} ns for the shape of {self._place(cell)}"
        )

    def _bound(self, share: float) -> float:
        """Return the bound where undamped motion has this share of the first one [s].

        Damping in proportion to the stiffness, of other bodies, may shorten it as much again.
        """
        return float(self.bound * share**self.power)

    def _step_at(self, share: float) -> float:
        """Return the step that a bound of this share of the first one allows [s]."""
        assert self.model.span is not None
        limit = self.model.scene.time.safety * self._bound(share)
        return even_step(self.model.span, min(limit, self.first))

    def _renew(self) -> None:
        """Find the bound of the present shape and count stretches from there."""
        if not self.frequency:
            self.frequency = self._highest() / (1 + SHARP)  # of the first shape, from below
        self.stretch.begin()
        self.shrunk = min(self.frequency / self._highest(), 1.0)
        self.seen = 0.0

    def _highest(self) -> float:
        """Return a bound of the highest frequency in the shape that is counted from [rad/s]."""
        V, x = self.model.domain.V, self.model.domain.msh.geometry.x
        flat = x.copy()
        moved = self._moving * self.stretch.since.x.array.reshape(-1, 3)
        x += moved[self._dof]
        try:
            square, _ = largest_eigenvalue(V, self._stiffness, tolerance=SHARP)
        finally:
            x[:] = flat
        return float(np.sqrt(square))

    def _work(self, u: Any, w: Any) -> Any:
        """Return the form of the virtual work of a small strain on top of the shape at hand."""
        entries = self.model.scene.bodies
        followed = [entries[name] for name in self.bodies]
        return sum(
            part.work(u, w, law=LAWS["small-strain"] if part.body in followed else None)
            for part in self.model.bodies.parts
        )

    def _closely(self) -> tuple[float, int]:
        """Return the smallest stretch of all ranks and the number of its cell in the mesh."""
        comm, domain = self.model.domain.msh.comm, self.model.domain
        own, cell = self.stretch.smallest()
        number = int(domain.msh.topology.original_cell_index[cell]) if cell >= 0 else -1
        found: tuple[float, int] = min(comm.allgather((own, number)))
        return found

    def _body(self, cell: int) -> str:
        mesh = self.model.domain.source
        return owners(self.model.scene)[mesh.name(int(mesh.regions[cell]))]

    def _place(self, cell: int) -> str:
        """Return body, number and place of a cell in words."""
        mesh = self.model.domain.source
        x, y, z = mesh.points[mesh.cells[cell]].mean(axis=0)
        return (
            f"body {self._body(cell)!r}, cell {cell}, at x = {x:.5f}, y = {y:.5f}, z = {z:.5f} m "
            "of the undeformed mesh"
        )

    def _inside_out(self, stretch: float, cell: int) -> str:
        state, fate = self.model.state, "turned inside out" if stretch <= 0 else "flattened at once"
        return (
            f"a cell is {fate} at step {state.step}, t = {state.t:.6e} s: {self._place(cell)}; "
            "likely its corners fold where the body flows most: a mesh that suits the flow, "
            "element = 'selective' or a larger hourglass_coefficient is the usual remedy"
        )

    def tables(self) -> list[dict[str, Any]]:
        """Return the changes as they stand in ``summary.json``."""
        names = ("step", "t", "dt_before", "dt", "bound_share", "cell")
        return [
            dict(zip(names, [int(row[0]), *row[1:5], int(row[5])], strict=True))
            | {"body": self._body(int(row[5]))}
            for row in self.changes
        ]

    def memory(self) -> dict[str, Array]:
        """Return step, bounds, changes and the shape that is counted from; collective."""
        scalars = [self.model.dt, self.model.dt_bound, self.frequency, self.shrunk, self.seen]
        return {
            "scalars": np.array(scalars),
            "changes": np.array(self.changes).reshape(-1, 6),
            "since": self.model.domain.gather(self.stretch.since.x.array),
        }

    def restore(self, memory: Mapping[str, Array]) -> None:
        """Go on from what :meth:`memory` returned: the model and its items take the step."""
        model = self.model
        dt, model.dt_bound, self.frequency, self.shrunk, self.seen = map(float, memory["scalars"])
        self.changes = memory["changes"].tolist()
        self.stretch.since.x.array[:] = memory["since"][model.domain.nodes].ravel()
        model.dt = dt
        for item in model.items:
            if hasattr(item, "retime"):
                item.retime(dt)
