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
from workflow.results import atomic
from workflow.scene.scene import Scene, SceneError

if TYPE_CHECKING:
    from workflow.model.model import Model
    from workflow.results.writer import Results
    from workflow.simulation.energy import Ledger
    from workflow.simulation.progress import Clock
from collections.abc import Mapping
from dataclasses import asdict
from typing import TYPE_CHECKING

import numpy.typing as npt
from dolfinx import la

from workflow.simulation.energy import Energy
from workflow.simulation.prescribed import moves

if TYPE_CHECKING:
    from workflow.model.model import Model
    from workflow.simulation.energy import Ledger

Arrays = dict[str, npt.NDArray[Any]]

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
    atomic.finish(folder / "results.h5")
    atomic.copy(folder / "results.h5", path.with_name("results.h5"))
    content = BytesIO()
    np.savez(content, **arrays)  # type: ignore[arg-type]
    atomic.replace(path, content.getvalue())


def collect(model: "Model", ledger: "Ledger", trackers: Mapping[str, Any]) -> Arrays:
    """Return the memory of a run between two steps, whole on rank 0; collective.

    Args:
        model: The model, its acceleration in place.
        ledger: Its energies so far.
        trackers: What follows the patches of each pair, on rank 0.
    """
    state, domain, comm = model.state, model.domain, model.domain.msh.comm
    fields = {"u": state.u.x.array, "v": state.v.x.array, "a": state.a.array}
    arrays = {name: domain.gather(local) for name, local in fields.items()}
    arrays["time"] = np.array([state.t, state.step])
    for name, owner, attribute in sums(model):
        arrays[f"sum/{name}"] = np.array(comm.allgather(getattr(owner, attribute)))
    if model.connections is not None:
        masses = model.connections.masses
        arrays |= {"masses/u": masses.u, "masses/v": masses.v}
        arrays["masses/sums"] = np.array([masses.dissipation, masses.work])  # alike on all ranks
    if model.drive is not None:
        arrays["drive/torque"] = np.array(model.drive.torque)
    if model.drives is not None:
        for i, carried in enumerate(model.drives.carried):
            local = np.zeros(3 * domain.owned)
            local.reshape(-1, 3)[carried.dofs] = carried.reaction
            arrays[f"driven/{i}/reaction"] = domain.gather(local)
            arrays[f"driven/{i}/centre"] = carried.centre
    sampled = {} if model.sampling is None else {"": model.sampling}
    for kind, parts in (("pair", model.pairs), ("tracker", trackers), ("samples", sampled)):
        for name, part in parts.items():
            arrays |= {f"{kind}/{name}/{key}": a for key, a in part.memory().items()}
    return arrays | energies(ledger)


def restore(model: "Model", ledger: "Ledger", arrays: Arrays) -> None:
    """Go on from what :func:`collect` returned, the same arrays on every rank; collective."""
    state, domain = model.state, model.domain
    state.u.x.array[:] = arrays["u"][domain.nodes].ravel()
    state.v.x.array[:] = arrays["v"][domain.nodes].ravel()
    state.t, state.step = float(arrays["time"][0]), int(arrays["time"][1])
    if model.connections is not None:
        masses = model.connections.masses
        masses.u[:], masses.v[:] = arrays["masses/u"], arrays["masses/v"]
        masses.dissipation, masses.work = map(float, arrays["masses/sums"])
    if "drive/torque" in arrays:
        from workflow.model.supports import drive

        model.drive = drive(model, 0.0, 0.0)
        model.drive.torque = float(arrays["drive/torque"])
    if model.scene.driven or moves(model.scene):
        steer(model, arrays)
    remind(model)
    state.a.array[:] = 0.0
    state.a.array[: 3 * domain.owned] = arrays["a"][domain.nodes[: domain.owned]].ravel()
    comm: MPI.Comm = domain.msh.comm
    ranks, rank = comm.size, comm.rank
    for name, owner, attribute in sums(model):
        parts = arrays[f"sum/{name}"]
        together = float(parts.sum()) if rank == 0 else 0.0
        setattr(owner, attribute, float(parts[rank]) if len(parts) == ranks else together)
    for name, pair in model.pairs.items():
        pair.restore(part(arrays, f"pair/{name}/"))
    if model.sampling is not None:
        model.sampling.restore(part(arrays, "samples//"))
    remember(ledger, arrays)


def part(arrays: Arrays, prefix: str) -> Arrays:
    """Return the arrays whose names begin so, without the beginning."""
    return {k.removeprefix(prefix): a for k, a in arrays.items() if k.startswith(prefix)}


def steer(model: "Model", arrays: Arrays) -> None:
    """Hold driven surfaces again where they were."""
    from workflow.simulation.prescribed import Hold

    model.drives = Hold(model)
    for i, carried in enumerate(model.drives.carried):
        carried.centre = arrays[f"driven/{i}/centre"]
        carried.arm = carried.reference[carried.dofs] - carried.centre
        nodes = model.domain.nodes[carried.dofs]
        carried.reaction = arrays[f"driven/{i}/reaction"][nodes]


def remind(model: "Model") -> None:
    """Let every load but contact know its last force, which is that of the present state.

    They count the work between two calls, so the first call of a new one counts nothing.
    """
    force = la.vector(model.domain.V.dofmap.index_map, 3)
    contact = [pair.add for pair in model.pairs.values()]
    for add in model.loads:
        if add not in contact:
            add(model.state, force)


def sums(model: "Model") -> Iterator[tuple[str, Any, str]]:
    """Yield name, owner and attribute of everything that is summed up on each rank by itself."""
    yield "internal", model.internal, "work"
    if model.viscosity is not None:
        yield "viscosity", model.viscosity, "work"
    if model.damping is not None:
        yield "damping", model.damping, "dissipation"
    if model.drive is not None:
        yield "drive", model.drive, "work"
    if model.connections is not None:
        for i, link in enumerate(model.connections.links):
            yield f"link{i}", link, "dissipation"
    if model.drives is not None:
        for i, carried in enumerate(model.drives.carried):
            yield f"driven{i}", carried, "work"
        for i, mover in enumerate(model.drives.moved):
            yield f"moved{i}", mover, "work"
            yield f"moved{i}/reaction", mover, "reaction"


def energies(ledger: "Ledger") -> Arrays:
    """Return the memory of a ledger."""
    scalars = [ledger.ride, ledger.reference, ledger.internal_start]
    arrays = {"ledger/scalars": np.array(scalars)}
    if ledger.start is not None:
        arrays |= {f"ledger/start/{k}": np.array(e) for k, e in asdict(ledger.start).items()}
    return arrays


def remember(ledger: "Ledger", arrays: Arrays) -> None:
    """Give a ledger its memory back."""
    ledger.ride, ledger.reference, ledger.internal_start = map(float, arrays["ledger/scalars"])
    start = part(arrays, "ledger/start/")
    ledger.start = Energy(**{k: float(e) for k, e in start.items()}) if start else None
