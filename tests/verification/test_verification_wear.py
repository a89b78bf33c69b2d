# SPDX-License-Identifier: LGPL-3.0-or-later
"""Verification row 40: friction work per way rolled is creep force times creepage, T-gamma.

Creepage counts from pure rolling. A roller that is pressed in rolls as if its radius were a little
less, which a creepage by its drawn radius does not know: that is 1.2 % of the creepage in carter,
4 % in tread-rolling, of the same sign driven and braked. So both are run, and their mean has none
of it. What the bodies store as the contact travels through them, 1.3 % in carter, is counted; no
material damping, and contact springs that give nothing away (`implicit-penalty`).
"""

from pathlib import Path

import numpy as np
import pytest

from workflow import Scene, run
from workflow.results.record import Record
from workflow.results.samples import read
from workflow.theory.rolling import steady

STIFF = {"contacts.touch.method": "implicit-penalty", "contacts.touch.penalty": 30.0}
LAST = 0.2  # of the way


def undamped(name: str, **changes) -> Scene:
    scene = Scene.load(name, **STIFF, **{"output.fields": False}, **changes)
    return scene.with_(**{f"bodies.{body}.stiffness_damping": 0.0 for body in scene.bodies})


def carter(way: int) -> Scene:
    """The scene, driven (1) or braked (-1) with 7.6e-4."""
    spin = [0.0, 80.0 * (1 + way * 7.5875e-4) / 0.46, 0.0]
    return undamped("carter", **{"driven.roller.spin": spin, "output.sample_interval": 1e-6})


def tread(way: int) -> Scene:
    """The scene, driven (1) or braked (-1) with 1.545e-3."""
    changes = {
        "driven.wheel.spin": [0.0, 40.0 * (1 + way * 1.545e-3) / 0.46, 0.0],
        "driven.wheel.shift": [-1e-5 * way, 0.0, 0.0],
        "output.sample_interval": 2e-6,
    }
    return undamped("tread-rolling", **changes)


def work(scene: Scene, folder: Path) -> tuple[float, float, float]:
    """Heat and stored energy over the way of the last fifth [N], force times creepage [N].

    The force is the mean of every step; the creepage is the one that is imposed.
    """
    run(scene, folder, quiet=True)
    record, samples = Record(folder), read(folder)
    rolling = steady(record)
    assert rolling is not None and samples is not None
    (pair,), t = samples.pairs.values(), record.history["t"]
    given = np.cumsum(pair.tangential[:, :2] @ rolling.creepage) * samples.interval
    given = np.abs(np.interp(t, samples.t + samples.interval / 2, given))
    last = t >= (1 - LAST) * t[-1]
    stored = record.history["internal"] + record.history["contact"]
    heat, kept, force = (
        np.polyfit(t[last], x[last], 1)[0]
        for x in (record.history["friction_dissipation"], stored, given)
    )
    return heat / abs(rolling.speed), kept / abs(rolling.speed), force


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scene", "single"),
    [
        pytest.param(carter, 0.02, id="carter"),
        pytest.param(tread, 0.07, id="tread", marks=pytest.mark.long),
    ],
)
def test_row_40_friction_work_is_force_times_creepage(tmp_path, scene, single):
    """Mean of driven and braked: 1 %. Each by itself within what its drawn radius is off by."""
    off = []
    for way in (1, -1):
        heat, kept, force = work(scene(way), tmp_path / f"{way}")
        assert heat > 0 and abs(kept) < 0.05 * heat
        off.append((heat + kept) / force - 1)
    assert off[0] < 0 < off[1] and max(map(abs, off)) < single
    assert np.mean(off) == pytest.approx(0, abs=0.01)
