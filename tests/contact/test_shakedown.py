# SPDX-License-Identifier: LGPL-3.0-or-later
"""Limits of line contact that rolls: its stresses, first yield and shakedown."""

import numpy as np
import pytest
from scipy.optimize import minimize

from contact.theory.shakedown import (
    ALONG,
    DEPTHS,
    line_contact_stresses,
    line_first_yield,
    line_shakedown,
)


@pytest.mark.parametrize("friction", [0.0, 0.4])
def test_stresses_are_in_equilibrium(friction):
    """Divergence zero by differences; on the surface pressure and shear as given."""
    x, z, h = np.array([0.3, -0.7, 1.4, -1.2]), np.array([0.4, 0.2, 0.9, 0.1]), 1e-5

    def slope(component, dx, dz):
        after = line_contact_stresses(x + dx * h, z + dz * h, friction)[component]
        before = line_contact_stresses(x - dx * h, z - dz * h, friction)[component]
        return (after - before) / (2 * h)

    np.testing.assert_allclose(slope(0, 1, 0) + slope(2, 0, 1), 0, atol=1e-8)
    np.testing.assert_allclose(slope(2, 1, 0) + slope(1, 0, 1), 0, atol=1e-8)
    x = np.array([-0.6, 0.0, 0.8])
    _, sz, txz = line_contact_stresses(x, np.full(3, 1e-9), friction)
    np.testing.assert_allclose(sz, -np.sqrt(1 - x**2), atol=1e-8)
    np.testing.assert_allclose(txz, -friction * np.sqrt(1 - x**2), atol=1e-8)


def test_limits_of_johnson():
    """Without traction 3.1 k and 4 k (Johnson, 1985, ch. 9); surface, incompressible: k/f."""
    assert line_first_yield(0.0) == pytest.approx(3.107, abs=1e-3)
    assert line_shakedown(0.0) == pytest.approx(4.0, rel=1e-3)
    for friction in (0.5, 0.7):
        assert line_shakedown(friction, 0.5) == pytest.approx(1 / friction, rel=1e-3)
    limits = [line_shakedown(f) for f in (0.0, 0.1, 0.2, 0.3, 0.4, 0.5)]
    assert np.all(np.diff(limits) < 0)
    assert all(line_first_yield(f) < line_shakedown(f) for f in (0.0, 0.2, 0.4))


def test_no_residual_stress_does_better():
    """Another way to the best residual stresses at each depth, by the whole tensor: the same."""
    friction, nu, levels = 0.2, 0.3, []
    for z in DEPTHS[1::4]:
        sx, sz, txz = line_contact_stresses(ALONG, np.full(ALONG.shape, z), friction)
        stress = np.zeros((len(ALONG), 3, 3))
        stress[:, 0, 0], stress[:, 1, 1], stress[:, 2, 2] = sx, nu * (sx + sz), sz
        stress[:, 0, 2] = stress[:, 2, 0] = txz

        def worst(r, stress=stress):
            whole = stress + np.diag([r[0], r[1], 0.0])
            s = whole - np.trace(whole, axis1=1, axis2=2)[:, None, None] * np.eye(3) / 3
            return np.sqrt(np.sum(s * s, axis=(1, 2)) / 2).max()

        options = {"xatol": 1e-7, "fatol": 1e-9, "maxiter": 4000}
        levels.append(minimize(worst, [0.0, 0.0], method="Nelder-Mead", options=options).fun)
    assert 1 / max(levels) == pytest.approx(line_shakedown(friction), rel=0.01)
    assert 1 / max(levels) >= line_shakedown(friction) * (1 - 1e-6)  # these are fewer depths
