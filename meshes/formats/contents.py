# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contents of mesh files: points, hexahedra, quads and groups, read by meshio or here (Abaqus).

A group of hexahedra is a region. A group of quads is a surface, and so is a set of nodes: it means
the outer facets all of whose nodes it holds. Whole numbers on cells, as formats without groups have
them, make a group ``NAME VALUE`` of each value; ``A-B-C`` with values 0, 1, 2 makes three groups,
as meshio writes them. Names are compared in lower case; groups whose names differ by case alone
have to be renamed in the table of names.
"""

import contextlib
import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from meshes.arrays import Array, Flags, Index

# Formats that hold hexahedra with groups, all that are named where another one is given.
READ = {
    ".msh": "gmsh",
    ".inp": "Abaqus",
    ".med": "Salome",
    ".vtu": "ParaView",
    ".vtk": "VTK",
    ".xdmf": "XDMF",
    ".e": "Exodus",
    ".bdf": "Nastran",
    ".avs": "AVS",
    ".mesh": "Medit",
}
OTHERS = {
    ".k": "LS-DYNA",
    ".key": "LS-DYNA",
    ".dyn": "LS-DYNA",
    ".rad": "Radioss",
    ".unv": "I-DEAS, Salome",
    ".cdb": "ANSYS",
    ".odb": "results of Abaqus",
    ".cae": "Abaqus/CAE; write its .inp",
    ".hm": "HyperMesh",
    ".step": "a shape, no mesh",
    ".stp": "a shape, no mesh",
    ".iges": "a shape, no mesh",
    ".igs": "a shape, no mesh",
    ".brep": "a shape, no mesh",
    ".geo": "a script of gmsh: mesh.kind = 'gmsh' takes it",
}
Members = dict[str, Flags]  # which cells, quads or nodes belong to each group


@dataclass(frozen=True)
class Groups:
    """Names of the groups of a mesh file.

    Attributes:
        regions: Groups of hexahedra.
        surfaces: Groups of quads, and sets of nodes.
        unread: Data on cells that is not whole numbers, so makes no groups.
    """

    regions: tuple[str, ...]
    surfaces: tuple[str, ...]
    unread: tuple[str, ...] = ()

    def called(self, names: Mapping[str, str] | None) -> dict[str, str]:
        """Return what the groups that are used are called, in lower case, by their name here.

        Args:
            names: Groups to use, by their name in the file in any case, and what to call them; all
                as they are called, if left out.

        Raises:
            ValueError: if the file has no group of that name, or several that differ by case.
        """
        every = dict.fromkeys((*self.regions, *self.surfaces))
        if names is None:
            for kind in (self.regions, self.surfaces):
                if alike := [n for n in kind if sum(n.lower() == m.lower() for m in kind) > 1]:
                    raise ValueError(
                        f"groups {alike} differ by upper and lower case only; expected names for "
                        "them in [mesh.groups], with the other groups to use"
                    )
            return {name: name.lower() for name in every}
        found: dict[str, str] = {}
        for old, new in names.items():
            like = [old] if old in every else [n for n in every if n.lower() == old.lower()]
            if not like:
                raise ValueError(f"no groups {[old]}; the file has {self.listed}")
            if len({*like}) > 1 and any(set(like) <= {*k} for k in (self.regions, self.surfaces)):
                raise ValueError(f"group {old!r}: expected one of {like}, which differ by case")
            found |= dict.fromkeys(like, new.lower())
        return found

    def chosen(self, names: Mapping[str, str] | None) -> "Groups":
        """Return the names of the groups that are used; see :meth:`called`."""
        called = self.called(names)
        regions, surfaces = (
            tuple(dict.fromkeys(called[n] for n in kind if n in called))
            for kind in (self.regions, self.surfaces)
        )
        return Groups(regions, surfaces, self.unread)

    @property
    def listed(self) -> str:
        """The names in words."""
        found = f"regions {list(self.regions)}, surfaces {list(self.surfaces)}"
        if self.unread and not self.regions:
            found += f"; data on cells {list(self.unread)} is not whole numbers of regions"
        return found


@dataclass(frozen=True)
class Contents:
    """What a file holds, before any check.

    Attributes:
        points: Node positions, shape ``(n, 3)``, in the file's unit.
        cells: Nodes of each hexahedron, shape ``(c, 8)``.
        quads: Nodes of each quad, shape ``(q, 4)``.
        regions: Cells of each group.
        sides: Quads of each group.
        nodes: Nodes of each set.
        others: Facets of each group that are no quads, in words.
        types: Number of cells of each type.
        told: Elements that were left out, in words.
        unread: Data on cells that makes no groups.
    """

    points: Array
    cells: Index
    quads: Index
    regions: Members
    sides: Members
    nodes: Members
    others: dict[str, str]
    types: dict[str, int]
    told: str = ""
    unread: tuple[str, ...] = ()

    @property
    def groups(self) -> Groups:
        """Names of its groups."""
        surfaces = {**self.sides, **self.others, **self.nodes}
        return Groups(tuple(self.regions), tuple(surfaces), self.unread)

    @property
    def listed(self) -> str:
        """What was found, in words."""
        types = ", ".join(f"{n} {kind}" for kind, n in self.types.items())
        return f"found {types or 'no cells'}; {self.groups.listed}"


def groups(path: str | Path) -> Groups:
    """Return the names of the groups of a mesh file; of gmsh's files only the head is read.

    Raises:
        ValueError: if the file cannot be read.
        OSError: if there is no such file.
    """
    if named := physical_names(path):
        of = {d: tuple(n for (dim, _), n in named.items() if dim == d) for d in (2, 3)}
        return Groups(of[3], of[2])
    stat = os.stat(path)
    return _groups(str(path), stat.st_mtime_ns, stat.st_size)


@lru_cache(maxsize=8)
def _groups(path: str, mtime: int, size: int) -> Groups:
    return contents(path).groups


def physical_names(path: str | Path) -> dict[tuple[int, int], str]:
    """Return gmsh's names of groups by dimension and tag, empty for other files."""
    names: dict[tuple[int, int], str] = {}
    if Path(path).suffix.lower() != ".msh":
        return names
    with open(path, "rb") as file:
        for line in file:
            if line.startswith(b"$PhysicalNames"):
                for _ in range(int(file.readline())):
                    dim, tag, name = file.readline().decode("utf-8").split(None, 2)
                    names[int(dim), int(tag)] = name.strip()[1:-1]
                break
            if line.startswith((b"$Nodes", b"$Entities")):
                break
    return names


def contents(path: str | Path) -> Contents:
    """Return what a mesh file holds.

    Raises:
        ValueError: if the file cannot be read.
        OSError: if there is no such file.
    """
    raw = _raw(Path(path))
    types: dict[str, int] = {}
    for block in raw.cells:
        types[block.type] = types.get(block.type, 0) + len(block.data)
    members = _members(raw, physical_names(path))
    of = {kind: [b.type == kind for b in raw.cells] for kind in ("hexahedron", "quad")}

    def cells(kind: str, corners: int) -> Any:
        blocks = [b.data for b in raw.cells if b.type == kind]
        return np.vstack([np.zeros((0, corners), np.int64), *blocks]).astype(np.int64)

    def part(kind: str) -> Members:
        chosen = {
            name: np.concatenate([m for m, take in zip(blocks, of[kind], strict=True) if take])
            for name, blocks in members.items()
            if any(of[kind])
        }
        return {name: mask for name, mask in chosen.items() if mask.any()}

    points = np.asarray(raw.points, dtype=np.float64)
    points = np.hstack([points, np.zeros((len(points), 3 - points.shape[1]))])
    return Contents(
        points,
        cells("hexahedron", 8),
        cells("quad", 4),
        part("hexahedron"),
        part("quad"),
        _node_sets(raw),
        _no_quads(raw, members),
        types,
        (raw.info or {}).get("left out", ""),
        tuple(k for k in raw.cell_data if k not in _whole(raw, bool(members))),
    )


def _node_sets(raw: Any) -> Members:
    """Return the nodes of each set."""
    nodes: Members = {}
    for name, ids in raw.point_sets.items():
        nodes[name] = np.zeros(len(raw.points), dtype=bool)
        nodes[name][np.asarray(ids, dtype=np.int64)] = True
    for tag, names in getattr(raw, "point_tags", {}).items():  # of MED
        for name in names:
            mask = nodes.setdefault(name, np.zeros(len(raw.points), dtype=bool))
            mask |= raw.point_data["point_tags"] == tag
    return nodes


def _no_quads(raw: Any, members: Mapping[str, list[Any]]) -> dict[str, str]:
    """Return the facets of each group that are no quads, in words."""
    found: dict[str, str] = {}
    for name, blocks in members.items():
        counts: dict[str, int] = {}
        for block, mask in zip(raw.cells, blocks, strict=True):
            if block.dim == 2 and block.type != "quad" and mask.any():
                counts[block.type] = counts.get(block.type, 0) + int(mask.sum())
        if counts:
            found[name] = ", ".join(f"{n} {kind}" for kind, n in counts.items())
    return found


def _raw(path: Path) -> Any:
    """Return a file as meshio has it; all its ways to fail become one."""
    os.stat(path)
    import meshio

    ending = path.suffix.lower()
    if ending not in meshio.extension_to_filetypes:
        program = f" ({OTHERS[ending]})" if ending in OTHERS else ""
        raise ValueError(
            f"files ending in {ending!r}{program} are not read; expected one of "
            f"{', '.join(f'{end} ({of})' for end, of in READ.items())}. gmsh converts some: "
            "gmsh FILE -save -o FILE.msh"
        )
    if ending == ".inp":
        from meshes.formats import abaqus

        return abaqus.read(path)
    try:
        with open(os.devnull, "w") as null, contextlib.redirect_stdout(null):
            return meshio.read(path)
    except (Exception, SystemExit) as error:
        if "Incompatible cell data" in str(error):
            raise ValueError(
                "some elements belong to no physical group; expected a group for each, or gmsh's "
                "Mesh.SaveAll = 0, which saves only those in groups"
            ) from None
        said = "" if isinstance(error, SystemExit) else f": {str(error) or type(error).__name__}"
        raise ValueError(f"meshio cannot read this file{said}") from None


def _members(raw: Any, named: Mapping[tuple[int, int], str]) -> dict[str, list[Any]]:
    """Return for each group the cells of each block that belong to it, as masks."""
    found: dict[str, list[Any]] = {}

    def add(name: str, block: int, which: Any) -> None:
        empty = [np.zeros(len(b.data), dtype=bool) for b in raw.cells]
        found.setdefault(name, empty)[block][which] = True

    for name, sets in raw.cell_sets.items():
        for k, which in enumerate(sets if name != "gmsh:bounding_entities" else ()):
            if which is not None and len(which):
                add(name, k, which)
    tags: dict[int, list[str]] = getattr(raw, "cell_tags", {})  # of MED
    for key, data in _whole(raw, bool(found)).items():
        values = np.unique(np.concatenate(data)).tolist()
        parts = key.split("-")
        joined = set(values) <= set(range(-1, len(parts)))
        for k, (block, value) in ((k, (d, v)) for k, d in enumerate(data) for v in np.unique(d)):
            names = [f"{key} {value:d}"]
            if key == "gmsh:physical":
                known = named.get((raw.cells[k].dim, int(value)), "")
                names = [known] if named or not value else names
            elif key == "cell_tags" and tags:
                names = tags.get(int(value), [])
            elif joined:
                names = [parts[value] if value >= 0 else ""]
            for name in filter(None, names):
                add(name, k, block == value)
    return found


def _whole(raw: Any, grouped: bool) -> dict[str, list[Any]]:
    """Return the data on cells that are whole numbers and make groups.

    Numbers stored as floats, ParaView's habit, count where a file has no other groups.

    Args:
        raw: The file as meshio has it.
        grouped: Whether it has sets of cells.
    """
    flat = {
        key: data
        for key, data in raw.cell_data.items()
        if key != "gmsh:geometrical" and all(d.ndim == 1 for d in data)
    }
    found = {k: data for k, data in flat.items() if all(d.dtype.kind in "iu" for d in data)}
    if found or grouped:
        return found
    return {
        key: [d.astype(np.int64) for d in data]
        for key, data in flat.items()
        if all(d.dtype.kind in "iuf" and (d == np.rint(d)).all() for d in data)
    }
