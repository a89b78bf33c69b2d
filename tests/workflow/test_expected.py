# SPDX-License-Identifier: LGPL-3.0-or-later
"""What theory expects of a run: every quantity of every verification scene, and when none."""

import csv
import json
import shutil
from html import escape
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from forms.elements import LAWS
from workflow import Scene, run
from workflow.model.geometry import export
from workflow.results.record import Record
from workflow.simulation import guards
from workflow.theory import expected as theory
from workflow.theory import rolling
from workflow.theory.expected import expected
from workflow.theory.quantity import Expected

E, NU, RHO = 210e9, 0.3, 7800.0
C = np.sqrt(E / RHO)  # of waves in a bar [m/s]
STAR = E / (2 * (1 - NU**2))  # of two bodies of steel [Pa]

# scene: changes to a fast size, and each quantity with what it may be off by
BAR = {
    "contact time, 2 L/c": 0.015,  # half an output at either end
    "contact force on the plateau, ρ c v A": 0.005,
    "velocity after the rebound": 0.01,
    "kinetic energy after the rebound": 0.01,
    "largest penetration": 1e-6,
}
HERTZ = {
    "nodal pressure off Hertz's, rms over p0": 0.06,
    "largest pressure p0, node in the middle": 0.03,
    "half axis a along x, from moments": 0.03,
    "half axis b along y, from moments": 0.03,
}
COARSE = HERTZ | {  # three cells in a half axis across
    "largest pressure p0, node in the middle": 0.08,
    "half axis a along x, from moments": 0.05,
    "half axis b along y, from moments": 0.08,
}
LOADED = {"normal force": 1e-3, "approach": 0.05}
POWER = "power of friction, force × creepage × speed"
FAST = {
    "bar-impact": ({"mesh.size": 2.5e-3}, BAR),
    "bar-wave": (
        {"mesh.size": 2.5e-3},
        {
            "frequency, c/4L": 0.002,
            "displacement of the free end after L/c": 0.015,
            "energy at the end": 0.013,  # half a cell at the clamp has no speed
        },
    ),
    "two-bars": (
        {},
        {
            "contact stress on the plateau, ρ c v/2": 0.005,
            "contact time, 2 L/c": 0.03,
            "velocity of the upper bar afterwards": 0.005,
            "velocity of the lower bar afterwards": 0.005,
            "momentum afterwards": 1e-6,  # fields are written in single precision
        },
    ),
    "contact-patch": (
        {},
        {
            "nodal pressure off the uniform one, rms over it": 0.03,
            "largest nodal pressure": 0.11,
            "normal force": 1e-5,
        },
    ),
    "sliding-block": (
        {"mesh.size": 5e-3, "mesh.base_size": 6e-3},
        {
            "friction force": 0.005,
            "deceleration": 0.005,
            "time until it stops": 0.01,
            "way until it stops": 0.01,
            "heat of friction": 0.01,
        },
    ),
    "slip-weakening": (
        {"mesh.size": 5e-3},
        {"heat of friction for the slip": 0.005, "velocity for the slip": 0.005},
    ),
    "hertz": ({"mesh.size": 1e-3}, HERTZ | LOADED),
    "ball-on-block": ({"mesh.size": 1.2e-4}, HERTZ | LOADED),
    "hertz-cylinder": (
        {"mesh.size": 4e-4},
        {k: v for k, v in HERTZ.items() if "half axis b" not in k}
        | {"normal force": 1e-3, "approach of points 2 a from the contact": 0.02},
    ),
    "hertz-ellipse": ({"mesh.size": 1.4e-3}, HERTZ | LOADED),
}
SLOW = {
    "stick-slip": (
        {
            "springs.0.stiffness": [2e4, 0.0, 0.0],
            "springs.0.velocity": [2.0, 0.0, 0.0],
            "contacts.sole.friction.decay": 0.012,
            "time.end": 7e-3,
        },
        {
            "period between jumps": 0.02,
            "largest pull of the spring": 0.02,
            "largest friction force": 0.005,
        },
    ),
    "sphere-impact": (
        {"mesh.size": 2e-4},
        {
            "contact time": 0.03,
            "largest force": 0.04,
            "velocity after the rebound": 0.01,
            "kinetic energy after the rebound": 0.01,
        },
    ),
    "cattaneo-mindlin": (
        {"mesh.size": 3.6e-4, "output.fields": False},
        {
            "nodal shear off Cattaneo's, rms over its peak": 0.1,
            "radius of the stick zone": 0.2,  # half a cell of a radius of 2.5 cells
        }
        | HERTZ,
    ),
    "carter": (
        {"mesh.size": 4.5e-4, "output.fields": False},
        {
            "creepage for the traction": 0.04,
            "tangential force at the creepage": 0.03,
            "width of the stick zone": 0.16,  # a cell
            "nodal shear off Carter's, rms over its peak": 0.1,
            POWER: 0.05,
        }
        | {k: v for k, v in HERTZ.items() if "half axis b" not in k},
    ),
    "kalker-creepage": (
        {"mesh.size": 8e-4, "mesh.base_size": 8.5e-4, "output.fields": False},
        {"longitudinal creep force, c11": 0.05, POWER: 0.1} | COARSE,
    ),
    "tread-rolling": (
        {"mesh.size": 1.8e-3, "mesh.base_size": 1.9e-3, "output.fields": False},
        {
            "traction over normal force": 0.05,
            "share of the area that sticks": 0.06,
            POWER: 0.1,
        }
        | COARSE,
    ),
}
LONG = ("stick-slip", "carter", "kalker-creepage", "tread-rolling")  # other tests run them too
CASES = [pytest.param(name, *case, id=name) for name, case in FAST.items()]
CASES += [
    pytest.param(
        name, *case, id=name, marks=[pytest.mark.slow] + [pytest.mark.long] * (name in LONG)
    )
    for name, case in SLOW.items()
]


def load(name: str, changes: dict) -> Scene:
    """A built-in scene with changes; ``springs.0.`` changes the first of a list."""
    tables = Scene.load(name).tables()
    for key, value in changes.items():
        *path, last = key.split(".")
        at = tables
        for word in path:
            at = at[int(word)] if isinstance(at, list) else at.setdefault(word, {})
        if value is None:
            at.pop(last, None)
        else:
            at[last] = value
    return Scene.check(tables)


def named(found: list[Expected]) -> dict[str, Expected]:
    return {answer.quantity: answer for answer in found}


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """Result folders of scenes at a fast size, each run when it is first asked for."""
    root = tmp_path_factory.mktemp("runs")

    def folder(name: str, changes: dict | None = None, tag: str = "") -> Path:
        path = root / (name + tag)
        if not path.exists():
            keys = (FAST | SLOW)[name][0] if changes is None else changes
            run(load(name, keys), path, quiet=True)
        return path

    return folder


@pytest.mark.parametrize(("name", "changes", "tolerances"), CASES)
def test_every_quantity_of_a_scene(folders, name, changes, tolerances):
    """All that theory gives for a verification scene, within its tolerance at a fast size."""
    folder = folders(name)
    found = named(expected(Record(folder)))
    assert set(found) == set(tolerances)
    for quantity, answer in found.items():
        assert abs(answer.error) <= tolerances[quantity], answer
        assert answer.source and answer.unit
    summary = json.loads((folder / "summary.json").read_text("utf-8"))
    keys = {"quantity", "unit", "value", "expected", "source", "error"}
    for told, answer in zip(summary["expected"], found.values(), strict=True):
        assert told.keys() == keys and told["quantity"] == answer.quantity
        assert told["error"] == pytest.approx(answer.error)


def test_a_changed_bar_gets_its_own_answers(folders):
    """2 m/s, a bar of 60 mm, a wall 10 µm away: ρ c v A, 2L/c and v, written out here."""
    keys = {"mesh.size": 2.5e-3, "mesh.length": 0.06, "bodies.bar.velocity": [-2.0, 0.0, 0.0]}
    keys |= {"contacts.wall.target.origin": [-1e-5, 0.0, 0.0], "output.sample_interval": 1e-9}
    found = named(expected(Record(folders("bar-impact", keys, "-other"))))
    for quantity, value in (
        ("contact time, 2 L/c", 2 * 0.06 / C),
        ("contact force on the plateau, ρ c v A", RHO * C * 2.0 * 0.005**2),
        ("velocity after the rebound", 2.0),
    ):
        assert found[quantity].expected == pytest.approx(value)
        assert found[quantity].error == pytest.approx(0, abs=0.02)


def test_a_changed_load_gets_its_own_answers(folders):
    """Half the load on a sphere of twice the radius: a = (3PR/4E*)^(1/3), p0 = 3P/2πa²."""
    keys = {"mesh.size": 1e-3, "mesh.radius": 0.2, "loads.0.traction": [0.0, 0.0, -4e6]}
    found = named(expected(Record(folders("hertz", keys, "-other"))))
    P = 4e6 * 0.04**2
    a = (0.75 * P * 0.2 / STAR) ** (1 / 3)
    assert found["half axis a along x, from moments"].expected == pytest.approx(a)
    p0 = found["largest pressure p0, node in the middle"]
    assert p0.expected == pytest.approx(1.5 * P / (np.pi * a**2))
    assert found["normal force"].expected == pytest.approx(P / 4)
    assert p0.error == pytest.approx(0, abs=0.03)


def test_a_mesh_file_gets_the_answers_of_its_shape(folders, tmp_path):
    """The sphere of ``hertz`` read from a file: same answers, its radius measured on the nodes."""
    made = named(expected(Record(folders("hertz"))))
    scene = Scene.load("hertz", **FAST["hertz"][0])
    export(scene, tmp_path / "sphere.msh")
    mesh = {"kind": "file", "path": str(tmp_path / "sphere.msh"), "size": scene.mesh.size}
    run(Scene.check(scene.tables() | {"mesh": mesh}), tmp_path / "run", quiet=True)
    read = named(expected(Record(tmp_path / "run")))
    assert set(read) == set(made)
    for quantity, answer in made.items():
        assert read[quantity].expected == pytest.approx(answer.expected, rel=1e-9)
        assert read[quantity].value == pytest.approx(answer.value, rel=1e-6)


OTHER = {"law": "orthotropic", "youngs_moduli": [E] * 3, "poisson_ratios": [NU] * 3}
OTHER |= {"shear_moduli": [8e10] * 3, "density": RHO}
FAILING = [
    ("bar-impact", {"bodies.bar.stiffness_damping": 1e-8}),
    ("bar-impact", {"bodies.bar.mass_damping": 10.0}),
    ("bar-impact", {"contacts.wall.damping": 0.1}),
    ("bar-impact", {"bodies.bar.velocity": [-1.0, 0.1, 0.0]}),
    ("bar-impact", {"bodies.bar.velocity": [1.0, 0.0, 0.0]}),
    ("bar-impact", {"bodies.bar.velocity": [-100.0, 0.0, 0.0]}),  # strain of 2 %
    ("bar-impact", {"bodies.bar.material": OTHER}),
    ("bar-impact", {"mesh.length": 0.04}),
    ("bar-impact", {"gravity": [0.0, 0.0, -9.81]}),
    ("bar-impact", {"supports": [{"surface": "ymin", "directions": ["y"]}]}),
    ("bar-impact", {"contacts.wall.target.normal": [1.0, 0.5, 0.0]}),
    ("bar-wave", {"absorbing": [{"surface": "xmax", "waves": "bar"}]}),
    ("bar-wave", {"supports": [{"surface": s, "directions": ["x"]} for s in ("xmin", "xmax")]}),
    ("two-bars", {"bodies.base.material.density": 2700.0}),
    ("two-bars", {"mesh.base": [0.005, 0.005, 0.04]}),
    ("contact-patch", {"mesh.base": [0.03, 0.02, 0.01]}),
    ("contact-patch", {"supports.1.surface": "xmax", "supports.0.directions": ["x"]}),
    ("sliding-block", {"contacts.face.friction": 0.0}),
    ("sliding-block", {"loads.0.traction": [1e5, 0.0, -10e6]}),
    ("sliding-block", {"mesh.base": [0.02005, 0.03, 0.01]}),
    ("sliding-block", {"supports.0.directions": ["z"]}),
    (
        "sliding-block",
        {
            "contacts.face.friction": {
                "law": "tabulated",
                "slip_rate": [0.0, 1.0],
                "coefficient": [0.3, 0.2],
            }
        },
    ),
    ("slip-weakening", {"loads.0.traction": [9e6, 0.0, -20e6]}),
    ("slip-weakening", {"contacts.sole.friction.memory": None}),
    ("hertz", {"bodies.sphere.material": OTHER}),
    ("hertz", {"bodies.flat.material.youngs_modulus": 70e9}),  # with friction
    ("hertz", {"supports.0.directions": ["y"]}),
    ("hertz", {"loads.0.traction": [0.0, 0.0, -7.69e8]}),  # not small beside the bodies
    ("hertz", {"gravity": [0.0, 0.0, -9.81]}),
]


@pytest.mark.parametrize(("name", "changes"), FAILING)
def test_nothing_where_an_assumption_fails(folders, name, changes):
    """The same results under a scene that the closed form is not of: no answers."""
    record = Record(folders(name))
    record.scene = load(name, FAST[name][0] | changes).tables()
    assert expected(record) == []


def test_slow_scenes_under_other_scenes(tmp_path):
    """Motion of bodies that closed forms of impact and rolling are not of, asked before any run."""
    from types import SimpleNamespace

    from workflow.theory import blocks, smooth

    def found(function, name, **changes):
        history = {"t": np.linspace(0, 80e-6, 9), "kinetic": np.full(9, 1.09e-3)}
        checked = load(name, {k.replace("__", "."): v for k, v in changes.items()})
        return function(SimpleNamespace(checked=checked, history=history))

    assert found(smooth.strike, "sphere-impact") is not None
    assert found(smooth.strike, "sphere-impact", bodies__ram__mass_damping=10.0) is None
    assert found(smooth.strike, "sphere-impact", mesh__crown=0.03) is None
    assert found(smooth.strike, "sphere-impact", supports=[]) is None
    assert found(smooth.strike, "sphere-impact", bodies__ram__velocity=[0.1, 0.0, -0.5]) is None
    jumps = [
        blocks.jumps(load("stick-slip", changes))
        for changes in (
            {},
            {"springs.0.velocity": [40.0, 0.0, 0.0]},  # pressed while it slips
            {"contacts.sole.friction.decay": 0.001},  # lets go piece by piece
            {"contacts.sole.friction.decay": 1.0},
            {"springs.0.damping": [1.0, 0.0, 0.0]},
        )
    ]
    assert jumps[0] is not None and jumps[1:] == [None] * 4
    creepage, speed = rolling.imposed(load("carter", {}))
    assert speed == 80.0 and creepage == pytest.approx([1 - 174.045 * 0.46 / 80, 0.0])
    lateral = {"driven.rail.velocity": [-40.0, -0.024, 0.0]}
    assert rolling.imposed(load("kalker-creepage", lateral))[0][1] == pytest.approx(6e-4)
    assert rolling.imposed(load("cattaneo-mindlin", {})) is None


def test_too_short_a_run_gets_none(tmp_path):
    """A bar that is stopped on the wall, a block that still slides, a wheel that starts to roll."""
    short = {"mesh.size": 2.5e-3, "time.end": 8e-6, "time.output_interval": 2e-6}
    assert run(load("bar-impact", short), tmp_path / "bar", quiet=True).summary["expected"] == []
    short |= {"mesh.size": 5e-3, "mesh.base_size": 6e-3}
    assert run(load("sliding-block", short), tmp_path / "b", quiet=True).summary["expected"] == []


def test_without_fields_what_they_tell_is_left_out(tmp_path, folders):
    """The same values of the rest."""
    keys = FAST["bar-impact"][0] | {"output.fields": False}
    less = named(expected(Record(folders("bar-impact", keys, "-less"))))
    more = named(expected(Record(folders("bar-impact"))))
    assert more.keys() - less.keys() == {"velocity after the rebound"}
    assert all(less[k] == more[k] for k in less)


def test_resumed_run_gets_the_same(tmp_path, folders):
    """A bar that goes on from a checkpoint in the middle of the impact."""
    keys = FAST["bar-impact"][0] | {"output.checkpoint_steps": 200}
    half = load("bar-impact", keys | {"time.end": 3e-5})
    run(half, tmp_path / "bar", quiet=True)
    summary = run(load("bar-impact", keys), tmp_path / "bar", quiet=True, resume=True).summary
    whole = named(expected(Record(folders("bar-impact"))))
    assert {a["quantity"]: a["value"] for a in summary["expected"]} == pytest.approx(
        {k: a.value for k, a in whole.items()}
    )


def test_stopped_run_and_laws_of_ones_own_get_none(tmp_path):
    """A guard stops the run; a law that the scene file does not tell."""
    keys = {"mesh.size": 5e-3, "output.fields": False}
    with pytest.raises(guards.GuardError):
        run(load("bar-impact", keys | {"guards.energy_error": 1e-12}), tmp_path / "s", quiet=True)
    assert json.loads((tmp_path / "s" / "summary.json").read_text())["expected"] == []
    law = {"bar": LAWS["neo-hookean"]}
    own = run(load("bar-impact", keys), tmp_path / "o", quiet=True, laws=law)
    assert own.summary["own_laws"] and own.summary["expected"] == []


def test_half_written_folder_is_safe(tmp_path, folders):
    """Killed before the first output, and before the last: no answers, or those it reached."""
    folder = Path(shutil.copytree(folders("bar-impact"), tmp_path / "killed"))
    (folder / "summary.json").unlink()
    import h5py

    with h5py.File(folder / "results.h5", "r+") as file:
        for column in file["history"].values():
            column.resize(20, axis=0)
    assert expected(Record(folder)) == []
    with h5py.File(folder / "results.h5", "r+") as file:
        for name in list(file["history"]):
            del file["history"][name]
    assert expected(Record(folder)) == []


def test_an_error_in_the_theory_is_told_and_ends_no_run(tmp_path, monkeypatch):
    """It stands in the log with its trace."""

    def wrong(record):
        raise ZeroDivisionError("of a theory")

    monkeypatch.setattr(theory, "theories", lambda scene: (wrong,))
    result = run(load("bar-wave", {"time.end": 2e-6}), tmp_path / "w", quiet=True)
    assert result.summary["status"] == "done" and result.summary["expected"] == []
    log = (tmp_path / "w" / "run.log").read_text("utf-8")
    assert "theory: no answers" in log and "ZeroDivisionError: of a theory" in log


def test_terminal_and_report_show_the_table(folders, capsys, monkeypatch):
    """Every quantity, its values and error, and where the answers are from."""
    from workflow.cli.main import tables
    from workflow.results.table import show

    folder = folders("hertz")
    summary = json.loads((folder / "summary.json").read_text("utf-8"))
    monkeypatch.setenv("COLUMNS", "160")
    show(tables(summary, folder), Console())
    shown = capsys.readouterr().out
    pytest.importorskip("jinja2")
    from workflow.report.page import contents, render

    page = render(contents(Record(folder), []))
    for answer in summary["expected"]:
        assert answer["quantity"] in shown and f"{answer['expected']:.5g}" in shown
        assert escape(answer["quantity"]) in page and escape(answer["source"]) in page
    assert "Johnson, Contact Mechanics" in shown
    show(tables(summary | {"expected": []}, folder), Console())
    assert "theory" not in capsys.readouterr().out


def test_cases_of_contact_are_those_of_its_table():
    """The five cases are the rows of the table; between them the traction grows evenly."""
    path = Path(__file__).parents[1] / "data" / "contact_tread_rolling_summary.csv"
    rows = csv.DictReader(path.read_text("utf-8").splitlines()[1:])
    keys = ("mu", "traction_coeff", "creepage_cksi", "stick_area_fraction")
    table = sorted(tuple(float(row[k]) for k in keys) for row in rows)
    assert table == sorted(tuple(map(float, case)) for case in rolling.CASES)
    scaled = rolling.SCALE * rolling.CASES[:, 2] / rolling.CASES[:, 0]
    assert (np.diff(scaled) > 0).all()
    shares = [rolling.traction_share(float(s)) for s in scaled]
    assert shares == pytest.approx(rolling.CASES[:, 1] / rolling.CASES[:, 0])
    fine = [rolling.traction_share(float(s)) for s in np.linspace(scaled[0], scaled[-1], 50)]
    assert (np.diff(fine, 2) < 1e-12).all()
