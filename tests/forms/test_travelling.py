# SPDX-License-Identifier: LGPL-3.0-or-later
"""Travelling loads: total force, where it stands, and its work."""

from types import SimpleNamespace

from mpi4py import MPI

import numpy as np
import pytest

from forms.loads import smooth_step
from forms.travelling import TravellingLoad, surface_shares

A, SPEED, RAMP, UNTIL = 5e-3, 50.0, 4e-5, 4e-4


@pytest.fixture
def load():
    """A load on a strip of 40 mm by 1 mm of cells of 1 mm, its nodes in two rows."""
    x = np.linspace(-0.02, 0.02, 41)
    points = np.concatenate([np.column_stack([x, 0 * x + y, 0 * x]) for y in (0.0, 1e-3)])
    k = np.arange(40)
    quads = np.column_stack([k, k + 1, k + 42, k + 41])
    shares, at = surface_shares(points, quads)
    comm, dofs = MPI.COMM_SELF, np.arange(82, dtype=np.int32)
    traction = np.array([2e8, 0.0, -1e9])
    return points, TravellingLoad(
        comm, dofs, shares, at, traction, A, -0.01, SPEED, RAMP, UNTIL, dt=1e-6
    )


def motion(t=0.0):
    """A state at rest and an empty force."""
    at_rest = SimpleNamespace(x=SimpleNamespace(array=np.zeros(246)))
    return SimpleNamespace(t=t, v=at_rest), SimpleNamespace(array=np.zeros(246))


@pytest.mark.parametrize("t", [5e-5, 1e-4, 1.234e-4, 2e-4, 3e-4])
def test_total_and_place(load, t):
    """π/2 a times the largest traction and the width, to 0.5 %, in the middle x₀ + V t."""
    points, load = load
    state, force = motion(t)
    load.add(state, force)
    nodal = force.array.reshape(-1, 3)
    total = np.pi / 2 * A * 1e-3 * load.traction
    np.testing.assert_allclose(nodal.sum(axis=0), total, rtol=5e-3)
    middle = nodal[:, 2] @ points[:, 0] / nodal[:, 2].sum()
    assert middle == pytest.approx(-0.01 + SPEED * t, abs=1e-5)


@pytest.mark.parametrize(("t", "share"), [(0.0, 0.0), (2e-5, 0.5), (3.8e-4, 0.5), (4e-4, 0.0)])
def test_it_comes_and_goes(load, t, share):
    """Nothing at first and at last, half of it in the middle of either ramp."""
    _, load = load
    total = load.at(t).sum()
    assert total == pytest.approx(share * np.pi / 2 * A * 1e-3, rel=5e-3, abs=1e-12)
    assert smooth_step(-1.0) == 0.0 and smooth_step(2.0) == 1.0


def test_work_of_a_surface_that_sinks_evenly(load):
    """Sunk at a steady speed w while it comes, passes and goes: F w (until − ramp)."""
    _, load = load
    state, force = motion()
    state.v.x.array.reshape(-1, 3)[:, 2] = -3.0
    for step in range(401):
        state.t = step * load.dt
        load.add(state, force)
    full = np.pi / 2 * A * 1e-3 * 1e9
    assert load.energy(state)["external_work"] == pytest.approx(full * 3.0 * 3.6e-4, rel=3e-3)
