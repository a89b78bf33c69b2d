# SPDX-License-Identifier: LGPL-3.0-or-later
"""Progress of a run: the line with time remaining, ``run.log``, and the time of each phase.

For machines the same goes to ``run.jsonl``, one JSON object a line: ``time`` (UTC), ``level``
(``info``, ``error``), ``phase``, ``message``, and with the progress ``step``, ``t`` [s] and its
numbers, at outputs the row of the history.
"""

import contextlib
import json
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from workflow.results.table import strict

if TYPE_CHECKING:
    import rich.progress

    from workflow.model.model import Model

REFRESH = 0.2  # s between updates of the line
PULSE = 60.0  # s after which the log tells of a run between two outputs


class Progress:
    """Progress of one run on rank 0; silent elsewhere.

    Args:
        root: Whether this is rank 0.
        quiet: Nothing on the terminal.
        clock: Tells the phase.
    """

    def __init__(self, root: bool, quiet: bool, clock: "Clock") -> None:
        self.root, self.clock = root, clock
        self.lines: list[tuple[str, dict[str, Any]]] = []  # of both logs, until there is a folder
        self.file: TextIO | None = None
        self.objects: TextIO | None = None
        self.console: rich.console.Console | None = None
        if root and not quiet:
            from rich.console import Console  # slow to import, for nothing in a quiet run

            self.console = Console(stderr=True)
        self.bar: rich.progress.Progress | None = None
        self.shown = self.told = 0.0
        self.state = ""

    def log(self, line: str) -> None:
        """Print a line and keep it in the log."""
        if self.console is not None:
            self.console.print(line, highlight=False, soft_wrap=True)
        self._keep(line)

    def note(self, line: str) -> None:
        """Keep a line in the log without showing it."""
        self._keep(line)

    def ended(self, status: str) -> None:
        """Keep how the run ended."""
        self._keep(status, level="info" if status == "done" else "error")

    def keep_in(self, folder: Path, *, objects: bool) -> None:
        """Write the log to the end of ``run.log`` from now on, what was said so far first.

        Args:
            folder: Result folder.
            objects: Write ``run.jsonl`` too.
        """
        if not self.root:
            return
        with contextlib.suppress(OSError):
            self.file = (folder / "run.log").open("a", encoding="utf-8")
            if objects:
                self.objects = (folder / "run.jsonl").open("a", encoding="utf-8")
        for line in self.lines:
            self._write(*line)
        self.lines.clear()

    def _keep(
        self, line: str, level: str = "info", numbers: Mapping[str, float | None] | None = None
    ) -> None:
        """Keep a line, for machines with its numbers."""
        if not self.root:
            return
        now = {"time": datetime.now(UTC).isoformat(timespec="milliseconds"), "level": level}
        entry = now | {"phase": self.clock.current, "message": line} | dict(numbers or {})
        text = f"{time.strftime('%H:%M:%S')} {line}\n"
        if self.file:
            self._write(text, entry)
        else:
            self.lines.append((text, entry))

    def _write(self, text: str, entry: dict[str, Any]) -> None:
        """Write a line to the log, and to that for machines if there is one."""
        with contextlib.suppress(OSError):  # a full disk: the results will tell
            if self.file is not None:
                self.file.write(text)
                self.file.flush()
            if self.objects is not None:
                self.objects.write(json.dumps(strict(entry)) + "\n")
                self.objects.flush()

    def start(self, model: "Model", end: float) -> None:
        """Begin the progress line of a run from where it stands to its last time [s]."""
        self.model, self.first, self.end = model, model.state.step, end
        self.clock.current = "stepping"
        self.log(f"stepping: {self.last - self.first} steps of {model.dt * 1e9:.1f} ns")
        self.began = self.told = time.perf_counter()
        if self.console is None:
            return
        from rich import progress as bar

        texts = (bar.TextColumn(f"{{task.fields[{name}]}}") for name in ("clock", "rate", "state"))
        clock, rate, state = texts
        ahead = bar.BarColumn(), bar.TaskProgressColumn(), rate, bar.TimeRemainingColumn()
        self.bar = bar.Progress(clock, *ahead, state, console=self.console, auto_refresh=False)
        self.task = self.bar.add_task(
            "", total=self.last, completed=self.first, clock="", rate="", state=""
        )
        self.bar.start()

    @property
    def last(self) -> int:
        """Number of the last step, if the step stays what it is."""
        state = self.model.state
        return state.step + round((self.end - state.t) / self.model.dt)

    def step(self, step: int) -> None:
        """Move the line on, a few times a second at most; the log once a minute at least."""
        now = time.perf_counter()
        if now - self.shown < REFRESH:
            return
        self.shown = now
        if now - self.told > PULSE:
            self._pulse(step)
        if self.bar is not None:
            self.bar.update(
                self.task,
                completed=step,
                total=self.last,
                clock=f"t = {self.model.state.t * 1e3:.3f} ms",
                rate=f"{self.rate(step):.0f} steps/s of {self.model.dt * 1e9:.1f} ns",
                state=self.state,
                refresh=True,
            )

    def rate(self, step: int) -> float:
        """Return the steps per second since the start [1/s]."""
        return (step - self.first) / max(time.perf_counter() - self.began, 1e-9)

    def output(self, model: "Model", history: Mapping[str, float]) -> None:
        """Note the state at an output: energy error, contact force and patches."""
        parts = [f"energy {history['balance_error']:+.1e}"]
        for name in model.pairs:
            force, patches = history[f"{name}_normal_force"], int(history[f"{name}_patches"])
            plural = "patch" if patches == 1 else "patches"
            parts.append(f"{name} {force / 1e3:.1f} kN in {patches} {plural}")
        self.state = "; ".join(parts)
        self._pulse(model.state.step, f": {self.state}", history)

    def _pulse(
        self, step: int, state: str = "", history: Mapping[str, float] | None = None
    ) -> None:
        """Keep a line of the log: time, step, rate, time remaining, and the state if given."""
        self.told, rate, last = time.perf_counter(), self.rate(step), self.last
        t, dt = self.model.state.t, self.model.dt
        left = (last - step) / rate if rate > 0 else None
        self._keep(
            f"t = {t * 1e3:.4f} ms, step {step} of {last}, "
            f"{rate:.0f} steps/s, dt = {dt * 1e9:.1f} ns, "
            f"{'starting' if left is None else f'{left:.0f} s left'}{state}",
            numbers={
                "t": t,
                "step": step,
                "steps": last,
                "dt": dt,
                "steps_per_second": rate,
                "seconds_left": left,
                **(history or {}),
            },
        )

    def close(self, *_: Any) -> None:
        """End the line and the logs."""
        if self.bar is not None:
            self.bar.refresh()
            self.bar.stop()
        for file in (self.file, self.objects):
            if file is not None:
                with contextlib.suppress(OSError):
                    file.close()


PHASES = ("mesh", "compile", "equilibrium", "internal_force", "contact", "update", "output")


@dataclass
class Clock:
    """Wall time spent in each phase of a run [s], and where the processor time began [s].

    Attributes:
        current: The phase that the run is in; between them ``stepping``.
    """

    seconds: dict[str, float] = field(default_factory=lambda: dict.fromkeys(PHASES, 0.0))
    began: float = field(default_factory=time.process_time)
    current: str = "start"

    @property
    def processor(self) -> float:
        """Processor time of this rank since the clock was made [s]: other work hardly counts."""
        return time.process_time() - self.began

    @contextmanager
    def phase(self, name: str) -> Iterator[None]:
        """Add the time spent inside to a phase."""
        start, before, self.current = time.perf_counter(), self.current, name
        try:
            yield
        finally:
            self.seconds[name] += time.perf_counter() - start
            self.current = before

    def timed(self, name: str, add: Callable[..., None]) -> Callable[..., None]:
        """Return ``add`` with its time counted as ``name``."""

        def wrapped(state: Any, force: Any) -> None:
            start = time.perf_counter()
            add(state, force)
            self.seconds[name] += time.perf_counter() - start

        return wrapped
