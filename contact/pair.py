# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact of two surfaces: normal force and friction, ``add(state, force)``."""

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from contact._kernel import ffi, lib
from contact.arrays import view
from contact.friction import Coulomb, Law, LawState, as_law, coefficients
from contact.history import History
from contact.lagrange import Lagrange
from contact.neighbourhood import Neighbourhood
from contact.normal_law import checked, node_foundation
from contact.state import State, Vector
from contact.surface import Surface, tributary_area
from contact.tangent import stiffness_blocks
from contact.totals import Totals

if TYPE_CHECKING:
    from mpi4py import MPI

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.int64]


STATIC = 10.0  # statics know no step, so springs that stand for a constraint can be this stiffer


class ContactPair(Totals):
    r"""Contactor nodes against target facets.

    1. The gap :math:`g` of a node is its signed distance from the closest point of the target,
       negative when penetrating; :math:`n` is the target's normal there.
    2. Normal force :math:`F_n = \max(0, k_n (-g) + c\,\dot g_{closing})` with
       :math:`k_n = penalty \cdot m_{eff} / dt^2` or from the bulk modulus, fixed from the birth of
       the contact to its release, and :math:`c = 2\,damping \sqrt{k_n m_{eff}}`; or a Lagrange
       multiplier that leaves no gap (:mod:`contact.normal_law`).
    3. Effective mass :math:`1/m_{eff} = 1/m_c + s \sum N_i / m_i`; s >= 1 contactor nodes share
       one target node.
    4. Trial traction :math:`t - k_t \Delta s`, :math:`k_t = tangential \cdot k_n`; the slip is
       the relative velocity less the spin of the facet, so rigid rotation of both gives none.
    5. Radial return to :math:`|F_t| \le friction\,F_n` (Wriggers, Computational Contact
       Mechanics, 2nd ed., sec. 5.2). The traction turns with the facet and is carried across
       facets.
    6. The reaction is spread over the facet by N_i, with a couple that balances the moment:
       forces and moments of the pair sum to zero.

    All ranks hold the same contact; forces go to owned dofs only.
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
        tangential: float = 1.0,
        reach: float | None = None,
        method: str = "penalty",
        smooth: bool = False,
        sharp_angle: float = 0.7,
        initial_overlap: str = "push",
        offset_time: float = 0.0,
        name: str = "",
    ) -> None:
        """Set up the pair; collective.

        Args:
            contactor: Surface whose nodes touch.
            target: Surface whose facets are touched.
            comm: Ranks that share the surfaces; None for one process.
            dt: Time step [s].
            friction: Coefficient of friction or a law, see :mod:`contact.friction`.
            penalty: Normal stiffness times dt^2 over the effective mass, or over that of the
                cells behind with ``modulus-penalty``; with ``lagrange`` for statics only [-].
            damping: Normal damping as a fraction of critical [-].
            tangential: Tangential over normal stiffness [-].
            reach: Deepest penetration at which contact can begin [m]; half a cell if None.
            method: ``penalty``, ``modulus-penalty`` or ``lagrange``; the last must be added when
                ``force`` holds all other forces on owned dofs.
            smooth: Curve the target's facets by their averaged normals.
            sharp_angle: Facets of a smooth target that meet at more keep their edge [rad].
            initial_overlap: What becomes of nodes that overlap at the first step and not from a
                static solve: ``push`` (their springs push) or ``offset`` (it does not count).
            offset_time: Time over which offsets fade to none; kept until release if 0 [s].
            name: Name for messages.
        """
        self.name = name or f"{contactor.name} on {target.name}"
        if contactor.rigid and target.rigid:
            raise ValueError(f"contact pair {self.name}: both surfaces are rigid")
        checked(
            method, dt=dt, penalty=penalty, tangential=tangential, damping=damping,
            offset_time=offset_time, sharp_angle=sharp_angle, initial_overlap=initial_overlap,
        )  # fmt: skip
        self.contactor, self.target = contactor, target
        self.dt, self.penalty, self.damping, self.tangential = dt, penalty, damping, tangential
        self.law = as_law(friction)
        self.method, self.initial_overlap, self.offset_time = method, initial_overlap, offset_time
        below = sharp_angle if smooth else None
        self.near = Neighbourhood(contactor, target, comm, reach, self.name, below)
        self.area = np.concatenate([tributary_area(contactor), tributary_area(target)])
        lasting = method == "lagrange"
        self.history = History(len(contactor.nodes), np.inf if lasting else tangential)
        self._bind()
        self._lagrange = Lagrange(self.near, self.history, self._fixed) if lasting else None
        self.reset()

    def _bind(self) -> None:
        """Collect the arguments of the kernel calls that stay the same."""
        n = len(self.area)
        self._mass = np.concatenate([self.contactor.mass, self.target.mass])
        self._dofs = np.concatenate([self.contactor.dofs, self.target.dofs])
        arrays: dict[str, npt.NDArray[Any]] = {
            "xv": self.near.exchange.xv, "mass": self._mass, "area": self.area, "dofs": self._dofs,
            "quad": self.near.search.quad,
        }  # fmt: skip
        assert self._mass.shape == self._dofs.shape == (n,)
        self._fixed = {key: view(key, a, a.shape, a.dtype) for key, a in arrays.items()}
        self._bed = (ffi.NULL, ffi.NULL)
        if self.method == "modulus-penalty":
            bed = node_foundation(self.contactor)
            if self.target.foundation is None:
                raise ValueError(f"surface {self.target.name}: expected bulk moduli")
            self._bed = view("bed", bed, (-1,)), view("bed", self.target.foundation, (-1,))
        c = self.history.c | self._fixed
        normal = "xv mass area quad facet xi normal gap stiffness damper offset"
        normal += " pressing drag traction slip touching total"
        friction = "xv mass dofs quad facet xi gap normal stiffness pressing slip traction"
        self._c_normal = tuple(c[key] for key in normal.split())
        self._c_friction = tuple(c[key] for key in friction.split())

    def reset(self) -> None:
        """Forget all contact: no node touches, no traction, nothing dissipated."""
        self.history.clear()
        self.history.total[:] = 0.0
        self.history.started[:] = np.nan
        constant = self.law.friction if isinstance(self.law, Coulomb) else np.nan
        self.history.friction[:] = constant
        self.near.forget()
        self.active = 0

    # ---- one step -------------------------------------------------------------------------

    @property
    def last(self) -> bool:
        """Whether :meth:`add` needs all other forces, complete on owned dofs."""
        return self._lagrange is not None

    def add(self, state: State, force: Vector, *, friction: bool = True) -> None:
        """Add the contact forces of the present state to ``force`` on owned dofs; collective.

        Args:
            state: ``u.x.array`` at t and ``v.x.array`` at t - dt/2, flat, block size 3 [m, m/s].
            force: ``array``, flat, block size 3 [N].
            friction: False in statics: normal springs only, a function of ``u`` alone, found
                by a new search wherever the bodies moved; drops the tangential history.
        """
        if not friction:
            m = self._settle(state)
            coefficient = view("none", np.zeros(len(self.history.gap)), (-1,))
        else:
            self.near.approach(state.u.x.array, state.v.x.array, self.dt, self.history)
            if self._lagrange is not None:
                self._close(self._lagrange, state, force.array)
                return
            m = self._press(self.dt, state.t)
            if not isinstance(self.law, Coulomb):
                self._apply_law(m, state.t)
            coefficient = self.history.c["friction"]
        lib.wr_friction(
            m, self.history.c["touching"], self.tangential, coefficient, *self._c_friction,
            view("force", force.array, (-1,), out=True), self.history.c["total"],
        )  # fmt: skip

    def _close(self, lagrange: Lagrange, state: State, force: Array) -> None:
        """Add the forces that leave no gap at the next step."""
        near = self.near
        # at the start v is at t, and the stepping takes half a step to get to t - dt/2
        kick = self.dt / 2 if getattr(state, "step", 1) == 0 else self.dt
        if np.isnan(self.history.started[0]):  # offsets are those of the present gaps
            near.search.track(len(near.item), near.c_item, self._fixed["xv"], self.history.c)
        fade = self._offsets(state.t)
        lagrange.predict(force, self.dt, kick, self.active)
        if not isinstance(self.law, Coulomb):
            self._apply_law(self.active, state.t)
        self.active = lagrange.solve(force, self.dt, kick, fade)

    def _settle(self, state: State) -> int:
        """Find the contact of a state at rest; return the number of touching nodes."""
        self.near.settle(state.u.x.array, self.history)
        self.history.traction[:] = 0.0
        self.history.started[:] = np.nan
        return self._press(0.0, state.t)

    def _press(self, dt: float, t: float) -> int:
        """Track the candidates and find their normal forces; return how many touch."""
        near, k = self.near, len(self.near.item)
        near.search.track(k, near.c_item, self._fixed["xv"], self.history.c)
        per_mass = self.penalty / self.dt**2
        if self._lagrange is not None:
            per_mass *= 1.0 if self.near.search.smooth else STATIC
        fade = self._offsets(t) if dt > 0.0 else 0.0
        self.active = lib.wr_normal(
            k, near.c_item, dt, per_mass, self.penalty, self.damping, self.tangential, fade,
            *self._bed, *self._c_normal,
        )  # fmt: skip
        return self.active

    def _offsets(self, t: float) -> float:
        """Set the offsets at the first step; return which part of them is left at ``t``."""
        always = self.initial_overlap == "offset"
        rest = self._lagrange is not None
        return self.history.faded(self.near.item, t, self.offset_time, always, rest)

    def _apply_law(self, m: int, t: float) -> None:
        h = self.history
        c = h.touching[:m]
        slip = h.slip.take(c, axis=0)
        rate = np.sqrt(np.einsum("ia,ia->i", slip, slip)) / self.dt
        pressure = h.pressing.take(c) / self.area.take(c)
        state = LawState(t, self.dt, self.contactor.nodes.take(c), h.friction.take(c))
        try:
            value = coefficients(self.law, rate, pressure, state)
        except ValueError as error:
            raise RuntimeError(f"contact pair {self.name}: {error}") from error
        h.friction[self.near.item] = np.nan
        h.friction[c] = value

    # ---- statics --------------------------------------------------------------------------

    def penetration(self, state: State, reach: float | None = None) -> tuple[float, int, Array]:
        """Return the deepest penetration [m], its HexMesh node and position ``(3,)`` [m].

        Depth 0 and node -1 where nothing penetrates; collective.

        Args:
            state: Displacements as in :meth:`add`; velocities are not read.
            reach: Depth up to which overlap is looked for [m]; a cell if None.
        """
        depth, c = self.near.deepest(state.u.x.array, reach)
        if c < 0:
            return 0.0, -1, np.zeros(3)
        return depth, int(self.contactor.nodes[c]), self.near.exchange.xv[c, :3].copy()

    def tangent(self, state: State, stick: bool = False) -> tuple[Index, Index, Array]:
        """Return the contact stiffness as triplets of HexMesh nodes, the same on all ranks.

        Args:
            state: A state at rest, as for ``add(..., friction=False)``.
            stick: Add the tangential stiffness of nodes that do not slip.

        Returns:
            See :func:`contact.tangent.stiffness_blocks`.
        """
        h = self.history
        c = h.touching[: self._settle(state)]
        nodes = self.near.nodes
        nodes = np.column_stack([nodes[c], nodes[self.near.search.quad[h.facet[c]]]])
        kn = h.stiffness[c]
        kt = self.tangential * kn if stick else 0.0
        return stiffness_blocks(nodes, h.xi[c], h.normal[c], kn, kt)

    # ---- results --------------------------------------------------------------------------

    def surfaces(self, u: Array, v: Array) -> tuple[Array, Array]:
        """Return position and velocity of all nodes [m, m/s]; collective.

        Args:
            u: Displacement at the last step, flat, owned dofs first [m].
            v: Velocity [m/s].

        Returns:
            Contactor ``(nc, 6)`` and target ``(nt, 6)``.
        """
        self.near.exchange.whole(u, v)
        xv, nc = self.near.exchange.xv.copy(), len(self.contactor.nodes)
        return xv[:nc], xv[nc:]

    # ---- memory ---------------------------------------------------------------------------

    def memory(self) -> dict[str, npt.NDArray[Any]]:
        """Return all that the next step depends on, for a checkpoint; the same on all ranks."""
        own = {"own": np.array([self.active, self.history.started[0]])}
        return self.history.saved() | self.near.saved() | own

    def restore(self, memory: dict[str, npt.NDArray[Any]]) -> None:
        """Go on from what :meth:`memory` returned, on any number of ranks."""
        self.history.load(memory)
        self.near.load(memory)
        active, self.history.started[0] = memory["own"]
        self.active = int(active)
