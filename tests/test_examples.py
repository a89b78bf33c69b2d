# SPDX-License-Identifier: LGPL-3.0-or-later
"""Each example runs as a script and ends on its closed form."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parent.parent / "examples"


def printed(name: str, *words: object) -> str:
    """What an example prints, run as a user would."""
    command = [sys.executable, EXAMPLES / name, *map(str, words)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_every_example_is_tested():
    """A new example needs a test below."""
    tested = {"own_residual.py", "own_material.py", "error_against_time.py"}
    assert {p.name for p in EXAMPLES.glob("*.py")} == tested


def test_own_residual_ends_on_the_golden_ratio():
    """A neo-Hookean block pulled by its shear modulus rests at (1 + √5)/2, to 1e-9."""
    found = re.search(r"^stretch ([\d.]+),", printed("own_residual.py"), re.MULTILINE)
    assert found and float(found[1]) == pytest.approx((1 + 5**0.5) / 2, abs=2e-9)


def test_own_material_ends_on_mooneys_stress():
    """A rod of Mooney's rubber pulled to twice its length: 2 (Λ² − 1/Λ) (c₁ + c₂/Λ), to c/κ."""
    found = re.search(r"^stress (\d+) Pa", printed("own_material.py"), re.MULTILINE)
    assert found and float(found[1]) == pytest.approx(2 * 3.5 * 0.45e6, rel=3e-3)


@pytest.mark.slow
def test_error_against_time_falls_with_the_mesh(tmp_path):
    """Hertz at 0.5 mm has half the pressure error of 1 mm or less, at every spring; a figure."""
    pytest.importorskip("matplotlib")
    lines = printed("error_against_time.py", tmp_path, "--quick").splitlines()[1:]
    rows = [
        (name, *map(float, rest)) for name, *rest in (x.replace("%", "").split() for x in lines)
    ]
    sphere = [row for row in rows if row[0] == "sphere"]
    assert len(sphere) == 6 and len(rows) == 10
    for coarse, fine in zip(sphere[::2], sphere[1::2], strict=True):
        assert coarse[1:3] == (1.0, fine[2]) and fine[3] <= coarse[3] / 2
    assert all(row[3] < 0.5 for row in rows if row[0] == "bar")
    assert (tmp_path / "error_against_time.png").stat().st_size > 10_000
