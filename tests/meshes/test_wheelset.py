# SPDX-License-Identifier: LGPL-3.0-or-later
import numpy as np
import pytest
from scipy.spatial import cKDTree

from meshes.hexmesh import FACES, boundary
from meshes.profiles.measured import from_points
from meshes.profiles.placement import lateral_shift_for, placed
from meshes.profiles.profiles import s1002
from meshes.quality import cell_volumes, quality
from meshes.tags import Tag
from meshes.wheel_rail.axle import Axle
from meshes.wheel_rail.wheelset import wheelset


@pytest.fixture(scope="module", params=[8e-3, 4e-3, pytest.param(2e-3, marks=pytest.mark.slow)])
def mesh(request):
    return request.param, wheelset(size=request.param, zone=(-0.05, 0.1))


def test_shape_and_volume(mesh):
    """Cells are valid and fill exactly what their surface encloses; no node is left over."""
    _, msh = mesh
    q = quality(msh)
    assert cell_volumes(msh.points, msh.cells).min() > 0 and q.scaled_jacobian > 0.25
    assert q.volume == pytest.approx(q.enclosed, rel=1e-12)
    assert set(q.regions) == {"TYRE", "WEB", "HUB", "AXLE"}
    assert np.array_equal(np.unique(msh.cells), np.arange(q.nodes))


def test_mass(mesh):
    """Rim, web and hub weigh 345 kg at 7800 kg/m³; the axle is a stepped cylinder."""
    _, msh = mesh
    volume = cell_volumes(msh.points, msh.cells)
    axle = msh.regions == Tag.AXLE
    assert 7800 * volume[~axle].sum() == pytest.approx(345.4, rel=0.03)
    cones = (0.08**2 + 0.08 * 0.092 + 0.092**2, 0.065**2 + 0.065 * 0.092 + 0.092**2)
    exact = 0.600 * 0.08**2 + 0.180 * 0.092**2 + 0.240 * 0.065**2 + 0.040 * sum(cones) / 3
    assert volume[axle].sum() == pytest.approx(np.pi * exact, rel=0.02)


def test_tread(mesh):
    """Tread nodes lie on the profile: radius and lateral position agree with S1002."""
    _, msh = mesh
    wheel = s1002()
    x = msh.points[np.unique(msh.surface(Tag.TREAD))] - [0, 0.75, 0]
    radius = np.hypot(x[:, 0], x[:, 2]) - 0.46
    fine = wheel.at(np.arange(0, wheel.length, 2e-5))
    for k in range(0, len(x), len(x) // 50):
        assert np.hypot(*(fine - [x[k, 1], radius[k]]).T).min() < 2e-5
    assert radius.max() > 27.5e-3 and x[:, 1].max() == pytest.approx(0.065)


def test_fine_zone(mesh):
    """The zone is covered by facets of the wanted size, 8 or more edges round the flange root."""
    size, msh = mesh
    quads = msh.points[msh.surface(Tag.TREAD)] - [0, 0.75, 0]
    centre = quads.mean(axis=1)
    arc = 0.46 * np.arctan2(centre[:, 0], -centre[:, 2])
    zone = (arc > -0.05) & (arc < 0.1)
    lateral = zone & (centre[:, 1] > -0.039) & (centre[:, 1] < 0.008)
    edges = np.linalg.norm(quads - np.roll(quads, 1, axis=1), axis=2)
    assert edges[lateral].max() < 1.31 * size
    column = zone & (np.abs(arc - arc[lateral][np.abs(arc[lateral]).argmin()]) < 1e-4)
    root = column & (centre[:, 1] > -0.0385) & (centre[:, 1] < -0.026)
    assert root.sum() >= 8


def test_no_hanging_nodes(mesh):
    """Every facet belongs to one or two cells, every edge of the surface to two of its facets."""
    _, msh = mesh
    facets = np.sort(msh.cells[:, FACES].reshape(-1, 4), axis=1)
    assert np.unique(facets, axis=0, return_counts=True)[1].max() == 2
    skin = boundary(msh.cells)
    edges = np.sort(np.stack([skin, np.roll(skin, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()


def test_hub_keeps_its_own_spacing(mesh):
    """Arcs at the bore stay 10 to 30 mm long however fine the tread is."""
    _, msh = mesh
    hub = np.unique(msh.cells[msh.regions == Tag.HUB])
    x = msh.points[hub] - [0, 0.75, 0]
    bore = np.abs(np.hypot(x[:, 0], x[:, 2]) - 0.092) < 1e-6
    angles = np.unique(np.round(np.arctan2(x[bore, 0], -x[bore, 2]), 6))
    assert 0.010 < 0.092 * np.diff(angles).min() and 0.092 * np.diff(angles).max() < 0.030


def sampled(profile, wear=0.0, spacing=1e-3):
    """A profile as a measured one: points, and wear that hollows the tread."""
    points = profile.at(np.linspace(0, profile.length, round(profile.length / spacing)))
    hollow = wear * np.exp(-(((points[:, 0] - 0.005) / 0.02) ** 2)) * (points[:, 1] < 0.003)
    return from_points(points - np.column_stack([0 * hollow, hollow]), smoothing=2e-6)


def cone(slope):
    """A straight conical profile from -60 to 60 mm."""
    y = np.linspace(-0.06, 0.06, 25)
    return from_points(np.column_stack([y, -slope * y]))


PROFILES = {"cone": cone(0.05), "cylinder": cone(0.0), "points": sampled(s1002())}
PROFILES["hollow"] = sampled(s1002(), 2e-3)
PROFILES["narrow"] = sampled(s1002(chamfer=False))


@pytest.mark.parametrize("size", [8e-3, 4e-3, 2e-3])
@pytest.mark.parametrize("name", PROFILES)
def test_any_profile(name, size):
    """Valid cells without overlap; nodes of the tread on the profile; fine about the touch."""
    profile = PROFILES[name]
    touch = float(np.interp(-0.01, profile.points[:, 0], profile.s))
    msh = wheelset(size=size, zone=(-0.02, 0.05), profile=profile, touch=touch)
    q = quality(msh)
    assert cell_volumes(msh.points, msh.cells).min() > 0 and q.scaled_jacobian > 0.25
    assert q.volume == pytest.approx(q.enclosed, rel=1e-12)
    quads = msh.points[msh.surface(Tag.TREAD)] - [0, 0.75, 0]
    r = np.hypot(quads[..., 0], quads[..., 2])
    fine = cKDTree(profile.at(np.arange(0, profile.length, 2e-5)))
    drawn = np.stack([quads[..., 1], r - 0.46], axis=-1).reshape(-1, 2)
    assert fine.query(drawn)[0].max() < 2.1e-5
    centre = quads.mean(axis=1)
    arc = 0.46 * np.arctan2(centre[:, 0], -centre[:, 2])
    near = (np.abs(centre[:, 1] + 0.01) < 0.01) & (arc > -0.02) & (arc < 0.05)
    edges = np.linalg.norm(quads - np.roll(quads, 1, axis=1), axis=2)
    assert near.any() and edges[near].max() < 1.31 * size


@pytest.mark.parametrize(
    ("points", "message"),
    [
        ([[-0.02, 0.0], [0.0, 0.0], [0.01, 0.0], [0.02, 0.0]], "expected a rim from"),
        ([[-0.07, -0.06], [-0.02, -0.05], [0.02, -0.05], [0.065, -0.06]], "20 mm of rim"),
    ],
)
def test_bad_profile(points, message):
    with pytest.raises(ValueError, match=message):
        wheelset(size=8e-3, profile=from_points(np.array(points)))


def test_axle(mesh):
    """The half axle runs from the track centre to 1.1 m; its ends and journal are tagged."""
    _, msh = mesh
    ends = {Tag.AXLE_INNER: 0.0, Tag.AXLE_OUTER: 1.1}
    for tag, y in ends.items():
        assert msh.points[msh.surface(tag)][..., 1] == pytest.approx(y)
    journal = msh.points[np.unique(msh.surface(Tag.JOURNAL))]
    assert np.hypot(journal[:, 0], journal[:, 2]) == pytest.approx(0.065)
    assert journal[:, 1].min() == pytest.approx(0.86)


def test_placed_wheel():
    """In the track position the axle is yawed and the wheel's bottom runs ahead to the field."""
    p = lateral_shift_for(yaw=0.02)
    msh = wheelset(size=8e-3)
    moved = placed(msh, p)
    inner, outer = (
        moved.points[np.unique(moved.surface(tag))].mean(axis=0)
        for tag in (Tag.AXLE_INNER, Tag.AXLE_OUTER)
    )
    axle = (outer - inner) / np.linalg.norm(outer - inner)
    assert axle == pytest.approx([-np.sin(0.02), np.cos(0.02), 0.0], abs=1e-9)
    assert cell_volumes(moved.points, moved.cells).sum() == pytest.approx(
        cell_volumes(msh.points, msh.cells).sum()
    )
    tread = moved.points[np.unique(moved.surface(Tag.TREAD))]
    nearest = np.linalg.norm(tread - p.tread_point, axis=1).min()
    assert nearest < 8e-3


@pytest.mark.parametrize("design", ["A_straight_24_30", "B_thinner_web_20_26", "C_conical_web"])
def test_designs(design):
    q = quality(wheelset(size=8e-3, design=design))
    assert q.scaled_jacobian > 0.2 and q.volume == pytest.approx(q.enclosed, rel=1e-12)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"size": 1e-4}, "size"),
        ({"design": "E"}, "D_curved_web"),
        ({"zone": (-2.0, 2.0)}, "zone"),
        ({"axle": Axle(outer=0.8)}, "axle"),
        ({"radius": 0.40}, "radius"),
    ],
)
def test_bad_input(change, message):
    with pytest.raises(ValueError, match=message):
        wheelset(**change)
