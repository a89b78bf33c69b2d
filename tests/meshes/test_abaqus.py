# SPDX-License-Identifier: LGPL-3.0-or-later
"""Input files of Abaqus: instances where the assembly has them, sets, surfaces of faces."""

import numpy as np
import pytest

from meshes.formats import read_write
from meshes.hexmesh import HexMesh
from meshes.quality import quality

# A cube of 1 with its nodes and element numbered from 1, as each part of an assembly is.
CUBE = """*NODE
1, 0, 0, 0
2, 1., 0, 0
3, 1., 1., 0
4, 0, 1., 0
5, 0, 0, 1.
6, 1., 0, 1.
7, 1., 1., 1.
8, 0, 1., 1.
*ELEMENT, TYPE=C3D8R, ELSET=BODY
1, 1, 2, 3, 4,
5, 6, 7, 8
"""
PART = f"*HEADING\n** cubes\n*PART, NAME=Cube\n{CUBE}*NSET, NSET=LOW\n1, 2, 3, 4\n*END PART\n"


def read(tmp_path, text: str, log=lambda line: None, **options) -> HexMesh:
    path = tmp_path / "model.inp"
    path.write_text(text)
    return read_write.read(path, log=log, **options)


def refused(tmp_path, text: str) -> str:
    with pytest.raises(ValueError) as caught:
        read(tmp_path, text)
    return str(caught.value)


def assembly(*instances: str, sets: str = "") -> str:
    return f"{PART}*ASSEMBLY, NAME=A\n{''.join(instances)}{sets}*END ASSEMBLY\n"


def ends(mesh: HexMesh, region: str) -> np.ndarray:
    nodes = np.unique(mesh.cells[mesh.regions == mesh.tag(region)])
    return np.array([mesh.points[nodes].min(axis=0), mesh.points[nodes].max(axis=0)])


def plane(mesh: HexMesh, surface: str) -> np.ndarray:
    """Centre of the facets of a surface, and their area vector together."""
    p = mesh.points[mesh.surface(mesh.tag(surface))]
    normals = np.cross(p[:, 2] - p[:, 0], p[:, 3] - p[:, 1]) / 2
    return np.array([p.mean(axis=(0, 1)), normals.sum(axis=0)])


def test_two_instances_of_a_part_are_two_bodies_at_their_places(tmp_path):
    """One shifted by (2, 3, 4), one turned by 90° round the line x = y = 1 after a shift by 1."""
    one = "*INSTANCE, NAME=I1, PART=cube\n2., 3., 4.\n*END INSTANCE\n"
    two = "*Instance, name=I2, part=Cube\n1., 0., 0.\n1., 1., 0., 1., 1., 5., 90.\n*End Instance\n"
    sets = "*NSET, NSET=FEET, INSTANCE=I2\nLOW\n*NSET, NSET=FEET, INSTANCE=I1\n1, 2, 3, 4\n"
    mesh = read(tmp_path, assembly(one, two, sets=sets))
    assert len(mesh.points) == 16 and quality(mesh).volume == pytest.approx(2)
    assert ends(mesh, "i1.body") == pytest.approx(np.array([[2, 3, 4], [3, 4, 5]]))
    assert ends(mesh, "i2.body") == pytest.approx(np.array([[1, 1, 0], [2, 2, 1]]), abs=1e-14)
    assert plane(mesh, "i1.low") == pytest.approx(np.array([[2.5, 3.5, 4], [0, 0, -1]]))
    assert len(mesh.surface(mesh.tag("feet"))) == 2


def test_sets_of_a_part_that_is_there_once_keep_their_names(tmp_path):
    """Two parts, each numbered from 1: regions by their sets, cells in none by their instance."""
    other = PART.replace("Cube", "Block").replace(", ELSET=BODY", "").replace("LOW", "FOOT")
    placed = "*INSTANCE, NAME=I1, PART=Cube\n*END INSTANCE\n"
    placed += "*INSTANCE, NAME=Slab, PART=Block\n0, 0, -1\n*END INSTANCE\n"
    mesh = read(tmp_path, f"{PART}{other}*ASSEMBLY, NAME=A\n{placed}*END ASSEMBLY\n")
    assert mesh.counts(mesh.regions) == {"body": 1, "slab": 1}
    assert ends(mesh, "slab") == pytest.approx(np.array([[0, 0, -1], [1, 1, 0]]))
    assert plane(mesh, "low")[0, 2] == 0 and plane(mesh, "foot")[0, 2] == -1


@pytest.mark.parametrize(
    ("face", "normal"),
    [
        ("S1", [0, 0, -1]),
        ("S2", [0, 0, 1]),
        ("S3", [0, -1, 0]),
        ("S4", [1, 0, 0]),
        ("S5", [0, 1, 0]),
        ("S6", [-1, 0, 0]),
    ],
)
def test_surfaces_of_element_faces(tmp_path, face, normal):
    """S1 to S6 of the manual, by element, by set, and all free faces where none is named."""
    text = f"{CUBE}*SURFACE, TYPE=ELEMENT, NAME=Skin\nBODY, {face}\n"
    text += f"*SURFACE, NAME=own\n1, {face}\n*SURFACE, NAME=all\nBODY,\n"
    mesh = read(tmp_path, text)
    for name in ("skin", "own"):
        assert plane(mesh, name)[1] == pytest.approx(np.array(normal))
    assert len(mesh.surface(mesh.tag("all"))) == 6


def test_assembly_of_the_preprocessor(tmp_path):
    """Abaqus/CAE: internal sets are no regions; surfaces name them, or a set of an instance."""
    placed = "*Instance, name=Cube-1, part=Cube\n0., 0., 9.\n*End Instance\n"
    sets = (
        "*Elset, elset=_Top_S2, internal, instance=Cube-1, generate\n1, 1, 1\n"
        "*Surface, type=ELEMENT, name=Top\n_Top_S2, S2\n"
        "*Surface, type=ELEMENT, name=Side\nCube-1.BODY, S4\n"
        "*Surface, type=NODE, name=Feet\nCube-1.LOW, 1.\n"
        '*Nset, nset="Some, Nodes", instance=Cube-1\n5, 6, 7, 8\n'
        "*Node\n1, 7., 7., 7.\n*Element, type=MASS, elset=point\n1, 1\n"
    )
    log = []
    text = assembly(placed, sets=sets) + "*MATERIAL, NAME=S\n*ELASTIC\n2e11, 0.3\n"
    text += "*STEP\n*STATIC\n*NGEN\n1, 2\n*END STEP\n"
    mesh = read(tmp_path, text, log.append)
    assert mesh.counts(mesh.regions) == {"body": 1}
    assert plane(mesh, "top") == pytest.approx(np.array([[0.5, 0.5, 10], [0, 0, 1]]))
    assert plane(mesh, "side")[1] == pytest.approx(np.array([1, 0, 0]))
    assert plane(mesh, "feet")[0, 2] == 9 and plane(mesh, "some, nodes")[0, 2] == 10
    assert any("1 lines of MASS" in line for line in log)


def test_included_files(tmp_path):
    """Lines of nodes in another file go where it is named; one that includes itself is refused."""
    at = CUBE.index("1, 0, 0, 0"), CUBE.index("*ELEMENT")
    (tmp_path / "nodes.txt").write_text(CUBE[at[0] : at[1]])
    text = f"*NODE\n*INCLUDE, INPUT=nodes.txt\n{CUBE[at[1] :]}"
    assert quality(read(tmp_path, text)).volume == pytest.approx(1)
    assert "*INCLUDE" in refused(tmp_path, "*INCLUDE, INPUT=model.inp\n")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (CUBE + "*NGEN\n1, 2\n", "*NGEN makes nodes that are not written out"),
        (CUBE + "*SYSTEM\n0, 0, 1, 1, 0, 1\n", "*SYSTEM moves nodes"),
        (CUBE.replace("*NODE", "*NODE, SYSTEM=C"), "expected rectangular coordinates"),
        (CUBE + "*NODE\n1, 5, 5, 5\n", "node 1 is given twice"),
        (CUBE.replace("5, 6, 7, 8\n", "5, 6, 7, 9\n"), "element 1 has node 9, which is not there"),
        (CUBE.replace("5, 6, 7, 8\n", "5, 6, 7\n"), "a number and 8 nodes for each element"),
        (CUBE + "*ELSET, ELSET=B\nNONE\n", "no set 'NONE'"),
        (CUBE.replace("C3D8R", "C3D10"), "*ELEMENT, TYPE=C3D10"),
        (CUBE.replace("ELSET=BODY", ""), "runs on into 1"),
        (PART, "no *INSTANCE"),
        (assembly("*INSTANCE, NAME=I, PART=None\n*END INSTANCE\n"), "no *PART, NAME=none"),
        (assembly("*INSTANCE, NAME=I, PART=Cube\n1, x\n*END INSTANCE\n"), "expected a shift"),
        (assembly("*INSTANCE, NAME=I, LIBRARY=j\n*END INSTANCE\n"), "LIBRARY"),
        (CUBE.replace(", ELSET=BODY", ""), "expected the hexahedra in named groups"),
    ],
)
def test_what_is_not_understood_is_refused(tmp_path, text, said):
    """Keyword and reason: nodes that are made, moved, missing or given twice; parts not placed."""
    assert said in refused(tmp_path, text)
