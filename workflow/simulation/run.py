# SPDX-License-Identifier: LGPL-3.0-or-later
"""A run from scene to results: equilibrium, rolling start, steps, outputs, summary."""

import copy
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

from forms.elements import Law
from workflow.audit.audit import audit
from workflow.model.contacts import tell_offsets
from workflow.model.model import Model, build
from workflow.results.writer import Results, check_free
from workflow.scene.scene import Scene, SceneError
from workflow.simulation import checkpoint, guards
from workflow.simulation.checkpoint import restore
from workflow.simulation.energy import Energy, Ledger
from workflow.simulation.initial import check_apart, start
from workflow.simulation.progress import Clock, Progress
from workflow.simulation.stepping import State, central_difference
from workflow.simulation.summary import answers, output, summarise

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


@dataclass
class Job:
    """A run under way: the model and all that is kept of it."""

    model: Model
    results: Results
    ledger: Ledger
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
    model = modelled(scene, point, comm, clock, progress, laws, friction)
    results, ledger = Results(folder, scene, model.domain, point), Ledger(model)
    progress.keep_in(folder / "run.log", go_on=point is not None)
    keeper = checkpoint.Keeper(model, ledger, results, clock, point, began)
    job = Job(model, results, ledger, keeper, clock, progress)
    with concluded(job):
        if point is None:
            begin(job)
        else:
            take_up(job, point)
        for job.energy, job.error in steps(job, watch, resumed=point is not None):
            pass
    return Result(folder, job.summary)


def modelled(
    scene: Scene,
    point: checkpoint.Checkpoint | None,
    comm: MPI.Comm,
    clock: Clock,
    progress: Progress,
    laws: Mapping[str, Law] | None,
    friction: "Mapping[str, FrictionLaw] | None",
) -> Model:
    """Return the model of a scene, checked against its checkpoint if it has one."""
    built = point.as_built(scene) if point else scene
    model = build(built, comm, progress.log, clock, laws, friction)
    model.scene = scene  # its mesh may be that of an earlier end
    if scene.output.sample_interval is not None:
        from workflow.simulation.sampling import Sampling

        model.sampling = Sampling(model)
    if point is not None:
        point.fits(model)
    else:
        check_apart(model)
    return model


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


def conclude(job: Job) -> None:
    """Write the last samples and the summary; if it is a full disk that ended the run, say so."""
    model, results, status = job.model, job.results, job.summary["status"]
    try:
        results.append_samples(model.sampling)
        job.summary["expected"] = answers(model, results.folder, status, job.progress.log)
        results.summarise(job.summary)
    except RuntimeError as error:
        if status == "done":
            raise guards.GuardError(str(error)) from error
        job.progress.log(f"summary.json not written: {error}")
    finally:
        job.progress.close()


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


def begin(job: Job) -> None:
    """Tell what the run will bear, bring the model to rest and set it in motion."""
    for line in audit(job.model):
        job.progress.note(line)
    with job.clock.phase("equilibrium"):
        start(job.model, job.progress.log)
    if job.model.placement is not None:
        from workflow.theory import at_rest

        at_rest.tell(job.model, job.progress.note)


def take_up(job: Job, point: checkpoint.Checkpoint) -> None:
    """Bring the model to the state of a checkpoint."""
    restore(job.model, job.ledger, point.arrays)
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
    for line in model.sampling.lines() if model.sampling is not None else ():
        progress.note(line)
    progress.start(model, round(scene.time.end / model.dt))
    watched = guards.Watch(model)
    for _ in timed_steps(model, job.clock, resumed):
        guards.check_finite(model)
        if state.step == 0:
            tell_offsets(model, progress.log)
        if model.sampling is not None:
            model.sampling.step()
        if watch is not None:
            watch(model)
        if state.step % per_output == 0:
            with job.clock.phase("output"):
                energy, error = job.ledger.measure()
                history = output(model, job.results, energy, error)
            progress.output(model, history)
            watched.check(error)
            yield energy, error
        elif state.step % scene.guards.check_interval == 0:
            watched.check(job.ledger.measure()[1])
        if told := job.keeper.step():
            progress.log(told)
        progress.step(state.step)
    if told := job.keeper.end():
        progress.log(told)


def timed_steps(model: Model, clock: Clock, resumed: bool) -> Iterator[State]:
    """Yield the states of the run; what neither loads nor others are timed for is ``update``."""
    began, busy = time.perf_counter(), sum(clock.seconds.values())
    yield from central_difference(
        model.state,
        model.mass.petsc_vec,
        [clock.timed(model.phase_of(add), add) for add in model.loads],
        model.drives or model.supports,
        model.dt,
        round(model.scene.time.end / model.dt) * model.dt,
        model.connections.masses if model.connections is not None else None,
        model.dead.nodal,
        resumed=resumed,
        last=[clock.timed(model.phase_of(add), add) for add in model.last],
    )
    others = sum(clock.seconds.values()) - busy
    clock.seconds["update"] += time.perf_counter() - began - others
