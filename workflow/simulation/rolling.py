# SPDX-License-Identifier: LGPL-3.0-or-later
"""Start of rolling: spin and travel of the wheelset, as steady as is known beforehand."""

from collections.abc import Mapping
from typing import Any

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import la

from forms.elasticity import full
from forms.kernel import CellKernel
from forms.loads import CarriedMass, DriveTorque
from meshes.arrays import Array
from meshes.domain import Domain
from meshes.wheel_rail import seats
from workflow.model import Model
from workflow.model.regions import facets
from workflow.model.supports import axle
from workflow.model.track import Seat, middle, seat, seats_of_points, sleeper_bodies


def travel(model: Model) -> Array:
    """Velocity of the wheel centre at the start, shape ``(3,)`` [m/s].

    It lies in the contact plane of the state at rest: on the slope of the gauge shoulder a wheel
    that drifts sideways has to rise. Started level it would run into the slope, and the contact
    force would ring by ``v √(k m)``, about the weight itself at 20 mrad and 80 km/h.
    """
    rolling = model.scene.rolling
    assert rolling is not None
    V = rolling.speed * np.array([np.cos(rolling.travel), np.sin(rolling.travel), 0.0])
    normal = sum((pair.normal_resultant for pair in model.pairs.values()), np.zeros(3))
    if normal[2] > 0:
        V[2] = -normal[:2] @ V[:2] / normal[2]
    return V


def spin(model: Model) -> Array:
    """Angular velocity for rolling without creepage at the tread, shape ``(3,)`` [rad/s]."""
    rolling = model.scene.rolling
    assert rolling is not None
    forward = rolling.speed * np.cos(rolling.travel - rolling.angle_of_attack)
    return forward / model.placement.rolling_radius * axle(model.scene)


def centrifugal(model: Model) -> Array:
    """Centrifugal force ``m ω² r`` on every owned dof of the wheelset [N], shape ``(3 owned,)``."""
    rolling = model.scene.rolling
    assert rolling is not None
    force = np.zeros((model.domain.owned, 3))
    dofs, omega = model.bodies.dofs(rolling.body), spin(model)
    r = model.domain.V.tabulate_dof_coordinates()[dofs] - np.array(model.placement.centre)
    mass = model.bodies.lumped_mass(scaled=False)[::3][dofs, None]  # added mass is carried
    force[dofs] = -mass * np.cross(omega, np.cross(omega, r))
    return force.ravel()


def start(model: Model) -> None:
    """Set the velocities at time zero and the drive torque, in place.

    With ``steady_start`` the deformation at rest is taken to travel with the contact: a wheel node
    at ``x = c + χ + w(χ)`` has the velocity ``V + ω × χ + ∇w (ω × χ)``, and the rail's pattern
    ``w(x - V t)`` gives it ``-∇w V``. Without it the wheelset is thrown as a rigid body and the
    contact zone has to build its flow of material in the first millimetres.
    """
    rolling, state = model.scene.rolling, model.state
    assert rolling is not None
    V, omega, centre = travel(model), spin(model), np.array(model.placement.centre)
    x = model.domain.V.tabulate_dof_coordinates()
    v = state.v.x.array.reshape(-1, 3)
    if rolling.steady_start and rolling.speed:
        v[: model.domain.owned] += convected(model, flow(model, V, omega, centre))
        follow(model)
    dofs = model.bodies.dofs(rolling.body)
    v[dofs] += V + np.cross(omega, x[dofs] - centre)
    model.supports(state.v.x)
    state.v.x.scatter_forward()
    for item in model.items:
        if isinstance(item, CarriedMass):
            item.spin, item.centre, item.velocity = omega, centre, V
        if isinstance(item, DriveTorque):
            load = sum(pair.normal_resultant[2] for pair in model.pairs.values())
            item.torque = rolling.traction_coefficient * load * model.placement.rolling_radius


def flow(model: Model, V: Array, omega: Array, centre: Array) -> dict[str, Any]:
    """Velocity of each body's material through the pattern of deformation, as UFL vectors.

    ``ω × χ`` in the wheelset, ``-V`` in all other bodies but sleepers, which stay where they are.
    """
    rolling, x = model.scene.rolling, ufl.SpatialCoordinate(model.domain.msh)
    assert rolling is not None
    arm = x - ufl.as_vector([float(c) for c in centre])
    passed = model.scene.bodies.keys() - sleeper_bodies(model.scene, model.domain)
    flows = dict.fromkeys(sorted(passed), ufl.as_vector([-float(c) for c in V]))
    return flows | {rolling.body: ufl.cross(ufl.as_vector([float(c) for c in omega]), arm)}


def convected(model: Model, flows: Mapping[str, Any]) -> Array:
    """Nodal ``∇w · flow`` by lumped projection, shape ``(owned, 3)`` [m/s].

    Args:
        model: The model at rest, with the displacement w; what earlier passes have left stays
            with the material and is not part of the pattern.
        flows: Velocity of the material through the pattern by body name; the others are left out.
    """
    scene, domain = model.scene, model.domain
    w, u = ufl.TestFunction(domain.V), model.state.u
    pattern = ufl.grad(u) if model.left is None else ufl.grad(u) - ufl.grad(model.left)
    dx = full(domain.msh, domain.regions)
    form = sum(
        model.bodies.inertial_density(name)
        * ufl.inner(pattern * velocity, w)
        * dx(model.bodies.tags(scene.bodies[name]))
        for name, velocity in flows.items()
    )
    out = la.vector(domain.V.dofmap.index_map, 3)
    out.array[:] = 0.0
    CellKernel(form).add(out)
    out.scatter_reverse(la.InsertMode.add)
    n = 3 * domain.owned
    return np.asarray((out.array[:n] / model.mass.array[:n]).reshape(-1, 3))


def follow(model: Model) -> None:
    """Give each sleeper the mean vertical velocity of the rail over its seat, in place.

    Under a travelling load the rail sinks ahead of it and rises behind; sleepers at rest would be
    struck through the stiff pads.
    """
    track, domain, scene = model.scene.track, model.domain, model.scene
    if track is None:
        return
    v, mesh = model.state.v.x.array.reshape(-1, 3), domain.source
    if track.sleeper_top is None:
        assert model.connections is not None
        speeds = sinking(domain, seats_of_points(track, domain), v)
        model.connections.masses.v[: len(speeds), 2] = speeds
        return
    tops = seats.parts(facets(domain, track.sleeper_top))
    under = [seat(track, domain, middle(mesh.points[top])) for top in tops]
    tags = [tag for body in sleeper_bodies(scene, domain) for tag in scene.bodies[body].regions]
    number = np.full(len(mesh.points), -1)
    for k, part in enumerate(seats.parts(mesh.cells[np.isin(mesh.regions, mesh.tags(tags))])):
        number[part] = k
    for top, speed in zip(tops, sinking(domain, under, v), strict=True):
        dofs = domain.local_dofs(np.flatnonzero(number == number[top[0, 0]]))
        v[dofs[dofs >= 0], 2] = speed


def sinking(domain: Domain, under: list[Seat], v: Array) -> Array:
    """Return the mean vertical velocity of the rail on each seat, shape ``(s,)`` [m/s]."""
    speeds = np.zeros(len(under))
    for i, (nodes, share) in enumerate(under):
        dofs = domain.local_dofs(nodes)
        speeds[i] = share[dofs >= 0] @ v[dofs[dofs >= 0], 2]
    domain.msh.comm.Allreduce(MPI.IN_PLACE, speeds)
    return speeds
