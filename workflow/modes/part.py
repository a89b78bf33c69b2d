# SPDX-License-Identifier: LGPL-3.0-or-later
"""Part of a scene for modal analysis: mesh, held surfaces, axle."""

from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from meshes.arrays import Array
from meshes.domain import Domain, distribute
from meshes.hexmesh import HexMesh
from workflow.model.geometry import mesh_of, placement_of, profile
from workflow.model.regions import owners, surface_nodes
from workflow.model.supports import axle, supports
from workflow.scene.mesh import Foreign, WheelRailMesh
from workflow.scene.scene import Scene, SceneError

WHEEL = "wheel"
WHEEL_REGIONS = ("tyre", "web", "hub")
BORE = "wheel_bore"


@dataclass(frozen=True)
class Axis:
    """The axle of a wheel.

    Attributes:
        point: A point of it, shape ``(3,)`` [m].
        direction: Unit vector, shape ``(3,)``.
    """

    point: Array
    direction: Array


@dataclass(frozen=True)
class Part:
    """What vibrates.

    Attributes:
        name: ``wheel`` or the name of a body.
        scene: The scene with that body alone, its regions those of the part.
        domain: Its distributed mesh.
        held: How it is held: ``free``, ``supports`` or names of surfaces.
        axis: The axle, None if it does not turn.
        spin: How fast it turns about it [rad/s].
    """

    name: str
    scene: Scene
    domain: Domain
    held: str
    axis: Axis | None
    spin: float = 0.0


def part_of(
    scene: Scene,
    name: str | None,
    held: str | None,
    size: float,
    comm: MPI.Comm,
    speed: float | None = None,
) -> Part:
    """Return a part of a scene; the wheel without axle is a body of revolution with even cells.

    Args:
        scene: The scene.
        name: ``wheel`` or a body; the wheel of a wheel on a rail, else the first body if None.
        held: ``free``, ``bore`` (of the wheel), ``supports`` (of the scene) or names of surfaces;
            if None a wheel is held in its bore, a wheelset free, another body by its supports.
        size: Length of edges in the section of the wheel [m].
        comm: Ranks that share it.
        speed: At which it rolls [m/s]; that of the scene if None.

    Raises:
        SceneError: if the scene has no such part, or it cannot be held so, or does not roll.
    """
    wheel = isinstance(scene.mesh, WheelRailMesh)
    name = name or (WHEEL if wheel else next(iter(scene.bodies)))
    known = [WHEEL] * wheel + list(scene.bodies)
    if name not in known:
        raise SceneError(f"--part {name!r}: expected one of {', '.join(known)}")
    alone = wheel and name == WHEEL and WHEEL not in scene.bodies
    body = owners(scene)["tyre"] if alone else name
    domain = distribute(made(scene, body, alone, size, comm), comm)
    entry = scene.bodies[body].model_copy(update={"yielding": None, "contact_zone": None})
    if alone:
        entry = entry.model_copy(update={"regions": list(WHEEL_REGIONS)})
    one = scene.model_copy(update={"bodies": {body: entry}})
    rolls = scene.rolling is not None and scene.rolling.body == body
    usual = BORE if alone else "free" if rolls else "supports"
    held = {None: usual, "bore": BORE}.get(held, held)
    assert held is not None
    spin = spin_of(scene, body, alone or rolls, speed)
    return Part(name, one, domain, held, axis_of(scene, body, alone, rolls), spin)


def spin_of(scene: Scene, body: str, rolls: bool, speed: float | None) -> float:
    """Return how fast a body turns at a speed of travel, or as its scene drives it [rad/s].

    Raises:
        SceneError: if a speed is asked for of a body that does not roll.
    """
    mesh = scene.mesh
    radius = mesh.wheel_radius if isinstance(mesh, WheelRailMesh) else None
    if isinstance(mesh, Foreign):
        radius = mesh.rolling_radius
    if speed is None:
        if body in scene.driven:
            return float(np.linalg.norm(scene.driven[body].spin))
        speed = scene.rolling.speed if rolls and scene.rolling else 0.0
    elif not rolls or radius is None:
        raise SceneError(f"--speed {speed:g}: expected a wheel that rolls, got {body!r}")
    return abs(speed) / radius if radius else 0.0


def made(scene: Scene, body: str, alone: bool, size: float, comm: MPI.Comm) -> HexMesh | None:
    """Return the mesh of a part on rank 0; its errors are raised on all ranks."""
    mesh, error = None, None
    if comm.rank == 0:
        try:
            if alone:
                mesh = wheel_alone(scene, size)
            else:
                whole = mesh_of(scene)[0]
                mesh = cut_out(whole, whole.tags(scene.bodies[body].regions))
        except (ValueError, OSError) as caught:
            error = SceneError(str(caught))
    error = comm.bcast(error)
    if error is not None:
        raise error
    return mesh


def wheel_alone(scene: Scene, size: float) -> HexMesh:
    """Return the wheel of a scene without its axle, in wheel axes."""
    from meshes.wheel_rail.wheel import turned_wheel

    mesh = scene.mesh
    assert isinstance(mesh, WheelRailMesh)
    outside = profile(mesh, "wheel")
    return turned_wheel(
        size=size, design=mesh.wheel_design, radius=mesh.wheel_radius, profile=outside
    )


def cut_out(mesh: HexMesh, regions: tuple[int, ...]) -> HexMesh:
    """Return the cells of some regions as a mesh of their own, with the surfaces they have."""
    cells = np.isin(mesh.regions, regions)
    kept, numbers = np.unique(mesh.cells[cells], return_inverse=True)
    number = np.full(len(mesh.points), -1)
    number[kept] = np.arange(len(kept))
    facets = number[mesh.facets]
    whole = (facets >= 0).all(axis=1)
    return HexMesh(
        mesh.points[kept],
        numbers.reshape(-1, 8),
        mesh.regions[cells],
        facets[whole],
        mesh.surfaces[whole],
        mesh.names,
    )


def axis_of(scene: Scene, body: str, alone: bool, rolls: bool) -> Axis | None:
    """Return the axle of the part: y through the origin for a wheel in its own axes."""
    driven = scene.driven.get(body)
    if driven is not None and any(driven.spin) and not rolls:
        return Axis(np.array(driven.centre), np.array(driven.spin) / np.linalg.norm(driven.spin))
    if alone:
        return Axis(np.zeros(3), np.array([0.0, 1.0, 0.0]))
    if not rolls:
        return None
    if isinstance(scene.mesh, Foreign):
        return Axis(np.array(scene.mesh.wheel_centre), axle(scene))
    return Axis(np.array(placement_of(scene).centre), axle(scene))


def held_dofs(part: Part) -> npt.NDArray[np.int32]:
    """Return the owned scalar dofs that do not move.

    Raises:
        SceneError: if the mesh has no such surface, or a support is slanted to the axes.
    """
    groups: list[tuple[Any, Any]]
    domain = part.domain
    if part.held == "free":
        return np.zeros(0, dtype=np.int32)
    if part.held == "supports":
        # a support may be on a surface of another body, which is not in this mesh
        mesh = domain.source
        here = [s for s in part.scene.supports if len(mesh.surface(mesh.tag(s.surface)))]
        found = supports(here, part.scene, domain)
        groups = list(zip(found.dofs, found.directions, strict=True))
        if any(np.count_nonzero(np.abs(n) > 1e-12) > 1 for _, n in groups):
            raise SceneError(
                "--held supports: expected supports along x, y or z, got one along the yawed axle; "
                "try --held free, or --set rolling.angle_of_attack=0"
            )
    else:
        groups = [
            (dofs, n)
            for s in part.held.split(",")
            for dofs in [_on(part, s.strip())]
            for n in np.eye(3)
        ]
    held = [3 * dofs + int(np.argmax(np.abs(n))) for dofs, n in groups]
    return np.unique(np.concatenate(held)).astype(np.int32) if held else np.zeros(0, np.int32)


def _on(part: Part, surface: str) -> npt.NDArray[np.int32]:
    domain = part.domain
    known = sorted({domain.source.name(int(tag)) for tag in np.unique(domain.source.surfaces)})
    if surface.lower() not in known:
        raise SceneError(
            f"--held {part.held!r}: expected free, supports or surfaces of this part: "
            f"{', '.join(known)}"
        )
    dofs = domain.local_dofs(surface_nodes(domain, surface))
    return dofs[dofs >= 0]
