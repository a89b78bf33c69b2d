# SPDX-License-Identifier: LGPL-3.0-or-later
"""Friction laws and their checks."""

import numpy as np
import pytest
from test_contact_pair import evaluate, plate_on_plane

from contact import LawState, coulomb, exponential, with_memory
from contact.friction import as_law, coefficients

STATE = LawState(0.0, 1e-6, np.arange(3), np.full(3, np.nan))


def test_laws():
    rate, pressure = np.array([0.0, 1.0, 1e3]), np.ones(3)
    assert coulomb(0.3)(rate, pressure, STATE) == pytest.approx([0.3] * 3)
    falling = exponential(0.5, 0.2, 1.0)(rate, pressure, STATE)
    assert falling == pytest.approx([0.5, 0.2 + 0.3 / np.e, 0.2])


def test_memory_law_does_not_depend_on_the_step():
    """A jump of slip rate: after slip s the coefficient is steady + jump * exp(-s / length)."""
    law = with_memory(exponential(0.5, 0.2, 1e-3), 1e-4)
    rate = np.ones(1)
    for steps in (10, 1000):
        friction = np.array([0.5])
        for _ in range(steps):
            friction = law(rate, rate, LawState(0.0, 1e-4 / steps, np.zeros(1, int), friction))
        assert friction == pytest.approx([0.2 + 0.3 / np.e], rel=1e-9)


def test_python_law_equals_constant_one():
    """A law written by the user gives the same forces as the built-in constant."""
    forces = []
    for friction in (0.3, lambda rate, pressure, state: np.full(rate.shape, 0.3)):
        _, pair, state = plate_on_plane(friction)
        state.v.x.array[0::3] = 1.0
        for _ in range(5):
            state.u.x.array[0::3] += 1e-6
            forces.append(evaluate(pair, state))
    assert (np.array(forces[:5]) == np.array(forces[5:])).all() and np.abs(
        forces[4][:, 0]
    ).max() > 0


def test_law_sees_slip_rate_pressure_and_history():
    seen = []

    def law(rate, pressure, state):
        seen.append((rate, pressure, state))
        return np.full(rate.shape, 0.1 * len(seen))

    plate, pair, state = plate_on_plane(law)
    state.v.x.array[1::3] = 2.0
    evaluate(pair, state)
    evaluate(pair, state)
    assert np.isnan(seen[0][2].friction).all() and seen[1][2].friction == pytest.approx(0.1)
    assert seen[1][0] == pytest.approx(np.full(25, 2.0))
    total = float((seen[1][1] * pair.area[:25]).sum())
    assert total == pytest.approx(pair.normal_force)
    assert (seen[1][2].node == plate.nodes).all()


@pytest.mark.parametrize("bad", [-0.1, np.nan, np.inf, "rough", None])
def test_bad_friction(bad):
    with pytest.raises(ValueError, match="friction"):
        as_law(bad)


@pytest.mark.parametrize("value", [-1.0, np.nan])
def test_bad_law_values(value):
    with pytest.raises(ValueError, match="expected finite values >= 0"):
        coefficients(lambda r, p, s: np.full(3, value), np.ones(3), np.ones(3), STATE)
    with pytest.raises(ValueError, match="expected shape"):
        coefficients(lambda r, p, s: np.ones(2), np.ones(3), np.ones(3), STATE)
