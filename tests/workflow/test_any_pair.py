# SPDX-License-Identifier: LGPL-3.0-or-later
"""Profiles of one's own through the whole chain: placed, meshed, brought to rest, rolled."""

import numpy as np
import pytest

from workflow import Scene, run
from workflow.model.geometry import mesh_of, placement_of
from workflow.model.supports import axle
from workflow.scene.scene import SceneError

RADIUS, CROWN, SLOPE = 0.46, 0.3, 1 / 20


@pytest.fixture
def files(tmp_path):
    """A 1:20 cone in m and a crown of 300 mm radius in mm, drawn downward."""
    y = np.linspace(-0.06, 0.06, 13)
    np.savetxt(tmp_path / "cone.csv", np.column_stack([y, -SLOPE * y]))
    y = np.linspace(-35, 35, 141)
    crown = np.column_stack([y, 300 - np.sqrt(300**2 - y**2)])
    np.savetxt(tmp_path / "crown.csv", crown, delimiter=",", header="y,z", comments="")
    names = {"wheel_profile": "cone.csv", "rail_profile": "crown.csv"}
    return {f"mesh.{key}": str(tmp_path / name) for key, name in names.items()}


def test_cone_stands_where_the_slopes_agree(files):
    """Slope of the cone's outline β; a lean of 1:40 moves the contact by 300 mm atan(1/40)."""
    scene = Scene.load("flange-transition").with_(**files, **{"mesh.lateral_shift": 0.004})
    p = placement_of(scene)
    yaw = scene.rolling.angle_of_attack
    beta = np.arctan(SLOPE / np.cos(yaw) / np.sqrt(1 - (SLOPE * np.tan(yaw)) ** 2))
    upright = placement_of(scene.with_(**{"mesh.inclination": 0.0}))
    assert p.centre[1] == pytest.approx(0.754) and p.flange_gap is None
    assert p.tread_angle == pytest.approx(beta, abs=1e-6)
    # the normal of the rail is the same, so the lean moves the contact along the crown
    moved = p.tread_rail_s - upright.tread_rail_s
    assert moved == pytest.approx(CROWN * np.arctan(1 / 40), abs=2e-5)


def test_rolled_wheelset(files):
    """``mesh.roll`` is the rise of the axle to the field side: of placement, mesh and supports.

    The contact angle of a cone grows by it; the axle, a body of revolution, has its axis there.
    """
    change = {"mesh.lateral_shift": 0.0, "mesh.size": 8e-3, "rolling.angle_of_attack": 0.0}
    scene = Scene.load("flange-transition").with_(**files, **change, **{"mesh.roll": 0.03})
    rise = np.array([0.0, np.cos(0.03), np.sin(0.03)])
    mesh, p = mesh_of(scene)
    assert p.tread_angle == pytest.approx(np.arctan(SLOPE) + 0.03, abs=1e-6)
    nodes = mesh.points[np.unique(mesh.cells[mesh.regions == mesh.tag("axle")])]
    found = np.linalg.svd(nodes - nodes.mean(axis=0), full_matrices=False)[2][0]
    np.testing.assert_allclose(found / np.sign(found[1]), rise, atol=1e-3)
    np.testing.assert_allclose(axle(scene), rise, atol=1e-15)
    main = Scene.load("flange-transition", **{"mesh.roll": 0.003})
    flange = placement_of(main)
    assert flange.roll == 0.003
    assert flange.flange_gap == pytest.approx(main.mesh.flange_gap, abs=1e-8)


@pytest.mark.slow
def test_cone_rolls_on_the_crown(files, tmp_path):
    """At rest the crown carries the wheelset's share; it rolls on as one patch at 1:20."""
    changes = {"mesh.size": 8e-3, "equilibrium.shift": 0.0, "time.end": 1e-5}
    changes |= {"time.output_interval": 5e-6, "output.fields": False}
    result = run(Scene.load("flange-transition").with_(**files, **changes), tmp_path / "run")
    pair = result.summary["contacts"]["wheel_rail"]
    assert result.summary["status"] == "done" and pair["patches"] == 1
    # the sprung mass and most of the wheelset of 500 kg
    assert pair["normal_force"] == pytest.approx(8400 * 9.81, rel=0.05)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"mesh.wheel_profile": "54E1"},
            "mesh.wheel_profile = '54E1': .*S1002 or a file of points",
        ),
        (
            {"mesh.rail_profile": "none.csv"},
            "mesh.rail_profile = 'none.csv': .*54E1, 60E1 or a file of points",
        ),
        ({"mesh.lateral_shift": 0.2}, r"mesh\.lateral_shift = 0\.2 with .*not above the rail"),
        ({"mesh.flange_gap": 0.05}, r"mesh\.flange_gap = 0\.05 with .*expected"),
        ({"mesh.rail_base": "49E1"}, "mesh.rail_base"),
        ({"mesh.roll": 0.5}, r"mesh\.roll = 0\.5: expected less than or equal to 0\.2 \[rad\]"),
        ({"mesh.profile_smoothing": -1.0}, "mesh.profile_smoothing"),
    ],
)
def test_bad_input(change, message):
    with pytest.raises(SceneError, match=message):
        placement_of(Scene.load("flange-transition").with_(**change))
