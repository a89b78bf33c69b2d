# SPDX-License-Identifier: LGPL-3.0-or-later
"""Target surfaces for the search, and single contactor nodes that look for their closest points."""

from types import SimpleNamespace

import numpy as np

from contact import ContactPair, Surface


def mesh_of(points, quads):
    n = len(points)
    return Surface(
        "target", np.arange(n), np.asarray(points, float), np.asarray(quads, np.int32),
        np.ones(n), np.arange(n, dtype=np.int32),
    )  # fmt: skip


def sheet(xs, ys, height):
    """Grid of quads ``z = height(x, y)``, facing up."""
    x, y = np.meshgrid(xs, ys, indexing="ij")
    ids = np.arange(x.size).reshape(x.shape)
    quads = np.stack([ids[:-1, :-1], ids[1:, :-1], ids[1:, 1:], ids[:-1, 1:]], axis=2)
    return mesh_of(np.stack([x, y, height(x, y)], 2).reshape(-1, 3), quads.reshape(-1, 4))


def root():
    """Floor z = 0 for x < 0, wall x = 0 for z > 0."""
    xs = [-3.0, -2, -1, 0]
    ys = [0.0, 1, 2, 3]
    floor = sheet(xs, ys, lambda x, y: 0 * x)
    wall = sheet(xs, ys, lambda x, y: 0 * x)
    stand = wall.reference[:, [2, 1, 0]] * [1, 1, -1]  # z from 3 down to 0 at x = 0
    joined = np.vstack([floor.reference, stand])
    quads = np.vstack([floor.facets, wall.facets[:, ::-1] + 16])
    keep, merged = np.unique(np.round(joined, 9), axis=0, return_inverse=True)
    return mesh_of(keep, merged.ravel()[quads])


def probes(points, dof, normal=(0.0, 0.0, -1.0), edge=1e-3):
    """Single contactor nodes: a tiny facet each, first corner at the point, facing ``normal``."""
    a = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    a = edge * a / np.linalg.norm(a)
    b = np.cross(normal, a)
    corner = np.array([[0, 0, 0], a, a + b, b])
    every = (np.asarray(points)[:, None] + corner).reshape(-1, 3)
    n = len(every)
    quads = np.arange(n, dtype=np.int32).reshape(-1, 4)
    dofs = np.arange(dof, dof + n, dtype=np.int32)
    return Surface("probes", 10_000 + np.arange(n), every, quads, np.ones(n), dofs)


def found(surface, points, normal=(0.0, 0.0, -1.0), reach=0.6, edge=1e-3):
    """Gap, candidates of the first corner of each probe."""
    probe = probes(points, len(surface.nodes), normal, edge)
    pair = ContactPair(probe, surface, dt=1e-6, reach=reach)
    pair.passes[0].candidates.margin = reach
    n = 3 * (len(surface.nodes) + len(probe.nodes))
    field = SimpleNamespace(x=SimpleNamespace(array=np.zeros(n)))
    pair.add(SimpleNamespace(u=field, v=field, t=0.0), SimpleNamespace(array=np.zeros(n)))
    return pair
