# SPDX-License-Identifier: LGPL-3.0-or-later
"""The main scene, flange-transition: its physics up to two points of contact.

The wheelset drifts sideways at 80 km/h × sin(20 mrad) = 0.44 m/s until the flange root meets the
gauge corner, and one contact patch becomes two.
"""

import json

import h5py
import numpy as np
import pytest

from meshes.quality import cell_volumes
from meshes.tags import Tag
from workflow.results.record import RAIL, Record

GRAVITY, RHO = 9.81, 7800.0
SPEED = 22.222  # [m/s]
DRIFT = SPEED * np.sin(0.02)  # [m/s]


@pytest.fixture(scope="module")
def record(squealx, tmp_path_factory) -> Record:
    """The scene from a start next to the flange up to 1.5 ms: two minutes on one rank."""
    folder = tmp_path_factory.mktemp("flange") / "run"
    words = ("flange-transition", "--out", folder)
    words += ("--set", "time.end=1.5e-3", "--set", "mesh.flange_gap=4e-4")
    squealx("run", *words, timeout=1800)
    return Record(folder)


def footprint(record: Record, output: int) -> dict[str, np.ndarray]:
    with h5py.File(record.folder / "results.h5") as file:
        group = file[f"contact/wheel_rail/{output}"]
        return {name: data[:] for name, data in group.items()}


@pytest.mark.slow
def test_one_patch_becomes_two(record):
    """Rail top alone until 0.9 ms; from 1.2 ms the gauge corner too, under 60 to 76 degrees.

    The corner grows: it carries more than the rail top at the end.
    """
    contact = record.contacts["wheel_rail"]
    np.testing.assert_allclose(contact.t, 3e-4 * np.arange(6), atol=1e-9)
    assert [sorted(p) for p in contact.patches] == [[1]] * 4 + [[1, 2]] * 2
    angle = np.degrees(contact.series(2, "contact_angle")[contact.two_points])
    assert ((angle > 60) & (angle < 76)).all()
    load = contact.series(2, "normal_force")[contact.two_points]
    assert (np.diff(load) > 0).all()
    assert load[-1] > contact.series(1, "normal_force")[-1]
    assert (contact.series(1, "contact_angle") < np.radians(35)).all()


@pytest.mark.slow
def test_row_24_energy_of_the_main_scene(record):
    """Balance error below 1 % of the energy exchanged; friction and drive have done work."""
    history = record.history
    assert np.abs(history["balance_error"]).max() < 0.01
    assert (np.diff(history["friction_dissipation"]) >= 0).all()
    assert history["friction_dissipation"][-1] > 1.0 and history["external_work"][-1] > 1.0


@pytest.mark.slow
def test_row_26_patches_are_those_of_half_spaces(record):
    """Area and peak pressure of both patches, rolling and sliding in two points: within 15 %.

    Half-spaces of the drawn profiles as they stand, under the same force. 4 mm along and 0.6 mm
    across the rail: 4 and 5 % on the rail top, 7 and 4 % on the gauge corner, mean of two outputs.
    """
    summary = json.loads((record.folder / "summary.json").read_text("utf-8"))
    errors = {a["quantity"]: a["error"] for a in summary["expected"]}
    rolling = {name: e for name, e in errors.items() if " rolling" in name}
    of_patches = [e for name, e in rolling.items() if name.endswith((": area", ": peak pressure"))]
    assert len(of_patches) == 4 and np.abs(of_patches).max() < 0.15
    nodal = [e for name, e in rolling.items() if "nodal pressure" in name]
    assert len(nodal) == 2 and max(nodal) < 0.15


@pytest.mark.slow
def test_the_rail_carries_the_weight_at_the_start(record):
    """Vertical contact force = weight of wheelset and sprung mass: 0.1 % at rest, 5 % to 0.3 ms.

    The wheel climbs. Added mass at the bottom of the rim neither weighs nor pulls as it turns.
    """
    body = record.body
    assert body is not None
    rail = np.isin(body.regions, [int(t) for t in (*RAIL, Tag.SLEEPER)])
    steel = RHO * cell_volumes(body.points, body.cells)[~rail].sum()
    weight = GRAVITY * (steel + record.scene["vehicle"]["sprung_mass"])
    assert {Tag(t) for t in np.unique(body.regions[~rail])} == {
        *(Tag.TYRE, Tag.WEB, Tag.HUB, Tag.AXLE)
    }
    vertical = record.contacts["wheel_rail"].series(1, "vertical_force")
    assert vertical[0] == pytest.approx(weight, rel=1e-3)
    assert vertical[1] == pytest.approx(weight, rel=0.05)


@pytest.mark.slow
def test_no_creepage_at_the_start(record):
    """Travel lies in the wheel's plane: the mean slip velocity is small against the drift.

    Weighted by the normal force: its vector mean under 5 % and its mean size under 20 % of
    0.44 m/s; every node adheres.
    """
    start = footprint(record, 0)
    weight, slip = start["normal_force"], start["slip_velocity"]
    assert np.linalg.norm(weight @ slip) / weight.sum() < 0.05 * DRIFT
    assert weight @ np.linalg.norm(slip, axis=1) / weight.sum() < 0.2 * DRIFT
    assert start["stick"].all()


@pytest.mark.slow
def test_creepages_are_those_of_a_rigid_wheel(record):
    """Spin sin(contact angle)/r; difference of longitudinal creepage height/r: both to 10 %.

    Measured from the motion of the bodies round each patch: 0.5 to 4 % and 5 % off.
    """
    table = record.patches
    spin = -np.sin(table["contact_angle"]) / 0.46
    np.testing.assert_allclose(table["spin_creepage"], spin, rtol=0.1)
    assert (np.bincount(table["output"]) == [1, 1, 1, 1, 2, 2]).all()
    assert list(table["patch"]) == [0, 0, 0, 0, 0, 1, 0, 1]
    for k in (4, 5):
        at = table["output"] == k
        lower = np.ptp(table["centre"][at, 2])
        assert np.ptp(table["creepage"][at, 0]) == pytest.approx(lower / 0.46, rel=0.1)


@pytest.mark.slow
def test_cone_is_kept_in_every_output(record):
    """|F_t| ≤ 0.6 F_n at every node of every output, to round-off; some nodes slip at the end."""
    for k in range(6):
        nodes = footprint(record, k)
        size = np.linalg.norm(nodes["tangential_force"], axis=1)
        assert (size <= 0.6 * nodes["normal_force"] * (1 + 1e-12)).all()
    assert not nodes["stick"].all()
