# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rail seats: shares of the nodes in a stretch of the foot, bilinear weights on what is below."""

import numpy as np

from meshes.arrays import Array, Index
from meshes.quads import GAUSS, bilinear

BEYOND = 1.5  # farthest reference coordinate of a point beside a facet that still hangs on it


def parts(groups: Index) -> list[Index]:
    """Return the connected parts of a surface's quads or of cells, in the order of their first one.

    Args:
        groups: Nodes of each quad or cell, shape ``(q, k)``.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    nodes, local = np.unique(groups, return_inverse=True)
    local = local.reshape(groups.shape)
    pairs = np.repeat(local[:, 0], groups.shape[1] - 1), local[:, 1:].ravel()
    links = coo_array((np.ones(len(pairs[0])), pairs), shape=(len(nodes),) * 2)
    _, label = connected_components(links, directed=False)
    of_group = label[local[:, 0]]
    _, first = np.unique(of_group, return_index=True)
    return [groups[of_group == of_group[i]] for i in np.sort(first)]


def shares(points: Array, quads: Index, start: float, end: float) -> tuple[Index, Array]:
    """Return the nodes of a stretch of a surface and their shares of its area, ``∫ N dA / A``.

    The stretch ends at x = ``start`` and ``end``, within facets where it must. A uniform pressure
    on it has the nodal forces that are in proportion to the shares, so resultant and centre are
    those of the stretch whatever the mesh; exact on facets with two edges across x.

    Args:
        points: Node positions, shape ``(n, 3)`` [m].
        quads: Facets of the surface, shape ``(q, 4)``.
        start: Smaller x of its ends [m].
        end: Larger x of its ends [m].

    Returns:
        Nodes and shares, which sum to 1, both of shape ``(k,)``.

    Raises:
        ValueError: if no facet lies in the stretch.
    """
    x = points[quads]
    along = np.abs(x[:, 1, 0] - x[:, 0, 0]) + np.abs(x[:, 2, 0] - x[:, 3, 0])
    across = np.abs(x[:, 2, 0] - x[:, 1, 0]) + np.abs(x[:, 3, 0] - x[:, 0, 0])
    quads = np.where((along < across)[:, None], np.roll(quads, -1, axis=1), quads)
    x = points[quads]
    nodal = np.zeros(len(points))
    for b in GAUSS:  # on a line across, x is linear from one end of the facet to the other
        ends = np.array([(1 - b) * x[:, 0, 0] + (1 + b) * x[:, 3, 0]]) / 2
        ends = np.vstack([ends, ((1 - b) * x[:, 1, 0] + (1 + b) * x[:, 2, 0]) / 2])
        length = np.diff(ends, axis=0)
        cuts = np.clip([[start], [end]], *np.sort(ends, axis=0)) - ends[0]
        cuts = cuts / np.where(length == 0, 1.0, length)  # a facet across x has no stretch of it
        half, middle = np.abs(cuts[1] - cuts[0]), cuts.sum(axis=0) - 1  # of xi from -1 to 1
        for a in middle + half * GAUSS[:, None]:
            N, da, db = bilinear(a, np.full_like(a, b))
            t, s = np.einsum("qi,qid->qd", da, x), np.einsum("qi,qid->qd", db, x)
            area = half * np.linalg.norm(np.cross(t, s), axis=1)
            np.add.at(nodal, quads, area[:, None] * N)
    nodes = np.flatnonzero(nodal > 1e-9 * nodal.max())
    if not len(nodes):
        low, high = x[:, :, 0].min(), x[:, :, 0].max()
        raise ValueError(
            f"seat from x = {start:.4f} to {end:.4f} m: expected within the surface, which goes "
            f"from {low:.4f} to {high:.4f} m"
        )
    return nodes, nodal[nodes] / nodal[nodes].sum()


def below(points: Array, quads: Index, at: Array) -> tuple[Index, Array]:
    """Return facet and bilinear weights of the points of a surface above or below others.

    A force along z on a point and its opposite on the surface then have one line of action. Beside
    the surface the nearest facet is continued.

    Args:
        points: Node positions, shape ``(n, 3)`` [m].
        quads: Facets of the surface, shape ``(q, 4)``, none of them upright.
        at: Points, shape ``(k, 3)`` [m].

    Returns:
        Nodes of the facet and their weights, which sum to 1, both of shape ``(k, 4)``.

    Raises:
        ValueError: if a point is more than a quarter of a facet beside the surface.
    """
    corners = points[quads][None, :, :, :2]
    place = np.zeros((len(at), len(quads), 2))
    for _ in range(12):  # Newton; one step on a parallelogram
        N, da, db = bilinear(place[..., 0], place[..., 1])
        off = at[:, None, :2] - np.einsum("kqi,kqid->kqd", N, corners)
        slopes = (np.einsum("kqi,kqid->kqd", g, corners) for g in (da, db))
        (a, c), (b, d) = (np.moveaxis(slope, -1, 0) for slope in slopes)
        place[..., 0] += (d * off[..., 0] - b * off[..., 1]) / (a * d - b * c)
        place[..., 1] += (a * off[..., 1] - c * off[..., 0]) / (a * d - b * c)
        place = np.clip(place, -10, 10)
    reach = np.abs(place).max(axis=2)
    facet = np.argmin(reach, axis=1)
    k = np.arange(len(at))
    if len(at) and reach[k, facet].max() > BEYOND:
        x, y, z = at[np.argmax(reach[k, facet])]
        raise ValueError(f"point x = {x:.4f}, y = {y:.4f}, z = {z:.4f} m: not over the surface")
    N, _, _ = bilinear(place[k, facet, 0], place[k, facet, 1])
    return quads[facet], N
