# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact forces that fit the gaps at the end of the step: multipliers, and implicit springs.

At t all forces but those of the contact are known, and with them where the nodes would be at
t + dt. The closest points are found there, and forces are added at t such that each node that would
overlap ends on the target (Carpenter, Taylor, Katona, Int. J. Numer. Meth. Eng. 32, 1991), or where
its spring bears its force; none pulls, and slip stops where friction can stop it. Nodes that share
a facet are coupled; projected Gauss-Seidel solves for them, starting from the forces of the last
step.

A spring taken so is stable at any stiffness. As a backward step does, it damps what the grid can
barely resolve, and leaves motions that are slow beside the spring alone.

Energy: the work of the forces is counted as the leapfrog does it, on the positions and velocities
at which it is done. What neither springs hold nor friction turns into heat is counted with the
damping: landing is a plastic impact of the surface nodes alone, whose loss falls with the size of
the cells.
"""

from typing import Any

import numpy as np

from contact._kernel import ffi, lib
from contact.arrays import struct, view
from contact.candidates import Candidates
from contact.contact_state import ContactState
from meshes.arrays import Array

TOLERANCE = 1e-10  # last move of the sweeps over the deepest overlap that they remove
_SWEEPS = 200
_LOST = 1e-3  # with a larger last move the forces mean nothing


class Implicit:
    """The solver of one pass.

    Attributes:
        sweeps: Gauss-Seidel sweeps of the last step.
        residual: Their last move over the deepest overlap [-].
    """

    def __init__(
        self, candidates: Candidates, state: ContactState, c_pass: Any, springs: bool
    ) -> None:
        """Bind candidates and state of a pass to ``c_pass``, the pass for the kernel.

        With ``springs`` the contacts give way by their stiffness, else not.
        """
        self._candidates, self._state, self._c_pass = candidates, state, c_pass
        nc, n = candidates.search.nc, candidates.search.n
        self._solver = struct(
            "wr_solver",
            tolerance=TOLERANCE,
            most=_SWEEPS,
            springs=int(springs),
            ahead=candidates.exchange.ahead,
            row=ffi.new("wr_row[]", nc),
            dv=np.zeros((n, 3)),
        )

    def predict(self, force: Array, dt: float, kick: float, touching: int) -> None:
        """End the last step, at which ``touching`` nodes pressed, and find the gaps one ahead."""
        near, state = self._candidates, self._state
        near.search.bend(near.found, near.exchange.c_xv)
        lib.wr_settle(self._c_pass, state.c, touching, dt)
        near.exchange.predict(self._c_pass, force, dt, kick)
        near.follow(near.exchange.c_ahead, state)

    def solve(self, force: Array, dt: float, kick: float, fade: float) -> int:
        """Add the forces; return how many nodes touch.

        Raises:
            RuntimeError: if the sweeps do not converge.
        """
        touching = lib.wr_implicit(
            self._c_pass,
            self._candidates.found.c,
            self._state.c,
            self._solver,
            dt,
            kick,
            fade,
            view("force", force, (-1,), out=True),
        )
        if self.residual > _LOST:
            raise RuntimeError(
                f"contact pair {self._candidates.name}: forces have not converged after "
                f"{_SWEEPS} sweeps, last move {self.residual:.1e} of the overlap"
            )
        return int(touching)

    @property
    def sweeps(self) -> int:  # noqa: D102
        return int(self._solver.sweeps)

    @property
    def residual(self) -> float:  # noqa: D102
        return float(self._solver.residual)
