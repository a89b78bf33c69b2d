# SPDX-License-Identifier: LGPL-3.0-or-later
"""An eighth of a hollow sphere: three patches of a cube's faces, drawn out along the radius."""

import numpy as np
import numpy.typing as npt

from meshes.arrays import Array, Index
from meshes.hexmesh import HexMesh, boundary
from meshes.spacing import graded, positive
from meshes.tags import Tag

ROUND = 1e-9  # of the radius, within which nodes are one


def hollow_sphere(
    inner: float, outer: float, size: float, growth: float = 1.0, *, across: int
) -> HexMesh:
    """Return the eighth x, y, z ≥ 0 of a hollow sphere about the origin.

    Its planes of symmetry are ``XMIN``, ``YMIN``, ``ZMIN``, its faces ``INSIDE`` and ``OUTSIDE``.

    Args:
        inner: Inner radius [m].
        outer: Outer radius [m].
        size: Largest edge along the radius of the cells at the hole [m].
        growth: Ratio of neighbouring edges along the radius, at least 1 [-].
        across: Number of cells along an edge of each of the three patches.

    Raises:
        ValueError: if a length is not positive, or there is no room between the radii.
    """
    if not outer > positive("inner_radius", inner):
        raise ValueError(f"outer_radius: expected more than inner_radius = {inner} m, got {outer}")
    directions, quads = _eighth(across)
    radii = inner + graded(outer - inner, size, growth=growth)
    points = (radii[:, None, None] * directions).reshape(-1, 3)
    first = len(directions) * np.arange(len(radii) - 1)[:, None, None]
    cells = np.concatenate([quads + first, quads + first + len(directions)], axis=2).reshape(-1, 8)
    facets, surfaces = _skin(points, cells, inner, outer)
    return HexMesh(
        points=points,
        cells=cells,
        regions=np.full(len(cells), Tag.SPHERE, dtype=np.int32),
        facets=facets,
        surfaces=surfaces,
    )


def _eighth(n: int) -> tuple[Array, Index]:
    """Return unit vectors to the nodes of an eighth of a sphere, and quads seen from outside.

    The faces x = 1, y = 1 and z = 1 of a cube, divided into equal angles.
    """
    s = np.tan(np.pi / 4 * np.arange(n + 1) / n)
    v, u = np.meshgrid(s, s, indexing="ij")
    one = np.ones_like(u)
    faces = [(one, u, v), (v, one, u), (u, v, one)]
    rays = np.concatenate([np.stack(face, axis=-1).reshape(-1, 3) for face in faces])
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    _, first, number = np.unique(
        np.round(rays / ROUND).astype(np.int64), axis=0, return_index=True, return_inverse=True
    )
    node = number.reshape(3, n + 1, n + 1)
    corners = [node[:, :-1, :-1], node[:, :-1, 1:], node[:, 1:, 1:], node[:, 1:, :-1]]
    return rays[first], np.stack(corners, axis=-1).reshape(-1, 4)


def _skin(
    points: Array, cells: Index, inner: float, outer: float
) -> tuple[Index, npt.NDArray[np.int32]]:
    """Return the facets of the surface and the tag of each."""
    facets = boundary(cells)
    corners = points[facets]
    radius, near = np.linalg.norm(corners, axis=2), ROUND * outer
    tags = np.zeros(len(facets), dtype=np.int32)
    tags[(np.abs(radius - inner) < near).all(axis=1)] = Tag.INSIDE
    tags[(np.abs(radius - outer) < near).all(axis=1)] = Tag.OUTSIDE
    for axis, tag in enumerate((Tag.XMIN, Tag.YMIN, Tag.ZMIN)):
        tags[(np.abs(corners[:, :, axis]) < near).all(axis=1)] = tag
    return facets, tags
