# SPDX-License-Identifier: LGPL-3.0-or-later
"""Verification of rolling with traction on the tread: the half-space code CONTACT, row 16.

The scene tread-rolling: a cylinder of 460 mm on a crown of 300 mm, 100 kN, friction 0.6, and the
creepage at which CONTACT finds a traction of 0.2 of the load (case 2 of its table).

A half-space has no radius. The wheel, which is pressed in by 0.05 mm, rolls as if its radius were
less by a third of that, which is a creepage of 4e-5 whatever the traction. So a driven wheel pulls
less than CONTACT says and a braked one more, and what they have in common is compared with it.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contact.theory.closed_forms import contact_modulus, hertz_ellipse
from tests.scripts import measured, numbers
from workflow import Scene, run

DATA = Path(__file__).parents[1] / "data"
CASE, RADIUS, CROWN, SPEED = 2, 0.46, 0.3, 40.0
TABLE, LINE = (
    np.genfromtxt(
        DATA / f"contact_tread_rolling_{name}.csv", delimiter=",", skip_header=1, names=True
    )
    for name in ("summary", "centreline")
)


def test_table_of_contact_is_hertz():
    """Its axes and largest pressure are those of Hertz for the scene's bodies, to 0.1 %."""
    modulus = contact_modulus(210e9, 0.3, 210e9, 0.3)
    for row in TABLE:
        hertz = hertz_ellipse(row["F_N"], RADIUS, CROWN, modulus)
        found = (1e-3 * row["a_mm"], 1e-3 * row["b_mm"], 1e6 * row["p0_MPa_CONTACT"])
        assert found == pytest.approx((hertz.a, hertz.b, hertz.p0), rel=1e-3)


CREEPAGE = TABLE[TABLE["case"] == CASE]["creepage_cksi"][0]


@pytest.fixture(scope="module")
def example(tmp_path_factory) -> tuple[str, dict, Path]:
    """What the example of the driven wheel prints, what its run is measured by, its figure."""
    figure = tmp_path_factory.mktemp("tread") / "tread.png"
    return *measured("tread_rolling.py", "--out", figure, by=roll), figure


@pytest.fixture(scope="module")
def rolled(example, tmp_path_factory) -> dict[int, dict]:
    """The scene driven (1) and braked (-1)."""
    spin, shift = [0.0, SPEED * (1 - CREEPAGE) / RADIUS, 0.0], [1e-5, 0.0, 0.0]
    changes = {"driven.wheel.spin": spin, "driven.wheel.shift": shift, "output.fields": False}
    braked = Scene.load("tread-rolling", **changes)
    return {1: example[1], -1: roll(braked, tmp_path_factory.mktemp("braked"))}


def roll(scene: Scene, folder: Path, also: Callable[[Any], Any] = lambda model: None) -> dict:
    """Return forces of the last tenth of the way and the nodes of the centre line at its end."""
    over = scene.driven["wheel"].spin[1] * RADIUS / SPEED - 1
    assert abs(over) == pytest.approx(CREEPAGE)
    way = np.sign(over)
    rows, kept = [], []

    def watch(model):
        also(model)
        pair = model.pairs["touch"]
        kept[:] = [pair]
        rows.append((pair.normal_force, way * pair.tangential_force[0]))

    history = run(scene, folder, watch=watch, quiet=True).history
    steady, before = (np.mean(rows[-k * len(rows) // 10 :][: len(rows) // 10], 0) for k in (1, 2))
    touch = kept[0].footprint(stick_tolerance=0.02)
    middle = touch.position[:, 1] < 1e-9
    x = touch.position[:, 0] - touch.normal_force @ touch.position[:, 0] / touch.normal_force.sum()
    whole = np.where(middle, 1, 2) * touch.area  # half of the contact is modelled
    return {
        "load": 2 * steady[0],
        "traction": steady[1] / steady[0],
        "drift": abs(steady[1] / before[1] - 1),
        "stick": whole[touch.stick].sum() / whole.sum(),
        "x": x[middle],
        "p": touch.pressure[middle],
        "q": way * touch.tangential_force[middle, 0] / touch.area[middle],
        "balance": np.abs(history["balance_error"]).max(),
    }


def off_line(found: dict, nodal: str, column: str) -> float:
    """Error along the centre line but for its ends, rms over the largest value."""
    line = LINE[LINE["case"] == CASE]
    x = 1e3 * found["x"]
    inner = np.abs(x) < 0.9 * line["x_mm"].max()
    off = 1e-6 * found[nodal] - np.interp(x, line["x_mm"], line[column])
    return float(np.sqrt(np.mean(off[inner] ** 2)) / line[column].max())


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.parametrize("way", [1, -1], ids=["driven", "braked"])
def test_row_16_tread_against_contact(rolled, way):
    """1.2 mm (a/6): pressure and shear on the centre line 3 % and 6 % rms; stick area 0.04.

    100 kN to 0.5 %; steady to 1 %; ledger 1e-3. A tenth of the line at either end, where a node
    has a part of its area outside, is left out.
    """
    found, row = rolled[way], TABLE[TABLE["case"] == CASE]
    assert found["load"] == pytest.approx(row["F_N"][0], rel=5e-3)
    assert off_line(found, "p", "p_MPa") < 0.03
    assert off_line(found, "q", "q_x_MPa") < 0.06
    assert found["stick"] == pytest.approx(row["stick_area_fraction"][0], abs=0.04)
    assert found["drift"] < 0.01
    assert found["balance"] < 1e-3


@pytest.mark.long
@pytest.mark.slow
def test_row_16_tread_traction(rolled):
    """Traction for the creepage: mean of driven and braked 1 %, each 4 %.

    Half of the difference is the creepage of a free wheel: a third of what the wheel is pressed in,
    over its radius, to 15 %.
    """
    driven, braked = (rolled[way]["traction"] for way in (1, -1))
    exact = TABLE[TABLE["case"] == CASE]["traction_coeff"][0]
    assert (driven + braked) / 2 == pytest.approx(exact, rel=0.01)
    assert (driven, braked) == pytest.approx((exact, exact), rel=0.04)
    low, high = TABLE[:2]
    slope = (high["traction_coeff"] - low["traction_coeff"]) / (
        high["creepage_cksi"] - low["creepage_cksi"]
    )
    modulus = contact_modulus(210e9, 0.3, 210e9, 0.3)
    pressed = hertz_ellipse(1e5, RADIUS, CROWN, modulus).approach / 2
    assert (braked - driven) / 2 / slope == pytest.approx(pressed / 3 / RADIUS, rel=0.15)


@pytest.mark.long
@pytest.mark.slow
def test_tread_rolling_ends_on_contact(example):
    """The example: traction 4 %, stick area 0.04 of the patch; a figure."""
    text, _, figure = example
    found, exact, _ = numbers(text, "traction")
    assert found == pytest.approx(exact, rel=0.04)
    found, exact = numbers(text, "stick")
    assert found == pytest.approx(exact, abs=0.04)
    assert figure.stat().st_size > 10_000
