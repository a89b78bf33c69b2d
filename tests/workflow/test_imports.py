# SPDX-License-Identifier: LGPL-3.0-or-later
"""A run imports what its scene needs: small scenes last no longer than their imports."""

import subprocess
import sys

import pytest

IDLE = {
    "scipy.optimize",
    "scipy.spatial",
    "scipy.special",
    "scipy.sparse.csgraph",
    "meshes.profiles.placement",
    "rich.console",
    "matplotlib",
    "pyvista",
    "meshio",
    "gmsh",
    "slepc4py",
    "workflow.squeal",
    "contact.sliding",
}
RUN = """
import sys
from workflow import Scene, run
changes = {"mesh.size": 5e-3, "time.end": 5e-5}
result = run(Scene.load(sys.argv[1], **changes), sys.argv[2], quiet=True)
assert result.summary["expected"] or sys.argv[1] != "bar-impact"
print(*sys.modules)
"""


@pytest.mark.parametrize(
    ("scene", "idle"), [("bar-impact", IDLE), ("bar-wave", IDLE | {"contact", "scipy.fft"})]
)
def test_a_bar_imports_little(scene, idle, tmp_path):
    """Nothing of the list, answers of theory included; of contact nothing where there is none."""
    words = [sys.executable, "-c", RUN, scene, str(tmp_path / "run")]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert not idle & set(done.stdout.split())
