# SPDX-License-Identifier: LGPL-3.0-or-later
"""Mesh files against the scene that uses them: what is refused in ``validate``, what is told."""

from dataclasses import replace

import numpy as np
import pytest
import tomli_w

from meshes.formats import read_write
from meshes.hexmesh import HexMesh, join
from meshes.shapes import blocks
from meshes.tags import Tag

STEEL = {"youngs_modulus": 210e9, "poisson_ratio": 0.3, "density": 7800.0}


def two_blocks(gap: float = 0.0) -> HexMesh:
    """A cube of 20 mm on a corner of a plate of 30 mm; nodes at one place if there is no gap."""
    upper = blocks.block(
        (0, 0, gap), (0.02, 0.02, 0.02 + gap), cells=(2, 2, 2), surfaces=blocks.BLOCK_FACES
    )
    lower = blocks.block(
        (0, 0, -0.01),
        (0.03, 0.03, 0),
        cells=(3, 3, 1),
        region=Tag.BASE,
        surfaces=blocks.BASE_FACES,
    )
    return join(upper, lower)


def merged(mesh: HexMesh, at: np.ndarray) -> HexMesh:
    """The same with the nodes of both blocks at the places ``at`` made one."""
    number = np.arange(len(mesh.points))
    for place in at:
        first, *others = np.flatnonzero((np.abs(mesh.points - place) < 1e-9).all(axis=1))
        number[others] = first
    return replace(mesh, cells=number[mesh.cells], facets=number[mesh.facets])


@pytest.fixture
def validate(command, tmp_path):
    """Writes a mesh and the scene of two steel blocks in contact on it, and validates that."""

    def call(mesh: HexMesh, check: bool = True, **changes):
        read_write.write(mesh, tmp_path / "mesh.msh")
        tables = {
            "name": "blocks",
            "title": "blocks",
            "mesh": {"kind": "file", "path": "mesh.msh"},
            "bodies": {n: {"regions": [n], "material": STEEL} for n in ("block", "base")},
            "contacts": {"face": {"contactor": "block_bottom", "target": "base_top"}},
            "time": {"end": 1e-6, "output_interval": 1e-6},
        }
        (tmp_path / "scene.toml").write_text(tomli_w.dumps(tables))
        words = [w for key, value in changes.items() for w in ("--set", f"{key}={value}")]
        done = command("validate", tmp_path / "scene.toml", *words, check=check)
        return done.returncode, " ".join(done.stderr.split())

    return call


@pytest.mark.parametrize("shared", [1, 2])
def test_nodes_that_two_bodies_of_a_pair_share_are_refused(validate, shared):
    """A corner, an edge of the block: the pair, its bodies, the node and its place."""
    mesh = two_blocks()
    at = np.array([[0.02, 0.02, 0.0], [0.02, 0.01, 0.0]])[:shared]
    assert validate(mesh)[0] == 0
    code, said = validate(merged(mesh, at), check=False)
    assert code == 2
    assert f"contacts.face: its bodies 'base' and 'block' share {shared} nodes" in said
    assert "x = 0.02, y = 0.02, z = 0 m" in said or "x = 0.02, y = 0.01, z = 0 m" in said


def test_nodes_shared_away_from_the_contact_are_refused_too(validate):
    """The block hangs on the plate by a node that is in neither surface of the pair."""
    mesh = merged(two_blocks(), np.array([[0.0, 0.0, 0.0]]))
    corner = (np.abs(mesh.points[mesh.facets]) < 1e-9).all(axis=2).any(axis=1)
    mesh = replace(mesh, facets=mesh.facets[~corner], surfaces=mesh.surfaces[~corner])
    code, said = validate(mesh, check=False)
    assert code == 2 and "bodies 'base' and 'block' share 1 nodes, the first is node 1" in said


def test_surfaces_of_one_body_that_share_an_edge_are_refused(validate):
    """Two neighbouring sides of the plate as contactor and target: four nodes in common."""
    changes = {"contacts.face.contactor": "xmax", "contacts.face.target": "base_top"}
    mesh = two_blocks()
    side = mesh.cells[8:].reshape(-1, 8)
    right = side[np.isclose(mesh.points[side][:, :, 0].max(axis=1), 0.03)][:, [1, 2, 6, 5]]
    mesh = replace(
        mesh,
        facets=np.vstack([mesh.facets, right]),
        surfaces=np.append(mesh.surfaces, np.full(len(right), Tag.XMAX)).astype(np.int32),
    )
    code, said = validate(mesh, check=False, **changes)
    assert code == 2 and "its surfaces 'xmax' and 'base_top' share 4 nodes" in said


def test_extent_and_mass_are_told_and_millimetres_suspected(validate):
    """The blocks in millimetres weigh 1.3e8 kg: what mesh.scale makes of them; else no question."""
    mesh = two_blocks()
    mass = 7800 * (0.02**3 + 0.01 * 0.03**2)
    code, said = validate(mesh)
    assert code == 0 and f"mesh file: 0.03 × 0.03 × 0.03 m, {mass:.3g} kg" in said
    assert "millimetre" not in said
    code, said = validate(mesh.moved(mesh.points * 1e3))
    assert code == 0 and f"30 × 30 × 30 m, {mass * 1e9:.3g} kg. Is its unit the millimetre?" in said
    assert f"mesh.scale = 0.001 makes it 0.03 × 0.03 × 0.03 m, {mass:.3g} kg" in said
    code, said = validate(mesh.moved(mesh.points * 1e3), **{"mesh.scale": 0.001})
    assert code == 0 and "millimetre" not in said


def test_bodies_that_come_apart_are_told(validate):
    """A block of two halves that are not merged: nine pairs; nodes of two bodies are no matter."""
    mesh = two_blocks()
    half = blocks.block((0.02, 0, 0), (0.03, 0.02, 0.02), cells=(1, 2, 2))
    _, said = validate(join(mesh, half))
    assert "9 pairs of nodes of one body coincide, the first at x = 0.02" in said
    assert "coincide" not in validate(mesh)[1]


def test_regions_that_no_body_has_point_to_the_groups(validate):
    """A region more than the scene has bodies: the key that chooses groups."""
    mesh = two_blocks()
    regions = mesh.regions.copy()
    regions[0] = Tag.BAR
    code, said = validate(replace(mesh, regions=regions), check=False)
    assert code == 2 and "no body has the regions ['bar']" in said and "mesh.groups" in said
