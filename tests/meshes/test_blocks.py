# SPDX-License-Identifier: LGPL-3.0-or-later
"""Shapes with closed-form answers: exact geometry, gradings, tags and refusals."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from meshes.hexmesh import HexMesh, boundary, join
from meshes.shapes import blocks, caps
from meshes.spacing import graded
from meshes.tags import Tag


def volumes(mesh: HexMesh) -> np.ndarray:
    """Volume of each cell by 2×2×2 Gauss points; also fails on any negative Jacobian."""
    square = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    signs = np.column_stack([np.tile(square, (2, 1)), np.repeat([-1, 1], 4)])
    total = np.zeros(len(mesh.cells))
    for xi in signs / np.sqrt(3):
        f = 1 + signs * xi
        grad = (
            signs / 8 * np.column_stack([f[:, 1] * f[:, 2], f[:, 0] * f[:, 2], f[:, 0] * f[:, 1]])
        )
        jac = np.linalg.det(np.einsum("cni,nj->cij", mesh.points[mesh.cells], grad))
        assert jac.min() > 0
        total += jac
    return total


def area_vectors(mesh: HexMesh, *tags: Tag) -> np.ndarray:
    """Area vector of a tagged surface, outward if the quads are counter-clockwise."""
    a, b, c, d = np.moveaxis(mesh.points[mesh.surface(*tags)], 1, 0)
    return np.cross(c - a, d - b).sum(axis=0) / 2


def test_block_fills_its_box_with_outward_faces():
    """A 2 × 3 × 4 box: volume 24, faces of area 12, 8 and 6 that point out of it."""
    mesh = blocks.block((1, 1, 1), (3, 4, 5), cells=(2, 3, 5))
    assert volumes(mesh).sum() == pytest.approx(24)
    normals = [area_vectors(mesh, tag) for tag in blocks.SIDES]
    np.testing.assert_allclose(
        normals,
        np.array([[-12, 0, 0], [12, 0, 0], [0, -8, 0], [0, 8, 0], [0, 0, -6], [0, 0, 6]]),
        atol=1e-12,
    )


def test_all_boundary_quads_are_tagged_once():
    """The tagged quads of a block are exactly its boundary."""
    mesh = blocks.block((0, 0, 0), (1, 1, 1), cells=(3, 2, 4))
    tagged, found = (np.sort(q, axis=1) for q in (mesh.facets, boundary(mesh.cells)))
    np.testing.assert_array_equal(np.unique(tagged, axis=0), np.unique(found, axis=0))
    assert len(tagged) == len(found)


@given(length=st.floats(1e-3, 1e3), ratio=st.floats(1e-3, 2.0), growth=st.floats(1.0, 3.0))
def test_spacing_keeps_size_growth_and_length(length, ratio, growth):
    """The first edge is at most ``size`` and not needlessly small; edges grow by ``growth``."""
    size = ratio * length
    s = graded(length, size, growth=growth)
    edges = np.diff(s)
    assert s[0] == 0 and s[-1] == length
    assert edges[0] <= size * (1 + 1e-6)
    np.testing.assert_allclose(edges[1:] / edges[:-1], growth, rtol=1e-6)
    if len(edges) > 1:  # one cell less would have been too coarse
        assert length / np.sum(growth ** np.arange(len(edges) - 1.0)) > size * (1 - 1e-6)


def test_block_is_finest_at_the_chosen_corner():
    """Graded towards (lower x, uniform y, upper z)."""
    mesh = blocks.block((0, 0, 0), (1, 1, 1), size=0.1, growth=1.5, fine=(-1, 0, 1))
    x, y, z = (np.diff(np.unique(mesh.points[:, a])) for a in range(3))
    assert np.all(np.diff(x) > 0) and np.all(np.diff(z) < 0)
    np.testing.assert_allclose(y, 0.1)
    assert max(x[0], z[-1]) <= 0.1


def test_bar_is_centred_on_the_x_axis():
    """A bar 1 m × 0.1 m (z) × 0.2 m (y)."""
    mesh = blocks.bar(1.0, 0.1, width=0.2, size=0.05)
    np.testing.assert_allclose(mesh.points.min(axis=0), [0, -0.1, -0.05])
    np.testing.assert_allclose(mesh.points.max(axis=0), [1, 0.1, 0.05])
    assert len(mesh.cells) == 20 * 4 * 2 and set(mesh.regions) == {Tag.BAR}


def test_cap_lies_on_the_sphere_and_keeps_flat_planes():
    """Every CAP node is at distance R from the centre; symmetry planes and top stay flat."""
    mesh = caps.sphere_cap(0.05, 0.02, size=5e-4, growth=1.2)
    on_cap = mesh.points[mesh.surface(Tag.CAP)] - [0, 0, 0.05]
    np.testing.assert_allclose(np.linalg.norm(on_cap, axis=-1), 0.05, rtol=1e-14)
    for tag, axis, value in ((Tag.XMIN, 0, 0), (Tag.YMIN, 1, 0), (Tag.ZMAX, 2, 0.02)):
        np.testing.assert_allclose(mesh.points[mesh.surface(tag)][..., axis], value, atol=1e-18)
    assert area_vectors(mesh, Tag.CAP)[2] == pytest.approx(-(0.02**2))
    assert np.ptp(mesh.points[mesh.cells[0]], axis=0).max() <= 5e-4


def test_cap_volume_converges_to_the_closed_form():
    """Box minus the volume under the sphere, by a fine midpoint rule."""
    radius, extent, n = 0.05, 0.02, 2000
    x = (np.arange(n) + 0.5) * extent / n
    under = np.sum(radius - np.sqrt(radius**2 - x**2 - x[:, None] ** 2)) * (extent / n) ** 2
    mesh = caps.sphere_cap(radius, extent, size=5e-4, growth=1.0)
    assert volumes(mesh).sum() == pytest.approx(extent**3 - under, rel=1e-4)


def test_cap_and_base_touch_at_the_origin_with_distinct_contact_surfaces():
    """Joined, both share the symmetry planes but not the surfaces that meet."""
    mesh = join(caps.sphere_cap(0.05, 0.01, size=1e-3), caps.base(0.01, size=1e-3))
    assert volumes(mesh).min() > 0
    top = mesh.points[mesh.surface(Tag.BASE_TOP)]
    cap = mesh.points[mesh.surface(Tag.CAP)]
    assert top[..., 2].min() == top[..., 2].max() == cap[..., 2].min() == 0
    np.testing.assert_allclose(area_vectors(mesh, Tag.BASE_TOP), [0, 0, 1e-4], atol=1e-18)
    assert set(mesh.regions) == {Tag.SPHERE, Tag.BASE}


def test_surfaces_renames_only_what_it_names():
    """A block for sliding on a base keeps its side tags."""
    mesh = blocks.block((0, 0, 0), (1, 1, 1), cells=(1, 1, 1), surfaces=blocks.BLOCK_FACES)
    expected = {Tag.XMIN, Tag.XMAX, Tag.YMIN, Tag.YMAX, Tag.BLOCK_BOTTOM, Tag.BLOCK_TOP}
    assert set(mesh.surfaces) == expected


def test_distorted_moves_interior_nodes_only_and_repeats():
    """Same boundary, positive cells, same volume, same result for the same seed."""
    mesh = blocks.block((0, 0, 0), (1, 2, 3), cells=(4, 4, 4))
    bent = blocks.distorted(mesh, amplitude=0.2, seed=3)
    moved = np.any(bent.points != mesh.points, axis=1)
    assert moved.sum() == 27 and not moved[boundary(mesh.cells)].any()
    assert volumes(bent).sum() == pytest.approx(6)
    again = blocks.distorted(mesh, amplitude=0.2, seed=3)
    np.testing.assert_array_equal(bent.points, again.points)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: blocks.bar(-1, 1, width=1, size=0.1), "length: .* got -1"),
        (lambda: blocks.bar(1, 1, width=0, size=0.1), "width: .* got 0"),
        (lambda: blocks.bar(1, 1, width=1, size=0), "size: .* got 0"),
        (lambda: blocks.bar(1, 1, width=1, size=np.nan), "size: .* got nan"),
        (lambda: blocks.block((0, 0, 0), (1, 1, -1), size=1), "upper: expected z > 0, got -1"),
        (lambda: blocks.block((0, 0, 0), (1, 1, 1), cells=(1, 0, 1)), "cells: .* got 0"),
        (lambda: blocks.block((0, 0, 0), (1, 1, 1)), "expected exactly one"),
        (lambda: blocks.block((0,) * 3, (1,) * 3, size=1, fine=(2, 0, 0)), "fine: .* got 2"),
        (lambda: caps.base(1, size=0.1, growth=0.9), "growth: .* got 0.9"),
        (lambda: caps.sphere_cap(1, 0.8, size=0.1), "extent: expected < .* got 0.8"),
        (lambda: caps.sphere_cap(1, 0.7, size=0.1), "height: expected > .* got 0.7"),
        (
            lambda: blocks.block((0,) * 3, (1,) * 3, size=1, surfaces={Tag.CAP: Tag.BASE_TOP}),
            "surfaces: .* got .*CAP",
        ),
        (lambda: blocks.distorted(caps.base(1, size=1), amplitude=0.5), "amplitude: .* 0.5"),
    ],
)
def test_bad_arguments_are_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()
