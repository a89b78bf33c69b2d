# SPDX-License-Identifier: LGPL-3.0-or-later
"""Dynamic relaxation against the static solve: another way to the same rest."""

import json

from mpi4py import MPI

import h5py
import numpy as np
import pytest
import ufl
from dolfinx import fem

from forms.time_step import assembled_frequency
from workflow import Scene
from workflow.model.model import Model, build
from workflow.simulation.equilibrium import Solver
from workflow.simulation.guards import GuardError
from workflow.simulation.initial import rest, start
from workflow.simulation.relaxation import SAFETY, damping_factor, masses

SCENES = {
    "hertz": {"mesh.size": 1e-3},
    "sliding-block": {
        "mesh.size": 5e-3,
        "mesh.base_size": 6e-3,
        "bodies.block.velocity": [0.0, 0.0, 0.0],
    },
}


DEEP = {"block": [0.0, 0.0, -2e-6]}  # m


def at_rest(name: str, method: str, log=lambda line: None, **changes) -> Model:
    """The model of a small scene at rest by one of the methods."""
    changes |= {"equilibrium.method": method, **SCENES[name]}
    model = build(Scene.load(name, **changes), MPI.COMM_SELF)
    start(model, log)
    return model


def stresses(model: Model) -> np.ndarray:
    """Von Mises stress at the centre of every cell [Pa]; one material everywhere."""
    body = next(iter(model.scene.bodies.values())).material
    E, nu = body.youngs_modulus, body.poisson_ratio
    strain = ufl.sym(ufl.grad(model.state.u))
    mu, lmbda = E / 2 / (1 + nu), E * nu / (1 + nu) / (1 - 2 * nu)
    s = ufl.dev(2 * mu * strain + lmbda * ufl.tr(strain) * ufl.Identity(3))
    mises = fem.Expression(ufl.sqrt(1.5 * ufl.inner(s, s)), np.full((1, 3), 0.5))
    cells = np.arange(model.domain.msh.topology.index_map(3).size_local, dtype=np.int32)
    return mises.eval(model.domain.msh, cells).ravel()


@pytest.mark.parametrize("name", SCENES)
def test_row_22_relaxation_agrees_with_the_static_solve(name):
    """Contact force, patch, pressures and stresses agree; 0.5 % are asked for."""
    static, relaxed = at_rest(name, "static"), at_rest(name, "relaxation")
    (one,), (other,) = static.pairs.values(), relaxed.pairs.values()
    assert other.normal_force == pytest.approx(one.normal_force, rel=5e-4)
    a, b = one.footprint(), other.footprint()
    np.testing.assert_array_equal(a.node, b.node)
    np.testing.assert_allclose(b.normal_force, a.normal_force, atol=1e-3 * a.normal_force.max())
    s, t = stresses(static), stresses(relaxed)
    np.testing.assert_allclose(t, s, atol=1e-3 * s.max())
    assert not relaxed.state.v.x.array.any() and relaxed.state.step == 0


def test_convergence_is_logged_and_damped_by_what_is_seen():
    """Kinetic over internal energy falls below the tolerance; less steps than at LS-DYNA's factor.

    The factor 0.995 of every step takes 250 steps to halve what 0.98 does in 35.
    """
    lines: dict[str, list[str]] = {"auto": [], "fixed": []}
    at_rest("hertz", "relaxation", lines["auto"].append)
    fixed = {"equilibrium.relaxation": {"velocity_factor": 0.995}}
    at_rest("hertz", "relaxation", lines["fixed"].append, **fixed)
    for history in lines.values():
        shares = [float(line.split("energy ")[1].split(",")[0]) for line in history]
        assert shares[-1] <= 1e-8 < shares[-2] and shares[0] > 1e-3
    assert len(lines["auto"]) < len(lines["fixed"])


def test_masses_bring_every_cell_to_the_limit():
    """With its own mass each cell has ω dt = 2 · SAFETY: the assembled value lies just below."""
    changes = {**SCENES["hertz"], "equilibrium.method": "relaxation"}
    model = build(Scene.load("hertz", **changes), MPI.COMM_SELF)
    assert model.scene.equilibrium is not None
    mass = masses(model, model.scene.equilibrium.relaxation)
    frequency, sharp = assembled_frequency(model.domain.V, model.bodies.internal_work, mass)
    assert sharp
    assert 0.7 < frequency * model.dt / (2 * SAFETY) < 1.002
    real, _ = assembled_frequency(model.domain.V, model.bodies.internal_work, model.mass.array)
    assert real * model.dt < 0.6  # the step of this scene is far below its limit


def test_damping_factor_is_critical():
    """An oscillator of that frequency comes to rest without passing through it, in few steps."""
    omega, dt = 3.0, 0.01
    factor = damping_factor(omega**2, dt)
    x, v, seen = 1.0, 0.0, []
    for _ in range(int(10 / (omega * dt))):
        v = factor * v - (1 + factor) / 2 * dt * omega**2 * x
        x += dt * v
        seen.append(x)
    t = dt * np.arange(1, len(seen) + 1)
    exact = (1 + omega * t) * np.exp(-omega * t)
    assert min(seen) > -1e-12
    np.testing.assert_allclose(seen, exact, atol=0.01)


def test_no_rest_in_the_steps_given_stops_the_run():
    """The message names the share that was reached and the keys to turn."""
    few = {"equilibrium.relaxation": {"max_steps": 300}}
    with pytest.raises(GuardError, match=r"after 300 steps, expected 1e-08; .*max_steps"):
        at_rest("hertz", "relaxation", **few)


def test_two_ranks_come_to_the_same_rest(command, tmp_path):
    """A run that starts from relaxation on two ranks has the forces of the static solve."""
    changes = SCENES["sliding-block"] | {"time.end": 2e-6, "output.fields": False}
    found = {}
    for method, ranks in (("static", 1), ("relaxation", 2)):
        words = [w for k, v in changes.items() for w in ("--set", f"{k}={json.dumps(v)}")]
        words += ["--set", f"equilibrium.method={method}", "--ranks", ranks]
        out = tmp_path / method
        command("run", "sliding-block", "--json", *words, "--out", out)
        with h5py.File(out / "results.h5") as file:
            found[method] = file["history/face_normal_force"][:]
    np.testing.assert_allclose(found["relaxation"], found["static"], rtol=5e-4)


def test_a_step_that_takes_all_contact_away_is_cut(monkeypatch):
    """The first solve goes three times too far, off the base; less than a third of it is taken."""
    model = build(Scene.load("contact-patch", **{"equilibrium.approach": DEEP}), MPI.COMM_SELF)
    lines: list[str] = []
    whole = Solver.solve

    def too_far(self, residual, du):
        whole(self, residual, du)
        if len(lines) == 1:
            du.array[:] *= 3.0

    monkeypatch.setattr(Solver, "solve", too_far)
    rest(model, lines.append)
    nodes = [int(line.split()[-3]) for line in lines if line.endswith("contact nodes")]
    shares = [float(line.split()[2]) for line in lines if line.endswith("of the step taken")]
    assert nodes[0] == nodes[-1] == min(nodes) > 0 and len(nodes) < 10
    assert 0.1 < shares[0] < 1 / 3
