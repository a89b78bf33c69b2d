# SPDX-License-Identifier: LGPL-3.0-or-later
"""Mass scaling: the step asked for, the mass it takes, and what does not change."""

import numpy as np
import pytest

from forms.loads import DeadLoad
from workflow import Scene, build, run
from workflow.scene import SceneError

COARSE = {"mesh.size": 1e-3, "output.fields": False}
STEP = 6e-8


def scaled(step=STEP, total=1.0, **more):
    return Scene.load("hertz", **COARSE, mass_scaling={"step": step, "total": total, **more})


def test_the_step_is_reached_with_little_more_mass_than_needed():
    """The assembled bound reaches the step; a step 8 % longer is not stable with that mass."""
    plain = build(Scene.load("hertz", **COARSE, **{"time.safety": 0.9}))
    scene = scaled(1.4 * plain.dt).with_(**{"time.safety": 0.9})
    model = build(scene)
    assert model.dt_bound >= 1.4 * plain.dt / 0.9 > plain.dt_bound
    assert model.dt_bound < 1.08 * 1.4 * plain.dt / 0.9
    assert model.added_mass.total == pytest.approx(
        model.mass.array[::3].sum() - plain.mass.array[::3].sum(), rel=1e-9
    )
    assert 0 < model.added_mass.total < 1.0
    assert sum(model.added_mass.regions.values()) == pytest.approx(model.added_mass.total)


def test_what_is_added_has_no_weight():
    gravity = {"gravity": [0.0, 0.0, -9.81]}
    plain, heavy = (
        build(Scene.load("hertz", **COARSE, **gravity)),
        build(scaled(**{}).with_(**gravity)),
    )
    loads = [next(i for i in m.items if isinstance(i, DeadLoad)).nodal for m in (plain, heavy)]
    np.testing.assert_array_equal(*loads)
    assert heavy.mass.array.sum() > plain.mass.array.sum()


def test_statics_do_not_feel_it_and_the_summary_tells(tmp_path):
    results = [
        run(scene, tmp_path / name, quiet=True)
        for name, scene in (("plain", Scene.load("hertz", **COARSE)), ("heavy", scaled()))
    ]
    forces = [r.history["touch_normal_force"][0] for r in results]
    assert forces[0] == pytest.approx(forces[1], rel=1e-4)
    assert results[0].summary["added_mass"] is None
    told = results[1].summary["added_mass"]
    assert told["total"] > 0 and set(told["bodies"]) == {"sphere", "flat"}
    assert told["largest_factor"] > 1


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        ({"total": 1e-9}, r"mass_scaling\.total = 1e-09 kg: a step of .* needs .* kg"),
        ({"total": 1.0, "per_region": 1e-9}, r"mass_scaling\.per_region = 1e-09 kg: .* in '"),
    ],
)
def test_more_than_allowed_is_refused(limits, message):
    with pytest.raises(SceneError, match=message):
        build(scaled(**limits))


def test_bad_keys():
    with pytest.raises(SceneError, match=r"mass_scaling\.step = -1\.0: expected"):
        scaled(-1.0)
    with pytest.raises(SceneError, match=r"mass_scaling\.total: missing"):
        Scene.load("hertz", mass_scaling={"step": 1e-7})


@pytest.mark.mpi
def test_two_ranks_add_as_much(tests_on):
    tests_on(2, __file__, "-k", "alike_on")


def test_alike_on_ranks():
    """The same mass on any number of ranks: that of this test's own ranks against one."""
    from mpi4py import MPI

    one, all_ = (build(scaled(), comm).added_mass for comm in (MPI.COMM_SELF, MPI.COMM_WORLD))
    assert all_.total == pytest.approx(one.total, rel=1e-6)
    assert all_.cells == one.cells
