# SPDX-License-Identifier: LGPL-3.0-or-later
"""Checkpoints: all that the coming steps depend on, in one file that is replaced at once.

Fields are kept by HexMesh node, so any number of ranks can go on from them. On as many ranks as
before the run goes on bit by bit, which is why work sums are kept per rank. What the forces of the
last step were is not kept where the state tells: each load is asked for it once more.
"""

import hashlib
import json
import time
from collections.abc import Iterator, Mapping
from importlib.metadata import version
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from dolfinx import la

from meshes.hexmesh import HexMesh
from workflow.model import Model
from workflow.results import atomic
from workflow.results.folder import Resume
from workflow.results.writer import Results
from workflow.scene import Scene, SceneError
from workflow.scene.keys import flat
from workflow.simulation.energy import Ledger
from workflow.simulation.prescribed import hold_of
from workflow.simulation.progress import Clock

if TYPE_CHECKING:
    from workflow.simulation.following import Following
    from workflow.simulation.sampling import Sampling

Arrays = dict[str, npt.NDArray[Any]]

FORMAT = 4
# do not alter what was
FREE = ("name", "title", "about", "time.end", "output.", "guards.", "passes.")


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
        check_same(self.about["scene"], scene, "checkpoint")
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

    def fits(self, model: Model) -> None:
        """Raise ``SceneError`` if mesh, laws of one's own or step are not the checkpoint's."""
        own = {"mesh": mesh_hash(model.domain.source), "laws": model.own_laws, "dt": model.dt}
        for key, mine in own.items():
            then = self.about.get(key, {})
            if then != mine:
                raise SceneError(
                    f"resume: expected the {key} of the checkpoint, {then}, got {mine}; "
                    f"it was written by squealx {self.about['version']}"
                )

    def resume(self) -> Resume:
        """Return what a result folder keeps of a run that goes on from here."""
        trackers: dict[str, Any] = {}
        for name in {key.split("/")[1] for key in self.arrays if key.startswith("tracker/")}:
            from contact.patches import Tracker  # a scene without contact does not import it

            trackers[name] = Tracker()
            trackers[name].restore(part(self.arrays, f"tracker/{name}/"))
        every = self.arrays.get("samples/every")
        return Resume(
            outputs=self.about["outputs"],
            t=float(self.arrays["time"][0]),
            samples=0 if every is None else int(every[1]),
            trackers=trackers,
        )


def check_same(then: Mapping[str, Any], scene: Scene, where: str) -> None:
    """Raise ``SceneError`` if keys that alter the past are others than they were, naming all.

    Args:
        then: Tables of the scene as it was.
        scene: The scene as it is now.
        where: What has those tables, for the message.
    """
    before, now = dict(flat(then)), dict(flat(scene.tables()))
    changed = [
        f"{key}: {before.get(key)!r} in the {where}, {now.get(key)!r} in the scene"
        for key in sorted(before.keys() | now.keys())
        if not key.startswith(FREE) and before.get(key) != now.get(key)
    ]
    if changed:
        told = "\n  ".join(changed)
        raise SceneError(
            f"resume: expected the scene of the {where}, where only time.end, output and guards "
            f"may change, got\n  {told}"
        )


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
        except Exception as caught:  # a file can be broken in more ways than numpy has errors for
            error = str(caught) or type(caught).__name__
    error = comm.bcast(error)
    if error is not None:
        raise SceneError(f"resume: {str(path)!r} is no checkpoint that can be read: {error}")
    return comm.bcast(found)


class Keeper:
    """Writes the checkpoints of a run.

    Attributes:
        first_step: The step that the run began with [s].
        mesh_end: The ``time.end`` that the mesh was made for [s].
        before: Wall time of the run up to the last checkpoint it was resumed from [s].
    """

    def __init__(
        self,
        model: Model,
        ledger: Ledger,
        results: Results,
        sampling: "Sampling | None",
        following: "Following | None",
        clock: Clock,
        point: Checkpoint | None,
        began: float,
    ) -> None:
        self.model, self.ledger, self.results = model, ledger, results
        self.sampling, self.following, self.clock = sampling, following, clock
        self.first_step, scene = model.dt, model.scene
        self.mesh_end: float = point.about["mesh_end"] if point else scene.time.end
        self.before: float = point.about["wall"] if point else 0.0
        self.began, self.last = began, time.perf_counter()
        self._mesh = mesh_hash(model.domain.source)
        self._written = -1

    def step(self) -> str | None:
        """Write a checkpoint if one is due; return what could not be done, if anything."""
        model = self.model
        output, step = model.scene.output, model.state.step
        if step == 0:  # forces there belong to the velocity at t, and v is at t - dt/2 already
            return None
        if output.checkpoint_steps is not None:
            return self.write() if step % output.checkpoint_steps == 0 else None
        if not output.checkpoint_minutes or step % model.scene.guards.check_interval:
            return None
        late = time.perf_counter() - self.last >= 60 * output.checkpoint_minutes
        return self.write() if model.domain.msh.comm.bcast(late) else None

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
        keepers = {f"tracker/{name}": kept for name, kept in self.results.trackers.items()}
        keepers |= {"samples": self.sampling, "following": self.following}
        arrays = collect(self.model, self.ledger, keepers)
        comm, error = self.model.domain.msh.comm, None
        if comm.rank == 0:
            arrays["about"] = np.frombuffer(json.dumps(self._about()).encode(), dtype=np.uint8)
            try:
                self.results.settle()
                write(self.results.folder, arrays)
            except OSError as caught:
                error = f"checkpoint not written: {atomic.why(caught)}"
        self.last, self._written = time.perf_counter(), self.model.state.step
        return comm.bcast(error)

    @property
    def wall(self) -> float:
        """Wall time of the run so far, that before its checkpoint included [s]."""
        return self.before + time.perf_counter() - self.began

    def _about(self) -> dict[str, Any]:
        model = self.model
        return {
            "format": FORMAT,
            "version": version("squealx"),
            "scene": model.scene.tables(),
            "mesh": self._mesh,
            "mesh_end": self.mesh_end,
            "laws": model.own_laws,
            "dt": self.first_step,
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
    atomic.finish(folder / "results.h5")
    atomic.copy(folder / "results.h5", path.with_name("results.h5"))
    content = BytesIO()
    np.savez(content, **arrays)  # type: ignore[arg-type]
    atomic.replace(path, content.getvalue())


def collect(model: Model, ledger: Ledger, others: Mapping[str, Any]) -> Arrays:
    """Return the memory of a run between two steps, whole on rank 0; collective.

    Args:
        model: The model, its acceleration in place.
        ledger: Its energies so far.
        others: What has a memory besides items, by name: what follows the patches of each pair,
            on rank 0, samples, what the step follows. None where there is none.
    """
    state, domain = model.state, model.domain
    fields = {"u": state.u.x.array, "v": state.v.x.array, "a": state.a.array}
    arrays = {name: domain.gather(local) for name, local in fields.items()}
    arrays["time"] = np.array([state.t, state.step])
    keepers = dict(items_by_name(model))
    keepers |= others
    for name, keeper in keepers.items():
        memory = keeper.memory() if hasattr(keeper, "memory") else {}
        arrays |= {f"{name}/{key}": array for key, array in memory.items()}
    return arrays | {f"ledger/{key}": array for key, array in ledger.memory().items()}


def items_by_name(model: Model) -> Iterator[tuple[str, Any]]:
    """Yield the items of a model, and what holds it, under the names of a checkpoint."""
    for k, item in enumerate(model.items):
        yield f"item/{k}/{type(item).__name__}", item
    yield "hold", model.hold


def restore(
    model: Model,
    ledger: Ledger,
    sampling: "Sampling | None",
    following: "Following | None",
    arrays: Arrays,
) -> None:
    """Go on from what :func:`collect` returned, the same arrays on every rank; collective."""
    state, domain = model.state, model.domain
    state.u.x.array[:] = arrays["u"][domain.nodes].ravel()
    state.v.x.array[:] = arrays["v"][domain.nodes].ravel()
    state.t, state.step = float(arrays["time"][0]), int(arrays["time"][1])
    if following is not None:
        following.restore(part(arrays, "following/"))
    model.hold = hold_of(model)
    recall(model, arrays)
    # Items count work between two calls: each is asked for the force of the present state, which
    # is not counted, and then reminded of what it had counted. Contact has it all in its memory.
    force = la.vector(domain.V.dofmap.index_map, 3)
    for item in model.items:
        if getattr(item, "phase", "update") != "contact":
            item.add(state, force)
    recall(model, arrays)
    state.a.array[:] = 0.0
    state.a.array[: 3 * domain.owned] = arrays["a"][domain.nodes[: domain.owned]].ravel()
    if sampling is not None:
        sampling.restore(part(arrays, "samples/"))
    ledger.restore(part(arrays, "ledger/"))


def recall(model: Model, arrays: Arrays) -> None:
    """Give every item its memory back."""
    for name, item in items_by_name(model):
        if hasattr(item, "restore"):
            item.restore(part(arrays, f"{name}/"))


def part(arrays: Arrays, prefix: str) -> Arrays:
    """Return the arrays whose names begin so, without the beginning."""
    return {k.removeprefix(prefix): a for k, a in arrays.items() if k.startswith(prefix)}
