# SPDX-License-Identifier: LGPL-3.0-or-later
"""Repair of read meshes: cells listed twice, orientation, unused and coincident nodes."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from meshes.arrays import Array, Flags, Index
from meshes.hexmesh import FACES
from meshes.quality import scaled_jacobians

TURNED = [4, 5, 6, 7, 0, 1, 2, 3]  # a hexahedron seen from the other side: top and bottom change
NEAR = 1e-6  # of the shortest edge: nodes closer than this coincide


def once(cells: Index, members: Mapping[str, Flags]) -> tuple[Index, dict[str, Flags], int]:
    """Return cells without those that have the nodes of one before, their groups, how many went.

    A cell that is listed in two groups, as overlapping groups of gmsh write it, is in both then.

    Args:
        cells: Nodes of each hexahedron, shape ``(c, 8)``.
        members: Which cells belong to each group.
    """
    _, first, number = np.unique(
        np.sort(cells, axis=1), axis=0, return_index=True, return_inverse=True
    )
    kept = np.sort(first)
    if len(kept) == len(cells):
        return cells, dict(members), 0
    of = np.searchsorted(kept, first)[number.ravel()]
    merged = {
        name: np.bincount(of, mask, minlength=len(kept)) > 0 for name, mask in members.items()
    }
    return cells[kept], merged, len(cells) - len(kept)


def check_apart(points: Array, cells: Index) -> None:
    """Refuse cells that lie on one another.

    Raises:
        ValueError: if cells have all their nodes at the same places, or share a face with two more.
    """
    place = _alike(points)
    at = np.sort(place[cells], axis=1)
    if place.max() < len(points) - 1:  # else no two nodes are at one place
        _, first, count = np.unique(at, axis=0, return_index=True, return_counts=True)
        if (count > 1).any():
            x, y, z = points[cells[first[count > 1][0]]].mean(axis=0)
            raise ValueError(
                f"{(count[count > 1] - 1).sum()} hexahedra lie on others with nodes of their own, "
                f"the first at x = {x:.5g}, y = {y:.5g}, z = {z:.5g}; expected each once"
            )
    faces = np.sort(cells[:, FACES].reshape(-1, 4), axis=1)
    n = len(points)
    number = _alike(np.column_stack([faces[:, 0] * n + faces[:, 1], faces[:, 2] * n + faces[:, 3]]))
    count = np.bincount(number)
    if (count > 2).any():
        x, y, z = points[faces[np.argmax(count[number] > 2)]].mean(axis=0)
        raise ValueError(
            f"{(count > 2).sum()} faces belong to more than two hexahedra, the first at "
            f"x = {x:.5g}, y = {y:.5g}, z = {z:.5g}; expected cells that do not overlap"
        )


def _alike(rows: npt.NDArray[Any]) -> Index:
    """Return a number for each row, the same for rows that are alike, shape ``(n,)``."""
    order = np.lexsort(rows.T)
    new = (rows[order[1:]] != rows[order[:-1]]).any(axis=1)
    number = np.zeros(len(rows), dtype=np.int64)
    number[order[1:]] = np.cumsum(new)
    return number


def turned(points: Array, cells: Index) -> tuple[Index, int]:
    """Return the cells with their nodes in VTK order, and how many had to be turned.

    Args:
        points: Node positions, shape ``(n, 3)`` [m].
        cells: Nodes of each hexahedron, either way round, shape ``(c, 8)``.

    Raises:
        ValueError: if a cell is collapsed or tangled whichever way round it is read.
    """
    repeated = (np.diff(np.sort(cells, axis=1), axis=1) == 0).any(axis=1)
    if repeated.any():
        first = int(np.argmax(repeated))
        raise ValueError(
            f"{repeated.sum()} hexahedra are collapsed: the first is cell {first}, nodes "
            f"{(cells[first] + 1).tolist()}; expected eight different nodes"
        )
    with np.errstate(invalid="ignore", divide="ignore"):
        worst = scaled_jacobians(points, cells)
        wrong = np.flatnonzero(~(worst > 0))
        cells = cells.copy()
        cells[wrong] = cells[wrong][:, TURNED]
        worst[wrong] = scaled_jacobians(points, cells[wrong])
    tangled = wrong[~(worst[wrong] > 0)]
    if len(tangled):
        x, y, z = points[cells[tangled[0]]].mean(axis=0)
        raise ValueError(
            f"{len(tangled)} hexahedra are tangled: the first is cell {tangled[0]} at "
            f"x = {x:.5g}, y = {y:.5g}, z = {z:.5g} m, scaled Jacobian {worst[tangled[0]]:.2g}; "
            "expected the order of VTK and gmsh (one face, then the opposite one)"
        )
    return cells, len(wrong)


def compact(points: Array, cells: Index, quads: Index) -> tuple[Array, Index, Index, int]:
    """Return points, cells and quads without nodes that no cell has, and how many were dropped.

    Args:
        points: Node positions, shape ``(n, 3)`` [m].
        cells: Nodes of each hexahedron, shape ``(c, 8)``.
        quads: Quads whose nodes all belong to cells, shape ``(q, 4)``.
    """
    used = np.zeros(len(points), dtype=bool)
    used[cells] = True
    number = np.cumsum(used) - 1
    return points[used], number[cells], number[quads], int((~used).sum())


def faces_on(cells: Index, nodes: Index) -> Index:
    """Return the faces of cells all of whose nodes are among ``nodes``, shape ``(f, 4)``.

    A face between two cells comes twice, once from each side.
    """
    on = np.zeros(int(cells.max()) + 1, dtype=bool)
    on[nodes[nodes < len(on)]] = True
    near = cells[on[cells].sum(axis=1) >= 4]
    faces = near[:, FACES].reshape(-1, 4)
    return faces[on[faces].all(axis=1)]


def matched(cells: Index, quads: Index) -> tuple[Index, Index, int]:
    """Return the quads as facets seen from outside, how many cells have each, how many were turned.

    A quad that already runs counter-clockwise keeps its first node, so that reading what was
    written changes nothing. Quads of no cell have count 0 and stay as they are.

    Args:
        cells: Nodes of each hexahedron in VTK order, shape ``(c, 8)``.
        quads: Nodes of each quad, either way round, shape ``(q, 4)``.
    """
    faces = faces_on(cells, np.unique(quads))
    both = np.sort(np.vstack([faces, quads]), axis=1)
    _, number = np.unique(both, axis=0, return_inverse=True)
    number = number.ravel()
    of_face, of_quad = number[: len(faces)], number[len(faces) :]
    count = np.bincount(of_face, minlength=int(number.max(initial=-1)) + 1)
    face = np.zeros(len(count), dtype=np.int64)
    face[of_face] = np.arange(len(faces))
    facets = quads.copy()
    outside = np.flatnonzero(count[of_quad] == 1)
    right = faces[face[of_quad[outside]]]
    same = np.zeros(len(outside), dtype=bool)
    for k in range(4):
        same |= (np.roll(right, k, axis=1) == quads[outside]).all(axis=1)
    facets[outside[~same]] = right[~same]
    return facets, count[of_quad], int((~same).sum())


def coincident(
    points: Array, cells: Index, regions: npt.NDArray[np.int32]
) -> tuple[int, int, Array]:
    """Return how many pairs of nodes coincide, how many of them in one region, the first of these.

    Args:
        points: Node positions, shape ``(n, 3)`` [m].
        cells: Nodes of each hexahedron, shape ``(c, 8)``.
        regions: Region tag of each cell, or the number of its body, shape ``(c,)``.
    """
    from scipy.spatial import cKDTree

    edges = points[cells[:, [1, 3, 4]]] - points[cells[:, :1]]
    reach = NEAR * float(np.sqrt((edges**2).sum(axis=2).min()))
    pairs = cKDTree(points).query_pairs(reach, output_type="ndarray")
    if not len(pairs):
        return 0, 0, np.zeros(3)
    region = np.zeros(len(points), dtype=np.int32)
    region[cells] = regions[:, None]
    within = region[pairs[:, 0]] == region[pairs[:, 1]]
    return len(pairs), int(within.sum()), points[pairs[np.argmax(within), 0]]
