# SPDX-License-Identifier: LGPL-3.0-or-later
"""Disks that fill at any point of a run: what is lost, what is said, and how the run goes on."""

import json
import re
import shutil
import subprocess

import pytest

from tests.folders import assert_same
from workflow import Scene, run
from workflow.results import batch

NAME = "sliding-block"
CHANGES = {
    "mesh.size": 5e-3, "mesh.base_size": 6e-3, "time.end": 2e-4, "time.output_interval": 4e-6,
    "output.checkpoint_steps": 97,
}  # fmt: skip
WORDS = [word for key, value in CHANGES.items() for word in ("--set", f"{key}={value}")]
POINTS = 20
FEW = (2, 11)  # of them
PAGE = 4096
ROOM = 64 * 2**20  # [bytes]


@pytest.fixture(scope="module")
def disk(tmp_path_factory):
    """A disk in memory and what gives it another size; only root may mount one."""
    place = tmp_path_factory.mktemp("disk")

    def mounted(*options):
        mount = ["mount", "-t", "tmpfs", "-o", ",".join(options), "squealx-tests", str(place)]
        subprocess.run(mount, check=True, capture_output=True, text=True)

    try:
        mounted(f"size={ROOM}")
    except (OSError, subprocess.CalledProcessError) as error:
        pytest.skip(f"needs to mount a disk: {getattr(error, 'stderr', '') or error}".strip())
    yield place, lambda size: mounted("remount", f"size={size}")
    subprocess.run(["umount", str(place)], check=True)


@pytest.fixture(scope="module")
def whole(run_scene):
    """The folder of the run that has room, and what its files take [bytes]."""
    folder = run_scene(NAME, **CHANGES)
    sizes = [path.stat().st_size for path in folder.rglob("*") if path.is_file()]
    return folder, sum(-(-size // PAGE) * PAGE for size in sizes)


def times(folder):
    """Times of the outputs that a reader finds in a folder [s]."""
    if not (folder / "results.h5").exists():
        return []
    with batch.opened(folder / "results.h5") as file:
        return list(file["history/t"]) if "history/t" in file else []


@pytest.mark.slow
@pytest.mark.parametrize(
    "point",
    [pytest.param(k, marks=[] if k in FEW else pytest.mark.long) for k in range(POINTS)],
)
def test_a_disk_that_fills(point, disk, whole, squealx):
    """Room for a share of a run, from none to nearly all. It ends with 2 if it cannot begin, or is
    foreseen not to end, and leaves nothing; else with 3 and every output before the one that had no
    room, as it would have been. With room again it goes on, and all is bit by bit as without.
    """
    (place, resize), (complete, size) = disk, whole
    folder = place / str(point)
    resize(max(PAGE, size * point // POINTS // PAGE * PAGE))
    done = squealx("run", NAME, *WORDS, "--out", folder, check=False)
    resize(ROOM)
    assert done.returncode in (2, 3) and "Traceback" not in done.stderr, done.stderr
    last = done.stderr.strip().splitlines()[-1]
    if "time.output_interval" in last:  # less than half of what it takes
        assert done.returncode == 2 and point < POINTS / 2
    else:
        assert f"No space left on device; expected room and permission in '{folder}'" in last
    if done.returncode == 2:
        assert not folder.exists()
    else:
        assert last.endswith(f"go on with: squealx run --resume --out {folder}")
        found, expected = times(folder), list(times(complete))
        assert found == expected[: len(found)] and len(found) >= outputs_before(last, complete)
    run(Scene.load(NAME, **CHANGES), folder, quiet=True, resume=True)
    assert_same(complete, folder)
    shutil.rmtree(folder)


def outputs_before(told, complete):
    """Number of outputs before the one that a message says was not written; all without a step."""
    summary = json.loads((complete / "summary.json").read_text("utf-8"))
    step = re.search(r"step (\d+): ", told)
    per_output = round(CHANGES["time.output_interval"] / summary["dt"])
    return -(-int(step[1]) // per_output) if step else len(times(complete))
