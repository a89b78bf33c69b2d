# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bodies of a scene: materials, laws and forms, and the internal force made of them."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from dolfinx import la, mesh

from forms import elements
from forms.cells import one_point
from forms.elasticity import Elastic, full
from forms.elements import HENCKY, LAWS, Law
from forms.frame import INTERVAL, TurningFrames
from forms.kernel import CellIntegral, CellKernel
from forms.mass import inertia, lumped_mass
from forms.rank_sums import gathered, own_part
from forms.viscosity import bulk_viscosity, tangent_viscosity
from meshes.arrays import Array, Dofs, Flags
from meshes.domain import Domain
from workflow.model.geometry import cell_size
from workflow.model.state import State
from workflow.model.zones import zone
from workflow.scene import Scene, SceneError
from workflow.scene.bodies import FOLLOWING, MEMORY, Body

BULK, NEAR, REMEMBERING = range(KINDS := 3)  # cells of a region: the contact zone, and what yields


@dataclass(frozen=True, eq=False)
class Part:
    """Cells of a body that share element and elastic law.

    Attributes:
        body: Table of the body.
        material: Its constants.
        law: The law.
        element: The element.
        dx: Volume measure of the cells, with full quadrature.
    """

    body: Body
    material: Any
    law: Law
    element: str
    dx: Any

    def work(self, u: Any, w: Any, v: Any = None, law: Law | None = None) -> Any:
        """Return the form of the internal virtual work, see :func:`forms.elements.internal_work`.

        Args:
            u: Displacement [m].
            w: Test function.
            v: Velocity [m/s].
            law: In place of its own.
        """
        return elements.internal_work(
            self.element,
            law or self.law,
            u,
            w,
            self.material,
            self.dx,
            v,
            coefficient=self.body.hourglass_coefficient,
        )


class Bodies:
    """Materials and laws of the bodies of a scene, and the forms made of them.

    Attributes:
        scene: The scene.
        domain: The distributed mesh.
        dx: Volume measure with full quadrature and the region tags.
        materials: Elastic constants by body name.
        laws: Material law by body name; the elastic one where it has a memory.
        memory_laws: Law of each body whose material has a memory: a name, or a
            :class:`forms.memory.MemoryLaw`.
        zones: Cells of the mesh that may yield, by body with such a law, flags of shape ``(c,)``.
        density_factor: What mass scaling multiplies the density of each cell by, in inertia only;
            None without it.
    """

    def __init__(self, scene: Scene, domain: Domain, laws: Mapping[str, Any] | None = None) -> None:
        self.scene, self.domain = scene, domain
        self.dx = full(domain.msh, domain.regions)
        entries = scene.bodies.items()
        self.materials = {name: b.material.constants(b.stiffness_damping) for name, b in entries}
        own = dict(laws or {})
        remembering = {name: given for name, given in own.items() if not hasattr(given, "residual")}
        elastic = {name: given for name, given in own.items() if name not in remembering}
        self.laws = {name: law(body) for name, body in entries} | elastic
        self.memory_laws: dict[str, Any] = {
            name: b.material.law
            for name, b in entries
            if b.material.law in MEMORY and name not in elastic
        } | remembering
        self.zones = {n: zone(scene, domain.source, n, "yielding") for n in self.memory_laws}
        self.density_factor: Any = None

    def tags(self, body: Body) -> tuple[int, ...]:
        """Return the region tags of the mesh that make a body."""
        return self.domain.source.tags(body.regions)

    def dofs(self, name: str) -> Dofs:
        """Return the owned dof blocks of the body called ``name``."""
        return self.domain.region_dofs(self.scene.bodies[name].regions)

    def turning(self) -> dict[str, Dofs]:
        """Return the local dof blocks, ghosts too, of each body that has a frame of its own.

        These are the bodies whose law is made for rotation. Those that share nodes with others
        stay in the frame at rest: the other one may be made for small strain.
        """
        nodes, source = self.domain.nodes, self.domain.source
        of = {name: source.nodes(*self.tags(b)) for name, b in self.scene.bodies.items()}
        count = np.bincount(np.concatenate([*of.values()]))
        return {
            name: np.flatnonzero(np.isin(nodes, own)).astype(np.int32)
            for name, own in of.items()
            if self.laws[name].rotating and (count[own] == 1).all()
        }

    def turning_frames(self) -> TurningFrames | None:
        """Return the frames of the bodies that may turn, None if there are none."""
        damped = any(b.stiffness_damping for b in self.scene.bodies.values())
        turning = [*self.turning().values()]
        return TurningFrames(self.domain.V, turning, velocity=damped) if turning else None

    def lumped_mass(self, *, scaled: bool = True) -> Array:
        """Return the lumped mass of every local scalar dof, shape ``(3 * n_local,)`` [kg].

        Args:
            scaled: With what mass scaling has added.
        """
        if scaled:
            return lumped_mass(self.domain.V, self.dx, self._densities())
        entries = self.scene.bodies.values()
        true: dict[tuple[int, ...], Any] = {self.tags(b): b.material.density for b in entries}
        return lumped_mass(self.domain.V, self.dx, true)

    def inertial_density(self, name: str) -> Any:
        """Return the density of a body, mass scaling counted in, as UFL [kg/m³]."""
        density = self.scene.bodies[name].material.density
        return density if self.density_factor is None else density * self.density_factor

    def _densities(self) -> dict[tuple[int, ...], Any]:
        entries = self.scene.bodies.items()
        return {self.tags(body): self.inertial_density(name) for name, body in entries}

    def whole(self, name: str) -> Flags:
        """Return which cells of the mesh are those of a body, shape ``(c,)``."""
        return np.isin(self.domain.source.regions, self.tags(self.scene.bodies[name]))

    @cached_property
    def _split(self) -> Any:
        """Volume measure whose tags tell apart the kinds of cells in a region, see :meth:`_of`."""
        entries = self.scene.bodies.items()
        if not any(b.contact_zone or b.yielding for _, b in entries):
            return self.dx
        msh, regions, source = self.domain.msh, self.domain.regions, self.domain.source
        kind = np.full(len(source.cells), BULK)
        for name, body in entries:
            if body.contact_zone is not None:
                kind[zone(self.scene, source, name, "contact_zone")] = NEAR
        for flags in self.zones.values():
            kind[flags] = REMEMBERING
        own = kind[msh.topology.original_cell_index[regions.indices]]
        tags = (KINDS * regions.values + own).astype(np.int32)
        return full(msh, mesh.meshtags(msh, 3, regions.indices, tags))

    def _of(self, name: str, *kinds: int) -> Any:
        """Return the volume measure of some kinds of cells of a body."""
        tags = self.tags(self.scene.bodies[name])
        if self._split is self.dx:
            return self.dx(tags)
        return self._split(tuple(KINDS * tag + kind for tag in tags for kind in kinds))

    def remembering(self, name: str) -> Any:
        """Return the volume measure of the cells of a body that have a memory."""
        return self._of(name, REMEMBERING)

    @property
    def parts(self) -> list[Part]:
        """All bodies with their elastic laws, those of two elements in two parts."""
        return [
            part
            for name in self.scene.bodies
            for part in self._parts(name, self.laws[name], (NEAR, REMEMBERING))
        ]

    @property
    def without_memory(self) -> list[Part]:
        """Bodies, or parts of them, whose stress follows from their strain alone.

        The part of a body that may yield elsewhere has the law that yields, but for that.
        """
        found: list[Part] = []
        for name in self.scene.bodies:
            rotating = name in self.zones and self.laws[name].rotating
            if name not in self.zones or not self.zones[name][self.whole(name)].all():
                own = HENCKY if rotating else self.laws[name]
                found += self._parts(name, own, (NEAR,))
        return found

    def _parts(self, name: str, law: Law, near: tuple[int, ...]) -> Iterator[Part]:
        """Yield a body, or its bulk and what is near; the latter are cells of these kinds."""
        body, material = self.scene.bodies[name], self.materials[name]
        if body.contact_zone is None:
            yield Part(body, material, law, body.element, self._of(name, BULK, *near))
        else:
            yield Part(body, material, law, body.element, self._of(name, BULK))
            yield Part(body, material, law, body.near_element, self._of(name, *near))

    def internal_work(
        self, u: Any, w: Any, v: Any = None, *, parts: Iterable[Part] | None = None
    ) -> Any:
        """Return the form of the elastic virtual work; damped if a velocity ``v`` is given.

        Args:
            u: Displacement [m].
            w: Test function.
            v: Velocity [m/s].
            parts: Those that take part, all bodies if not given.
        """
        return sum(
            part.work(u, w, v if part.body.stiffness_damping else None)
            for part in (self.parts if parts is None else parts)
        )

    def strain_energy(self, u: Any) -> Any:
        """Return the form of the strain energy, without hourglass control and laws with memory."""
        return sum(
            elements.strain_energy(part.element, part.law, u, part.material, part.dx)
            for part in self.without_memory
        )

    def hourglass_energy(self, u: Any) -> Any:
        """Return the form of the energy of hourglass control, laws with a memory aside; or None."""
        forms = [
            elements.control_energy(
                part.law,
                u,
                part.material,
                part.dx,
                coefficient=part.body.hourglass_coefficient,
            )
            for part in self.without_memory
            if part.element == "one-point"
        ]
        return sum(forms) if forms else None

    def viscous_work(self, u: Any, v: Any, w: Any) -> Any:
        """Return the form of the bulk viscosity's virtual work, None without viscosity."""
        forms = [
            bulk_viscosity(
                u,
                v,
                w,
                isotropic(self.materials[name]),
                linear=body.bulk_viscosity.linear,
                quadratic=body.bulk_viscosity.quadratic,
                rotating=self.laws[name].rotating,
            )
            * one_point(self.dx(self.tags(body)))
            for name, body in self.scene.bodies.items()
            if body.bulk_viscosity
        ]
        return sum(forms) if forms else None

    def damping_work(self, v: Any, w: Any) -> Any:
        """Return a linear form that bounds all material damping, at the scene's own speeds.

        For the quadratic viscosity a cell is taken to be closed by the whole difference of the
        bodies' initial velocities.
        """
        start = [b.velocity or (0.0, 0.0, 0.0) for b in self.scene.bodies.values()]
        closing = max(np.linalg.norm(np.subtract(a, b)) for a in [*start, (0, 0, 0)] for b in start)
        forms = []
        for part in self.parts:
            body = part.body
            if body.bulk_viscosity:
                viscous = tangent_viscosity(
                    v,
                    w,
                    isotropic(part.material),
                    linear=body.bulk_viscosity.linear,
                    quadratic=body.bulk_viscosity.quadratic,
                    rate=float(closing) / cell_size(self.scene, self.domain.source),
                )
                forms.append(viscous * one_point(part.dx, mixed=part.element != "one-point"))
            if body.stiffness_damping:
                forms.append(body.stiffness_damping * part.work(v, w))
        return sum(forms)

    def mass(self, w: Any) -> Any:
        """Return the form whose vector is the lumped mass."""
        return inertia(w, self.dx, self._densities())


class InternalForce:
    """Minus the internal force as an item; counts its work only where it dissipates.

    Args:
        form: Minus the virtual work.
        space: Space of the displacement.
        precision: Type that is computed with, ``float64`` or ``float32``.
        damped: Whether a part of its work is dissipated.
        stored: Forms of the strain energy and of hourglass control, by term of the ledger.
        frames: Frames in which the form is written, if it is.
        at_rest: The form for statics, in double precision; ``form`` if not given.
    """

    phase = "internal_force"

    def __init__(
        self,
        form: Any,
        space: Any,
        precision: str,
        *,
        damped: bool,
        stored: Mapping[str, Any],
        frames: TurningFrames | None = None,
        at_rest: Any = None,
    ) -> None:
        self.kernel = CellKernel(form, precision)
        self.comm = space.mesh.comm
        self.frames = frames
        self.work, self.start = 0.0, np.nan  # stored energy at the first look, see energy
        self._at_rest = self.kernel if at_rest is None else CellKernel(at_rest)
        self._stored = {name: CellIntegral(energy) for name, energy in stored.items()}
        index_map = space.dofmap.index_map
        self._forces = [la.vector(index_map, 3) for _ in range(2)] if damped else []  # now, before
        self._t: float | None = None

    def add(self, state: State, force: la.Vector) -> None:
        """Add this rank's cells; the work is that of the elastic and viscous stress together."""
        if not self._forces:
            self._add(state, force)
            return
        self._forces.reverse()
        now, before = self._forces
        now.array[:] = 0.0
        self._add(state, now)
        force.array[:] += now.array
        if self._t is not None:
            v = state.v.x.array  # what the nodes moved with since then
            self.work -= (state.t - self._t) / 2 * float(now.array @ v + before.array @ v)
        self._t = state.t

    def _add(self, state: State, force: la.Vector) -> None:
        if self.frames is None:
            self.kernel.add(force)
            return
        if state.step % INTERVAL == 0:
            self.frames.follow(state.u.x.array)
        self.frames.enter(state.u.x.array, state.v.x.array)
        self.kernel.add(self.frames.force)
        self.frames.release(force.array)

    def rest(self, state: State, force: la.Vector) -> None:
        """Add this rank's cells, the work left aside, in double precision."""
        self._at_rest.add(force)

    def stored(self) -> dict[str, float]:
        """Return strain energy and that of hourglass control [J]; collective."""
        return {name: integral() for name, integral in self._stored.items()}

    def energy(self, state: State) -> dict[str, float]:
        """Return what is stored, and of the work what was not stored since the first look [J]."""
        terms = self.stored()
        now = sum(terms.values())
        if np.isnan(self.start):
            self.start = now
        if self._forces:
            terms["damping"] = self.comm.allreduce(self.work) - (now - self.start)
        return terms

    def memory(self) -> dict[str, Array]:
        """Return work and frames of each rank and the energy stored at the start; collective."""
        arrays = {"work": gathered(self.comm, self.work), "start": np.array(self.start)}
        return arrays | ({"turn": self.frames.memory(self.comm)} if self.frames else {})

    def restore(self, memory: Mapping[str, Array]) -> None:
        """Go on from what :meth:`memory` returned."""
        self.work, self.start = own_part(self.comm, memory["work"]), float(memory["start"])
        if self.frames is not None:
            self.frames.restore(self.comm, memory["turn"])


def law(body: Body) -> Law:
    """Return the elastic law of a body; that of its kinematics for linear materials.

    For a law with a memory it is the one that has the same stiffness before anything has yielded:
    step bound, modes and statics go by it.

    Raises:
        SceneError: if the law is not in :data:`forms.elements.LAWS`.
    """
    name = body.kinematics if body.material.law in FOLLOWING else body.material.law
    if body.material.law in MEMORY and body.near_element == "selective" and name != "small-strain":
        name = "neo-hookean"
    if name not in LAWS:
        raise SceneError(f"material.law = {name!r}: expected one of {['hooke', *LAWS]}")
    return LAWS[name]


def isotropic(constants: Any) -> Elastic:
    """Return the constants themselves, or the nearest isotropic ones."""
    return getattr(constants, "isotropic", constants)
