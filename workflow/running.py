# SPDX-License-Identifier: LGPL-3.0-or-later
"""A run from scene to results: equilibrium, rolling start, steps, outputs, summary."""

import copy
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

import numpy as np

from forms.elements import Law
from workflow import checkpoint, guards
from workflow.audit import audit
from workflow.clock import Clock
from workflow.contact_step import tell_offsets
from workflow.energy import Energy, Ledger
from workflow.geometry import cell_size
from workflow.model import Model, build
from workflow.moving import moves
from workflow.outputs import output, summarise
from workflow.progress import Progress
from workflow.results import Results, check_free
from workflow.scene import Scene, SceneError
from workflow.snapshot import restore
from workflow.stepping import central_difference

if TYPE_CHECKING:
    from contact.friction import Law as FrictionLaw


@dataclass
class Result:
    """A finished (or stopped) run.

    Attributes:
        folder: Where its results are.
        summary: The contents of ``summary.json``.
    """

    folder: Path
    summary: dict[str, Any]

    @property
    def history(self) -> dict[str, Any]:
        """Columns of ``/history`` in ``results.h5``."""
        import h5py

        with h5py.File(self.folder / "results.h5", "r", locking=False) as file:
            return {name: data[:] for name, data in file["history"].items()}


def run(
    scene: Scene,
    out: str | Path,
    comm: MPI.Comm = MPI.COMM_WORLD,
    *,
    watch: Callable[[Model], None] | None = None,
    laws: Mapping[str, Law] | None = None,
    friction: "Mapping[str, FrictionLaw] | None" = None,
    quiet: bool = False,
    resume: bool = False,
) -> Result:
    """Run a scene and leave its results in a new folder.

    Args:
        scene: What to run.
        out: Result folder; made if missing, must not hold a run unless ``resume``.
        comm: Ranks that share the run.
        watch: Called with the model at every step, for experiments.
        laws: Material laws of your own by body name, in place of the scene's.
        friction: Friction laws of your own by contact name, in place of the scene's.
        quiet: No progress on the terminal; ``run.log`` is always written.
        resume: Go on from the last checkpoint in ``out``; from the start if there is none.

    Raises:
        SceneError: bad input, before anything is written.
        GuardError: the run was stopped; everything up to there is kept.
    """
    began = time.perf_counter()
    folder = checked(out, comm, resume)
    point = checkpoint.read(folder, comm) if resume else None
    clock, progress = Clock(), Progress(comm.rank == 0, quiet)
    built = point.as_built(scene) if point else scene
    model = build(built, comm, progress.log, clock, laws, friction)
    model.scene = scene  # its mesh may be that of an earlier end
    if scene.output.sample_interval is not None:
        from workflow.sampling import Sampling

        model.sampling = Sampling(model)
    if point is not None:
        point.fits(model)
    else:
        check_apart(model)
    results, ledger = Results(folder, scene, model.domain, point), Ledger(model)
    progress.keep_in(folder / "run.log", go_on=point is not None)
    keeper = checkpoint.Keeper(model, ledger, results, clock, point, began)
    energy, error, status = None, 0.0, "done"
    try:
        if point is None:
            for line in audit(model):
                progress.note(line)
            with clock.phase("equilibrium"):
                start(model, progress.log)
        else:
            take_up(point, model, ledger, results, clock, progress)
            energy, error = copy.copy(ledger).measure()  # the ledger itself has done so then
        for energy, error in steps(model, results, ledger, keeper, clock, progress, watch, point):
            pass
    except guards.GuardError as stop:
        status = f"stopped: {stop}"
        raise
    except RuntimeError as stop:  # no room for results; a node went through, or is nowhere
        status = f"stopped: {stop}"
        raise guards.GuardError(f"{stop} (step {model.state.step})") from stop
    except BaseException as failure:
        status = f"failed: {type(failure).__name__}: {failure}"
        raise
    finally:
        summary = summarise(model, energy, error, status, clock, keeper.wall)
        conclude(results, summary, progress, model)
    return Result(folder, summary)


def conclude(
    results: Results, summary: Mapping[str, Any], progress: Progress, model: Model
) -> None:
    """Write the last samples and the summary; if it is a full disk that ended the run, say so."""
    try:
        results.append_samples(model.sampling)
        results.summarise(summary)
    except RuntimeError as error:
        if summary["status"] == "done":
            raise guards.GuardError(str(error)) from error
        progress.log(f"summary.json not written: {error}")
    finally:
        progress.close()


def checked(out: str | Path, comm: MPI.Comm, resume: bool = False) -> Path:
    """Return the result folder if rank 0 finds it free; raise alike on all ranks if not."""
    error = None
    if comm.rank == 0:
        try:
            check_free(out, resume)
        except SceneError as caught:
            error = caught
    error = comm.bcast(error)
    if error is not None:
        raise error
    return Path(out)


def take_up(
    point: checkpoint.Checkpoint,
    model: Model,
    ledger: Ledger,
    results: Results,
    clock: Clock,
    progress: Progress,
) -> None:
    """Bring a model to the state of a checkpoint."""
    restore(model, ledger, point.arrays)
    for phase, seconds in point.about["seconds"].items():
        clock.seconds[phase] += seconds
    ranks, state = point.about["ranks"], model.state
    progress.log(f"resumed at step {state.step}, t = {state.t:.6e} s, written on {ranks} ranks")
    for line in results.lost:
        progress.log(line)


def check_apart(model: Model) -> None:
    """Refuse bodies that overlap by more than a hundredth of a cell before the run."""
    size = cell_size(model.scene, model.domain.source)
    limit, look = 0.01 * size, 50 * size
    for name, pair in model.pairs.items():
        depth, node, place = pair.penetration(model.state, look)
        if depth > limit:
            x, y, z = place
            raise SceneError(
                f"contacts.{name}: bodies overlap at the start by {depth:.3e} m at node {node} "
                f"(x = {x:.5f}, y = {y:.5f}, z = {z:.5f} m); expected at most {limit:.1e} m"
            )


def start(model: Model, log: Callable[[str], Any]) -> None:
    """Bring the model to rest and set its initial velocities, as the scene asks."""
    scene = model.scene
    if scene.equilibrium is not None:
        extra = np.zeros(0)
        if scene.rolling is not None:
            from workflow import rolling

            extra = rolling.centrifugal(model)
        if scene.equilibrium.method == "relaxation":
            from workflow.relaxation import relaxation

            relaxation(model, scene.equilibrium, extra, log)
        else:
            from workflow.equilibrium import equilibrium

            equilibrium(model, scene.equilibrium, extra, log)
    v = model.state.v.x.array.reshape(-1, 3)
    for name, body in scene.bodies.items():
        if body.velocity is not None:
            v[model.body_dofs(name)] = body.velocity
    model.supports(model.state.v.x)
    if scene.rolling is not None:
        from workflow import rolling

        rolling.start(model)
    if scene.driven or moves(scene):
        from workflow import driven

        driven.start(model)
    model.state.v.x.scatter_forward()


def steps(
    model: Model,
    results: Results,
    ledger: Ledger,
    keeper: checkpoint.Keeper,
    clock: Clock,
    progress: Progress,
    watch: Callable[[Model], None] | None,
    point: checkpoint.Checkpoint | None = None,
) -> Iterator[tuple[Energy, float]]:
    """Step to the end; yield energies and balance error at every output."""
    scene, state = model.scene, model.state
    per_output = round(scene.time.output_interval / model.dt)
    last = round(scene.time.end / model.dt)
    loads = [clock.timed(model.phase_of(add), add) for add in model.loads]
    constraints = [clock.timed(model.phase_of(add), add) for add in model.last]
    for line in model.sampling.lines() if model.sampling is not None else ():
        progress.note(line)
    progress.start(model, last)
    loop = central_difference(
        state,
        model.mass.petsc_vec,
        loads,
        model.drives or model.supports,
        model.dt,
        last * model.dt,
        model.connections.masses if model.connections is not None else None,
        model.dead.nodal,
        resumed=point is not None,
        last=constraints,
    )
    began = time.perf_counter()
    busy = sum(clock.seconds.values())
    watched = guards.Watch(model)
    for _ in loop:
        guards.check_finite(model)
        if state.step == 0:
            tell_offsets(model, progress.log)
        if model.sampling is not None:
            model.sampling.step()
        if watch is not None:
            watch(model)
        if state.step % per_output == 0:
            with clock.phase("output"):
                energy, error = ledger.measure()
                history = output(model, results, energy, error)
            progress.output(model, history)
            watched.check(error)
            yield energy, error
        elif state.step % scene.guards.check_interval == 0:
            watched.check(ledger.measure()[1])
        if told := keeper.step():
            progress.log(told)
        progress.step(state.step)
    others = sum(clock.seconds.values()) - busy
    clock.seconds["update"] += time.perf_counter() - began - others
    if told := keeper.end():
        progress.log(told)
