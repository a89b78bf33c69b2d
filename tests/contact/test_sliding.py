# SPDX-License-Identifier: LGPL-3.0-or-later
"""Small motions of sliding contacts: against the kernel's own forces, and laws of friction."""

import numpy as np
import pytest

from contact.friction import coulomb, exponential, with_memory
from contact.sliding import sliding, slopes
from contact.tangent import relative_rows
from tests.skins import evaluate, plate_on_plane

DT, SPEED = 1e-6, 3.0  # of plate_on_plane; m/s
FRICTION, DECAY = 0.3, 2.0


def slid(law, w, du, steps=200, **options):
    """Forces of the stepping on a plate that slides along ``w`` from a displacement ``du``."""
    plate, pair, state = plate_on_plane(law, **options)
    state.v.x.array[:] = np.tile(w, len(plate.nodes))
    state.u.x.array[:] = du
    for _ in range(steps):
        force = evaluate(pair, state)
        state.u.x.array[:] += DT * state.v.x.array
        state.t += DT
    return force.ravel()


@pytest.mark.parametrize("options", [{}, {"points": "quadrature"}])
def test_tangent_is_that_of_the_stepping(options):
    """A plate that slides on a plane with falling friction is displaced, then slides otherwise.

    What its forces change by in the stepping is ``-K δu`` and ``-C δv`` of the sliding state.
    """
    law = exponential(0.5, 0.2, DECAY)
    w = np.array([SPEED * np.cos(0.3), SPEED * np.sin(0.3), 0.0])
    plate, pair, state = plate_on_plane(law, **options)
    state.v.x.array[:] = np.tile(w, len(plate.nodes))
    on = sliding(pair.passes[0], state, 0.0)
    nodes = np.sort(plate.nodes)
    assert np.array_equal(nodes, plate.nodes)
    n, t, b = (
        relative_rows(on.nodes, on.weight, d, nodes) for d in (on.normal, on.along, on.across)
    )
    rng, size = np.random.default_rng(1), 3 * len(nodes)
    du, dv = np.zeros((size // 3, 3)), 1e-4 * SPEED * np.array([0.5, -0.8, 0.0])
    du[:, 2] = 1e-9 * rng.standard_normal(size // 3)
    before = slid(law, w, np.zeros(size), **options)
    moved = slid(law, w, du.ravel(), **options) - before
    K = n.T @ (on.stiffness * (n @ du.ravel())) - t.T @ (
        on.steepness * on.stiffness * (n @ du.ravel())
    )
    assert moved == pytest.approx(-K, abs=1e-6 * np.abs(K).max())
    v = np.tile(dv, len(nodes))
    turned = slid(law, w + dv, np.zeros(size), **options) - before
    C = t.T @ (on.normal_force * on.slope * (t @ v)) + b.T @ (on.turning * (b @ v))
    assert turned == pytest.approx(-C, abs=1e-3 * np.abs(C).max())


def test_slopes_of_a_law():
    """``f = k + (s - k) exp(-v / d)``: slope ``-(s - k) / d exp(-v / d)``; memory changes none.

    A law that falls with the pressure as ``f = a / p`` bears a force that does not depend on it.
    """
    v, p = np.array([0.5, 2.0]), np.array([10.0, 30.0])
    law = exponential(0.5, 0.2, DECAY)
    for one in (law, with_memory(law, 1e-3)):
        f, steep, slope = slopes(one, v, p, np.full(2, 1e-4), np.arange(2), 0.0)
        assert f == pytest.approx(0.2 + 0.3 * np.exp(-v / DECAY))
        assert steep == pytest.approx(f)
        assert slope == pytest.approx(-0.3 / DECAY * np.exp(-v / DECAY), rel=1e-6)

    def bounded(rate, pressure, state):
        return 3e4 / pressure

    f, steep, slope = slopes(bounded, v, p, np.full(2, 1e-4), np.arange(2), 0.0)
    assert f == pytest.approx(3.0 / p)
    assert steep == pytest.approx(0.0, abs=1e-7)
    assert slope == pytest.approx(0.0, abs=1e-12)


def test_stick_and_no_slip():
    """Contacts told to stick have tangential springs and no friction; at rest nothing slides."""
    _, pair, state = plate_on_plane(coulomb(FRICTION))
    with pytest.raises(ValueError, match="25 of 25 contacts do not slide"):
        sliding(pair.passes[0], state, 0.0)
    on = sliding(pair.passes[0], state, 0.0, np.array([SPEED, 0.0, 5.0]))
    assert on.speed == pytest.approx(SPEED)
    assert on.along == pytest.approx(np.tile([1.0, 0.0, 0.0], (25, 1)))
    assert on.turning == pytest.approx(FRICTION * on.normal_force / SPEED)
    stuck = on.stuck(0.7)
    assert stuck.tangential == pytest.approx(0.7 * on.stiffness)
    assert not (stuck.turning.any() or stuck.steepness.any() or stuck.slope.any())
