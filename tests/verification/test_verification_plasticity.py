# SPDX-License-Identifier: LGPL-3.0-or-later
"""Verification rows 31, 33, 34 and 36: bodies that yield."""

import json

import h5py
import numpy as np
import pytest

from meshes.quality import cell_volumes
from workflow import Scene, SceneError, run
from workflow.results.passes import rows_of
from workflow.results.record import Record
from workflow.simulation.guards import GuardError
from workflow.theory.expected import expected
from workflow.theory.yielding_sphere import first_yield

E, Y, SLOPE, RHO = 210e9, 500e6, 21e9, 7800.0


def wall_stress(speed: float) -> float:
    """Stress behind an elastic wave of the yield stress and a plastic one [Pa]."""
    return Y + RHO * np.sqrt(SLOPE / RHO) * (speed - Y / np.sqrt(E * RHO))


@pytest.mark.parametrize("speed", [20.0, 30.0])
@pytest.mark.parametrize("size", [2.5e-3, pytest.param(6.25e-4, marks=pytest.mark.long)])
def test_row_31_yielding_bar_on_a_wall(run_scene, speed, size):
    """597.9 MPa at 20 m/s, 725.8 MPa at 30 m/s, to 1 %; the scene says so; energy within 2e-3."""
    keys = {"mesh.size": size, "bodies.bar.velocity": [-speed, 0.0, 0.0]}
    folder = run_scene("plastic-bar", **keys)
    (stress,) = expected(Record(folder))
    assert stress.expected == pytest.approx({20.0: 597.9e6, 30.0: 725.8e6}[speed], rel=1e-4)
    assert stress.expected == pytest.approx(wall_stress(speed), rel=1e-6)
    assert stress.value == pytest.approx(stress.expected, rel=0.01)
    with h5py.File(folder / "results.h5") as file:
        history = {name: data[:] for name, data in file["history"].items()}
    assert np.abs(history["balance_error"]).max() < 2e-3
    assert history["plastic_dissipation"][-1] > history["hardening"][-1] > 0
    assert (np.diff(history["plastic_dissipation"]) >= -1e-12).all()


ELEMENTS = [("full", "small-strain"), ("full", "total-lagrangian"), ("selective", "small-strain")]
ELEMENTS += [("selective", "total-lagrangian"), ("one-point", "small-strain")]
ELEMENTS += [("one-point", "total-lagrangian")]


@pytest.mark.parametrize(("element", "kinematics"), ELEMENTS)
def test_row_31_elements_and_kinematics(run_scene, element, kinematics):
    """Every element and strain that a law with a memory has: the wall stress to 1 %."""
    keys = {"mesh.size": 2.5e-3, "bodies.bar.element": element}
    folder = run_scene("plastic-bar", **keys, **{"bodies.bar.kinematics": kinematics})
    (stress,) = expected(Record(folder))
    assert stress.value == pytest.approx(wall_stress(20.0), rel=0.01)


def test_row_36_the_ledger_closes_with_the_step(run_scene):
    """Plastic work in the ledger: 7e-4 at the shipped step, 2e-4 at half of it on the same wall.

    A contact spring is ``penalty m / dt²``: a quarter of the penalty is the same spring.
    """
    errors = []
    for keys in ({}, {"time.safety": 0.25, "contacts.wall.penalty": 0.075}):
        folder = run_scene("plastic-bar", **{"mesh.size": 2.5e-3}, **keys)
        with h5py.File(folder / "results.h5") as file:
            errors.append(float(np.abs(file["history/balance_error"][:]).max()))
    assert errors[0] < 1e-3
    assert errors[1] < 0.4 * errors[0]


def test_an_elastic_bar_of_plastic_steel_is_an_elastic_bar(run_scene):
    """Below 12.35 m/s nothing yields: the run is that of Hooke's law, but for round-off."""
    keys = {"mesh.size": 2.5e-3, "bodies.bar.velocity": [-10.0, 0.0, 0.0]}
    law = {"law": "hooke", "youngs_modulus": E, "poisson_ratio": 0.0, "density": RHO}
    plastic, elastic = (
        run_scene("plastic-bar", **keys, **own) for own in ({}, {"bodies.bar.material": law})
    )
    with h5py.File(plastic / "results.h5") as one, h5py.File(elastic / "results.h5") as other:
        assert one["history/plastic_dissipation"][-1] == 0.0
        assert "plastic_dissipation" not in other["history"]
        for name in ("kinetic", "internal", "wall_normal_force"):
            a, b = one[f"history/{name}"][:], other[f"history/{name}"][:]
            np.testing.assert_allclose(a, b, rtol=0, atol=1e-11 * np.abs(b).max())


def test_what_does_not_go_with_a_memory_is_refused():
    """Element, damping, precision and constants: the key, what it got, what it expects."""
    steel = Scene.load("plastic-bar").tables()["bodies"]["bar"]["material"]
    for keys, words in (
        ({"bodies.bar.stiffness_damping": 1e-9}, "bodies.bar.stiffness_damping = 1e-09"),
        ({"time.precision": "float32"}, "time.precision = 'float32': expected 'float64'"),
        ({"bodies.bar.material": steel | {"yield_stress": 0.0}}, "yield_stress = 0"),
        ({"bodies.bar.material": steel | {"yield_stress": 3e11}}, "less than Young's modulus"),
        ({"bodies.bar.material": steel | {"hardening_modulus": -1e9}}, "hardening_modulus"),
        ({"bodies.bar.material": steel | {"saturation_stress": 1e8}}, "both above 0, or neither"),
        ({"bodies.bar.material": steel | {"back_stresses": [{"recall": 3}]}}, "back_stresses.0"),
        ({"bodies.bar.material": steel | {"yield": 1e8}}, "unknown key"),
        ({"bodies.bar.material": steel | {"law": "j3"}}, "'j2'"),
    ):
        with pytest.raises(SceneError) as caught:
            Scene.load("plastic-bar", **keys)
        assert words in str(caught.value), caught.value


def test_a_law_that_finds_no_state_stops_the_run_with_its_place(tmp_path, monkeypatch):
    """One iteration of Newton's method at 300 m/s: cell and excess are told, outputs are kept."""
    from forms import plasticity

    monkeypatch.setattr(plasticity, "ITERATIONS", 1)
    steel = Scene.load("plastic-bar").tables()["bodies"]["bar"]["material"]
    steel |= {"saturation_stress": 900e6, "saturation_rate": 3000.0, "hardening_modulus": 0.0}
    keys = {"mesh.size": 2.5e-3, "bodies.bar.velocity": [-300.0, 0.0, 0.0]}
    scene = Scene.load("plastic-bar", **keys, **{"bodies.bar.material": steel})
    told = r"bodies.bar.material: .* xx = -0\.\d+, .* cell at \(.*\) m: .* beyond what it admits"
    with pytest.raises(GuardError, match=told):
        run(scene, tmp_path / "run", quiet=True)
    with h5py.File(tmp_path / "run" / "results.h5") as file:
        assert len(file["history/t"]) >= 1
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert "beyond what it admits" in summary["status"] and summary["steps"] > 0
    assert len(list(Record(tmp_path / "run").series("displacement"))) >= 1


@pytest.mark.mpi
def test_row_36_fields_and_history_of_what_yielded(command, run_scene, tmp_path):
    """Plastic strain by cell, its largest in the history, on 1 and 2 ranks alike."""
    keys = {"mesh.size": 2.5e-3, "time.end": 1e-5}
    serial, ranks = run_scene("plastic-bar", **keys), tmp_path / "two"
    words = [w for key, value in keys.items() for w in ("--set", f"{key}={value}")]
    command("run", "plastic-bar", "--out", ranks, "--ranks", 2, *words)
    found = []
    for folder in (serial, ranks):
        with h5py.File(folder / "fields.vtkhdf") as file, h5py.File(folder / "results.h5") as h5:
            strain = file["VTKHDF/CellData/equivalent_plastic_strain"][:]
            steps = int(file["VTKHDF/Steps"].attrs["NSteps"])
            largest = h5["history/bar_largest_plastic_strain"][:]
        cells = len(strain) // steps
        assert cells == 160 and steps == len(largest) == 11
        last = strain.reshape(steps, cells)[-1]
        assert 0.9 * largest[-1] < last.max() <= largest[-1] * (1 + 1e-6)
        assert (last == 0).sum() > cells / 2  # the plastic wave has not come far
        found.append(strain)
    np.testing.assert_allclose(found[1], found[0], rtol=0, atol=1e-6 * found[0].max())


def test_own_law_with_a_memory_runs_as_the_built_in_one(run_scene, tmp_path):
    """Linear hardening in ten lines of UFL, given from Python: the same history to round-off."""
    import ufl

    from forms.memory import MemoryLaw, Variable

    Y, H = 500e6, 23.333333e9

    def update(strain, old, steel):
        trial = 2 * steel.mu * ufl.dev(strain - old["plastic_strain"])
        size = ufl.sqrt(1.5 * ufl.inner(trial, trial) + 1e-9)
        beyond = size - Y - H * old["p"]
        dp = ufl.conditional(ufl.gt(beyond, 0), beyond / (3 * steel.mu + H), 0.0)
        plastic = old["plastic_strain"] + 1.5 * dp / size * trial
        return steel.stress(strain - plastic), {"plastic_strain": plastic, "p": old["p"] + dp}

    def energy(strain, now, steel):
        elastic = strain - now["plastic_strain"]
        return {
            "internal": ufl.inner(steel.stress(elastic), elastic) / 2,
            "heat": Y * now["p"],
            "hardening": H / 2 * now["p"] ** 2,
        }

    names = {"plastic_strain": Variable((3, 3), symmetric=True), "p": Variable()}
    elastic = {"law": "hooke", "youngs_modulus": E, "poisson_ratio": 0.0, "density": RHO}
    keys = {"mesh.size": 2.5e-3}
    scene = Scene.load("plastic-bar", **keys, **{"bodies.bar.material": elastic})
    law = MemoryLaw(lambda steel: names, update, energy)
    run(scene, tmp_path / "own", quiet=True, laws={"bar": law})
    built_in = run_scene("plastic-bar", **keys)
    with h5py.File(built_in / "results.h5") as one, h5py.File(tmp_path / "own/results.h5") as two:
        for name, other in (("plastic_dissipation", "heat"), ("internal", "internal")):
            a, b = one[f"history/{name}"][:], two[f"history/{other}"][:]
            np.testing.assert_allclose(a, b, rtol=0, atol=1e-9 * np.abs(a).max())


@pytest.mark.slow
@pytest.mark.parametrize("size", [8e-4, pytest.param(5.4e-4, marks=pytest.mark.long)])
def test_row_33_taylor_bar(run_scene, size):
    """21.425 mm long, 7.22 mm in radius at the face, to 1 %; the step falls to a tenth or less.

    The energy closes to 1e-3, and the volume, which flow keeps, to the compression of the centres.
    """
    folder = run_scene("taylor-bar", **{"mesh.size": size})
    length, radius = expected(Record(folder))
    assert length.expected == pytest.approx(21.425e-3) and radius.expected == pytest.approx(7.22e-3)
    for answer in (length, radius):
        assert answer.value == pytest.approx(answer.expected, rel=0.01)
    summary = json.loads((folder / "summary.json").read_text())
    changes = summary["step_changes"]
    assert changes[-1]["dt"] < 0.1 * changes[0]["dt_before"]
    with h5py.File(folder / "results.h5") as file:
        assert np.abs(file["history/balance_error"][:]).max() < 1e-3
    record = Record(folder)
    points, cells = record.body.points, record.body.cells
    volume = [cell_volumes(x, cells) for x in (points, points + record.displacement(80e-6))]
    assert volume[1].sum() == pytest.approx(volume[0].sum(), rel=5e-3)


@pytest.mark.slow
@pytest.mark.parametrize("size", [1.4e-4, pytest.param(7e-5, marks=pytest.mark.long)])
def test_row_34_flattened_sphere(run_scene, size):
    """P / P_c = 4.93 and 13.2 at 3 and 6 times the critical approach, to 5 %; slow to 2 %."""
    folder = run_scene("sphere-flattening", **{"mesh.size": size})
    three, six, kinetic = expected(Record(folder))
    assert three.expected == pytest.approx(4.93, abs=0.005)
    assert six.expected == pytest.approx(13.2, abs=0.05)
    assert three.value == pytest.approx(three.expected, rel=0.05)
    assert six.value == pytest.approx(six.expected, rel=0.05)
    assert 0 < kinetic.value < 0.02


def test_row_34_first_yield_of_the_fit_is_that_of_hertz():
    """P / P_c at the critical approach is 1 within the 3 % that the fit is off there itself."""
    steel = Scene.load("sphere-flattening").bodies["ball"].material
    approach, force = first_yield(steel, 0.01)
    modulus = 210e9 / 0.91
    assert approach == pytest.approx((np.pi * 0.577 * 2.8 * 2.3e9 / 2 / modulus) ** 2 * 0.01)
    assert force == pytest.approx(4 / 3 * modulus * np.sqrt(0.01 * approach**3))
    a = np.sqrt(0.01 * approach)  # mean pressure K H, as first yield is defined
    assert force / (np.pi * a**2) == pytest.approx(2 / 3 * 0.577 * 2.8 * 2.3e9, rel=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.93, 1.05])
def test_row_34_first_yield_under_a_sphere(resting, share):
    """Hertz: first yield at p₀ = 1.60 Y, 0.48 a below; statics yields at 0.93 of Y, not at 1.05.

    The sphere of `hertz` has a = 2 mm and p₀ = 3 P / (2 π a²) under 12.3 kN, cells of a/8.
    """
    pressure, a = 1.5 * 12.3e3 / (np.pi * 2e-3**2), 2e-3
    steel = {"law": "j2", "youngs_modulus": E, "poisson_ratio": 0.3, "density": RHO}
    steel |= {"yield_stress": share * pressure / 1.60, "hardening_modulus": 2e9}
    names = ("sphere", "flat")
    model = resting("hertz", **{f"bodies.{name}.material": steel for name in names})
    strains = []
    for item in model.items:
        if hasattr(item, "cell_means"):
            item.add(model.state, model.state.a)  # takes the history to the state at rest
            strains.append(item.cell_means("equivalent_plastic_strain"))
    assert len(strains) == 2
    if share > 1:
        assert max(s.max() for s in strains) == 0.0
        return
    for strain in strains:
        worst = int(np.argmax(strain))
        x, y, z = model.domain.source.points[model.domain.source.cells[worst]].mean(axis=0)
        assert strain[worst] > 0 and np.hypot(x, y) < 0.25 * a
        assert abs(z) == pytest.approx(0.48 * a, abs=0.2 * a)


@pytest.mark.parametrize(
    ("size", "bound"), [(1e-3, 0.02), pytest.param(2.5e-4, 0.006, marks=pytest.mark.long)]
)
def test_row_32_hollow_sphere(run_scene, size, bound):
    """b/a = 2, pressure inside: 0.5833, 1.1963, 1.3863 of Y at onset, c/a = 1.5, collapse; 2 %.

    The errors fall with the cells. The front that they are read from is at 1.5 a where Hill has it.
    """
    folder = run_scene("plastic-sphere", **{"mesh.size": size})
    onset, middle, collapse = expected(Record(folder))
    for answer, exact in ((onset, 0.5833), (middle, 1.1963), (collapse, 1.3863)):
        assert answer.expected == pytest.approx(exact, abs=1e-4)
        assert answer.value == pytest.approx(answer.expected, rel=bound)
    with h5py.File(folder / "results.h5") as file:
        assert np.abs(file["history/balance_error"][:]).max() < 1e-5


def test_full_cells_lock_in_a_sphere_that_flows(run_scene):
    """Full quadrature bears 3 % more than collapse where `selective` bears 0.7 %."""
    keys = {"mesh.size": 1e-3, "bodies.sphere.element": "full"}
    *_, last = expected(Record(run_scene("plastic-sphere", **keys)))
    assert last.quantity.endswith("collapse")
    assert last.value > 1.03 * last.expected


@pytest.mark.parametrize(
    ("element", "kinematics"),
    [("full", "small-strain"), ("selective", "total-lagrangian"), ("one-point", "small-strain")],
)
def test_stresses_of_cells_on_the_wall(run_scene, element, kinematics):
    """Kinematic hardening C, ν = 0: −598 MPa along the bar, X = −2/3 C p along it, 1/3 C p across.

    Von Mises' stress is that of the tensor; stress less back stress is at most the yield stress.
    """
    steel = Scene.load("plastic-bar").tables()["bodies"]["bar"]["material"]
    C = steel.pop("hardening_modulus")
    steel["back_stresses"] = [{"modulus": C}]
    keys = {"mesh.size": 2.5e-3, "time.end": 2e-5, "output.stress": True}
    keys |= {"bodies.bar.element": element, "bodies.bar.kinematics": kinematics}
    folder = run_scene("plastic-bar", **keys, **{"bodies.bar.material": steel})
    with h5py.File(folder / "fields.vtkhdf") as file:
        cells = {name: data[-160:] for name, data in file["VTKHDF/CellData"].items()}
        centres = file["VTKHDF/Points"][:][file["VTKHDF/Connectivity"][:].reshape(-1, 8)].mean(1)
    stress, back = cells["stress"].astype(float), cells["back_stress"].astype(float)
    p, near = cells["equivalent_plastic_strain"].astype(float), centres[:, 0] < 0.01
    assert stress[near, 0].mean() == pytest.approx(-wall_stress(20.0), rel=0.02)
    assert np.abs(stress[near, 1:]).max() < 0.02 * wall_stress(20.0)
    exact = np.outer(p, [-2 / 3 * C, C / 3, C / 3, 0, 0, 0])
    np.testing.assert_allclose(back[near], exact[near], rtol=0, atol=0.01 * np.abs(exact).max())
    scale = 2e-2 if element == "full" else 3e-3  # the mean of a root is not the root of the mean
    atol = scale * np.abs(stress).max()
    np.testing.assert_allclose(cells["von_mises_stress"], von_mises(stress), rtol=0, atol=atol)
    assert von_mises(stress - back).max() < 1.005 * Y  # Cauchy against Kirchhoff


def von_mises(stress):
    """Von Mises' stress of tensors as VTK has them, shape ``(n, 6)``."""
    xx, yy, zz, xy, yz, xz = stress.T
    square = ((xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2) / 2 + 3 * (xy**2 + yz**2 + xz**2)
    return np.sqrt(square)


@pytest.mark.parametrize("kinematics", ["small-strain", "total-lagrangian"])
def test_a_plastic_run_converges_with_its_step(tmp_path, kinematics):
    """A bar pulled smoothly past its yield stress: what it dissipates, of second order in the step.

    Steps of a half, a quarter, an eighth of the bound: differences fall by 4.
    """
    tables = Scene.load("plastic-bar", **{"mesh.size": 2.5e-3}).tables()
    del tables["contacts"], tables["bodies"]["bar"]["velocity"]
    tables["bodies"]["bar"]["kinematics"] = kinematics
    tables["supports"] = [
        {"surface": "xmin", "directions": ["x"]},
        {"surface": "xmax", "directions": ["x"], "velocity": 12.0, "ramp": 30e-6},
    ]
    tables["time"] |= {"end": 40e-6, "output_interval": 40e-6, "follow_shape": False}
    lost = []
    for k in range(3):
        tables["time"]["safety"] = 0.5 / 2**k
        result = run(Scene.check(tables), tmp_path / f"{k}", quiet=True)
        lost.append(result.summary["energy"]["plastic_dissipation"])
    assert lost[0] > 0.1
    first, second = np.abs(np.diff(lost))
    assert first / second == pytest.approx(4, rel=0.1)


def rolled(run_scene, ratio, number, size):
    """Rows of passes of a Hertzian pressure, by its largest value over the yield stress in shear.

    The pressure is that of the scene, 1 GPa; the steel is made as weak as is asked for.
    """
    keys = {"mesh.size": size, "passes.number": number, "output.fields": False}
    steel = {"bodies.block.material.yield_stress": np.sqrt(3) * 1e9 / ratio}
    return rows_of(run_scene("rolling-shakedown", **keys, **steel))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("size", "number"),
    [(1.25e-3, 3), pytest.param(1e-3, 6, marks=pytest.mark.long)],
)
def test_row_35_shakedown(run_scene, size, number):
    """Below 4 k the first pass leaves stresses with which the section bears the next, above not.

    At 3.5 k nothing is added any more. At 5 k each pass adds strain and forward shear alike, to 5 %
    between the last two (Bhargava, Hahn and Rubin 1985).
    """
    rows = rolled(run_scene, 3.5, number, size)
    assert rows[0]["added_plastic_strain"] > 5e-4 and rows[0]["residual_stress_xx"] < -50e6
    assert all(row["added_plastic_strain"] == 0.0 for row in rows[1:])
    assert all(row["plastic_work"] < 0.02 * rows[0]["plastic_work"] for row in rows[1:])
    *_, before, last = rolled(run_scene, 5.0, number, size)
    for name in ("added_plastic_strain", "added_section_shear"):
        assert last[name] == pytest.approx(before[name], rel=0.05)
    assert last["added_section_shear"] < -3e-3 and last["added_plastic_strain"] > 9e-3


@pytest.mark.slow
@pytest.mark.long
def test_row_35_elastic_limit_and_4_35(run_scene):
    """At 3.0 k nothing yields (the limit is 3.1). At 4.35 k it goes on: passes 2 to 6 add plastic
    strain alike to 10 %, and shear, less and less of it.
    """
    for row in rolled(run_scene, 3.0, 2, 1e-3):
        assert row["largest_plastic_strain"] == 0.0
    rows = rolled(run_scene, 4.35, 6, 1e-3)
    added = [row["added_plastic_strain"] for row in rows[1:]]
    assert min(added) > 0.9 * max(added) > 1.8e-3
    shear = [row["added_section_shear"] for row in rows[1:]]
    assert max(shear) < -2e-4 and shear == sorted(shear)
