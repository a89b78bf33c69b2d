# SPDX-License-Identifier: LGPL-3.0-or-later
"""Elements, laws, viscosity and precision as keys of a scene, on a ringing and a bending bar."""

from mpi4py import MPI

import numpy as np
import pytest

from forms.elasticity import Elastic
from forms.elements import LAWS, Law
from forms.springs.connections import Connections
from forms.springs.point_masses import PointMasses
from forms.springs.springs import spread
from forms.springs.step_bound import attached, joined_step
from workflow import Scene, run
from workflow.model.model import build
from workflow.model.step import step_bound
from workflow.results.record import Record
from workflow.scene.scene import SceneError

STEEL = {"youngs_modulus": 210e9, "poisson_ratio": 0.3, "density": 7800.0}
WOOD = {
    "law": "orthotropic",
    "youngs_moduli": [12e9, 0.6e9, 1.0e9],
    "poisson_ratios": [0.4, 0.35, 0.3],
    "shear_moduli": [0.7e9, 0.8e9, 0.1e9],
    "density": 500.0,
}
LARGE = {"kinematics": "total-lagrangian"}
BODIES = {
    "one-point": {"element": "one-point"},
    "one-point, coefficient": {"element": "one-point", "hourglass_coefficient": 0.1},
    "one-point, large": {"element": "one-point", **LARGE},
    "selective": {"element": "selective"},
    "neo-hookean": {"material": {**STEEL, "law": "neo-hookean"}, **LARGE},
    "neo-hookean, one-point": {
        "material": {**STEEL, "law": "neo-hookean"}, "element": "one-point", **LARGE
    },
    "neo-hookean, selective": {
        "material": {**STEEL, "law": "neo-hookean"}, "element": "selective", **LARGE
    },
    "orthotropic": {"material": WOOD},
    "orthotropic, one-point": {"material": WOOD, "element": "one-point"},
}  # fmt: skip


def bending(body: dict, **changes) -> Scene:
    """A cantilever of 20:1 with four cells over its height that is thrown sideways."""
    scene = {f"bodies.bar.{key}": value for key, value in body.items()}
    scene |= {
        "bodies.bar.velocity": [0.0, 1.0, 0.0],
        "supports": [{"surface": "xmin", "directions": ["x", "y", "z"]}],
        "output.fields": False,
    }
    return Scene.load("bar-wave", **(scene | changes))


@pytest.mark.parametrize("name", BODIES)
def test_row_24_energy_of_every_element_and_law(tmp_path, name):
    """A thrown cantilever: the ledger closes, with the hourglass term where it belongs."""
    history = run(bending(BODIES[name]), tmp_path, quiet=True).history
    assert np.abs(history["balance_error"]).max() < 1e-4
    control = history["hourglass"].max() / history["internal"].max()
    assert (1e-4 < control < 0.2) if "one-point" in name else control == 0


def test_stiffness_damping_takes_hourglass_energy_into_account(tmp_path):
    """Damped one-point cells lose energy steadily, and the ledger still closes."""
    damped = {"element": "one-point", "stiffness_damping": 2e-8}
    history = run(bending(damped), tmp_path, quiet=True).history
    assert np.abs(history["balance_error"]).max() < 1e-4
    assert history["damping"][-1] > 1e-2 * history["kinetic"][0]
    assert np.diff(history["damping"]).min() > 0


def wall(tmp_path, **changes) -> tuple[np.ndarray, dict]:
    """Time and force on the wall at every step of bar-impact, and the history."""
    rows: list[tuple[float, float]] = []
    scene = Scene.load("bar-impact", **{"output.fields": False}, **changes)
    result = run(
        scene,
        tmp_path,
        watch=lambda m: rows.append((m.state.t, m.pairs["wall"].normal_force)),
        quiet=True,
    )
    return np.array(rows).T, result.history


def test_bulk_viscosity_calms_the_front(tmp_path):
    """The ringing about ρ c v A falls by more than a third; what the viscosity takes is counted."""
    force = (210e9 * 7800) ** 0.5 * 25e-6

    def ringing(rows) -> float:
        t, f = rows
        return float(np.std(f[(t > 3e-6) & (t < 35e-6)])) / force

    bare, _ = wall(tmp_path / "bare")
    calm, history = wall(tmp_path / "calm", **{"bodies.bar.bulk_viscosity": {"linear": 0.2}})
    assert ringing(calm) < 0.66 * ringing(bare)
    assert history["damping"][-1] > 1e-3 * history["kinetic"][0]
    assert np.abs(history["balance_error"]).max() < 1e-3


def test_single_precision_run(tmp_path):
    """float32 forces of the cells leave the wall force within 1e-4 of its plateau."""
    double, _ = wall(tmp_path / "double")
    single, history = wall(tmp_path / "single", **{"time.precision": "float32"})
    assert 0 < np.abs(single[1] - double[1]).max() < 1e-4 * (210e9 * 7800) ** 0.5 * 25e-6
    assert np.abs(history["balance_error"]).max() < 1e-3


def test_a_law_of_ones_own(tmp_path):
    """Twice the modulus by a law given from Python is the scene with twice the modulus."""
    small = LAWS["small-strain"]

    def stiff(material: Elastic) -> Elastic:
        return Elastic(2 * material.E, material.nu, material.rho, material.damping)

    own = Law(
        lambda u, w, m, v=None: small.residual(u, w, stiff(m), v),
        lambda u, m: small.energy(u, stiff(m)),
        rotating=False,
    )
    scene = bending({})
    doubled = bending({"material": {**STEEL, "poisson_ratio": 0.0, "youngs_modulus": 420e9}})
    result = run(scene, tmp_path / "own", laws={"bar": own}, quiet=True)
    given, named = result.history, result.summary["own_laws"]["bar"]
    assert __name__ in named and "test_a_law_of_ones_own" in named
    with pytest.raises(SceneError, match=r"expected the laws of .*got \{\}"):
        run(scene, tmp_path / "own", quiet=True, resume=True)
    expected = run(doubled, tmp_path / "doubled", quiet=True).history
    for column in ("t", "internal", "kinetic"):
        scale = expected[column].max()
        np.testing.assert_allclose(given[column], expected[column], rtol=0, atol=1e-11 * scale)


def test_a_registered_law_by_name(tmp_path, monkeypatch):
    """A law of half the stress entered in LAWS is, by its name, the scene with half the modulus.

    Gone from LAWS it is refused; with the kinematics of another law or a wrong element too.
    """
    small = LAWS["small-strain"]
    half = Law(
        lambda u, w, m, v=None: small.residual(u, w, m, v) / 2,
        lambda u, m: small.energy(u, m) / 2,
        rotating=False,
    )
    monkeypatch.setitem(LAWS, "half", half)
    steel = {**STEEL, "poisson_ratio": 0.0}
    scene = bending({"material": {**steel, "law": "half"}})
    softer = bending({"material": {**steel, "youngs_modulus": 105e9}})
    found = run(scene, tmp_path / "half", quiet=True).history
    expected = run(softer, tmp_path / "softer", quiet=True).history
    for column in ("t", "internal", "kinetic"):
        scale = expected[column].max()
        np.testing.assert_allclose(found[column], expected[column], rtol=0, atol=1e-11 * scale)
    with pytest.raises(SceneError, match="'total-lagrangian': half expects 'small-strain'"):
        scene.with_(**{"bodies.bar.kinematics": "total-lagrangian"})
    with pytest.raises(SceneError, match=r"'selective': expected material.law = 'hooke'"):
        scene.with_(**{"bodies.bar.element": "selective"})
    monkeypatch.delitem(LAWS, "half")
    with pytest.raises(
        SceneError, match=r"law = 'half': expected one of \['hooke', 'small-strain'"
    ):
        build(scene, MPI.COMM_SELF)
    with pytest.raises(SceneError, match="law = 'half': expected one of 'hooke', 'small-strain'"):
        scene.with_()


@pytest.mark.mpi
def test_row_23_one_point_and_viscosity_on_two_ranks(squealx, tmp_path):
    """One-point cells with viscosity give the same history on two ranks as on one."""
    scene = bending(BODIES["one-point"], **{"bodies.bar.bulk_viscosity": {}})
    one = run(scene, tmp_path / "one", quiet=True).history
    words = ["run", tmp_path / "one" / "scene.toml", "--ranks", 2, "--out", tmp_path / "two"]
    squealx(*words, timeout=60)
    two = Record(tmp_path / "two").history
    for name in ("kinetic", "internal", "hourglass", "damping"):
        np.testing.assert_allclose(two[name], one[name], rtol=0, atol=1e-11 * one["kinetic"].max())


def test_dampers_away_from_the_stiffest_cells_cost_little_step():
    """Dashpots on the end of a bar, M⁻¹ C up to ω: the step is stable, and longer than worst on
    worst; checked against the dense limit of dt²/4 K + dt/2 C < M.
    """
    scene = Scene.load("bar-wave", **{"mesh.size": 2.5e-3, "supports": []})
    model = build(scene, MPI.COMM_SELF)
    x = model.domain.V.tabulate_dof_coordinates()
    end = np.flatnonzero(np.isclose(x[:, 0], 0.1)).astype(np.int32)
    mass, omega = model.mass.array, 2 / model.dt_bound
    c = 1.0 * omega * mass.reshape(-1, 3)[end]
    none = PointMasses(np.zeros(0), np.zeros(3), *(np.zeros((0, 3)) for _ in range(3)))
    pads = Connections(MPI.COMM_SELF, none, [spread(MPI.COMM_SELF, end, 0 * c, c)], dt=0.0)
    K, C = np.empty((len(mass), len(mass))), np.zeros(len(mass))
    C.reshape(-1, 3)[end] = c
    for j, row in enumerate(K):
        row[:] = 0.0
        model.state.u.x.array[:] = 0.0
        model.state.u.x.array[j] = 1.0
        model.internal.kernel.add(row)
    scale = 1 / np.sqrt(mass)
    A, B = -scale[:, None] * K * scale, np.diag(C / mass)

    def top(dt: float) -> float:
        return float(np.linalg.eigvalsh(dt**2 / 4 * (A + A.T) / 2 + dt / 2 * B)[-1])

    found = step_bound(model.bodies, mass, pads, lambda line: None)
    assert 0.95 < top(found) <= 1.0
    springs, dampers = attached(MPI.COMM_SELF, none, pads.links, mass)
    assert found > 1.05 * joined_step(omega, springs, dampers)
