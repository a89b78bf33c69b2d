# SPDX-License-Identifier: LGPL-3.0-or-later
"""Meshes from and to files: nothing is lost, what cannot be used is refused and told, same runs."""

import json
import sys
import tomllib
from dataclasses import replace
from pathlib import Path

import h5py
import meshio
import numpy as np
import pytest
import tomli_w

from meshes.formats import conform, contents, read_write
from meshes.hexmesh import HexMesh, join
from meshes.quality import quality
from meshes.shapes import blocks
from meshes.tags import Tag
from workflow import Scene
from workflow.cli import main
from workflow.model.geometry import mesh_of
from workflow.scene.scene import SceneError

ARRAYS = ("points", "cells", "regions", "facets", "surfaces")

# Two cubes side by side as gmsh 4.1 writes them, in mm; the name "skin" is a volume and a surface,
# volume 2 is in two groups and node 13 belongs to nothing.
GMSH_41 = """$MeshFormat
4.1 0 8
$EndMeshFormat
$PhysicalNames
4
2 1 "skin"
2 2 "Far End"
3 7 "skin"
3 8 "Other Cube"
$EndPhysicalNames
$Entities
0 0 2 2
1 0 0 0 0 1 1 1 1 0
2 2 0 0 2 1 1 1 2 0
1 0 0 0 1 1 1 1 7 0
2 1 0 0 2 1 1 1 8 0
$EndEntities
$Nodes
1 13 1 13
3 1 0 13
1
2
3
4
5
6
7
8
9
10
11
12
13
0 0 0
1 0 0
1 1 0
0 1 0
0 0 1
1 0 1
1 1 1
0 1 1
2 0 0
2 1 0
2 0 1
2 1 1
9 9 9
$EndNodes
$Elements
4 4 1 4
2 1 3 1
1 1 4 8 5
2 2 3 1
2 9 11 12 10
3 1 5 1
3 1 2 3 4 5 6 7 8
3 2 5 1
4 6 11 12 7 2 9 10 3
$EndElements
"""


def two_blocks() -> HexMesh:
    """A block on a base of another mesh, nodes moved so that no coordinate is a short number."""
    upper = blocks.block((0, 0, 0), (1, 1, 1), cells=(3, 2, 2), surfaces=blocks.BLOCK_FACES)
    lower = blocks.block(
        (-1, -1, -1), (2, 2, 0), cells=(2, 3, 2), region=Tag.BASE, surfaces=blocks.BASE_FACES
    )
    mesh = join(upper, lower)
    rng = np.random.default_rng(1)
    moved = mesh.moved(mesh.points + rng.uniform(-0.05, 0.05, mesh.points.shape))
    order = rng.permutation(len(mesh.cells))  # regions mixed
    return replace(moved, cells=moved.cells[order], regions=moved.regions[order])


def assert_same(a: HexMesh, b: HexMesh) -> None:
    for name in ARRAYS:
        x, y = getattr(a, name), getattr(b, name)
        assert x.dtype == y.dtype and np.array_equal(x, y), name


def written(path: Path, mesh: HexMesh, **changes) -> Path:
    """Write a mesh through meshio with blocks or groups changed, as a .msh of version 2.2."""
    cells = changes.get("cells", [("hexahedron", mesh.cells), ("quad", mesh.facets)])
    tags = changes.get("tags", [mesh.regions, mesh.surfaces])
    names = changes.get("names", {"block": [21, 3], "base": [22, 3], "top": [119, 2]})
    data = {
        k: [np.asarray(t, np.int32) for t in tags] for k in ("gmsh:physical", "gmsh:geometrical")
    }
    out = meshio.Mesh(changes.get("points", mesh.points), cells, cell_data=data)
    out.field_data = {n: np.array(t) for n, t in names.items()}
    meshio.write(path, out, file_format="gmsh22")
    return path


def told(path: Path, **options) -> str:
    """The message with which a file is refused."""
    with pytest.raises(ValueError) as caught:
        read_write.read(path, **options)
    return str(caught.value)


@pytest.mark.parametrize("ending", read_write.FORMATS)
def test_written_and_read_again_nothing_changes(tmp_path, ending):
    """Every bit of the points, cells, regions, facets and surfaces, in order; own tags."""
    mesh, path = two_blocks(), tmp_path / f"mesh{ending}"
    read_write.write(mesh, path)
    log = []
    again = read_write.read(path, log=log.append)
    assert_same(mesh, again)
    assert not log
    assert again.names == {
        mesh.name(t): t for t in {*mesh.regions.tolist(), *mesh.surfaces.tolist()}
    }


@pytest.mark.parametrize("ending", read_write.FORMATS)
def test_foreign_names_and_no_facets(tmp_path, ending):
    """Names of one's own come back as regions and surfaces; a mesh without facets is one too."""
    mesh, path = two_blocks(), tmp_path / f"mesh{ending}"
    names = {"my wheel": Tag.BLOCK, "plate_2": Tag.BASE, "running band": Tag.BLOCK_TOP}
    if ending == ".vtk":
        with pytest.raises(ValueError, match="'my wheel', 'running band'"):
            read_write.write(mesh, path, names)
        names = {name.replace(" ", "_"): tag for name, tag in names.items()}
    read_write.write(mesh, path, names)
    assert set(read_write.groups(path).regions) == {n for n in names if "band" not in n}
    again = read_write.read(path)
    for name, tag in names.items():
        assert np.array_equal(again.regions == again.tag(name), mesh.regions == tag)
        assert np.array_equal(again.surface(again.tag(name)), mesh.surface(tag))
    assert min(again.tag(n) for n in names) >= 1000
    bare = replace(mesh, facets=mesh.facets[:0], surfaces=mesh.surfaces[:0])
    read_write.write(bare, path)
    assert_same(bare, read_write.read(path))


def test_gmsh_41_in_millimetres(tmp_path):
    """A hand-written 4.1 file: groups, scale, a stray node dropped, a quad turned outwards."""
    path = tmp_path / "two.msh"
    path.write_text(GMSH_41)
    assert read_write.groups(path).regions == ("skin", "Other Cube")
    assert read_write.groups(path).chosen(None).surfaces == ("skin", "far end")
    log = []
    mesh = read_write.read(path, scale=1e-3, log=log.append)
    assert len(mesh.points) == 12 and np.ptp(mesh.points[:, 0]) == pytest.approx(2e-3)
    assert quality(mesh).volume == pytest.approx(2e-9, rel=1e-14)
    centres = mesh.points[mesh.cells].mean(axis=1)[:, 0]
    assert centres[mesh.regions == mesh.tag("skin")] == pytest.approx([0.5e-3])
    assert centres[mesh.regions == mesh.tag("OTHER CUBE")] == pytest.approx([1.5e-3])
    for name, normal in (("skin", -1e-6), ("far end", 1e-6)):
        a, b, c, d = mesh.points[mesh.surface(mesh.tag(name))[0]]
        assert np.cross(c - a, d - b)[0] / 2 == pytest.approx(normal)
    assert any("1 nodes" in line for line in log) and any("1 of 2 hex" in line for line in log)


@pytest.mark.parametrize("version", [2.2, 4.1])
@pytest.mark.parametrize("binary", [0, 1])
def test_mesh_made_by_gmsh(tmp_path, version, binary):
    """A box meshed by gmsh itself: volume, surface areas, groups, in both versions."""
    gmsh = pytest.importorskip("gmsh", exc_type=ImportError)
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        part = (0, gmsh.model.geo.addPoint(0, 0, 0))
        for axis, cells in (((2, 0, 0), 4), ((0, 3, 0), 3), ((0, 0, 1), 2)):
            part = gmsh.model.geo.extrude([part], *axis, [cells], [], True)[1]
        gmsh.model.geo.synchronize()
        volume = gmsh.model.getEntities(3)
        sides = gmsh.model.getEntities(2)
        left = [t for d, t in sides if gmsh.model.getBoundingBox(d, t)[3] < 1e-3]
        gmsh.model.addPhysicalGroup(3, [t for _, t in volume], name="box")
        gmsh.model.addPhysicalGroup(2, left, name="left")
        gmsh.model.mesh.generate(3)
        gmsh.option.setNumber("Mesh.MshFileVersion", version)
        gmsh.option.setNumber("Mesh.Binary", binary)
        gmsh.write(str(tmp_path / "box.msh"))
    finally:
        gmsh.finalize()
    mesh = read_write.read(tmp_path / "box.msh")
    q = quality(mesh)
    assert len(mesh.cells) == 24 and q.volume == pytest.approx(6) == q.enclosed
    quads = mesh.points[mesh.surface(mesh.tag("left"))]
    area = np.cross(quads[:, 2] - quads[:, 0], quads[:, 3] - quads[:, 1]).sum(axis=0) / 2
    assert area == pytest.approx([-3, 0, 0])


def test_cells_and_facets_the_wrong_way_round(tmp_path):
    """Half the hexahedra and quads turned: the same solid comes back, and the log says so."""
    mesh = two_blocks()
    cells, facets = mesh.cells.copy(), mesh.facets.copy()
    cells[::2] = cells[::2][:, [3, 2, 1, 0, 7, 6, 5, 4]]
    facets[1::2] = facets[1::2, ::-1]
    path, log = tmp_path / "turned.msh", []
    read_write.write(replace(mesh, cells=cells, facets=facets), path)
    again = read_write.read(path, log=log.append)
    assert quality(again).enclosed == pytest.approx(quality(mesh).enclosed, rel=1e-13)
    same = [set(a) == set(b) for a, b in zip(again.facets, mesh.facets, strict=True)]
    assert all(same)
    x, y = (m.points[m.facets] for m in (again, mesh))
    areas = [np.cross(p[:, 2] - p[:, 0], p[:, 3] - p[:, 1]) for p in (x, y)]
    assert np.allclose(*areas, rtol=0, atol=1e-15)
    assert f"{(len(cells) + 1) // 2} of {len(cells)} hexahedra" in log[0]
    assert f"{len(facets) // 2} of {len(facets)} facets" in log[1]


def test_what_cannot_be_used_is_refused_with_what_was_found(tmp_path):
    """Other cells, second order, no groups, overlaps, tangles, stray quads, no mesh at all."""
    mesh, path = two_blocks(), tmp_path / "bad.msh"
    tetra = [("hexahedron", mesh.cells), ("tetra", mesh.cells[:3, [0, 1, 2, 4]])]
    message = told(written(path, mesh, cells=tetra, tags=[mesh.regions, [21, 21, 21]]))
    assert (
        "3 tetra" in message and f"{len(mesh.cells)} hexahedron" in message and "'base'" in message
    )
    twenty = [("hexahedron20", np.arange(20)[None])]
    points = np.random.default_rng(0).random((20, 3))
    message = told(written(path, mesh, points=points, cells=twenty, tags=[[21]]))
    assert "1 hexahedron20" in message and "ElementOrder = 1" in message
    message = told(written(path, mesh, tags=[0 * mesh.regions, mesh.surfaces]))
    assert "named groups" in message and "surfaces ['top']" in message
    some = np.where(np.arange(len(mesh.cells)) < 4, 0, mesh.regions)
    assert "4 hexahedra are in none" in told(written(path, mesh, tags=[some, mesh.surfaces]))
    mixed = mesh.cells.copy()
    mixed[5] = mixed[5][[0, 1, 3, 2, 4, 5, 7, 6]]  # the order of DOLFINx
    message = told(written(path, mesh, cells=[("hexahedron", mixed), ("quad", mesh.facets)]))
    assert "1 hexahedra are tangled" in message and "cell 5" in message
    mixed[5] = mixed[5][[0, 1, 1, 2, 4, 5, 5, 6]]
    message = told(written(path, mesh, cells=[("hexahedron", mixed), ("quad", mesh.facets)]))
    assert "collapsed" in message and "cell 5" in message
    across = mesh.facets.copy()
    top = np.flatnonzero(mesh.surfaces == Tag.BLOCK_TOP)[:2]
    across[top] = mesh.cells[:2][:, [0, 2, 6, 4]]
    message = told(written(path, mesh, cells=[("hexahedron", mesh.cells), ("quad", across)]))
    assert "2 quads" in message and "['top']" in message and "not facets" in message
    path.write_text("no mesh at all")
    assert "cannot read" in told(path)
    with pytest.raises(FileNotFoundError):
        read_write.read(tmp_path / "none.msh")
    with pytest.raises(ValueError, match=r"\.msh, \.vtu"):
        read_write.write(mesh, tmp_path / "mesh.stl")


def test_groups_that_overlap_are_chosen_by_name(tmp_path):
    """Abaqus: overlapping ELSETs are refused until named; NSET as surface."""
    mesh, path = two_blocks(), tmp_path / "mesh.inp"
    every = np.arange(len(mesh.cells))
    upper, lower = (np.flatnonzero(mesh.regions == t) for t in (Tag.BLOCK, Tag.BASE))
    top = np.unique(mesh.surface(Tag.BLOCK_TOP))
    sets = {"EALL": [every], "UPPER": [upper], "LOWER": [lower]}
    cells = [("hexahedron", mesh.cells)]
    meshio.Mesh(mesh.points, cells, cell_sets=sets, point_sets={"NTOP": top}).write(path)
    message = told(path)
    assert f"{len(upper)} hexahedra" in message and "'eall'" in message and "mesh.groups" in message
    again = read_write.read(path, names={"Upper": "block", "LOWER": "base", "ntop": "block_top"})
    assert np.array_equal(again.regions, mesh.regions)
    quads = {frozenset(q) for q in mesh.surface(Tag.BLOCK_TOP).tolist()}
    assert {frozenset(q) for q in again.surface(again.tag("block_top")).tolist()} == quads
    assert "no groups ['Uper']" in told(path, names={"Uper": "block"})


def test_numbers_instead_of_names(tmp_path):
    """Integer data of a format without groups: a group of each value."""
    mesh, path = two_blocks(), tmp_path / "mesh.vtu"
    data = {"MaterialIDs": [mesh.regions.astype(np.int32)]}
    meshio.Mesh(mesh.points, [("hexahedron", mesh.cells)], cell_data=data).write(path)
    assert read_write.groups(path).regions == ("MaterialIDs 21", "MaterialIDs 22")
    again = read_write.read(path, names={"MaterialIDs 21": "block", "MaterialIDs 22": "base"})
    assert np.array_equal(again.regions, mesh.regions)


def test_coincident_nodes_are_told():
    """A bar cut in two without merging: every pair in the cut, of one region; apart: none."""
    left = blocks.block((0, 0, 0), (1, 1, 1), cells=(2, 3, 3))
    right = blocks.block((1, 0, 0), (2, 1, 1), cells=(2, 3, 3))
    cut = join(left, right)
    assert conform.coincident(cut.points, cut.cells, cut.regions)[:2] == (16, 16)
    other = join(left, replace(right, regions=right.regions + 1))
    assert conform.coincident(other.points, other.cells, other.regions)[:2] == (16, 0)
    apart = join(left, right.moved(right.points + np.array([1e-3, 0, 0])))
    assert conform.coincident(apart.points, apart.cells, apart.regions)[:2] == (0, 0)


def scene_by_file(folder: Path, name: str, ending: str = ".msh", **changes) -> Path:
    """Export the mesh of a scene and write the scene that reads it; return its path."""
    scene = Scene.load(name, **changes)
    read_write.write(mesh_of(scene)[0], folder / f"{name}{ending}")
    tables = scene.tables()
    tables["mesh"] = {"kind": "file", "path": f"{name}{ending}", "size": scene.mesh.size}
    path = folder / f"{name}-by-file.toml"
    path.write_text(tomli_w.dumps(tables))
    return path


def run_of(
    command, scene: str | Path, out: Path, ranks: int = 1, *changes: str
) -> dict[str, np.ndarray]:
    """Run a scene by the command line and return its history."""
    words = [w for change in changes for w in ("--set", change)]
    command("run", scene, "--out", out, "--ranks", ranks, *words)
    with h5py.File(out / "results.h5") as file:
        return {name: data[:] for name, data in file["history"].items()}


@pytest.mark.mpi
@pytest.mark.slow
@pytest.mark.parametrize("name", ["bar-impact", "hertz"])
def test_same_run_from_a_file(command, tmp_path, name):
    """Forces and energies of the built-in scene and of its exported mesh, on 1 and 2 ranks.

    To 1e-11; to 1e-9 from a static solve, which MUMPS on two ranks repeats to 1e-10 only.
    """
    most = 1e-11 if name == "bar-impact" else 1e-9
    changes = () if name == "bar-impact" else ("time.end=1e-6",)
    path = scene_by_file(tmp_path, name)
    here = run_of(command, name, tmp_path / "a", 1, *changes)
    for ranks in (1, 2):
        there = run_of(command, path, tmp_path / f"b{ranks}", ranks, *changes)
        force = next(k for k in here if k.endswith("normal_force"))
        assert np.abs(here[force]).max() > 0
        energies = ("kinetic", "internal", "contact")
        energy = max(np.abs(here[key]).max() for key in energies)
        for key in (force, *energies):
            scale = energy if key in energies else np.abs(here[key]).max()
            error = np.abs(there[key] - here[key]).max() / scale
            print(f"{name}, {ranks} ranks, {key}: {error:.1e}")
            assert error <= most, (key, ranks)


@pytest.mark.slow
def test_result_of_a_mesh_file_runs_again(command, tmp_path, monkeypatch):
    """The path is relative to the scene; the result's scene.toml runs from any other folder."""
    path = scene_by_file(tmp_path, "bar-impact", ".vtu")
    first = run_of(command, path, tmp_path / "a", 1, "time.end=3e-6")
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    again = run_of(command, tmp_path / "a" / "scene.toml", tmp_path / "b")
    assert np.array_equal(first["kinetic"], again["kinetic"])


def test_scene_names_what_the_file_has_not(tmp_path):
    """Region, surface, group, file: the message names the key and lists the names of the file."""
    path = scene_by_file(tmp_path, "sliding-block")
    for key, value, said in (
        ("bodies.block.regions", ["wheel"], "expected one of ['block', 'base']"),
        ("contacts.face.target", "roof", "contacts.face.target = 'roof': expected one of"),
        ("mesh.groups", {"wheel": "block"}, "no groups ['wheel']; the file has regions"),
        ("mesh.path", str(tmp_path / "none.msh"), "mesh.path = "),
        ("mesh.groups", {"block": "block"}, "bodies.base.regions = 'base'"),
    ):
        with pytest.raises(SceneError) as caught:
            Scene.load(path, **{key: value})
        assert said in str(caught.value)


def test_contact_surfaces_lie_outside(tmp_path):
    """Nodes of two bodies merged by the mesher: their interface is refused as contact surface."""
    mesh = blocks.block((0, 0, 0), (2, 1, 1), cells=(4, 2, 2))
    right = mesh.points[mesh.cells].mean(axis=1)[:, 0] > 1
    faces = conform.faces_on(mesh.cells, np.flatnonzero(mesh.points[:, 0] == 1))
    inner = faces[np.unique(np.sort(faces, axis=1), axis=0, return_index=True)[1]]
    assert len(inner) == 4
    merged = replace(
        mesh,
        regions=np.where(right, Tag.BLOCK, Tag.BASE).astype(np.int32),
        facets=np.vstack([mesh.facets, inner]),
        surfaces=np.append(mesh.surfaces, np.full(4, Tag.BLOCK_BOTTOM)).astype(np.int32),
    )
    read_write.write(merged, tmp_path / "merged.msh")
    path = scene_by_file(tmp_path, "sliding-block")
    changed = {"mesh.path": str(tmp_path / "merged.msh"), "contacts.face.target": "xmax"}
    scene = Scene.load(path, **changed, **{"supports": [], "equilibrium": None})
    with pytest.raises(SceneError, match=r"contacts.face.contactor = 'block_bottom': 4 of its 4"):
        mesh_of(scene)


@pytest.mark.slow
def test_rolling_on_a_mesh_file(tmp_path):
    """Without centre and radius refused by name; with them the wheel spins as the placed one."""
    scene = Scene.load("flange-transition", **{"mesh.size": 0.008})
    mesh, placement = mesh_of(scene)
    read_write.write(mesh, tmp_path / "wheel.msh")
    tables = scene.tables() | {"mesh": {"kind": "file", "path": str(tmp_path / "wheel.msh")}}
    with pytest.raises(SceneError, match=r"mesh\.wheel_centre, mesh\.rolling_radius: missing"):
        Scene.check(tables)
    tables["mesh"] |= {
        "wheel_centre": placement.centre.tolist(),
        "rolling_radius": float(placement.rolling_radius),
    }
    again, wheel = mesh_of(Scene.check(tables))
    assert_same(mesh, again)
    assert np.array_equal(wheel.centre, placement.centre)
    assert wheel.rolling_radius == placement.rolling_radius


def test_export_command(tmp_path, monkeypatch, capfd):
    """``squealx export``: a file that reads back the same, a table that a scene takes, refusals."""
    monkeypatch.chdir(tmp_path)

    def call(*words: str) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["squealx", "export", *words])
        try:
            main()
            code = 0
        except SystemExit as stop:
            code = int(stop.code or 0)
        return code, *capfd.readouterr()

    code, out, _ = call("sliding-block", "block.vtu", "--set", "mesh.size=4e-3", "--json")
    found = json.loads(out)
    mesh = mesh_of(Scene.load("sliding-block", **{"mesh.size": 4e-3}))[0]
    assert code == 0 and found["cells"] == len(mesh.cells)
    assert_same(mesh, read_write.read("block.vtu"))
    code, out, _ = call("bar-wave", "bar.msh")
    table = tomllib.loads(out[out.index("[mesh]") :])["mesh"]
    tables = Scene.load("bar-wave").tables() | {"mesh": table}
    assert code == 0 and Scene.check(tables).mesh.regions == ("bar",)
    code, _, err = call("bar-wave", "bar.stl")
    assert code == 2 and "file = 'bar.stl'" in err and ".vtu" in err
    code, _, err = call("bar-wave", "none/bar.msh")
    assert code == 2 and "file = 'none/bar.msh'" in err


@pytest.mark.slow
def test_names_of_the_file_reach_log_and_figures(command, tmp_path):
    """Regions called by no name of squealx: a run, its recorded names, its picture and legend."""
    pytest.importorskip("matplotlib")
    from workflow.figures import style
    from workflow.figures.mesh import model
    from workflow.results.record import Record

    scene = Scene.load("sliding-block", **{"mesh.size": 5e-3, "mesh.base_size": 5e-3})
    mesh = mesh_of(scene)[0]
    names = {mesh.name(t): t for t in np.unique(mesh.surfaces).tolist()}
    names |= {"upper part": Tag.BLOCK, "plate": Tag.BASE}
    read_write.write(mesh, tmp_path / "mesh.msh", names)
    tables = scene.tables() | {"mesh": {"kind": "file", "path": str(tmp_path / "mesh.msh")}}
    tables["bodies"]["block"]["regions"] = ["Upper Part"]
    tables["bodies"]["base"]["regions"] = ["plate"]
    (tmp_path / "scene.toml").write_text(tomli_w.dumps(tables))
    run_of(command, tmp_path / "scene.toml", tmp_path / "out", 1, "time.end=1e-6")
    record = Record(tmp_path / "out")
    assert sorted(record.body.names.values()) == ["plate", "upper part"]
    with style.style():
        fig = model(record)
        assert [t.get_text() for t in fig.legends[0].get_texts()] == ["plate", "upper part"]
        style.save(fig, tmp_path / "model.png")


def bar() -> HexMesh:
    """Sixteen cubes of 10 mm in two layers of two by four, with its top."""
    faces = {Tag.ZMAX: Tag.BLOCK_TOP}
    return blocks.block((0, 0, 0), (0.04, 0.02, 0.02), cells=(4, 2, 2), surfaces=faces)


def area(mesh: HexMesh, name: str) -> float:
    p = mesh.points[mesh.surface(mesh.tag(name))]
    return float(np.linalg.norm(np.cross(p[:, 2] - p[:, 0], p[:, 3] - p[:, 1]), axis=1).sum() / 2)


def test_cells_and_faces_that_are_listed_twice_count_once(tmp_path):
    """Each hexahedron and each quad twice, once turned: 16 cells, 16 cm³, a top of 8 cm²."""
    mesh, path, log = bar(), tmp_path / "twice.msh", []
    top = mesh.surface(Tag.BLOCK_TOP)
    cells = np.vstack([mesh.cells, mesh.cells[::-1][:, [4, 5, 6, 7, 0, 1, 2, 3]]])
    quads = np.vstack([top, top[::-1, ::-1]])
    blocks_ = [("hexahedron", cells), ("quad", quads)]
    tags, names = [[21] * 32, [119] * 16], {"bar": [21, 3], "top": [119, 2]}
    again = read_write.read(
        written(path, mesh, cells=blocks_, tags=tags, names=names), log=log.append
    )
    assert len(again.cells) == 16 and len(again.facets) == 8
    assert quality(again).volume == pytest.approx(16e-6) == quality(again).enclosed
    assert area(again, "top") == pytest.approx(8e-4) and "16 hexahedra" in log[0]


def test_cells_in_two_groups_are_refused_until_one_is_chosen(tmp_path):
    """Overlapping physical groups, which gmsh 2.2 writes as cells twice; a quad may be in two."""
    mesh, path = bar(), tmp_path / "two.msh"
    top = mesh.surface(Tag.BLOCK_TOP)
    cells = [("hexahedron", np.vstack([mesh.cells] * 2)), ("quad", np.vstack([top, top[:3]]))]
    tags = [[1] * 16 + [2] * 16, [3] * 8 + [4] * 3]
    names = {"bar": [1, 3], "solids": [2, 3], "top": [3, 2], "end": [4, 2]}
    written(path, mesh, cells=cells, tags=tags, names=names)
    message = told(path)
    assert "16 hexahedra are in group 'solids' and in ['bar']" in message and "groups" in message
    again = read_write.read(path, names={"bar": "bar", "top": "top", "end": "end"})
    assert len(again.cells) == 16 and again.counts(again.regions) == {"bar": 16}
    assert area(again, "top") == pytest.approx(8e-4) and area(again, "end") == pytest.approx(3e-4)


def test_cells_that_lie_on_others_are_refused(tmp_path):
    """A body that is written twice with nodes of its own; three cells on one face."""
    mesh, path = bar(), tmp_path / "over.msh"
    read_write.write(join(mesh, mesh), path)
    assert "16 hexahedra lie on others" in told(path) and "expected each once" in told(path)
    beyond = np.vstack([mesh.points, mesh.points[mesh.cells[0]] + np.array([0.012, 0.002, 0.001])])
    third = [*mesh.cells[0][[1, 2, 6, 5]], *(len(mesh.points) + np.array([1, 2, 6, 5]))]
    cells = [("hexahedron", np.vstack([mesh.cells, [third]]))]
    names, tags = {"bar": [21, 3]}, [[21] * 17]
    written(path, mesh, points=beyond, cells=cells, tags=tags, names=names)
    assert "1 faces belong to more than two hexahedra" in told(path)


def test_names_that_differ_by_case_are_kept_apart(tmp_path):
    """Two surfaces, "Face" and "face ": as they are; "Face" and "face": renamed, else refused."""
    mesh, path = bar(), tmp_path / "case.msh"
    top, end = mesh.surface(Tag.BLOCK_TOP), mesh.surface(Tag.XMIN)
    cells = [("hexahedron", mesh.cells), ("quad", np.vstack([top, end]))]
    tags = [[1] * 16, [2] * 8 + [3] * 4]
    names = {"bar": [1, 3], "Face": [2, 2], "face ": [3, 2]}
    spaced = read_write.read(written(path, mesh, cells=cells, tags=tags, names=names))
    assert area(spaced, "face") == pytest.approx(8e-4)
    assert area(spaced, "face ") == pytest.approx(4e-4)
    names["face"] = names.pop("face ")
    written(path, mesh, cells=cells, tags=tags, names=names)
    assert "groups ['Face', 'face'] differ by upper and lower case only" in told(path)
    chosen = {"bar": "bar", "Face": "top", "face": "end"}
    again = read_write.read(path, names=chosen)
    assert area(again, "top") == pytest.approx(8e-4) and area(again, "end") == pytest.approx(4e-4)
    assert "expected one of ['Face', 'face']" in told(path, names={"bar": "bar", "FACE": "top"})


def test_triangles_on_hexahedra_are_refused(tmp_path):
    """A surface of 16 triangles: refused where it is used, left out where it is not."""
    mesh, path = bar(), tmp_path / "tri.msh"
    top = mesh.surface(Tag.BLOCK_TOP)
    halves = np.vstack([top[:, [0, 1, 2]], top[:, [0, 2, 3]]])
    cells = [("hexahedron", mesh.cells), ("triangle", halves)]
    names = {"bar": [1, 3], "top": [2, 2]}
    written(path, mesh, cells=cells, tags=[[1] * 16, [2] * 16], names=names)
    assert "surface 'top' has 16 triangle; expected quads" in told(path)
    assert len(read_write.read(path, names={"bar": "bar"}).cells) == 16


def test_region_numbers_as_floats(tmp_path):
    """ParaView's habit: whole numbers are regions, unless there are other groups; 1.5 is none."""
    mesh, path = bar(), tmp_path / "float.vtu"
    cells, ids = [("hexahedron", mesh.cells)], np.repeat([1.0, 2.0], 8)
    meshio.Mesh(mesh.points, cells, cell_data={"Mat": [ids], "p": [ids + 0.5]}).write(path)
    again = read_write.read(path)
    assert again.counts(again.regions) == {"mat 1": 8, "mat 2": 8}
    meshio.Mesh(mesh.points, cells, cell_data={"p": [ids + 0.5]}).write(path)
    assert "data on cells ['p'] is not whole numbers of regions" in told(path)
    both = {"Mat": [ids], "tag": [np.full(16, 3)]}
    meshio.Mesh(mesh.points, cells, cell_data=both).write(path)
    assert read_write.read(path).counts(again.regions * 0 + 1000) == {"tag 3": 16}


def test_names_of_salome(tmp_path):
    """MED: families by number, groups by name; a family in two groups is in both."""
    mesh, path = bar(), tmp_path / "salome.med"
    top, end = mesh.surface(Tag.BLOCK_TOP), mesh.surface(Tag.XMIN)
    cells = [("hexahedron", mesh.cells), ("quad", np.vstack([top, end]))]
    tags = [np.full(16, -6), np.repeat([-7, -8], [8, 4])]
    out = meshio.Mesh(mesh.points, cells, cell_data={"cell_tags": tags})
    out.cell_tags = {-6: ["Rail"], -7: ["Top", "Skin"], -8: ["Skin"]}
    meshio.write(path, out)
    again = read_write.read(path)
    assert again.counts(again.regions) == {"rail": 16}
    assert area(again, "top") == pytest.approx(8e-4)
    assert area(again, "skin") == pytest.approx(12e-4)


@pytest.mark.parametrize(
    ("name", "program"),
    [("a.k", "LS-DYNA"), ("a.rad", "Radioss"), ("a.unv", "Salome"), ("a.geo", "gmsh"), ("a", "''")],
)
def test_formats_that_are_not_read(tmp_path, name, program):
    """The message names the program and all formats that would do, each of which meshio knows."""
    (tmp_path / name).write_text("*KEYWORD")
    message = told(tmp_path / name)
    assert program in message and all(end in message for end in (".msh", ".inp", ".med", ".vtu"))
    assert set(contents.READ) <= set(meshio.extension_to_filetypes)
