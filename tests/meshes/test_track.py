# SPDX-License-Identifier: LGPL-3.0-or-later
import numpy as np
import pytest

from meshes.generate.refine import trisect
from meshes.hexmesh import FACES, boundary, edges_of
from meshes.profiles.measured import from_points
from meshes.profiles.placement import rail_in_track
from meshes.profiles.profiles import rail_54e1
from meshes.quality import cell_volumes, quality
from meshes.tags import Tag
from meshes.wheel_rail.rail import rail as track
from meshes.wheel_rail.rail_section import completed


@pytest.fixture(scope="module", params=[8e-3, 4e-3, pytest.param(2e-3, marks=pytest.mark.slow)])
def mesh(request):
    return request.param, track(3.0, -1.0, size=request.param, zone=(-0.05, 0.15))


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
    assert cell_volumes(msh.points, msh.cells).min() > 0 and q.scaled_jacobian > 0.25
    assert q.volume == pytest.approx(q.enclosed, rel=1e-12)
    assert q.mass / 3.0 == pytest.approx(54.77, rel=0.01)
    assert set(q.regions) == {"RAIL_HEAD", "RAIL_WEB", "RAIL_FOOT"}
    assert np.array_equal(np.unique(msh.cells), np.arange(q.nodes))


STANDARDS = {"54E1": (69.77e-4, 2337.9e-8, 419.2e-8), "60E1": (76.70e-4, 3038.3e-8, 512.3e-8)}


@pytest.mark.parametrize("size", [8e-3, 4e-3, 2e-3, 1e-3])
@pytest.mark.parametrize("design", STANDARDS)
def test_section_of_the_mesh(design, size):
    """Area and second moments of the meshed section are the standard's within 0.5 %."""
    msh = track(1.0, -0.5, size=size, zone=(0.0, 0.02), inclination=0.0, design=design)
    ends = msh.points[msh.surface(Tag.RAIL_ENDS)]
    quads = ends[ends[:, 0, 0] == -0.5][:, :, 1:]
    y, z = quads[..., 0], quads[..., 1]
    y_next, z_next = np.roll(y, -1, axis=1), np.roll(z, -1, axis=1)
    cross = y * z_next - y_next * z
    area = cross.sum() / 2
    centre = [(cross * (u + v)).sum() / 6 / area for u, v in ((y, y_next), (z, z_next))]
    second = [
        (cross * (u * u + u * v + v * v)).sum() / 12 / area - c**2
        for (u, v), c in zip(((y, y_next), (z, z_next)), centre, strict=True)
    ]
    found = abs(area) * np.array([1.0, second[1], second[0]])
    assert found == pytest.approx(np.array(STANDARDS[design]), rel=5e-3)


def test_no_hanging_nodes(mesh):
    """Every facet belongs to one or two cells, every edge of the surface to two of its facets."""
    _, msh = mesh
    facets = np.sort(msh.cells[:, FACES].reshape(-1, 4), axis=1)
    assert np.unique(facets, axis=0, return_counts=True)[1].max() == 2
    skin = boundary(msh.cells)
    edges = np.sort(np.stack([skin, np.roll(skin, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()


def crown(radius, half):
    """A round rail head, its top at (0, 0), without sides."""
    y = np.linspace(-half, half, 141)
    return from_points(np.column_stack([y, np.sqrt(radius**2 - y**2) - radius]))


def worn(wear):
    """54E1 with the gauge corner worn off towards the gauge side, up to ``wear``."""
    points = rail_54e1().at(np.arange(2e-3, rail_54e1().length - 1e-3, 1e-3))
    gone = wear * np.clip(-points[:, 0] / 0.036, 0, 1) ** 2
    return from_points(points + np.column_stack([gone, -gone]), smoothing=1e-5)


HEADS = {"crown": crown(0.3, 0.035), "narrow": crown(0.3, 0.030), "worn": worn(3e-3)}


@pytest.mark.parametrize("size", [8e-3, 2e-3])
@pytest.mark.parametrize("design", ["54E1", "60E1"])
@pytest.mark.parametrize("head", HEADS)
def test_any_head(head, design, size):
    """A head of another shape on web and foot of a standard rail: valid, without overlap."""
    msh = track(1.0, -0.5, size=size, zone=(0.0, 0.02), profile=HEADS[head], design=design)
    q = quality(msh)
    assert cell_volumes(msh.points, msh.cells).min() > 0 and q.scaled_jacobian > 0.25
    assert q.volume == pytest.approx(q.enclosed, rel=1e-12)
    assert 0.7 < q.volume / STANDARDS[design][0] < 1.15


def test_head_without_sides():
    """A crown gets sides of slope 20:1 down to the height of the lower head corner of 54E1."""
    head = completed(crown(0.3, 0.035))
    edge = np.array([-0.035, np.sqrt(0.3**2 - 0.035**2) - 0.3])
    drop = edge[1] + 0.034057
    assert head.at(0.0) == pytest.approx([edge[0] - drop / 20, -0.034057], abs=1e-6)
    start, end = head.joints[0], head.joints[1]
    assert end - start == pytest.approx(drop * np.hypot(1, 1 / 20), rel=1e-4)
    assert completed(head).length == pytest.approx(head.length, rel=1e-9)
    assert completed(rail_54e1()).length == pytest.approx(rail_54e1().length, rel=1e-6)


def test_head_of_the_whole_outline():
    """From a rail drawn all round only the running surface is taken."""
    outline = rail_54e1("outline")
    half = outline.length / 2
    s = np.concatenate([np.arange(half + 1e-3, outline.length, 1e-3), np.arange(0, half, 1e-3)])
    head = completed(from_points(outline.at(s)))
    assert head.length == pytest.approx(rail_54e1().length, abs=5e-5)


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
    msh = track(size=8e-3)
    x = np.unique(np.round(msh.points[np.unique(msh.surface(Tag.FOOT_UNDERSIDE)), 0], 6))
    assert np.diff(x).max() <= 0.1 + 1e-9 and x[0] == -5.0 and x[-1] == 5.0


@pytest.mark.parametrize(
    ("change", "message"),
    [({"size": 1e-2}, "size"), ({"zone": (4.5, 4.99)}, "zone"), ({"zone": (0.1, -0.1)}, "zone")],
)
def test_bad_input(change, message):
    with pytest.raises(ValueError, match=message):
        track(**change)


def area(msh, tag):
    p = msh.points[msh.surface(tag)]
    normal = np.cross(p[:, 2] - p[:, 0], p[:, 3] - p[:, 1]) / 2
    return np.linalg.norm(normal, axis=1).sum()
