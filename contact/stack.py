# SPDX-License-Identifier: LGPL-3.0-or-later
"""Nodes of a pass as the kernel numbers them, and points in the contactor's facets.

First comes what touches the target: the contactor's nodes, or 2 x 2 Gauss points in each of its
facets. Then come the target's nodes and, where points touch, the contactor's. A point moves with
the nodes of its facet and loads them by its shape functions. It has the area that it stands for in
the integral over the facet, and the same share of the mass of the nodes.

Facets are chords of the drawn surface. A point stands over its facet by the height of the surface
curved by averaged normals (:mod:`contact.smooth`), taken once from the undeformed positions: a
height that changed with the deformation would do work that no node feels.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from contact.arrays import Index32, struct, view
from contact.smooth import Smooth
from contact.surface import Surface, tributary_area
from meshes.arrays import Array, Index
from meshes.quads import gauss_points

EACH = 4  # points of a facet


@dataclass(frozen=True, eq=False)
class Points:
    """Gauss points in the facets of a contactor, ``EACH`` after ``EACH``.

    Attributes:
        node: Nodes of its facet, as indices into the contactor's, shape ``(nc, 4)``.
        weight: Their shape functions at the point, shape ``(nc, 4)``.
        area: Area it stands for, shape ``(nc,)`` [m2].
        mass: Mass that the nodes have for it, shape ``(nc,)`` [kg].
        reference: Undeformed position on the facet, shape ``(nc, 3)`` [m].
        height: Of the curved surface over the facet there, shape ``(nc,)`` [m].
    """

    node: Index32
    weight: Array
    area: Array
    mass: Array
    reference: Array
    height: Array


def points_in(contactor: Surface, sharp_angle: float) -> Points:
    """Return the 2 x 2 Gauss points in the facets of a contactor.

    Args:
        contactor: The surface.
        sharp_angle: Facets that meet at less have a common normal [rad].
    """
    x = contactor.reference
    shapes, vectors = zip(*gauss_points(x[contactor.facets]), strict=True)
    node = np.repeat(contactor.facets, EACH, axis=0)
    weight = np.tile(np.array(shapes), (len(contactor.facets), 1))
    area = np.linalg.norm(np.stack(vectors, axis=1), axis=2).ravel()
    mass = area * np.einsum("ci,ci->c", weight, (contactor.mass / tributary_area(contactor))[node])
    place = np.einsum("ci,cia->ca", weight, x[node])
    normal = corner_directions(contactor, sharp_angle)
    high = np.einsum("cia,cia->ci", x[node] - place[:, None], normal)
    rise = 0.5 * np.einsum("ci,ci,cia->ca", weight, high, normal)
    mean = np.einsum("ci,cia->ca", weight, normal)
    height = np.einsum("ca,ca->c", rise, mean) / np.linalg.norm(mean, axis=1)
    return Points(node, weight, area, mass, place, height)


def corner_directions(contactor: Surface, sharp_angle: float) -> Array:
    """Return the averaged normals at the corners of the facet of each point, ``(nc, 4, 3)``."""
    smooth = Smooth(contactor.reference, contactor.facets, sharp_angle)
    xv = np.hstack([contactor.reference, np.zeros_like(contactor.reference)])
    everywhere = np.ones(len(contactor.facets), dtype=np.uint8)
    smooth.update(smooth.corners(everywhere), view("xv", xv, xv.shape))
    return np.asarray(smooth.normals[np.repeat(smooth.corner, EACH, axis=0)])


class Stack:
    """Numbers of the nodes of a pass, and what belongs to each.

    Attributes:
        nc, n: Number of what touches, and of all.
        contactor, target: Where the nodes of both surfaces stand.
        points: What touches instead of the contactor's nodes, or None.
        nearest: The contactor's node at or next to what touches, shape ``(nc,)``.
        node: HexMesh nodes, of points those next to them, shape ``(n,)``.
        reference: Undeformed positions, shape ``(n, 3)`` [m].
        dofs: Dof blocks that this rank owns, else -1, shape ``(n,)``.
        mass: Masses, shape ``(n,)`` [kg].
        area: Undeformed areas, shape ``(n,)`` [m2].
    """

    def __init__(
        self,
        contactor: Surface,
        target: Surface,
        points_below: float | None = None,
    ) -> None:
        """Stack the surfaces; points touch if told their sharp angle, :func:`points_in` [rad]."""
        m, nt = len(contactor.nodes), len(target.nodes)
        self.points = p = None if points_below is None else points_in(contactor, points_below)
        self.nc = m if p is None else len(p.area)
        self.target = slice(self.nc, self.nc + nt)
        self.contactor = slice(0, m) if p is None else slice(self.nc + nt, self.nc + nt + m)
        own, other = tributary_area(contactor), tributary_area(target)
        parts = [
            (contactor.nodes, contactor.reference, contactor.dofs, contactor.mass, own),
            (target.nodes, target.reference, target.dofs, target.mass, other),
        ]
        self.nearest = np.arange(m)
        if p is not None:
            self.nearest = p.node[np.arange(self.nc), p.weight.argmax(axis=1)].astype(np.int64)
            none = np.full(self.nc, -1, dtype=np.int32)
            touching = (contactor.nodes[self.nearest], p.reference, none, p.mass, p.area)
            parts = [touching, parts[1], parts[0]]
        columns = (np.concatenate(column) for column in zip(*parts, strict=True))
        self.node, self.reference, self.dofs, self.mass, self.area = columns
        self.n = len(self.node)

    def behind(self, c: npt.NDArray[np.integer[Any]]) -> Index:
        """Return the numbers of the nodes that move ``c`` ``(k,)``: ``(k, 1)`` or ``(k, 4)``."""
        if self.points is None:
            return c[:, None].astype(np.int64)
        return self.points.node[c].astype(np.int64) + self.contactor.start

    def weights(self, c: npt.NDArray[np.integer[Any]]) -> Array:
        """Return the weights that go with :meth:`behind`."""
        return np.ones((len(c), 1)) if self.points is None else self.points.weight[c]

    def for_kernel(self) -> Any:
        """Return the points for the kernel, None where nodes touch."""
        p = self.points
        if p is None:
            return None
        node = np.ascontiguousarray(p.node + np.int32(self.contactor.start))
        per_mass = p.weight / self.mass[node]
        return struct("wr_points", node=node, weight=p.weight, per_mass=per_mass, height=p.height)
