# SPDX-License-Identifier: LGPL-3.0-or-later
"""The energy ledger of whole runs without contact (row 24), and what it says of a blow-up."""

from dataclasses import replace

import numpy as np
import pytest

from workflow import Scene, run
from workflow.simulation.energy import FLIGHT, Energy, blown_up
from workflow.simulation.guards import GuardError

LENGTH, WIDTH, RHO, E = 0.1, 0.01, 7800.0, 210e9
C = np.sqrt(E / RHO)
FREQUENCY = np.pi * C / (2 * LENGTH)  # of the first mode [rad/s]
MASS = RHO * LENGTH * WIDTH**2


def bar(**changes) -> Scene:
    """The bar-wave scene in 10 cells."""
    coarse = {"mesh.width": WIDTH, "mesh.size": WIDTH, "output.fields": False}
    return Scene.load("bar-wave", **coarse | changes)


def history(scene: Scene, folder, start=None) -> dict:
    """Columns of a quiet run; ``start`` may change the model at time zero."""

    def watch(model):
        if start is not None and model.state.step == 0:
            start(model)

    return run(scene, folder, watch=watch, quiet=True).history


def kinetic_and_internal(h: dict) -> np.ndarray:
    return h["kinetic"] + h["internal"]


def test_row_24_wave_keeps_its_energy(tmp_path):
    """m v₀²/2 of the bar less its clamped end, exchanged between motion and strain: 1e-9 off."""
    h = history(bar(), tmp_path)
    assert len(h["t"]) == 81
    assert np.abs(h["balance_error"]).max() <= 1e-9
    assert h["internal"].max() > 0.9 * h["kinetic"][0]
    # half a cell of the ten is held; the half-step velocities at t = 0 differ at the clamp only
    assert kinetic_and_internal(h)[0] == pytest.approx(MASS * 0.95 / 2, rel=1e-12)


DAMPING = {
    "stiffness": {"bodies.bar.stiffness_damping": 2e-7},
    "mass": {"bodies.bar.mass_damping": 5e3},
    "both": {"bodies.bar.stiffness_damping": 1e-7, "bodies.bar.mass_damping": 2e3},
}


@pytest.mark.parametrize("damping", DAMPING)
def test_row_24_damped_wave_closes_its_balance(tmp_path, damping):
    """Kinetic + internal + dissipated = initial energy to 1e-9, and a good part is dissipated."""
    h = history(bar(**DAMPING[damping]), tmp_path)
    assert np.abs(h["balance_error"]).max() <= 1e-9
    assert np.all(np.diff(h["damping"]) >= 0)
    assert h["damping"][-1] > 0.1 * h["kinetic"][0]


@pytest.mark.parametrize("damping", DAMPING)
def test_damping_takes_what_rayleigh_says(tmp_path, damping):
    """First mode: amplitude² falls as exp(−(α + β ω²) t); over whole half periods 2 %.

    The damper lags half a step: relative error of the rate (α + βω²) dt/2 < 1 %.
    """
    half = np.pi / FREQUENCY
    scene = bar(**DAMPING[damping], **{"time.end": 4 * half, "time.output_interval": half})
    body = scene.bodies["bar"]
    rate = body.mass_damping + body.stiffness_damping * FREQUENCY**2
    scene = scene.with_(**{"bodies.bar.velocity": [0.0, 0.0, 0.0]})

    def first_mode(model):
        x = model.domain.V.tabulate_dof_coordinates()[:, 0]
        model.state.v.x.array[::3] = np.sin(np.pi * x / (2 * LENGTH))

    h = history(scene, tmp_path, first_mode)
    start = MASS / 4  # ∫ ρ A sin² / 2
    expected = start * np.exp(-rate * h["t"][1:])
    assert rate * h["t"][-1] > 0.1
    np.testing.assert_allclose(kinetic_and_internal(h)[1:], expected, rtol=0.02)


def test_row_24_suddenly_pulled_bar(tmp_path):
    """Dead traction p on the free end from rest: balance 1e-9; the end swings to 2 p L / E.

    The work is p A u(L), so at its first peak (t = 2L/c) it is 2 p² A L / E. The shock is spread
    over a few of the 40 cells: 2 % for the peak.
    """
    p = 1e6
    pull = [{"surface": "xmax", "traction": [p, 0.0, 0.0]}]
    scene = bar(loads=pull, **{"bodies.bar.velocity": [0.0, 0.0, 0.0], "mesh.size": LENGTH / 40})
    h = history(scene, tmp_path)
    assert np.abs(h["balance_error"]).max() <= 1e-9
    assert h["external_work"].max() == pytest.approx(2 * p**2 * WIDTH**2 * LENGTH / E, rel=0.02)


STILL = Energy(0, 0, 0, 0, 0, 0, 0, 0)


def test_total_counts_works_against_what_is_stored_and_dissipated():
    """1 + 2 + 4 + 8 + 16 stored, 32 + 64 dissipated, 128 put in."""
    assert Energy(1, 2, 4, 8, 16, 32, 64, 128).total == 127 - 128


@pytest.mark.parametrize("x", [0.5, 0.9, 0.99])
def test_stable_modes_are_no_blow_up(x):
    """At the turn of an undamped mode of ω dt/2 = x: kinetic −x²/(1−x²), stored 1/(1−x²) of E."""
    turn = replace(STILL, kinetic=-(x**2) / (1 - x**2), internal=1 / (1 - x**2))
    assert not blown_up(turn, replace(STILL, kinetic=1.0))


def test_linear_blow_up_stops_the_run_although_the_balance_closes(tmp_path):
    """Step 4 % over the limit: kinetic and internal energy grow threefold a step, their sum not.

    The run stops soon after the start with its results kept, and says why.
    """
    scene = bar(**{"time.safety": 1.2, "time.output_interval": 2e-6})
    with pytest.raises(GuardError, match=r"energy balance error -9\d.*unstable step.*time.safety"):
        run(scene, tmp_path / "run", quiet=True)
    kept = {p.name for p in (tmp_path / "run").iterdir()}
    assert kept == {"scene.toml", "summary.json", "results.h5", "run.log"}


def test_small_balance_error_is_let_pass_and_a_large_one_is_not(tmp_path):
    """With the guard at 1e-18 the first round-off stops the run."""
    with pytest.raises(GuardError, match=r"is over guards.energy_error = 0.00%"):
        history(bar(**{"guards.energy_error": 1e-18}), tmp_path)


class Push:
    """A force along x on all nodes of a body, in proportion to mass, that the ledger is not told.

    Args:
        model: The model.
        body: The body.
        force: Its resultant [N].
    """

    def __init__(self, model, body: str, force: float) -> None:
        self.dofs = model.bodies.dofs(body)
        mass = model.mass.array[::3][self.dofs]
        self.nodal = force * mass / mass.sum()

    def add(self, state, force) -> None:
        """Add it."""
        force.array[3 * self.dofs] += self.nodal


FAST, WEIGHT, HEAT = 100.0, 4000.0, 0.3  # speed [m/s], load [N] and friction of the sliding block


def pushed(folder, force: float) -> dict:
    """History of a block that slides at 100 m/s, pushed by a force that no ledger knows."""
    scene = Scene.load("sliding-block", **{
        "mesh.size": 0.005, "mesh.base_size": 0.006, "mesh.base": [0.06, 0.03, 0.01],
        "bodies.block.velocity": [FAST, 0.0, 0.0], "time.end": 40e-6, "output.fields": False,
        "guards.check_interval": 5})  # fmt: skip
    return run(scene, folder, items=[lambda m: Push(m, "block", force)], quiet=True).history


def test_guard_compares_with_the_work_of_the_contact(tmp_path):
    """A twelfth of the work of friction made from nothing ends a run, a fortieth does not.

    It is 0.3 % of the kinetic energy of 156 J by the end. Work of the contact: 0.3 × 4 kN × the
    way, and the strain of the pressed bodies, 10 MPa.
    """
    fed = pushed(tmp_path / "some", HEAT * WEIGHT / 40)
    assert fed["guarded_error"][-1] == pytest.approx(1 / 40, rel=0.02)
    assert fed["contact_work"][-1] == pytest.approx(HEAT * WEIGHT * FAST * 40e-6, rel=0.02)
    assert np.abs(fed["balance_error"]).max() < 2e-3
    with pytest.raises(
        GuardError, match=r"balance error [5-9]\.\d+% of the work of the contact"
    ) as e:
        pushed(tmp_path / "much", HEAT * WEIGHT / 12)
    t = float(str(e.value).split("t = ")[1].split()[0])
    ride = (
        FLIGHT * 156.0
    )  # before friction has done so much, a share of all energy is compared with
    assert t < 2 * ride / (HEAT * WEIGHT * FAST)


def test_without_contact_all_energy_is_compared_with(tmp_path):
    """There is no other; and a ledger that has no error has none either way."""
    h = history(bar(**DAMPING["both"]), tmp_path)
    assert not h["contact_work"].any()
    np.testing.assert_array_equal(h["guarded_error"], h["balance_error"])


def test_bodies_that_have_not_touched_may_fly(tmp_path):
    """Before the impact contact has done nothing, and round-off of the flight ends no run."""
    scene = Scene.load("bar-impact", **{"output.fields": False, "time.end": 10e-6})
    apart = scene.with_(**{"contacts.wall.target.origin": [-2e-6, 0.0, 0.0]})
    h = run(apart, tmp_path / "run", quiet=True).history
    early = h["wall_normal_force"] == 0
    assert early.any() and (h["internal"][~early] > 0).any()
    assert np.abs(h["guarded_error"]).max() < 1e-2
