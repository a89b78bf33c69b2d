# SPDX-License-Identifier: LGPL-3.0-or-later
"""Absorbing surfaces: a pulse that leaves a bar, the reflection of the wrong impedance, energy."""

from mpi4py import MPI

import numpy as np
import pytest
from scipy.special import erf

from forms.elasticity import Elastic
from forms.springs.dashpots import absorbing, dashpots
from forms.springs.point_masses import PointMasses
from forms.springs.step_bound import attached
from workflow.model.model import Model, build
from workflow.scene.scene import Scene, SceneError
from workflow.simulation.energy import Ledger
from workflow.simulation.stepping import steps

STEEL = Elastic(210e9, 0.3, 7800.0)
LENGTH, SIGMA = 0.6, 0.03
SPEED = np.sqrt(STEEL.E / STEEL.rho)
NOBODY = np.zeros((0, 3))
SQUARE = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])


def test_matrices_of_a_slanted_facet():
    """Σ C n = ρ c A n and Σ C t = ρ c_s A t on a unit square turned in space; a bar has √(E/ρ)."""
    turn = np.linalg.qr(np.random.default_rng(0).standard_normal((3, 3)))[0]
    points = SQUARE @ turn.T
    for waves, speed in (("plane", STEEL.dilatational_speed), ("bar", SPEED)):
        total = absorbing(points, np.arange(4)[None], STEEL, waves).sum(axis=0)
        shear = np.sqrt(STEEL.mu * STEEL.rho)
        impedance = turn @ np.diag([shear, shear, STEEL.rho * speed]) @ turn.T
        np.testing.assert_allclose(total, impedance, atol=1e-9 * shear)


def test_bound_of_slanted_dampers():
    """The dampers along the axes that bound them: diag(d) − C has no negative eigenvalue."""
    points = SQUARE @ np.linalg.qr(np.random.default_rng(1).standard_normal((3, 3)))[0].T
    matrix = absorbing(points, np.arange(4)[None], STEEL)
    link = dashpots(MPI.COMM_SELF, np.arange(4, dtype=np.int32), matrix)
    masses = PointMasses(np.zeros(0), np.zeros(3), NOBODY, NOBODY, NOBODY)
    springs, dampers = attached(MPI.COMM_SELF, masses, [link], np.ones(12))
    assert springs.rate == 0.0 and not springs.nodal.any()
    for C, d in zip(matrix, dampers.nodal.reshape(4, 3), strict=True):
        assert np.linalg.eigvalsh(np.diag(d) - C)[0] >= -1e-9 * d.max()


def bar(waves: str | None, nu: float, safety: float = 0.9) -> Model:
    """A free bar of 5 mm with a pulse on its way to the far end, of σ = 30 mm in cells of 2.5 mm.

    Every section contracts with ν, at the strain of the pulse and its rate.
    """
    changes = {"mesh.length": LENGTH, "mesh.width": 5e-3, "mesh.size": 2.5e-3}
    changes |= {"bodies.bar.material.poisson_ratio": nu, "bodies.bar.velocity": None}
    changes |= {"supports": [], "time.end": 1e-3, "time.safety": safety}
    if waves:
        changes["absorbing"] = [{"surface": "xmax", "waves": waves}]
    model = build(Scene.load("bar-wave", **changes), MPI.COMM_SELF)
    X = model.domain.V.tabulate_dof_coordinates()
    u, v = (f.x.array.reshape(-1, 3) for f in (model.state.u, model.state.v))
    s = (X[:, 0] - LENGTH / 2) / SIGMA
    v[:, 0] = np.exp(-(s**2) / 2)
    u[:, 0] = -SIGMA * np.sqrt(np.pi / 2) * erf(s / np.sqrt(2)) / SPEED
    u[:, 1:] = nu / SPEED * v[:, :1] * X[:, 1:]
    v[:, 1:] = (nu * s / SIGMA * v[:, 0])[:, None] * X[:, 1:]
    return model


def reflected(model: Model) -> tuple[float, float, float]:
    """Velocity of the pulse on its way back [m/s]; share of the energy taken; balance error."""
    dt = model.dt
    count = int(0.9 * LENGTH / SPEED / dt)  # now its middle, if any, is at 0.6 of the bar
    ledger, X = Ledger(model), model.domain.V.tabulate_dof_coordinates()[:, 0]
    for state in steps(model, count * dt):
        if state.step == 0:
            ledger.measure()
    energy, error = ledger.measure()
    assert ledger.start is not None
    back = state.v.x.array[::3][X > 0.3 * LENGTH]
    taken = energy.damping / (ledger.start.kinetic + ledger.start.internal)
    return float(back[np.argmax(np.abs(back))]), taken, error


@pytest.mark.parametrize(("nu", "most"), [(0.0, 0.01), (0.3, 0.02)])
def test_a_bar_absorbs_its_pulse(nu, most):
    """Dashpots of √(E ρ) take 99.98 % of the energy; 1 % of the amplitude comes back with ν = 0.

    2 % with ν = 0.3, where the dashpots across hold the end's contraction. Measured 0.7 and 1.5 %;
    the ledger closes to round-off.
    """
    back, taken, error = reflected(bar("bar", nu))
    assert abs(back) < most
    assert 0.9998 < taken < 1
    assert abs(error) < 1e-12


def test_what_comes_back_falls_with_the_step():
    """Dampers lag half a step, R ~ ω dt / 4: with ν = 0 it falls with slope 1 over 4 times."""
    steps, sizes = [], []
    for safety in (0.8, 0.4, 0.2):
        model = bar("bar", 0.0, safety)
        sizes.append(abs(reflected(model)[0]))
        steps.append(model.dt)
    assert np.polyfit(np.log(steps), np.log(sizes), 1)[0] == pytest.approx(1.0, abs=0.15)


def test_plane_waves_impedance_sends_part_of_a_bar_wave_back():
    """R = (c − c_p)/(c + c_p) = −7.4 % with c_p at ν = 0.3; a free end all of it, R = 1."""
    speed = STEEL.dilatational_speed
    expected = (SPEED - speed) / (SPEED + speed)
    assert reflected(bar("plane", 0.3))[0] == pytest.approx(expected, abs=0.01)
    assert reflected(bar(None, 0.3))[0] == pytest.approx(1.0, abs=0.01)


def test_bad_surface():
    """A name that the mesh does not have, and waves that nobody knows."""
    with pytest.raises(SceneError, match=r"absorbing.0.surface = 'end': expected one of"):
        Scene.load("bar-wave", absorbing=[{"surface": "end"}])
    with pytest.raises(SceneError, match=r"absorbing.0.waves = 'p': expected 'plane' or 'bar'"):
        Scene.load("bar-wave", absorbing=[{"surface": "xmax", "waves": "p"}])
