# SPDX-License-Identifier: LGPL-3.0-or-later
"""Mass scaling: the step asked for, the mass it takes, and what does not change."""

import re

from mpi4py import MPI

import numpy as np
import pytest
from dolfinx import fem, la
from scipy.spatial.transform import Rotation

from forms.loads import CarriedMass, DeadLoad
from meshes.domain import distribute
from meshes.shapes.blocks import block
from workflow import Scene, build, run
from workflow.model.state import State
from workflow.scene import SceneError
from workflow.simulation.stepping import central_difference, no_hold

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


def test_a_step_out_of_reach_is_refused_on_the_command_line(command, tmp_path):
    """Key, what it allows, what is needed; exit code 2, and no folder is left."""
    mass = ("--set", "mass_scaling.step=1e-7", "--set", "mass_scaling.total=1e-6")
    done = command(
        "run", "hertz", "--set", "mesh.size=1e-3", *mass, "--out", tmp_path / "run", check=False
    )
    said = done.stderr.strip().splitlines()[-1]
    assert done.returncode == 2 and not (tmp_path / "run").exists()
    needed = (
        r"squealx: mass_scaling\.total = 1e-06 kg: a step of 1e-07 s needs 0\.\d+ kg; expected a "
    )
    assert re.fullmatch(needed + r"shorter mass_scaling\.step or a higher limit", said)


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


def test_carried_mass_rolls_by_itself():
    """Free nodes that are all added mass follow a rolling rigid body; their energy balances.

    A third of a turn: the path is off by the step squared, the balance by round-off.
    """
    domain = distribute(block((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), cells=(2, 2, 2)), MPI.COMM_SELF)
    V, x = domain.V, domain.V.tabulate_dof_coordinates()
    spin, centre, velocity = np.array([[0.0, 60.0, 20.0], [0.5, 0.5, 0.3], [20.0, 0.0, 1.0]])
    mass = la.vector(V.dofmap.index_map, 3)
    mass.array[:] = np.repeat(np.linspace(1.0, 2.0, len(x)), 3)
    off = []
    for dt in (1e-4, 5e-5):
        state = State(fem.Function(V), fem.Function(V), la.vector(V.dofmap.index_map, 3))
        dofs = np.arange(len(x), dtype=np.int32)
        carried = CarriedMass(MPI.COMM_SELF, dofs, mass.array[::3].copy(), x)
        carried.spin, carried.centre, carried.velocity = spin, centre, velocity
        state.v.x.array[:] = (velocity + np.cross(spin, x - centre)).ravel()
        start = (mass.array * state.v.x.array**2).sum() / 2
        balance = []
        for s in central_difference(state, mass.petsc_vec, [carried.add], no_hold, dt, 0.03):
            before = s.v.x.array
            kinetic = (mass.array * before * (before + dt * s.a.array)).sum() / 2
            balance.append(kinetic - carried.work)
        assert np.ptp(balance) <= 1e-10 * start
        turn = Rotation.from_rotvec(spin * state.t).as_matrix()
        there = centre + velocity * state.t + (x - centre) @ turn.T
        off.append(np.abs(x + state.u.x.array.reshape(-1, 3) - there).max())
    assert off[0] < 1e-4 and off[0] / off[1] == pytest.approx(4, rel=0.05)


@pytest.mark.parametrize("speed", [0.0, 22.0])
def test_only_a_body_that_rolls_carries_mass(speed):
    """Added mass of the rolling wheelset is carried, that of the rail is not; none at rest."""
    model = build(Scene.load("two-patches", **{"mesh.size": 8e-3, "rolling.speed": speed}))
    carried = [item for item in model.items if isinstance(item, CarriedMass)]
    assert len(carried) == (speed > 0)
    for item in carried:
        added = model.added_mass
        assert item.mass.sum() == pytest.approx(added.bodies["wheelset"], rel=1e-9)
        assert 0 < item.mass.sum() < added.total
