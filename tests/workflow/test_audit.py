# SPDX-License-Identifier: LGPL-3.0-or-later
"""``squealx audit``: what it predicts without stepping, against dense algebra and against runs."""

import json

from mpi4py import MPI  # noqa: F401

import numpy as np
import pytest

from contact.springs import springs
from contact.theory.slip_waves import HalfSpace, slip_wave
from workflow import Scene, run
from workflow.audit.audit import printout, report
from workflow.audit.limits import Limits
from workflow.model.advice import landing_gain
from workflow.model.model import build
from workflow.simulation.initial import start
from workflow.squeal.squeal import squeal

SMALL = {"mesh.size": 0.005, "mesh.base_size": 0.006, "mesh.base": [0.03, 0.03, 0.01]}
STEEL = HalfSpace(210e9 / 2.6, 0.3, 7800.0)


def at_rest(**changes):
    """Return the sliding block on a coarse mesh, at rest under its load."""
    model = build(Scene.load("sliding-block", **SMALL, **changes))
    start(model, lambda line: None)
    return model


def dense(model, limits, damping=0.0) -> np.ndarray:
    """Return dt²/4 M^(-1/2) (K + contact) M^(-1/2) with the contact summed spring by spring."""
    n, dt = 3 * model.domain.owned, model.dt
    K = np.array([limits._apply(e, dt, np.zeros(0), None) for e in np.eye(n)])
    local = model.domain.local_dofs(np.arange(len(model.domain.source.points)))
    s, p = limits.passes[0].springs, limits.passes[0].penalty
    held = np.eye(n)
    for dofs, d in zip(model.supports.dofs, model.supports.directions, strict=True):
        i = 3 * dofs + int(np.argmax(d))
        held[i, i] = 0.0
    for nodes, w, normal, m in zip(s.nodes, s.weight, s.normal, s.mass, strict=True):
        k = p * m / dt**2 * (np.eye(3) + 4 * damping / p**0.5 * np.outer(normal, normal))
        B = np.zeros((3, n))
        for node, share in zip(nodes, w, strict=True):
            B[:, 3 * local[node] : 3 * local[node] + 3] += share * np.eye(3)
        B = B * limits._scale @ held
        K += B.T @ k @ B
    return dt**2 / 4 * K


@pytest.mark.parametrize("points", ["nodes", "quadrature"])
@pytest.mark.parametrize("damping", [0.0, 0.4])
def test_asked_is_the_dense_eigenvalue(damping, points):
    """Bodies, contact springs and dampers together: at most 0.5 % above the exact value."""
    changes = {"penalty": 1.5, "damping": damping, "points": points}
    model = at_rest(**{f"contacts.face.{key}": value for key, value in changes.items()})
    limits = Limits(model)
    exact = np.linalg.eigvalsh(dense(model, limits, damping))[-1]
    assert exact <= limits.demand(model.dt) <= 1.005 * exact


def test_springs_are_those_of_the_kernel():
    """Every touching node has the stiffness that the pair gave it when it touched, before the
    bodies had come to rest and moved by 1e-5 of a facet."""
    model = at_rest()
    side = model.pairs["face"].passes[0]
    found = springs(side, model.state)
    c = side.contact_state.touching[: side.active]
    nodes = list(found.nodes[:, 0])
    mine = found.mass[[nodes.index(side.contactor.nodes[i]) for i in c]]
    np.testing.assert_allclose(
        side.options.penalty * mine / model.dt**2, side.contact_state.stiffness[c], rtol=1e-4
    )


def test_limits_are_where_the_whole_is_asked():
    """At each limit the model asks for 1: of the step, the penalty and the contact damping."""
    model = at_rest()
    limits, dt = Limits(model), model.dt
    assert limits.demand(limits.step()) == pytest.approx(1, abs=5e-3)
    assert limits.demand(dt, penalty=limits.penalty(dt)) == pytest.approx(1, abs=5e-3)
    assert limits.demand(dt, damping=limits.damping(dt)) == pytest.approx(1, abs=1e-2)
    alone, touch = limits.demand(dt, contact=False), limits.share(dt)
    assert max(alone, touch) <= limits.demand(dt) <= 1.005 * (alone + touch)


def test_parts_never_take_more_than_the_scene_keeps_for_them():
    """The bound of the scene is on the safe side of the limit, and within a tenth of it."""
    model = at_rest()
    assert 0.9 < model.dt_bound / Limits(model).step() < 1.002


def test_critical_penalty_where_the_step_gives_way():
    """Springs p m/dt² leave room up to p = 4; there the step of the stiffest cell takes over."""
    found = report(Scene.load("sliding-block", **SMALL))
    p = 0.4 * found["critical"]["penalty_factor"]
    assert p == pytest.approx(4, rel=0.01)
    assert found["critical"]["penalty_factor_at_this_step"] < found["critical"]["penalty_factor"]


def test_penetration_at_rest_is_that_of_the_springs():
    """A uniform pressure on springs k: the mean depth is p A / Σk; no node is three times it."""
    found = report(Scene.load("sliding-block", **SMALL))["contacts"]["face"]
    model = at_rest()
    k = Limits(model).passes[0].springs.mass.sum() * 0.4 / model.dt**2
    assert 1 <= found["penetration"] / (10e6 * 0.02**2 / k) < 3
    assert found["penetration_over_cell"] == pytest.approx(found["penetration"] / 5e-3, rel=1e-6)


def test_penetration_of_an_impact(tmp_path):
    """Bar on a wall: ρ c v A / k, foreseen, is the depth of the plateau of the run."""
    scene = Scene.load("bar-impact", **{"output.fields": False, "time.end": 30e-6})
    depths = []
    run(scene, tmp_path / "o", watch=lambda m: depths.append(m.pairs["wall"].max_penetration),
        quiet=True)  # fmt: skip
    found = report(scene)["contacts"]["wall"]["penetration"]
    assert found == pytest.approx(np.mean(depths[len(depths) // 4 :]), rel=0.1)


def test_equivalent_penalties_undo_each_other():
    """What a penalty is as a modulus-penalty has the same stiffness when it is one."""
    first = report(Scene.load("sliding-block", **SMALL))["contacts"]["face"]
    keys = {"contacts.face.method": "modulus-penalty",
            "contacts.face.penalty": first["equivalent_modulus_penalty"]}  # fmt: skip
    model = at_rest(**keys)
    t = Limits(model).passes[0]
    k = np.median(t.stiffness(model.dt, 1.0, 0.0)[0])
    assert k == pytest.approx(first["stiffness"], rel=0.15)


IMPLICIT = {"contacts.face.method": "implicit-penalty", "contacts.face.penalty": 10.0}


def test_springs_at_the_end_of_the_step_ask_for_nothing():
    """No penalty is too large, the whole step is that of the bodies, and the give at rest is p A
    over Σk of springs of 10 m/dt², at no node three times that."""
    found = report(Scene.load("sliding-block", **SMALL, **IMPLICIT))
    assert found["asked"]["contacts"] == 0 and found["critical"]["penalty_factor"] == np.inf
    assert found["critical"]["step"] == pytest.approx(found["critical"]["step_without_contact"])
    face, model = found["contacts"]["face"], at_rest(**IMPLICIT)
    assert not face["limits_the_step"]
    springs_of = Limits(model).springs["face"][0].springs
    k = springs_of.mass.sum() * 10.0 / model.dt**2
    assert 1 <= face["penetration"] / (10e6 * 0.02**2 / k) < 3
    told = "\n".join(printout(found))
    assert "stable at any penalty and takes nothing of the step, give" in told
    assert "largest stable penalties" not in told and found["doubts"] == []


def test_a_soft_and_a_hard_contact_are_told_apart():
    """Without give there is nothing to tell but that; explicit springs keep their limits."""
    lagrange = report(Scene.load("sliding-block", **SMALL, **{"contacts.face.method": "lagrange"}))
    assert "contacts.face: lagrange, no give" in "\n".join(printout(lagrange))
    plain = report(Scene.load("sliding-block", **SMALL))
    told = "\n".join(printout(plain))
    assert "largest stable penalties" in told and "stable at any penalty" not in told


DOUBTS = [
    ({"time.safety": 1.15}, "time.safety = 1.15"),
    ({"bodies.base.material.poisson_ratio": 0.4999}, "full quadrature locks"),
    ({"contacts.face.penalty": 2.0}, "a landing adds up to"),
    ({"contacts.face.penalty": 5.0}, "leaves no room"),
    (IMPLICIT | {"contacts.face.penalty": 0.4}, "gives way as much as the cells"),
    ({"bodies.base.material.youngs_modulus": 180e9}, "slip waves of"),
    ({"loads": [{"surface": "zmax", "traction": [0.0, 0.0, -9e9]}]}, "of a cell"),
]


@pytest.mark.parametrize("change, words", DOUBTS, ids=[words for _, words in DOUBTS])
def test_doubts(change, words):
    """Each extreme setting is named with its key."""
    doubts = report(Scene.load("sliding-block", **SMALL, **change))["doubts"]
    assert any(words in line for line in doubts)


def test_a_shipped_scene_gives_no_cause_to_doubt():
    assert report(Scene.load("sliding-block", **SMALL))["doubts"] == []


def test_the_sliding_state_by_itself():
    """A block is said to flutter where its eigenvalues do, and to be stable at a tenth of that.

    Without friction or motion nothing is said; where there is no steady sliding, why.
    """
    own = {"mesh.size": 5e-3, "mesh.base_size": 6e-3}
    grows = report(Scene.load("sliding-block", **own, **{"contacts.face.friction": 0.6}))
    fastest = grows["sliding"]["growing"][0]
    found = squeal(
        Scene.load("sliding-block", **own, **{"contacts.face.friction": 0.6}), top=60e3
    ).summary
    (mode,) = [mode for mode in found["modes"] if mode["kind"] != "stable"]
    assert fastest == {key: pytest.approx(mode[key], rel=1e-6) for key in fastest}
    assert any("grows by" in line and "per second" in line for line in printout(grows))
    calm = report(Scene.load("sliding-block", **own, **{"contacts.face.friction": 0.03}))
    assert calm["sliding"]["growing"] == []
    assert any("sliding state by itself: stable to" in line for line in printout(calm))
    assert report(Scene.load("bar-impact"))["sliding"] is None
    told = report(Scene.load("carter", **{"mesh.size": 1e-3, "equilibrium.tolerance": 1e-3}))
    assert "no steady sliding" in told["sliding"]["unknown"]


def test_turning_bodies_in_single_precision():
    """A roller that turns by 0.07 rad has a frame that turns with it: no doubt."""
    small = {"mesh.size": 1e-3, "time.precision": "float32", "equilibrium.tolerance": 1e-3}
    found = report(Scene.load("carter", **small))
    assert not any("float32" in line for line in found["doubts"])
    assert any("steps of" in line for line in printout(found))


@pytest.mark.parametrize("p, gain", [(1.0, 0.0), (2.0, 0.0), (3.0, 0.75), (2.5, 25 / 108)])
def test_a_landing_gains_energy_between_whole_half_periods(p, gain):
    """Integrals over the phase by hand: none at p = 1 and 2, 25/108 at 2.5, 3/4 at 3."""
    assert landing_gain(p) == pytest.approx(gain, abs=1e-5)


def test_half_space_closed_forms():
    """Static compliance (1 − ν)/μ; surface waves at 0.9194 of shear waves for ν = 1/4."""
    one = HalfSpace(80e9, 0.25, 7800.0)
    assert one.compliance(1e-2 * one.shear_speed) == pytest.approx(0.75 / 80e9, rel=1e-3)
    assert one.rayleigh_speed / one.shear_speed == pytest.approx(0.9194, abs=1e-4)


@pytest.mark.parametrize("ratio, there", [(0.9, True), (0.75, True), (0.3, False)])
def test_slip_waves_of_similar_materials(ratio, there):
    """They run between both surface waves, where pressures cancel; unlike bodies have none."""
    other = HalfSpace(ratio * STEEL.mu, STEEL.nu, STEEL.rho)
    c = slip_wave(STEEL, other)
    assert (c is not None) == there
    if c is not None:
        assert other.rayleigh_speed < c < STEEL.rayleigh_speed
        assert STEEL.compliance(c) == pytest.approx(-other.compliance(c), rel=1e-6)


SETS = ["sliding-block", "--set", "mesh.size=0.005", "--set", "mesh.base_size=0.006"]


def test_command_line(command, tmp_path, monkeypatch):
    """One JSON object on stdout; bad input exits with 2 and names the key."""
    monkeypatch.chdir(tmp_path)
    done = command("audit", *SETS, "--json")
    found = json.loads(done.stdout)
    assert {"asked", "critical", "contacts", "cost", "doubts"} <= found.keys()
    bad = command("audit", "sliding-block", "--set", "contacts.face.penalty=-1", check=False)
    assert bad.returncode == 2 and "contacts.face.penalty" in bad.stderr


@pytest.mark.mpi
def test_two_ranks_say_the_same(mpirun):
    """What is asked and where the limits are does not depend on the ranks."""
    one = report(Scene.load("sliding-block", **{"mesh.size": 0.005, "mesh.base_size": 0.006}))
    done = mpirun(2, "-m", "workflow.cli", "audit", *SETS, "--json", timeout=120)
    two = json.loads(done.stdout)
    for table in ("asked", "critical"):
        for key, value in one[table].items():
            assert two[table][key] == pytest.approx(value, rel=1e-6), key
