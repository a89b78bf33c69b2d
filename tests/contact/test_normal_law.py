# SPDX-License-Identifier: LGPL-3.0-or-later
"""Normal laws: hand numbers, no gap and no tension, sums, energies, overlap at the start, step."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from contact import ContactPair, rigid_plane
from contact.normal_law import largest_rates, node_foundation
from contact.surface import tributary_area
from tests.skins import (
    RHO_H,
    evaluate,
    plate_on_plane,
    skin,
    stacked,
    tangent_of,
    two_skins,
)
from workflow import Scene, run
from workflow.scene.scene import SceneError
from workflow.simulation.guards import GuardError

BED = 1.75e11 / 1e-3  # bulk modulus of steel over the height of a cell [Pa/m]
METHODS = {
    "penalty": {"damping": 0.1},
    "modulus-penalty": {"method": "modulus-penalty", "penalty": 1e-5, "damping": 0.1},
    "lagrange": {"method": "lagrange"},
    "points": {"points": "quadrature", "damping": 0.1},
    "implicit points": {"method": "implicit-penalty", "penalty": 30.0, "points": "quadrature"},
}


def bedded(*surfaces):
    """The surfaces with a foundation modulus on every facet."""
    return [replace(s, foundation=np.full(len(s.facets), BED)) for s in surfaces]


def step(pair, state, mass, load):
    """One step of central difference under ``load``; the force of the pair ``(n, 3)``."""
    force = SimpleNamespace(array=load.copy())
    pair.add(state, force)
    state.v.x.array[:] += pair.dt * force.array / mass
    state.u.x.array[:] += pair.dt * state.v.x.array
    state.t += pair.dt
    return (force.array - load).reshape(-1, 3)


@pytest.mark.parametrize("friction", [0.0, 0.3, 1.5])
@pytest.mark.parametrize("smooth", [False, True])
@pytest.mark.parametrize("kind", [*METHODS, "two passes"])
def test_row_11_action_equals_reaction_and_cone(kind, smooth, friction):
    """Two free skins thrown at each other and shaken: forces and moments sum to zero every step.

    To 1e-12 of their sizes; the friction of every node stays in its cone.
    """
    lower, upper = bedded(*two_skins())
    options = {"dt": 1e-6, "friction": friction, "smooth": smooth}
    if kind == "two passes":
        pair = ContactPair(upper, lower, two_pass=True, damping=0.1, **options)
    else:
        pair = ContactPair(upper, lower, **options, **METHODS[kind])
    X, state = stacked(lower, upper)
    mass = np.repeat(np.concatenate([lower.mass, upper.mass]), 3)
    rng, top = np.random.default_rng(3), slice(len(lower.nodes), None)
    v = state.v.x.array.reshape(-1, 3)
    v[top] = [5.0, 3.0, -20.0]
    v += 0.3 * rng.normal(size=v.shape)
    most = 0
    for _ in range(200):
        x = X + state.u.x.array.reshape(-1, 3)
        x = x - x.mean(axis=0)
        load = 1e4 * mass * rng.normal(size=mass.size)
        f = step(pair, state, mass, load)
        # f is a difference of vectors that hold the load too
        size, most = np.abs(f).sum() + 1e-3 * np.abs(load).sum(), max(most, pair.active)
        assert np.abs(f.sum(axis=0)).max() <= 1e-12 * size
        assert np.abs(np.cross(x, f).sum(axis=0)).max() <= 1e-12 * size * 0.05
        for side in pair.passes:
            h = side.contact_state
            over = np.linalg.norm(h.tangential_force, axis=1) - friction * h.normal_force
            assert over.max() <= 1e-12 * h.normal_force.max() and h.normal_force.min() >= 0.0
    assert most >= 3


def test_modulus_hand_numbers():
    """k = penalty K A^2 / V: A the smaller of both sides, K / height the softer; any step."""
    lower = skin(3, 3, 0.03, 0.03, lambda x, y: 0 * x, up=True)
    upper = skin(1, 1, 0.01, 0.01, lambda x, y: 0.02 + 0 * x, up=False, origin=(0.015, 0.015),
                 dof=16, first=50)  # fmt: skip
    lower, upper = bedded(lower, upper)
    lower = replace(lower, foundation=0.5 * lower.foundation)
    for dt in (1e-7, 1e-6):
        pair = ContactPair(upper, lower, dt=dt, method="modulus-penalty", penalty=0.1)
        _, state = stacked(lower, upper)
        u = state.u.x.array.reshape(-1, 3)
        u[16] = [0.0, 0.0, -0.02 - 1e-6]  # a quarter cell over the centre of a facet
        f = evaluate(pair, state)
        assert f[16, 2] == pytest.approx(0.1 * 0.5 * BED * 0.25e-4 * 1e-6, rel=1e-9)


def test_modulus_needs_moduli():
    lower, upper = two_skins()
    with pytest.raises(ValueError, match="bulk moduli"):
        ContactPair(upper, lower, dt=1e-6, method="modulus-penalty")


def test_modulus_rates_bound_what_is_found():
    """largest_rates against K/M of assembled contact springs, random skins and contacts."""
    rng = np.random.default_rng(5)
    largest = 0.0
    for seed in range(6):
        lower, upper = two_skins()
        lower, upper = bedded(lower, upper)
        lower = replace(lower, mass=lower.mass * rng.uniform(0.3, 1.0, len(lower.mass)))
        upper = replace(upper, foundation=upper.foundation * rng.uniform(0.2, 3, len(upper.facets)))
        pair = ContactPair(upper, lower, dt=1e-9, method="modulus-penalty", penalty=0.7)
        _, state = stacked(lower, upper)
        u = state.u.x.array.reshape(-1, 3)
        u[len(lower.nodes) :] = [*rng.uniform(-4e-3, 4e-3, 2), -6e-4]
        K = tangent_of(pair, state, lower, upper)
        assert pair.active > 5, seed
        root = np.repeat(np.concatenate([lower.mass, upper.mass]), 3) ** -0.5
        K = root[:, None] * K * root
        square, rate = largest_rates(upper, lower, 0.7, 0.5)
        assert rate == pytest.approx(square**0.5)
        largest = max(largest, np.linalg.eigvalsh(K)[-1] / square)
    assert 0.2 < largest <= 1.0


def test_lagrange_leaves_no_gap_and_no_tension():
    """A plate pressed and pulled on a plane: gap 0 to round-off while pressed, then it leaves."""
    plate, pair, state = plate_on_plane(0.0, method="lagrange")
    mass = np.repeat(plate.mass, 3)
    state.u.x.array[2::3] += 2e-6
    gaps, pressing = [], []
    for k in range(120):
        load = np.zeros(mass.size)
        load[2::3] = mass[2::3] * 1e5 * np.cos(k / 40 * np.pi / 2) * (1 + 0.3 * np.sin(3.0 * k))
        step(pair, state, mass, -load)
        gaps.append((state.u.x.array[2::3] - 1e-6).min())
        pressing.append(pair.passes[0].contact_state.normal_force.copy())
    pressing = np.array(pressing)
    touch = pressing.max(axis=1) > 0
    assert (pressing >= 0).all() and 10 < touch.sum() < 80 and not touch[-30:].any()
    assert np.abs(np.array(gaps)[touch]).max() <= 1e-18
    assert gaps[-1] > 1e-6


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_lagrange_energy(friction):
    """What an impact of the surface nodes takes and friction are counted; the rest stays, 1e-12."""
    plate, pair, state = plate_on_plane(friction, method="lagrange")
    u, v = state.u.x.array, state.v.x.array
    mass, load = np.repeat(plate.mass, 3), np.zeros(u.size)
    u[2::3], v[0::3], v[2::3] = 1.5e-6, 0.2, -0.05
    load[2::3] = -0.1 * mass[2::3] / pair.dt**2 * 1e-6
    work, start, error = 0.0, None, 0.0
    for _ in range(400):
        before, height = v.copy(), load @ u
        step(pair, state, mass, load)
        lost = pair.friction_dissipation + pair.damping_dissipation
        energy = 0.5 * mass @ (before * v) + lost - work
        start = energy if start is None else start
        error = max(error, abs(energy - start))
        work += load @ u - height
    assert pair.damping_dissipation > 0.5 * start  # a lumped plate has nothing else
    assert (pair.friction_dissipation > 0.1 * start) == (friction > 0)
    assert error <= 1e-12 * start


def test_lagrange_sticks_and_slips():
    """Pushed with 0.9 of the limit it stays to round-off; with 1.1 it gets what is left."""
    for share in (0.9, 1.1):
        plate, pair, state = plate_on_plane(0.4, method="lagrange")
        mass = np.repeat(plate.mass, 3)
        state.u.x.array[2::3] = 1e-6
        load = np.zeros(mass.size)
        load[2::3], load[0::3] = -1e4 * mass[2::3], 0.4 * share * 1e4 * mass[0::3]
        for _ in range(50):
            step(pair, state, mass, load)
        speed = state.v.x.array[0::3]
        gain = 50 * pair.dt * 1e4 * 0.4 * max(share - 1, 0)
        assert speed == pytest.approx(np.full(25, gain), abs=1e-14)
        assert pair.tangential_force[0] == pytest.approx(
            -0.4 * min(share, 1) * 1e4 * mass[0::3].sum()
        )


def test_initial_overlap():
    """Push: the spring acts at once. Offset: no force, reported, fading if asked, until release."""
    _, pair, state = plate_on_plane(0.0)
    assert evaluate(pair, state)[:, 2].sum() > 0 and pair.initial_offsets == (0, 0.0)
    _, pair, state = plate_on_plane(0.0, initial_overlap="offset")
    assert (evaluate(pair, state) == 0).all()
    count, depth = pair.initial_offsets
    assert count == 25 and depth == pytest.approx(1e-6, rel=1e-12)
    state.u.x.array[2::3] = -1e-7  # deeper than at first
    deeper = evaluate(pair, state)[:, 2].sum()
    assert pair.max_penetration == pytest.approx(1.1e-6, rel=1e-9)
    state.u.x.array[2::3] = 1.1e-6
    evaluate(pair, state)  # released: from now on the whole gap counts
    state.u.x.array[2::3] = -1e-7
    assert evaluate(pair, state)[:, 2].sum() == pytest.approx(11 * deeper, rel=1e-6)
    _, pair, state = plate_on_plane(0.0, initial_overlap="offset", offset_time=1e-5)
    full = 0.2 * RHO_H * 0.04**2 / 1e-12 * 1e-6
    for k in range(15):
        state.t = k * 1e-6
        assert evaluate(pair, state)[:, 2].sum() == pytest.approx(min(k / 10, 1) * full, rel=1e-9)


@pytest.mark.parametrize("smooth", [False, True])
@pytest.mark.parametrize("kind", [*METHODS, "two passes"])
def test_memory_resumes_bitwise(kind, smooth):
    """Stop and go on in a new pair: the same forces to the last bit."""
    lower, upper = bedded(*two_skins())
    options = {"dt": 1e-6, "friction": 0.3, "smooth": smooth}

    def made():
        if kind == "two passes":
            return ContactPair(upper, lower, two_pass=True, **options)
        return ContactPair(upper, lower, **options, **METHODS[kind])

    one, two = made(), made()
    X, state = stacked(lower, upper)
    mass = np.repeat(np.concatenate([lower.mass, upper.mass]), 3)
    rng, touched = np.random.default_rng(7), 0
    state.v.x.array.reshape(-1, 3)[len(lower.nodes) :] = [4.0, 1.0, -30.0]
    for k in range(90):
        load = 1e4 * mass * rng.normal(size=X.size)
        if k == 40:
            two.restore(one.memory())
        if k >= 40:
            other = SimpleNamespace(array=load.copy())
            two.add(state, other)
        f = step(one, state, mass, load)
        if k >= 40:
            assert (other.array.reshape(-1, 3) - load.reshape(-1, 3) == f).all()
            assert two.max_penetration == one.max_penetration
        touched += one.active
    assert touched > 0 and two.damping_dissipation == one.damping_dissipation


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"method": "magic"}, "method: expected one of penalty"),
        ({"method": "lagrange", "damping": 0.1}, "damping: expected 0 with method"),
        ({"sharp_angle": 4.0}, "sharp_angle"),
        ({"initial_overlap": "jump"}, "initial_overlap"),
        ({"points": "centres"}, "points: expected one of nodes, quadrature"),
        ({"offset_time": -1.0}, "offset_time"),
    ],
)
def test_bad_options(change, message):
    lower, upper = two_skins()
    with pytest.raises(ValueError, match=message):
        ContactPair(upper, lower, **({"dt": 1e-6} | change))
    plane = rigid_plane((0, 0, 0), (0, 0, 1), 1.0)
    with pytest.raises(ValueError, match="two deformable surfaces"):
        ContactPair(upper, plane, two_pass=True, dt=1e-6)
    with pytest.raises(ValueError, match="expected a penalty method"):
        ContactPair(upper, lower, two_pass=True, dt=1e-6, method="lagrange")


def test_node_foundation_is_the_mean_of_the_facets():
    values = np.arange(1.0, 31.0)
    flat = skin(6, 5, 0.06, 0.05, lambda x, y: 0 * x, up=True)
    flat = replace(flat, foundation=values)
    assert node_foundation(flat)[0] == pytest.approx(1.0)
    assert node_foundation(flat) @ tributary_area(flat) == pytest.approx(values.sum() * 1e-4)


# whole runs

E, RHO, SPEED, LENGTH, WIDTH = 210e9, 7800.0, 1.0, 0.1, 0.005
C = np.sqrt(E / RHO)


def momentum(model, body):
    """Momentum of a body at t, shape ``(3,)`` [kg m/s]."""
    dofs, state = model.bodies.dofs(body), model.state
    v = (state.v.x.array + model.dt / 2 * state.a.array).reshape(-1, 3)[dofs]
    return model.mass.array[::3][dofs] @ v


def watched(scene, folder, probe):
    """History of a quiet run, and what ``probe(model)`` returned at every step, as columns."""
    rows = []
    result = run(scene, folder, watch=lambda model: rows.append(probe(model)), quiet=True)
    return result.history, np.array(rows).T


def two_bars(size, base_size):
    """A bar falls at 1 m/s on a free one of the same size, cut into other cells."""
    steel = {"youngs_modulus": E, "poisson_ratio": 0.0, "density": RHO}
    half = [WIDTH, WIDTH, LENGTH / 2]
    blocks = {"kind": "block-on-base", "block": half, "base": half}
    return Scene.check(
        {
            "name": "bars",
            "title": "Two equal bars",
            "mesh": blocks | {"size": size, "base_size": base_size},
            "bodies": {
                "block": {"regions": ["block"], "material": steel, "velocity": [0, 0, -SPEED]},
                "base": {"regions": ["base"], "material": steel},
            },
            "contacts": {
                "face": {
                    "contactor": "block_bottom",
                    "target": "base_top",
                    "method": "lagrange",
                }
            },
            "time": {"end": 30e-6, "output_interval": 1e-6, "safety": 0.5},
            "output": {"fields": False},
        }
    )


def test_row_8_lagrange_bar_against_wall(tmp_path):
    """Force ρ c v A to 0.1 %; the impact of the end nodes takes half a cell's kinetic energy."""

    def probe(m):
        return m.state.t, m.pairs["wall"].normal_force, m.pairs["wall"].damping_dissipation

    scene = Scene.load("bar-impact", **{"output.fields": False, "contacts.wall.method": "lagrange"})
    history, (t, force, lost) = watched(scene, tmp_path, probe)
    T = 2 * LENGTH / C
    middle = (t > T / 4) & (t < 3 * T / 4)
    assert force[middle].mean() / (RHO * C * SPEED * WIDTH**2) == pytest.approx(1, abs=1e-3)
    assert t[force > 0][-1] == pytest.approx(T, abs=scene.mesh.size / C)
    bar = 0.5 * RHO * LENGTH * WIDTH**2 * SPEED**2
    assert lost[-1] / bar == pytest.approx(scene.mesh.size / 2 / LENGTH, rel=1e-6)
    assert np.abs(history["balance_error"]).max() < 1e-12


@pytest.mark.parametrize("base_size", [0.00125, 0.001, 0.0017])
def test_row_9_lagrange_two_bars(tmp_path, base_size):
    """Stress ρ c v/2 to 0.1 %, momentum to 1e-12, no penetration: 1e-12 m, matching or not."""

    def probe(m):
        pair, bodies = m.pairs["face"], (momentum(m, "block")[2], momentum(m, "base")[2])
        return m.state.t, pair.normal_force, pair.max_penetration, *bodies

    scene = two_bars(0.00125, base_size)
    history, (t, force, depth, block, base) = watched(scene, tmp_path, probe)
    T, whole = LENGTH / C, RHO * WIDTH**2 * LENGTH / 2 * SPEED
    middle = (t > 0.3 * T) & (t < 0.7 * T)
    assert force[middle].mean() / WIDTH**2 == pytest.approx(RHO * C * SPEED / 2, rel=1e-3)
    assert np.abs(block + base + whole).max() <= 1e-12 * whole
    assert depth.max() <= 1e-12 and force.max() > 0
    assert base[-1] == pytest.approx(-whole, rel=0.02)
    assert np.abs(history["balance_error"]).max() < 1e-6


STIFF = [
    {"penalty": 1e-3},
    {"penalty": 1.0},
    {"penalty": 10.0},
    {"damping": 2.0, "penalty": 0.2},
    {"damping": 2.0, "penalty": 1.0},
    {"method": "modulus-penalty", "penalty": 1e-3},
    {"method": "modulus-penalty", "penalty": 10.0},
    {"method": "modulus-penalty", "penalty": 1.0, "damping": 2.0},
]


@pytest.mark.parametrize("change", STIFF, ids=str)
def test_stiff_contacts_end_stable_or_guarded(tmp_path, change):
    """bar-impact at 0.9 of the bound: balanced within 2 %, or a guard where no step is stable."""
    keys = {f"contacts.wall.{key}": value for key, value in change.items()}
    scene = Scene.load("bar-impact", **{"output.fields": False, "time.safety": 0.9}, **keys)
    p, damping = change.get("penalty", 0.3), change.get("damping", 0.0)
    hopeless = "method" not in change and p / 4 + damping * p**0.5 >= 1
    if hopeless:
        with pytest.raises(GuardError, match="energy balance error"):
            run(scene, tmp_path / "out", quiet=True)
        log = (tmp_path / "out" / "run.log").read_text()
        assert "no step is stable" in log
        return
    history = run(scene, tmp_path / "out", quiet=True).history
    assert np.abs(history["balance_error"]).max() < 0.02
    assert history["wall_normal_force"].max() > 0


@pytest.mark.parametrize("method", ["penalty", "modulus-penalty", "lagrange"])
@pytest.mark.parametrize("friction", [0.0, 1.5])
def test_sliding_block_with_every_law(tmp_path, method, friction):
    """Friction 0 and 1.5, every law: balanced to 1 %, block stays on its base."""
    keys = {"contacts.face.method": method, "contacts.face.friction": friction}
    scene = Scene.load("sliding-block", **{"output.fields": False}, **keys)
    history = run(scene, tmp_path / "out", quiet=True).history
    assert np.abs(history["balance_error"]).max() < 0.01
    assert (history["face_normal_force"] > 0).mean() > 0.9


def test_scene_refuses_what_does_not_go_together():
    with pytest.raises(SceneError, match=r"damping = 0.1: expected 0 with method = 'lagrange'"):
        Scene.load(
            "bar-impact", **{"contacts.wall.method": "lagrange", "contacts.wall.damping": 0.1}
        )
    with pytest.raises(SceneError, match="two_pass = true: expected a penalty method"):
        Scene.load("bar-impact", **{"contacts.wall.two_pass": True})
    with pytest.raises(SceneError, match=r"contacts\.wall\.method"):
        Scene.load("bar-impact", **{"contacts.wall.method": "magic"})


def test_two_passes_run_with_all_guards(tmp_path):
    """A run in two passes that must stay in touch goes through, with the ledger closed."""
    changes = {"contacts.face.two_pass": True, "contacts.face.keep": True, "time.end": 4e-6}
    scene = Scene.load("sliding-block", **changes, **{"output.fields": False})
    history = run(scene, tmp_path, quiet=True).history
    assert np.abs(history["balance_error"]).max() < 1e-3
    assert history["face_normal_force"].min() > 0
