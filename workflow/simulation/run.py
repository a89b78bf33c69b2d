# SPDX-License-Identifier: LGPL-3.0-or-later
"""Run of a scene: equilibrium, start of rolling, steps, outputs, summary."""

import copy
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

from forms.elements import Law
from workflow.model import Model, build
from workflow.model.state import Item
from workflow.model.step import step_report
from workflow.results.energy import Energy
from workflow.results.folder import checked
from workflow.results.result import Result
from workflow.results.writer import Results
from workflow.scene import Scene
from workflow.simulation import checkpoint, guards, stepping
from workflow.simulation.energy import Ledger
from workflow.simulation.initial import check_apart, start
from workflow.simulation.progress import Clock, Progress
from workflow.simulation.reactions import Reactions
from workflow.simulation.summary import answers, output, summarise
from workflow.simulation.threads import one_per_rank

if TYPE_CHECKING:
    from contact.friction import Law as FrictionLaw
    from workflow.simulation.sampling import Sampling

Log = Callable[[str], Any]


@dataclass
class Job:
    """A run under way: the model and all that is kept of it."""

    model: Model
    results: Results
    ledger: Ledger
    sampling: "Sampling | None"
    keeper: checkpoint.Keeper
    clock: Clock
    progress: Progress
    energy: Energy | None = None
    error: float = 0.0
    summary: dict[str, Any] = field(default_factory=dict)


def run(
    scene: Scene,
    out: str | Path,
    comm: MPI.Comm = MPI.COMM_WORLD,
    *,
    watch: Callable[[Model], None] | None = None,
    laws: Mapping[str, Law] | None = None,
    friction: "Mapping[str, FrictionLaw] | None" = None,
    items: Iterable[Callable[[Model], Item]] = (),
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
        items: What acts besides, of your own: each is called with the model and returns an item
            (:class:`workflow.model.state.Item`).
        quiet: No progress on the terminal; ``run.log`` is always written.
        resume: Go on from the last checkpoint in ``out``; from the start if there is none.

    Raises:
        SceneError: bad input, before anything is written.
        GuardError: the run was stopped; everything up to there is kept.
    """
    began = time.perf_counter()
    folder = checked(out, comm, resume)
    point = checkpoint.read(folder, comm) if resume else None
    clock = Clock()
    progress = Progress(comm.rank == 0, quiet, clock)
    with one_per_rank() as threads:
        progress.note(threads)
        model = made(scene, comm, progress, point, (laws, friction, items))
        job = prepared(model, clock, progress, folder, point, began)
        with concluded(job):
            if point is None:
                begin(job)
            else:
                take_up(job, point)
            for job.energy, job.error in steps(job, watch, resumed=point is not None):
                pass
            store(job)
    return Result(folder, job.summary)


def made(
    scene: Scene,
    comm: MPI.Comm,
    progress: Progress,
    point: checkpoint.Checkpoint | None,
    own: tuple[Any, Any, Any],
) -> Model:
    """Return the model of a scene, for the checkpoint if there is one."""
    built = point.as_built(scene) if point else scene  # its mesh may be that of an earlier end
    model = build(built, comm, progress.log, progress.clock.phase, *own)
    model.scene = scene
    if point is not None:
        point.fits(model)
    else:
        check_apart(model)
    return model


def prepared(
    model: Model,
    clock: Clock,
    progress: Progress,
    folder: Path,
    point: checkpoint.Checkpoint | None,
    began: float,
) -> Job:
    """Return the run of a model into a folder, which is opened."""
    sampling, ledger = sampler(model), Ledger(model)
    results = Results(folder, model.scene, model.domain, point.resume() if point else None)
    objects = model.scene.output.log == "json"
    progress.keep_in(folder, objects=objects, go_on=point is not None)
    keeper = checkpoint.Keeper(model, ledger, results, sampling, clock, point, began)
    return Job(model, results, ledger, sampling, keeper, clock, progress)


def sampler(model: Model) -> "Sampling | None":
    """Return what samples a model between its outputs, imported only if the scene asks for it."""
    if model.scene.output.sample_interval is None:
        return None
    from workflow.simulation.sampling import Sampling

    return Sampling(model)


@contextmanager
def concluded(job: Job) -> Iterator[None]:
    """Write the summary however the run inside ends; what stopped it becomes a GuardError."""
    status, model = "done", job.model
    try:
        yield
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
        job.summary = summarise(model, job.energy, job.error, status, job.clock, job.keeper.wall)
        conclude(job)


def store(job: Job) -> None:
    """Write the last samples and all that waits to be written."""
    if job.sampling is not None:
        job.sampling.append(job.results)
    job.results.flush()


def conclude(job: Job) -> None:
    """Write what is left and the summary; if it is a full disk that ended the run, say so."""
    model, results, status = job.model, job.results, job.summary["status"]
    try:
        if status != "done":
            store(job)
        job.summary["expected"] = answers(model, results.folder, status, job.progress.log)
        results.summarise(job.summary)
    except RuntimeError as error:
        if status == "done":
            status = f"stopped: {error}"
            raise guards.GuardError(str(error)) from error
        job.progress.log(f"summary.json not written: {error}")
    finally:
        job.progress.ended(status)
        job.progress.close()


def begin(job: Job) -> None:
    """Tell what the run will bear, bring the model to rest and set it in motion."""
    model = job.model
    for line in step_report(model.bodies, model.mass.array, model.dt, model.dt_bound):
        job.progress.note(line)
    with job.clock.phase("equilibrium"):
        start(model, job.progress.log)
    if model.placement is not None:
        from workflow.theory import wheel_on_rail  # half-spaces, for that alone

        wheel_on_rail.tell(model, job.progress.note)


def take_up(job: Job, point: checkpoint.Checkpoint) -> None:
    """Bring the model to the state of a checkpoint."""
    checkpoint.restore(job.model, job.ledger, job.sampling, point.arrays)
    for phase, seconds in point.about["seconds"].items():
        job.clock.seconds[phase] += seconds
    ranks, state = point.about["ranks"], job.model.state
    job.progress.log(f"resumed at step {state.step}, t = {state.t:.6e} s, written on {ranks} ranks")
    for line in job.results.lost:
        job.progress.log(line)
    job.energy, job.error = copy.copy(job.ledger).measure()  # the ledger itself has done so then


def steps(
    job: Job, watch: Callable[[Model], None] | None, *, resumed: bool
) -> Iterator[tuple[Energy, float]]:
    """Step to the end; yield energies and balance error at every output."""
    model, progress, state = job.model, job.progress, job.model.state
    scene = model.scene
    per_output = round(scene.time.output_interval / model.dt)
    for line in job.sampling.lines() if job.sampling is not None else ():
        progress.note(line)
    progress.start(model, round(scene.time.end / model.dt))
    watched = guards.Watch(model)
    end, reactions = round(scene.time.end / model.dt) * model.dt, Reactions(model, per_output)
    hold = reactions if model.supports.dofs else None
    for _ in stepping.steps(model, end, job.clock, hold=hold, resumed=resumed):
        guards.check_finite(model)
        if state.step == 0:
            tell_offsets(model, progress.log)
        if job.sampling is not None:
            job.sampling.step()
        if watch is not None:
            watch(model)
        if state.step % per_output == 0:
            with job.clock.phase("output"):
                energy, error = job.ledger.measure()
                history = output(model, job.results, energy, error, job.ledger, reactions)
                if job.sampling is not None:
                    job.sampling.append(job.results)
            progress.output(model, history)
            watched.check(job.ledger)
            yield energy, error
        elif state.step % scene.guards.check_interval == 0:
            job.ledger.measure()
            watched.check(job.ledger)
        if told := job.keeper.step():
            progress.log(told)
        progress.step(state.step)
    if told := job.keeper.end():
        progress.log(told)


def tell_offsets(model: Model, log: Log) -> None:
    """Log which contacts overlapped at the start, where that does not count."""
    for name, pair in model.pairs.items():
        count, depth = pair.initial_offsets
        if count:
            log(f"contacts.{name}: {count} nodes overlap by up to {depth:.1e} m at first, offset")
