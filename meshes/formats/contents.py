# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contents of mesh files: points, hexahedra, quads and groups, read by meshio.

A group of hexahedra is a region. A group of quads is a surface, and so is a set of nodes: it means
the outer facets all of whose nodes it holds. Integer data on cells, as formats without groups have
it, makes a group ``NAME VALUE`` of each value; ``A-B-C`` with values 0, 1, 2 makes three groups, as
meshio writes them. Names are compared in lower case.
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

Members = dict[str, Flags]  # which cells, quads or nodes belong to each group


@dataclass(frozen=True)
class Groups:
    """Names of the groups of a mesh file, in lower case.

    Attributes:
        regions: Groups of hexahedra.
        surfaces: Groups of quads, and sets of nodes.
    """

    regions: tuple[str, ...]
    surfaces: tuple[str, ...]

    def chosen(self, names: Mapping[str, str] | None) -> "Groups":
        """Return only the groups that ``names`` has as keys, called by its values.

        Raises:
            ValueError: if the file has no group of that name.
        """
        if names is None:
            return self
        new = lower(names)
        if unknown := [n for n in new if n not in (*self.regions, *self.surfaces)]:
            raise ValueError(f"no groups {unknown}; the file has {self.listed}")
        return Groups(
            tuple(new[n] for n in self.regions if n in new),
            tuple(new[n] for n in self.surfaces if n in new),
        )

    @property
    def listed(self) -> str:
        """The names in words."""
        return f"regions {list(self.regions)}, surfaces {list(self.surfaces)}"


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
        types: Number of cells of each type.
    """

    points: Array
    cells: Index
    quads: Index
    regions: Members
    sides: Members
    nodes: Members
    types: dict[str, int]

    @property
    def groups(self) -> Groups:
        """Names of its groups."""
        sides = [*self.sides, *(n for n in self.nodes if n not in self.sides)]
        return Groups(tuple(self.regions), tuple(sides))

    @property
    def listed(self) -> str:
        """What was found, in words."""
        types = ", ".join(f"{n} {kind}" for kind, n in self.types.items())
        return f"found {types or 'no cells'}; {self.groups.listed}"


def lower(names: Mapping[str, str]) -> dict[str, str]:
    """Return the table with keys and values in lower case."""
    return {old.lower(): new.lower() for old, new in names.items()}


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
                    names[int(dim), int(tag)] = name.strip()[1:-1].lower()
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
    raw = _meshio(path)
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

    nodes = {}
    for name, ids in raw.point_sets.items():
        nodes[name.lower()] = np.zeros(len(raw.points), dtype=bool)
        nodes[name.lower()][np.asarray(ids, dtype=np.int64)] = True
    points = np.asarray(raw.points, dtype=np.float64)
    points = np.hstack([points, np.zeros((len(points), 3 - points.shape[1]))])
    return Contents(
        points,
        cells("hexahedron", 8),
        cells("quad", 4),
        part("hexahedron"),
        part("quad"),
        nodes,
        types,
    )


def _meshio(path: str | Path) -> Any:
    """Return meshio's mesh; all its ways to fail become one."""
    os.stat(path)
    import meshio

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
        found.setdefault(name.lower(), empty)[block][which] = True

    for name, sets in raw.cell_sets.items():
        for k, which in enumerate(sets if name != "gmsh:bounding_entities" else ()):
            if which is not None and len(which):
                add(name, k, which)
    for key, data in raw.cell_data.items():
        if key == "gmsh:geometrical" or not all(d.dtype.kind in "iu" and d.ndim == 1 for d in data):
            continue
        values = np.unique(np.concatenate(data)).tolist()
        parts = key.split("-")
        joined = set(values) <= set(range(-1, len(parts)))
        for k, (block, value) in ((k, (d, v)) for k, d in enumerate(data) for v in np.unique(d)):
            name = f"{key} {value}"
            if key == "gmsh:physical":
                name = named.get((raw.cells[k].dim, int(value)), "" if named or not value else name)
            elif joined:
                name = parts[value] if value >= 0 else ""
            if name:
                add(name, k, block == value)
    return found
