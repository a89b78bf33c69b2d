# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a scene attaches to its bodies: supports, loads, damping, springs, contact."""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import la

from forms.elasticity import exact
from forms.kernel import CellKernel
from forms.loads import DriveTorque, MassDamping, gravity, nodal_traction
from meshes.domain import Domain
from workflow.model.contacts import contact_surfaces
from workflow.model.regions import surface_nodes
from workflow.scene.contacts import law_of
from workflow.scene.scene import Scene, SceneError
from workflow.scene.settings import Contact, Support

if TYPE_CHECKING:
    from collections.abc import Mapping

    from contact.friction import Law as FrictionLaw
    from workflow.model.model import Model

Array = npt.NDArray[np.float64]
Dofs = npt.NDArray[np.int32]


@dataclass(frozen=True)
class Supports:
    """Held directions: node groups whose acceleration loses its component along a unit vector.

    Attributes:
        dofs: Owned dof blocks of each group.
        directions: Unit vector of each group, shape ``(3,)``.
    """

    dofs: list[Dofs]
    directions: list[Array]

    def __call__(self, a: la.Vector) -> None:
        """Remove the held components, in place."""
        x = a.array
        for index, n in self._groups:
            if n is None:
                x[index] = 0.0
            else:
                held = x[index]
                x[index] = held - np.multiply.outer(n, n @ held)

    @cached_property
    def _groups(self) -> list[tuple[npt.NDArray[np.int64], Array | None]]:
        """Entries of a flat vector ``(3, k)`` and direction; entries ``(k,)`` along an axis."""
        groups: list[tuple[npt.NDArray[np.int64], Array | None]] = []
        for dofs, n in zip(self.dofs, self.directions, strict=True):
            index = 3 * dofs.astype(np.int64) + np.arange(3)[:, None]
            axis = np.flatnonzero(n)
            groups.append((index[axis[0]], None) if len(axis) == 1 else (index, n))
        return groups


def axle(scene: Scene) -> Array:
    """Return the unit vector along the axle, at its angle of attack and roll, shape ``(3,)``."""
    yaw = scene.rolling.angle_of_attack if scene.rolling else 0.0
    roll = getattr(scene.mesh, "roll", 0.0)
    level = np.array([-np.sin(yaw), np.cos(yaw), 0.0])
    return np.cos(roll) * level + np.array([0.0, 0.0, np.sin(roll)])


def supports(entries: list[Support], scene: Scene, domain: Domain) -> Supports:
    """Return supports as listed in a scene."""
    axes = {"x": np.eye(3)[0], "y": np.eye(3)[1], "z": np.eye(3)[2], "axle": axle(scene)}
    dofs, directions = [], []
    for entry in entries:
        local = domain.local_dofs(surface_nodes(domain, entry.surface))
        for direction in entry.directions:
            dofs.append(local[local >= 0])
            directions.append(axes[direction])
    return Supports(dofs, directions)


def dead_load(scene: Scene, domain: Domain) -> Array:
    """Return gravity and tractions as a force on every owned dof, shape ``(3 * owned,)`` [N]."""
    vector = la.vector(domain.V.dofmap.index_map, 3)
    vector.array[:] = 0.0
    if scene.gravity is not None:
        w, dx = ufl.TestFunction(domain.V), exact(domain.msh, domain.regions)
        bodies, tags = scene.bodies.values(), domain.source.tags
        weight = sum(
            gravity(w, b.material.density, scene.gravity) * dx(tags(b.regions)) for b in bodies
        )
        CellKernel(weight).add(vector)
        vector.scatter_reverse(la.InsertMode.add)
    nodal = vector.array.reshape(-1, 3)[: domain.owned].copy()
    for load in scene.loads:
        quads = domain.source.surface(domain.source.tag(load.surface))
        force = nodal_traction(domain.source.points, quads, np.array(load.traction))
        nodal += force[domain.nodes[: domain.owned]]
    return nodal.ravel()


def attach(model: "Model", friction: "Mapping[str, FrictionLaw] | None" = None) -> None:
    """Attach what the scene names, and only that; ``friction`` laws by pair in place of its own."""
    scene, own = model.scene, dict(friction or {})
    if unknown := sorted(own.keys() - scene.contacts):
        raise SceneError(f"friction = {unknown}: expected contacts of {list(scene.contacts)}")
    if any(b.mass_damping for b in scene.bodies.values()):
        model.damping = mass_damping(model)
    for contact_name, contact in scene.contacts.items():
        law = own.get(contact_name, contact.friction)
        model.pairs[contact_name] = pair(model, contact_name, contact, law)


def mass_damping(model: "Model") -> MassDamping:
    """Return the mass-proportional damping of all bodies."""
    owned = model.domain.owned
    alpha = np.zeros((owned, 1))
    for body, entry in model.scene.bodies.items():
        alpha[model.bodies.dofs(body)] = entry.mass_damping
    nodal = (model.mass.array.reshape(-1, 3)[:owned] * alpha).ravel()
    return MassDamping(model.domain.msh.comm, nodal, model.dt)


def pair(model: "Model", key: str, contact: Contact, friction: Any) -> Any:
    """Return the contact pair of a scene entry (the contact package is imported only here).

    Raises:
        SceneError: if ``friction``, a coefficient, table or law, cannot be used.
    """
    from contact.pair import ContactPair
    from contact.two_pass import TwoPass

    try:
        law = law_of(friction)
    except ValueError as error:
        raise SceneError(f"contacts.{key}.friction: {error}") from error
    contactor, target = contact_surfaces(model.bodies, contact, model.mass.array[::3])
    kind = TwoPass if contact.two_pass else ContactPair
    return kind(
        contactor,
        target,
        comm=model.domain.msh.comm,
        dt=model.dt,
        friction=law,
        penalty=contact.penalty,
        damping=contact.damping,
        method=contact.method,
        smooth=contact.smooth,
        sharp_angle=contact.sharp_angle,
        initial_overlap=contact.initial_overlap,
        offset_time=contact.offset_time,
        name=key,
    )


def drive(model: "Model", normal_force: float, radius: float) -> DriveTorque:
    """Return the drive torque for a traction coefficient of the static wheel load.

    Args:
        model: The model at equilibrium.
        normal_force: Static wheel load [N].
        radius: Rolling radius [m].
    """
    rolling, domain = model.scene.rolling, model.domain
    assert rolling is not None
    dofs = domain.region_dofs([rolling.driven_region])
    return DriveTorque(
        comm=domain.msh.comm,
        dofs=dofs,
        mass=model.mass.array[::3][dofs],
        reference=domain.V.tabulate_dof_coordinates()[dofs],
        axis=axle(model.scene),
        torque=rolling.traction_coefficient * normal_force * radius,
        ramp=rolling.torque_ramp,
    )
