# SPDX-License-Identifier: LGPL-3.0-or-later
"""Closed forms against tabulated Hertz values and against their own resultants."""

import numpy as np
import pytest
from scipy.integrate import quad

from contact.theory import closed_forms as cf

# independent table: load, rail crown radius -> a (rolling), b (lateral), p0, approach;
# wheel radius 0.46 m, steel E = 210 GPa, nu = 0.3
TABLE = [
    (50000.0, 0.3, 0.0056842, 0.0042758, 9.8225e08, 6.559e-05),
    (80000.0, 0.3, 0.0066483, 0.005001, 1.14885e09, 8.973e-05),
    (100000.0, 0.3, 0.0071617, 0.0053872, 1.23756e09, 0.00010412),
    (116800.0, 0.3, 0.0075422, 0.0056734, 1.30331e09, 0.00011548),
    (120000.0, 0.3, 0.0076104, 0.0057247, 1.3151e09, 0.00011758),
    (50000.0, 0.08, 0.0067797, 0.0021436, 1.64267e09, 7.868e-05),
    (80000.0, 0.08, 0.0079296, 0.0025072, 1.92127e09, 0.00010763),
    (100000.0, 0.08, 0.0085419, 0.0027008, 2.06963e09, 0.0001249),
    (116800.0, 0.08, 0.0089957, 0.0028443, 2.17958e09, 0.00013852),
    (120000.0, 0.08, 0.0090772, 0.00287, 2.19931e09, 0.00014104),
]


@pytest.mark.parametrize(("load", "crown", "a", "b", "p0", "approach"), TABLE)
def test_ellipse_against_table(load, crown, a, b, p0, approach):
    modulus = cf.contact_modulus(210e9, 0.3, 210e9, 0.3)
    h = cf.hertz_ellipse(load, 0.46, crown, modulus)
    assert (h.a, h.b, h.p0, h.approach) == pytest.approx((a, b, p0, approach), rel=1e-3)


def test_ellipse_turns_and_becomes_a_circle():
    h, k = cf.hertz_ellipse(1e4, 0.4, 0.1, 1e11), cf.hertz_ellipse(1e4, 0.1, 0.4, 1e11)
    assert (h.a, h.b) == pytest.approx((k.b, k.a)) and h.a > h.b
    near, sphere = cf.hertz_ellipse(1e4, 0.2, 0.2001, 1e11), cf.hertz_sphere(1e4, 0.2, 1e11)
    assert (near.a, near.p0, near.approach) == pytest.approx(
        (sphere.a, sphere.p0, sphere.approach), rel=1e-3
    )


def test_tractions_carry_their_loads():
    """Integrals of the Hertz, Cattaneo-Mindlin and Carter tractions give back the loads."""
    P, Q, friction = 1e4, 1.8e3, 0.3
    h = cf.hertz_sphere(P, 0.1, 1e11)
    assert quad(lambda r: 2 * np.pi * r * h.pressure(r), 0, h.a)[0] == pytest.approx(P, rel=1e-6)
    shear = quad(lambda r: 2 * np.pi * r * cf.cattaneo_mindlin(r, h, Q, P, friction), 0, h.a)
    assert shear[0] == pytest.approx(Q, rel=1e-5)
    line = cf.hertz_line(P, 0.1, 1e11)
    assert quad(line.pressure, -line.a, line.a)[0] == pytest.approx(P, rel=1e-6)
    ratio = cf.carter_stick_ratio(Q, P, friction)
    carter = quad(
        lambda x: cf.carter_traction(x, line, ratio, friction), -line.a, line.a, limit=200
    )
    assert carter[0] == pytest.approx(Q, rel=1e-5)


def test_line_compression_sums_the_strain():
    """Johnson's stresses on the axis, summed, and the limit far below (Johnson 5.56)."""
    E, nu = 210e9, 0.3
    h = cf.hertz_line(1e6, 0.1, cf.contact_modulus(E, nu, E, nu))

    def strain(z):
        root = np.hypot(h.a, z)
        along = -h.p0 / h.a * ((h.a**2 + 2 * z**2) / root - 2 * z)
        vertical = -h.p0 * h.a / root
        return -((1 - nu**2) * vertical - nu * (1 + nu) * along) / E

    for depth in (0.5 * h.a, 2 * h.a, 10 * h.a):
        exact = quad(strain, 0, depth)[0]
        assert cf.line_compression(h, depth, E, nu) == pytest.approx(exact, rel=1e-8)
    far = 1e3 * h.a
    slope = 1e6 * (1 - nu**2) / (np.pi * E)
    johnson = slope * (2 * np.log(2 * far / h.a) - nu / (1 - nu))
    assert cf.line_compression(h, far, E, nu) == pytest.approx(johnson, rel=1e-4)


@pytest.mark.parametrize("crown", [0.1, 0.03])
def test_sinking_sums_boussinesq(crown):
    """Half the approach at the surface; Boussinesq's forces summed by another rule below it."""
    E, nu = 210e9, 0.3
    h = cf.hertz_ellipse(1e4, 0.1, crown, cf.contact_modulus(E, nu, E, nu))
    assert 2 * cf.sinking(h, 1e-9, E, nu) == pytest.approx(h.approach, rel=1e-6)
    depth, n = 1.5 * h.a, 400
    x, y = np.meshgrid(*((np.arange(n) + 0.5) / n * axis for axis in (h.a, h.b)))
    R = np.sqrt(x**2 + y**2 + depth**2)
    force = 4 * h.pressure(x, y) * h.a * h.b / n**2
    exact = (1 + nu) / (2 * np.pi * E) * (force * (depth**2 / R**3 + 2 * (1 - nu) / R)).sum()
    assert cf.sinking(h, depth, E, nu) == pytest.approx(exact, rel=1e-4)


def test_work_of_weakening_friction():
    """The coefficient, integrated over the slip."""
    found = cf.slip_weakening_work(3e-5, 0.5, 0.1, 1e-5)
    exact = quad(lambda x: 0.1 + 0.4 * np.exp(-x / 1e-5), 0, 3e-5)[0]
    assert found == pytest.approx(exact, rel=1e-9)


def test_impact_approach_takes_up_the_kinetic_energy():
    """The work of Hertz's force up to the largest approach is m v² / 2."""
    m, R, modulus, v = 0.03, 0.02, 1.15e11, 0.5
    depth = cf.sphere_impact_approach(m, R, modulus, v)
    work = 8 / 15 * modulus * np.sqrt(R) * depth**2.5
    assert work == pytest.approx(m * v**2 / 2)


def test_limits():
    assert cf.stick_radius_ratio(0.0, 1.0, 0.3) == 1.0
    assert cf.stick_radius_ratio(0.3, 1.0, 0.3) == 0.0
    assert cf.carter_creepage(0.3, 1.0, 0.3, 1e-3, 0.1) == pytest.approx(-3e-3)
    assert cf.bar_impact(0.01, 210e9, 7800.0, 1e-4, 0.5)[1] == pytest.approx(1.0 / 5188.7, rel=1e-4)
    assert cf.sliding_stop(2.0, 0.3)[0] == pytest.approx(4.0 / (0.6 * 9.81))
    assert cf.sphere_impact_time(1.0, 0.1, 1e11, 1.0) == pytest.approx(1.81e-4, rel=0.01)


@pytest.mark.parametrize(
    "call",
    [
        lambda: cf.hertz_sphere(-1.0, 1.0, 1.0),
        lambda: cf.hertz_ellipse(1.0, 0.0, 1.0, 1.0),
        lambda: cf.stick_radius_ratio(2.0, 1.0, 0.3),
        lambda: cf.carter_stick_ratio(2.0, 1.0, 0.3),
        lambda: cf.sliding_stop(1.0, 0.0),
    ],
)
def test_bad_values(call):
    with pytest.raises(ValueError, match="expected"):
        call()
