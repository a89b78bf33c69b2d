# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact in two passes: each surface is once contactor and once target, with half the penalty.

One pass sees the nodes of one surface only, and loads the other as these happen to lie on it. Two
passes treat both alike, which evens out the pressure where the meshes do not match.
"""

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from contact.footprint import Footprint
from contact.friction import Law
from contact.pair import ContactPair
from contact.state import State, Vector
from contact.surface import Surface
from contact.tangent import shape_functions

if TYPE_CHECKING:
    from mpi4py import MPI

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.int64]


class TwoPass:
    """Both passes of a pair, with the interface of :class:`contact.pair.ContactPair`.

    Attributes:
        passes: The contactor's nodes on the target, and the target's on the contactor.
    """

    def __init__(
        self,
        contactor: Surface,
        target: Surface,
        *,
        comm: "MPI.Comm | None" = None,
        dt: float,
        friction: float | Law = 0.0,
        penalty: float = 0.2,
        damping: float = 0.0,
        method: str = "penalty",
        name: str = "",
        **options: Any,
    ) -> None:
        """Set up both passes; collective. Arguments as for a pair, which gets ``options``.

        Raises:
            ValueError: if a surface is rigid or the method is ``lagrange``.
        """
        self.name = name or f"{contactor.name} on {target.name}"
        if contactor.rigid or target.rigid:
            raise ValueError(f"contact pair {self.name}: two passes need two deformable surfaces")
        if method == "lagrange":
            raise ValueError("two_pass: expected a penalty method; constraints of both sides clash")
        self.passes = tuple(
            ContactPair(
                one, other, comm=comm, dt=dt, friction=friction, penalty=penalty / 2,
                damping=damping / 2**0.5, method=method, name=self.name, **options,
            )
            for one, other in ((contactor, target), (target, contactor))
        )  # fmt: skip
        self.contactor, self.target, self.dt, self.last = contactor, target, dt, False

    phase = "contact"

    def energy(self, state: Any) -> dict[str, float]:
        """Return the terms of the ledger [J]."""
        return {
            "contact": self.stored_energy,
            "contact_normal": self.normal_energy,
            "contact_tangential": self.tangential_energy,
            "friction_dissipation": self.friction_dissipation,
            "damping": self.damping_dissipation,
        }

    def rest(self, state: Any, force: Any) -> None:
        """Add the forces in statics."""
        self.add(state, force, friction=False)

    def reset(self) -> None:
        """Forget all contact."""
        for side in self.passes:
            side.reset()

    def add(self, state: State, force: Vector, *, friction: bool = True) -> None:
        """Add the forces of both passes, see :meth:`contact.pair.ContactPair.add`."""
        for side in self.passes:
            side.add(state, force, friction=friction)

    def penetration(self, state: State, reach: float | None = None) -> tuple[float, int, Array]:
        """Return the deepest penetration of both passes [m], its node and position [m]."""
        found = [side.penetration(state, reach) for side in self.passes]
        return max(found, key=lambda entry: entry[0])

    def tangent(self, state: State, stick: bool = False) -> tuple[Index, Index, Array]:
        """Return the stiffness of both passes as triplets."""
        both = [side.tangent(state, stick) for side in self.passes]
        rows, columns, blocks = (np.concatenate(parts) for parts in zip(*both, strict=True))
        return rows, columns, blocks

    def _sum(self, key: str) -> float:
        return float(sum(getattr(side, key) for side in self.passes))

    @property
    def active(self) -> int:
        """Nodes in touch, of both surfaces."""
        return sum(side.active for side in self.passes)

    @property
    def friction_dissipation(self) -> float:
        """Work turned into heat by friction [J]."""
        return self._sum("friction_dissipation")

    @property
    def damping_dissipation(self) -> float:
        """Work turned into heat by normal damping [J]."""
        return self._sum("damping_dissipation")

    @property
    def normal_energy(self) -> float:
        """Energy of the normal springs [J]."""
        return self._sum("normal_energy")

    @property
    def tangential_energy(self) -> float:
        """Energy of the tangential springs [J]."""
        return self._sum("tangential_energy")

    @property
    def stored_energy(self) -> float:
        """Energy of all springs [J]."""
        return self._sum("stored_energy")

    @property
    def normal_force(self) -> float:
        """Sum of the nodal normal forces [N]."""
        return self._sum("normal_force")

    @property
    def max_penetration(self) -> float:
        """Deepest penetration at the last step [m]."""
        return max(side.max_penetration for side in self.passes)

    @property
    def initial_offsets(self) -> tuple[int, float]:
        """Nodes whose overlap at the start does not count, and the deepest [m]."""
        count, depth = zip(*(side.initial_offsets for side in self.passes), strict=True)
        return sum(count), max(depth)

    @property
    def normal_resultant(self) -> Array:
        """Vector sum of the normal forces on the contactor, shape ``(3,)`` [N]."""
        return self.passes[0].normal_resultant - self.passes[1].normal_resultant

    @property
    def tangential_force(self) -> Array:
        """Vector sum of the tangential forces on the contactor, shape ``(3,)`` [N]."""
        return self.passes[0].tangential_force - self.passes[1].tangential_force

    def footprint(self, stick_tolerance: float = 0.05) -> Footprint:
        """Return the contactor's nodes with what both passes press on them.

        Slip and coefficient of friction are those of the first pass, zero at nodes that only the
        second one presses on.
        """
        one, two = self.passes
        nodes, force, normal = _nodal(one)
        reaction, back, spread = _on_facets(two)
        total, direction = np.zeros((2, len(self.contactor.nodes), 3))
        total[nodes], direction[nodes] = force, normal
        for corner in range(4):
            np.add.at(total, spread[:, corner], reaction[:, corner])
            np.add.at(direction, spread[:, corner], back)
        size = np.linalg.norm(direction, axis=1)
        direction /= np.where(size > 0.0, size, 1.0)[:, None]
        pressing = np.einsum("ia,ia->i", total, direction)
        c = np.flatnonzero(pressing > 0.0)
        traction = total[c] - pressing[c, None] * direction[c]
        return one.footprint_on(c, direction[c], pressing[c], traction, stick_tolerance)

    def surfaces(self, u: Array, v: Array) -> tuple[Array, Array]:
        """Return position and velocity of all nodes, see :class:`contact.pair.ContactPair`."""
        return self.passes[0].surfaces(u, v)

    def memory(self) -> dict[str, npt.NDArray[Any]]:
        """Return all that the next step depends on; the second pass's names end in a tick."""
        one, two = (side.memory() for side in self.passes)
        return one | {f"{key}'": value for key, value in two.items()}

    def restore(self, memory: dict[str, npt.NDArray[Any]]) -> None:
        """Go on from what :meth:`memory` returned."""
        one, two = self.passes
        one.restore({key: value for key, value in memory.items() if not key.endswith("'")})
        two.restore({key[:-1]: value for key, value in memory.items() if key.endswith("'")})


def _nodal(side: ContactPair) -> tuple[Index, Array, Array]:
    """Return the touching nodes of a pass, the forces on them and their normals."""
    h = side.history
    c = h.touching[: side.active].astype(np.int64)
    return c, h.pressing[c, None] * h.normal[c] + h.traction[c], h.normal[c]


def _on_facets(side: ContactPair) -> tuple[Array, Array, Index]:
    """Return the reactions of a pass on the corners of its facets, ``(m, 4, 3)`` [N].

    With them the direction of each, away from the facet's body, ``(m, 3)``, and the surface nodes,
    ``(m, 4)``.
    """
    h = side.history
    c, force, normal = _nodal(side)
    facet = h.facet[c]
    share = -shape_functions(h.xi[c])[:, :, None] * force[:, None]
    return share, -normal, side.target.facets[facet].astype(np.int64)
