# SPDX-License-Identifier: LGPL-3.0-or-later
"""Friction laws and their checks."""

import h5py
import numpy as np
import pytest

from contact import LawState, coulomb, exponential, with_memory
from contact.expression import expression
from contact.friction import as_law, coefficients, rational, tabulated, tried
from tests.skins import evaluate, plate_on_plane
from workflow import Scene, run
from workflow.scene.scene import SceneError
from workflow.simulation.guards import GuardError

STATE = LawState(0.0, 1e-6, np.arange(3), np.full(3, np.nan))


def test_laws():
    rate, pressure = np.array([0.0, 1.0, 1e3]), np.ones(3)
    assert coulomb(0.3)(rate, pressure, STATE) == pytest.approx([0.3] * 3)
    falling = exponential(0.5, 0.2, 1.0)(rate, pressure, STATE)
    assert falling == pytest.approx([0.5, 0.2 + 0.3 / np.e, 0.2])
    slower = rational(0.5, 0.2, 1.0)(rate, pressure, STATE)
    assert slower == pytest.approx([0.5, 0.35, 0.2 + 0.3 / 1001])
    points = tabulated([0.5, 1.0, 2.0], [0.5, 0.4, 0.2])
    assert points(np.array([0.0, 0.75, 1.5]), pressure, STATE) == pytest.approx([0.5, 0.45, 0.3])
    assert points(np.array([2.0, 9.0, 1.0]), pressure, STATE) == pytest.approx([0.2, 0.2, 0.4])


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
    total = float((seen[1][1] * pair.passes[0].stack.area[:25]).sum())
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


def test_expression_is_the_law_it_says():
    rate, pressure = np.array([0.0, 0.5, 3.0]), np.array([1e6, 1e9, 2e9])
    state = LawState(0.25, 1e-6, np.arange(3), np.array([np.nan, 0.2, 0.3]))
    same = exponential(0.4, 0.1, 0.5)(rate, pressure, state)
    assert expression("0.3 * exp(-slip_rate / 0.5) + 0.1")(rate, pressure, state) == pytest.approx(
        same, rel=1e-15
    )
    for text, value in (
        ("0.3", [0.3] * 3),
        ("max(0.4 - pressure / 1e10, 0.25) + t", [0.4 - 1e-4 + 0.25, 0.55, 0.5]),
        ("where(previous > 0, previous, 0.5)", [0.5, 0.2, 0.3]),
        ("where(slip_rate <= 0.5, 0.4, 0.1 ** 2)", [0.4, 0.4, 0.01]),
    ):
        assert expression(text)(rate, pressure, state) == pytest.approx(value)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("speed", "'speed': expected one of"),
        ("slip_rate.size", "Attribute: expected"),
        ("__import__('os').getcwd()", "expected"),
        ("[0.3 for x in slip_rate]", "expected"),
        ("exp(slip_rate, out=pressure)", "Call: expected"),
        ("0.3 if t > 1 else 0.2", "IfExp: expected"),
        ("0.1 < slip_rate < 1", "comparison of two"),
        ("max(1)", "max: expected 2 arguments"),
        ("0.3 +", "not an expression"),
        ("0.3 + " * 100 + "1", "at most 500 characters"),
        ("'a'", "expected numbers"),
    ],
)
def test_expression_takes_nothing_else(text, says):
    with pytest.raises(ValueError, match=says):
        expression(text)


@pytest.mark.parametrize(
    ("law", "says"),
    [
        (lambda r, p, s: 0.3 - r, "expected finite values >= 0, got -"),
        (lambda r, p, s: 1e-3 / r, "got inf at slip rate 0"),
        (lambda r, p, s: 0.3, "expected shape"),
        (lambda r, p, s: s.friction, "got nan"),
        (lambda r, p: 0.3 + 0 * r, "failed with TypeError"),
        (expression("9 ** 9 ** 9"), "failed with OverflowError"),
        (expression("exp"), "failed with TypeError"),
    ],
)
@pytest.mark.filterwarnings("ignore:divide by zero")
def test_a_law_is_tried_before_use(law, says):
    with pytest.raises(ValueError, match=says):
        tried(law)


def test_bad_points():
    with pytest.raises(ValueError, match="increasing"):
        tabulated([0.0, 1.0, 1.0], [0.3, 0.2, 0.1])
    with pytest.raises(ValueError, match="lists of one length"):
        tabulated([0.0, 1.0], [0.3])
    with pytest.raises(ValueError, match="coefficient: expected finite values >= 0"):
        tabulated([0.0, 1.0], [0.3, -0.2])


SLIDE = {"output.fields": False, "time.end": 3e-5, "time.output_interval": 1e-6}


def momentum(model) -> float:
    """Momentum of the block along x, at t [kg m/s]."""
    dofs = model.bodies.dofs("block")
    v = model.state.v.x.array + model.dt / 2 * model.state.a.array
    return float(model.mass.array[::3][dofs] @ v.reshape(-1, 3)[dofs, 0])


def test_block_on_a_law_linear_in_slip_rate(tmp_path):
    """m v' = -(a + b v) F has v = (v0 + a/b) exp(-b F t / m) - a/b; to 1 % of the loss after 30 µs.

    The same from a table of points, an expression, a law in Python, and with a memory that is
    short against the way of 40 µm.
    """
    a, b = 0.1, 0.1
    table = {"law": "tabulated", "slip_rate": [0.0, 10.0], "coefficient": [a, a + 10 * b]}
    own = {"face": lambda rate, pressure, state: a + b * rate}
    mass, force = 7800 * 0.02 * 0.02 * 0.01, 10e6 * 0.02 * 0.02
    exact = (2 + a / b) * np.exp(-b * force / mass * 3e-5) - a / b
    for k, (friction, laws) in enumerate(
        [
            (table, None),
            ({"law": "expression", "expression": f"{a} + {b} * slip_rate"}, None),
            (0.9, own),
            (table | {"memory": {"length": 1e-7}}, None),
        ]
    ):
        scene = Scene.load("sliding-block", **SLIDE, **{"contacts.face.friction": friction})
        seen: list = []
        run(scene, tmp_path / f"{k}", watch=lambda m: seen.append(momentum(m)), friction=laws,
            quiet=True)  # fmt: skip
        assert 2 - seen[-1] / mass == pytest.approx(2 - exact, rel=0.01)


@pytest.mark.parametrize(
    ("friction", "says"),
    [
        (-0.1, "contacts.face.friction = -0.1: expected greater"),
        ({"law": "sticky"}, "contacts.face.friction = .* table with law = one of"),
        ({"law": "exponential", "static": 0.3}, r"contacts.face.friction.kinetic: missing.*\[-\]"),
        (
            {"law": "rational", "static": 0.3, "kinetic": 0.1, "speed": 0.0},
            r"contacts.face.friction.speed = 0.0: expected greater than 0 \[m/s\]",
        ),
        (
            {"law": "expression", "expression": "0.3 - slip_rate"},
            "contacts.face.friction: friction law: expected finite values >= 0",
        ),
        (
            {"law": "expression", "expression": "0.3", "memory": {"length": 0.0}},
            "contacts.face.friction.memory.length = 0.0: expected greater",
        ),
        (
            {"law": "tabulated", "slip_rate": [1.0, 0.0], "coefficient": [0.3, 0.2]},
            "contacts.face.friction: slip_rate: expected increasing",
        ),
    ],
)
def test_bad_friction_in_a_scene(friction, says):
    with pytest.raises(SceneError, match=says):
        Scene.load("sliding-block", **{"contacts.face.friction": friction})


def test_laws_from_python_are_checked(tmp_path):
    """Before the run where they can be, else the run is stopped and what there is is kept."""
    scene = Scene.load("sliding-block", **SLIDE)
    for friction, says in (
        ({"wheel": coulomb(0.3)}, r"friction = \['wheel'\]: expected contacts of \['face'\]"),
        ({"face": lambda r, p, s: r - 1}, "contacts.face.friction: friction law: expected finite"),
    ):
        with pytest.raises(SceneError, match=says):
            run(scene, tmp_path / "none", friction=friction, quiet=True)
    assert not (tmp_path / "none").exists()

    def fails_late(rate, pressure, state):
        return np.full(rate.shape, 0.3 if state.t < 4.5e-6 else np.nan)

    with pytest.raises(GuardError, match=r"contact pair face: friction law: .* got nan"):
        run(scene, tmp_path / "late", friction={"face": fails_late}, quiet=True)
    with h5py.File(tmp_path / "late" / "results.h5") as file:
        assert len(file["history/t"]) == 5


def test_springs_and_heat_have_columns_of_their_own(tmp_path):
    """Normal and tangential springs add up to ``contact``; heat only grows; both are there."""
    history = run(Scene.load("sliding-block", **SLIDE), tmp_path / "run", quiet=True).history
    normal, tangential = history["contact_normal"], history["contact_tangential"]
    np.testing.assert_allclose(normal + tangential, history["contact"], rtol=1e-14)
    np.testing.assert_array_equal(history["face_tangential_energy"], tangential)
    np.testing.assert_array_equal(history["face_normal_energy"], normal)
    np.testing.assert_array_equal(history["face_friction_dissipation"],
                                  history["friction_dissipation"])  # fmt: skip
    # all nodes slide at the limit: springs store 0.3^2 of the normal ones
    np.testing.assert_allclose(tangential, 0.09 * normal, rtol=1e-9)
    assert (np.diff(history["friction_dissipation"]) > 0).all()
