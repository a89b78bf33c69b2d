# SPDX-License-Identifier: LGPL-3.0-or-later
"""Scenes with mesh.kind = "gmsh": scripts and functions beside the scene, kept, on one rank."""

import json
import subprocess
import sys

import numpy as np
import pytest
import tomli_w

from meshes.formats import gmsh_model
from tests.meshes.test_gmsh_model import BOX, box
from workflow import Scene, run
from workflow.model.geometry import mesh_of
from workflow.scene.scene import SceneError, names

pytest.importorskip("gmsh", exc_type=ImportError)

STEEL = {"youngs_modulus": 210e9, "poisson_ratio": 0.3, "density": 7800.0}
FUNCTION = """from lengths import LENGTH
from tests.meshes.test_gmsh_model import box


def make(n):
    box(LENGTH, n)
"""


def tables(**mesh) -> dict:
    """A box of steel that flies, its mesh by gmsh."""
    found = {"kind": "gmsh", "regions": ["Box"], "surfaces": ["low"]} | mesh
    body = {"regions": ["box"], "material": STEEL, "velocity": [1.0, 0.0, 0.0]}
    time = {"end": 2e-5, "output_interval": 1e-5}
    return {"name": "b", "title": "b", "mesh": found, "bodies": {"box": body}, "time": time}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with a script, a function and an empty cache."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    (tmp_path / "box.geo").write_text('Include "more.geo";\n' + BOX)
    (tmp_path / "more.geo").write_text("// nothing\n")
    (tmp_path / "maker.py").write_text(FUNCTION)
    (tmp_path / "lengths.py").write_text("LENGTH = 2.0\n")
    yield tmp_path
    sys.modules.pop("lengths", None)


def scene_in(folder, **mesh) -> Scene:
    (folder / "scene.toml").write_text(tomli_w.dumps(tables(**mesh)))
    return Scene.load(folder / "scene.toml")


def test_script_beside_the_scene_is_meshed_once(folder, monkeypatch):
    """Kept by text, includes, parameters and version of gmsh; taken again with nothing changed."""
    log: list[str] = []

    def made(**mesh) -> bool:
        log.clear()
        found, _ = mesh_of(scene_in(folder, path="box.geo", **mesh), log.append)
        assert found.counts(found.regions) == {"box": len(found.cells)}
        return not any("taken from the cache" in line for line in log)

    assert made() and not made() and not made(parameters={})
    assert made(parameters={"n": 5}) and not made(parameters={"n": 5})
    (folder / "more.geo").write_text("// more\n")
    assert made() and not made()
    (folder / "box.geo").write_text('Include "more.geo";\n' + BOX + "// changed\n")
    assert made() and not made()
    monkeypatch.setattr(gmsh_model, "version", lambda: "5.0")
    assert made() and not made()


def test_function_beside_the_scene(folder):
    """file:name with a neighbour that it imports: made anew when that changes; its keywords."""
    words = {"function": "maker:make", "parameters": {"n": 3}}
    scene, log = scene_in(folder, **words), []
    mesh = mesh_of(scene, log.append)[0]
    assert len(mesh.cells) == 18 and np.ptp(mesh.points[:, 0]) == pytest.approx(2)
    assert scene.mesh.function == f"{folder}/maker:make"
    mesh_of(scene, log.append)
    assert any("taken from the cache" in line for line in log)
    (folder / "lengths.py").write_text("LENGTH = 3.00\n")
    sys.modules.pop("lengths")
    assert np.ptp(mesh_of(scene)[0].points[:, 0]) == pytest.approx(3)


def test_function_from_python(tmp_path):
    """run(scene, out, mesh=function): called with the parameters, kept in no cache; a whole run."""
    scene = Scene.check(tables(parameters={"length": 2.0, "n": 3}))
    result = run(scene, tmp_path / "out", mesh=box, quiet=True)
    assert result.summary["cells"] == 18 and result.summary["status"] == "done"
    with pytest.raises(SceneError, match=r"expected mesh\.path, mesh\.function, or run\(scene"):
        mesh_of(scene)
    with pytest.raises(SceneError, match=r"expected a scene with mesh\.kind"):
        mesh_of(Scene.load("bar-wave"), own=box)


@pytest.mark.parametrize(
    ("mesh", "said"),
    [
        ({"path": "box.geo", "parameters": {"m": 1}}, "mesh.path: mesh.parameters.m: the script"),
        ({"path": "none.geo"}, "none.geo': no such file"),
        ({"path": "box.step"}, "expected a script of gmsh, .geo"),
        ({"path": "box.geo", "function": "maker:make"}, "expected path or function, got both"),
        ({"function": "maker"}, "expected 'file:name'"),
        ({"function": "maker:made"}, "expected a function 'made' in it"),
        ({"function": "maker:make", "parameters": {"m": 1}}, "mesh.function: mesh.parameters"),
        ({"function": "none:make"}, "none.py': no such file"),
        ({"path": "box.geo", "parameters": {"size": 1}}, "expected mesh.size"),
        ({"path": "box.geo", "size": 0.1}, "mesh.parameters.size: the script has no such"),
        ({"path": "box.geo", "surfaces": ["lid"]}, "no groups ['lid']; the file has regions"),
        ({}, "expected mesh.path, mesh.function"),
    ],
)
def test_refusals_name_the_key(folder, command, mesh, said):
    """``squealx validate`` ends with 2 and the reason, which is all that ``run`` would find."""
    (folder / "scene.toml").write_text(tomli_w.dumps(tables(**mesh)))
    done = command("validate", folder / "scene.toml", check=False)
    assert done.returncode == 2 and said in done.stderr.replace("\n", " ")


RANKS = """
import sys
from mpi4py import MPI
from workflow import Scene, SceneError, build
model = build(Scene.load(sys.argv[1]))
cells = model.domain.msh.topology.index_map(3).size_global
try:
    build(Scene.load(sys.argv[1], **{"mesh.parameters": {"m": 1}}))
except SceneError as error:
    said = str(error)
found = MPI.COMM_WORLD.gather((cells, "gmsh" in sys.modules, "no such variable" in said))
if found:
    print(found)
"""


@pytest.mark.mpi
def test_only_one_rank_runs_gmsh(folder, mpirun):
    """Two ranks share 24 cells that the first has made; what it refuses is an error on both."""
    scene_in(folder, path="box.geo")
    done = mpirun(2, "-c", RANKS, folder / "scene.toml")
    assert done.stdout.strip() == "[(24, True, True), (24, False, True)]"


BY_GMSH = ("ball-on-block", "mode-coupling")
OTHERS = """
import sys
from workflow import Scene
from workflow.model.checks import check
from workflow.model.geometry import mesh_of, read_mesh
check(Scene.load("tread-rolling"))
assert read_mesh(Scene.load("tread-rolling"), print) is None
for scene in map(Scene.load, sys.argv[1:]):
    if scene.mesh.kind != "wheel-on-rail":
        mesh_of(scene)
assert not {"gmsh", "meshio"} & set(sys.modules)
assert Scene.load("ball-on-block").mesh.kind == "gmsh" and "gmsh" not in sys.modules
"""


def test_no_other_scene_loads_gmsh():
    """All loaded, those of shapes meshed, a wheel on a rail checked: neither gmsh nor meshio."""
    words = [sys.executable, "-c", OTHERS, *(n for n in names() if n not in BY_GMSH)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_validate_of_the_built_in_scene_leaves_its_mesh_for_the_run(folder, command):
    """Valid, and the mesh is taken from the cache then; its sphere is one to the last bit."""
    words = ("--set", "mesh.size=2e-4", "--set", "mesh.parameters.radius=0.02")
    done = command("validate", "ball-on-block", *words, "--json")
    assert json.loads(done.stdout)["valid"] and not done.stderr
    log: list[str] = []
    changes = {"mesh.size": 2e-4, "mesh.parameters.radius": 0.02}
    mesh, _ = mesh_of(Scene.load("ball-on-block", **changes), log.append)
    assert "taken from the cache" in log[0]
    x = mesh.points[np.unique(mesh.surface(mesh.tag("cap")))] - np.array([0, 0, 0.02])
    assert np.abs(np.linalg.norm(x, axis=1) - 0.02).max() < 1e-15
