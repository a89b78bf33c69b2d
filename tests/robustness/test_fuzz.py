# SPDX-License-Identifier: LGPL-3.0-or-later
"""The whole command line over generated damage: no traceback, no hang, no other exit code."""

import os
from pathlib import Path

import pytest

SHORT = ("time.end=2e-5", "time.output_interval=2e-6", "output.checkpoint_steps=20")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("count", "seed"), [(300, 1), pytest.param(3000, 2, marks=pytest.mark.long)]
)
def test_damage_ends_in_words(squealx, mpirun, tmp_path, count, seed):
    """Scenes, keys, words, results, profiles and meshes damaged: exit code 0, 2, 3 or 130."""
    finished, root = tmp_path / "finished", Path(__file__).parents[2]
    changes = [word for change in SHORT for word in ("--set", change)]
    squealx("run", "bar-wave", *changes, "--out", finished)
    done = mpirun(
        *(1, Path(__file__).with_name("fuzzed.py"), count, seed, finished),
        env=os.environ | {"PYTHONPATH": str(root)},
        timeout=8.0 * count,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-20_000:] + done.stderr[-2000:]
    assert f"{count} cases" in done.stdout
