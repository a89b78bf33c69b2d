# SPDX-License-Identifier: LGPL-3.0-or-later
"""Result folders that are copied while they grow, and compared bit by bit."""

import shutil
from pathlib import Path

import h5py
import numpy as np

from workflow import Scene, run

BAR = {"mesh.size": 5e-3, "time.end": 4e-5, "output.checkpoint_steps": 7}


def arrays(path: Path) -> dict[str, np.ndarray]:
    """All datasets of an HDF5 file by name."""
    found = {}

    def note(name, item):
        if isinstance(item, h5py.Dataset):
            found[name] = item[()]

    with h5py.File(path, "r") as file:
        file.visititems(note)
    return found


def assert_same(one: Path, other: Path, files=("results.h5", "fields.vtkhdf")) -> None:
    """The results of two folders agree bit by bit."""
    for name in files:
        a, b = arrays(one / name), arrays(other / name)
        assert a.keys() == b.keys()
        for key in a:
            np.testing.assert_array_equal(a[key], b[key], err_msg=key, strict=True)


def copied(scene: Scene, folder: Path, at: int, **words) -> Path:
    """Run a scene into ``folder``; return a copy of that folder made at step ``at``."""
    copy = folder.with_name(folder.name + "-killed")

    def watch(model):
        if model.state.step == at:
            shutil.copytree(folder, copy)

    run(scene, folder, quiet=True, watch=watch, **words)
    return copy
