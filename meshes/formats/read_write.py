# SPDX-License-Identifier: LGPL-3.0-or-later
"""Input and output of hexahedral meshes in formats of other programs, groups as names."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from meshes.arrays import Index
from meshes.formats import conform
from meshes.formats.contents import Contents, Members, contents, groups
from meshes.hexmesh import HexMesh, boundary
from meshes.tags import NAMES

__all__ = ["groups", "read", "write"]

# Written without loss: what meshio calls the format, and what its names must not contain.
FORMATS = {
    ".msh": ("gmsh22", '"'),
    ".vtu": ("vtu", "-"),
    ".vtk": ("vtk", "- "),
    ".xdmf": ("xdmf", "-"),
    ".inp": ("abaqus", ",*="),
}
SOLIDS = ("hexahedron", "tetra", "wedge", "pyramid", "VTK_LAGRANGE_H", "VTK_LAGRANGE_T")
FIRST_TAG = 1000  # of names that squealx does not know


def read(
    path: str | Path,
    *,
    scale: float = 1.0,
    names: Mapping[str, str] | None = None,
    log: Callable[[str], Any] = lambda line: None,
) -> HexMesh:
    """Return the hexahedral mesh of a file.

    Names that squealx knows get its tags, all others tags from 1000 on. Surfaces may lie between
    two cells; contact surfaces may not, which is checked where they are used.

    Args:
        path: Any file that meshio reads, or an input file of Abaqus.
        scale: Length of the file's unit [m].
        names: Groups to use, by their name in the file, and what to call them; all if left out.
        log: Called with a line for everything that was put right.

    Raises:
        ValueError: if it cannot be used; the message lists what was found.
        OSError: if there is no such file.
    """
    found = contents(path)
    _check_types(found)
    if found.told:
        log(f"mesh file: left out, since neither cells nor facets: {found.told}")
    new = found.groups.called(names)
    _check_facets(found, new)
    tags = _tags(tuple(new[n] for n in (*found.regions, *found.groups.surfaces) if n in new))
    points = found.points * scale if scale != 1 else found.points
    if not np.isfinite(points).all():
        raise ValueError("some nodes have no finite position")
    cells, members, twice = conform.once(found.cells, found.regions)
    if twice:
        log(f"mesh file: {twice} hexahedra that are listed more than once taken once")
    cells, count = conform.turned(points, cells)
    if count:
        log(f"mesh file: {count} of {len(cells)} hexahedra turned the right way round")
    conform.check_apart(points, cells)
    regions = _regions(found, members, new, tags)
    quads, surfaces = _quads(found, cells, new, tags)
    facets, owners, flipped = conform.matched(cells, quads)
    if (stray := owners == 0).any():
        which = [n for n, t in tags.items() if (surfaces[stray] == t).any()]
        raise ValueError(
            f"{stray.sum()} quads of the surfaces {which} are not facets of hexahedra; "
            f"{found.listed}"
        )
    if flipped:
        log(f"mesh file: {flipped} of {len(facets)} facets turned to face outwards")
    points, cells, facets, dropped = conform.compact(points, cells, facets)
    if dropped:
        log(f"mesh file: {dropped} nodes that belong to no hexahedron left out")
    return HexMesh(points, cells, regions, facets, surfaces, tags)


def _check_types(found: Contents) -> None:
    """Refuse a file whose solid cells are not all hexahedra with eight nodes."""
    other = [t for t in found.types if t.startswith(SOLIDS) and t != "hexahedron"]
    if other or not len(found.cells):
        hint = ""
        if any(t.startswith(("hexahedron", "VTK_LAGRANGE_H")) for t in other):
            hint = " (mesh with order 1: in gmsh Mesh.ElementOrder = 1)"
        raise ValueError(f"expected hexahedra with 8 nodes only{hint}; {found.listed}")
    if not found.regions:
        raise ValueError(f"expected the hexahedra in named groups, got none; {found.listed}")


def _check_facets(found: Contents, new: Mapping[str, str]) -> None:
    """Refuse surfaces that are used and whose facets are not all quads."""
    if wrong := [f"{name!r} has {what}" for name, what in found.others.items() if name in new]:
        raise ValueError(
            f"surface {', '.join(wrong)}; expected quads, the faces of hexahedra (recombine them, "
            "or leave the group out in [mesh.groups])"
        )


def _tags(names: tuple[str, ...]) -> dict[str, int]:
    """Return a tag for each name: that of squealx, or one beyond."""
    foreign = sorted(set(names) - set(NAMES))
    beyond = {name: FIRST_TAG + k for k, name in enumerate(foreign)}
    return {name: NAMES.get(name, beyond.get(name, 0)) for name in dict.fromkeys(names)}


def _regions(
    found: Contents, members: Members, new: Mapping[str, str], tags: Mapping[str, int]
) -> npt.NDArray[np.int32]:
    """Return the region tag of each cell; each must have one."""
    regions = np.zeros(len(next(iter(members.values()))), dtype=np.int32)
    for name, mask in members.items():
        if name not in new:
            continue
        tag = tags[new[name]]
        if (twice := mask & (regions > 0) & (regions != tag)).any():
            before = [n for n, m in members.items() if (m & twice).any() and n != name]
            raise ValueError(
                f"{twice.sum()} hexahedra are in group {name!r} and in {before} too; name those "
                "to use, without overlap, in [mesh.groups]"
            )
        regions[mask] = tag
    if (none := regions == 0).any():
        raise ValueError(f"{none.sum()} hexahedra are in none of the groups used; {found.listed}")
    return regions


def _quads(
    found: Contents,
    cells: Index,
    new: Mapping[str, str],
    tags: Mapping[str, int],
) -> tuple[Index, npt.NDArray[np.int32]]:
    """Return the quads of all surfaces and their tags, in the order of the file, each once."""
    quads, numbers, surfaces = [], [], []
    for name, mask in found.sides.items():
        if name in new:
            numbers.append(np.flatnonzero(mask))
            quads.append(found.quads[mask])
            surfaces.append(np.full(len(numbers[-1]), tags[new[name]], dtype=np.int32))
    sets = [n for n in found.nodes if n in new and n not in found.sides]
    outer = boundary(cells) if sets else np.zeros((0, 4), dtype=np.int64)
    for name in sets:
        inside = outer[found.nodes[name][outer].all(axis=1)]
        quads.append(inside)
        numbers.append(np.full(len(inside), len(found.quads)))
        surfaces.append(np.full(len(inside), tags[new[name]], dtype=np.int32))
    if not quads:
        return np.zeros((0, 4), dtype=np.int64), np.zeros(0, dtype=np.int32)
    order = np.argsort(np.concatenate(numbers), kind="stable")
    every, tagged = np.vstack(quads)[order], np.concatenate(surfaces)[order]
    alike = np.column_stack([np.sort(every, axis=1), tagged])
    first = np.sort(np.unique(alike, axis=0, return_index=True)[1])
    return every[first], tagged[first]


def write(mesh: HexMesh, path: str | Path, names: Mapping[str, int] | None = None) -> None:
    """Write a mesh with its regions and surfaces as named groups; :func:`read` gives it back.

    Points keep every bit, cells and facets their order. A ``.msh`` is of version 2.2 and binary.

    Args:
        mesh: The mesh.
        path: Where to; the ending chooses the format: ``.msh .vtu .vtk .xdmf .inp``.
        names: Tag of each name; those of the mesh by default.

    Raises:
        ValueError: if the format is not among these, or cannot hold a name.
        OSError: if the file cannot be written.
    """
    import meshio

    path = Path(path)
    if path.suffix.lower() not in FORMATS:
        raise ValueError(f"expected a name ending in {', '.join(FORMATS)}, got {path.name!r}")
    kind, forbidden = FORMATS[path.suffix.lower()]
    called = {tag: name for name, tag in (mesh.names if names is None else names).items()}
    tags = [mesh.regions, mesh.surfaces]
    used = [{int(t): called.get(int(t), str(t)) for t in np.unique(of)} for of in tags]
    cells = [("hexahedron", mesh.cells), ("quad", mesh.facets)]
    _check_names(used, forbidden)
    if not len(mesh.facets):
        cells, tags, used = cells[:1], tags[:1], [used[0], {}]
    out = meshio.Mesh(mesh.points, cells)
    if kind == "gmsh22":
        data = [t.astype(np.int32) for t in tags]
        out.cell_data = {"gmsh:physical": data, "gmsh:geometrical": [d.copy() for d in data]}
        dims = ((3, used[0]), (2, used[1]))
        out.field_data = {n: np.array([t, dim]) for dim, of in dims for t, n in of.items()}
    elif kind == "abaqus":
        every = dict.fromkeys(n for of in used for n in of.values())
        number = {n: t for of in used for t, n in of.items()}
        out.cell_sets = {n: [np.flatnonzero(t == number[n]) for t in tags] for n in every}
    else:
        name = {**used[0], **used[1]}
        order = sorted(name)
        key = "-".join(name[t] for t in order)
        out.cell_data = {key: [np.searchsorted(order, t).astype(np.int32) for t in tags]}
    meshio.write(path, out, file_format=kind)


def _check_names(used: list[dict[int, str]], forbidden: str) -> None:
    """Refuse names that the format cannot keep."""
    both = set(used[0].values()) & set(used[1].values())
    if both:
        raise ValueError(f"{sorted(both)} name a region and a surface; expected different names")
    wrong = [n for of in used for n in of.values() if set(n) & set(forbidden)]
    if wrong:
        raise ValueError(f"names {wrong}: expected none of {forbidden!r} in them for this format")
