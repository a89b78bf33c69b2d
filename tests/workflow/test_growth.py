# SPDX-License-Identifier: LGPL-3.0-or-later
"""Instability of the model itself: growth fitted to a force, told from faults of the numerics."""

from itertools import product

from mpi4py import MPI  # noqa: F401

import numpy as np
import pytest
import scipy.linalg
from scipy.sparse.linalg import LinearOperator, eigs

from contact.springs import springs
from workflow import Scene
from workflow.audit.limits import Limits
from workflow.model.model import build
from workflow.simulation.initial import start
from workflow.stability.cases import Case, implicit
from workflow.stability.growth import (
    CELLS,
    DAMPINGS,
    NONE,
    STIFF,
    Growth,
    alike,
    force_of,
    growth,
    model_growth,
    refined,
    sliding_growth,
    told,
)
from workflow.stability.run import judge

FACE = "contacts.face."
COARSE = {"mesh.size": 0.005, "mesh.base_size": 0.006}
T = np.linspace(0, 60e-6, 400)


@pytest.mark.parametrize("rate", [2e4, 4e4])
@pytest.mark.parametrize("frequency", [50e3, 75e3])
def test_fit_finds_what_a_force_was_made_of(rate, frequency):
    """Trend, noise and a wave that grows: rate and frequency within 3 times the error of the fit,
    which is below a tenth of the rate."""
    wave = 0.05 * np.exp(rate * T) * np.cos(2 * np.pi * frequency * T + 1)
    noise = 0.01 * np.random.default_rng(1).standard_normal(len(T))
    found = growth(T, 1 + 2e3 * T + wave + noise)
    assert found.sure and found.rate_error < 0.1 * rate
    assert abs(found.rate - rate) < 3 * found.rate_error + 0.05 * rate
    assert found.frequency == pytest.approx(frequency, rel=0.02)


def test_what_does_not_grow_is_not_sure():
    """A wave that dies, noise, a step, a force that leaves before a period is over."""
    wave = 0.1 * np.cos(2 * np.pi * 50e3 * T)
    noise = 0.1 * np.random.default_rng(1).standard_normal(len(T))
    for level in (1 + wave * np.exp(-2e4 * T), 1 + noise, 1 + 0.1 * (T > 30e-6), 1 - 8e4 * T):
        assert not growth(T, level).sure


def test_lift_off_ends_the_window():
    """Beyond it the wave is cut at zero, and would be taken for a slower growth."""
    wave = 0.05 * np.exp(6e4 * T) * np.cos(2 * np.pi * 70e3 * T)
    found = growth(T, np.maximum(1 + wave, 0.0))
    assert found.rate == pytest.approx(6e4, rel=0.02)


def at(cells: float, damping: float, power: float = 0.0, dies: float = 0.0) -> Growth:
    """A growth whose frequency and rate go with a power of the cell; less with damping."""
    scale = cells**power
    return Growth(6e4 * scale - dies * damping, 72e3 * scale, 5e2, 1e2, 0.97, 4.0)


RUNS = list(product(CELLS, DAMPINGS))


@pytest.mark.parametrize("power, dies, same", [
    (0.0, 0.0, True), (0.1, 1e11, True), (-0.5, 0.0, False), (-1.0, 0.0, False), (0.0, 8e11, False),
])  # fmt: skip
def test_alike_on_all_meshes_or_not(power, dies, same):
    """The model's own is alike; frequencies of springs that follow the mesh (h to the -1/2) and of
    the grid (1/h), and what a little damping stops, are not; nor is a run that is missing."""
    found = [at(*run, power, dies) for run in RUNS]
    assert alike(found) == same
    assert not alike(found[:-1]) and not alike([*found[:-1], NONE])


def test_what_is_told():
    """Range, error and number of runs; a run without growth is named."""
    assert (
        told([at(*run) for run in RUNS]) == "grows by 6e+04 ± 5e+02 per second at 72 kHz in 6 runs"
    )
    assert told([at(1, 0), NONE]).endswith("in 1 runs and not in the next")
    assert told([NONE]) == "does not grow at one frequency"


def eigenvalue(friction: float, penalty: float = STIFF, **changes) -> tuple[float, float]:
    """Largest growth [1/s] and its frequency [Hz] of the 60 modes about 75 kHz (complex; row 39).

    All nodes slide along x: a spring k at a node presses with k along the normal and drags with
    friction × k along the slip, so its stiffness is not symmetric. Mass is lumped.
    """
    scene = Scene.load("sliding-block", **(COARSE | implicit(penalty, "face") | changes))
    model = build(scene.with_(**{FACE + "friction": 0.0}))
    start(model, lambda line: None)
    n, limits = 3 * model.domain.owned, Limits(model)
    K = np.array([limits._apply(e, model.dt, np.zeros(0), None) for e in np.eye(n)])
    side = model.pairs["face"].passes[0]
    s = springs(side, model.state)
    local = model.domain.local_dofs(np.arange(len(model.domain.source.points)))
    held = np.ones(n)
    for dofs, d in zip(model.supports.dofs, model.supports.directions, strict=True):
        held[3 * dofs + int(np.argmax(d))] = 0.0
    for nodes, w, normal, m in zip(s.nodes, s.weight, s.normal, s.mass, strict=True):
        B = np.zeros((3, n))
        for node, share in zip(nodes, w, strict=True):
            B[:, 3 * local[node] : 3 * local[node] + 3] += share * np.eye(3)
        B *= limits._scale * held
        force = normal - friction * np.array(
            [1.0, 0.0, 0.0]
        )  # on the contactor, which slides to +x
        K += penalty * m / model.dt**2 * np.outer(B.T @ force, normal @ B)
    shift = -((2 * np.pi * 75e3) ** 2)
    factors = scipy.linalg.lu_factor(-K - shift * np.eye(n))
    near = LinearOperator((n, n), matvec=lambda x: scipy.linalg.lu_solve(factors, x))
    found = eigs(-K, 60, sigma=shift, OPinv=near, v0=np.ones(n), return_eigenvectors=False)
    root = np.sqrt(found.astype(complex))
    root = np.where(root.imag < 0, -root, root)
    worst = root[np.argmax(root.real)]
    return float(worst.real), float(worst.imag) / (2 * np.pi)


def test_growth_of_a_run_is_that_of_complex_eigenvalues():
    """Friction 0.6, stiff contact: frequency within 3 %, rate within 15 %, without a time step."""
    rate, frequency = eigenvalue(0.6)
    keys = {**COARSE, **implicit(STIFF, "face"), FACE + "friction": 0.6}
    keys |= {"bodies.block.velocity": [10.0, 0.0, 0.0], "output.fields": False}
    found = sliding_growth(Scene.load("sliding-block", **keys), "face")
    assert found.sure and rate > 0
    assert found.frequency == pytest.approx(frequency, rel=0.03)
    assert found.rate == pytest.approx(rate, rel=0.15)


COME, FAR = 60e-6, 0.5  # friction is there [s]; change of the force, up to which all is linear
PATIENT = {"time.end": 250e-6, "time.output_interval": 50e-6, "time.safety": 0.9,
           "output.fields": False, "output.checkpoint_minutes": 0.0}  # fmt: skip


def patient_growth(friction: float, **changes) -> Growth:
    """Growth of what a friction leaves that comes on softly, up to where the force has halved.

    The block is thrown just fast enough to slide to the end, which disturbs the contact least.
    """
    s = f"(t / {COME})"
    law = f"{friction} * where(t < {COME}, {s}**3 * (10 - 15 * {s} + 6 * {s}**2), 1)"
    keys = PATIENT | changes
    keys[FACE + "friction"] = {"law": "expression", "expression": law}
    keys["bodies.block.velocity"] = [40.0 * friction, 0.0, 0.0]
    t, force = force_of(Scene.load("sliding-block", **keys), "face")
    level = force / force[0]
    small = np.logical_and.accumulate(np.abs(level - 1) < FAR) & (t >= COME)
    return growth(t[small], level[small])


FINER = [pytest.param(size, marks=pytest.mark.slow) for size in (3.33e-3, 2.5e-3)]


@pytest.mark.parametrize("size", [5e-3, *FINER])
def test_row_39_growth_from_a_small_disturbance(size):
    """Friction 0.3, seven periods: frequency within 2 %, rate within 10 % of the eigenvalue.

    With springs of 1000 m/dt². Those of 10, taken at the end of the step, damp what is quick: at
    5 mm and the whole step, of 0.7 µs, a quarter of the growth.
    """
    keys = {"mesh.size": size, "mesh.base_size": 1.2 * size, **implicit(1000, "face")}
    rate, frequency = eigenvalue(0.3, 1000, **keys)
    found = patient_growth(0.3, **keys)
    assert found.sure and found.periods > 6
    assert found.frequency == pytest.approx(frequency, rel=0.02)
    assert found.rate == pytest.approx(rate, rel=0.1)


def test_row_39_springs_at_the_end_of_a_long_step_damp_it():
    """Springs of 10 m/dt²: 0.65 to 0.85 of the growth at the whole step, 0.9 or more at a fifth."""
    keys = COARSE | implicit(10, "face")
    rate, _ = eigenvalue(0.3, 10)
    whole = patient_growth(0.3, **keys)
    fifth = patient_growth(0.3, **keys, **{"time.safety": 0.18})
    assert 0.65 < whole.rate / rate < 0.85 < 0.9 < fifth.rate / rate < 1.1


@pytest.mark.slow
def test_verdict_of_a_model_that_is_unstable_by_itself():
    """Friction 0.6 swings for the model's own sake, whatever the contact: stiff springs and
    constraints; with soft springs on coarse cells it is wrong (40 kHz for 73)."""
    rough = {**COARSE, FACE + "friction": 0.6}
    stiff = judge(Case("p", "1", "", "slide", {**rough, **implicit(10, "face")}))
    exact = judge(Case("p", "2", "", "slide", {**rough, FACE + "method": "lagrange"}))
    soft = judge(Case("p", "3", "", "slide", rough))
    assert (stiff.kind, exact.kind, soft.kind) == ("model", "model", "wrong")
    assert "the model itself grows by" in stiff.message and "in 6 runs" in stiff.message
    assert "at 40 kHz" in soft.message


def test_a_steady_slide_is_not_run_again(monkeypatch):
    """Only what swings beyond the tolerance though its energy is balanced is looked into."""
    monkeypatch.setattr("workflow.stability.growth.itself", lambda *a: pytest.fail("run again"))
    assert judge(Case("p", "1", "", "slide", COARSE)).kind == "accurate"


def test_refined_scenes():
    """Half the cells of both bodies, and damping on top of what there was."""
    scene = Scene.load("sliding-block", **COARSE, **{"bodies.base.stiffness_damping": 1e-8})
    fine = refined(scene, 0.5, 5e-8)
    assert (fine.mesh.size, fine.mesh.base_size) == (0.0025, 0.003)
    dampings = [body.stiffness_damping for body in fine.bodies.values()]
    assert dampings == pytest.approx([5e-8, 6e-8])


def test_cells_of_one_model_share_its_runs(monkeypatch):
    """Contact, damping of it, step and precision are no part of the model; friction is."""
    ran = []
    monkeypatch.setattr("workflow.stability.growth.KNOWN", {})
    monkeypatch.setattr("workflow.stability.growth.sliding_growth",
                        lambda scene, contact: ran.append(scene) or at(1, 0))  # fmt: skip
    base = Scene.load("sliding-block", **COARSE)
    for keys in ({}, {"time.safety": 0.1}, {FACE + "damping": 0.3}, implicit(30, "face")):
        assert len(model_growth(base.with_(**keys), "face")) == len(ran) == 6
    model_growth(base.with_(**{FACE + "friction": 0.4}), "face")
    assert len(ran) == 12 and {s.contacts["face"].penalty for s in ran} == {STIFF}
