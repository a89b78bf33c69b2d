# SPDX-License-Identifier: LGPL-3.0-or-later
"""Kalker's coefficients: table entries, their relations, forces of known creepages."""

import numpy as np
import pytest

from contact.theory import kalker


@pytest.mark.parametrize(
    ("name", "ratio", "poisson", "value"),
    [
        ("c11", 1.0, 0.25, 4.12),
        ("c22", 1.0, 0.25, 3.67),
        ("c23", 1.0, 0.25, 1.47),
        ("c11", 0.1, 0.0, 2.51),
        ("c22", 10.0, 0.5, 16.0),
    ],
)
def test_entries_of_the_table(name, ratio, poisson, value):
    assert kalker.coefficient(name, ratio, poisson) == pytest.approx(value, abs=1e-9)


def test_longitudinal_and_lateral_agree_without_lateral_contraction():
    """At ν = 0 a half-space yields alike in all directions of its surface: c₁₁ = c₂₂."""
    for ratio in (0.13, 0.5, 1.0, 1.33, 7.0):
        both = [kalker.coefficient(name, ratio, 0.0) for name in ("c11", "c22")]
        assert both[0] == pytest.approx(both[1])


def test_coefficients_rise_with_the_ratio_of_the_axes():
    for name in kalker.TABLE:
        values = [kalker.coefficient(name, r, 0.3) for r in np.geomspace(0.1, 9.99, 50)]
        assert (np.diff(values) > 0).all()


def test_forces_oppose_the_creepage():
    """Circle of 1 mm, G = 80 GPa, ν = 0.25: 4.12, 3.67 and 1.47 times c² G of 80 kN or c³ G."""
    force = kalker.creep_force((1e-3, 0.0, 0.0), (1e-3, 1e-3), 80e9, 0.25)
    assert force == pytest.approx([-329.6, 0.0])
    force = kalker.creep_force((0.0, 1e-3, 0.5), (1e-3, 1e-3), 80e9, 0.25)
    assert force == pytest.approx([0.0, -293.6 - 58.8])


def test_saturation():
    """Slope 1 at the origin, the limit from three times it on, 19/27 of it at its own size."""
    assert kalker.saturated(1e-6, 1.0) == pytest.approx(1e-6, rel=1e-5)
    assert kalker.saturated(1.0, 1.0) == pytest.approx(19 / 27)
    assert kalker.saturated(3.0, 1.0) == kalker.saturated(9.0, 1.0) == 1.0


@pytest.mark.parametrize(
    "call",
    [
        lambda: kalker.coefficient("c12", 1.0, 0.3),
        lambda: kalker.coefficient("c11", 11.0, 0.3),
        lambda: kalker.coefficient("c11", 1.0, 0.6),
        lambda: kalker.saturated(-1.0, 1.0),
    ],
)
def test_bad_values(call):
    with pytest.raises(ValueError, match="expected"):
        call()
