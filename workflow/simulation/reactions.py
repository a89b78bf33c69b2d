# SPDX-License-Identifier: LGPL-3.0-or-later
"""Forces on the bodies at an output: reactions of supports, of connections, and of contact.

With the loads of the scene and the inertia of the nodes they are in balance to round-off.
"""

from collections import defaultdict
from collections.abc import Iterator, Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

import numpy as np
from dolfinx import la

from meshes.arrays import Array, Index
from workflow.model import Model
from workflow.simulation.stepping import due

if TYPE_CHECKING:
    from workflow.results.footprints import Touch

AXES = "xyz"


class Reactions:
    """The forces that act on the bodies besides their loads, as columns of the history.

    Those of supports are found where these are imposed, in the steps of an output only: held or
    moved, a support has changed the acceleration of its nodes by its force over their mass. Where
    supports share nodes and a direction, the first one bears them.

    Args:
        model: The model, in motion.
    """

    def __init__(self, model: Model) -> None:
        self.model, self.hold = model, model.hold
        self.interval = model.scene.time.output_interval
        supports = model.supports
        self._mass = [model.mass.array[::3][dofs] for dofs in supports.dofs]
        self._forces = np.zeros(len(supports.dofs))

    def __call__(self, a: la.Vector) -> None:
        """Impose what the model holds on an acceleration, in place; take the forces if due."""
        if not due(self.model.state.t, self.interval, self.model.dt):
            self.hold(a)
            return
        left = a.array.copy()
        self.hold(a)
        groups = list(enumerate(self.model.supports.groups))
        taken = [-self._removed(left, *group) for group in groups]
        given = a.array - left  # by what moves supports and driven surfaces
        for k, group in reversed(groups):
            taken[k] += self._removed(given, k, group)
        self._forces[:] = taken

    def _removed(self, x: Array, k: int, group: tuple[Index, Array | None]) -> float:
        """Remove the component of an acceleration along a support; return it times the masses."""
        index, n = group
        along = x[index] if n is None else n @ x[index]
        x[index] -= along if n is None else np.multiply.outer(n, along)
        return float(self._mass[k] @ along)

    def columns(self, contacts: "Mapping[str, Touch]") -> dict[str, float]:
        """Return the forces of the present output by name [N]; collective.

        Args:
            contacts: The contact of each pair.
        """
        forces: dict[str, float] = defaultdict(float)
        total = self.model.domain.msh.comm.allreduce(self._forces, MPI.SUM)
        for name, force in zip(self.model.supports.names, total, strict=True):
            forces[f"support_{name}_force"] += float(force)
        links = self.model.connections
        for name, vector in links.forces() if links is not None else ():
            for axis, force in zip(AXES, vector, strict=True):
                forces[f"connection_{name}_{axis}_force"] += float(force)
        for body, vector in self._on_bodies(contacts):
            for axis, force in zip(AXES, vector, strict=True):
                forces[f"contact_on_{body}_{axis}_force"] += float(force)
        return {name.replace("/", "-"): force for name, force in forces.items()}

    def _on_bodies(self, contacts: "Mapping[str, Touch]") -> Iterator[tuple[str, Array]]:
        """Yield body and force of each contact on it."""
        for name, pair in self.model.pairs.items():
            force = pair.normal_resultant + pair.tangential_force
            for side, sign in (("contactor", 1.0), ("target", -1.0)):
                surface = getattr(pair, side)
                bodies: Any = () if surface.rigid else np.unique(self._body[surface.nodes])
                if len(bodies) == 1:
                    yield self._names[bodies[0]], sign * force
                    continue
                for body in bodies:
                    yield self._names[body], self._part(contacts[name].sides.get(side), body)

    def _part(self, side: Any, body: int) -> Array:
        """Return the force on those nodes of a side that belong to one of its bodies."""
        if side is None:
            return np.zeros(3)
        foot, own = side.foot, self._body[side.foot.node] == body
        forces = foot.normal_force[own, None] * foot.normal[own] + foot.tangential_force[own]
        return np.asarray(forces.sum(axis=0))

    @property
    def _names(self) -> list[str]:
        return list(self.model.scene.bodies)

    @cached_property
    def _body(self) -> Index:
        """Number of the body of each mesh node, of the first one at a border."""
        mesh, bodies = self.model.domain.source, self.model.scene.bodies
        found = np.full(len(mesh.points), -1)
        for k, name in reversed(list(enumerate(self._names))):
            found[mesh.nodes(*mesh.tags(bodies[name].regions))] = k
        return found
