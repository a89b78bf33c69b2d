# SPDX-License-Identifier: LGPL-3.0-or-later
"""Meshes of scenes from and to files of other programs: read and checked, exported and told."""

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from meshes.hexmesh import HexMesh
from workflow.file_mesh import FileMesh
from workflow.scene import Scene, SceneError


@dataclass(frozen=True)
class Wheel:
    """What rolling needs to know of a wheel.

    Attributes:
        centre: A point of its axle, shape ``(3,)`` [m].
        rolling_radius: Its radius at the first contact [m].
    """

    centre: npt.NDArray[np.float64]
    rolling_radius: float


def mesh_from_file(
    scene: Scene, table: FileMesh, log: Callable[[str], Any]
) -> tuple[HexMesh, Wheel | None]:
    """Return the mesh of a file, checked against the scene, and the wheel that rolls on it.

    Raises:
        SceneError: if the file cannot be used, or not for this scene.
    """
    from meshes.formats import read_write

    try:
        mesh = read_write.read(table.path, scale=table.scale, names=table.groups, log=log)
    except (ValueError, OSError) as error:
        raise SceneError(f"mesh.path = {table.path!r}: {error}") from None
    if wrong := list(unfit_surfaces(scene, mesh)):
        raise SceneError("\n".join(wrong))
    if table.wheel_centre is None or table.rolling_radius is None:
        return mesh, None
    return mesh, Wheel(np.array(table.wheel_centre), table.rolling_radius)


def unfit_surfaces(scene: Scene, mesh: HexMesh) -> Iterator[str]:
    """Yield a line for every surface without facets, and for contact surfaces inside the mesh."""
    from meshes.formats.conform import matched

    for key, name in scene.surfaces():
        facets = mesh.surface(mesh.tag(name))
        if not len(facets):
            yield f"{key} = {name!r}: expected facets of hexahedra, the group has none"
        elif key.startswith("contacts."):
            inner = int((matched(mesh.cells, facets)[1] > 1).sum())
            if inner:
                yield (
                    f"{key} = {name!r}: {inner} of its {len(facets)} facets lie between two "
                    "hexahedra; expected outer facets (bodies in contact must not share nodes)"
                )


def export(scene: Scene, path: Path) -> dict[str, Any]:
    """Write the mesh of a scene to a file and return what it holds.

    Raises:
        SceneError: if the file cannot be written, or not in that format.
    """
    from meshes.formats import read_write
    from workflow.geometry import mesh_of

    if path.suffix.lower() not in read_write.FORMATS:
        expected = ", ".join(read_write.FORMATS)
        raise SceneError(f"file = {str(path)!r}: expected a name ending in one of {expected}")
    mesh, placement = mesh_of(scene)
    try:
        read_write.write(mesh, path)
    except (ValueError, OSError) as error:
        raise SceneError(f"file = {str(path)!r}: {error}") from None
    tags, counts = np.unique(mesh.regions, return_counts=True)
    told: dict[str, Any] = {
        "file": str(path),
        "cells": len(mesh.cells),
        "nodes": len(mesh.points),
        "regions": {mesh.name(int(t)): int(n) for t, n in zip(tags, counts, strict=True)},
    }
    tags, counts = np.unique(mesh.surfaces, return_counts=True)
    told["surfaces"] = {mesh.name(int(t)): int(n) for t, n in zip(tags, counts, strict=True)}
    told["mesh"] = {"kind": "file", "path": str(path)}
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
