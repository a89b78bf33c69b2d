# SPDX-License-Identifier: LGPL-3.0-or-later
"""Supports that move: a surface is given a speed along the direction in which it is held."""

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from dolfinx import la

from workflow.attachments import supports
from workflow.sections import Support

if TYPE_CHECKING:
    from workflow.model import Model

Array = npt.NDArray[np.float64]


class Moved:
    """Nodes held along a direction whose speed there changes once, and the work of what does it.

    From ``begin`` on and within ``ramp`` the speed goes from 0 to ``velocity`` as
    ``s³ (10 - 15 s + 6 s²)``, so that acceleration and jerk are continuous.

    Attributes:
        work: Work of this rank's nodes since the first step [J].
        reaction: Force that holds them along the direction, of this rank [N].
    """

    def __init__(self, model: "Model", entry: Support) -> None:
        found = supports([entry], model.scene, model.domain)
        self.entry, self.state, self.dt = entry, model.state, model.dt
        self.dofs, self.direction = found.dofs[0], found.directions[0]
        self.mass = model.mass.array[::3][self.dofs]
        self.work, self.reaction = 0.0, float("nan")

    def acceleration(self, t: float) -> float:
        """Return the prescribed acceleration at a time [m/s²]."""
        s = (t - self.entry.begin) / self.entry.ramp
        return self.entry.velocity / self.entry.ramp * 30 * (s * (1 - s)) ** 2 if 0 < s < 1 else 0.0

    def free(self, a: la.Vector) -> Array:
        """Return the acceleration that the other forces give the nodes, shape ``(n,)`` [m/s²]."""
        return np.asarray(a.array.reshape(-1, 3)[self.dofs] @ self.direction)

    def steer(self, a: la.Vector, free: Array) -> None:
        """Add the prescribed acceleration where the supports have left none, and count the work.

        Args:
            a: Acceleration, its held component gone, in place [m/s²].
            free: What :meth:`free` returned before.
        """
        held = self.acceleration(self.state.t)
        if held:
            a.array.reshape(-1, 3)[self.dofs] += held * self.direction
        reaction = float(self.mass @ (held - free))
        if len(self.dofs) and not np.isnan(self.reaction):
            speed = self.state.v.x.array[3 * self.dofs[0] :][:3] @ self.direction
            self.work += self.dt / 2 * (self.reaction + reaction) * float(speed)
        self.reaction = reaction


def moved(model: "Model") -> list[Moved]:
    """Return the supports of a scene that move."""
    return [Moved(model, entry) for entry in model.scene.supports if entry.velocity]


def moves(scene: Any) -> bool:
    """Tell whether a support of a scene moves."""
    return any(entry.velocity for entry in scene.supports)
