# SPDX-License-Identifier: LGPL-3.0-or-later
"""One pass of a contact: nodes or points of one surface on the facets of another."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array

from contact._kernel import ffi, lib
from contact.arrays import Index32, State, Vector, struct, view
from contact.candidates import Candidates
from contact.contact_state import ContactState
from contact.footprint import Footprint, footprint_of
from contact.friction import Coulomb, LawState, coefficients
from contact.implicit import Implicit
from contact.normal_law import node_foundation
from contact.options import IMPLICIT, Options
from contact.patches import beside, parted
from contact.search import Found
from contact.surface import Surface
from contact.tangent import RestSprings, shape_functions
from meshes.arrays import Array, Index

if TYPE_CHECKING:
    from mpi4py import MPI

ROUND_OFF = 1e-14  # share of the largest normal force below which a node bears none
STATIC = 10.0  # statics know no step, so springs that stand for a constraint can be this stiffer


@dataclass(frozen=True)
class Pressed:
    """Nodes of a surface that bear forces, as indices into its nodes; see :class:`Footprint`.

    Attributes:
        c: Nodes, shape ``(m,)``.
        normal: Directions of the normal forces, shape ``(m, 3)``.
        normal_force: Normal forces, shape ``(m,)`` [N].
        tangential_force: Tangential forces on the nodes, shape ``(m, 3)`` [N].
        slip: Slip against the other surface since the last step, shape ``(m, 3)`` [m].
        friction: Coefficients of friction, shape ``(m,)``.
        work: Work of the tangential forces on the slip, turned into heat, shape ``(m,)`` [J].
    """

    c: Index
    normal: Array
    normal_force: Array
    tangential_force: Array
    slip: Array
    friction: Array
    work: Array


class Pass:
    """Contactor nodes or points against target facets, see :class:`contact.pair.ContactPair`.

    Attributes:
        contactor, target: Its surfaces.
        options: Its options.
        candidates: Nodes, or points instead, that may touch.
        stack: Their numbers.
        contact_state: Contact of each of them.
        active: How many are in touch.
    """

    def __init__(
        self,
        contactor: Surface,
        target: Surface,
        options: Options,
        *,
        comm: "MPI.Comm | None" = None,
        name: str,
    ) -> None:
        """Set up the pass; collective.

        Args:
            contactor: Surface whose nodes touch.
            target: Surface whose facets are touched.
            options: Options, checked.
            comm: Ranks that share the surfaces; None for one process.
            name: Name of the pair for messages.
        """
        self.contactor, self.target = contactor, target
        self.options, self.dt, self.name = options, options.dt, name
        below = options.sharp_angle if options.smooth else None
        points_below = options.sharp_angle if options.points == "quadrature" else None
        self.candidates = Candidates(
            contactor, target, comm, options.reach, name, below, points_below
        )
        self.stack = self.candidates.stack
        implicit = options.method in IMPLICIT
        self.contact_state = ContactState(self.stack.nc, np.inf if implicit else options.tangential)
        self._c = self._bind()
        self._c_friction = view("friction", self.contact_state.friction, (-1,))
        self._implicit: Implicit | None = None
        if implicit:
            springs = options.method != "lagrange"
            self._implicit = Implicit(self.candidates, self.contact_state, self._c, springs)
        self.reset()

    def _bind(self) -> Any:
        """Return the pass for the kernel."""
        o, exchange, points = self.options, self.candidates.exchange, self.candidates.search.points
        c = struct(
            "wr_pass",
            target=self.candidates.search.c,
            xv=exchange.xv,
            mass=self.stack.mass,
            area=self.stack.area,
            dof=self.stack.dofs,
            per_mass=self._per_mass,
            per_area=o.penalty,
            damping=o.damping,
            tangential=o.tangential,
            **self._foundations(),
            **({} if points is None else {"points": points}),
        )
        return c

    @property
    def _per_mass(self) -> float:
        """Stiffness that springs are born with, over their effective mass [1/s²]."""
        o = self.options
        stiffer = STATIC if o.method == "lagrange" and not o.smooth else 1.0
        return o.penalty / self.dt**2 * stiffer

    def retime(self, dt: float) -> None:
        """Go on with another step [s]; springs that there are keep the stiffness of their birth."""
        self.dt = dt
        self._c.per_mass = self._per_mass

    def _foundations(self) -> dict[str, Array]:
        """Return the foundation moduli of both sides, nothing where springs follow the mass."""
        if self.options.method != "modulus-penalty":
            return {}
        contactor, target = node_foundation(self.contactor), self.target.foundation
        if target is None:
            raise ValueError(f"surface {self.target.name}: expected bulk moduli")
        return {"foundation_c": contactor, "foundation_t": target}

    def reset(self) -> None:
        """Forget all contact: no node touches, no force, nothing dissipated."""
        law = self.options.law
        self.contact_state.reset(law.friction if isinstance(law, Coulomb) else np.nan)
        self.candidates.forget()
        self.active = 0

    # ---- one step -------------------------------------------------------------------------

    def add(self, state: State, force: Vector, *, friction: bool = True) -> None:
        """Add the contact forces of the present state to ``force`` on owned dofs; collective.

        Args:
            state: ``u.x.array`` at t and ``v.x.array`` at t - dt/2, flat, block size 3 [m, m/s].
            force: ``array``, flat, block size 3 [N].
            friction: False in statics: normal springs only, a function of ``u`` alone, found
                by a new search wherever the bodies moved; drops the tangential forces.
        """
        h = self.contact_state
        coefficient = ffi.NULL
        if not friction:
            self._update_static(state)
        else:
            self.candidates.approach(state.u.x.array, state.v.x.array, self.dt, h)
            if self._implicit is not None:
                self._look_ahead(self._implicit, state, force.array)
                return
            self._update(self.dt, state.t)
            if not isinstance(self.options.law, Coulomb):
                self._apply_law(state.t)
            coefficient = self._c_friction
        c_force = view("force", force.array, (-1,), out=True)
        lib.wr_friction(self._c, h.c, self.active, coefficient, c_force)

    def _look_ahead(self, implicit: Implicit, state: State, force: Array) -> None:
        """Add the forces that fit the gaps at the next step."""
        begins = getattr(state, "step", 1) == 0
        if begins and self.active and self.options.method != "lagrange":
            # the springs of the state at rest: what is not quite right in the velocities that
            # a run begins with shall not jump into its first forces
            self._update(self.dt, state.t)
            c_force = view("force", force, (-1,), out=True)
            lib.wr_friction(self._c, self.contact_state.c, self.active, ffi.NULL, c_force)
            return
        # at the start v is at t, and the stepping takes half a step to get to t - dt/2
        kick = self.dt / 2 if begins else self.dt
        if np.isnan(self.contact_state.started):  # offsets are those of the present gaps
            self.candidates.track(self.candidates.exchange.c_xv, self.contact_state)
        fade = self._offsets(state.t)
        implicit.predict(force, self.dt, kick, self.active)
        if not isinstance(self.options.law, Coulomb):
            self._apply_law(state.t)
        self.active = implicit.solve(force, self.dt, kick, fade)

    def _update_static(self, state: State) -> None:
        """Find the contact of a state at rest."""
        self.candidates.update_static(state.u.x.array, self.contact_state)
        self.contact_state.tangential_force[:] = 0.0
        self.contact_state.started = np.nan
        self._update(0.0, state.t)

    def _update(self, dt: float, t: float) -> None:
        """Track the candidates and find their normal forces."""
        near, h = self.candidates, self.contact_state
        near.track(near.exchange.c_xv, h)
        fade = self._offsets(t) if dt > 0.0 else 0.0
        self.active = lib.wr_normal(self._c, near.found.c, h.c, dt, fade)

    def _offsets(self, t: float) -> float:
        """Set the offsets at the first step; return which part of them is left at ``t``."""
        always = self.options.initial_overlap == "offset"
        rest = self.options.method == "lagrange"  # without springs that could bear it
        return self.contact_state.faded(
            self.candidates.item, t, self.options.offset_time, always, rest
        )

    def _apply_law(self, t: float) -> None:
        """Set the coefficient of friction of the touching nodes."""
        h = self.contact_state
        c = h.touching[: self.active]
        slip = h.slip.take(c, axis=0)
        rate = np.sqrt(np.einsum("ia,ia->i", slip, slip)) / self.dt
        pressure = h.normal_force.take(c) / self.stack.area.take(c)
        state = LawState(t, self.dt, self.stack.node.take(c), h.friction.take(c))
        try:
            value = coefficients(self.options.law, rate, pressure, state)
        except ValueError as error:
            raise RuntimeError(f"contact pair {self.name}: {error}") from error
        h.friction[self.candidates.item] = np.nan
        h.friction[c] = value

    # ---- statics --------------------------------------------------------------------------

    def penetration(self, state: State, reach: float | None = None) -> tuple[float, int, Array]:
        """Return the deepest penetration [m], its HexMesh node and position ``(3,)`` [m].

        Depth 0 and node -1 where nothing penetrates; collective.

        Args:
            state: Displacements as in :meth:`add`; velocities are not read.
            reach: Depth up to which overlap is looked for [m]; a cell if None.
        """
        depth, c = self.candidates.deepest(state.u.x.array, reach)
        if c < 0:
            return 0.0, -1, np.zeros(3)
        return depth, int(self.stack.node[c]), self.candidates.exchange.xv[c, :3].copy()

    def springs_at_rest(self, state: State) -> RestSprings:
        """Return the springs of all candidates in statics, the same on all ranks; collective.

        Args:
            state: A state at rest, as for ``add(..., friction=False)``.
        """
        self._update_static(state)
        h, item = self.contact_state, self.candidates.item
        born = h.stiffness[item]
        stiffness = np.where(born > 0.0, born, self._stiffness_at_birth())
        seen = np.isfinite(h.gap[item])
        c = item[seen].astype(np.int64)
        return RestSprings(c, *self.joined(c, h), h.normal[c], h.gap[c], stiffness[seen])

    def _stiffness_at_birth(self) -> Array:
        """Return the normal stiffness that each candidate would begin with [N/m]."""
        h, near = self.contact_state, self.candidates
        mass, shared = self.effective_mass(near.found, h)
        if self.options.method != "modulus-penalty":
            return self._per_mass * mass
        moduli = self._foundations()
        behind = moduli["foundation_c"][near.item], moduli["foundation_t"][h.facet[near.item]]
        return self.options.penalty * shared * np.minimum(*behind)

    def joined(self, c: Index | Index32, state: ContactState) -> tuple[Index, Array]:
        """Return the HexMesh nodes that contacts ``c`` join, and their weights in the gap.

        Shapes ``(m, 5)``, or ``(m, 8)`` for points; those of the facet come last.
        """
        stacked, weight = self._joined(c, state)
        return self.stack.node[stacked], weight

    def _joined(self, c: Index | Index32, state: ContactState) -> tuple[Index, Array]:
        """Return the same with the nodes' numbers in the stack."""
        stacked = np.hstack([self.stack.behind(c), self.candidates.search.quad[state.facet[c]]])
        return stacked, np.hstack([self.stack.weights(c), -shape_functions(state.xi[c])])

    def velocity(self, c: Index, state: State) -> Array:
        """Return the velocity of contacts ``c`` against the target, ``(m, 3)`` [m/s]; collective.

        The contacts are those of the present displacement. The spin of the facet times the gap,
        which friction leaves out in a step, is left in: it is small against any slip.
        """
        self.candidates.exchange.whole(state.u.x.array, state.v.x.array)
        stacked, weight = self._joined(c, self.contact_state)
        return np.einsum("mi,mia->ma", weight, self.candidates.exchange.xv[stacked, 3:])

    def effective_mass(self, found: Found, state: ContactState) -> tuple[Array, Array]:
        """Return the effective mass [kg] of candidates and the area that both sides bring [m2].

        Args:
            found: ``k`` candidates.
            state: Their closest points.

        Returns:
            Shapes ``(k,)``.
        """
        mass, shared = np.empty((2, len(found.item)))
        c_mass = view("mass", mass, (-1,), out=True)
        c_shared = view("shared", shared, (-1,), out=True)
        lib.wr_effective_mass(self._c, found.c, state.c, c_mass, c_shared)
        return mass, shared

    # ---- results --------------------------------------------------------------------------

    def surfaces(self, u: Array, v: Array) -> tuple[Array, Array]:
        """Return position and velocity of all nodes [m, m/s]; collective.

        Args:
            u: Displacement at the last step, flat, owned dofs first [m].
            v: Velocity [m/s].

        Returns:
            Contactor ``(nc, 6)`` and target ``(nt, 6)``.
        """
        self.candidates.exchange.whole(u, v)
        xv = self.candidates.exchange.xv
        return xv[self.stack.contactor].copy(), xv[self.stack.target].copy()

    def pressed(self) -> Pressed:
        """Return the contactor's nodes that bear forces at the last step, ascending.

        Forces on points are those on the nodes of their facets; slip and coefficient of friction
        are means over the points round a node, weighted with their normal forces.
        """
        h, c, points = self.contact_state, self._bearing(), self.stack.points
        if points is None:
            p, t, n, slip = h.normal_force[c], h.tangential_force[c], h.normal[c], h.slip[c]
            return Pressed(c, n, p, t, slip, h.friction[c], -np.einsum("ca,ca->c", t, slip))
        return self._shared(c, points.node[c], points.weight[c], 1.0)

    def reacting(self) -> Pressed:
        """Return the target's nodes that bear the reactions at the last step, ascending.

        A reaction is shared by the nodes of its facet as in the step; slip, seen from the target,
        and coefficient of friction are means weighted with the normal forces.
        """
        h, c = self.contact_state, self._bearing()
        return self._shared(c, self.target.facets[h.facet[c]], shape_functions(h.xi[c]), -1.0)

    def _bearing(self) -> Index:
        """Return what bears forces, nodes or points, ascending."""
        h = self.contact_state
        c = np.sort(h.touching[: self.active].astype(np.int64))
        return np.asarray(c[h.normal_force[c] > 0.0])

    def _shared(self, c: Index, node: Index | Index32, weight: Array, sign: float) -> Pressed:
        """Return the nodes that share the forces on ``c``, or with ``sign`` -1 their reactions.

        Args:
            c: Nodes or points that bear forces, shape ``(m,)``.
            node: Nodes that share each, shape ``(m, 4)``.
            weight: Their shares, shape ``(m, 4)``.
            sign: Of forces and slip.
        """
        h = self.contact_state
        p, t, n, slip = h.normal_force[c], h.tangential_force[c], h.normal[c], h.slip[c]
        nodes, place = np.unique(node, return_inverse=True)
        entries = weight.ravel(), (place.ravel(), np.repeat(np.arange(len(c)), 4))
        share = coo_array(entries, (len(nodes), len(c))).tocsr()
        bears = share @ p > ROUND_OFF * p.max(initial=0.0)  # a node opposite to one that is hit
        nodes, share = nodes[bears], share[bears]
        mean = 1.0 / (share @ p)
        normal = sign * (share @ (p[:, None] * n))
        normal_force = np.linalg.norm(normal, axis=1)
        return Pressed(
            nodes.astype(np.int64),
            normal / normal_force[:, None],
            normal_force,
            sign * (share @ t),
            sign * mean[:, None] * (share @ (p[:, None] * slip)),
            mean * (share @ (p * h.friction[c])),
            share @ -np.einsum("ca,ca->c", t, slip),
        )

    def forces(self) -> tuple[Index32, Array]:
        """Return touching contactor nodes and the normal and tangential force on each [N].

        Shapes ``(m,)`` and ``(m, 6)``; called at every step.
        """
        h = self.contact_state
        if self.stack.points is not None:
            on = self.pressed()
            return on.c.astype(np.int32), np.hstack(
                [on.normal_force[:, None] * on.normal, on.tangential_force]
            )
        c = h.touching[: self.active]
        force = np.empty((len(c), 6))
        np.multiply(h.normal.take(c, axis=0), h.normal_force.take(c)[:, None], out=force[:, :3])
        h.tangential_force.take(c, axis=0, out=force[:, 3:])
        return c, force

    def footprint(self, stick_tolerance: float = 0.05) -> Footprint:
        """Return the nodes in contact at the last step and their patches, same on all ranks.

        Args:
            stick_tolerance: A node adheres where ``friction * F_n - |F_t|`` exceeds this
                fraction of the largest tangential nodal force [-].
        """
        return self.footprint_on(self.pressed(), stick_tolerance)

    def footprint_on(self, on: Pressed, stick_tolerance: float) -> Footprint:
        """Return the footprint of the nodes that bear forces."""
        neighbours = beside(self.contactor.facets, on.c, len(self.contactor.nodes))
        start = self.stack.contactor.start
        area = self.stack.area[start + on.c]
        return footprint_of(
            self.contactor.nodes[on.c],
            self.candidates.exchange.xv[start + on.c, :3],
            on.normal,
            on.normal_force,
            on.tangential_force,
            area,
            on.slip / self.dt,
            on.friction,
            on.work / self.dt,
            parted(on.normal_force / area, neighbours),
            stick_tolerance,
        )

    def nodal_forces(self) -> tuple[Index, Array, Array]:
        """Return touching nodes ``(m,)``, the forces on them [N] and their normals ``(m, 3)``."""
        h = self.contact_state
        c = h.touching[: self.active].astype(np.int64)
        return c, h.normal_force[c, None] * h.normal[c] + h.tangential_force[c], h.normal[c]

    def facet_forces(self) -> tuple[Index, Array, Array]:
        """Return the reactions of the touching nodes on the target.

        Returns:
            Target nodes ``(m, 4)``, reactions on them ``(m, 4, 3)`` [N] and the direction away
            from the target's body ``(m, 3)``.
        """
        h = self.contact_state
        c, force, normal = self.nodal_forces()
        reaction = -shape_functions(h.xi[c])[:, :, None] * force[:, None]
        return self.target.facets[h.facet[c]].astype(np.int64), reaction, -normal

    # ---- memory ---------------------------------------------------------------------------

    def memory(self) -> dict[str, npt.NDArray[Any]]:
        """Return all that the next step depends on, for a checkpoint; the same on all ranks."""
        active = {"active": np.array([self.active])}
        return self.contact_state.saved() | self.candidates.saved() | active

    def restore(self, memory: dict[str, npt.NDArray[Any]]) -> None:
        """Go on from what :meth:`memory` returned, on any number of ranks."""
        self.contact_state.load(memory)
        self.candidates.load(memory, self.contact_state)
        self.active = int(memory["active"][0])
