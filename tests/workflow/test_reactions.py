# SPDX-License-Identifier: LGPL-3.0-or-later
"""Forces on the bodies in the history: they balance loads and inertia, at rest and in motion."""

from dataclasses import replace

import numpy as np
import pytest

from meshes.formats import read_write
from meshes.hexmesh import HexMesh
from meshes.shapes import blocks
from meshes.tags import Tag
from workflow import Scene, run

AREA, LENGTH = 0.005**2, 0.1
MASS = 7800 * LENGTH * AREA
IMPEDANCE = np.sqrt(210e9 * 7800) * AREA  # ρ c A [N s/m]
ROUND_OFF = 1e-9  # N, of forces of a kN
BAR = {"mesh.size": 5e-3, "output.fields": False}


def moved(scene: Scene, folder) -> tuple[dict, np.ndarray]:
    """History, and ``Σ m a`` of all nodes at every step [N]."""
    rows = []

    def watch(model):
        rows.append((model.mass.array * model.state.a.array).reshape(-1, 3).sum(axis=0))

    return run(scene, folder, watch=watch, quiet=True).history, np.array(rows)


def sums(history: dict, start: str) -> np.ndarray:
    """Sum of the forces whose names begin so, by axis and output."""
    none = np.zeros_like(history["t"])
    found = [
        [v for k, v in history.items() if k.startswith(start) and f"_{a}_f" in k] for a in "xyz"
    ]
    return np.transpose([sum(columns, none) for columns in found])


def test_supports_bear_the_load_at_rest(tmp_path):
    """100 MPa on a block on a base: 10 kN below, nothing at the sides; it comes through contact.

    Supports, load and the inertia that the rest of the static solve leaves sum up to round-off; so
    do the forces on the block alone. A base that gives makes the pressure on it uneven, and the
    contact is not quite level: the forces across are those of its slopes.
    """
    scene = Scene.load("contact-patch", **{"output.fields": False})
    history, inertia = moved(scene, tmp_path)
    every = (len(inertia) - 1) // (len(history["t"]) - 1)
    block = scene.mesh.block
    load = 100e6 * block[0] * block[1]
    total = sums(history, "support_")
    total[:, 2] -= load
    np.testing.assert_allclose(total, inertia[::every], atol=1e-12 * load)
    assert np.abs(total).max() < 2e-6 * load
    np.testing.assert_allclose(history["support_base_bottom_z_force"], load, rtol=2e-6)
    np.testing.assert_allclose(history["contact_on_block_z_force"], load, rtol=1e-4)
    np.testing.assert_allclose(history["support_xmin_x_force"], 0.0, atol=2e-6 * load)
    for axis in "xyz":
        on_block, on_base = (history[f"contact_on_{b}_{axis}_force"] for b in ("block", "base"))
        np.testing.assert_array_equal(on_block, -on_base)


def test_wall_turns_the_momentum_round(tmp_path):
    """A bar at 1 m/s: the impulse of the wall is its change of momentum, by and large 2 m v.

    Output at every step: forces times step are what momentum gains, to round-off. The wall bears
    ρ c v A in the mean until the wave is back, and nothing afterwards.
    """
    scene = Scene.load("bar-impact", **BAR, **{"time.output_interval": 4e-7})
    history, inertia = moved(scene, tmp_path)
    force, t = history["contact_on_bar_x_force"], history["t"]
    np.testing.assert_allclose(force, inertia[:, 0], atol=ROUND_OFF)
    impulse = np.sum(force) * (t[1] - t[0])
    assert impulse == pytest.approx(2 * MASS, rel=0.02)
    pressed = (t > 5e-6) & (t < 35e-6)
    assert force[pressed].mean() == pytest.approx(IMPEDANCE, rel=0.02)
    assert not force[t > 45e-6].any()


def test_clamp_stops_a_bar_and_throws_it_back(tmp_path):
    """Clamped at one end and thrown at 1 m/s: ∓ρ c v A, turning round with each wave that is back.

    The support named first bears what both hold: the second one has nothing to do.
    """
    tables = Scene.load("bar-wave", **BAR, **{"time.output_interval": 4e-7}).tables()
    tables["supports"].append({"surface": "xmin", "directions": ["x", "y"]})
    history, inertia = moved(Scene.check(tables), tmp_path)
    force, t = history["support_xmin_x_force"], history["t"]
    np.testing.assert_allclose(force, inertia[:, 0], atol=ROUND_OFF)
    np.testing.assert_allclose(history["support_xmin_y_force"], inertia[:, 1], atol=ROUND_OFF)
    back = 2 * LENGTH / np.sqrt(210e9 / 7800)
    assert force[(t > 3e-6) & (t < back - 3e-6)].mean() == pytest.approx(-IMPEDANCE, rel=0.02)
    assert force[(t > back + 3e-6) & (t < 77e-6)].mean() == pytest.approx(IMPEDANCE, rel=0.02)
    # the front is spread over a cell or two, of 40 on its way
    assert np.sum(force[t < back]) * (t[1] - t[0]) == pytest.approx(-2 * MASS, rel=0.04)


def test_shared_nodes_are_counted_once(tmp_path):
    """Two surfaces with an edge in common are both held along x: the sum is still the inertia."""
    tables = Scene.load("bar-wave", **BAR, **{"time.end": 5e-6}).tables()
    tables["supports"].append({"surface": "ymin", "directions": ["x"]})
    tables["time"]["output_interval"] = 4e-7
    history, inertia = moved(Scene.check(tables), tmp_path)
    total = history["support_xmin_x_force"] + history["support_ymin_x_force"]
    np.testing.assert_allclose(total, inertia[:, 0], atol=ROUND_OFF)
    assert np.abs(history["support_ymin_x_force"]).max() > 100


def test_moved_support_and_spring(tmp_path):
    """An end that is towed to 2 m/s, a spring at the other: both forces are what the bar gains.

    The spring pulls back with its stiffness times the way of its end.
    """
    way = []

    def watch(model):
        x = model.domain.V.tabulate_dof_coordinates()[:, 0]
        u = model.state.u.x.array.reshape(-1, 3)[:, 0]
        inertia = model.mass.array[::3] @ model.state.a.array.reshape(-1, 3)[:, 0]
        way.append((u[x > LENGTH - 1e-9].mean(), inertia))

    changes = {"time.output_interval": 4e-7, "time.end": 8e-5}
    tables = Scene.load("bar-wave", **BAR, **changes).tables()
    del tables["bodies"]["bar"]["velocity"]
    tables["supports"][0] |= {"velocity": 2.0, "begin": 1e-6, "ramp": 2e-5}
    tables["springs"] = [{"surface": "xmax", "stiffness": [1e6, 0.0, 0.0]}]
    history = run(Scene.check(tables), tmp_path, watch=watch, quiet=True).history
    end, inertia = np.transpose(way)
    spring, tow = history["connection_spring_xmax_x_force"], history["support_xmin_x_force"]
    np.testing.assert_allclose(spring, -1e6 * end, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(spring + tow, inertia, atol=1e-7)
    assert np.abs(spring).max() > 50 and np.abs(tow).max() > 500


def test_driven_surfaces(tmp_path):
    """A wheel led by its top, a rail by its underside: what leads them makes all the inertia."""
    changes = {
        "mesh.size": 4.8e-3, "mesh.base_size": 5e-3, "mesh.fine_x": [-0.01, 0.03],
        "time.end": 4e-5, "output.fields": False,
    }  # fmt: skip
    history, inertia = moved(Scene.load("tread-rolling", **changes), tmp_path)
    every = (len(inertia) - 1) // (len(history["t"]) - 1)
    total = sums(history, "support_")
    size = np.abs(total).max()
    np.testing.assert_allclose(total, inertia[::every], atol=1e-10 * size)
    down = history["support_zmax_z_force"]
    assert (down < -1e4).all() and (history["contact_on_rail_z_force"] < -1e4).all()


def halves() -> HexMesh:
    """A block of two regions, its underside one surface."""
    mesh = blocks.block((0, 0, 0), (0.02, 0.01, 0.01), cells=(4, 2, 2))
    right = mesh.points[mesh.cells].mean(axis=1)[:, 0] > 0.01
    return replace(mesh, regions=np.where(right, int(Tag.RAIL_WEB), int(Tag.RAIL_HEAD)))


def test_surface_of_two_bodies(tmp_path):
    """A block of two bodies flies onto a wall: each half of it bears its own part of the force."""
    read_write.write(halves(), tmp_path / "block.msh")
    steel = {"youngs_modulus": 210e9, "poisson_ratio": 0.0, "density": 7800.0}
    body = {"material": steel, "velocity": [0.0, 0.0, -1.0]}
    wall = {"origin": [0, 0, 0], "normal": [0, 0, 1], "half_width": 0.1}
    left, right = (body | {"regions": [name]} for name in ("rail_head", "rail_web"))
    tables = {
        "name": "halves", "title": "A block of two bodies",
        "mesh": {"kind": "file", "path": str(tmp_path / "block.msh")},
        "bodies": {"left": left, "right": right},
        "contacts": {"wall": {"contactor": "zmin", "target": wall, "penalty": 0.3}},
        "time": {"end": 2e-6, "output_interval": 1e-6},
    }  # fmt: skip
    history, inertia = moved(Scene.check(tables), tmp_path / "run")
    left, right = (history[f"contact_on_{body}_z_force"] for body in ("left", "right"))
    every = (len(inertia) - 1) // (len(history["t"]) - 1)
    np.testing.assert_allclose(left + right, inertia[::every, 2], rtol=1e-9, atol=ROUND_OFF)
    # the nodes in the middle count as the first body's: 3 of 5 rows, two of them at full weight
    np.testing.assert_allclose(left[1:] / right[1:], (0.5 + 1 + 1) / (1 + 0.5), rtol=0.05)


def test_without_supports_nothing_is_watched(tmp_path):
    """A bar that flies free has no such columns, and its steps are held by nothing."""
    tables = Scene.load("bar-wave", **BAR, **{"time.end": 2e-6}).tables() | {"supports": []}
    history = run(Scene.check(tables), tmp_path, quiet=True).history
    assert not [
        name for name in history if name.startswith(("support", "connection", "contact_on"))
    ]
