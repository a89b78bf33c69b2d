# SPDX-License-Identifier: LGPL-3.0-or-later
"""Run of a scene: equilibrium, start of rolling, steps, outputs, summary."""

import contextlib
import copy
import signal
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

from forms.elements import Law
from workflow.model import Model, build
from workflow.model.model import names_of_own
from workflow.model.state import Item
from workflow.model.step import step_report
from workflow.results.energy import Energy
from workflow.results.folder import command_to_resume, occupied
from workflow.results.result import Result
from workflow.results.writer import Results, write_summary
from workflow.scene import Scene
from workflow.simulation import checkpoint, guards, interrupts, ranks, stepping
from workflow.simulation.energy import Ledger
from workflow.simulation.guards import GuardError
from workflow.simulation.initial import start
from workflow.simulation.progress import Clock, Progress
from workflow.simulation.reactions import Reactions
from workflow.simulation.resuming import finished, how_to_go_on, point_of
from workflow.simulation.summary import answers, output, summarise
from workflow.simulation.threads import one_per_rank

if TYPE_CHECKING:
    from contact.friction import Law as FrictionLaw
    from forms.memory import MemoryLaw
    from workflow.simulation.following import Following
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
    following: "Following | None" = None
    summary: dict[str, Any] = field(default_factory=dict)
    asked: Callable[[], int] = lambda: 0  # the signal that asks this rank to end, or 0


def run(
    scene: Scene,
    out: str | Path,
    comm: MPI.Comm = MPI.COMM_WORLD,
    *,
    watch: Callable[[Model], None] | None = None,
    laws: "Mapping[str, Law | MemoryLaw] | None" = None,
    friction: "Mapping[str, FrictionLaw] | None" = None,
    items: Iterable[Callable[[Model], Item]] = (),
    mesh: Callable[..., Any] | None = None,
    quiet: bool = False,
    resume: bool = False,
) -> Result:
    """Run a scene and leave its results in a new folder.

    Args:
        scene: What to run.
        out: Result folder; made if missing, must not hold a run unless ``resume``. It is this
            run's alone while it lasts. Passes of a scene that has several go into folders of it.
        comm: Ranks that share the run.
        watch: Called with the model at every step, for experiments.
        laws: Material laws of your own by body name, in place of the scene's.
        friction: Friction laws of your own by contact name, in place of the scene's.
        items: What acts besides, of your own: each is called with the model and returns an item
            (:class:`workflow.model.state.Item`).
        mesh: Builds a model of gmsh from ``mesh.parameters`` of a scene with ``mesh.kind =
            "gmsh"``; called on one rank.
        quiet: No progress on the terminal; ``run.log`` is always written.
        resume: Go on from the last checkpoint in ``out``; from the start if there is none, with
            outputs that are there put aside. A run that is finished is left as it is.

    Raises:
        SceneError: bad input, before anything is written.
        GuardError: the run was stopped; everything up to there is kept.
        Interrupted: SIGINT, SIGTERM or SIGHUP came; there is a checkpoint if stepping had begun.
        Alone: an error of this rank alone, which the others wait for: end them.
    """
    items = tuple(items)
    if scene.passes is not None and scene.passes.number > 1:
        from workflow.simulation.passes import run_passes

        one = partial(run, comm=comm, watch=watch, laws=laws, friction=friction, items=items)
        one = partial(one, mesh=mesh, quiet=quiet)
        return run_passes(scene, out, comm, one, quiet=quiet, resume=resume)
    began, clock = time.perf_counter(), Clock()
    progress = Progress(comm.rank == 0, quiet, clock)
    with interrupts.raised(), occupied(out, comm, "squealx run", resume=resume) as folder:
        point = None
        if resume:
            own = names_of_own(laws, friction, items)
            if (summary := finished(folder, scene, own, comm)) is not None:
                progress.log(f"{folder}: {how_to_go_on(folder)}")
                return Result(folder, summary)
            point = point_of(folder, scene, comm, progress.log)
        with one_per_rank() as threads:
            progress.note(threads)
            model = made(scene, comm, progress, point, (laws, friction, items, mesh, folder))
            job = prepared(model, clock, progress, folder, point, began)
            with concluded(job):
                if point is None:
                    begin(job)
                else:
                    take_up(job, point)
                with interrupts.noted() as job.asked:
                    for job.energy, job.error in steps(job, watch, resumed=point is not None):
                        pass
                store(job)
                leave_residual(job)
            return Result(folder, job.summary)


def made(
    scene: Scene,
    comm: MPI.Comm,
    progress: Progress,
    point: checkpoint.Checkpoint | None,
    own: tuple[Any, Any, Any, Any, Path],
) -> Model:
    """Return the model of a scene, for the checkpoint if there is one.

    ``own`` are the last arguments of :func:`workflow.model.build`.
    """
    built = point.as_built(scene) if point else scene  # its mesh may be that of an earlier end
    model = build(built, comm, progress.log, progress.clock.phase, *own)
    model.scene = scene
    if point is not None:
        point.fits(model)
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
    progress.keep_in(folder, objects=model.scene.output.log == "json")
    following = follower(model, clock)
    keeper = checkpoint.Keeper(model, ledger, results, sampling, following, clock, point, began)
    return Job(model, results, ledger, sampling, keeper, clock, progress, following=following)


def sampler(model: Model) -> "Sampling | None":
    """Return what samples a model between its outputs, imported only if the scene asks for it."""
    if model.scene.output.sample_interval is None:
        return None
    from workflow.simulation.sampling import Sampling

    return Sampling(model)


def follower(model: Model, clock: Clock) -> "Following | None":
    """Return what lets the step follow the shape of cells, imported only where it does."""
    if model.span is None:
        return None
    from workflow.simulation.following import Following

    with clock.phase("compile"):
        return Following(model)


@contextmanager
def concluded(job: Job) -> Iterator[None]:
    """Write the summary however the run inside ends; what stopped it becomes a GuardError."""
    failure: BaseException | None = None
    try:
        yield
    except BaseException as caught:
        failure = caught
    status, comm = status_of(failure), job.model.domain.msh.comm
    shared = not isinstance(failure, interrupts.Interrupted) or failure.agreed
    if failure is not None and not (shared and ranks.alike(comm)):
        leave(job, status)
        told = f"{status}; go on with: {command_to_resume(job.results.folder)}"
        if not shared:
            raise interrupts.Interrupted(told) from failure
        raise ranks.Alone(f"rank {comm.rank}: {told}") from failure
    model, clock, wall = job.model, job.clock, job.keeper.wall
    job.summary = summarise(model, job.energy, job.error, status, clock, wall)
    job.summary["step_changes"] = job.following.tables() if job.following is not None else []
    conclude(job)
    if isinstance(failure, RuntimeError | MemoryError) and not isinstance(failure, GuardError):
        # no room for results; a node went through, or is nowhere
        told = str(failure) or "out of memory"
        raise GuardError(f"step {model.state.step}: {told}") from failure
    if failure is not None:
        raise failure


def status_of(failure: BaseException | None) -> str:
    """Return how a run ended in the words of its summary."""
    if failure is None:
        return "done"
    if isinstance(failure, interrupts.Interrupted):
        return str(failure)
    if isinstance(failure, RuntimeError | MemoryError):
        return f"stopped: {str(failure) or 'out of memory'}"
    return f"failed: {type(failure).__name__}: {failure}"


def leave(job: Job, status: str) -> None:
    """Write what one rank can say by itself, and no more: the others may be anywhere."""
    model, clock = job.model, job.clock
    found = summarise(model, None, 0.0, status, clock, job.keeper.wall, contacts=False)
    with contextlib.suppress(OSError):
        write_summary(job.results.folder, found)
    job.progress.ended(status)
    job.progress.close()


def store(job: Job) -> None:
    """Write the last samples and all that waits to be written."""
    if job.sampling is not None:
        job.sampling.append(job.results)
    job.results.flush()


def leave_residual(job: Job) -> None:
    """Write what the next pass begins with, if the scene has passes."""
    if job.model.scene.passes is not None:
        from workflow.simulation.residual import leave

        with job.clock.phase("equilibrium"):
            leave(job.model, job.results.folder)


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
            raise GuardError(str(error)) from error
        job.progress.log(f"summary.json not written: {error}")
    finally:
        job.progress.ended(status)
        job.progress.close()


def begin(job: Job) -> None:
    """Tell what the run will bear, bring the model to rest and set it in motion."""
    model = job.model
    for line in step_report(model.bodies, model.mass.array, model.dt, model.dt_bound):
        job.progress.note(line)
    if model.scene.passes is not None:
        from workflow.simulation.residual import take

        take(model)
    with job.clock.phase("equilibrium"):
        start(model, job.progress.log)
    if model.placement is not None:
        from workflow.theory import wheel_on_rail  # half-spaces, for that alone

        wheel_on_rail.tell(model, job.progress.note)


def take_up(job: Job, point: checkpoint.Checkpoint) -> None:
    """Bring the model to the state of a checkpoint."""
    checkpoint.restore(job.model, job.ledger, job.sampling, job.following, point.arrays)
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
    interval, end = scene.time.output_interval, end_of(model)
    for line in job.sampling.lines() if job.sampling is not None else ():
        progress.note(line)
    progress.start(model, end)
    watched, reactions = guards.Watch(model), Reactions(model)
    hold = reactions if model.supports.dofs else None
    stepped = stepping.steps(model, end, job.clock, hold=hold, resumed=resumed)
    for _ in interruptible(job, stepped):
        if state.step == 0:
            tell_offsets(model, progress.log)
        if job.sampling is not None:
            job.sampling.step()
        if watch is not None:
            watch(model)
        if stepping.due(state.t, interval, model.dt):
            with job.clock.phase("output"):
                energy, error = job.ledger.measure()
                history = output(model, job.results, energy, error, job.ledger, reactions)
                if job.sampling is not None:
                    job.sampling.append(job.results)
            progress.output(model, history)
            for item in model.items:
                for line in item.notices() if hasattr(item, "notices") else ():
                    progress.log(line)
            watched.check(job.ledger)
            yield energy, error
        elif state.step % scene.guards.check_interval == 0:
            job.ledger.measure()
            watched.check(job.ledger)
        if job.following is not None:
            follow(job, job.following)
        if told := job.keeper.step():
            progress.log(told)
        progress.step(state.step)
    if told := job.keeper.end():
        progress.log(told)


def end_of(model: Model) -> float:
    """Return the time of the last step [s]: of a step that may change, the end of a span."""
    unit = model.dt if model.span is None else model.span
    return round(model.scene.time.end / unit) * unit


def follow(job: Job, following: "Following") -> None:
    """Let the step follow the shape of cells, where a look at it is due, and log a change."""
    model = job.model
    if model.span is None or not stepping.due(model.state.t, model.span, model.dt):
        return
    with job.clock.phase("update"):
        told = following.look()
    if told is not None:
        job.progress.log(told)
        if job.sampling is not None:
            job.sampling.retime(model.dt)


def interruptible(job: Job, stepped: Iterator[Any]) -> Iterator[Any]:
    """Yield the same, checked to be finite; a signal ends it after a step, with a checkpoint.

    Raises:
        Interrupted: on all ranks at the same step.
    """
    for state in stepped:
        number = guards.check_finite(job.model, job.asked())
        yield state
        if number and state.step > 0:  # there is no checkpoint of the start
            raise interrupted(job, number)


def interrupted(job: Job, number: int) -> interrupts.Interrupted:
    """Return what ends a run at this step on all ranks, its checkpoint written."""
    state = job.model.state
    told = job.keeper.write() or "its checkpoint is written"
    stop = interrupts.Interrupted(
        f"interrupted by {signal.Signals(number).name} at step {state.step}, t = {state.t:.6e} s; "
        f"{told}; go on with: {command_to_resume(job.results.folder)}"
    )
    stop.agreed = True
    return stop


def tell_offsets(model: Model, log: Log) -> None:
    """Log which contacts overlapped at the start, where that does not count."""
    for name, pair in model.pairs.items():
        count, depth = pair.initial_offsets
        if count:
            log(f"contacts.{name}: {count} nodes overlap by up to {depth:.1e} m at first, offset")
