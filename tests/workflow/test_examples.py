# SPDX-License-Identifier: LGPL-3.0-or-later
"""Each example runs as a script and ends on its closed form."""

import ast
import importlib
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.scripts import EXAMPLES, numbers, printed


def test_every_example_is_tested():
    """A new example needs a test: below, or beside the row whose run it is."""
    files = Path(__file__).parents[1].glob("*/test_*.py")
    text = "".join(file.read_text(encoding="utf-8") for file in files)
    assert {p.name for p in EXAMPLES.glob("*.py") if f'"{p.name}"' not in text} == set()


FACES = {"workflow", "contact", "contact.theory", "forms", "meshes", "meshes.profiles"}


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.stem)
def test_examples_use_public_names_only(path):
    """What they import is listed by a package in its ``__all__``, as a reader may rely on."""
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module:
            if node.module.split(".")[0] in {face.split(".")[0] for face in FACES}:
                assert node.module in FACES
                listed = importlib.import_module(node.module).__all__
                assert {name.name for name in node.names} <= set(listed)


@pytest.mark.parametrize("face", sorted(FACES))
def test_every_public_name_is_there(face):
    """Each name that a package lists can be had from it."""
    package = importlib.import_module(face)
    assert all(hasattr(package, name) for name in package.__all__)


def test_an_example_runs_by_itself():
    """As a user would start it: a process of its own."""
    command = [sys.executable, EXAMPLES / "two_bars.py"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    assert "stress" in done.stdout


def test_own_residual_ends_on_the_golden_ratio():
    """A neo-Hookean block pulled by its shear modulus rests at (1 + √5)/2, to 1e-9."""
    found = re.search(r"^stretch ([\d.]+),", printed("own_residual.py"), re.MULTILINE)
    assert found and float(found[1]) == pytest.approx((1 + 5**0.5) / 2, abs=2e-9)


def test_own_item_swings_as_its_roots_say():
    """A bar on an air spring with an orifice: roots of a cubic; ledger and resume to round-off."""
    text = printed("own_item.py")
    assert numbers(text, "displacement")[0] < 2e-5
    assert numbers(text, "ledger")[0] < 1e-13
    assert numbers(text, "resumed")[0] == 0.0


def test_own_material_ends_on_mooneys_stress():
    """A rod of Mooney's rubber pulled to twice its length: 2 (Λ² − 1/Λ) (c₁ + c₂/Λ), to c/κ."""
    found = re.search(r"^stress (\d+) Pa", printed("own_material.py"), re.MULTILINE)
    assert found and float(found[1]) == pytest.approx(2 * 3.5 * 0.45e6, rel=3e-3)


def test_two_bars_ends_on_half_the_impedance():
    """ρ c v/2 = 20.24 MPa to 1 %."""
    stress, *_ = numbers(printed("two_bars.py"), "stress")
    exact = (210e9 * 7800) ** 0.5 / 2
    assert stress == pytest.approx(exact, rel=0.01)


def test_sliding_block_ends_on_the_coefficient_of_friction():
    """Friction from slope and from impulse to 0.5 %, the way to 1 %."""
    text = printed("sliding_block.py")
    far, *_ = numbers(text, "stops")
    assert far == pytest.approx(52.0, rel=0.01)
    for start in ("friction from slope", "friction from impulse"):
        found, given, _ = numbers(text, start)
        assert given == 0.3 and found == pytest.approx(given, rel=0.005)


def test_contact_patch_ends_on_uniform_pressure():
    """Within 3 % rms of it where the contactor has the smaller cells, 0.6 % in two passes."""
    rows = [line.replace("%", "").split() for line in printed("contact_patch.py").splitlines()[1:7]]
    assert [row[2] for row in rows] == list("111222")
    assert float(rows[0][3]) < 3 and float(rows[0][4]) < 12
    assert all(float(row[3]) < 0.6 for row in rows[3:])


def test_hertz_contact_ends_on_hertz():
    """Half axes 5.684 and 4.276 mm to 1 %, p₀ 982 MPa to 2 %."""
    text = printed("hertz_contact.py", 1.0)
    for name, exact, rel in (("a", 5.684, 0.01), ("b", 4.276, 0.01), ("p0", 982.25, 0.02)):
        line = next(line for line in text.splitlines() if line.startswith(f"{name} "))
        assert float(line.split()[1]) == pytest.approx(exact, rel=rel)


@pytest.mark.slow
def test_stick_slip_ends_on_its_period():
    """Both periods 0.5 %; the spring swings about the friction in slip; ledger 1e-6."""
    text = printed("stick_slip.py")
    periods = [line for line in text.splitlines() if line.startswith("period")]
    found = np.array([numbers(line, "period")[:2] for line in periods])
    assert len(found) == 2
    assert found[:, 0] == pytest.approx(found[:, 1], rel=0.005)
    low, high, middle = numbers(text, "pull")
    assert (low + high) / 2 == pytest.approx(middle, rel=0.005)
    assert numbers(text, "energy")[0] < 1e-6


@pytest.mark.slow
def test_slip_weakening_ends_on_its_heat():
    """Row 18. With memory slip and heat to 2 % over dt/8 and h/2, heat as in closed form to 0.5 %.

    Under a shear that friction at rest can bear the bar slides off without memory at the usual
    step alone; with memory it stays.
    """
    text = printed("slip_weakening.py")
    without, memory = numbers(text, "stays without"), numbers(text, "stays with memory")
    assert without[0] > 30 and without[1] < 0.1 and max(memory) < 0.1
    assert max(numbers(text, "spread")) < 2
    heat, exact, _ = numbers(text, "heat")
    assert heat == pytest.approx(exact, rel=0.005)


def test_patch_at_rest_shows_where_hertz_fails(tmp_path):
    """On one arc of the rail half-spaces are Hertz to 2 %; over its end the patch is far longer."""
    text = printed("patch_at_rest.py", "--out", tmp_path / "patches.png")
    words = [line.replace("mm", "").replace("°", "").split() for line in text.splitlines()[1:]]
    rows = [list(map(float, row)) for row in words]
    shift, _, a, b, p0, *half_space = rows[3]
    assert shift == 3 and half_space == pytest.approx([a, b, p0], rel=0.02)
    assert rows[0][6] > 2 * rows[0][3]
    assert (tmp_path / "patches.png").stat().st_size > 10_000


@pytest.mark.slow
def test_error_against_time_falls_with_the_mesh(tmp_path):
    """Hertz at 0.5 mm has half the pressure error of 1 mm; a bar leaves in time; a figure."""
    pytest.importorskip("matplotlib")
    lines = printed("error_against_time.py", tmp_path, "--quick").splitlines()[1:]
    rows = [
        (name, *map(float, rest)) for name, *rest in (x.replace("%", "").split() for x in lines)
    ]
    sphere = [row for row in rows if row[0] == "sphere"]
    assert len(sphere) == 6 and len(rows) == 10
    for coarse, fine in zip(sphere[::2], sphere[1::2], strict=True):
        assert coarse[1:3] == (1.0, fine[2]) and fine[3] <= coarse[3] / 2
    for _, size, safety, error, *_ in (row for row in rows if row[0] == "bar"):
        transit = 100 * size / 200  # of a cell, in percent of 2 L/c, L = 100 mm
        assert error < (transit if safety == 0.5 else 2 * transit)  # row 8; a softer spring
    assert (tmp_path / "error_against_time.png").stat().st_size > 10_000
