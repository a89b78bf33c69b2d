# SPDX-License-Identifier: LGPL-3.0-or-later
"""Hexahedral meshes as plain arrays with tagged regions and surfaces."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from meshes.arrays import Array, Index
from meshes.tags import NAMES

# Faces of a hexahedron in VTK node order, counter-clockwise seen from outside.
FACES = np.array(
    [[0, 4, 7, 3], [1, 2, 6, 5], [0, 1, 5, 4], [3, 7, 6, 2], [0, 3, 2, 1], [4, 5, 6, 7]]
)

# Edges of a hexahedron by direction, in cyclic order round the cell and all pointing the same way.
FAMILIES = np.array(
    [
        [[0, 1], [3, 2], [7, 6], [4, 5]],
        [[0, 3], [4, 7], [5, 6], [1, 2]],
        [[0, 4], [1, 5], [2, 6], [3, 7]],
    ]
)


@dataclass(frozen=True)
class HexMesh:
    """Hexahedra with tagged regions and tagged surface facets.

    Attributes:
        points: Node positions, shape ``(n, 3)`` [m].
        cells: Nodes of each hexahedron in VTK order (bottom counter-clockwise, then top),
            shape ``(c, 8)``.
        regions: Region tag of each cell, shape ``(c,)``.
        facets: Nodes of each tagged surface quad, counter-clockwise from outside, ``(q, 4)``.
        surfaces: Surface tag of each quad, shape ``(q,)``.
        names: Tag of each region and surface by its name, in lower case; those of ``Tag`` unless
            the mesh was read from a file with groups of its own.
    """

    points: Array
    cells: Index
    regions: npt.NDArray[np.int32]
    facets: Index
    surfaces: npt.NDArray[np.int32]
    names: Mapping[str, int] = field(default_factory=lambda: NAMES)

    def tag(self, name: str) -> int:
        """Return the tag of the region or surface called ``name`` (any case).

        Raises:
            ValueError: if the mesh knows no such name.
        """
        try:
            return self.names[name.lower()]
        except KeyError:
            known = ", ".join(self.names)
            raise ValueError(f"unknown region or surface {name!r}; known: {known}") from None

    def tags(self, names: Iterable[str]) -> tuple[int, ...]:
        """Return the tags of the regions or surfaces called ``names``."""
        return tuple(map(self.tag, names))

    def name(self, tag: int) -> str:
        """Return what a tag is called, its number if it has no name."""
        return next((name for name, known in self.names.items() if known == tag), str(tag))

    def counts(self, tags: npt.NDArray[np.int32]) -> dict[str, int]:
        """Return how often each tag is among ``tags``, ``regions`` or ``surfaces``, by name."""
        values, numbers = np.unique(tags, return_counts=True)
        return {self.name(int(t)): int(n) for t, n in zip(values, numbers, strict=True)}

    def moved(self, points: Array) -> "HexMesh":
        """Return the same mesh with its nodes at ``points``, shape ``(n, 3)`` [m]."""
        return replace(self, points=np.ascontiguousarray(points, dtype=np.float64))

    def nodes(self, *tags: int) -> Index:
        """Return the nodes of the cells in any of the regions ``tags``, ascending."""
        return np.unique(self.cells[np.isin(self.regions, tags)])

    def region_at(self, node: int) -> str:
        """Return the name of the region that a node belongs to; that of the first, at a border."""
        cell = int(np.flatnonzero((self.cells == node).any(axis=1))[0])
        return self.name(int(self.regions[cell]))

    def surface(self, *tags: int) -> Index:
        """Return the quads that carry any of ``tags``, shape ``(q, 4)``."""
        return self.facets[np.isin(self.surfaces, tags)]


def boundary(cells: Index) -> Index:
    """Return the quads that belong to one cell only, seen from outside, shape ``(q, 4)``."""
    quads = cells[:, FACES].reshape(-1, 4)
    _, first, count = np.unique(
        np.sort(quads, axis=1), axis=0, return_index=True, return_counts=True
    )
    return quads[np.sort(first[count == 1])]


def edges_of(cells: Index) -> tuple[Index, Index]:
    """Return the edges, shape ``(e, 2)``, lower node first, and those of each cell, (c, 3, 4)."""
    pairs = np.sort(cells[:, FAMILIES].reshape(-1, 2), axis=1)
    key = pairs[:, 0] * (int(cells.max()) + 1) + pairs[:, 1]
    _, first, inverse = np.unique(key, return_index=True, return_inverse=True)
    return pairs[first], inverse.reshape(-1, 3, 4)


def join(*meshes: HexMesh) -> HexMesh:
    """Return one mesh that holds the given ones side by side; nodes are not merged."""
    shift = np.cumsum([0] + [len(m.points) for m in meshes[:-1]])
    return HexMesh(
        points=np.vstack([m.points for m in meshes]),
        cells=np.vstack([m.cells + s for m, s in zip(meshes, shift, strict=True)]),
        regions=np.concatenate([m.regions for m in meshes]),
        facets=np.vstack([m.facets + s for m, s in zip(meshes, shift, strict=True)]),
        surfaces=np.concatenate([m.surfaces for m in meshes]),
        names={name: tag for m in meshes for name, tag in m.names.items()},
    )
