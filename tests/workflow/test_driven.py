# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bodies driven by a surface: rigid motion, shift, work in the ledger, refusals, two ranks."""

import json

from mpi4py import MPI

import h5py
import numpy as np
import pytest
import tomli_w

from workflow import Scene, run
from workflow.model.model import Model, build
from workflow.scene.scene import SceneError
from workflow.simulation.initial import start

STEEL = {"youngs_modulus": 210e9, "poisson_ratio": 0.3, "density": 7800.0}
SMALL = {
    "name": "small",
    "title": "A short roller on a block",
    "mesh": {
        "kind": "curved-on-curved",
        "rolls": True,
        "radius": 0.1,
        "size": 0.001,
        "base_size": 0.0012,
        "growth": 1.5,
        "x": [-0.012, 0.012],
        "fine_x": [-0.004, 0.004],
        "y": [0.0, 0.001],
        "layers": 1,
        "height": 0.01,
        "depth": 0.01,
    },
    "bodies": {
        "roller": {"regions": ["roller"], "material": STEEL, "kinematics": "total-lagrangian"},
        "block": {"regions": ["base"], "material": STEEL},
    },
    "contacts": {
        "touch": {"contactor": "cap", "target": "base_top", "friction": 0.3, "penalty": 0.67}
    },
    "driven": {
        "roller": {
            "surface": "zmax",
            "spin": [0.0, 202.0, 0.0],
            "centre": [0.0, 0.0, 0.1],
            "steady_start": True,
        },
        "block": {"surface": "base_bottom", "velocity": [-20.0, 0.0, 0.0], "steady_start": True},
    },
    "supports": [
        {"surface": "ymin", "directions": ["y"]},
        {"surface": "ymax", "directions": ["y"]},
    ],
    "equilibrium": {"approach": {"roller": [0.0, 0.0, -1.5e-5]}, "tolerance": 1e-10},
    "time": {"end": 4e-5, "output_interval": 4e-6, "safety": 0.4},
    "output": {"fields": False},
}


def test_rolling_keeps_to_the_rigid_motion_and_balances(tmp_path):
    """Bore on its circle and bottom on its way to 1e-12 m; ledger to 1e-4, with slip and work."""
    kept: list[Model] = []
    history = run(
        Scene.check(SMALL), tmp_path, watch=lambda m: kept or kept.append(m), quiet=True
    ).history
    model, t = kept[0], kept[0].state.t
    u, X = model.state.u.x.array.reshape(-1, 3), model.domain.V.tabulate_dof_coordinates()
    bore, bottom = (carried.dofs for carried in model.hold.carried)
    np.testing.assert_allclose(u[bottom], np.tile([-20.0 * t, 0, 0], (len(bottom), 1)), atol=1e-12)
    angle, arm = 202.0 * t, X[bore] - [0, 0, 0.1]
    turned = np.column_stack(
        [
            arm[:, 0] * np.cos(angle) + arm[:, 2] * np.sin(angle),
            arm[:, 1],
            arm[:, 2] * np.cos(angle) - arm[:, 0] * np.sin(angle),
        ]
    )
    np.testing.assert_allclose(u[bore], turned - arm + [0, 0, -1.5e-5], atol=1e-12)
    assert np.abs(history["balance_error"]).max() < 1e-4
    assert history["friction_dissipation"][-1] > 0
    assert history["external_work"][-1] > history["friction_dissipation"][-1]


def test_steady_start_lets_the_material_flow_through_the_pattern():
    """Below the contact the block moves with V ∂u/∂x on top of V, to 15 % of the largest.

    The flow is a lumped mean over the cells of a node, the slope that of the nodal displacements
    along a row of nodes in the middle of its depth, in the uniform zone.
    """
    model = build(Scene.check(SMALL), MPI.COMM_SELF)
    start(model, lambda line: None)
    X, dofs = model.domain.V.tabulate_dof_coordinates(), model.bodies.dofs("block")
    row = dofs[(np.abs(X[dofs, 1]) < 1e-9) & (np.abs(X[dofs, 0]) < 0.0041)]
    depths = np.unique(X[row, 2].round(9))
    row = row[np.isclose(X[row, 2], depths[len(depths) // 2])]
    row = row[np.argsort(X[row, 0])]
    x, u = X[row, 0], model.state.u.x.array.reshape(-1, 3)[row]
    v = model.state.v.x.array.reshape(-1, 3)[row]
    for axis in (0, 2):
        slope = np.gradient(u[:, axis], x)
        flow = v[:, axis] - (-20.0 if axis == 0 else 0.0)
        assert np.abs(flow).max() > 1e-4
        np.testing.assert_allclose(flow[1:-1], -20.0 * slope[1:-1], atol=0.15 * np.abs(flow).max())


def test_shift_ends_at_rest(tmp_path):
    """A shift of 1 um without spin: the surface is there to 1e-12 m, with no speed, and stays."""
    changes = {
        "driven.roller": {"surface": "zmax", "shift": [1e-6, 0.0, 0.0], "shift_time": 2e-5},
        "driven.block": {"surface": "base_bottom"},
    }
    kept: list[Model] = []
    seen: list[float] = []

    def watch(model: Model) -> None:
        kept[:] = [model]
        bore = model.hold.carried[0].dofs
        seen.append(model.state.u.x.array.reshape(-1, 3)[bore, 0].mean())

    history = run(Scene.check(SMALL).with_(**changes), tmp_path, watch=watch, quiet=True).history
    model = kept[0]
    bore = model.hold.carried[0].dofs
    u, v = (f.x.array.reshape(-1, 3)[bore] for f in (model.state.u, model.state.v))
    np.testing.assert_allclose(u, np.tile([1e-6, 0, -1.5e-5], (len(bore), 1)), atol=1e-9)
    assert np.abs(v).max() < 1e-5
    half = np.interp(0.5, np.linspace(0, 2, len(seen)), seen)
    assert half == pytest.approx(0.5e-6, rel=0.01)
    assert np.abs(history["balance_error"]).max() < 1e-4


def test_pressed_together_without_a_load():
    """The static solve takes the approach as its load: forces of the two bodies are opposite."""
    model = build(Scene.check(SMALL), MPI.COMM_SELF)
    lines: list[str] = []
    start(model, lines.append)
    assert "residual" in lines[-1] and model.pairs["touch"].normal_force > 0


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("driven.wheel", {"surface": "zmax"}, "driven.wheel"),
        ("driven.roller.surface", "bore", "driven.roller.surface"),
        ("driven.roller.shift", [1e-6, 0.0, 0.0], "shift_time"),
        ("mesh.radius", None, "mesh.radius"),
        ("mesh.fine_y", [0.0, 0.001], "fine_y"),
    ],
)
def test_refusals_name_the_key(key, value, words):
    with pytest.raises(SceneError, match=words):
        Scene.check(SMALL).with_(**{key: value})


@pytest.mark.mpi
def test_two_ranks_give_the_same(command, tmp_path):
    """Every column of the history to 1e-9 of its size."""
    path, found = tmp_path / "small.toml", []
    path.write_text(tomli_w.dumps(SMALL))
    for ranks in (1, 2):
        out = tmp_path / str(ranks)
        done = command("run", path, "--json", "--ranks", ranks, "--out", out)
        assert json.loads(done.stdout)["status"] == "done"
        with h5py.File(out / "results.h5") as file:
            found.append({name: data[:] for name, data in file["history"].items()})
    one, two = found
    scale = one["touch_normal_force"].max()
    for name, values in one.items():
        size = scale if name.endswith("force") else max(np.abs(values).max(), 1e-12)
        if name.endswith("error"):
            size = 1.0
        np.testing.assert_allclose(two[name], values, rtol=0, atol=1e-9 * size, err_msg=name)
