# SPDX-License-Identifier: LGPL-3.0-or-later
"""Verification of rolling: rows 15 (Carter, plane strain) and 16 (Kalker, small creepage)."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contact.theory import kalker
from contact.theory.closed_forms import (
    carter_creepage,
    carter_stick_ratio,
    carter_traction,
    contact_modulus,
    hertz_ellipse,
    hertz_line,
)
from tests.scripts import measured, numbers
from workflow import Scene, run
from workflow.model.model import Model

E, NU, RADIUS, CROWN = 210e9, 0.3, 0.46, 0.3
Watch = Callable[[Model], Any]
MODULUS, G = contact_modulus(E, NU, E, NU), E / (2 * (1 + NU))


def unwatched(model: Model) -> None:
    """Nobody else looks on."""


def rolled(scene: Scene, folder: Path, also: Watch) -> tuple[Model, np.ndarray, dict]:
    """The model at the end, mean force on the roller over the last fifth of the way, history.

    The force ``(3,)`` is that of every step: normal, along, across [N].
    """
    rows: list[tuple] = []
    kept: list[Model] = []

    def watch(model: Model) -> None:
        also(model)
        pair = model.pairs["touch"]
        kept[:] = [model]
        rows.append((pair.normal_force, *pair.tangential_force[:2]))

    history = run(scene, folder, watch=watch, quiet=True).history
    forces = np.array(rows)
    steady, before = (forces[-k * len(rows) // 5 :][: len(rows) // 5] for k in (1, 2))
    history["drift"] = np.abs(steady.mean(axis=0) / before.mean(axis=0) - 1)
    return kept[0], steady.mean(axis=0), history


# row 15


def carter(scene: Scene, folder: Path, also: Watch = unwatched) -> dict:
    """The scene carter: errors of Q for its creepage, of the stick zone, of the traction."""
    creepage = scene.driven["roller"].spin[1] * RADIUS / 80.0 - 1
    model, force, history = rolled(scene, folder, also)
    P, Q = force[:2] / scene.mesh.y[1]
    hertz, friction = hertz_line(P, RADIUS, MODULUS), scene.contacts["touch"].friction
    exact = carter_creepage(Q, P, friction, hertz.a, RADIUS)
    footprint = model.pairs["touch"].footprint(stick_tolerance=0.02)
    x, stick = footprint.position[:, 0], footprint.stick
    size, ratio = scene.mesh.size, carter_stick_ratio(Q, P, friction)
    q = footprint.tangential_force[:, 0] / footprint.area
    traction = np.sign(Q) * carter_traction(x, hertz, ratio, friction)
    width = np.ptp(np.unique(x[stick].round(7))) + size if stick.any() else 0.0
    return {
        "share": abs(Q) / (friction * P),
        "creepage": -creepage / exact - 1,
        "stick": (width - 2 * ratio * hertz.a) / size,
        "leading": (x[stick].max() - hertz.a) / size,
        "q": float(np.sqrt(((q - traction) ** 2).mean())) / np.abs(traction).max(),
        "drift": history["drift"][1],
        "balance": np.abs(history["balance_error"]).max(),
    }


EXAMPLE = 7.6e-4
CURVE = [(5e-4, 0.5), (7.6e-4, 0.69), (1.19e-3, 0.91), (-7.6e-4, 0.69)]  # driven, last: braked


@pytest.fixture(scope="module")
def carters(tmp_path_factory) -> tuple[str, dict, Path]:
    """What the example prints, what its run is measured by, its figure."""
    figure = tmp_path_factory.mktemp("carter") / "traction.png"
    return *measured("carter.py", EXAMPLE, figure, by=carter), figure


@pytest.mark.slow
def test_carter_ends_on_his_creepage(carters):
    """The example: creepage 3 %, stick zone one cell of 0.3 mm; a figure."""
    text, _, figure = carters
    found, exact, _ = numbers(text, "creepage")
    assert found == pytest.approx(exact, rel=0.03)
    width, closed = numbers(text, "stick")
    assert abs(width - closed) <= 0.3
    assert figure.stat().st_size > 10_000


@pytest.mark.slow
@pytest.mark.parametrize(
    ("creepage", "share"),
    [
        pytest.param(*point, marks=[] if point[0] == EXAMPLE else pytest.mark.long)
        for point in CURVE
    ],
)
def test_row_15_carter(request, tmp_path, creepage, share):
    """0.3 mm: creepage for the traction 3 %, stick zone one cell, at the leading edge; ledger.

    One cell is the finest that a stick zone is told by: a node sticks or slips. Driven and braked
    differ by 2 %: without traction the roller creeps by 7e-6, of the order of (a/R)², which the
    half-spaces of Carter do not.
    """
    if creepage == EXAMPLE:
        found = request.getfixturevalue("carters")[1]
    else:
        spin = [0.0, 80.0 * (1 + creepage) / RADIUS, 0.0]
        keys = {"driven.roller.spin": spin, "output.fields": False}
        found = carter(Scene.load("carter", **keys), tmp_path)
    assert found["share"] == pytest.approx(share, abs=0.03)
    assert found["drift"] < 0.03
    assert found["creepage"] == pytest.approx(0, abs=0.03)
    assert abs(found["stick"]) <= 1
    assert -2 <= found["leading"] <= 0.5
    assert found["q"] < 0.1
    assert found["balance"] < 1e-3


# row 16


def kalkers(scene: Scene, folder: Path, also: Watch = unwatched) -> dict:
    """The scene kalker-creepage: force over Kalker's, which includes the little that slips."""
    _, force, history = rolled(scene, folder, also)
    sides = 2 if scene.mesh.y[0] == 0 else 1
    P, Qx, Qy = sides * force
    V = -np.array(scene.driven["rail"].velocity)
    rim = scene.driven["wheel"].spin[1] * RADIUS
    xi, eta = (V[0] - rim) / V[0], V[1] / V[0]
    hertz = hertz_ellipse(P, RADIUS, CROWN, MODULUS)
    linear = kalker.creep_force((xi, eta, 0.0), (hertz.a, hertz.b), G, NU)
    size = np.linalg.norm(linear)
    friction = scene.contacts["touch"].friction
    exact = kalker.saturated(size, friction * P) * linear / size
    axis = int(np.argmax(np.abs(linear)))
    return {
        "force": (Qx, Qy)[axis] / exact[axis] - 1,
        "linear": (Qx, Qy)[axis] / linear[axis] - 1,
        "across": (Qy, Qx)[axis] / size,
        "drift": history["drift"][1 + axis],
        "balance": np.abs(history["balance_error"]).max(),
    }


@pytest.fixture(scope="module")
def longitudinal() -> tuple[str, dict]:
    """What the example prints, and what its run is measured by."""
    return measured("kalker_creepage.py", by=kalkers)


@pytest.mark.slow
def test_kalker_creepage_ends_on_his_coefficient(longitudinal):
    """The example: c₁₁ of the ellipse of a wheel on a rail crown to 5 %."""
    line = next(x for x in longitudinal[0].splitlines() if x.startswith("c11 "))
    found, exact = float(line.split()[1].rstrip(",")), float(line.split()[3].rstrip(","))
    assert found == pytest.approx(exact, rel=0.05)


@pytest.mark.slow
def test_row_16_longitudinal_creepage(longitudinal):
    """0.5 mm (a/6): c₁₁ 5 %, steady to 3 %; ledger 1e-3."""
    found = longitudinal[1]
    assert found["force"] == pytest.approx(0, abs=0.05)
    assert found["drift"] < 0.03
    assert found["balance"] < 1e-3


LATERAL = {
    "driven.wheel.spin": [0.0, 40.0 / RADIUS, 0.0],
    "driven.wheel.shift": [0.0, 1.7e-6, 0.0],
    "driven.rail.velocity": [-40.0, -0.024, 0.0],
    "supports": [],
    "mesh.y": [-0.02, 0.02],
    "mesh.fine_y": [-0.003, 0.003],
}


@pytest.mark.long
@pytest.mark.slow
def test_row_16_lateral_creepage(tmp_path):
    """The same, 6e-4 across, on the whole contact: c₂₂ 5 %, steady to 3 %; ledger 1e-3."""
    lateral = Scene.load("kalker-creepage", **{"output.fields": False}, **LATERAL)
    found = kalkers(lateral, tmp_path)
    assert found["force"] == pytest.approx(0, abs=0.05)
    assert found["drift"] < 0.03
    assert found["balance"] < 1e-3
