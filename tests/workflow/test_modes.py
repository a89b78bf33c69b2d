# SPDX-License-Identifier: LGPL-3.0-or-later
"""Modes: labels of shapes that are known, parts and how they are held, files, ranks, errors."""

import json
import sys

from mpi4py import MPI

import numpy as np
import pytest

from meshes.quality import quality
from meshes.wheel_rail.wheel import turned_wheel
from workflow import Scene
from workflow.cli import main
from workflow.modes.labels import Mode, labelled
from workflow.modes.modes import matched, modes
from workflow.modes.part import cut_out, spin_of

STEEL = 7800.0
AXLE = (np.array([0.1, -0.2, 0.3]), np.array([0.0, 1.0, 0.0]))
COARSE = ("--size", "0.016", "--to", "400")


def disc(rng: np.random.Generator, rings: bool) -> np.ndarray:
    """Nodes (radius, angle from the bottom) of a disc of radius 0.4 m, even or thrown at random."""
    if rings:
        r, angle = np.meshgrid(np.linspace(0.1, 0.4, 13), 2 * np.pi * np.arange(64) / 64)
        return np.column_stack([r.ravel(), angle.ravel()])
    return np.column_stack([rng.uniform(0.1, 0.4, 6000), rng.uniform(0, 2 * np.pi, 6000)])


def placed(disc: np.ndarray) -> np.ndarray:
    r, angle = disc.T
    return AXLE[0] + np.column_stack([r * np.sin(angle), 0 * r, -r * np.cos(angle)])


@pytest.mark.parametrize("rings", [True, False])
@pytest.mark.parametrize(("n", "m"), [(0, 0), (1, 2), (3, 1), (7, 0)])
def test_nodal_diameters_and_circles(rings, n, m):
    """Axial motion ``cos(m π s) cos(nθ + 0.4)`` over even rings and over nodes in disorder."""
    at = disc(np.random.default_rng(1), rings)
    s = (at[:, 0] - 0.1) / 0.3
    shape = np.zeros((1, len(at), 3))
    shape[0, :, 1] = np.cos(m * np.pi * s) * np.cos(n * at[:, 1] + 0.4)
    mass = np.random.default_rng(2).uniform(0.5, 1.5, len(at))
    found, _ = labelled(np.array([100.0]), shape, placed(at), mass, AXLE, hub=0.1)
    assert (found[0].diameters, found[0].circles, found[0].kind) == (n, m, "axial")
    assert found[0].purity > (0.99 if rings else 0.95)  # masses are uneven by half


def test_few_nodes_do_not_take_a_wave_for_a_shorter_one():
    """20 even nodes with 30 more in a short arc, as under a fine tread: n = 3, not an alias."""
    angle = np.concatenate([2 * np.pi * np.arange(20) / 20, np.linspace(-0.12, 0.12, 30)])
    r = np.linspace(0.1, 0.4, 40) + 1e-5 * np.random.default_rng(1).normal(size=(50, 40))
    at = np.column_stack([r.ravel(), np.repeat(angle, 40)])
    shape = np.zeros((1, len(at), 3))
    shape[0, :, 1] = at[:, 0] * np.cos(3 * at[:, 1])
    found, _ = labelled(np.array([100.0]), shape, placed(at), np.ones(len(at)), AXLE)
    assert found[0].diameters == 3


@pytest.mark.parametrize(("kind", "axis"), [("radial", 0), ("circumferential", 1)])
def test_direction_of_motion(kind, axis):
    """Radial and circumferential motion are told apart, with all the kinetic energy."""
    at = disc(np.random.default_rng(1), True)
    angle = at[:, 1]
    outward = np.column_stack([np.sin(angle), 0 * angle, -np.cos(angle)])
    around = np.column_stack([np.cos(angle), 0 * angle, np.sin(angle)])
    shape = ((outward, around)[axis] * np.cos(2 * angle)[:, None])[None]
    found, _ = labelled(np.array([100.0]), shape, placed(at), np.ones(len(at)), AXLE)
    assert found[0].kind == kind and found[0].diameters == 2
    assert found[0].shares[kind] == pytest.approx(1.0, abs=1e-12)


def test_pairs_are_found_and_turned():
    """Two modes turned at will are a pair; a third of the same order but another section is not.

    A pair of equal frequencies is given back with its first mode largest at the bottom.
    """
    at = disc(np.random.default_rng(1), True)
    r, angle = at.T
    shapes = np.zeros((3, len(at), 3))
    shapes[0, :, 1], shapes[1, :, 1] = r * np.cos(2 * angle + 1), r * np.sin(2 * angle + 1)
    shapes[2, :, 1] = np.cos(40 * r) * np.cos(2 * angle)
    f = np.array([100.0, 100.0, 101.0])
    found, turned = labelled(f, shapes, placed(at), np.ones(len(at)), AXLE)
    assert [m.partner for m in found] == [2, 1, None] and found[0].split == 0
    np.testing.assert_allclose(turned[0, :, 1], r * np.cos(2 * angle), atol=1e-12)
    apart = labelled(np.array([100.0, 102.0, 103.0]), shapes, placed(at), np.ones(len(at)), AXLE)[0]
    assert apart[0].split == pytest.approx(2 / 101)


def test_torsion_is_put_beside_torsion():
    """For n = 0 torsion does not mix with the rest: neighbours that swapped are not confused."""
    reference = [(0, 990.0, "radial"), (0, 1000.0, "circumferential")]
    ours = [Mode(1, 1001.0, "circumferential", {}, 0), Mode(2, 1010.0, "radial", {}, 0)]
    assert matched(ours, reference) == {1: 1000.0, 2: 990.0}


def test_turned_wheel():
    """Mass of the drawing within 0.5 %, no flat cell, every sector the same."""
    mesh = turned_wheel(size=0.013)
    q = quality(mesh)
    assert q.volume * STEEL == pytest.approx(345.4, rel=5e-3)
    assert q.scaled_jacobian > 0.5
    r = np.round(np.hypot(mesh.points[:, 0], mesh.points[:, 2]), 9)
    _, count = np.unique(
        np.column_stack([r, np.round(mesh.points[:, 1], 9)]), axis=0, return_counts=True
    )
    assert (count == count[0]).all()
    with pytest.raises(ValueError, match=r"size: expected 2e-3 to 20e-3 m, got 0\.1"):
        turned_wheel(size=0.1)


def test_cut_out_keeps_what_belongs_to_it():
    """The tyre alone: its cells, its surfaces, no node too many."""
    mesh = turned_wheel(size=0.016)
    tyre = cut_out(mesh, mesh.tags(["tyre"]))
    assert len(tyre.cells) == (mesh.regions == mesh.tag("tyre")).sum()
    assert len(np.unique(tyre.cells)) == len(tyre.points)
    assert len(tyre.surface(tyre.tag("tread"))) == len(mesh.surface(mesh.tag("tread")))
    assert not len(tyre.surface(tyre.tag("wheel_bore")))


def test_shapes_are_normalised_by_mass():
    """``Φᵀ M Φ = 1`` with the lumped mass of the nodes; the mass is that of the bar."""
    found = modes(Scene.load("bar-wave"), comm=MPI.COMM_SELF, top=20e3)
    assert found.summary["mass"] == pytest.approx(7800 * 0.1 * 25e-6)
    cell = found.summary["mass"] / len(found.mesh.cells)
    mass = np.bincount(found.mesh.cells.ravel()) * cell / 8
    gram = np.einsum("ani,bni,n->ab", found.shapes, found.shapes, mass)
    np.testing.assert_allclose(gram, np.eye(len(gram)), atol=1e-8)


@pytest.mark.slow
@pytest.mark.mpi
def test_two_ranks_find_the_same(command, tmp_path, monkeypatch):
    """Frequencies within 1e-9 and the same labels; fields open in pyvista and are the same."""
    import pyvista

    monkeypatch.chdir(tmp_path)
    tables, grids, words = [], [], ("modes", "flange-transition", *COARSE, "--json")
    for ranks in (1, 2):
        done = command(*words, "--out", f"r{ranks}", "--ranks", ranks)
        tables.append(json.loads(done.stdout)["modes"])
        grids.append(pyvista.read(tmp_path / f"r{ranks}" / "modes.vtkhdf"))
        assert {p.name for p in (tmp_path / f"r{ranks}" / "figures").iterdir()} == {
            "modes.png", "mode_shapes.png"
        }  # fmt: skip
    assert len(tables[0]) == 5
    for one, two in zip(*tables, strict=True):
        assert one["frequency"] == pytest.approx(two["frequency"], rel=1e-9)
        for key in ("kind", "diameters", "circles", "partner", "independent"):
            assert one[key] == two[key]
    names = [n for n in grids[0].point_data if "Hz" in n]
    assert len(names) == 5 and set(names) <= set(grids[1].point_data)
    for name in names:
        a, b = grids[0][name], grids[1][name]
        assert np.abs(a - b).max() < 1e-4 * np.abs(a).max()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("bar-wave", "--part", "tail"), "--part 'tail': expected one of bar"),
        (("bar-wave", "--held", "seat"), "--held 'seat': expected free, supports or surfaces"),
        (("bar-wave", "--held", "xmin", "--to", "100"), "no mode up to 100 Hz"),
        (("bar-wave", "--most", "5"), "9 modes up to 10000 Hz; expected at most 5"),
        (("bar-wave", "--to=-3"), "--to -3: expected a frequency above 0 Hz"),
        (("bar-wave", "--speed", "10"), "--speed 10: expected a wheel that rolls, got 'bar'"),
        (("flange-transition", "--size", "0.1"), "size: expected 2e-3 to 20e-3 m"),
    ],
)
def test_bad_input_is_named(words, message, monkeypatch, capfd, tmp_path):
    """Exit code 2, the message says what was got and what is expected, nothing is written."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["squealx", "modes", *words])
    with pytest.raises(SystemExit) as stop:
        main()
    assert stop.value.code == 2
    assert message in capfd.readouterr().err
    assert not list(tmp_path.iterdir())


def test_held_surface_and_free(tmp_path):
    """A cantilever of the bar, ``f = 1.8751² / 2π √(E I / ρ A) / L²``, within 3 %."""
    scene = Scene.load("bar-wave", **{"mesh.size": 1e-3, "bodies.bar.element": "one-point"})
    found = modes(scene, comm=MPI.COMM_SELF, held="xmin", top=1000.0)
    f = 1.8751**2 / (2 * np.pi) * np.sqrt(210e9 / 7800 / 12) * 0.005 / 0.1**2
    assert [m.frequency for m in found.modes] == pytest.approx([f, f], rel=0.03)
    free = modes(scene, comm=MPI.COMM_SELF, held="free", top=1000.0)
    assert [m.kind for m in free.modes] == ["rigid"] * 6


def test_a_turning_wheel_seen_from_the_track():
    """--speed 30: 65.2 rad/s at 0.46 m, f ± carried Ω/2π for n ≥ 1, one frequency for n = 0.

    Left out, it is the scene's 80 km/h.
    """
    scene = Scene.load("flange-transition")
    fast = modes(scene, comm=MPI.COMM_SELF, size=0.016, top=400.0, speed=30.0).summary
    assert fast["spin"] == pytest.approx(30 / 0.46)
    assert spin_of(scene, "wheelset", True, None) == pytest.approx(22.222 / 0.46)
    for mode in fast["modes"]:
        if mode["diameters"] == 0:
            assert mode["in_track"] is None
            continue
        apart = mode["carried"] * 30 / 0.46 / (2 * np.pi)
        expected = (mode["frequency"] - apart, mode["frequency"] + apart)
        assert mode["in_track"] == pytest.approx(expected)
        assert 0.95 < mode["carried"] / mode["diameters"] < 1  # axial, as all below 400 Hz
