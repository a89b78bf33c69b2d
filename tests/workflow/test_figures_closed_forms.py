# SPDX-License-Identifier: LGPL-3.0-or-later
"""What is drawn behind computed curves, against theory written out here; outlines of patches."""

from types import SimpleNamespace

import numpy as np
import pytest

from workflow.figures.closed_forms import closed_forms
from workflow.figures.footprint import cell_sizes, outlines
from workflow.scene.scene import Scene
from workflow.theory.smooth import applied, smooth

pytest.importorskip("matplotlib")

E, NU = 210e9, 0.3
STAR = E / (2 * (1 - NU**2))  # of two bodies of the same steel


def record(scene: str, history=None, **changes) -> SimpleNamespace:
    """What the functions look at of a run."""
    tables = Scene.load(scene, **changes).tables()
    return SimpleNamespace(scene=tables, checked=Scene.check(tables), history=history or {})


def test_sphere_of_a_quarter_model():
    """12.3 kN on the whole sphere: a = (3PR/4E*)^(1/3)."""
    bodies, load = smooth(record("hertz")), applied(record("hertz"))
    assert load == pytest.approx(7.69e6 * 0.02**2)
    hertz = bodies.hertz(load)
    assert hertz.a == hertz.b == pytest.approx((0.75 * 4 * load * 0.1 / STAR) ** (1 / 3))


def test_cylinder_of_a_half_model():
    """7.2 kN per mm: a = sqrt(4PR/(π E*)), p0 = 2P/(π a)."""
    bodies, load = smooth(record("hertz-cylinder")), applied(record("hertz-cylinder"))
    a = np.sqrt(4 * 7.2e6 * 0.1 / (np.pi * STAR))
    hertz = bodies.hertz(load)
    assert bodies.plane and hertz.a == pytest.approx(a)
    assert hertz.p0 == pytest.approx(2 * 7.2e6 / (np.pi * a))


def test_ellipse_is_that_of_the_table():
    """50 kN, radii 0.46 m and 0.3 m: half axes 5.7 and 4.3 mm (tests/data/hertz_reference.csv)."""
    bodies, load = smooth(record("hertz-ellipse")), applied(record("hertz-ellipse"))
    hertz = bodies.hertz(load)
    assert 4 * load == pytest.approx(50e3)
    assert (1e3 * hertz.a, 1e3 * hertz.b) == pytest.approx((5.69, 4.28), abs=0.02)
    # the ellipsoid of pressure holds the load
    assert 2 / 3 * np.pi * hertz.a * hertz.b * hertz.p0 == pytest.approx(50e3)


def test_no_closed_form_where_none_fits():
    """Wheel on rail, a bar, two contacts: nothing is drawn behind."""
    assert smooth(record("flange-transition")) is None and smooth(record("bar-wave")) is None
    assert applied(record("flange-transition")) is None and applied(record("carter")) is None
    hyper = {"bodies.sphere.kinematics": "total-lagrangian"}
    assert smooth(record("hertz", **hyper)) is not None
    assert closed_forms(record("two-bars"), "face") == []


def test_carter_at_the_imposed_creepage():
    """Q = friction P (1 - (1 - ξR/(friction a))²), P of the last output, per 0.5 mm."""
    history = {"t": np.array([0, 3e-4]), "touch_normal_force": np.array([1.0, 665.0])}
    ((label, _, force),) = closed_forms(record("carter", history), "touch")
    P, friction, xi = 665.0 / 5e-4, 0.3, 174.045 * 0.46 / 80 - 1
    a = np.sqrt(4 * P * 0.46 / (np.pi * STAR))
    share = 1 - (1 - xi * 0.46 / (friction * a)) ** 2
    assert "Carter" in label
    np.testing.assert_allclose(force, friction * 665.0 * share, rtol=1e-9)
    assert 0.6 < share < 0.75


def test_impact_has_hertz_time_and_force():
    """Largest force (4/3) E* sqrt(R) δ^1.5 with δ from the energy; time 2.94 δ/v."""
    speed, mass = 0.5, 0.1
    stiffness = 4 / 3 * STAR * np.sqrt(0.02) / 4
    depth = (5 / 4 * mass * speed**2 / stiffness) ** 0.4
    t = np.linspace(0, 3.2 * depth / speed, 81)
    history = {"t": t, "kinetic": np.full(81, 0.5 * mass * speed**2)}
    ((_, t, force),) = closed_forms(record("sphere-impact", history), "touch")
    assert force.max() == pytest.approx(stiffness * depth**1.5, rel=1e-3)
    assert t[force > 0][-1] == pytest.approx(2.94 * depth / speed, rel=0.01)


def grid(columns: int, rows: int, at=(0.0, 0.0)) -> np.ndarray:
    """Nodes 4 mm apart along and 2 mm across."""
    return np.mgrid[:columns, :rows].reshape(2, -1).T * (4e-3, 2e-3) + at


def area(ring: np.ndarray) -> float:
    x, y = ring[:-1].T
    return abs(float(x @ np.roll(y, 1) - y @ np.roll(x, 1))) / 2


def test_outline_holds_the_cells_and_no_more():
    """A block of nodes, a single one, two apart: a ring each, of about the tributary areas."""
    nodes = grid(5, 3)
    np.testing.assert_allclose(cell_sizes(nodes, np.full(15, 8e-6)), [(4e-3, 2e-3)] * 15)
    for part, n in ((nodes, 15), (nodes[:1], 1)):
        (ring,) = outlines(part, np.full(n, 8e-6))
        assert area(ring) == pytest.approx(n * 8e-6, rel=0.3)
        np.testing.assert_allclose(ring[0], ring[-1])
    apart = np.vstack([nodes, grid(2, 2, at=(0.1, 0.0))])
    assert len(outlines(apart, np.full(19, 8e-6))) == 2
    # an L is not filled up as its hull would be
    corner = np.vstack([grid(5, 1), grid(1, 4, at=(0.0, 2e-3))])
    (ring,) = outlines(corner, np.full(9, 8e-6))
    assert area(ring) == pytest.approx(9 * 8e-6, rel=0.3)
