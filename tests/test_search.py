# SPDX-License-Identifier: LGPL-3.0-or-later
"""Closest points and candidates against brute force."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contact import ContactPair, Surface
from contact.search import SHARP, Search, facet_kinds, node_facets
from contact.surface import facet_areas, rigid_plane


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


def brute_force(surface, p, against):
    """Smallest distance over the facets whose normal opposes ``against``: grids, zooming in."""
    y = surface.reference[surface.facets]
    centre, half = np.zeros((len(y), 2)), 1.0
    g = np.stack(np.meshgrid(np.linspace(-1, 1, 17), np.linspace(-1, 1, 17)), 2).reshape(-1, 2)
    while half > 1e-9:
        z = np.clip(centre[:, None] + half * g, -1, 1)
        a, b = z[..., 0], z[..., 1]
        N = 0.25 * np.stack([(1 - a) * (1 - b), (1 + a) * (1 - b), (1 + a) * (1 + b),
                             (1 - a) * (1 + b)], 2)  # fmt: skip
        d = np.linalg.norm(np.einsum("qki,qia->qka", N, y) - p, axis=2)
        k = d.argmin(axis=1)
        q = np.arange(len(y))
        centre, half = z[q, k], half / 4.0
    a, b = centre[:, :1], centre[:, 1:]
    t1 = (y[:, 1] - y[:, 0]) * (1 - b) + (y[:, 2] - y[:, 3]) * (1 + b)
    t2 = (y[:, 3] - y[:, 0]) * (1 - a) + (y[:, 2] - y[:, 1]) * (1 + a)
    return np.where(np.cross(t1, t2) @ against < 0, d[q, k], np.inf).min()


def found(surface, points, normal=(0.0, 0.0, -1.0), reach=0.6, edge=1e-3):
    """Gap, candidates of the first corner of each probe."""
    probe = probes(points, len(surface.nodes), normal, edge)
    pair = ContactPair(probe, surface, dt=1e-6, reach=reach)
    pair.near.margin = reach
    n = 3 * (len(surface.nodes) + len(probe.nodes))
    field = SimpleNamespace(x=SimpleNamespace(array=np.zeros(n)))
    pair.add(SimpleNamespace(u=field, v=field, t=0.0), SimpleNamespace(array=np.zeros(n)))
    return pair


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10**6), st.floats(0.05, 0.35))
def test_closest_point_equals_brute_force(seed, bump):
    """Warped facets of a random sheet with ridges and hollows; nodes above and below it."""
    rng = np.random.default_rng(seed)
    xs, ys = np.cumsum(rng.uniform(0.7, 1.3, 5)), np.cumsum(rng.uniform(0.7, 1.3, 5))
    target = sheet(xs, ys, lambda x, y: bump * rng.uniform(-1, 1, x.shape))
    points = np.column_stack([
        rng.uniform(xs[1], xs[-2], 6), rng.uniform(ys[1], ys[-2], 6), rng.uniform(-0.4, 0.4, 6)
    ])  # fmt: skip
    pair = found(target, points)
    for k, p in enumerate(points):
        distance = brute_force(target, p, np.array([0, 0, -1.0]))
        if distance > 0.55:
            continue
        c = 4 * k
        assert c in pair.near.item
        assert abs(pair.history.gap[c]) == pytest.approx(distance, abs=1e-7)


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


def test_edges_vertices_and_concave_root():
    """A 90 degree root: floor z = 0 for x < 0, wall x = 0 for z > 0; exact gaps and normals."""
    target = root()
    area = facet_areas(target.reference, target.facets)
    assert (area[:9, 2] > 0).all() and (area[9:, 0] < 0).all()
    s = Search(target, target)
    assert (s.kind & SHARP > 0).sum() == 6  # the rows that meet in the root
    diagonal = np.array([1.0, 0.0, -1.0]) / np.sqrt(2)  # faces floor and wall alike
    points = [[-0.2, 1.5, 0.1], [-0.1, 1.5, 0.2], [0.05, 1.3, 0.3], [-0.3, 1.0, -0.05],
              [0.03, 1.5, -0.04]]  # fmt: skip
    pair = found(target, points, diagonal)
    gap, normal = pair.history.gap[::4], pair.history.normal[::4]
    # in the solid below the root the distance to the edge is the depth
    assert gap == pytest.approx([0.1, 0.1, -0.05, -0.05, -0.05], abs=1e-12)
    assert normal[:4] == pytest.approx(
        np.array([[0, 0, 1], [-1, 0, 0], [-1, 0, 0], [0, 0, 1]]), abs=1e-12
    )
    assert normal[4] == pytest.approx(np.array([-0.6, 0, 0.8]), abs=1e-12)


def test_tracking_sees_the_wall():
    """A node that skims the floor is caught by the wall, without a new search."""
    target, diagonal = root(), np.array([1.0, 0.0, -1.0]) / np.sqrt(2)
    pair = found(target, [[-0.35, 1.4, 0.1]], diagonal, reach=0.5)
    n, c = 3 * (len(target.nodes) + 4), pair.near.search.nc
    assert c == 4 and pair.history.gap[0] == pytest.approx(0.1)
    u, item = np.zeros(n), pair.near.item
    pair.near.margin = 10.0
    for x in np.linspace(0.0, 0.4, 41):
        u[-12::3] = x
        field = SimpleNamespace(x=SimpleNamespace(array=u))
        still = SimpleNamespace(x=SimpleNamespace(array=np.zeros(n)))
        state = SimpleNamespace(u=field, v=still, t=0.0)
        pair.add(state, SimpleNamespace(array=np.zeros(n)))
        assert pair.near.item is item
        assert pair.history.gap[0] == pytest.approx(min(0.1, 0.35 - x), abs=1e-12)


def test_exactly_on_nodes_and_edges_and_beyond_the_border():
    """Nodes over vertices, edges and the border are in contact; beyond the border they are not."""
    target = sheet(np.arange(4.0), np.arange(4.0), lambda x, y: 0 * x)
    inside = [[1, 1, -0.1], [1.5, 1, -0.1], [0, 0, -0.1], [3, 1.3, -0.1], [3, 3, -0.1]]
    outside = [[-0.1, 1, -0.1], [3.2, 1.5, -0.1], [-0.1, -0.1, -0.1]]
    pair = found(target, inside + outside)
    gap = pair.history.gap[::4]
    assert gap[:5] == pytest.approx(np.full(5, -0.1), abs=1e-14)
    assert np.isinf(gap[5:]).all()


def test_far_side_is_not_touched():
    """A node that faces away from the target, or lies deeper than the reach, has no contact."""
    target = sheet(np.arange(4.0), np.arange(4.0), lambda x, y: 0 * x)
    assert found(target, [[1.5, 1.5, -0.1]], (0, 0, 1.0)).active == 0
    assert found(target, [[1.5, 1.5, -0.7]]).active == 0


@settings(max_examples=6, deadline=None)
@given(st.integers(0, 10**6))
def test_nobody_is_missed_under_motion(seed):
    """Nodes that fly over a wavy sheet: each step finds the contacts that a new search finds."""
    rng = np.random.default_rng(seed)
    xs = np.linspace(0, 0.06, 25)
    target = sheet(xs, xs, lambda x, y: 1.5e-3 * np.sin(150 * x) * np.cos(110 * y))
    points = np.column_stack([rng.uniform(0, 0.06, (80, 2)), rng.uniform(0.5e-3, 6e-3, 80)])
    probe = probes(points, len(target.nodes), edge=2.5e-3)
    dt, reach = 1e-6, 1e-3
    pair = ContactPair(probe, target, dt=dt, reach=reach)
    n = 3 * (len(target.nodes) + len(probe.nodes))
    u, v = np.zeros(n), np.zeros(n)
    speed = np.column_stack([rng.uniform(-30, 30, (80, 2)), rng.uniform(-40, 5, 80)])
    v[3 * len(target.nodes) :] = np.repeat(speed, 4, axis=0).ravel()
    state = SimpleNamespace(
        u=SimpleNamespace(x=SimpleNamespace(array=u)),
        v=SimpleNamespace(x=SimpleNamespace(array=v)), t=0.0,
    )  # fmt: skip
    searches, began = 0, np.zeros(320, dtype=bool)
    force = SimpleNamespace(array=np.zeros(n))
    for _ in range(150):
        u += dt * v
        before = pair.near.item
        pair.add(state, force)
        searches += pair.near.item is not before
        fresh = ContactPair(probe, target, dt=dt, reach=reach)
        fresh.add(state, force)
        touch, again = pair.history.gap < 0, fresh.history.gap < 0
        # a first contact within the reach must be seen at once
        shallow = again & (fresh.history.gap > -2e-4)
        assert not (shallow & ~touch & ~began).any()
        both = touch & again
        assert pair.history.gap[both] == pytest.approx(fresh.history.gap[both], abs=1e-9)
        began |= touch
        pair.history.gap[:], fresh.history.gap[:] = np.inf, np.inf
    assert searches < 75 and began.any()


def test_search_cost_follows_the_patch():
    """Of a large surface only the neighbourhood of the other body is kept."""
    xs = np.linspace(0, 1.0, 201)
    target = sheet(xs, xs, lambda x, y: 0 * x)
    probe = probes([[0.5, 0.5, 1e-3]], len(target.nodes), edge=2e-3)
    pair = ContactPair(probe, target, dt=1e-7)
    n = 3 * (len(target.nodes) + len(probe.nodes))
    field = SimpleNamespace(x=SimpleNamespace(array=np.zeros(n)))
    pair.add(SimpleNamespace(u=field, v=field, t=0.0), SimpleNamespace(array=np.zeros(n)))
    assert 1 <= pair.near.search.live.sum() <= 25


def test_topology():
    target = sheet([0.0, 1, 2], [0.0, 1], lambda x, y: 0 * x)
    around, ring = node_facets(target.facets, 6)
    assert [sorted(ring[around[j] : around[j + 1]]) for j in (0, 2)] == [[0], [0, 1]]
    kind = facet_kinds(target.reference, target.facets, around, ring)
    assert [bin(k).count("1") for k in kind] == [3, 3]
    assert rigid_plane((0, 0, 0), (0, 1, 1), 2.0).facets.tolist() == [[0, 1, 2, 3]]
