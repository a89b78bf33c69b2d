# SPDX-License-Identifier: LGPL-3.0-or-later
"""Solid sleepers and the seats on them: sizes, gap, mass, shares of area, points below."""

import numpy as np
import pytest

from meshes.hexmesh import HexMesh
from meshes.quality import cell_volumes, quality, scaled_jacobians
from meshes.tags import Tag
from meshes.wheel_rail.rail import rail
from meshes.wheel_rail.seats import below, parts, shares
from meshes.wheel_rail.sleepers import places, sleepers

NS90 = {"spacing": 0.6, "length": 1.26, "width": 0.30, "height": 0.23, "pad": 0.01}
CONCRETE = 2520.0


@pytest.fixture(scope="module")
def track() -> tuple[HexMesh, HexMesh]:
    """4 m of inclined rail, off the middle, and its sleepers."""
    upper = rail(4.0, -1.7, size=8e-3, zone=(-0.05, 0.05))
    return upper, sleepers(foot(upper), **NS90)


def foot(upper: HexMesh) -> np.ndarray:
    return upper.points[np.unique(upper.surface(Tag.FOOT_UNDERSIDE))]


def test_size_mass_and_shape(track):
    """Seven sleepers of 12 cells and 219 kg in the middle of the rail; no cell worse than 0.999."""
    _, below_rail = track
    tops = parts(below_rail.surface(Tag.SLEEPER_TOP))
    assert len(tops) == 7 and len(below_rail.cells) == 84
    middles = [np.ptp(below_rail.points[t][:, :, 0]) / 2 + below_rail.points[t][:, :, 0].min()
               for t in tops]  # fmt: skip
    np.testing.assert_allclose(middles, 0.3 + 0.6 * np.arange(-3, 4), atol=1e-12)
    volume = cell_volumes(below_rail.points, below_rail.cells)
    assert volume.min() > 0 and scaled_jacobians(below_rail.points, below_rail.cells).min() > 0.999
    mass = CONCRETE * volume.sum() / 7
    assert mass == pytest.approx(CONCRETE * 1.26 * 0.30 * 0.23, rel=2e-4)
    assert mass == pytest.approx(219.0, rel=1e-3)
    q = quality(below_rail)
    assert q.volume == pytest.approx(q.enclosed, rel=1e-12)


def test_surfaces(track):
    """Underside and inner end have the areas drawn; all facets are named."""
    _, below_rail = track
    for tag, area in ((Tag.SLEEPER_BOTTOM, 1.26 * 0.3), (Tag.SLEEPER_INNER, 0.3 * 0.23)):
        x = below_rail.points[below_rail.surface(tag)]
        cross = np.cross(x[:, 2] - x[:, 0], x[:, 3] - x[:, 1]) / 2
        assert np.linalg.norm(cross, axis=1).sum() == pytest.approx(7 * area, rel=1e-12)
    inner = below_rail.points[np.unique(below_rail.surface(Tag.SLEEPER_INNER))]
    assert not inner[:, 1].any()
    assert set(below_rail.surfaces) == set(map(int, (
        Tag.SLEEPER_TOP, Tag.SLEEPER_BOTTOM, Tag.SLEEPER_INNER, Tag.SLEEPER_SKIN
    )))  # fmt: skip


def test_seat_lies_parallel_to_the_foot_at_the_thickness_of_the_pad(track):
    """10 mm square to the inclined foot at every node of it over a sleeper, to 1e-12 m."""
    upper, below_rail = track
    slope = np.ptp(foot(upper)[:, 2]) / np.ptp(foot(upper)[:, 1])
    assert slope == pytest.approx(1 / 40, rel=1e-9)
    for top in parts(below_rail.surface(Tag.SLEEPER_TOP)):
        x = below_rail.points[top][:, :, 0]
        over = foot(upper)
        over = over[(over[:, 0] >= x.min()) & (over[:, 0] <= x.max())]
        assert len(over) >= 13
        facet, weights = below(below_rail.points, top, over)
        under = np.einsum("ki,kid->kd", weights, below_rail.points[facet])
        np.testing.assert_allclose(under[:, :2], over[:, :2], atol=1e-12)
        gap = (over[:, 2] - under[:, 2]) / np.hypot(1, slope)
        np.testing.assert_allclose(gap, 0.01, atol=1e-12)


@pytest.mark.parametrize("stretch", [(-0.075, 0.075), (0.012, 0.013), (-0.5, 2.0)])
def test_shares_of_a_stretch(track, stretch):
    """They sum to 1; the centre is that of the stretch, wherever cells end; the moment is w²/12."""
    upper, _ = track
    start, end = stretch
    nodes, share = shares(upper.points, upper.surface(Tag.FOOT_UNDERSIDE), start, end)
    assert share.min() > 0 and share.sum() == pytest.approx(1, rel=1e-13)
    centre = share @ upper.points[nodes]
    assert centre[0] == pytest.approx((start + end) / 2, abs=1e-12)
    assert centre[1] == pytest.approx(foot(upper)[:, 1].mean(), abs=1e-4)
    y = upper.points[nodes, 1]
    plane = (foot(upper)[:, 1].min() + foot(upper)[:, 1].max()) / 2
    assert centre[1] == pytest.approx(plane, abs=1e-12)
    assert share @ (y - plane) ** 2 == pytest.approx(0.14**2 / 12 / (1 + 1 / 1600), rel=0.03)


def test_points_below_a_warped_surface():
    """Inverse of the bilinear map of a distorted quad, to 1e-12, inside and a little beside it."""
    points = np.array([[0.0, 0, 0], [1, 0.1, 0.1], [1.2, 1, 0], [-0.1, 0.8, 0.2]])
    xi = np.random.default_rng(0).uniform(-1.2, 1.2, (20, 2))
    corner = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    N = ((1 + xi[:, None] * corner) / 2).prod(axis=2)
    facet, weights = below(points, np.arange(4)[None], N @ points + [0, 0, 0.3])
    np.testing.assert_allclose(weights, N, atol=1e-12)
    assert (facet == np.arange(4)).all()


def test_places_are_counted_from_the_middle():
    """A rail of 10 m has 17 sleepers every 0.6 m; one of 1.2 m one, at its middle."""
    np.testing.assert_allclose(places(-5.3, 4.7, 0.6), -0.3 + 0.6 * np.arange(-8, 9))
    np.testing.assert_allclose(places(0.0, 1.2, 0.6), [0.6])


def test_bad_input(track):
    """Each error says what it got and what it expects."""
    upper, below_rail = track
    bad = {
        "width": "less than the spacing",
        "length": "a half sleeper of 3 or more cells that ends beyond 0.8",
    }
    for key, message in bad.items():
        with pytest.raises(ValueError, match=message):
            sleepers(foot(upper), **NS90 | {key: 0.7})
    with pytest.raises(ValueError, match=r"a plane along x, got points"):
        sleepers(upper.points, **NS90)
    with pytest.raises(ValueError, match=r"expected within the surface, which goes from -1.7"):
        shares(upper.points, upper.surface(Tag.FOOT_UNDERSIDE), 3.0, 3.1)
    with pytest.raises(ValueError, match=r"not over the surface"):
        below(below_rail.points, below_rail.surface(Tag.SLEEPER_TOP), upper.points[:1] + 9.0)
