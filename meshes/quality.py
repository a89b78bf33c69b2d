# SPDX-License-Identifier: LGPL-3.0-or-later
"""Quality of hexahedral meshes: edge lengths, scaled Jacobians, volumes, mass."""

from dataclasses import dataclass

import numpy as np

from meshes.arrays import Array, Index
from meshes.hexmesh import FACES, HexMesh, boundary, edges_of
from meshes.quads import enclosed_volume

# The three neighbours of each node of a hexahedron, right-handed.
NEIGHBOURS = np.array(
    [[1, 3, 4], [2, 0, 5], [3, 1, 6], [0, 2, 7], [7, 5, 0], [4, 6, 1], [5, 7, 2], [6, 4, 3]]
)


@dataclass(frozen=True)
class Quality:
    """Figures of a mesh.

    Attributes:
        cells, nodes: Their numbers.
        shortest, longest: Length of edges [m].
        scaled_jacobian: Smallest determinant of unit edges at a node of a cell, 1 for a brick.
        volume: Sum over the cells [m³].
        enclosed: Volume within the outer surface [m³]; equal, unless cells overlap.
        mass: Volume times density [kg].
        regions: Number of cells of each region.
    """

    cells: int
    nodes: int
    shortest: float
    longest: float
    scaled_jacobian: float
    volume: float
    enclosed: float
    mass: float
    regions: dict[str, int]

    @property
    def report(self) -> str:
        """The figures in words, one a line."""
        lines = [
            f"{self.cells} cells, {self.nodes} nodes",
            f"edges {self.shortest * 1e3:.3f} to {self.longest * 1e3:.1f} mm",
            f"smallest scaled Jacobian {self.scaled_jacobian:.3f}",
            f"volume {self.volume:.6e} m³ (within the surface {self.enclosed:.6e} m³)",
            f"mass {self.mass:.2f} kg",
            *(f"{name.lower()}: {count} cells" for name, count in self.regions.items()),
        ]
        return "\n".join(lines)


def quality(mesh: HexMesh, *, density: float = 7850.0) -> Quality:
    """Return the figures of a mesh.

    Args:
        mesh: The mesh.
        density: Density of all its regions [kg/m³].
    """
    length = edge_lengths(mesh.points, mesh.cells)
    volume = float(cell_volumes(mesh.points, mesh.cells).sum())
    return Quality(
        cells=len(mesh.cells),
        nodes=len(mesh.points),
        shortest=float(length.min()),
        longest=float(length.max()),
        scaled_jacobian=float(scaled_jacobians(mesh.points, mesh.cells).min()),
        volume=volume,
        enclosed=enclosed_volume(mesh.points, boundary(mesh.cells)),
        mass=density * volume,
        regions={name.upper(): count for name, count in mesh.counts(mesh.regions).items()},
    )


def edge_lengths(points: Array, cells: Index) -> Array:
    """Return the length of every edge of the mesh, shape ``(e,)`` [m]."""
    ends = points[edges_of(cells)[0]]
    return np.asarray(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1))


def scaled_jacobians(points: Array, cells: Index) -> Array:
    """Return the smallest determinant of unit edges over the nodes of each cell, ``(c,)``."""
    x = points[cells]
    edges = x[:, NEIGHBOURS] - x[:, :, None]
    edges /= np.linalg.norm(edges, axis=3, keepdims=True)
    # a triple product is faster than a general determinant
    return np.asarray(
        np.sum(edges[:, :, 0] * np.cross(edges[:, :, 1], edges[:, :, 2]), axis=2).min(axis=1)
    )


def cell_volumes(points: Array, cells: Index) -> Array:
    """Return the volume of each cell, exact for bilinear faces, shape ``(c,)`` [m³]."""
    corners = points[cells]
    p = corners[:, FACES] - corners.mean(axis=1)[:, None, None]
    centre = p.mean(axis=2)
    cone = 0.0
    for a in range(4):  # cones from the middle over triangles round the centre of each face
        cone = cone + np.einsum("cfa,cfa->c", centre, np.cross(p[:, :, a], p[:, :, (a + 1) % 4]))
    return np.asarray(cone / 6.0)
