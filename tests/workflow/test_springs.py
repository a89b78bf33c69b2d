# SPDX-License-Identifier: LGPL-3.0-or-later
"""Springs of a scene between a surface and a point: closed form, ledger, resume, ranks."""

import shutil

import h5py
import numpy as np
import pytest

from workflow import Scene, run
from workflow.scene.scene import SceneError

STIFFNESS, SPEED, END = 1e6, 3.0, 1.2e-3
MASS = 7800 * 0.02 * 0.01**2
PULLED = {
    "mesh.length": 0.02,
    "mesh.width": 0.01,
    "mesh.size": 0.01,
    "bodies.bar.velocity": [0.0, 0.0, 0.0],
    "contacts": {},
    "springs": [
        {"surface": "xmax", "stiffness": [STIFFNESS, 0.0, 0.0], "velocity": [SPEED, 0.0, 0.0]}
    ],
    "time.end": END,
    "time.output_interval": 1e-5,
    "output.fields": False,
    "output.checkpoint_steps": 100,
}


def test_block_behind_a_moving_spring(tmp_path):
    """From rest ``x = V t − V sin(ω t)/ω``, to 0.2 % of V/ω; the puller's work closes the ledger.

    The block gives as a spring of 1e9 N/m does, and the mean of the pulled end leads its middle.
    """
    rows = []

    def watch(model):
        dofs = model.bodies.dofs("bar")
        m, u = model.mass.array[::3][dofs], model.state.u.x.array.reshape(-1, 3)[dofs, 0]
        rows.append((model.state.t, m @ u / m.sum()))

    history = run(Scene.load("bar-impact", **PULLED), tmp_path, watch=watch, quiet=True).history
    t, x = np.array(rows).T
    omega = np.sqrt(STIFFNESS / MASS)
    exact = SPEED * (t - np.sin(omega * t) / omega)
    np.testing.assert_allclose(x, exact, atol=2e-3 * SPEED / omega)
    assert np.abs(history["balance_error"]).max() < 1e-9
    power = STIFFNESS * SPEED**2 / omega**2 * (1 - np.cos(omega * END))  # ∫ k V²/ω sin ωt dt
    assert history["external_work"][-1] == pytest.approx(power, rel=5e-3)


def test_resumed_puller_is_the_same_bit_by_bit(tmp_path):
    """From a checkpoint between two outputs: place of the pulled end, its work and the motion."""
    scene, copy = Scene.load("bar-impact", **PULLED), tmp_path / "killed"

    def watch(model):
        if model.state.step == 350:
            shutil.copytree(tmp_path / "whole", copy)

    whole = run(scene, tmp_path / "whole", watch=watch, quiet=True).history
    resumed = run(scene, copy, quiet=True, resume=True).history
    for name, column in whole.items():
        np.testing.assert_array_equal(resumed[name], column, err_msg=name)


@pytest.mark.mpi
def test_two_ranks_pull_alike(squealx, tmp_path):
    """The history to 1e-9 of the work of some joules."""
    one = run(Scene.load("bar-impact", **PULLED), tmp_path / "one", quiet=True).history
    source = tmp_path / "one" / "scene.toml"
    squealx("run", source, "--ranks", 2, "--out", tmp_path / "two", timeout=120)
    with h5py.File(tmp_path / "two" / "results.h5") as file:
        for name, column in one.items():
            atol = 1e-9 * max(1, np.abs(column).max())
            np.testing.assert_allclose(file["history"][name], column, rtol=0, atol=atol)


def test_bad_springs_are_named():
    """Key, what it got, what it expects."""
    for change, message in (
        ({"surface": "roof"}, r"springs\.0\.surface = 'roof': expected one of"),
        ({"stiffness": [-1.0, 0.0, 0.0]}, r"springs\.0\.stiffness\.0 = -1\.0: expected .*\[N/m\]"),
    ):
        spring = PULLED["springs"][0] | change
        with pytest.raises(SceneError, match=message):
            Scene.load("bar-impact", **PULLED | {"springs": [spring]})
