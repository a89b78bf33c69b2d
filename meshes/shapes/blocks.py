# SPDX-License-Identifier: LGPL-3.0-or-later
"""Boxes of structured hexahedra: bar, graded block, tensor-product grid.

Structured NumPy grids rather than gmsh: simpler here, and nodes lie exactly where they should.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from meshes.arrays import Array
from meshes.hexmesh import FACES, HexMesh, boundary
from meshes.spacing import graded, positive
from meshes.tags import Tag

# Surface tags of a box in the order of FACES.
SIDES = (Tag.XMIN, Tag.XMAX, Tag.YMIN, Tag.YMAX, Tag.ZMIN, Tag.ZMAX)
# Names of the horizontal faces where a block rests on a base.
BLOCK_FACES: Mapping[Tag, Tag] = {Tag.ZMIN: Tag.BLOCK_BOTTOM, Tag.ZMAX: Tag.BLOCK_TOP}
BASE_FACES: Mapping[Tag, Tag] = {Tag.ZMIN: Tag.BASE_BOTTOM, Tag.ZMAX: Tag.BASE_TOP}


def bar(
    length: float,
    height: float,
    *,
    width: float,
    size: float | Sequence[float],
    region: Tag = Tag.BAR,
    surfaces: Mapping[Tag, Tag] | None = None,
) -> HexMesh:
    """Return a uniform bar along x from the origin, centred on the x axis.

    Args:
        length: Extent in x [m].
        height: Extent in z [m].
        width: Extent in y [m].
        size: Largest cell edge, one for all axes or one each [m].
        region: Region tag of its cells.
        surfaces: New tags for some of ``XMIN … ZMAX``.

    Raises:
        ValueError: if an extent or ``size`` is not positive.
    """
    for name, value in (("length", length), ("height", height), ("width", width)):
        positive(name, value)
    lower, upper = (0.0, -width / 2, -height / 2), (length, width / 2, height / 2)
    return block(lower, upper, size=size, region=region, surfaces=surfaces)


def block(
    lower: Sequence[float],
    upper: Sequence[float],
    *,
    size: float | Sequence[float] | None = None,
    cells: Sequence[int] | None = None,
    growth: float = 1.0,
    fine: Sequence[int] = (0, 0, 0),
    region: Tag = Tag.BLOCK,
    surfaces: Mapping[Tag, Tag] | None = None,
) -> HexMesh:
    """Return a box of hexahedra, uniform or graded towards a corner, an edge or a face.

    Args:
        lower: Corner with the smallest coordinates, shape ``(3,)`` [m].
        upper: Corner with the largest coordinates, shape ``(3,)`` [m].
        size: Largest edge of the finest cells, one for all axes or one each [m].
        cells: Number of cells along each axis, instead of ``size``, shape ``(3,)``.
        growth: Ratio of neighbouring edges along the graded axes, at least 1 [-].
        fine: End of each axis where the cells are finest: -1 lower, 1 upper, 0 uniform, ``(3,)``.
        region: Region tag of its cells.
        surfaces: New tags for some of ``XMIN … ZMAX``, for example :data:`BASE_FACES`.

    Raises:
        ValueError: if the box is empty, or neither or both of ``size`` and ``cells`` are given,
            or one of the arguments is out of range.
    """
    if (size is None) == (cells is None):
        raise ValueError(f"size, cells: expected exactly one, got size={size}, cells={cells}")
    sizes = np.broadcast_to(np.nan if size is None else np.asarray(size, dtype=float), 3)
    axes = []
    for a, name in enumerate("xyz"):
        if not upper[a] > lower[a]:
            raise ValueError(f"upper: expected {name} > {lower[a]}, got {upper[a]}")
        if fine[a] not in (-1, 0, 1):
            raise ValueError(f"fine: expected -1, 0 or 1, got {fine[a]} for {name}")
        ratio = growth if fine[a] else 1.0
        count = None if cells is None else cells[a]
        s = graded(upper[a] - lower[a], sizes[a], cells=count, growth=ratio)
        axes.append(lower[a] + s if fine[a] <= 0 else upper[a] - s[::-1])
    return grid(*axes, region=region, surfaces=surfaces)


def grid(
    x: Array, y: Array, z: Array, *, region: Tag, surfaces: Mapping[Tag, Tag] | None = None
) -> HexMesh:
    """Return the tensor-product grid of three increasing coordinate arrays, x running fastest.

    Args:
        x: Node positions along x, shape ``(nx + 1,)`` [m].
        y: Node positions along y, shape ``(ny + 1,)`` [m].
        z: Node positions along z, shape ``(nz + 1,)`` [m].
        region: Region tag of all cells.
        surfaces: New tags for some of ``XMIN … ZMAX``.

    Raises:
        ValueError: if ``surfaces`` names anything else.
    """
    names = {**dict(zip(SIDES, SIDES, strict=True)), **(surfaces or {})}
    if unknown := [Tag(t).name for t in names if t not in SIDES]:
        raise ValueError(f"surfaces: expected keys among XMIN … ZMAX, got {', '.join(unknown)}")
    zz, yy, xx = np.meshgrid(z, y, x, indexing="ij")
    node = np.arange(xx.size).reshape(xx.shape)
    corners = [(0, 0, 0), (0, 0, 1), (0, 1, 1), (0, 1, 0)]
    corners += [(1, j, i) for _, j, i in corners]
    nz, ny, nx = (n - 1 for n in xx.shape)
    cells = np.stack([node[k : k + nz, j : j + ny, i : i + nx] for k, j, i in corners], axis=-1)
    sides = [cells[:, :, 0], cells[:, :, -1], cells[:, 0], cells[:, -1], cells[0], cells[-1]]
    quads = [side.reshape(-1, 8)[:, face] for side, face in zip(sides, FACES, strict=True)]
    return HexMesh(
        points=np.column_stack([xx.ravel(), yy.ravel(), zz.ravel()]),
        cells=cells.reshape(-1, 8),
        regions=np.full(cells.size // 8, region, dtype=np.int32),
        facets=np.vstack(quads),
        surfaces=np.repeat([names[s] for s in SIDES], [len(q) for q in quads]).astype(np.int32),
    )


def distorted(mesh: HexMesh, *, amplitude: float = 0.2, seed: int = 0) -> HexMesh:
    """Return ``mesh`` with its interior nodes moved at random, for patch tests.

    Args:
        mesh: Mesh to distort; its boundary stays.
        amplitude: Largest shift along each axis over the shortest edge at the node, in
            ``[0, 0.5)`` [-].
        seed: Seed of the random numbers.

    Raises:
        ValueError: if ``amplitude`` is out of range.
    """
    if not 0 <= amplitude < 0.5:
        raise ValueError(f"amplitude: expected 0 <= amplitude < 0.5, got {amplitude}")
    start = mesh.cells[:, FACES]
    end = np.roll(start, -1, axis=2)
    length = np.linalg.norm(mesh.points[start] - mesh.points[end], axis=-1)
    shortest = np.full(len(mesh.points), np.inf)
    np.minimum.at(shortest, start, length)
    np.minimum.at(shortest, end, length)
    shortest[boundary(mesh.cells)] = 0.0
    shift = np.random.default_rng(seed).uniform(-amplitude, amplitude, mesh.points.shape)
    return mesh.moved(mesh.points + shift * shortest[:, None])
