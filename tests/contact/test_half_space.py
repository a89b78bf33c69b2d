# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact of half-spaces, solved numerically, against Hertz and against its own conditions."""

import numpy as np
import pytest

from contact.theory.closed_forms import contact_modulus, hertz_ellipse
from contact.theory.half_space import half_space_contact

MODULUS, LOAD, WHEEL = contact_modulus(210e9, 0.3, 210e9, 0.3), 1e5, 0.46


def grid(half: tuple[float, float], n: int):
    """Middles of n times n rectangles over a box of half widths, and their sides."""
    x, y = ((np.arange(n) - (n - 1) / 2) * 2 * h / n for h in half)
    return x[:, None], y[None, :], (2 * half[0] / n, 2 * half[1] / n)


@pytest.mark.parametrize("crown", [0.08, 0.3, 3.0])
def test_paraboloids_give_hertz(crown):
    """64 x 64: p₀, approach and both axes (from second moments, p a²/5) 0.05 %, rms 0.35 %.

    The pressure is worst at the edge, where Hertz's has an upright tangent.
    """
    hertz = hertz_ellipse(LOAD, WHEEL, crown, MODULUS)
    x, y, spacing = grid((1.3 * hertz.a, 1.3 * hertz.b), 64)
    found = half_space_contact(x**2 / (2 * WHEEL) + y**2 / (2 * crown), spacing, LOAD, MODULUS)
    p = found.pressure
    a, b = (np.sqrt(5 * (p * c**2).sum() / p.sum()) for c in (x, y))
    assert p.sum() * spacing[0] * spacing[1] == pytest.approx(LOAD)
    assert (a, b, p.max()) == pytest.approx((hertz.a, hertz.b, hertz.p0), rel=5e-4)
    assert found.approach == pytest.approx(hertz.approach, rel=2e-4)
    assert found.area == pytest.approx(np.pi * hertz.a * hertz.b, rel=0.01)
    assert np.sqrt(np.mean((p - hertz.pressure(x, y)) ** 2)) < 3.5e-3 * hertz.p0
    assert not found.reaches_the_edge


def test_flat_punch():
    """A rigid flat circular punch: approach P / (2 E* R) (Johnson 3.36) to 1 % with 60 cells.

    The pressure is infinite at the edge; each cell there is wholly in or out.
    """
    radius = 0.01
    x, y, spacing = grid((0.0101, 0.0101), 64)
    gap = np.where(np.hypot(x, y) < radius, 0.0, 1.0)
    found = half_space_contact(gap, spacing, LOAD, MODULUS)
    assert found.approach == pytest.approx(LOAD / (2 * MODULUS * radius), rel=0.01)


def test_soft_layer():
    """A layer far softer than the bodies: p = (approach - gap) / layer, load pi R approach²/layer.

    Bodies a thousand times stiffer than the layer: 1 %.
    """
    radius, layer = 0.3, 1e-3 * 0.01 / 1e6
    x, y, spacing = grid((0.05, 0.05), 64)
    approach = np.sqrt(LOAD * layer / (np.pi * radius))
    found = half_space_contact((x**2 + y**2) / (2 * radius), spacing, LOAD, 1e3 * MODULUS, layer)
    assert found.approach == pytest.approx(approach, rel=0.01)
    assert found.pressure.max() == pytest.approx(approach / layer, rel=0.01)


def test_two_bumps_part_as_the_load_falls():
    """Two paraboloids of unequal height: two patches under a heavy load, one under a light one."""
    x, y, spacing = grid((0.012, 0.012), 96)
    bump = np.minimum((x - 0.005) ** 2 / 0.2, (x + 0.005) ** 2 / 0.2 + 1e-5) + y**2 / 0.2
    both = half_space_contact(bump, spacing, 2e4, MODULUS).pressure
    one = half_space_contact(bump, spacing, 2e2, MODULUS).pressure
    left = (x < 0).ravel()
    assert both[left].sum() > 0.2 * both.sum() and both[47:49].max() == 0
    assert one[left].sum() == 0


def test_a_grid_too_small_is_told():
    """Half the patch on the grid."""
    x, y, spacing = grid((0.003, 0.003), 16)
    assert half_space_contact(x**2 + y**2, spacing, LOAD, MODULUS).reaches_the_edge


@pytest.mark.parametrize(
    ("gap", "spacing", "load"),
    [(np.zeros((4, 4)), (1.0, 1.0), -1.0), (np.zeros((4, 4)), (1.0, 0.0), 1.0)],
)
def test_wrong_numbers_are_refused(gap, spacing, load):
    with pytest.raises(ValueError, match="expected values > 0"):
        half_space_contact(gap, spacing, load, MODULUS)


def test_wrong_gaps_are_refused():
    with pytest.raises(ValueError, match="finite distances"):
        half_space_contact(np.full((4, 4), np.nan), (1.0, 1.0), 1.0, MODULUS)
