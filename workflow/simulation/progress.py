# SPDX-License-Identifier: LGPL-3.0-or-later
"""Progress of a run: the line with time remaining, ``run.log``, and the time of each phase."""

import contextlib
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

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
    """

    def __init__(self, root: bool, quiet: bool) -> None:
        self.root = root
        self.lines: list[str] = []  # until there is a folder to write to
        self.file: TextIO | None = None
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

    def keep_in(self, path: Path) -> None:
        """Write the log to the end of ``path`` from now on, what was said so far first."""
        if self.root:
            with contextlib.suppress(OSError):
                self.file = path.open("a", encoding="utf-8")
                self.file.writelines(self.lines)
            self.lines.clear()

    def _keep(self, line: str) -> None:
        text = f"{time.strftime('%H:%M:%S')} {line}\n"
        if self.file:
            with contextlib.suppress(OSError):  # a full disk: the results will tell
                self.file.write(text)
                self.file.flush()
        elif self.root:
            self.lines.append(text)

    def start(self, model: "Model", last: int) -> None:
        """Begin the progress line of a run from where it stands to its last step."""
        self.dt, self.first, self.last = model.dt, model.state.step, last
        self.log(f"stepping: {last - self.first} steps of {self.dt * 1e9:.1f} ns")
        self.began = self.told = time.perf_counter()
        if self.console is None:
            return
        from rich import progress as bar

        texts = (bar.TextColumn(f"{{task.fields[{name}]}}") for name in ("clock", "rate", "state"))
        clock, rate, state = texts
        ahead = bar.BarColumn(), bar.TaskProgressColumn(), rate, bar.TimeRemainingColumn()
        self.bar = bar.Progress(clock, *ahead, state, console=self.console, auto_refresh=False)
        self.task = self.bar.add_task(
            "", total=last, completed=self.first, clock="", rate="", state=""
        )
        self.bar.start()

    def step(self, step: int) -> None:
        """Move the line on, a few times a second at most; the log once a minute at least."""
        now = time.perf_counter()
        if now - self.shown < REFRESH:
            return
        self.shown = now
        if now - self.told > PULSE:
            self._pulse(step, "")
        if self.bar is not None:
            self.bar.update(
                self.task,
                completed=step,
                clock=f"t = {step * self.dt * 1e3:.3f} ms",
                rate=f"{self.rate(step):.0f} steps/s of {self.dt * 1e9:.1f} ns",
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
        self._pulse(model.state.step, f": {self.state}")

    def _pulse(self, step: int, state: str) -> None:
        """Keep a line of the log: time, step, rate, time remaining, and the state if given."""
        self.told, rate = time.perf_counter(), self.rate(step)
        left = f"{(self.last - step) / rate:.0f} s left" if rate > 0 else "starting"
        self._keep(
            f"t = {step * self.dt * 1e3:.4f} ms, step {step} of {self.last}, "
            f"{rate:.0f} steps/s, dt = {self.dt * 1e9:.1f} ns, {left}{state}"
        )

    def close(self, *_: Any) -> None:
        """End the line and the log."""
        if self.bar is not None:
            self.bar.refresh()
            self.bar.stop()
        if self.file:
            with contextlib.suppress(OSError):
                self.file.close()


PHASES = ("mesh", "compile", "equilibrium", "internal_force", "contact", "update", "output")


@dataclass
class Clock:
    """Wall time spent in each phase of a run [s], and where the processor time began [s]."""

    seconds: dict[str, float] = field(default_factory=lambda: dict.fromkeys(PHASES, 0.0))
    began: float = field(default_factory=time.process_time)

    @property
    def processor(self) -> float:
        """Processor time of this rank since the clock was made [s]: other work hardly counts."""
        return time.process_time() - self.began

    @contextmanager
    def phase(self, name: str) -> Iterator[None]:
        """Add the time spent inside to a phase."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] += time.perf_counter() - start

    def timed(self, name: str, add: Callable[..., None]) -> Callable[..., None]:
        """Return ``add`` with its time counted as ``name``."""

        def wrapped(state: Any, force: Any) -> None:
            start = time.perf_counter()
            add(state, force)
            self.seconds[name] += time.perf_counter() - start

        return wrapped
