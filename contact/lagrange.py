# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact without penetration: forward-increment Lagrange multipliers.

At t all forces but those of the contact are known, and with them where the nodes would be at
t + dt. The closest points are found there, and forces are added at t such that each node that would
overlap ends on the target (Carpenter, Taylor, Katona, Int. J. Numer. Meth. Eng. 32, 1991), none
pulls, and slip stops where friction can stop it. Nodes that share a facet are coupled; projected
Gauss-Seidel solves for them, starting from the forces of the last step.

Energy: a contact that lasts does no work. One that begins is a plastic impact of the surface nodes
alone; what it takes of their kinetic energy is counted with the damping and falls with the size of
the cells.
"""

from typing import Any

import numpy as np
import numpy.typing as npt

from contact._kernel import lib
from contact.arrays import view
from contact.candidates import Candidates
from contact.contact_state import ContactState

Array = npt.NDArray[np.float64]

TOLERANCE = 1e-10  # last move of the sweeps over the deepest overlap that they remove
_SWEEPS = 200
_LOST = 1e-3  # with a larger last move the forces mean nothing


class Lagrange:
    """The solver of one pair.

    Attributes:
        sweeps: Gauss-Seidel sweeps of the last step.
        residual: Their last move over the deepest overlap [-].
    """

    def __init__(
        self, near: Candidates, contact_state: ContactState, fixed: dict[str, Any]
    ) -> None:
        """Bind the arrays of a pair; ``fixed`` are views of ``mass, dofs, quad, xv``."""
        self._near, self._state = near, contact_state
        nc, n = len(contact_state.gap), len(near.nodes)
        self._work, self._dv = np.zeros((nc, lib.WR_ROW)), np.zeros((n, 3))
        self._info = np.zeros(2)
        ahead = near.exchange.ahead
        self._mass, self._xv = fixed["mass"], fixed["xv"]
        self._ahead = view("ahead", ahead, ahead.shape)
        h = contact_state.c
        names = "gap stiffness offset normal_force approach tangential_force slip touching"
        self._c = (
            h["friction"],
            fixed["xv"],
            self._ahead,
            fixed["mass"],
            fixed["dofs"],
            fixed["quad"],
            h["facet"],
            h["xi"],
            h["normal"],
            *(h[name] for name in names.split()),
            view("work", self._work, (nc, -1), out=True),
            view("dv", self._dv, (n, 3), out=True),
        )
        self._c_info = view("info", self._info, (2,), out=True)
        smooth = near.search.smooth
        curved = smooth.c[1:] if smooth else near.search.flat[1:]
        self._c_overlap = (fixed["xv"], fixed["quad"], *curved, h["facet"], h["xi"], h["normal"])

    def predict(self, force: Array, dt: float, kick: float, touching: int) -> None:
        """Find the gaps one step ahead; ``touching`` nodes pressed at the last step."""
        near, h = self._near, self._state
        if near.search.smooth:
            near.search.smooth.update(self._xv)
        h.total[4] = lib.wr_overlap(touching, h.c["touching"], *self._c_overlap)
        near.exchange.predict(force, self._mass, dt, kick)
        near.search.track(len(near.item), near.c_item, self._ahead, h.c)

    def solve(self, force: Array, dt: float, kick: float, fade: float) -> int:
        """Add the forces; return how many nodes touch.

        Raises:
            RuntimeError: if the sweeps do not converge.
        """
        h, near = self._state, self._near
        touching = lib.wr_lagrange(
            len(near.item),
            near.c_item,
            dt,
            kick,
            TOLERANCE,
            _SWEEPS,
            fade,
            *self._c,
            view("force", force, (-1,), out=True),
            h.c["total"],
            self._c_info,
        )
        if self.residual > _LOST:
            raise RuntimeError(
                f"contact pair {near.name}: Lagrange forces have not converged after "
                f"{_SWEEPS} sweeps, last move {self.residual:.1e} of the overlap"
            )
        return touching

    @property
    def sweeps(self) -> int:  # noqa: D102
        return int(self._info[0])

    @property
    def residual(self) -> float:  # noqa: D102
        return float(self._info[1])
