# SPDX-License-Identifier: LGPL-3.0-or-later
"""``squealx bench --quick`` runs through; what it holds is positive, finite and complete.

How fast is not asserted: that is what the command itself prints.
"""

import importlib.util
import json
import subprocess
import sys
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem

from forms.elasticity import full, st_venant_kirchhoff
from workflow.bench import main_scene, memory_cases, peers, roofline, speed, speed_cases
from workflow.bench.speed_cases import FORMS, REFERENCE, STEEL
from workflow.cli import main

ENGINES = {
    "assemble_vector",
    "assemble_vector, tuned",
    "native float64",
    "native float32",
    "AIJ MatMult",
}


@pytest.fixture(scope="module")
def quick(tmp_path_factory) -> tuple[dict, Path]:
    """The JSON of a quick bench and its folder."""
    folder = tmp_path_factory.mktemp("bench")
    command = [sys.executable, "-m", "workflow.cli", "bench", "--quick", "--json"]
    done = subprocess.run(
        [*command, "--out", str(folder)], check=True, capture_output=True, text=True, timeout=480
    )
    return json.loads(done.stdout), folder


def numbers(node) -> list:
    """All numbers below a node."""
    if isinstance(node, dict):
        return [x for value in node.values() for x in numbers(value)]
    if isinstance(node, list):
        return [x for value in node for x in numbers(value)]
    return [node] if isinstance(node, int | float) and not isinstance(node, bool) else []


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.mpi
def test_quick_bench_is_complete(quick):
    """Every part is there with positive, finite numbers; file and stdout hold the same."""
    found, folder = quick
    assert json.loads((folder / "bench.json").read_text()) == found
    parts = {"kernels", "memory", "roofline", "steps", "overhead", "contact", "ranks", "host"}
    assert found["quick"] and parts | {"peers", "main_scene"} == set(found) - {"quick", "rounds"}
    assert len(found["memory"]) == 12
    assert all(row["difference"] < 1e-11 for row in found["memory"])
    for part in parts - {"kernels", "host"}:
        assert found[part] is not None and numbers(found[part])
        assert all(np.isfinite(x) and x > 0 for x in numbers(found[part])), part
    for engines in found["kernels"]["forms"].values():
        assert set(engines) == ENGINES
        assert all(row["rate"] > 0 and np.isfinite(row["rate"]) for row in engines.values())
        assert all(row["ratio"] > 0 and row["ratio_reference"] > 0 for row in engines.values())
    assert set(found["kernels"]["forms"]) == set(FORMS)
    for key in ("vector_bits", "compiler", "cores", "versions"):
        assert found["host"][key]
    assert str(Path.home()) not in json.dumps(found["host"])


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.mpi
def test_engines_agree_with_dolfinx(quick):
    """Native and tuned forces against stock assembly, to the round-off of their type."""
    for engines in quick[0]["kernels"]["forms"].values():
        assert engines["native float64"]["difference"] <= 1e-13
        assert engines["assemble_vector, tuned"]["difference"] <= 1e-13
        assert 1e-13 < engines["native float32"]["difference"] <= 1e-5


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.mpi
def test_phases_of_the_main_scene(quick):
    """Phases of the same window on 1 and 2 ranks make up the step; all it needs is timed."""
    found = quick[0]["main_scene"]
    assert found["scene"] == "flange-transition" and found["cells"] > 10_000
    assert found["seconds"]["mesh"] > 0 and found["seconds"]["compile"] > 0
    for ranks in (found["one"], found["two"]):
        phases = [ranks[p] for p in main_scene.STEPPED]
        assert all(seconds >= 0 for seconds in phases) and ranks["contact"] > 0
        assert sum(phases) == pytest.approx(ranks["step"])
        assert ranks["rate"] == pytest.approx(found["cells"] / ranks["step"])
        assert 0.2 < ranks["share"] < 1


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.mpi
def test_other_codes_do_the_same_job(quick):
    """Codes that are installed agree with stock to round-off; the others say what to install."""
    codes = quick[0]["peers"]["codes"]
    assert {"assemble_vector", "native float64", *peers.MODULES} == set(codes)
    assert codes["assemble_vector"]["ratio"] == 1.0
    for name, code in codes.items():
        if "skipped" in code:
            assert name in peers.MODULES and code == {"skipped": peers.EXTRA}
            assert importlib.util.find_spec(peers.MODULES[name]) is None
        else:
            assert code["rate"] > 0 and code["difference"] < 1e-11


def test_a_code_that_is_not_installed_is_skipped(monkeypatch):
    """Word of what to install in place of numbers, in the printout as well."""
    monkeypatch.setattr(peers, "MODULES", dict.fromkeys(peers.MODULES, "no_such_module"))
    found = peers.measure(2, 1)
    assert found["codes"]["JAX"] == {"skipped": peers.EXTRA}
    assert found["codes"]["native float64"]["difference"] < 1e-13
    lines = [part for part in speed._peers(found) if isinstance(part, str)]
    assert lines == [f"{name}: {peers.EXTRA}" for name in peers.MODULES]


@pytest.mark.parametrize("element", ["one-point", pytest.param("full", marks=pytest.mark.slow)])
def test_law_with_a_memory_as_stock_dolfinx_has_it(element):
    """Two back stresses, every cell flows: force and history of stock, in no more than 1.3 kB."""
    domain = speed_cases.cube((3, 3, 2), MPI.COMM_SELF)
    material = memory_cases.MATERIALS["J2, two back stresses"]
    case = memory_cases.Case(domain, material, element, rotating=False)
    (native, own), (stock, given) = case.native(memory_cases.BEYOND), case.stock()
    for _ in range(3):
        native()
        stock()
    for a, b in zip(own(), given(), strict=True):
        assert np.abs(a - b).max() < 1e-11 * np.abs(b).max() and np.abs(b).max() > 0
    strain = own()[1][:, :, 6]
    assert strain.min() > 5e-5  # all points of all cells flow, at every call
    assert case.bytes == {"one-point": 264, "full": 1280}[element]


def test_cells_below_yield_rest():
    """The other state that is timed: no point of any cell has flowed."""
    domain = speed_cases.cube((2, 2, 2), MPI.COMM_SELF)
    case = memory_cases.Case(domain, memory_cases.MATERIALS["J2, isotropic"], "full", False)
    resting, own = case.native(memory_cases.BELOW)
    resting()
    assert not own()[1].any() and case.bytes <= 1200


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.mpi
def test_figure_is_written(quick):
    """One picture beside the JSON."""
    path = quick[1] / "bench.png"
    assert path.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n" and path.stat().st_size > 10_000


def test_not_under_mpiexec(monkeypatch, capsys):
    """Two ranks would measure each other: exit code 2."""
    monkeypatch.setenv("PMI_RANK", "0")
    monkeypatch.setattr(sys, "argv", ["squealx", "bench", "--quick"])
    with pytest.raises(SystemExit) as stop:
        main()
    assert stop.value.code == 2 and "starts its own ranks" in capsys.readouterr().err


def test_counted_operations():
    """∫ w over one point: FFCx's code multiplies and adds the eight entries once each."""
    domain = speed_cases.cube((2, 2, 2), MPI.COMM_SELF)
    V = fem.functionspace(domain.msh, ("Lagrange", 1))
    f, w = fem.Function(V), ufl.TestFunction(V)

    def operations(degree: int) -> int:
        dx = full(domain.msh)(metadata={"quadrature_degree": degree})
        return roofline.operations(f * w * dx, native=False)

    one, eight = operations(1), operations(2)
    assert operations(3) == eight  # 2×2×2 points too
    loop = (eight - one) / 7
    assert loop >= 2 * 8 + 2 * 8  # value of f, and eight entries of the vector, per point
    assert loop < 200  # with the Jacobian's determinant


def test_forms_are_those_of_the_library():
    """The reference is stock's St. Venant-Kirchhoff; one-point titles say which stiffness."""
    domain = speed_cases.cube((1, 1, 1), MPI.COMM_SELF)
    u, w, dx = fem.Function(domain.V), ufl.TestFunction(domain.V), full(domain.msh)
    expected = st_venant_kirchhoff(u, w, STEEL) * dx
    assert FORMS[REFERENCE](u, w, dx).signature() == expected.signature()
    one_point = [title for title in FORMS if "one point" in title]
    assert len(one_point) == 2 and all("physical hourglass" in title for title in one_point)


def test_unused_values_are_not_counted():
    """a = x y; b = a z is read by nobody: 0; once b is, both products count."""
    x, a, b, out = (roofline.L.Symbol(n, roofline.L.DataType.SCALAR) for n in "xabo")
    chain = [
        roofline.L.VariableDecl(a, x * x),
        roofline.L.VariableDecl(b, a * x),
    ]
    use = roofline.L.AssignAdd(out, b)
    code = roofline.L.StatementList
    assert roofline.live(code(chain)) == 0
    assert roofline.live(code([*chain, use])) == 3


def test_rounds_are_interleaved():
    """Calls take turns; each is timed once per round."""
    seen: list[str] = []
    calls = {name: (lambda name=name: seen.append(name)) for name in "ab"}
    times = speed_cases.rounds(calls, 3, inner=2)
    assert set(times) == {"a", "b"} and all(len(t) == 3 for t in times.values())
    assert "".join(seen[-12:]) == "aabb" * 3


def test_blocks_press_all_nodes_and_apart_none():
    """The contact that is timed: every contactor node slides, or none is in reach."""
    pair, state, away, force = speed_cases.pressed(5)
    for _ in range(20):  # until all slip
        pair.add(state, force)
    assert pair.active == 36 and pair.normal_force > 0
    assert np.isclose(np.linalg.norm(pair.tangential_force), 0.3 * pair.normal_force, rtol=1e-6)
    other = speed_cases.pressed(5)[0]
    other.add(away, force)
    assert other.active == 0


def test_folder_is_tried_before_anything_is_measured(tmp_path, monkeypatch, capsys):
    """A folder below a file cannot be made: exit code 2, and nothing was measured."""
    (tmp_path / "file").touch()
    monkeypatch.setattr("workflow.bench.speed.measure", lambda *_: pytest.fail("measured"))
    monkeypatch.setattr(sys, "argv", ["squealx", "bench", "--out", str(tmp_path / "file/out")])
    with pytest.raises(SystemExit) as stop:
        main()
    assert stop.value.code == 2
    assert "expected a folder that can be written" in capsys.readouterr().err
