# SPDX-License-Identifier: LGPL-3.0-or-later
"""Checkpoints: all that the coming steps depend on, in one file that is replaced at once.

Fields are kept by HexMesh node, so any number of ranks can go on from them. On as many ranks as
before the run goes on bit by bit, which is why work sums are kept per rank. What the forces of the
last step were is not kept where the state tells: each load is asked for it once more.
"""

import hashlib
import json
import time
import zipfile
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

import numpy as np

from meshes.hexmesh import HexMesh
from workflow import durable
from workflow.scene import Scene, SceneError
from workflow.snapshot import Arrays, collect

if TYPE_CHECKING:
    from workflow.clock import Clock
    from workflow.energy import Ledger
    from workflow.model import Model
    from workflow.results import Results

FORMAT = 1
FREE = ("name", "title", "about", "time.end", "output.", "guards.")  # do not alter what was


def file_of(folder: Path) -> Path:
    """Return the checkpoint of a result folder."""
    return folder / "checkpoint" / "state.npz"


class Checkpoint:
    """A checkpoint that was read, the same on all ranks.

    Attributes:
        about: Scene, mesh, step, time and counts, as written by :func:`save`.
        arrays: State by name.
    """

    def __init__(self, about: dict[str, Any], arrays: Arrays) -> None:
        self.about, self.arrays = about, arrays

    def as_built(self, scene: Scene) -> Scene:
        """Return ``scene`` with the end that its mesh was made for.

        Raises:
            SceneError: if a key has changed that alters the past, naming all of them.
        """
        then, now = dict(flat(self.about["scene"])), dict(flat(scene.tables()))
        changed = [
            f"{key}: {then.get(key)!r} in the checkpoint, {now.get(key)!r} in the scene"
            for key in sorted(then.keys() | now.keys())
            if not key.startswith(FREE) and then.get(key) != now.get(key)
        ]
        if changed:
            told = "\n  ".join(changed)
            raise SceneError(
                "resume: expected the scene of the checkpoint, where only time.end, output and "
                f"guards may change, got\n  {told}"
            )
        if scene.time.end < self.about["t"] * (1 - 1e-12):
            raise SceneError(
                f"time.end = {scene.time.end} s: expected later than the checkpoint, which is at "
                f"{self.about['t']} s"
            )
        end = self.about["mesh_end"]
        further = abs(scene.rolling.speed) * (scene.time.end - end) if scene.rolling else 0.0
        margin = getattr(scene.mesh, "margin", np.inf)
        if further > margin:
            raise SceneError(
                f"time.end = {scene.time.end} s: the mesh was made to roll on for {end} s, "
                f"expected at most {margin / abs(scene.rolling.speed):.2e} s more"  # type: ignore[union-attr]
            )
        return scene.with_(**{"time.end": end})

    def fits(self, model: "Model") -> None:
        """Raise ``SceneError`` if mesh, laws of one's own or step are not the checkpoint's."""
        own = {"mesh": mesh_hash(model.domain.source), "laws": model.own_laws, "dt": model.dt}
        for key, mine in own.items():
            then = self.about.get(key, {})
            if then != mine:
                raise SceneError(
                    f"resume: expected the {key} of the checkpoint, {then}, got {mine}; "
                    f"it was written by squealx {self.about['version']}"
                )


def flat(tables: Any, key: str = "") -> Iterator[tuple[str, Any]]:
    """Yield dotted keys and values of nested tables."""
    if not isinstance(tables, dict):
        yield key, tables
        return
    for name, below in tables.items():
        yield from flat(below, f"{key}.{name}" if key else name)


def mesh_hash(mesh: HexMesh) -> str:
    """Return a hash of points, cells and regions."""
    found = hashlib.sha256()
    for array in (mesh.points, mesh.cells, mesh.regions):
        found.update(np.ascontiguousarray(array).tobytes())
    return found.hexdigest()[:16]


def read(folder: Path, comm: MPI.Comm) -> Checkpoint | None:
    """Return the checkpoint of a result folder, None if there is none.

    Raises:
        SceneError: on all ranks, if it cannot be read.
    """
    found, error = None, None
    path = file_of(folder)
    if comm.rank == 0 and path.exists():
        try:
            with np.load(path) as file:
                arrays = dict(file)
            about = json.loads(arrays.pop("about").tobytes())
            if about["format"] != FORMAT:
                error = f"expected format {FORMAT}, got {about['format']}"
            found = Checkpoint(about, arrays)
        except (OSError, ValueError, KeyError, zipfile.BadZipFile) as caught:
            error = str(caught)
    error = comm.bcast(error)
    if error is not None:
        raise SceneError(f"resume: {str(path)!r} is no checkpoint that can be read: {error}")
    return comm.bcast(found)


class Keeper:
    """Writes the checkpoints of a run.

    Attributes:
        mesh_end: The ``time.end`` that the mesh was made for [s].
        before: Wall time of the run up to the last checkpoint it was resumed from [s].
    """

    def __init__(
        self,
        model: "Model",
        ledger: "Ledger",
        results: "Results",
        clock: "Clock",
        point: Checkpoint | None,
        began: float,
    ) -> None:
        self.model, self.ledger, self.results, self.clock = model, ledger, results, clock
        scene = model.scene
        self.mesh_end: float = point.about["mesh_end"] if point else scene.time.end
        self.before: float = point.about["wall"] if point else 0.0
        self.began, self.last = began, time.perf_counter()
        self._mesh = mesh_hash(model.domain.source)
        self._written = -1

    def step(self) -> str | None:
        """Write a checkpoint if one is due; return what could not be done, if anything."""
        output, step = self.model.scene.output, self.model.state.step
        if step == 0:  # forces there belong to the velocity at t, and v is at t - dt/2 already
            return None
        if output.checkpoint_steps is not None:
            return self.write() if step % output.checkpoint_steps == 0 else None
        if not output.checkpoint_minutes or step % self.model.scene.guards.check_interval:
            return None
        late = time.perf_counter() - self.last >= 60 * output.checkpoint_minutes
        return self.write() if self.model.domain.msh.comm.bcast(late) else None

    def end(self) -> str | None:
        """Write the checkpoint at the end of a run, so that it can be prolonged."""
        output, step = self.model.scene.output, self.model.state.step
        wanted = output.checkpoint_minutes > 0 or output.checkpoint_steps is not None
        return self.write() if wanted and step != self._written else None

    def write(self) -> str | None:
        """Replace the checkpoint; return why it could not be, the old one is then kept."""
        with self.clock.phase("output"):
            return self._write()

    def _write(self) -> str | None:
        arrays = collect(self.model, self.ledger, self.results.trackers)
        comm, error = self.model.domain.msh.comm, None
        if comm.rank == 0:
            arrays["about"] = np.frombuffer(json.dumps(self._about()).encode(), dtype=np.uint8)
            try:
                write(self.results.folder, arrays)
            except OSError as caught:
                error = f"checkpoint not written: {caught}"
        self.last, self._written = time.perf_counter(), self.model.state.step
        return comm.bcast(error)

    @property
    def wall(self) -> float:
        """Wall time of the run so far, that before its checkpoint included [s]."""
        return self.before + time.perf_counter() - self.began

    def _about(self) -> dict[str, Any]:
        from importlib.metadata import version

        model = self.model
        return {
            "format": FORMAT,
            "version": version("squealx"),
            "scene": model.scene.tables(),
            "mesh": self._mesh,
            "mesh_end": self.mesh_end,
            "laws": model.own_laws,
            "dt": model.dt,
            "t": model.state.t,
            "step": model.state.step,
            "ranks": model.domain.msh.comm.size,
            "outputs": self.results.outputs,
            "wall": self.wall,
            "seconds": self.clock.seconds,
        }


def write(folder: Path, arrays: Arrays) -> None:
    """Write a checkpoint; the results go first, so that they never lack what it tells of."""
    path = file_of(folder)
    path.parent.mkdir(exist_ok=True)
    durable.finish(folder / "results.h5")
    durable.copy(folder / "results.h5", path.with_name("results.h5"))
    content = BytesIO()
    np.savez(content, **arrays)  # type: ignore[arg-type]
    durable.replace(path, content.getvalue())
