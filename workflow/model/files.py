# SPDX-License-Identifier: LGPL-3.0-or-later
"""Meshes of other programs in a scene: files and models of gmsh, checked against what uses them."""

import importlib.util
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from meshes.arrays import Flags
from meshes.hexmesh import HexMesh
from meshes.quality import cell_volumes, edge_lengths
from workflow.model.regions import owners
from workflow.scene.mesh import FileMesh, GmshMesh
from workflow.scene.scene import Scene, SceneError

Log = Callable[[str], Any]
Maker = Callable[..., Any]  # builds a model of gmsh from the parameters of a scene
HEAVY = 1e5  # kg: no scene of squealx weighs as much
COARSE = 0.1  # m: nor has cells of which the smallest is that large


@dataclass(frozen=True)
class Wheel:
    """What rolling needs to know of a wheel.

    Attributes:
        centre: A point of its axle, shape ``(3,)`` [m].
        rolling_radius: Its radius at the first contact [m].
    """

    centre: npt.NDArray[np.float64]
    rolling_radius: float


def wheel_of(table: FileMesh | GmshMesh) -> Wheel | None:
    """Return the wheel that a table tells of, None if it does not."""
    if table.wheel_centre is None or table.rolling_radius is None:
        return None
    return Wheel(np.array(table.wheel_centre), table.rolling_radius)


def from_file(scene: Scene, table: FileMesh, log: Log) -> HexMesh:
    """Return the mesh of a file, checked against the scene.

    Raises:
        SceneError: if the file cannot be used, or not for this scene.
    """
    from meshes.formats import read_write

    try:
        mesh = read_write.read(table.path, scale=table.scale, names=table.groups, log=log)
    except (ValueError, OSError) as error:
        raise SceneError(f"mesh.path = {table.path!r}: {error}") from None
    check(scene, mesh, log)
    log(size_of(scene, mesh, table.scale))
    return mesh


def from_gmsh(scene: Scene, table: GmshMesh, log: Log, own: Maker | None) -> HexMesh:
    """Return the mesh of a model of gmsh, checked against the scene; a function of yours is called.

    That of a script or of a function by name is kept in the cache of meshes. A function given from
    Python is called each time, since it may depend on anything.

    Raises:
        SceneError: if gmsh or the function refuses, or the mesh does not fit the scene.
    """
    from meshes import cache
    from meshes.formats import gmsh_model

    names = (*table.regions, *table.surfaces)
    given = table.parameters if table.size is None else {**table.parameters, "size": table.size}
    key = f"mesh.{table.source}" if own is None else "mesh"

    def make(model: Path | Maker) -> HexMesh:
        return gmsh_model.meshed(model, given, names=names, log=log)

    try:
        if own is not None:
            mesh = make(own)
        elif table.source is None:
            raise ValueError(
                "expected mesh.path, mesh.function, or run(scene, out, mesh=function) from Python"
            )
        else:
            model, sources = _model(table)
            inputs = {"mesh": table.model_dump(mode="json"), "gmsh": gmsh_model.version()}
            name = cache.key(inputs, sources)
            mesh, _ = cache.cached(name, lambda: (make(model), None), log)
    except (ValueError, OSError) as error:
        raise SceneError(f"{key}: {error}") from None
    check(scene, mesh, log)
    return mesh


def _model(table: GmshMesh) -> tuple[Path | Maker, list[Path]]:
    """Return the script or function of a table, and the files that it is made of."""
    if table.path is not None:
        from meshes.formats.gmsh_model import script_files

        path = Path(table.path)
        if not path.is_file():
            raise ValueError(f"{table.path!r}: no such file")
        return path, sorted(script_files(path))
    assert table.function is not None
    path, name = table.file_and_name
    function = _function(path, name)
    files = (getattr(module, "__file__", None) for module in list(sys.modules.values()))
    beside = (Path(file) for file in files if file)
    return function, sorted({path, *(p for p in beside if p.parent == path.parent)})


def _function(path: Path, name: str) -> Maker:
    """Return a function of a Python file, which may import others beside it."""
    if not path.is_file():
        raise ValueError(f"{str(path)!r}: no such file")
    spec = importlib.util.spec_from_file_location(f"squealx_mesh_{path.stem}", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.path.append(str(path.parent))  # at the end: no file there takes the place of a library
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise ValueError(f"{str(path)!r}: {type(error).__name__}: {error}") from error
    finally:
        sys.path.remove(str(path.parent))
    found = getattr(module, name, None)
    if not callable(found):
        raise ValueError(f"{str(path)!r}: expected a function {name!r} in it")
    return found


def check(scene: Scene, mesh: HexMesh, log: Log) -> None:
    """Refuse a mesh that does not fit what the scene uses of it; tell where a body comes apart."""
    from meshes.formats.conform import coincident

    if wrong := [*unfit_surfaces(scene, mesh), *shared_nodes(scene, mesh)]:
        raise SceneError("\n".join(wrong))
    bodies, body_of = list(scene.bodies), owners(scene)
    number = np.zeros(len(mesh.cells), dtype=np.int32)
    for region, body in body_of.items():
        number[mesh.regions == mesh.tag(region)] = bodies.index(body)
    _, within, (x, y, z) = coincident(mesh.points, mesh.cells, number)
    if within:
        log(
            f"mesh file: {within} pairs of nodes of one body coincide, the first at x = {x:.5g}, "
            f"y = {y:.5g}, z = {z:.5g} m. It comes apart there unless they are merged in the "
            "mesher (gmsh: Coherence Mesh)"
        )


def unfit_surfaces(scene: Scene, mesh: HexMesh) -> Iterator[str]:
    """Yield a line for every surface without facets, and for contact surfaces inside the mesh."""
    from meshes.formats.conform import matched

    for key, name in scene.surfaces():
        facets = mesh.surface(mesh.names.get(name.lower(), -1))
        if not len(facets):
            yield f"{key} = {name!r}: expected facets of hexahedra, the group has none"
        elif key.startswith("contacts."):
            inner = int((matched(mesh.cells, facets)[1] > 1).sum())
            if inner:
                yield (
                    f"{key} = {name!r}: {inner} of its {len(facets)} facets lie between two "
                    "hexahedra; expected outer facets (bodies in contact must not share nodes)"
                )


def shared_nodes(scene: Scene, mesh: HexMesh) -> Iterator[str]:
    """Yield a line for every contact pair whose surfaces or bodies have nodes in common."""
    held: dict[str, Flags] = {}
    for region, body in owners(scene).items():
        nodes = held.setdefault(body, np.zeros(len(mesh.points), dtype=bool))
        nodes[mesh.nodes(mesh.tag(region))] = True
    for name, contact in scene.contacts.items():
        if not isinstance(contact.target, str):
            continue
        sides = [
            mesh.surface(mesh.names.get(surface.lower(), -1))
            for surface in (contact.contactor, contact.target)
        ]
        first, second = (
            [body for body, nodes in held.items() if nodes[facets].all(axis=1).any()]
            for facets in sides
        )
        pairs = {tuple(sorted((a, b))) for a in first for b in second if a != b}
        common = {f"bodies {a!r} and {b!r}": held[a] & held[b] for a, b in sorted(pairs)}
        both = np.zeros(len(mesh.points), dtype=bool)
        both[np.intersect1d(sides[0], sides[1])] = True
        common[f"surfaces {contact.contactor!r} and {contact.target!r}"] = both
        for what, nodes in common.items():
            if nodes.any():
                node = int(np.argmax(nodes))
                x, y, z = mesh.points[node]
                yield (
                    f"contacts.{name}: its {what} share {nodes.sum()} nodes, the first is node "
                    f"{node + 1} at x = {x:.6g}, y = {y:.6g}, z = {z:.6g} m; expected nodes of "
                    "their own (shared ones weld them together)"
                )
                break


def size_of(scene: Scene, mesh: HexMesh, scale: float) -> str:
    """Return extent and mass of a mesh in words, and the scale that it seems to lack."""
    extent = np.ptp(mesh.points, axis=0)
    volume = np.bincount(mesh.regions, cell_volumes(mesh.points, mesh.cells))
    densities = {
        mesh.tag(region): scene.bodies[body].material.density
        for region, body in owners(scene).items()
    }
    mass = sum(float(volume[tag]) * density for tag, density in densities.items())
    line = f"mesh file: {_metres(extent)}, {mass:.3g} kg"
    if mass > HEAVY or float(edge_lengths(mesh.points, mesh.cells).min()) > COARSE:
        line += (
            f". Is its unit the millimetre? mesh.scale = {scale * 1e-3:g} makes it "
            f"{_metres(extent * 1e-3)}, {mass * 1e-9:.3g} kg"
        )
    return line


def _metres(extent: npt.NDArray[np.float64]) -> str:
    return " × ".join(f"{length:.4g}" for length in extent) + " m"
