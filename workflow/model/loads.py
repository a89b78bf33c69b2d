# SPDX-License-Identifier: LGPL-3.0-or-later
"""Loads of a scene: gravity and tractions, damping by mass, drive torque, carried mass."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
import ufl
from dolfinx import la

from forms.elasticity import exact
from forms.kernel import CellKernel
from forms.loads import (
    CarriedMass,
    DeadLoad,
    DriveTorque,
    MassDamping,
    TimedLoad,
    gravity,
    nodal_pressure,
    nodal_traction,
    pulse,
)
from meshes.arrays import Array
from meshes.domain import Domain
from meshes.quads import area_shares
from workflow.model.bodies import Bodies
from workflow.model.supports import axle
from workflow.scene import Scene, SceneError
from workflow.scene.settings import Hammer, Load

if TYPE_CHECKING:
    from forms.travelling import TravellingLoad


def dead_load(scene: Scene, domain: Domain) -> DeadLoad:
    """Return gravity and the loads without ramp as a constant force."""
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
        if load.resting:
            nodal += nodal_force(load, domain)
    return DeadLoad(domain.msh.comm, nodal.ravel())


def timed_loads(scene: Scene, domain: Domain) -> Iterator[TimedLoad]:
    """Yield the loads that come up within a time, and blows.

    Raises:
        SceneError: if a blow meets no facet.
    """
    comm = domain.msh.comm
    for i, load in enumerate(scene.loads):
        if load.ramp:
            yield TimedLoad(comm, nodal_force(load, domain).ravel(), load.ramp)
        if (hammer := load.hammer) is not None:
            nodal = struck(domain, load.surface, hammer, f"loads.{i}.hammer")
            yield TimedLoad(comm, nodal.ravel(), hammer.duration, pulse)


def struck(domain: Domain, surface: str, hammer: Hammer, key: str) -> Array:
    """Return the largest force of a blow on the owned nodes, shape ``(owned, 3)`` [N].

    Raises:
        SceneError: if there is no facet within its radius.
    """
    points, quads = domain.source.points, domain.source.surface(domain.source.tag(surface))
    away = np.linalg.norm(points[quads].mean(axis=1) - hammer.point, axis=1)
    if not (near := away <= hammer.radius).any():
        raise SceneError(
            f"{key}.radius = {hammer.radius}: expected {away.min():.4f} m or more, where the "
            f"nearest middle of a facet of {surface!r} lies"
        )
    force = np.zeros_like(points)
    nodes, share = area_shares(points, quads[near])
    force[nodes] = np.outer(share, hammer.force)
    return np.asarray(force[domain.nodes[: domain.owned]])


def nodal_force(load: Load, domain: Domain) -> Array:
    """Return the force of a load on the owned nodes, shape ``(owned, 3)`` [N]."""
    points, quads = domain.source.points, domain.source.surface(domain.source.tag(load.surface))
    force = nodal_traction(points, quads, np.array(load.traction))
    if load.pressure:
        force += nodal_pressure(points, quads, load.pressure)
    return np.asarray(force[domain.nodes[: domain.owned]])


def travelling_loads(scene: Scene, domain: Domain, dt: float) -> "Iterator[TravellingLoad]":
    """Yield the loads of a scene that travel; ``dt`` is the step [s]."""
    for load in scene.loads:
        if (way := load.travelling) is None:
            continue
        from forms.travelling import TravellingLoad, surface_shares  # with scipy's sparse matrices

        quads = domain.source.surface(domain.source.tag(load.surface))
        shares, x = surface_shares(domain.source.points, quads)
        nodes = np.unique(quads)
        dofs = domain.local_dofs(nodes)
        yield TravellingLoad(
            comm=domain.msh.comm,
            dofs=dofs[dofs >= 0],
            shares=shares[nodes[dofs >= 0]],
            x=x,
            traction=np.array(load.traction),
            half_width=way.half_width,
            start=way.start,
            speed=way.velocity,
            ramp=way.ramp,
            until=way.until,
            dt=dt,
        )


def mass_damping(bodies: Bodies, mass: Array, dt: float) -> MassDamping:
    """Return the mass-proportional damping of all bodies.

    Args:
        bodies: Bodies of the scene.
        mass: Lumped mass of every local dof, shape ``(3 n_local,)`` [kg].
        dt: Step [s].
    """
    owned = bodies.domain.owned
    alpha = np.zeros((owned, 1))
    for body, entry in bodies.scene.bodies.items():
        alpha[bodies.dofs(body)] = entry.mass_damping
    nodal = (mass.reshape(-1, 3)[:owned] * alpha).ravel()
    return MassDamping(bodies.domain.msh.comm, nodal, dt)


def drive_torque(scene: Scene, domain: Domain, mass: Array) -> DriveTorque:
    """Return the drive of a rolling wheelset; its torque is set when the wheel load is known.

    Args:
        scene: The scene, rolling.
        domain: Its mesh.
        mass: Lumped mass of every local dof, shape ``(3 n_local,)`` [kg].
    """
    rolling = scene.rolling
    assert rolling is not None
    dofs = np.sort(domain.region_dofs([rolling.driven_region]))  # in the order of memory
    return DriveTorque(
        comm=domain.msh.comm,
        dofs=dofs,
        mass=mass[::3][dofs],
        reference=domain.V.tabulate_dof_coordinates()[dofs],
        axis=axle(scene),
        torque=0.0,
        ramp=rolling.torque_ramp,
    )


def carried_mass(bodies: Bodies, mass: Array) -> CarriedMass:
    """Return what the mass that scaling has added to a rolling body takes to roll with it.

    Args:
        bodies: Bodies of the scene, their densities scaled.
        mass: Lumped mass of every local dof with it, shape ``(3 * n_local,)`` [kg].
    """
    rolling = bodies.scene.rolling
    assert rolling is not None
    domain, dofs = bodies.domain, np.sort(bodies.dofs(rolling.body))
    added = (mass - bodies.lumped_mass(scaled=False))[::3][dofs]
    dofs, added = dofs[added > 0], added[added > 0]
    return CarriedMass(domain.msh.comm, dofs, added, domain.V.tabulate_dof_coordinates()[dofs])
