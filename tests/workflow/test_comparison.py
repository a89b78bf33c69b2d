# SPDX-License-Identifier: LGPL-3.0-or-later
"""Runs side by side: errors against closed forms, the front, the figures that compare."""

import json

import numpy as np
import pytest

from contact.theory.closed_forms import contact_modulus, hertz_sphere
from workflow import Scene, run
from workflow.results.record import Record
from workflow.study import table
from workflow.theory.expected import expected


def test_front_holds_what_nothing_beats():
    """Of five runs three are on the front; the shipped one is told what beats it."""
    cost_error = {"a": (1, 0.5), "b": (2, 0.1), "c": (3, 0.2), "d": (4, 0.01), "e": (5, 0.01)}
    rows = [
        {"run": n, "group": "", "label": n, "status": "done"}
        | {"processor_seconds": float(c), "closed_form_error": e}
        | ({} if n == "c" else {"mesh.size": c})
        for n, (c, e) in cost_error.items()
    ]
    assert [row["run"] for row in table.front(rows)] == ["a", "b", "d"]
    assert table.verdicts(rows) == {
        "": "a, b, d; c is not: b has an error of 10.00% for 20.00% in 0.67 of the cost"
    }


def test_error_of_a_bar_is_that_of_its_force(tmp_path):
    """Row 8, from forces of every step: what a watcher of the same run finds, to a step."""
    keys = {"output.fields": False, "output.sample_interval": 1e-9}
    scene = Scene.load("bar-impact", **keys)
    seen = []
    result = run(
        scene,
        tmp_path / "bar",
        quiet=True,
        watch=lambda m: seen.append((m.state.t, m.pairs["wall"].normal_force)),
    )
    t, force = np.array(seen).T
    touching = t[force > force[force > 0].mean() / 2]
    stay = 2 * 0.1 / (210e9 / 7800) ** 0.5
    found = expected(Record(tmp_path / "bar"))[0]
    assert found.quantity == "contact time, 2 L/c" and found.expected == pytest.approx(stay)
    assert 0 < found.error < 0.01
    step = result.summary["dt"] / stay
    assert found.error == pytest.approx(np.ptp(touching) / stay - 1, abs=step)


def test_error_of_hertz_is_that_of_his_pressure(tmp_path):
    """Row 13 at 0.5 mm: 2 to 4 % rms, computed here from the nodes."""
    run(
        Scene.load("hertz", **{"mesh.size": 5e-4, "output.fields": False}),
        tmp_path / "h",
        quiet=True,
    )
    record = Record(tmp_path / "h")
    patch = record.contacts["touch"].patches[-1][1]
    modulus = contact_modulus(210e9, 0.3, 210e9, 0.3)
    hertz = hertz_sphere(4 * patch.normal_forces.sum(), 0.1, modulus)
    r = np.hypot(*patch.position[:, :2].T)
    off = (patch.pressure - hertz.pressure(r))[r < 0.7 * hertz.a] / hertz.p0
    found = expected(record)[0]
    assert found.quantity == "nodal pressure off Hertz's, rms over p0"
    assert found.error == pytest.approx(np.sqrt(np.mean(off**2)), rel=1e-3)


def test_comparisons_are_drawn_from_the_folder(tmp_path):
    """Two sizes of a sphere on a flat and a run that is not there: three rows, three figures."""
    pytest.importorskip("matplotlib")
    from workflow.study.figures import draw

    runs = {}
    for size in (2e-3, 1e-3):
        folder = tmp_path / "runs" / str(size)
        run(Scene.load("hertz", **{"mesh.size": size, "output.fields": False}), folder, quiet=True)
        (folder / "done").touch()
        about = {"group": "", "label": f"{1e3 * size:g} mm", "scene": "hertz", "ranks": 1}
        runs[str(size)] = about | {"changes": {"mesh.size": size}}
    runs["missing"] = dict(runs["0.001"])
    asked = ["convergence", "error_against_time", "shear_of_patches"]
    (tmp_path / "study.json").write_text(json.dumps({"compare": asked, "runs": runs}))
    rows = table.rows(tmp_path)
    assert [row["status"] for row in rows] == ["done", "done", "to do"]
    assert rows[1]["closed_form_error"] < rows[0]["closed_form_error"]
    paths = draw(tmp_path, rows)
    assert [path.stem for path in paths] == asked
    assert all(path.stat().st_size > 10_000 for path in paths)
