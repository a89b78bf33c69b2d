# SPDX-License-Identifier: LGPL-3.0-or-later
"""Integrals over bilinear quads against closed forms; the public faces of the meshes."""

import numpy as np
import pytest

import meshes
from meshes import block, profiles
from meshes.quads import (
    area_shares,
    area_vectors,
    bilinear,
    corner_areas,
    enclosed_volume,
    nodal_areas,
)
from meshes.shapes.blocks import distorted

TRAPEZOID = np.array([[0.0, 0, 0], [4, 0, 0], [3, 2, 0], [1, 2, 0]])  # area 6


def test_shape_functions_are_one_at_their_corner():
    """Nᵢ = 1 at corner i and 0 at the others; they sum to 1 anywhere, their slopes to 0."""
    N, _, _ = bilinear([-1, 1, 1, -1], [-1, -1, 1, 1])
    np.testing.assert_array_equal(N, np.eye(4))
    N, along, across = bilinear(0.3, -0.7)
    assert N.sum() == pytest.approx(1) and along.sum() == across.sum() == 0


def test_areas_of_a_trapezoid():
    """Parallel sides 4 and 2, height 2: area 6, of which the corners of side 4 have 5/3 each."""
    quad = np.arange(4)[None]
    np.testing.assert_allclose(area_vectors(TRAPEZOID, quad), [[0, 0, 6]])
    np.testing.assert_allclose(nodal_areas(TRAPEZOID, quad), [5 / 3, 5 / 3, 4 / 3, 4 / 3])
    np.testing.assert_allclose(corner_areas(TRAPEZOID, quad), [[5 / 3, 5 / 3, 4 / 3, 4 / 3]])
    nodes, share = area_shares(TRAPEZOID, quad)
    np.testing.assert_array_equal(nodes, quad[0])
    assert share.sum() == pytest.approx(1)


def test_volume_within_the_surface_of_a_sheared_block():
    """A box of 2 × 3 × 4 has volume 24, sheared too, wherever it lies."""
    mesh = block((0, 0, 0), (2, 3, 4), cells=(2, 3, 2))
    points = mesh.points @ np.array([[1, 0.4, 0], [0, 1, 0.2], [0, 0, 1]]) + [7, 0, -5]
    assert enclosed_volume(points, mesh.facets) == pytest.approx(24)
    assert enclosed_volume(distorted(mesh).points, mesh.facets) == pytest.approx(24)


@pytest.mark.parametrize("face", [meshes, profiles])
def test_every_name_of_a_public_face_is_there(face):
    """Each name in ``__all__`` is imported on first use; others raise AttributeError."""
    assert all(hasattr(face, name) for name in face.__all__)
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = face.nothing
