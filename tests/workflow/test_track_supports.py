# SPDX-License-Identifier: LGPL-3.0-or-later
"""The track under the rail and the vehicle on it: parts, statics, preload, ends, bad keys."""

from dataclasses import replace
from functools import lru_cache
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from dolfinx import la

from forms.loads import nodal_traction
from forms.springs.connections import Connections
from forms.springs.springs import Springs
from meshes.formats import read_write
from meshes.hexmesh import HexMesh, join
from meshes.tags import Tag
from meshes.wheel_rail.rail import rail
from meshes.wheel_rail.sleepers import sleepers
from tests.beams import beam_section, foundation_deflection
from workflow.model.model import Model, build
from workflow.model.track import sleeper_bodies
from workflow.scene.scene import Scene, SceneError
from workflow.simulation.initial import rest, start
from workflow.simulation.rolling import follow
from workflow.simulation.stepping import steps

STEEL = {"youngs_modulus": 210e9, "poisson_ratio": 0.3, "density": 7800.0}
CONCRETE = {"youngs_modulus": 38.4e9, "poisson_ratio": 0.2, "density": 2520.0}
PAD, BALLAST, SPACING = 1300e6, 45e6, 0.6
TRACK = {
    "seat": "foot_underside", "seat_length": 0.15,
    "pad_stiffness": [130e6, 130e6, PAD], "pad_damping": [4.5e3, 4.5e3, 45e3],
    "ballast_stiffness": BALLAST, "ballast_damping": 32e3,
}  # fmt: skip
SOLID = {"sleeper_top": "sleeper_top", "sleeper_bottom": "sleeper_bottom"}
POINTS = {"sleeper_mass": 219.0, "sleeper_spacing": SPACING}
NOBODY = np.zeros((0, 3))


@lru_cache
def rail_and_sleepers(length: float, inclination: float) -> tuple[HexMesh, HexMesh]:
    """Some rail, facets of its top within 40 mm of x = 0 and 0.3 m marked, and its sleepers."""
    mesh = rail(length, -length / 2, size=8e-3, zone=(-0.05, 0.05), inclination=inclination)
    middle = mesh.points[mesh.facets].mean(axis=1)
    top = (mesh.surfaces == Tag.RAILHEAD) & (middle[:, 2] > -0.002)
    marked = mesh.surfaces.copy()
    for tag, x in ((Tag.CAP, 0.0), (Tag.BLOCK_TOP, 0.3)):
        marked[top & (np.abs(middle[:, 0] - x) < 0.04)] = tag
    foot = mesh.points[np.unique(mesh.surface(Tag.FOOT_UNDERSIDE))]
    below = sleepers(foot, spacing=SPACING, length=1.26, width=0.3, height=0.23, pad=0.01)
    return replace(mesh, surfaces=marked), below


def scene(
    folder, *, length: float = 2.0, inclination: float = 0.025, solid: bool = True, **changes: Any
) -> Scene:
    """A rail on its track, from a mesh file."""
    upper, below = rail_and_sleepers(length, inclination)
    path = folder / "track.msh"
    read_write.write(join(upper, below) if solid else upper, path)
    bodies = {"rail": {"regions": ["rail_head", "rail_web", "rail_foot"], "material": STEEL}}
    held = []
    if solid:
        bodies["sleepers"] = {"regions": ["sleeper"], "material": CONCRETE}
        held = [
            {"surface": "sleeper_bottom", "directions": ["x", "y"]},
            {"surface": "sleeper_inner", "directions": ["y"]},
        ]
    tables = {
        "name": "track",
        "title": "A rail on its track",
        "mesh": {"kind": "file", "path": str(path)},
        "bodies": bodies,
        "supports": held,
        "track": TRACK | (SOLID if solid else POINTS),
        "time": {"end": 1e-6, "output_interval": 1e-6, "bound": "cell"},
    }
    return Scene.check(tables).with_(**changes)


def links(model: Model) -> list[Springs]:
    """Links of a model: pads, ballast under solid sleepers, dashpots, suspension."""
    assert model.connections is not None
    return model.connections.links


def test_all_parts_of_a_solid_track(tmp_path):
    """Three sleepers: pads and ballast sum to the data of each, in every direction."""
    model = build(scene(tmp_path), MPI.COMM_SELF)
    pads, ballast = links(model)
    np.testing.assert_allclose(pads.stiffness.sum(axis=0), 3 * np.array(TRACK["pad_stiffness"]))
    np.testing.assert_allclose(pads.damping.sum(axis=0), 3 * np.array(TRACK["pad_damping"]))
    np.testing.assert_allclose(ballast.stiffness.sum(axis=0), [0, 0, 3 * BALLAST])
    np.testing.assert_allclose(ballast.damping.sum(axis=0), [0, 0, 3 * 32e3])
    assert (ballast.point == -1).all() and not len(model.connections.masses.mass)
    mass = model.mass.array[::3][model.bodies.dofs("sleepers")].sum()
    assert mass == pytest.approx(3 * 219.0, rel=1e-3)


def test_all_parts_of_a_track_of_point_masses(tmp_path):
    """The same pads between the rail and three masses of 219 kg on the ballast."""
    model = build(scene(tmp_path, solid=False), MPI.COMM_SELF)
    (pads,), masses = links(model), model.connections.masses
    np.testing.assert_allclose(pads.stiffness.sum(axis=0), 3 * np.array(TRACK["pad_stiffness"]))
    assert np.bincount(pads.point, pads.stiffness[:, 2]) == pytest.approx([PAD] * 3)
    np.testing.assert_allclose(masses.mass, 219.0)
    np.testing.assert_allclose(masses.base_stiffness, np.outer(np.ones(3), [0, 0, BALLAST]))


@pytest.mark.parametrize("solid", [True, False])
def test_the_track_carries_its_weight(tmp_path, solid):
    """At rest pads carry the rail, ballast rail and sleepers, to 1e-6; and no pad pulls sideways.

    Pads push rail and sleepers by the same force, so their sum over both is nothing.
    """
    model = build(
        scene(tmp_path, solid=solid, gravity=[0.0, 0.0, -9.81], equilibrium={}), MPI.COMM_SELF
    )
    rest(model)
    u, m = model.state.u.x.array, model.mass.array[::3]
    weight = 9.81 * m[model.bodies.dofs("rail")].sum()
    sleeper = 9.81 * (m[model.bodies.dofs("sleepers")].sum() if solid else 3 * 219.0)
    if solid:
        pads, ballast = links(model)
        carried = -(ballast.stiffness * ballast.stretch(u, NOBODY)).sum(axis=0)[2]
        through = -(pads.stiffness * pads.stretch(u, NOBODY)).sum(axis=0)
        both = np.zeros_like(u)
        pads.add(u, 0 * u, model.connections.masses, both, NOBODY, 0.0)
        assert np.abs(both.reshape(-1, 3).sum(axis=0)).max() < 1e-12 * weight
    else:
        (pads,), masses = links(model), model.connections.masses
        carried = -BALLAST * masses.u[:, 2].sum()
        through = -(pads.stiffness * pads.stretch(u, masses.u)).sum(axis=0)
    force = la.vector(model.domain.V.dofmap.index_map, 3)
    model.connections.rest(model.state, force)
    told = dict(model.connections.forces())
    np.testing.assert_allclose(told["pads"], through, rtol=0, atol=1e-9 * weight)
    np.testing.assert_allclose(told["ballast"], [0, 0, carried], rtol=0, atol=1e-9 * weight)
    assert carried == pytest.approx(weight + sleeper, rel=1e-6)
    assert through[2] == pytest.approx(weight, rel=1e-6)
    assert np.abs(through[:2]).max() < 1e-6 * weight


@pytest.mark.slow
def test_row_20_deflection_on_pads_and_sleepers(tmp_path):
    """100 kN on 8 m of rail, rigid sleepers, pads without shear: an endless beam, 3 %.

    w = F/π ∫ dq / (k + (1/EIq⁴ + 1/κGAq²)⁻¹) with k of pad and ballast in series over 0.6 m;
    the web's deflection, mean of a force over a sleeper and one between two: 2.3 % below it.
    """
    mesh, _ = rail_and_sleepers(8.0, 0.0)
    ends = mesh.surface(Tag.RAIL_ENDS)
    end = ends[(mesh.points[ends][:, :, 0] < 0).all(axis=1)]
    nodes, quads = np.unique(end, return_inverse=True)
    section = beam_section(mesh.points[nodes, 1:], quads.reshape(-1, 4)[:, ::-1])
    bending = STEEL["youngs_modulus"] * section.vertical
    shearing = STEEL["youngs_modulus"] / 2.6 * section.area * section.shear
    k = 1 / (1 / PAD + 1 / BALLAST) / SPACING
    expected = foundation_deflection(1e5, k, bending, shearing)
    rigid = {"bodies.sleepers.material.youngs_modulus": 1e13, "track.ends": "fixed"}
    rigid |= {"track.pad_stiffness": [1e3, 1e3, PAD], "equilibrium": {}}
    found = []
    for surface, x in (("cap", 0.0), ("block_top", 0.3)):
        area = nodal_traction(
            mesh.points, mesh.surface(Tag[surface.upper()]), np.array([1.0, 0, 0])
        )
        load = {"surface": surface, "traction": [0.0, 0.0, -1e5 / area.sum()]}
        entry = scene(tmp_path, length=8.0, inclination=0.0, loads=[load], **rigid)
        model = build(entry, MPI.COMM_SELF)
        rest(model)
        X = model.domain.V.tabulate_dof_coordinates()
        web = (np.abs(X[:, 0] - x) < 0.02) & (np.abs(X[:, 2] - section.centroid[1]) < 0.02)
        found.append(-model.state.u.x.array[2::3][web].mean())
    assert np.mean(found) == pytest.approx(expected, rel=0.03)


@pytest.mark.parametrize("solid", [True, False])
def test_sleepers_start_with_the_rail_over_them(tmp_path, solid):
    """A rail that turns about y with 0.1 rad/s: each sleeper moves as the rail at its middle."""
    model = build(scene(tmp_path, solid=solid), MPI.COMM_SELF)
    X, v = model.domain.V.tabulate_dof_coordinates(), model.state.v.x.array.reshape(-1, 3)
    over = model.bodies.dofs("rail")
    v[over, 2] = 0.2 - 0.1 * X[over, 0]
    follow(model)
    middles = SPACING * np.arange(-1, 2)
    if not solid:
        np.testing.assert_allclose(model.connections.masses.v[:, 2], 0.2 - 0.1 * middles)
        return
    dofs = model.bodies.dofs("sleepers")
    nearest = SPACING * np.round(X[dofs, 0] / SPACING)
    np.testing.assert_allclose(v[dofs, 2], 0.2 - 0.1 * nearest, rtol=1e-12)
    assert sleeper_bodies(model.scene, model.domain) == {"sleepers"}


# the ends of the rail


def test_ends_of_the_rail(tmp_path):
    """Fixed: a support along x. Absorbing: √(E ρ) A along x, √(μ ρ) A across. Free: neither."""
    upper, _ = rail_and_sleepers(2.0, 0.025)
    free = build(scene(tmp_path, solid=False), MPI.COMM_SELF)
    fixed = build(scene(tmp_path, solid=False, **{"track.ends": "fixed"}), MPI.COMM_SELF)
    damped = build(scene(tmp_path, solid=False, **{"track.ends": "absorbing"}), MPI.COMM_SELF)
    ends = len(np.unique(upper.surface(Tag.RAIL_ENDS)))
    assert [len(m.supports.dofs) for m in (free, fixed, damped)] == [0, 1, 0]
    assert len(fixed.supports.dofs[0]) == ends
    np.testing.assert_array_equal(fixed.supports.directions[0], [1, 0, 0])
    assert len(links(free)) == len(links(fixed)) == 1  # pads alone
    _, dashpots = links(damped)
    x = upper.points[upper.surface(Tag.RAIL_ENDS)]
    area = np.linalg.norm(np.cross(x[:, 2] - x[:, 0], x[:, 3] - x[:, 1]), axis=1).sum() / 2
    normal, shear = (np.sqrt(E * 7800.0) * area for E in (210e9, 210e9 / 2.6))
    np.testing.assert_allclose(
        dashpots.damping.sum(axis=0), np.diag([normal, shear, shear]), rtol=1e-9, atol=1e-9 * normal
    )


# vehicle


def sprung() -> Scene:
    """The block of sliding-block pressed onto its base by 50 kg on a spring, without friction."""
    vehicle = {"journal": "zmax", "sprung_mass": 50.0}
    vehicle |= {"suspension_stiffness": 1e6, "suspension_damping": 2e3}
    changes = {
        "vehicle": vehicle,
        "loads": [],
        "gravity": [0.0, 0.0, -9.81],
        "bodies.block.velocity": None,
        "contacts.face.friction": 0.0,
        "supports": [
            {"surface": "base_bottom", "directions": ["x", "y", "z"]},
            {"surface": "zmax", "directions": ["x", "y"]},
        ],
        "equilibrium.hold": [],
        "equilibrium.tolerance": 1e-10,
    }
    return Scene.load("sliding-block", **changes)


def test_vehicle_is_preloaded_and_starts_without_a_jump():
    """The suspension carries m g, the contact the block too; 500 steps move nothing.

    Forces at rest to 1e-6; then velocities stay below 1e-6 of what the weight gives in that time.
    """
    model = build(sprung(), MPI.COMM_SELF)
    start(model, lambda line: None)
    u, connections = model.state.u.x.array, model.connections
    (suspension,) = links(model)
    assert isinstance(connections, Connections)
    stretch = suspension.stretch(u, connections.masses.u)[0, 2]
    assert 1e6 * stretch == pytest.approx(50 * 9.81, rel=1e-9)
    block = model.mass.array[::3][model.bodies.dofs("block")].sum()
    (pair,) = model.pairs.values()
    assert pair.normal_resultant[2] == pytest.approx(9.81 * (50 + block), rel=1e-6)
    assert not model.state.v.x.array.any() and not connections.masses.v.any()
    fastest = max(np.abs(s.v.x.array).max() for s in steps(model, 500 * model.dt))
    assert model.state.step == 500
    assert fastest < 1e-6 * 9.81 * 50 / block * 500 * model.dt
    assert np.abs(connections.masses.v).max() < 1e-6 * 9.81 * 500 * model.dt


# bad input

BAD = {
    "both": ({"sleeper_mass": 219.0}, "track: expected either sleeper_top and sleeper_bottom"),
    "half": ({"sleeper_bottom": None}, "got sleeper_top"),
    "surface": ({"sleeper_top": "top"}, "track.sleeper_top = 'top': expected one of"),
    "ends": ({"ends": "fixed", "end_surface": "end"}, "track.end_surface = 'end': expected one of"),
    "kind": ({"ends": "open"}, "track.ends = 'open': expected 'fixed', 'free' or 'absorbing'"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_keys(tmp_path, case):
    """The key, what it got and what it expects."""
    changes, message = BAD[case]
    with pytest.raises(SceneError, match=message):
        scene(tmp_path).with_(**{f"track.{key}": value for key, value in changes.items()})


def test_surfaces_that_do_not_meet(tmp_path):
    """A seat without length along the rail, sleepers that are not under it, a region left out."""
    ends = scene(tmp_path).with_(**{"track.seat": "rail_ends"})
    with pytest.raises(SceneError, match=r"track.seat_length = 0.15: seat from x = .*expected"):
        build(ends, MPI.COMM_SELF)
    changes = {"track.seat": "sleeper_top", "track.sleeper_top": "foot_underside"}
    swapped = scene(tmp_path).with_(**changes)
    with pytest.raises(SceneError, match=r"track.sleeper_top = 'foot_underside': point x = .*not"):
        build(swapped, MPI.COMM_SELF)
    tables = Scene.load("flange-transition").tables()
    del tables["bodies"]["sleepers"]
    with pytest.raises(SceneError, match=r"no body has the regions \['sleeper'\] of the mesh"):
        Scene.check(tables)
