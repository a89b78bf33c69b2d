# SPDX-License-Identifier: LGPL-3.0-or-later
"""Shapes of two touching bodies, measured on a mesh of another program: spheres and planes.

Closed forms of built-in meshes know their radii from the scene; of other meshes the nodes tell.
"""

from dataclasses import dataclass

import numpy as np

from meshes.arrays import Array, Index
from meshes.hexmesh import boundary
from meshes.quads import area_vectors
from workflow.results.record import Body

STEEP = np.cos(np.radians(20.0))  # facets within it of the axis belong to the contact
EXACT = 1e-6  # of the radius or extent: nodes of a shape lie on it so closely


@dataclass(frozen=True)
class Touching:
    """Two bodies that touch at the origin, one above the other.

    Attributes:
        regions: Names of the upper and the lower one.
        curvature: Of their contact surfaces, convex ones positive [1/m].
        halved: Whether the bodies begin at the plane through the origin, across x and across y.
        room: Least distance from the origin to the ends of the bodies [m].
        top: Area of the flat top of the upper one [m²].
    """

    regions: tuple[str, str]
    curvature: tuple[float, float]
    halved: tuple[bool, bool]
    room: float
    top: float


def touching(body: Body) -> Touching | None:
    """Return two bodies that touch at the origin, None if a mesh is not that."""
    if len(np.unique(body.regions)) != 2:
        return None
    tags = sorted(np.unique(body.regions), key=lambda t: -body.centres[body.regions == t, 2].mean())
    upper, lower = (body.cells[body.regions == tag] for tag in tags)
    above, beneath = _curvature(body.points, upper, -1.0), _curvature(body.points, lower, 1.0)
    if above is None or beneath is None:
        return None
    x = body.points[np.unique(upper)]
    low, high = x.min(axis=0), x.max(axis=0)
    near = EXACT * float((high - low).max())
    if abs(low[2]) > near:
        return None
    halved = bool(abs(low[0]) < near), bool(abs(low[1]) < near)
    below = body.points[np.unique(lower)]
    ends = [high[2], -below[:, 2].min(), *high[:2], *below[:, :2].max(axis=0)]
    for i in (0, 1):
        ends += [] if halved[i] else [-low[i], -below[:, i].min()]
    quads = boundary(upper)
    flat = (np.abs(body.points[quads][:, :, 2] - high[2]) < near).all(axis=1)
    top = float(np.linalg.norm(area_vectors(body.points, quads[flat]), axis=1).sum())
    names = body.names[int(tags[0])], body.names[int(tags[1])]
    return Touching(names, (above, beneath), halved, float(min(ends)), top)


def _curvature(points: Array, cells: Index, side: float) -> float | None:
    """Return the curvature of the end of a body, 0 for a plane, None for another shape [1/m].

    Args:
        points: Node positions, shape ``(n, 3)`` [m].
        cells: Hexahedra of the body, shape ``(c, 8)``.
        side: 1 for its upper end, -1 for its lower one.
    """
    quads = boundary(cells)
    normal = area_vectors(points, quads)
    facing = side * normal[:, 2] > STEEP * np.linalg.norm(normal, axis=1)
    x = points[np.unique(quads[facing])]
    size = float(np.ptp(points[np.unique(cells)], axis=0).max())
    if not len(x):
        return None
    if np.abs(x[:, 2]).max() < EXACT * size:
        return 0.0
    # |x|² = 2 c·x + d on a sphere round c
    found, *_ = np.linalg.lstsq(
        np.column_stack([2 * x / size, np.ones(len(x))]), (x**2).sum(axis=1) / size**2
    )
    centre = found[:3] * size
    radius = float(np.linalg.norm(centre))
    off = np.abs(np.linalg.norm(x - centre, axis=1) - radius).max()
    if off > EXACT * radius or np.abs(centre[:2]).max() > EXACT * radius:
        return None
    return -side * float(np.sign(centre[2])) / radius
