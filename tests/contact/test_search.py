# SPDX-License-Identifier: LGPL-3.0-or-later
"""Closest points and candidates against brute force."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contact import ContactPair, Surface
from contact.search import SHARP, Search, facet_kinds, node_facets
from contact.surface import rigid_plane
from meshes.quads import area_vectors
from tests.sheets import found, probes, root, sheet


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
        assert c in pair.passes[0].candidates.item
        assert abs(pair.passes[0].contact_state.gap[c]) == pytest.approx(distance, abs=1e-7)


def test_edges_vertices_and_concave_root():
    """A 90 degree root: floor z = 0 for x < 0, wall x = 0 for z > 0; exact gaps and normals."""
    target = root()
    area = area_vectors(target.reference, target.facets)
    assert (area[:9, 2] > 0).all() and (area[9:, 0] < 0).all()
    s = Search(target, target)
    assert (s.kind & SHARP > 0).sum() == 6  # the rows that meet in the root
    diagonal = np.array([1.0, 0.0, -1.0]) / np.sqrt(2)  # faces floor and wall alike
    points = [[-0.2, 1.5, 0.1], [-0.1, 1.5, 0.2], [0.05, 1.3, 0.3], [-0.3, 1.0, -0.05],
              [0.03, 1.5, -0.04]]  # fmt: skip
    pair = found(target, points, diagonal)
    gap, normal = pair.passes[0].contact_state.gap[::4], pair.passes[0].contact_state.normal[::4]
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
    n, c = 3 * (len(target.nodes) + 4), pair.passes[0].candidates.search.nc
    assert c == 4 and pair.passes[0].contact_state.gap[0] == pytest.approx(0.1)
    u, item = np.zeros(n), pair.passes[0].candidates.item
    pair.passes[0].candidates.margin = 10.0
    for x in np.linspace(0.0, 0.4, 41):
        u[-12::3] = x
        field = SimpleNamespace(x=SimpleNamespace(array=u))
        still = SimpleNamespace(x=SimpleNamespace(array=np.zeros(n)))
        state = SimpleNamespace(u=field, v=still, t=0.0)
        pair.add(state, SimpleNamespace(array=np.zeros(n)))
        assert pair.passes[0].candidates.item is item
        assert pair.passes[0].contact_state.gap[0] == pytest.approx(min(0.1, 0.35 - x), abs=1e-12)


def test_exactly_on_nodes_and_edges_and_beyond_the_border():
    """Nodes over vertices, edges and the border are in contact; beyond the border they are not."""
    target = sheet(np.arange(4.0), np.arange(4.0), lambda x, y: 0 * x)
    inside = [[1, 1, -0.1], [1.5, 1, -0.1], [0, 0, -0.1], [3, 1.3, -0.1], [3, 3, -0.1]]
    outside = [[-0.1, 1, -0.1], [3.2, 1.5, -0.1], [-0.1, -0.1, -0.1]]
    pair = found(target, inside + outside)
    gap = pair.passes[0].contact_state.gap[::4]
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
        before = pair.passes[0].candidates.item
        pair.add(state, force)
        searches += pair.passes[0].candidates.item is not before
        fresh = ContactPair(probe, target, dt=dt, reach=reach)
        fresh.add(state, force)
        touch, again = pair.passes[0].contact_state.gap < 0, fresh.passes[0].contact_state.gap < 0
        # a first contact within the reach must be seen at once
        shallow = again & (fresh.passes[0].contact_state.gap > -2e-4)
        assert not (shallow & ~touch & ~began).any()
        both = touch & again
        assert pair.passes[0].contact_state.gap[both] == pytest.approx(
            fresh.passes[0].contact_state.gap[both], abs=1e-9
        )
        began |= touch
        pair.passes[0].contact_state.gap[:], fresh.passes[0].contact_state.gap[:] = np.inf, np.inf
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
    assert 1 <= pair.passes[0].candidates.found.live.sum() <= 25


def test_topology():
    target = sheet([0.0, 1, 2], [0.0, 1], lambda x, y: 0 * x)
    around, ring = node_facets(target.facets, 6)
    assert [sorted(ring[around[j] : around[j + 1]]) for j in (0, 2)] == [[0], [0, 1]]
    kind = facet_kinds(target.reference, target.facets, around, ring)
    assert [bin(k).count("1") for k in kind] == [3, 3]
    assert rigid_plane((0, 0, 0), (0, 1, 1), 2.0).facets.tolist() == [[0, 1, 2, 3]]


def carried(target, points, motion, steps, dt=1e-6, reach=1e-3, normal=(0.0, 0.0, -1.0)):
    """Single nodes moved by ``motion(k)``, displacement and velocity ``(n, 3)`` at step k.

    Yields the pair and, for comparison, one that searches anew at every step.
    """
    probe = probes(points, len(target.nodes), normal, edge=2.5e-3)
    pair = ContactPair(probe, target, dt=dt, reach=reach)
    n, first = 3 * (len(target.nodes) + len(probe.nodes)), 3 * len(target.nodes)
    u, v, force = np.zeros(n), np.zeros(n), SimpleNamespace(array=np.zeros(n))
    state = SimpleNamespace(
        u=SimpleNamespace(x=SimpleNamespace(array=u)),
        v=SimpleNamespace(x=SimpleNamespace(array=v)), t=0.0,
    )  # fmt: skip
    for k in range(steps):
        shift, speed = motion(k)
        u[first:], v[first:] = np.repeat(shift, 4, axis=0).ravel(), np.repeat(speed, 4, 0).ravel()
        pair.add(state, force)
        fresh = ContactPair(probe, target, dt=dt, reach=reach)
        fresh.add(state, force)
        yield pair, fresh


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 10**6), st.floats(5e6, 2e7))
def test_nobody_is_missed_from_rest(seed, acceleration):
    """Nodes at rest far outside the margin, then thrown at the target by a million g.

    No search is due when they start, as nothing moves; each contact is found at the step at which a
    new search finds it.
    """
    rng = np.random.default_rng(seed)
    xs = np.linspace(0, 0.03, 13)
    target = sheet(xs, xs, lambda x, y: 5e-4 * np.sin(200 * x) * np.cos(150 * y))
    points = np.column_stack([rng.uniform(0.002, 0.028, (12, 2)), rng.uniform(6e-3, 12e-3, 12)])
    share = rng.uniform(0.3, 1.0, 12)
    began, wait = np.zeros(48, dtype=bool), 40

    def fall(k):
        t = max(k - wait, 0) * 1e-6
        down = np.array([0, 0, -acceleration]) * share[:, None]
        return down * t**2 / 2, down * max(t - 5e-7, 0)

    for pair, fresh in carried(target, points, fall, 130):
        touch = pair.passes[0].contact_state.gap < 0
        new = (fresh.passes[0].contact_state.gap < 0) & ~began
        assert not (new & ~touch).any()
        began |= touch
        pair.passes[0].contact_state.gap[:], fresh.passes[0].contact_state.gap[:] = np.inf, np.inf
    assert began.any()


def test_a_jump_that_nobody_could_see_is_told():
    """Nodes 6 mm away stand on the target two steps later: an error, not a silent miss."""
    xs = np.linspace(0, 0.03, 13)
    target = sheet(xs, xs, lambda x, y: 0 * x)

    def leap(k):
        return np.array([[0, 0, -6.1e-3 if k > 20 else 0.0]]), np.zeros((1, 3))

    with pytest.raises(RuntimeError, match="was not watched"):
        for _ in carried(target, [[0.015, 0.015, 6e-3]], leap, 60):
            pass


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 10**6))
def test_sharp_surfaces_under_motion_equal_brute_force(seed):
    """Nodes wander over ridges and roots of up to 70 degrees: distances of brute force each step.

    Two facets are often equally near there; which one is taken must not matter for the distance.
    """
    rng = np.random.default_rng(seed)
    xs = np.linspace(0, 0.012, 7)
    steep = np.tan(np.radians(rng.uniform(20, 70)))
    target = sheet(xs, xs, lambda x, y: steep * np.abs((x / 2e-3) % 2 - 1) * 2e-3)
    points = np.column_stack([rng.uniform(3e-3, 9e-3, (4, 2)), np.full(4, 2e-3 * steep + 3e-4)])
    way = np.column_stack([rng.uniform(-40, 40, (4, 2)), rng.uniform(-8, 0, 4)])
    checked = 0
    for k, (pair, _) in enumerate(
        carried(target, points, lambda k: (k * 1e-6 * way, way), 60, reach=2e-3)
    ):
        if k % 6:
            continue
        for i, p in enumerate(points + k * 1e-6 * way):
            distance = brute_force(target, p, np.array([0, 0, -1.0]))
            above = p[2] > steep * abs((p[0] / 2e-3) % 2 - 1) * 2e-3
            if 4 * i in pair.passes[0].candidates.item and above:
                assert abs(pair.passes[0].contact_state.gap[4 * i]) == pytest.approx(
                    distance, abs=1e-9
                )
                checked += 1
    assert checked > 5


def test_node_leaves_over_the_end_of_the_target():
    """A pressed node slides off the end: contact to within a hundredth of a facet, then none."""
    xs = np.linspace(0, 4e-3, 5)
    target = sheet(xs, xs, lambda x, y: 0 * x)
    way = np.array([[10.0, 0.0, 0.0]])
    last = 0.0
    for k, (pair, _) in enumerate(
        carried(target, [[3.5e-3, 2e-3, -2e-5]], lambda k: (k * 1e-6 * way, way), 100)
    ):
        x = 3.5e-3 + k * 1e-5
        if pair.passes[0].contact_state.normal_force[0] > 0:
            last = x
            assert pair.passes[0].contact_state.gap[0] == pytest.approx(-2e-5, rel=1e-9)
    assert last == pytest.approx(4e-3, abs=2e-5)


def test_several_pairs_and_patches():
    """Two targets and two groups of nodes on one: each pair and patch has its own forces."""
    xs = np.linspace(0, 0.02, 21)
    floor = sheet(xs, xs, lambda x, y: 0 * x)
    ceiling = sheet(xs, xs, lambda x, y: 0 * x + 5e-3)
    ceiling = Surface(
        "ceiling", 5000 + ceiling.nodes, ceiling.reference, ceiling.facets[:, ::-1].copy(),
        ceiling.mass, ceiling.dofs + len(floor.nodes),
    )  # fmt: skip
    n = len(floor.nodes) + len(ceiling.nodes)
    low = [[5e-3, 5e-3, -1e-5], [5.1e-3, 5e-3, -1e-5], [15e-3, 15e-3, -2e-5]]
    down = probes(low, n, (0, 0, -1.0), edge=1e-4)
    up = probes([[8e-3, 8e-3, 5.02e-3]], n + len(down.nodes), (0, 0, 1.0), edge=1e-4)
    size = 3 * (n + len(down.nodes) + len(up.nodes))
    field = SimpleNamespace(x=SimpleNamespace(array=np.zeros(size)))
    state = SimpleNamespace(u=field, v=field, t=0.0)
    forces = []
    for contactor, target in ((down, floor), (up, ceiling)):
        pair = ContactPair(contactor, target, dt=1e-6, reach=1e-4)
        force = SimpleNamespace(array=np.zeros(size))
        pair.add(state, force)
        forces.append(force.array.reshape(-1, 3))
        assert np.abs(forces[-1].sum(axis=0)).max() <= 1e-12 * np.abs(forces[-1]).sum()
        if target is floor:
            patches = pair.footprint().patches
            assert len(patches) == 3 and pair.active == 12  # each probe is a facet of its own
    assert forces[0][: len(floor.nodes), 2].sum() < 0 < forces[1][len(floor.nodes) : n, 2].sum()
    assert (forces[0][len(floor.nodes) : n] == 0).all() and (
        forces[1][: len(floor.nodes)] == 0
    ).all()
