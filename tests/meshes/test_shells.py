# SPDX-License-Identifier: LGPL-3.0-or-later
"""Hollow spheres."""

import numpy as np
import pytest

from meshes.hexmesh import boundary
from meshes.quads import area_vectors, enclosed_volume
from meshes.quality import cell_volumes
from meshes.shapes.shells import hollow_sphere
from meshes.tags import Tag


def test_an_eighth_of_a_hollow_sphere():
    """3 n² cells a layer, π/6 (b³ − a³) to second order, closed, every face with its tag."""
    errors = []
    for n in (4, 8):
        mesh = hollow_sphere(1.0, 2.0, 1 / n, across=n)
        assert len(mesh.cells) == 3 * n**3
        volume = cell_volumes(mesh.points, mesh.cells)
        assert volume.min() > 0
        skin = boundary(mesh.cells)
        assert enclosed_volume(mesh.points, skin) == pytest.approx(volume.sum(), rel=1e-12)
        np.testing.assert_allclose(area_vectors(mesh.points, skin).sum(axis=0), 0, atol=1e-12)
        errors.append(1 - volume.sum() / (np.pi / 6 * 7))
        counts = {tag: int((mesh.surfaces == tag).sum()) for tag in np.unique(mesh.surfaces)}
        planes = dict.fromkeys((Tag.XMIN, Tag.YMIN, Tag.ZMIN), 2 * n**2)
        assert counts == planes | {Tag.INSIDE: 3 * n**2, Tag.OUTSIDE: 3 * n**2}
    assert 0 < errors[1] < 0.26 * errors[0] < 0.01


def test_layers_grow_from_the_hole():
    """Edges 0.1, 0.12, …: ten equal ones would be 1; the nodes of a layer are on its sphere."""
    mesh = hollow_sphere(1.0, 2.0, 0.1, 1.2, across=2)
    radii = np.unique(np.round(np.linalg.norm(mesh.points, axis=1), 9))
    edges = np.diff(radii)
    assert radii[0] == 1.0 and radii[-1] == 2.0 and edges[0] < 0.1
    np.testing.assert_allclose(edges[1:] / edges[:-1], 1.2, rtol=1e-6)
    assert len(mesh.points) == len(radii) * 19  # three patches of 3 × 3 nodes share 8 of 27


def test_no_wall_is_refused():
    """The outer radius has to be larger, lengths positive: told by name."""
    for radii, name in (((2.0, 2.0), "outer_radius"), ((0.0, 2.0), "inner_radius")):
        with pytest.raises(ValueError, match=name):
            hollow_sphere(*radii, 0.1, across=2)
