# SPDX-License-Identifier: LGPL-3.0-or-later
"""Two curved bodies: exact surfaces, uniform zones, tags that cover the boundary, refusals."""

from dataclasses import replace

import numpy as np
import pytest

from meshes.hexmesh import boundary
from meshes.quality import quality
from meshes.shapes import caps
from meshes.spacing import zoned
from meshes.tags import Tag

PLAN = caps.Footing((-0.03, 0.05), (0.0, 0.02), (-0.004, 0.01), (0.0, 0.003), 0.02, 0.001)


def surface(mesh, tag: Tag) -> np.ndarray:
    """Positions of the nodes of a surface, shape ``(n, 3)``."""
    return mesh.points[np.unique(mesh.surface(tag))]


def test_zone_is_uniform_and_grows_outside():
    """Edges of at most the size in the zone, next ones larger by growth, ends exact."""
    x = zoned("x", (-0.03, 0.05), (-0.004, 0.01), 0.001, 1.3)
    assert x[0] == -0.03 and x[-1] == 0.05
    edges, middle = np.diff(x), (x[1:] + x[:-1]) / 2
    inside = (middle > -0.004) & (middle < 0.01)
    np.testing.assert_allclose(edges[inside], 0.001)
    for side in (edges[middle > 0.01], edges[middle < -0.004][::-1]):
        assert side[0] <= 0.0013 * (1 + 1e-9)
        np.testing.assert_allclose(side[1:] / side[:-1], 1.3)


@pytest.mark.parametrize(("radius", "crown"), [(0.2, 0.2), (0.46, None), (None, 0.3), (0.4, 0.08)])
def test_surfaces_of_revolution(radius, crown):
    """Equal radii make a sphere, one alone a cylinder; else a circle of the profile's radius."""
    mesh = caps.cap(PLAN, radius=radius, crown=crown)
    x, y, z = surface(mesh, Tag.CAP).T
    side = 0 * y if crown is None else crown - np.sqrt(crown**2 - y**2)
    if radius is None:
        np.testing.assert_allclose(z, side, atol=1e-15)
    else:
        np.testing.assert_allclose(np.hypot(x, radius - z), radius - side, rtol=1e-13)
    if radius == crown:
        np.testing.assert_allclose(x**2 + y**2 + (z - radius) ** 2, radius**2, rtol=1e-13)
    np.testing.assert_allclose(surface(mesh, Tag.ZMAX)[:, 2], PLAN.depth)
    assert quality(mesh).scaled_jacobian > 0.7


def test_below_is_the_mirror_image():
    """Nodes of the lower body are those of the upper one with z reversed; its cells are sound."""
    upper, lower = caps.cap(PLAN, crown=0.3), caps.below(PLAN, crown=0.3)
    mirror = np.sort((upper.points * [1, 1, -1]).round(12).view("f8,f8,f8"), axis=0)
    own = np.sort(lower.points.round(12).view("f8,f8,f8"), axis=0)
    for name in ("f0", "f1", "f2"):
        np.testing.assert_allclose(own[name], mirror[name], atol=1e-11)
    assert quality(lower).scaled_jacobian > 0.7
    assert surface(lower, Tag.BASE_TOP)[:, 2].max() == 0.0


def test_roller_is_a_ring_about_its_axle():
    """Running surface at R from the axle, top at R less the height, x along the circle."""
    mesh = caps.roller(PLAN, radius=0.46)
    for tag, radius in ((Tag.CAP, 0.46), (Tag.ZMAX, 0.46 - PLAN.depth)):
        x, _, z = surface(mesh, tag).T
        np.testing.assert_allclose(np.hypot(x, z - 0.46), radius, rtol=1e-13)
        angle = np.arctan2(x, 0.46 - z)
        assert (angle.min(), angle.max()) == pytest.approx((-0.03 / 0.46, 0.05 / 0.46))


@pytest.mark.parametrize("make", [caps.cap, caps.below])
def test_layers_and_tags(make):
    """One layer for plane strain; the tagged quads are exactly the boundary."""
    mesh = make(replace(PLAN, y=(0.0, 0.0005), layers=1), radius=0.2)
    assert set(mesh.points[:, 1]) == {0.0, 0.0005}
    tagged, found = (np.sort(q, axis=1) for q in (mesh.facets, boundary(mesh.cells)))
    np.testing.assert_array_equal(np.unique(tagged, axis=0), np.unique(found, axis=0))


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: caps.cap(replace(PLAN, fine_x=(-0.04, 0.0))), "fine_x"),
        (lambda: caps.cap(PLAN, radius=0.04), "radius"),
        (lambda: caps.cap(PLAN, radius=0.052), "radius|depth"),
        (lambda: caps.roller(PLAN, radius=0.01), "height"),
        (lambda: caps.roller(PLAN, radius=0.03), "quarter"),
    ],
)
def test_refusals(call, words):
    with pytest.raises(ValueError, match=words):
        call()
