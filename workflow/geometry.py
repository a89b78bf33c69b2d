# SPDX-License-Identifier: LGPL-3.0-or-later
"""The mesh of a scene: made on rank 0, distributed by DOLFINx."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np

from meshes.domain import Domain, distribute
from meshes.hexmesh import HexMesh, join
from meshes.tags import Tag
from workflow.file_mesh import FileMesh
from workflow.scene import Scene, SceneError
from workflow.sections import BarMesh, BlocksMesh, CapMesh, WheelRailMesh

PROFILES = {"S1002": "s1002", "54E1": "rail_54e1"}


def domain_of(scene: Scene, comm: MPI.Comm, log: Callable[[str], Any]) -> tuple[Domain, Any]:
    """Return the distributed mesh of a scene and, for wheel on rail, its placement.

    An error in meshing on rank 0 is raised on every rank.
    """
    mesh, placement, error = None, None, None
    if comm.rank == 0:
        try:
            mesh, placement = mesh_of(scene, log)
            log(f"mesh: {shape_of(mesh)}")
        except (ValueError, OSError) as caught:
            error = SceneError(str(caught))
    error = comm.bcast(error)
    if error is not None:
        raise error
    return distribute(mesh, comm), comm.bcast(placement)


def cell_size(scene: Scene, mesh: HexMesh) -> float:
    """Return the edge of the cells where bodies touch [m]; of a file, its shortest if not told."""
    if scene.mesh.size is not None:
        return scene.mesh.size
    from meshes.split import edges_of

    edges, _ = edges_of(mesh.cells)
    return float(np.linalg.norm(np.diff(mesh.points[edges], axis=1)[:, 0], axis=1).min())


def shape_of(mesh: HexMesh) -> str:
    """Return the size of a mesh and the shape of its cells in words, for the log."""
    from meshes.quality import quality

    q = quality(mesh)
    return (
        f"{q.cells} cells, {q.nodes} nodes, edges {q.shortest * 1e3:.2f} to "
        f"{q.longest * 1e3:.3g} mm, smallest scaled Jacobian {q.scaled_jacobian:.2f}"
    )


def mesh_of(scene: Scene, log: Callable[[str], Any] = lambda line: None) -> tuple[HexMesh, Any]:
    """Return the mesh of a scene on this process, and the placement of its wheel or None."""
    mesh = scene.mesh
    if isinstance(mesh, WheelRailMesh):
        return cached_wheel_on_rail(scene, mesh, log)
    if isinstance(mesh, FileMesh):
        from workflow.foreign import mesh_from_file

        return mesh_from_file(scene, mesh, log)
    from meshes import blocks

    if isinstance(mesh, BarMesh):
        return blocks.bar(mesh.length, mesh.width, width=mesh.width, size=mesh.size), None
    if isinstance(mesh, BlocksMesh):
        return block_on_base(mesh), None
    assert isinstance(mesh, CapMesh)
    cap = blocks.sphere_cap(mesh.radius, mesh.extent, size=mesh.size, growth=mesh.growth)
    return join(cap, blocks.base(mesh.extent, size=mesh.size, growth=mesh.growth)), None


def block_on_base(mesh: BlocksMesh) -> HexMesh:
    """Return a block that rests near the start of a longer base, free to slide in +x."""
    from meshes import blocks

    (length, width, height), (base_length, base_width, depth) = mesh.block, mesh.base
    start = (base_width - width) / 2
    upper = blocks.block(
        (0.0, -width / 2, 0.0),
        (length, width / 2, height),
        size=mesh.size,
        surfaces={Tag.ZMIN: Tag.BLOCK_BOTTOM},
    )
    lower = blocks.block(
        (-start, -base_width / 2, -depth),
        (base_length - start, base_width / 2, 0.0),
        size=mesh.base_size,
        region=Tag.BASE,
        surfaces=blocks.BASE_FACES,
    )
    return join(upper, lower)


def rolling_zone(scene: Scene) -> tuple[float, float]:
    """Return where along the rail the wheel will roll, from the first contact on [m].

    The flange touches ahead of the tread by the angle of attack times the lever of the flange
    angle, about R tan(70°) sin(angle of attack).
    """
    mesh, rolling = scene.mesh, scene.rolling
    assert isinstance(mesh, WheelRailMesh)
    travel = rolling.speed * scene.time.end if rolling else 0.0
    lead = (
        mesh.wheel_radius
        * np.tan(np.radians(70))
        * np.sin(rolling.angle_of_attack if rolling else 0.0)
    )
    ahead = max(travel, 0.0) + max(lead, 0.0)
    behind = min(travel, 0.0) + min(lead, 0.0)
    return behind - mesh.margin, ahead + mesh.margin


def check_profiles(scene: Scene) -> None:
    """Read the profiles that a scene names, without meshing.

    Raises:
        SceneError: naming the key of a profile that is missing or cannot be used.
    """
    if isinstance(scene.mesh, WheelRailMesh):
        profile("mesh.wheel_profile", scene.mesh.wheel_profile)
        profile("mesh.rail_profile", scene.mesh.rail_profile)


def profile(key: str, name: str) -> Any:
    """Return the built-in profile or CSV file ``name``, or raise ``SceneError`` naming the key."""
    from meshes import measured, profiles

    if name in PROFILES:
        return getattr(profiles, PROFILES[name])()
    try:
        return measured.from_csv(name)
    except (ValueError, OSError) as error:
        expected = f"expected one of {', '.join(PROFILES)} or a CSV file"
        raise SceneError(f"{key} = {name!r}: {error}; {expected}") from None


def placement_of(scene: Scene) -> Any:
    """Return where the wheel of a scene stands on the rail: the flange just short of the corner.

    Raises:
        SceneError: if a profile cannot be used.
        ValueError: if no lateral position leaves the flange gap of the scene.
    """
    from meshes import placement

    mesh = scene.mesh
    assert isinstance(mesh, WheelRailMesh)
    for key in ("wheel_profile", "rail_profile"):
        name = getattr(mesh, key)
        outline = profile(f"mesh.{key}", name)
        if name not in PROFILES:
            raise SceneError(
                f"mesh.{key} = {name!r}: a profile of {outline.length * 1e3:.0f} mm, but only "
                f"{', '.join(PROFILES)} can be meshed so far"
            )
    return placement.lateral_shift_for(
        rail=placement.rail_in_track(inclination=mesh.inclination, gauge=mesh.gauge),
        flange_gap=mesh.flange_gap,
        radius=mesh.wheel_radius,
        yaw=scene.rolling.angle_of_attack if scene.rolling else 0.0,
    )


def cached_wheel_on_rail(
    scene: Scene, mesh: WheelRailMesh, log: Callable[[str], Any]
) -> tuple[HexMesh, Any]:
    """Return wheelset and rail as made before from the same tables and code, or made now."""
    from meshes import cache

    yaw = scene.rolling.angle_of_attack if scene.rolling else 0.0
    inputs = {"mesh": mesh.model_dump(mode="json"), "zone": rolling_zone(scene), "yaw": yaw}
    name = cache.key(inputs, [Path(__file__)])
    return cache.cached(name, lambda: wheel_on_rail(scene, mesh), log)


def wheel_on_rail(scene: Scene, mesh: WheelRailMesh) -> tuple[HexMesh, Any]:
    """Return wheelset and rail in the track position, and the placement of the wheel."""
    from meshes.placement import placed
    from meshes.sleepers import sleepers
    from meshes.track import rail
    from meshes.wheelset import wheelset

    position = placement_of(scene)
    zone = rolling_zone(scene)
    start = mesh.start
    wheel = wheelset(size=mesh.size, zone=zone, design=mesh.wheel_design, radius=mesh.wheel_radius)
    track = rail(
        mesh.rail_length,
        -mesh.rail_length / 2 - start,
        size=mesh.size,
        zone=zone,
        inclination=mesh.inclination,
        gauge=mesh.gauge,
    )
    if mesh.sleepers is None:
        return join(placed(wheel, position), track), position
    foot = track.points[np.unique(track.surface(Tag.FOOT_UNDERSIDE))]
    below = sleepers(foot, **mesh.sleepers.model_dump())
    return join(placed(wheel, position), track, below), position
