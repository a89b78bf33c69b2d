# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact of two surfaces: normal force and friction, ``add(state, force)``."""

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from contact.arrays import State, Vector
from contact.footprint import Footprint, stick_zone
from contact.friction import Law, as_law
from contact.one_pass import Pass, Pressed
from contact.options import IMPLICIT, Options
from contact.surface import Surface
from contact.tangent import RestSprings
from meshes.arrays import Array

if TYPE_CHECKING:
    from mpi4py import MPI


class ContactPair:
    r"""Contactor nodes against target facets, in one pass or in two.

    1. The gap :math:`g` of a node is its signed distance from the closest point of the target,
       negative when penetrating; :math:`n` is the target's normal there.
    2. Normal force :math:`F_n = \max(0, k_n (-g) + c\,\dot g_{closing})` with
       :math:`k_n = penalty \cdot m_{eff} / dt^2` or from the bulk modulus, fixed from the birth of
       the contact to its release, and :math:`c = 2\,damping \sqrt{k_n m_{eff}}`; or a Lagrange
       multiplier that leaves no gap (:mod:`contact.normal_law`).
    3. Effective mass :math:`1/m_{eff} = 1/m_c + s \sum N_i / m_i`; s >= 1 contactor nodes share
       one target node.
    4. Trial tangential force :math:`t - k_t \Delta s`, :math:`k_t = tangential \cdot k_n`; the slip
       is the relative velocity less the spin of the facet, so rigid rotation of both gives none.
    5. Radial return to :math:`|F_t| \le friction\,F_n` (Wriggers, Computational Contact
       Mechanics, 2nd ed., sec. 5.2). The force turns with the facet and is carried across
       facets.
    6. The reaction is spread over the facet by N_i, with a couple that balances the moment:
       forces and moments of the pair sum to zero.

    One pass sees the nodes of one surface only, and loads the other as these happen to lie on it.
    Two passes treat both alike, each surface once contactor and once target with half the penalty,
    which evens out the pressure where the meshes do not match.

    All ranks hold the same contact and share the search; forces go to owned dofs only.

    Attributes:
        passes: The contactor's nodes on the target and, in two passes, the target's on the
            contactor.
        contactor, target: Its surfaces.
        dt: Time step [s].
        last: Whether :meth:`add` needs all other forces, complete on owned dofs.
        phase: What the time of :meth:`add` counts to.
    """

    phase = "contact"

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
        two_pass: bool = False,
        points: str = "nodes",
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
            method: ``penalty``, ``modulus-penalty``, ``implicit-penalty``, ``lagrange``; the last
                two must be added when ``force`` holds all other forces on owned dofs.
            smooth: Curve the target's facets by their averaged normals.
            sharp_angle: Facets that meet at more keep their edge [rad].
            initial_overlap: What becomes of nodes that overlap at the first step and not from a
                static solve: ``push`` (their springs push) or ``offset`` (it does not count).
            offset_time: Time over which offsets fade to none; kept until release if 0 [s].
            two_pass: Make each surface contactor once; both deformable, ``penalty`` or
                ``modulus-penalty`` only.
            points: What touches the target: the contactor's ``nodes``, or 2 x 2 Gauss points in
                each of its facets (``quadrature``), which load the nodes of the facet; with
                ``penalty`` and ``implicit-penalty`` in one pass, contactor deformable.
            name: Name for messages.

        Raises:
            ValueError: if an option does not fit, or the surfaces do not.
        """
        self.name = name or f"{contactor.name} on {target.name}"
        self.contactor, self.target, self.dt = contactor, target, dt
        options = Options(
            dt=dt,
            law=as_law(friction),
            penalty=penalty,
            damping=damping,
            tangential=tangential,
            reach=reach,
            method=method,
            smooth=smooth,
            sharp_angle=sharp_angle,
            initial_overlap=initial_overlap,
            offset_time=offset_time,
            points=points,
        )
        self.last = method in IMPLICIT
        sides = [(contactor, target)]
        if contactor.rigid and target.rigid:
            raise ValueError(f"contact pair {self.name}: both surfaces are rigid")
        if points != "nodes" and (two_pass or contactor.rigid):
            raise ValueError(
                f"contact pair {self.name}: points = {points!r}: expected one pass and a "
                "deformable contactor"
            )
        if two_pass:
            self._check_two_passes()
            options = replace(options, penalty=penalty / 2, damping=damping / 2**0.5)
            sides.append((target, contactor))
        self.passes = tuple(
            Pass(one, other, options, comm=comm, name=self.name) for one, other in sides
        )

    def _check_two_passes(self) -> None:
        if self.contactor.rigid or self.target.rigid:
            raise ValueError(f"contact pair {self.name}: two passes need two deformable surfaces")
        if self.last:
            raise ValueError(
                "two_pass: expected a penalty method, penalty or modulus-penalty; forces that fit "
                "the gaps at the end of the step are solved for in one pass"
            )

    def reset(self) -> None:
        """Forget all contact: no node touches, no force, nothing dissipated."""
        for side in self.passes:
            side.reset()

    def retime(self, dt: float) -> None:
        """Go on with another step [s]; springs that there are keep the stiffness of their birth."""
        self.dt = dt
        for side in self.passes:
            side.retime(dt)

    def add(self, state: State, force: Vector, *, friction: bool = True) -> None:
        """Add the contact forces of the present state to ``force`` on owned dofs; collective.

        Args:
            state: ``u.x.array`` at t and ``v.x.array`` at t - dt/2, flat, block size 3 [m, m/s].
            force: ``array``, flat, block size 3 [N].
            friction: False in statics: normal springs only, a function of ``u`` alone, found
                by a new search wherever the bodies moved; drops the tangential forces.
        """
        for side in self.passes:
            side.add(state, force, friction=friction)

    # ---- statics --------------------------------------------------------------------------

    def penetration(self, state: State, reach: float | None = None) -> tuple[float, int, Array]:
        """Return the deepest penetration [m], its HexMesh node and position ``(3,)`` [m].

        Depth 0 and node -1 where nothing penetrates; collective.

        Args:
            state: Displacements as in :meth:`add`; velocities are not read.
            reach: Depth up to which overlap is looked for [m]; a cell if None.
        """
        found = [side.penetration(state, reach) for side in self.passes]
        return max(found, key=lambda entry: entry[0])

    def springs_at_rest(self, state: State) -> list[RestSprings]:
        """Return the springs of each pass in statics, the same on all ranks; collective.

        Args:
            state: A state at rest, as for ``add(..., friction=False)``.
        """
        return [side.springs_at_rest(state) for side in self.passes]

    # ---- energies and resultants ----------------------------------------------------------

    @property
    def active(self) -> int:
        """Nodes in touch."""
        return sum(side.active for side in self.passes)

    @property
    def friction_dissipation(self) -> float:
        """Work turned into heat by friction since :meth:`reset` [J]."""
        return sum(side.contact_state.totals.friction_dissipation for side in self.passes)

    @property
    def damping_dissipation(self) -> float:
        """Work turned into heat by normal damping since :meth:`reset` [J]."""
        return sum(side.contact_state.totals.damping_dissipation for side in self.passes)

    @property
    def normal_energy(self) -> float:
        """Energy of the normal springs at the last step [J]."""
        return sum(side.contact_state.totals.normal_energy for side in self.passes)

    @property
    def tangential_energy(self) -> float:
        """Energy of the tangential springs at the last step [J]."""
        return sum(side.contact_state.totals.tangential_energy for side in self.passes)

    @property
    def stored_energy(self) -> float:
        """Energy of the normal and tangential springs at the last step [J]."""
        totals = (side.contact_state.totals for side in self.passes)
        return sum(t.normal_energy + t.tangential_energy for t in totals)

    @property
    def max_penetration(self) -> float:
        """Deepest penetration at the last step [m]."""
        return max(side.contact_state.totals.max_penetration for side in self.passes)

    @property
    def normal_force(self) -> float:
        """Sum of the nodal normal forces at the last step [N]."""
        return sum(side.contact_state.totals.normal_force for side in self.passes)

    @property
    def normal_resultant(self) -> Array:
        """Vector sum of the normal forces on the contactor, shape ``(3,)`` [N]."""
        return _less_reaction([s.contact_state.totals.normal_resultant for s in self.passes])

    @property
    def tangential_force(self) -> Array:
        """Vector sum of the tangential forces on the contactor, shape ``(3,)`` [N]."""
        return _less_reaction([s.contact_state.totals.tangential_resultant for s in self.passes])

    @property
    def initial_offsets(self) -> tuple[int, float]:
        """Nodes whose overlap at the start does not count, and the deepest [m]."""
        count, depth = zip(*(side.contact_state.offsets for side in self.passes), strict=True)
        return sum(count), max(depth)

    def rest(self, state: State, force: Vector) -> None:
        """Add the forces in statics: normal springs only, see :meth:`add`."""
        self.add(state, force, friction=False)

    def energy(self, state: State) -> dict[str, float]:
        """Return the terms of the energy balance [J], the same on all ranks.

        ``contact`` is stored, of it ``contact_normal`` and ``contact_tangential``;
        ``friction_dissipation`` and ``damping`` are lost since :meth:`reset`.
        """
        return {
            "contact": self.stored_energy,
            "contact_normal": self.normal_energy,
            "contact_tangential": self.tangential_energy,
            "friction_dissipation": self.friction_dissipation,
            "damping": self.damping_dissipation,
        }

    # ---- results --------------------------------------------------------------------------

    def surfaces(self, u: Array, v: Array) -> tuple[Array, Array]:
        """Return position and velocity of all nodes [m, m/s]; collective.

        Args:
            u: Displacement at the last step, flat, owned dofs first [m].
            v: Velocity [m/s].

        Returns:
            Contactor ``(nc, 6)`` and target ``(nt, 6)``.
        """
        return self.passes[0].surfaces(u, v)

    def footprint(self, stick_tolerance: float = 0.05) -> Footprint:
        """Return the contactor's nodes in contact and their patches, same on all ranks.

        In two passes they bear what both press on them; slip and coefficient of friction are those
        of the first pass, zero at nodes that only the second one presses on.

        Args:
            stick_tolerance: A node adheres where ``friction * F_n - |F_t|`` exceeds this
                fraction of the largest tangential nodal force [-].
        """
        one = self.passes[0]
        if len(self.passes) == 1:
            return one.footprint(stick_tolerance)
        return one.footprint_on(_in_both(*self.passes), stick_tolerance)

    def target_footprint(self, foot: Footprint, stick_tolerance: float = 0.05) -> Footprint:
        """Return the target's nodes that bear the reactions, same on all ranks; without patches.

        Pressure is the reaction on a node, as the step has shared it, over the area of the node:
        forces and powers of both bodies are equal. Where the target is finer than the contactor,
        one pass loads its nodes unevenly. A node is of the patch of the nearest contactor node.

        Args:
            foot: The contactor's, of the same step.
            stick_tolerance: As for :meth:`footprint`.
        """
        from scipy.spatial import cKDTree  # a fifteenth of a second to import

        one, *two = self.passes
        on = _in_both(two[0], one) if two else one.reacting()
        at = one.stack.target.start + on.c
        position = one.candidates.exchange.xv[at, :3]
        limit = on.friction * on.normal_force
        patch = foot.patch[cKDTree(foot.position).query(position)[1]] if len(on.c) else on.c
        return Footprint(
            node=self.target.nodes[on.c],
            position=position,
            normal=on.normal,
            normal_force=on.normal_force,
            tangential_force=on.tangential_force,
            area=one.stack.area[at],
            slip_velocity=on.slip / self.dt,
            friction=on.friction,
            friction_power=on.work / self.dt,
            stick=stick_zone(limit, on.tangential_force, stick_tolerance),
            patch=patch,
            patches=(),
        )

    # ---- memory ---------------------------------------------------------------------------

    def memory(self) -> dict[str, npt.NDArray[Any]]:
        """Return all that the next step depends on, for a checkpoint; the same on all ranks."""
        return {
            f"{i}/{key}": value
            for i, side in enumerate(self.passes)
            for key, value in side.memory().items()
        }

    def restore(self, memory: dict[str, npt.NDArray[Any]]) -> None:
        """Go on from what :meth:`memory` returned, on any number of ranks."""
        for i, side in enumerate(self.passes):
            prefix = f"{i}/"
            side.restore(
                {k.removeprefix(prefix): a for k, a in memory.items() if k.startswith(prefix)}
            )


def _in_both(one: Pass, two: Pass) -> Pressed:
    """Return the nodes of the contactor of ``one``, the target of ``two``, with what both press."""
    c, force, normal = one.nodal_forces()
    nodes, reaction, back = two.facet_forces()
    total, direction = np.zeros((2, len(one.contactor.nodes), 3))
    total[c], direction[c] = force, normal
    for corner in range(4):
        np.add.at(total, nodes[:, corner], reaction[:, corner])
        np.add.at(direction, nodes[:, corner], back)
    size = np.linalg.norm(direction, axis=1)
    direction /= np.where(size > 0.0, size, 1.0)[:, None]
    normal_force = np.einsum("ia,ia->i", total, direction)
    work = np.zeros(len(total))
    for on in (one.pressed(), two.reacting()):
        work[on.c] += on.work
    c = np.flatnonzero(normal_force > 0.0)
    tangential = total[c] - normal_force[c, None] * direction[c]
    h = one.contact_state  # of nodes: points do not go with two passes
    slip, friction = h.slip[c], h.friction[c]
    return Pressed(c, direction[c], normal_force[c], tangential, slip, friction, work[c])


def _less_reaction(resultants: list[Any]) -> Array:
    """Return the resultant of the first pass less that of the second, shape ``(3,)`` [N]."""
    first, *second = (np.array([*r]) for r in resultants)
    for reaction in second:
        first -= reaction
    return first
