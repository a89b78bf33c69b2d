# SPDX-License-Identifier: LGPL-3.0-or-later
import numpy as np
import pytest

from meshes.hexmesh import boundary
from meshes.placement import rail_in_track
from meshes.quality import quality, volumes
from meshes.split import edges_of, trisect
from meshes.tags import Tag
from meshes.track import rail


@pytest.fixture(scope="module", params=[8e-3, 4e-3, pytest.param(2e-3, marks=pytest.mark.slow)])
def mesh(request):
    return request.param, rail(3.0, -1.0, size=request.param, zone=(-0.05, 0.15))


def brick(n):
    """A cube of n³ unit cells whose local axes are turned at random."""
    number = np.arange((n + 1) ** 3).reshape(n + 1, n + 1, n + 1)
    low, high = slice(None, -1), slice(1, None)
    at = [(low, low), (high, low), (high, high), (low, high)]
    cells = np.stack([number[i, j, k].ravel() for k in (low, high) for i, j in at], axis=1)
    turns = [[0, 1, 2, 3, 4, 5, 6, 7], [1, 2, 3, 0, 5, 6, 7, 4], [0, 3, 7, 4, 1, 2, 6, 5]]
    choice = np.random.default_rng(0).integers(3, size=len(cells))
    cells = np.take_along_axis(cells, np.array(turns)[choice], axis=1)
    grid = np.arange(n + 1.0)
    return np.array(np.meshgrid(grid, grid, grid, indexing="ij")).reshape(3, -1).T, cells


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_trisected_box_fills_the_cube(axis):
    """Edges in a box of 2³ cells within 5³: 8·3 + 16·4 (faces) + 8·5 (edges) cells, no overlap."""
    points, cells = brick(5)
    edges, of_cell = edges_of(cells)
    along = np.abs(np.diff(points[edges], axis=1))[:, 0, axis] > 0.5
    inside = ((points >= 1) & (points <= 3)).all(axis=1)[edges].all(axis=1)
    made = trisect(points, cells, edges, of_cell, along & inside)
    new = np.einsum("mk,mkj->mj", made.weights, points[made.sources])
    x = np.vstack([points, new])
    assert len(made.cells) == 125 + 8 * 2 + 16 * 3 + 8 * 4
    assert len(np.unique(np.round(x, 9), axis=0)) == len(x)
    facets = x[boundary(made.cells)]
    assert ((facets == 0).all(axis=1) | (facets == 5).all(axis=1)).any(axis=1).all()


def test_two_directions_in_one_cell():
    points, cells = brick(1)
    edges, of_cell = edges_of(cells)
    with pytest.raises(ValueError, match="one direction per cell"):
        trisect(points, cells, edges, of_cell, np.ones(len(edges), dtype=bool))


def test_shape_and_volume(mesh):
    """Valid cells fill exactly what their surface encloses and weigh 54.77 kg/m within 1 %."""
    _, msh = mesh
    q = quality(msh)
    assert volumes(msh).min() > 0 and q.scaled_jacobian > 0.25
    assert q.volume == pytest.approx(q.enclosed, rel=1e-12)
    assert q.mass / 3.0 == pytest.approx(54.77, rel=0.01)
    assert set(q.regions) == {"RAIL_HEAD", "RAIL_WEB", "RAIL_FOOT"}
    assert np.array_equal(np.unique(msh.cells), np.arange(q.nodes))


def test_surfaces(mesh):
    """Railhead nodes lie on the profile in the track; ends and foot have the areas drawn."""
    _, msh = mesh
    profile = rail_in_track()
    nodes = np.unique(msh.surface(Tag.RAILHEAD))
    fine = profile.at(np.arange(0, profile.length, 2e-5))
    for point in msh.points[nodes[:: len(nodes) // 50], 1:]:
        assert np.hypot(*(fine - point).T).min() < 1.1e-5
    assert area(msh, Tag.FOOT_UNDERSIDE) == pytest.approx(3.0 * 0.140, rel=1e-6)
    assert area(msh, Tag.RAIL_ENDS) == pytest.approx(2 * 69.775e-4, rel=0.01)
    assert set(np.unique(msh.points[np.unique(msh.surface(Tag.RAIL_ENDS)), 0])) == {-1.0, 2.0}


def test_fine_zone(mesh):
    """The zone is covered by facets of the wanted size, 8 or more edges round the gauge corner."""
    size, msh = mesh
    quads = msh.points[msh.surface(Tag.RAILHEAD)]
    profile = rail_in_track()
    corner = profile.at(profile.joints[1:3])
    centre = quads.mean(axis=1)
    inside = (centre[:, 0] > -0.05) & (centre[:, 0] < 0.15)
    band = inside & (centre[:, 2] > corner[0, 1]) & (centre[:, 1] < 0.755)
    edges = np.linalg.norm(quads - np.roll(quads, 1, axis=1), axis=2)
    assert edges[band].max() < 1.31 * size
    column = inside & (np.abs(centre[:, 0] - centre[band][0, 0]) < 1e-6)
    round_corner = column & (centre[:, 2] > corner[0, 1]) & (centre[:, 1] < corner[1, 0])
    assert round_corner.sum() >= 8


def test_support_stations():
    """Cells under the foot are at most 100 mm long, so that pads find their nodes."""
    msh = rail(size=8e-3)
    x = np.unique(np.round(msh.points[np.unique(msh.surface(Tag.FOOT_UNDERSIDE)), 0], 6))
    assert np.diff(x).max() <= 0.1 + 1e-9 and x[0] == -5.0 and x[-1] == 5.0


@pytest.mark.parametrize(
    ("change", "message"),
    [({"size": 1e-2}, "size"), ({"zone": (4.5, 4.99)}, "zone"), ({"zone": (0.1, -0.1)}, "zone")],
)
def test_bad_input(change, message):
    with pytest.raises(ValueError, match=message):
        rail(**change)


def area(msh, tag):
    p = msh.points[msh.surface(tag)]
    normal = np.cross(p[:, 2] - p[:, 0], p[:, 3] - p[:, 1]) / 2
    return np.linalg.norm(normal, axis=1).sum()
