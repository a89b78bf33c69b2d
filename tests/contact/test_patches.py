# SPDX-License-Identifier: LGPL-3.0-or-later
"""Patches: parted at valleys of pressure, followed from output to output, their creepages."""

from types import SimpleNamespace

import h5py
import numpy as np
import pytest

from contact.creepage import Creepage, creepage_of, rigid_motion
from contact.footprint import footprint_of, frame_of
from contact.patches import Tracker, beside, parted
from tests.skins import skin
from workflow import Scene, run
from workflow.results.patches import COLUMNS, t_gamma, travel


def discs(*parts, size=2e-3, seed=0, merged=()):
    """A footprint of discs (x, y, radius) on a mesh that lies anew each time."""
    rng = np.random.default_rng(seed)
    points, label = [], []
    for k, (x, y, radius) in enumerate(parts):
        n = int(radius / size) + 2
        grid = size * np.mgrid[-n : n + 1, -n : n + 1].reshape(2, -1).T
        grid = grid + rng.uniform(-size / 2, size / 2, 2)
        grid = grid[np.linalg.norm(grid, axis=1) < radius] + (x, y)
        points.append(np.column_stack([grid, np.zeros(len(grid))]))
        label.append(np.full(len(grid), dict(merged).get(k, k)))
    position, patch = np.vstack(points), np.unique(np.concatenate(label), return_inverse=True)[1]
    one = np.ones(len(patch))
    up = np.tile([0.0, 0.0, 1.0], (len(patch), 1))
    foot = footprint_of(np.arange(len(patch)), position, up, one, 0 * up, size**2 * one, 0 * up,
                        0.3 * one, 0 * one, patch, 0.05)  # fmt: skip
    return foot


def identity_at(foot, ids, x, y):
    """Identity of the patch of the node nearest to a place."""
    k = np.argmin(np.linalg.norm(foot.position[:, :2] - (x, y), axis=1))
    return int(ids[foot.patch[k]])


@pytest.mark.parametrize(("bridge", "patches"), [(0.5, 2), (1.9, 1)])
def test_weak_bridge_does_not_join_two_peaks(bridge, patches):
    """Peaks 5 and 3 in a row of nodes: apart below a third of the lower one, else together."""
    pressure = np.array([2.0, 5.0, 4.0, bridge, 2.0, 3.0, 2.0])
    around = [{k - 1, k + 1} & set(range(7)) for k in range(7)]
    patch = parted(pressure, around)
    assert len(set(patch)) == patches
    assert len(set(patch[:3])) == 1 and len(set(patch[4:])) == 1
    assert len(set(parted(pressure, [set()] * 7))) == 7


def test_faint_peak_at_the_fringe_is_no_patch():
    """A peak under a twentieth of its neighbour is joined to it, unless nothing lies between."""
    pressure = np.array([9.0, 1.0, 0.05, 0.4])
    line = [{1}, {0, 2}, {1, 3}, {2}]
    assert len(set(parted(pressure, line))) == 1
    assert len(set(parted(pressure, [{1}, {0}, {3}, {2}]))) == 2
    assert parted(np.zeros(0), []).shape == (0,)


def test_neighbours_are_nodes_of_one_facet():
    """On a grid of 4 x 3 quads: 8 round an inner node, and only those that touch."""
    grid = skin(4, 3, 1.0, 1.0, lambda x, y: 0 * x, up=False)
    every = np.arange(20)
    around = beside(grid.facets, every, 20)
    for k in every:
        near = np.abs(grid.reference - grid.reference[k])
        want = (near[:, 0] < 0.3) & (near[:, 1] < 0.4) & (every != k)
        np.testing.assert_array_equal(around[k], np.flatnonzero(want))
    some = np.array([0, 1, 5, 19])
    assert [list(a) for a in beside(grid.facets, some, 20)] == [[1, 2], [0, 2], [0, 1], []]


@pytest.mark.parametrize("step", [1e-3, 7e-3, 18e-3])
def test_patch_is_the_same_however_far_it_rolls(step):
    """Ways of a tenth to twice the length of the patch between outputs, the mesh ever another."""
    tracker = Tracker()
    for k in range(10):
        foot = discs((k * step, 0.0, 5e-3), seed=k)
        ids, events = tracker.follow(1e-3 * k, foot)
        assert list(ids) == [0]
        assert [e.kind for e in events] == (["birth"] if k == 0 else [])


@pytest.mark.parametrize("step", [2e-3, 7e-3])
def test_flange_transition_in_small(step):
    """Birth of a corner patch ahead, both roll, the first shrinks and ends: two identities."""
    tracker, kinds = Tracker(), []
    for k in range(12):
        parts = []
        if k < 8:
            parts.append((k * step, 0.0, 5e-3 - 3e-4 * k))
        if k >= 4:
            parts.append((k * step + 12e-3, -9e-3, 2e-3 + 4e-4 * k))
        foot = discs(*parts, seed=k)
        ids, events = tracker.follow(1e-3 * k, foot)
        kinds += [(k, e.kind, e.patch, e.other) for e in events]
        if k < 8:
            assert identity_at(foot, ids, k * step, 0.0) == 0
        if k >= 4:
            assert identity_at(foot, ids, k * step + 12e-3, -9e-3) == 1
    assert kinds == [(0, "birth", 0, -1), (4, "birth", 1, -1), (8, "end", 0, -1)]


def test_split_and_merge():
    """Two lobes that were one: the larger keeps the number; together again: it keeps it still."""
    tracker = Tracker()
    lobes = ((0.0, 0.0, 6e-3), (0.0, 11e-3, 4e-3))
    whole = discs(*lobes, merged=((1, 0),))
    assert len(whole.patches) == 1
    assert list(tracker.follow(0.0, whole)[0]) == [0]
    apart = discs(*lobes, seed=1)
    ids, events = tracker.follow(1.0, apart)
    assert identity_at(apart, ids, 0, 0) == 0 and identity_at(apart, ids, 0, 11e-3) == 1
    assert [(e.kind, e.patch, e.other) for e in events] == [("split", 1, 0)]
    ids, events = tracker.follow(2.0, discs(*lobes, seed=2, merged=((1, 0),)))
    assert list(ids) == [0] and [(e.kind, e.patch, e.other) for e in events] == [("merge", 1, 0)]
    # a number is never given twice
    ids, events = tracker.follow(3.0, discs(*lobes, seed=3))
    assert sorted(ids) == [0, 2]


def test_nothing_touches_for_a_while():
    tracker = Tracker()
    none = SimpleNamespace(position=np.zeros((0, 3)), area=np.zeros(0), patches=(),
                           patch=np.zeros(0, dtype=np.int64))  # fmt: skip
    assert tracker.follow(0.0, none)[1] == []
    assert list(tracker.follow(1.0, discs((0, 0, 4e-3)))[0]) == [0]
    ids, events = tracker.follow(2.0, none)
    assert len(ids) == 0 and [e.kind for e in events] == ["end"]
    assert list(tracker.follow(3.0, discs((0, 0, 4e-3)))[0]) == [1]


def test_frame_of_a_patch():
    """Right-handed; x of the track where it can be; on the gauge corner lateral is upwards."""
    for normal in np.random.default_rng(0).normal(size=(20, 3)):
        frame = frame_of(normal / np.linalg.norm(normal))
        np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-14)
        assert np.linalg.det(frame) == pytest.approx(1.0)
    np.testing.assert_allclose(frame_of(np.array([0.0, 0, 1])), np.eye(3))
    corner = frame_of(np.array([0.0, -np.sin(1.2), np.cos(1.2)]))
    np.testing.assert_allclose(corner[:2], [[1, 0, 0], [0, np.cos(1.2), np.sin(1.2)]], atol=1e-15)
    np.testing.assert_allclose(frame_of(np.array([1.0, 0, 0]))[0], [0, 1, 0])


def test_rigid_motion_is_found_exactly():
    rng = np.random.default_rng(1)
    points, about = rng.normal(size=(30, 3)), rng.normal(size=3)
    v, spin = rng.normal(size=3), rng.normal(size=3)
    for flat in (points, points * [1, 1, 0]):
        found = rigid_motion(flat, v + np.cross(spin, flat - about), about)
        np.testing.assert_allclose(found.velocity, v, atol=1e-12)
        np.testing.assert_allclose(found.spin, spin, atol=1e-12)


def wheel_nodes(radius, half, size):
    """Nodes of a cone-shaped tread round the lowest point of a wheel, origin at that point."""
    theta, y = np.meshgrid(np.arange(-half, half, size) / radius, np.arange(-half, half, size))
    theta, y = theta.ravel(), y.ravel()
    return np.column_stack([radius * np.sin(theta), y, radius * (1 - np.cos(theta))])


def test_creepages_of_a_wheel():
    """V = 20, r = 0.46, 0.2 % over-speed, 3 mrad of yaw, 20 degrees of slope: ξ, η, φ to 1e-12.

    The elastic velocities of rolling, V du/dx of a point load on a half-space, are put on top:
    they leave the creepages within 2 % of what they are in the patch.
    """
    speed, radius, yaw, slope = 20.0, 0.46, 3e-3, np.radians(20.0)
    turn = 1.002 * speed / radius
    points = wheel_nodes(radius, 0.06, 2.5e-3)
    centre = np.array([0.0, 0.0, radius])
    axle = np.array([-np.sin(yaw), np.cos(yaw), 0.0])
    velocity = np.array([speed, 0, 0]) + np.cross(turn * axle, points - centre)
    normal = np.array([0.0, -np.sin(slope), np.cos(slope)])
    patch = SimpleNamespace(area=np.pi * 5e-3**2, centre=np.zeros(3), frame=frame_of(normal))
    rail = np.column_stack([*np.mgrid[-0.06:0.06:2.5e-3, -0.06:0.06:2.5e-3].reshape(2, -1)])
    still = np.column_stack([rail, np.zeros((len(rail), 4))])
    way = np.array([speed, 0.0, 0.0])
    found = creepage_of(patch, np.hstack([points, velocity]), still, way)
    slip = way + np.cross(turn * axle, -centre)
    rolling = np.linalg.norm(way - slip / 2)
    assert found.speed == pytest.approx(rolling, rel=1e-12)
    assert found.longitudinal == pytest.approx(slip[0] / rolling, rel=1e-10)
    assert found.lateral == pytest.approx(slip[1] * np.cos(slope) / rolling, rel=1e-10)
    assert found.spin == pytest.approx(turn * axle @ normal / rolling, rel=1e-12)
    assert found.longitudinal == pytest.approx(-0.002, rel=5e-3)
    assert found.spin == pytest.approx(-np.sin(slope) / radius, rel=4e-3)

    load, shear, nu = 80e9, 10e3, 0.3  # N/m2 of shear modulus, N
    x, y = points[:, 0], points[:, 1]
    r = np.maximum(np.hypot(x, y), 5e-3)
    scale = shear / (2 * np.pi * load)
    dudx = scale * (-(1 - nu) * x / r**3 + nu * (2 * x / r**3 - 3 * x**3 / r**5))
    elastic = velocity + speed * np.outer(dudx, [1.0, 0, 0])
    inside = speed * np.abs(dudx).max()
    disturbed = creepage_of(patch, np.hstack([points, elastic]), still, way)
    assert inside > 2e-4 * speed
    assert np.abs(disturbed.slip - found.slip).max() < 0.02 * inside
    assert np.isnan(creepage_of(patch, still, still, None).longitudinal)


def test_t_gamma_is_the_heat_of_a_way():
    """A patch in full slip, rigid bodies with creepages and spin: power is V (Tγ + M φ), exactly.

    The shear opposes the slip ``s + ω n × r`` at each node and is friction times pressure.
    """
    foot = discs((0.01, -0.02, 0.012), seed=3)
    slip, spin, speed = np.array([-0.3, 0.2, 0.0]), 9.0, 25.0
    centre = foot.position.mean(axis=0)
    local = slip + np.cross([0.0, 0.0, spin], foot.position - centre)
    shear = -0.3 * local / np.linalg.norm(local, axis=1)[:, None]
    (patch,) = footprint_of(
        foot.node, foot.position, foot.normal, foot.normal_force, shear, foot.area, local,
        foot.friction, -np.einsum("ia,ia->i", shear, local), foot.patch, 0.05,
    ).patches  # fmt: skip
    motion = Creepage(patch.frame[:2] @ slip, spin, speed)
    of_spin = COLUMNS["spin_t_gamma"].value(patch, motion)
    assert 0 < of_spin < COLUMNS["t_gamma"].value(patch, motion)
    assert patch.friction_power == pytest.approx(0.3 * np.linalg.norm(local, axis=1).sum())
    assert speed * (t_gamma(patch, motion) + of_spin) == pytest.approx(patch.friction_power)


def test_table_of_patches(tmp_path):
    """One row a patch and output; units and words beside each column; nodes carry the identity."""
    scene = Scene.load("sliding-block", **{"output.fields": False, "time.end": 5e-6})
    result = run(scene, tmp_path / "run", quiet=True)
    history = result.history
    assert travel(scene) is None
    with h5py.File(result.folder / "results.h5") as file:
        table = file["patches/face"]
        assert set(table) == {"output", "t", "patch", "events", *COLUMNS}
        assert all(table[k].attrs["units"] and table[k].attrs["about"] for k in COLUMNS)
        np.testing.assert_array_equal(table["output"], np.arange(6))
        np.testing.assert_array_equal(table["patch"], 0)
        np.testing.assert_allclose(table["normal_force"], history["face_normal_force"])
        along = history["face_tangential_x_force"]
        np.testing.assert_allclose(table["force_in_frame"][:, 0], along, rtol=1e-3)
        np.testing.assert_allclose(table["shear_stress"][:, 0], along / 4e-4, rtol=1e-3)
        np.testing.assert_allclose(table["mean_shear"], np.abs(along) / 4e-4, rtol=1e-3)
        np.testing.assert_allclose(np.abs(table["shear_angle"]), np.pi, atol=0.02)
        assert table["rigid_slip"][0] == pytest.approx([2.0, 0.0], abs=1e-9)
        assert np.isnan(table["creepage"][:]).all()  # nothing rolls
        assert [table["events"][k][0] for k in ("t", "patch", "other", "kind")] == [
            0.0, 0, -1, b"birth",
        ]  # fmt: skip
        for k in range(6):
            assert (file[f"contact/face/{k}/patch"][:] == 0).all()


def test_travel_of_the_main_scene():
    """The contact travels with the axle, in the wheel's own plane."""
    scene = Scene.load("flange-transition")
    assert travel(scene) == pytest.approx(22.222 * np.array([np.cos(0.02), np.sin(0.02), 0]))


LAW = {"law": "exponential", "static": 0.5, "kinetic": 0.2, "decay": 0.5}
LAW["memory"] = {"length": 2e-6}


@pytest.mark.mpi
def test_patches_and_laws_are_the_same_on_two_ranks(squealx, tmp_path):
    """Every column of the table, with friction that has a memory: to 1e-9 of its largest value."""
    keys = {"output.fields": False, "time.end": 2e-5, "contacts.face.friction": LAW}
    run(Scene.load("sliding-block", **keys), tmp_path / "1", quiet=True)
    squealx("run", tmp_path / "1" / "scene.toml", "--ranks", 2, "--out", tmp_path / "2")
    files = [h5py.File(tmp_path / f"{ranks}" / "results.h5", "r") for ranks in (1, 2)]
    one, two = (file["patches/face"] for file in files)
    for name in {*COLUMNS, "output", "t", "patch"} - {"rolling_speed", "creepage", "spin_creepage"}:
        scale = max(np.abs(one[name][:]).max(), 1e-3)
        np.testing.assert_allclose(two[name], one[name], atol=1e-9 * scale, rtol=0, err_msg=name)
    for file in files:
        file.close()
