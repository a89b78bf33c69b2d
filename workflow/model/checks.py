# SPDX-License-Identifier: LGPL-3.0-or-later
"""Checks of a scene before its mesh is made, and of its bodies as soon as they are meshed.

``squealx validate`` and every model that is built make the same ones: what one passes, the other
accepts. Each message names the key, what it got and what it expects.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from meshes.hexmesh import HexMesh
from workflow.model.advice import TURN, turns
from workflow.model.cost import (
    Cost,
    cost_of,
    extent_of,
    host_memory,
    room_for,
    size_in_words,
    wave_speed,
)
from workflow.model.residual import unfit
from workflow.scene.bodies import FOLLOWING
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
from workflow.scene.settings import RigidWall

MOST_OUTPUTS, MOST_SAMPLES, MOST_STEPS = 10_000_000, 10_000_000, 1e10
FEW, LEAST = 5.0, 3.0  # steps that a prescribed motion takes: as estimated, and as they are
NARROWEST = 0.01  # cells of a strip over those of the zone
CLOSE, SURE = 1.5, 2.0  # room over results, results over room: doubted below, refused above
WAY = 0.25  # of the shortest edge, the most that bodies come closer in a step


def check(scene: Scene, mesh: HexMesh | None = None) -> Cost:
    """Return what the run of a scene takes; nothing is meshed.

    Args:
        scene: The scene.
        mesh: Its mesh, if it is there already.

    Raises:
        SceneError: naming the keys that no run can have.
    """
    if wrong := [*_numbers(scene), *_sizes(scene), *_rotations(scene), *unfit(scene)]:
        raise SceneError("\n".join(wrong))
    cost = cost_of(scene, mesh)
    if wrong := [*_limits(scene, cost), *_motions(scene, cost)]:
        raise SceneError("\n".join(wrong))
    return cost


def _numbers(scene: Scene) -> Iterator[str]:
    """Yield a line for outputs and samples beyond all use."""
    end = scene.time.end
    for key, interval, most in (
        ("time.output_interval", scene.time.output_interval, MOST_OUTPUTS),
        ("output.sample_interval", scene.output.sample_interval, MOST_SAMPLES),
    ):
        if interval is not None and end / interval > most:
            yield (
                f"{key} = {interval}: {end / interval:.2g} of them in {end} s; expected at most "
                f"{most:.0e}, {end / most:.1e} s or more"
            )


def _sizes(scene: Scene) -> Iterator[str]:
    """Yield a line for every cell that is larger than its body."""
    mesh = scene.mesh
    given: list[tuple[str, float | None, tuple[float, ...]]] = []
    if isinstance(mesh, BarMesh):
        given = [("size", mesh.size, (mesh.length, mesh.width))]
    elif isinstance(mesh, BlocksMesh):
        given = [("size", mesh.size, mesh.block), ("base_size", mesh.base_size, mesh.base)]
    elif isinstance(mesh, CapMesh):
        given = [("size", mesh.size, (mesh.extent,))]
    elif isinstance(mesh, HollowSphereMesh):
        given = [("size", mesh.size, (mesh.outer_radius - mesh.inner_radius,))]
    elif isinstance(mesh, CurvedMesh):
        plan = [mesh.x[1] - mesh.x[0]] + [mesh.y[1] - mesh.y[0]] * (mesh.layers is None)
        given = [("size", mesh.size, (*plan, mesh.height))]
        given += [("base_size", mesh.base_size, (*plan, mesh.depth))]
    elif isinstance(mesh, WheelRailMesh):
        if not 0.5e-3 <= mesh.size <= 8e-3:
            yield f"mesh.size = {mesh.size}: expected 0.0005 to 0.008 m for a wheel on a rail"
        elif mesh.strip is not None and mesh.strip.size < NARROWEST * mesh.size:
            yield (
                f"mesh.strip.size = {mesh.strip.size}: expected {NARROWEST * mesh.size:.1e} m or "
                f"more, {NARROWEST:g} of mesh.size"
            )
    for key, size, lengths in given:
        if size is not None and size > (1 + 1e-9) * min(lengths):
            yield (
                f"mesh.{key} = {size}: coarser than the body; expected at most {min(lengths)} m, "
                "its smallest extent"
            )


def _rotations(scene: Scene) -> Iterator[str]:
    """Yield a line for every body that turns and takes that for strain."""
    for name, angle in turns(scene).items():
        body = scene.bodies[name]
        if angle > TURN and body.kinematics == "small-strain":
            law, strain = body.material.law, 1 - np.cos(min(angle, np.pi))
            linear = law in FOLLOWING
            wanted = "'total-lagrangian', as if left out" if linear else "a law made for rotation"
            yield (
                f"bodies.{name}.kinematics = 'small-strain' with material.law = {law!r}: the body "
                f"turns by {angle:.2g} rad, which it takes for strains of up to {strain:.1g}; "
                f"expected {wanted}"
            )


def _limits(scene: Scene, cost: Cost) -> Iterator[str]:
    """Yield a line for what this machine, or a life, has not enough of."""
    if cost.steps > MOST_STEPS:
        yield (
            f"time.end = {scene.time.end}: about {cost.steps:.1e} steps of {cost.step:.1e} s; "
            f"expected at most {MOST_STEPS:.0e}. The step follows the shortest edge, the wave "
            "speed, damping, time.output_interval and time.safety"
        )
    most = host_memory()
    if cost.memory > most:
        key, size = _finest(scene)
        fits = _fitting(scene, key, cost.memory / cost.cells, most)
        wanted = f"expected {fits:.2g} m or more" if fits else "expected fewer cells"
        yield (
            f"mesh.{key} = {size}: {cost.cells:.3g} cells take about {size_in_words(cost.memory)} "
            f"of memory, this machine has {size_in_words(most)}; {wanted}"
        )


def _finest(scene: Scene) -> tuple[str, float | str]:
    """Return the key of the mesh that most of its cells come from, and its value."""
    mesh = scene.mesh
    if isinstance(mesh, FileMesh):
        return "path", mesh.path
    if isinstance(mesh, GmshMesh):
        return ("size", mesh.size) if mesh.size else ("kind", mesh.kind)
    base = getattr(mesh, "base_size", None)
    return ("base_size", base) if base is not None and base < mesh.size else ("size", mesh.size)


def _fitting(scene: Scene, key: str, per_cell: float, memory: float) -> float | None:
    """Return the smallest size of cells of a shape whose mesh has room in the memory [m]."""
    if isinstance(scene.mesh, Foreign | RailMesh | WheelRailMesh):
        return None
    size = getattr(scene.mesh, key)
    for _ in range(400):
        size *= 1.1
        other = scene.mesh.model_copy(update={key: size})
        if per_cell * extent_of(scene.model_copy(update={"mesh": other})).cells < memory:
            return float(size)
    return None


def check_room(scene: Scene, cost: Cost, folder: Path) -> Iterator[str]:
    """Yield a line if the results of a run may not find room.

    Args:
        scene: The scene.
        cost: What its run takes.
        folder: Where the results are to go.

    Raises:
        SceneError: if they surely do not: disk is estimated to a factor of 2.
    """
    room = room_for(folder)
    if cost.disk < room / CLOSE:
        return
    fields = ", or output.fields = false" if scene.output.fields else ""
    line = (
        f"time.output_interval = {scene.time.output_interval}: {cost.outputs} outputs of "
        f"{cost.nodes} nodes take about {size_in_words(cost.disk)}, where {str(folder)!r} is to be "
        f"there is room for {size_in_words(room)}; expected a longer one{fields}, or another disk"
    )
    if cost.disk > SURE * room:
        raise SceneError(line)
    yield line


def check_step(scene: Scene, step: float) -> None:
    """Raise SceneError for motion that is over within too few steps, now that they are known.

    Asked for is less than by :func:`check`, whose steps are within a third of these.
    """
    if wrong := list(_ramps(scene, step, LEAST)):
        raise SceneError("\n".join(wrong))


def _ramps(scene: Scene, step: float, least: float) -> Iterator[str]:
    """Yield a line for every prescribed motion that is over within a few steps."""
    ramps = {f"supports.{i}.ramp": s.ramp for i, s in enumerate(scene.supports) if s.velocity}
    ramps |= {f"driven.{k}.shift_time": d.shift_time for k, d in scene.driven.items()}
    for key, time in ramps.items():
        if 0 < time < least * step:
            yield (
                f"{key} = {time}: over within {time / step:.2g} steps of {step:.1e} s; expected "
                f"{least:g} or more, {least * step:.1e} s"
            )


def _motions(scene: Scene, cost: Cost) -> Iterator[str]:
    """Yield a line for every motion that is over, or through a surface, within a few steps."""
    yield from _ramps(scene, cost.step, FEW)
    start = {name: b.velocity or (0.0, 0.0, 0.0) for name, b in scene.bodies.items()}
    others = [*start.values()]
    if any(isinstance(contact.target, RigidWall) for contact in scene.contacts.values()):
        others.append((0.0, 0.0, 0.0))
    for name, v in start.items() if scene.contacts else ():
        closing = max(float(np.linalg.norm(np.subtract(v, other))) for other in others)
        way = closing * cost.step / cost.edge
        if any(v) and way > WAY:
            yield (
                f"bodies.{name}.velocity = {list(v)}: {closing:.3g} m/s, {way:.2g} of a cell in a "
                f"step of about {cost.step:.1e} s, and through a surface unseen; expected at most "
                f"{closing * WAY / way:.2g} m/s (waves run at "
                f"{wave_speed(scene.bodies[name]):.2g} m/s)"
            )
