# SPDX-License-Identifier: LGPL-3.0-or-later
"""Model at rest: the forces of its items in statics, what is held, and the way there.

The forces are those of the very items that the stepping uses, so a run that starts from rest does
not jump.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from dolfinx import la

from forms.loads import DeadLoad
from meshes.arrays import Array
from workflow.model import Model
from workflow.model.state import Load
from workflow.model.supports import supports
from workflow.scene.settings import Equilibrium
from workflow.simulation.guards import GuardError

if TYPE_CHECKING:
    from workflow.simulation.elastic import Free

Log = Callable[[str], Any]
Solve = Callable[[bool], int]  # to rest, roughly or not, and the iterations used


class AtRest:
    """A model under its loads without velocities, as a static solver sees it.

    Attributes:
        model: The model; its displacement, contact state and point masses are set.
        settings: Tolerance, iterations, first guess, extra supports, shift.
        held: Owned scalar dofs that stay.
        free: Motions whose inertia balances the other forces; None for none.
    """

    def __init__(
        self,
        model: Model,
        settings: Equilibrium,
        extra: Array,
        friction: Load | None = None,
        free: "Free | None" = None,
    ) -> None:
        """Take a model.

        Args:
            model: The model.
            settings: How the scene wants its equilibrium.
            extra: More dead load of every owned dof (the centrifugal force of a spinning wheel) or
                none, N.
            friction: Adds the friction of bodies that slide; a model at rest has none.
            free: Motions whose inertia balances the other forces.
        """
        self.model, self.settings, self.free = model, settings, free
        self.held = held_dofs(model, settings)
        self._dead = [item for item in model.items if isinstance(item, DeadLoad)]
        items = list(model.items)
        if len(extra):
            more = DeadLoad(model.domain.msh.comm, extra)
            self._dead.append(more)
            items.insert(len(self._dead), more)  # beside the other dead load
        acting = [item for item in items if getattr(item, "rest", item.add) is not None]
        last = [item for item in acting if getattr(item, "last", False)]
        self._remembering = [item for item in items if hasattr(item, "settle_memory")]
        self._masses = [] if model.connections is None else [model.connections.masses]
        self._whole = [item.nodal for item in self._dead], [m.gravity for m in self._masses]
        self._last = [getattr(item, "rest", item.add) for item in last]
        self._last += [friction] if friction is not None else []
        self._loads = [getattr(item, "rest", item.add) for item in acting if item not in last]

    def out_of_balance(self) -> la.Vector:
        """Return the sum of all forces, zero where held; point masses settled [N]."""
        state = self.model.state
        state.a.array[:] = 0.0
        for add in self._loads:
            add(state, state.a)
        state.a.scatter_reverse(la.InsertMode.add)
        for add in self._last:
            add(state, state.a)
        state.a.array[self.held] = 0.0
        if self.free is not None:
            self.free.balance(state.a.array[: 3 * self.model.domain.owned])
        return state.a

    def bear(self, share: float) -> None:
        """Let a share of the dead loads act, and of the weight of the point masses."""
        for item, whole in zip(self._dead, self._whole[0], strict=True):
            item.nodal = whole if share == 1.0 else share * whole
        for masses, whole in zip(self._masses, self._whole[1], strict=True):
            masses.gravity = whole if share == 1.0 else share * whole

    @property
    def remembers(self) -> bool:
        """Whether it matters on which way the bodies come to rest."""
        return bool(self._remembering)

    @property
    def softens(self) -> bool:
        """Whether there are bodies whose stiffness after flow is known."""
        return any(getattr(item, "softens", False) for item in self._remembering)

    def remember(self) -> None:
        """Take the memory of the materials on to the present displacement."""
        for item in self._remembering:
            item.settle_memory(self.model.state)

    def load_size(self) -> float:
        """Norm of the dead loads and the weight of the point masses, scale of the residual [N].

        Raises:
            GuardError: if there are neither such nor contact forces.
        """
        model = self.model
        nodal = sum((item.nodal for item in self._dead), np.zeros(3 * model.domain.owned))
        square = model.domain.msh.comm.allreduce(float(nodal @ nodal))
        if model.connections is not None:
            masses = model.connections.masses
            square += float(((masses.mass[:, None] * masses.gravity) ** 2).sum())
        if square == 0.0:
            # driven bodies are pressed together by their approach: the scale is the contact force
            pressed = sum(np.linalg.norm(p.normal_resultant) for p in model.pairs.values())
            if pressed == 0.0:
                raise GuardError("no loads, and nothing touches: no forces to balance")
            return float(pressed)
        return float(np.sqrt(square))


def held_dofs(model: Model, settings: Equilibrium) -> npt.NDArray[np.int32]:
    """Owned scalar dofs held in the static solve.

    A support along a slanted direction holds every axis that it touches: the static solve has no
    sliding along it.
    """
    extra = supports(settings.hold, model.scene, model.domain)
    groups = zip(
        model.supports.dofs + extra.dofs, model.supports.directions + extra.directions, strict=True
    )
    held = [3 * d + i for d, n in groups for i in np.flatnonzero(np.abs(n) > 1e-12)]
    return np.unique(np.concatenate(held)) if held else np.zeros(0, dtype=np.int32)


def move(model: Model, body: str, shift: Array) -> None:
    """Displace a whole body rigidly by ``shift``, shape ``(3,)`` [m]."""
    u = model.state.u.x
    u.array.reshape(-1, 3)[model.bodies.dofs(body)] += shift
    u.scatter_forward()
