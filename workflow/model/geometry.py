# SPDX-License-Identifier: LGPL-3.0-or-later
"""Mesh of a scene, made or read on one rank and distributed by DOLFINx; its export to a file.

A wheel on a rail comes with its placement, and is kept on disk for the next run.
"""

import json
import os
from collections.abc import Callable, Iterator
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

import numpy as np

from meshes import profiles
from meshes.domain import Domain, distribute
from meshes.hexmesh import HexMesh, join
from meshes.quality import edge_lengths, quality
from meshes.shapes import blocks, caps, shells
from meshes.tags import Tag
from workflow.scene.mesh import (
    BarMesh,
    BlocksMesh,
    CapMesh,
    CurvedMesh,
    FileMesh,
    Foreign,
    GmshMesh,
    HollowSphereMesh,
    RailMesh,
    WheelRailMesh,
)
from workflow.scene.scene import Scene, SceneError

if TYPE_CHECKING:
    from meshes.generate.sweep import Strip
    from meshes.profiles.point_files import Kind

OVERLAP = 0.01  # of a cell, by which bodies may overlap at the start


def domain_of(
    scene: Scene,
    comm: MPI.Comm,
    log: Callable[[str], Any],
    own: Callable[..., Any] | None = None,
) -> tuple[Domain, Any]:
    """Return the distributed mesh of a scene and, for wheel on rail, its placement.

    An error in meshing on rank 0 is raised on every rank. ``own`` builds a model of gmsh.
    """

    def make() -> tuple[HexMesh, Any]:
        mesh, placement = mesh_of(scene, log, own)
        log(f"mesh: {shape_of(mesh)}")
        return mesh, placement

    mesh, placement = on_root(comm, make) or (None, None)
    return distribute(mesh, comm), comm.bcast(placement)


def on_root[T](comm: MPI.Comm, work: Callable[[], T]) -> T | None:
    """Return what ``work`` returns on rank 0, None on others; its errors are raised on all ranks.

    Raises:
        SceneError: for what is wrong with a scene or its files.
    """
    found, error = None, None
    if comm.rank == 0:
        try:
            found = work()
        except (ValueError, OSError) as caught:
            error = SceneError(str(caught))
    error = comm.bcast(error)
    if error is not None:
        raise error
    return found


def cell_size(scene: Scene, mesh: HexMesh) -> float:
    """Return the edge of the cells where bodies touch [m]; of a file, its shortest if not told."""
    if scene.mesh.size is not None:
        return scene.mesh.size
    return float(edge_lengths(mesh.points, mesh.cells).min())


def shape_of(mesh: HexMesh) -> str:
    """Return the size of a mesh and the shape of its cells in words, for the log."""
    q = quality(mesh)
    return (
        f"{q.cells} cells, {q.nodes} nodes, edges {q.shortest * 1e3:.2f} to "
        f"{q.longest * 1e3:.3g} mm, smallest scaled Jacobian {q.scaled_jacobian:.2f}"
    )


def mesh_of(
    scene: Scene,
    log: Callable[[str], Any] = lambda line: None,
    own: Callable[..., Any] | None = None,
) -> tuple[HexMesh, Any]:
    """Return the mesh of a scene on this process, and the placement of its wheel or None.

    Args:
        scene: The scene.
        log: Called with lines for the log.
        own: Builds a model of gmsh in place of a script that the scene names.
    """
    mesh = scene.mesh
    if own is not None and not isinstance(mesh, GmshMesh):
        raise SceneError(f"mesh = {own!r}: expected a scene with mesh.kind = 'gmsh'")
    if isinstance(mesh, WheelRailMesh):
        for line in readings(mesh):
            log(line)
        return cached_wheel_on_rail(scene, mesh, log)
    if isinstance(mesh, Foreign):
        return foreign(scene, mesh, log, own)
    if isinstance(mesh, RailMesh):
        return rail_alone(mesh), None
    if isinstance(mesh, BarMesh):
        return blocks.bar(mesh.length, mesh.width, width=mesh.width, size=mesh.size), None
    if isinstance(mesh, BlocksMesh):
        return block_on_base(mesh), None
    if isinstance(mesh, CurvedMesh):
        return curved_on_curved(mesh), None
    if isinstance(mesh, HollowSphereMesh):
        radii, grading = (mesh.inner_radius, mesh.outer_radius), (mesh.size, mesh.growth)
        return shells.hollow_sphere(*radii, *grading, across=mesh.across), None
    assert isinstance(mesh, CapMesh)
    cap = caps.sphere_cap(mesh.radius, mesh.extent, size=mesh.size, growth=mesh.growth)
    return join(cap, caps.base(mesh.extent, size=mesh.size, growth=mesh.growth)), None


def foreign(
    scene: Scene,
    mesh: FileMesh | GmshMesh,
    log: Callable[[str], Any],
    own: Callable[..., Any] | None,
) -> tuple[HexMesh, Any]:
    """Return the mesh of another program and its wheel; what reads it is imported only here."""
    from workflow.model import files

    if isinstance(mesh, GmshMesh):
        return files.from_gmsh(scene, mesh, log, own), files.wheel_of(mesh)
    return files.from_file(scene, mesh, log), files.wheel_of(mesh)


def block_on_base(mesh: BlocksMesh) -> HexMesh:
    """Return a block that rests near the start of a longer base, free to slide in +x."""
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


def curved_on_curved(mesh: CurvedMesh) -> HexMesh:
    """Return two curved bodies that touch at the origin."""
    upper, lower = footings(mesh)
    base = caps.below(lower, radius=mesh.base_radius, crown=mesh.base_crown)
    if mesh.rolls:
        assert mesh.radius is not None
        return join(caps.roller(upper, radius=mesh.radius, crown=mesh.crown), base)
    return join(caps.cap(upper, radius=mesh.radius, crown=mesh.crown), base)


def footings(mesh: CurvedMesh) -> tuple[caps.Footing, caps.Footing]:
    """Return the plans of the upper and the lower of two curved bodies."""
    shape = (mesh.x, mesh.y, mesh.fine_x, mesh.fine_y or mesh.y)
    upper = caps.Footing(*shape, mesh.height, mesh.size, mesh.growth, mesh.layers)
    size = mesh.base_size or mesh.size
    return upper, caps.Footing(*shape, mesh.depth, size, mesh.growth, mesh.layers)


def yaw_of(scene: Scene) -> float:
    """Return the angle of attack of the wheelset of a scene [rad]."""
    return scene.rolling.angle_of_attack if scene.rolling else 0.0


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


def read_mesh(scene: Scene, log: Callable[[str], Any]) -> HexMesh | None:
    """Return the mesh of a scene that comes from a file or a model of gmsh, None of any other.

    Raises:
        SceneError: naming the key that cannot be used.
    """
    if not isinstance(scene.mesh, Foreign):
        return None
    # whether it was kept is of no interest before a run
    mesh, _ = mesh_of(scene, lambda line: None if line.startswith("mesh: ") else log(line))
    return mesh


def readings(mesh: WheelRailMesh) -> Iterator[str]:
    """Yield what is understood of the profile files of a scene, and what of it to doubt."""
    kinds: tuple[Kind, Kind] = ("wheel", "rail")
    for kind in kinds:
        if (read := reading(mesh, kind)) is not None:
            yield f"mesh.{kind}_profile: {read.in_words()}"
            for doubt in read.doubts():
                yield f"mesh.{kind}_profile: {doubt}"


def built_in(kind: "Kind") -> tuple[str, ...]:
    """Return the names of the profiles that come with the package."""
    return ("S1002",) if kind == "wheel" else tuple(profiles.RAILS)


def reading(mesh: WheelRailMesh, kind: "Kind") -> "profiles.Reading | None":
    """Return the profile file that a scene names, as understood; None if it is a built-in one.

    Raises:
        SceneError: naming the key of a profile that cannot be used.
    """
    name: str = getattr(mesh, f"{kind}_profile")
    asked = getattr(mesh, f"{kind}_axes")
    if name in built_in(kind):
        if asked is not None:
            raise SceneError(
                f"mesh.{kind}_axes: expected a file as mesh.{kind}_profile, got {name!r}, built in"
            )
        return None
    axes = profiles.Axes(
        **(asked.model_dump() if asked else {}),
        flange_back=mesh.flange_back,
        gauge_depth=mesh.gauge_depth,
    )
    try:
        return profiles.read(name, kind, axes, mesh.profile_smoothing)
    except ValueError as error:
        raise SceneError(
            f"mesh.{kind}_profile = {name!r}: {error} (mesh.{kind}_axes tells how its coordinates "
            "are meant)"
        ) from None
    except OSError as error:
        expected = f"expected one of {', '.join(built_in(kind))} or a file of points"
        raise SceneError(f"mesh.{kind}_profile = {name!r}: {error}; {expected}") from None


def profile(mesh: WheelRailMesh, kind: "Kind") -> "profiles.Profile":
    """Return the profile that a scene names, see ``reading``."""
    read = reading(mesh, kind)
    if read is not None:
        return read.profile
    return profiles.s1002() if kind == "wheel" else profiles.rail(mesh.rail_profile)


def profiles_of(mesh: WheelRailMesh) -> "tuple[profiles.Profile, profiles.Profile, str]":
    """Return wheel profile, rail head with its sides, and the rail whose web and foot it gets.

    Raises:
        SceneError: naming the key of a profile that cannot be used.
    """
    from meshes.wheel_rail.rail_section import completed

    base = mesh.rail_profile if mesh.rail_profile in profiles.RAILS else mesh.rail_base
    wheel, head = profile(mesh, "wheel"), profile(mesh, "rail")
    try:
        return wheel, completed(head, base), base
    except ValueError as error:
        raise SceneError(f"mesh.rail_profile = {mesh.rail_profile!r}: {error}") from None


def in_track(mesh: WheelRailMesh, head: "profiles.Profile") -> "profiles.Profile":
    """Return a rail head in the track position of a scene.

    Raises:
        ValueError: if it does not reach down to where the gauge is measured.
    """
    return profiles.rail_in_track(
        head, inclination=mesh.inclination, gauge=mesh.gauge, gauge_depth=mesh.gauge_depth
    )


def tape_of(mesh: WheelRailMesh) -> float:
    """Return the lateral position of the tape circle, not shifted [m]."""
    return mesh.back_to_back / 2 + mesh.flange_back


def placement_of(scene: Scene) -> "profiles.Placement":
    """Return where the wheel of a scene stands on the rail, as :func:`placed_at`."""
    assert isinstance(scene.mesh, WheelRailMesh)
    return placed_at(scene.mesh, yaw_of(scene))


def placed_at(mesh: WheelRailMesh, yaw: float) -> "profiles.Placement":
    """Return where a wheel stands on the rail: the flange just short of the corner.

    With ``mesh.lateral_shift``, or if the wheel has no flange, it stands at that shift instead.

    Raises:
        SceneError: if a profile cannot be used or no lateral position leaves the flange gap.
    """
    from meshes.profiles.features import flange_of

    wheel, head, _ = profiles_of(mesh)
    turn: dict[str, Any] = {"radius": mesh.wheel_radius, "yaw": yaw, "roll": mesh.roll}
    turn["tape"] = tape_of(mesh)
    shift = mesh.lateral_shift
    if shift is None and flange_of(wheel) is None:
        shift = 0.0
    key, value = ("flange_gap", mesh.flange_gap) if shift is None else ("lateral_shift", shift)
    try:
        rail = in_track(mesh, head)
        if shift is None:
            return profiles.lateral_shift_for(wheel, rail, flange_gap=mesh.flange_gap, **turn)
        placement = profiles.place(wheel, rail, shift=shift, **turn)
        gap = placement.flange_gap
        if gap is not None and gap < -OVERLAP * mesh.size:
            most = profiles.lateral_shift_for(wheel, rail, flange_gap=0.0, **turn).shift
            raise ValueError(
                f"the flange would stand {-gap:.2e} m inside the rail; expected at most "
                f"{most:.5f} m, where it touches; or leave it out and give mesh.flange_gap, which "
                "equilibrium.shift or equilibrium.approach can close under load"
            )
        return placement
    except ValueError as error:
        remedy = "; mesh.lateral_shift, which may be negative, takes its place" * (shift is None)
        raise SceneError(
            f"mesh.{key} = {value} with mesh.wheel_profile = {mesh.wheel_profile!r} on "
            f"mesh.rail_profile = {mesh.rail_profile!r}: {error}{remedy}"
        ) from None


def strips_of(scene: Scene) -> dict[str, "Strip | None"]:
    """Return the strips of narrow cells of a scene, as :func:`strips_at`."""
    assert isinstance(scene.mesh, WheelRailMesh)
    return strips_at(scene.mesh, yaw_of(scene))


def strips_at(mesh: WheelRailMesh, yaw: float) -> dict[str, "Strip | None"]:
    """Return the strips of narrow cells on wheel and rail at an angle of attack [rad].

    None where the scene asks for none, or leaves their place to a flange that the wheel has not.

    Raises:
        SceneError: if they have to be found and no position lets the flange touch.
    """
    if mesh.strip is None:
        return {"wheel": None, "rail": None}
    from meshes.generate.sweep import Strip
    from meshes.profiles.features import flange_of
    from meshes.profiles.placement import narrow_arcs

    given = {"wheel": mesh.strip.wheel, "rail": mesh.strip.rail}
    wheel, head, _ = profiles_of(mesh)
    if None in given.values() and flange_of(wheel) is not None:
        turn = {"radius": mesh.wheel_radius, "yaw": yaw, "roll": mesh.roll, "tape": tape_of(mesh)}
        try:
            found = narrow_arcs(wheel, in_track(mesh, head), **turn)
        except ValueError as error:
            raise SceneError(
                f"mesh.strip: {error}; expected a flange that can touch, or the arc lengths "
                "mesh.strip.wheel and mesh.strip.rail"
            ) from None
        given = {side: given[side] or found[side] for side in given}
    lengths, size = {"wheel": wheel.length, "rail": head.length}, mesh.strip.size
    for side, arc in given.items():
        if arc and not 0 <= arc[0] < arc[1] <= lengths[side]:
            raise SceneError(
                f"mesh.strip.{side} = {list(arc)}: expected a rising stretch of the profile's arc "
                f"length, 0 to {lengths[side]:.4f} m"
            )
    return {side: Strip(*arc, size) if arc else None for side, arc in given.items()}


def cached_wheel_on_rail(
    scene: Scene, mesh: WheelRailMesh, log: Callable[[str], Any]
) -> tuple[HexMesh, Any]:
    """Return wheelset and rail as made before from the same tables and code, or made now."""
    from meshes import cache

    inputs = {
        "mesh": mesh.model_dump(mode="json"),
        "zone": rolling_zone(scene),
        "yaw": yaw_of(scene),
    }
    name = cache.key(inputs, [Path(__file__)])
    return cache.cached(name, lambda: wheel_on_rail(scene, mesh), log)


def plans(
    mesh: WheelRailMesh, yaw: float, zone: tuple[float, float]
) -> "tuple[profiles.Placement, dict[str, Any], dict[str, Any]]":
    """Return the placement of a wheel, and what its mesh and that of the rail are made from.

    Args:
        mesh: The table of the scene.
        yaw: Angle of attack [rad].
        zone: Where along the rail it will roll [m].

    Raises:
        SceneError: naming the key of a profile or position that cannot be used.
    """
    position, strips = placed_at(mesh, yaw), strips_at(mesh, yaw)
    tread, head, base = profiles_of(mesh)
    both = {"size": mesh.size, "zone": zone}
    wheel = both | {
        "design": mesh.wheel_design,
        "radius": mesh.wheel_radius,
        "profile": tread,
        "touch": position.tread_s,
        "strip": strips["wheel"],
    }
    rail = both | {
        "length": mesh.rail_length,
        "x0": -mesh.rail_length / 2 - mesh.start,
        "profile": head,
        "design": base,
        "touch": position.tread_rail_s,
        "strip": strips["rail"],
    }
    return position, wheel, rail


def wheel_on_rail_cells(scene: Scene, mesh: WheelRailMesh) -> int:
    """Return about how many cells :func:`wheel_on_rail` makes, without making them.

    Raises:
        SceneError: naming the key that lets no mesh be made.
    """
    named = (mesh.wheel_profile, mesh.rail_profile)
    stamps = tuple(os.stat(name).st_mtime_ns for name in named if os.path.isfile(name))
    return _cells_of(mesh, yaw_of(scene), rolling_zone(scene), stamps)


@lru_cache(maxsize=64)  # the runs of a study share meshes
def _cells_of(
    mesh: WheelRailMesh, yaw: float, zone: tuple[float, float], stamps: tuple[int, ...]
) -> int:
    """Return about how many cells are made; ``stamps`` tell profiles that were written anew."""
    from meshes.wheel_rail.rail import rail_cells
    from meshes.wheel_rail.wheelset import wheelset_cells

    _, wheel, rail = plans(mesh, yaw, zone)
    found = 0
    for side, count, plan in (("wheel", wheelset_cells, wheel), ("rail", rail_cells, rail)):
        try:
            found += count(**plan)
        except ValueError as error:
            raise SceneError(_with_key(mesh, side, str(error))) from None
    if mesh.sleepers is not None:
        nx, ny, nz = mesh.sleepers.cells
        found += int(mesh.rail_length / mesh.sleepers.spacing) * nx * ny * nz
    return found


def _with_key(mesh: WheelRailMesh, side: str, error: str) -> str:
    """Return an error of a mesh with the key of the scene that its first word stands for."""
    word, _, told = error.partition(":")
    if word == "strip" and mesh.strip is not None:
        arc = getattr(mesh.strip, side)
        if arc:
            return f"mesh.strip.{side} = {list(arc)}:{told}"
        return (
            f"mesh.strip.{side}:{told}; found where wheel and rail come close unless it is told; "
            "without [mesh.strip] there is none"
        )
    keys = {"design": "wheel_design", "radius": "wheel_radius", "size": "size"}
    keys["zone"] = "rail_length" if side == "rail" else "margin"
    key = keys.get(word, f"{side}_profile")
    why = "; it is the way rolled in time.end and mesh.margin at either end" * ("zone" in error)
    return f"mesh.{key} = {getattr(mesh, key)!r}: {error}{why}"


def wheel_on_rail(scene: Scene, mesh: WheelRailMesh) -> tuple[HexMesh, Any]:
    """Return wheelset and rail in the track position, and the placement of the wheel."""
    from meshes.profiles.placement import placed
    from meshes.wheel_rail.rail import rail
    from meshes.wheel_rail.wheelset import wheelset

    position = placement_of(scene)
    zone = rolling_zone(scene)
    start = mesh.start
    tread, head, base = profiles_of(mesh)
    strips = strips_of(scene)
    wheel = wheelset(
        size=mesh.size,
        zone=zone,
        design=mesh.wheel_design,
        radius=mesh.wheel_radius,
        tape=tape_of(mesh),
        profile=tread,
        touch=position.tread_s,
        strip=strips["wheel"],
    )
    track = rail(
        mesh.rail_length,
        -mesh.rail_length / 2 - start,
        size=mesh.size,
        zone=zone,
        inclination=mesh.inclination,
        gauge=mesh.gauge,
        gauge_depth=mesh.gauge_depth,
        profile=head,
        design=base,
        touch=position.tread_rail_s,
        strip=strips["rail"],
    )
    return join(placed(wheel, position), track, *sleepers_under(track, mesh)), position


def sleepers_under(track: HexMesh, mesh: RailMesh | WheelRailMesh) -> Iterator[HexMesh]:
    """Yield the solid sleepers under a rail, if the scene has them."""
    if mesh.sleepers is not None:
        from meshes.wheel_rail.sleepers import sleepers

        foot = track.points[np.unique(track.surface(Tag.FOOT_UNDERSIDE))]
        yield sleepers(foot, **mesh.sleepers.model_dump())


def rail_plan(mesh: RailMesh) -> dict[str, Any]:
    """Return what the mesh of a rail without wheel is made from."""
    return {
        "length": mesh.rail_length,
        "x0": -mesh.rail_length / 2 - mesh.start,
        "size": mesh.size,
        "zone": (-mesh.fine_length / 2, mesh.fine_length / 2),
        "largest": mesh.longest,
        "design": mesh.rail_profile,
    }


def rail_alone(mesh: RailMesh) -> HexMesh:
    """Return a rail in the track position without a wheel, on its sleepers if it has them.

    Raises:
        SceneError: naming the key that lets no mesh be made.
    """
    from meshes.wheel_rail.rail import coarse_rail

    placed = {k: getattr(mesh, k) for k in ("inclination", "gauge", "gauge_depth")}
    try:
        track = coarse_rail(**rail_plan(mesh), **placed)
    except ValueError as error:
        raise SceneError(_of_rail(mesh, str(error))) from None
    return join(track, *sleepers_under(track, mesh))


def rail_alone_extent(mesh: RailMesh) -> tuple[int, int]:
    """Return how many cells and nodes :func:`rail_alone` makes; it raises as that."""
    from meshes.wheel_rail.rail import coarse_rail_extent
    from meshes.wheel_rail.sleepers import places

    plan = rail_plan(mesh)
    try:
        cells, nodes = coarse_rail_extent(**plan)
    except ValueError as error:
        raise SceneError(_of_rail(mesh, str(error))) from None
    if mesh.sleepers is not None:
        n = np.array(mesh.sleepers.cells)
        under = len(places(plan["x0"], plan["x0"] + mesh.rail_length, mesh.sleepers.spacing))
        cells, nodes = cells + under * int(n.prod()), nodes + under * int((n + 1).prod())
    return cells, nodes


def _of_rail(mesh: RailMesh, error: str) -> str:
    """Return an error of the mesh of a rail with the key that its first word stands for."""
    word, _, told = error.partition(":")
    key = {"size": "size", "zone": "rail_length"}[word]
    return f"mesh.{key} = {getattr(mesh, key)!r}:{told}"


def export(scene: Scene, path: Path) -> dict[str, Any]:
    """Write the mesh of a scene to a file and return what it holds.

    Raises:
        SceneError: if the file cannot be written, or not in that format.
    """
    from meshes.formats import read_write

    if path.suffix.lower() not in read_write.FORMATS:
        expected = ", ".join(read_write.FORMATS)
        raise SceneError(f"file = {str(path)!r}: expected a name ending in one of {expected}")
    mesh, placement = mesh_of(scene)
    try:
        read_write.write(mesh, path)
    except (ValueError, OSError) as error:
        raise SceneError(f"file = {str(path)!r}: {error}") from None
    told: dict[str, Any] = {
        "file": str(path),
        "cells": len(mesh.cells),
        "nodes": len(mesh.points),
        "regions": mesh.counts(mesh.regions),
        "surfaces": mesh.counts(mesh.surfaces),
        "mesh": {"kind": "file", "path": str(path)},
    }
    if scene.mesh.size is not None:
        told["mesh"]["size"] = scene.mesh.size
    if placement is not None:
        told["mesh"]["wheel_centre"] = [float(c) for c in placement.centre]
        told["mesh"]["rolling_radius"] = float(placement.rolling_radius)
    return told


def in_words(told: dict[str, Any]) -> str:
    """Return what :func:`export` told, with the table for a scene that reads the file."""
    lines = [f"{told['file']}: {told['cells']} cells, {told['nodes']} nodes"]
    lines += [f"{kind}: {', '.join(told[kind])}" for kind in ("regions", "surfaces")]
    table = (f"{key} = {json.dumps(value)}" for key, value in told["mesh"].items())
    return "\n".join([*lines, "", "[mesh]", *table])
