# SPDX-License-Identifier: LGPL-3.0-or-later
import numpy as np
import pytest

from meshes.axle import Axle
from meshes.placement import lateral_shift_for, placed
from meshes.profiles import s1002
from meshes.quality import quality, volumes
from meshes.tags import Tag
from meshes.wheelset import wheelset


@pytest.fixture(scope="module", params=[8e-3, 4e-3, pytest.param(2e-3, marks=pytest.mark.slow)])
def mesh(request):
    return request.param, wheelset(size=request.param, zone=(-0.05, 0.1))


def test_shape_and_volume(mesh):
    """Cells are valid and fill exactly what their surface encloses; no node is left over."""
    _, msh = mesh
    q = quality(msh)
    assert volumes(msh).min() > 0 and q.scaled_jacobian > 0.25
    assert q.volume == pytest.approx(q.enclosed, rel=1e-12)
    assert set(q.regions) == {"TYRE", "WEB", "HUB", "AXLE"}
    assert np.array_equal(np.unique(msh.cells), np.arange(q.nodes))


def test_mass(mesh):
    """Rim, web and hub weigh 345 kg at 7800 kg/m³; the axle is a stepped cylinder."""
    _, msh = mesh
    volume = volumes(msh)
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
    assert volumes(moved).sum() == pytest.approx(volumes(msh).sum())
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
