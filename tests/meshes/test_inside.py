# SPDX-License-Identifier: LGPL-3.0-or-later
"""Points inside hexahedra and distances from quads, against closed forms."""

import numpy as np

from meshes.hexmesh import join
from meshes.inside import distance_to_quads, inside
from meshes.shapes.blocks import block, distorted
from meshes.shapes.caps import sphere_cap


def test_points_in_a_distorted_block():
    """Random nodes are inside a unit cube of skewed cells exactly where their coordinates are."""
    cube = distorted(block((0, 0, 0), (1, 1, 1), size=0.2), amplitude=0.3)
    points = np.random.default_rng(2).uniform(-0.3, 1.3, (500, 3))
    both = np.vstack([cube.points, points])
    wanted = len(cube.points) + np.arange(500)
    exact = ((points >= 0) & (points <= 1)).all(axis=1)
    assert (inside(both, cube.cells, wanted) == exact).all() and 0 < exact.sum() < 500


def test_faces_count_and_own_corners_do_not():
    """Nodes of a second block on a face of the first are inside; those of the first itself not."""
    lower = block((0, 0, 0), (1, 1, 1), size=0.5)
    pair = join(lower, block((0.1, 0.1, 1), (0.9, 0.9, 2), size=0.4))
    upper = np.arange(len(lower.points), len(pair.points))
    touching = inside(pair.points, pair.cells[: len(lower.cells)], upper)
    assert (touching == (pair.points[upper, 2] == 1)).all()
    assert not inside(lower.points, lower.cells, np.arange(len(lower.points))).any()


def test_distance_from_a_cube():
    """To the nearest of its six faces, inside and outside, edges and corners too."""
    cube = block((0, 0, 0), (1, 1, 1), size=0.5)
    x = np.random.default_rng(3).uniform(-1, 2, (300, 3))
    out = np.linalg.norm(x - np.clip(x, 0, 1), axis=1)
    within = np.minimum(x, 1 - x).min(axis=1)
    exact = np.where(out > 0, out, within)
    found = distance_to_quads(x, cube.points[cube.facets])
    np.testing.assert_allclose(found, exact, atol=1e-12)


def test_distance_from_a_sphere():
    """A cap of 25 mm cells on 0.5 m: from the centre the radius less the chord's 0.07 %."""
    cap = sphere_cap(0.5, 0.2, size=0.025, growth=1.0)
    quads = cap.points[cap.surface(cap.tag("cap"))]
    found = distance_to_quads(np.array([[0.0, 0.0, 0.5], [0.0, 0.0, 0.4]]), quads)
    np.testing.assert_allclose(found, [0.5, 0.4], rtol=8e-4)
