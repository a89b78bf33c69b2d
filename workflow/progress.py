# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a run says while it goes on: a progress line with time remaining, and ``run.log``."""

import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

import rich.console
import rich.progress as bar

if TYPE_CHECKING:
    from workflow.model import Model

REFRESH = 0.2  # s between updates of the line


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
        self.console = rich.console.Console(stderr=True, quiet=quiet or not root)
        self.bar: bar.Progress | None = None
        self.shown = 0.0
        self.note = ""

    def log(self, line: str) -> None:
        """Print a line and keep it in the log."""
        self.console.print(line, highlight=False, soft_wrap=True)
        self._keep(line)

    def keep_in(self, path: Path) -> None:
        """Write the log to ``path`` from now on, with what was said so far."""
        if self.root:
            self.file = path.open("w", encoding="utf-8")
            self.file.writelines(self.lines)
            self.lines.clear()

    def _keep(self, line: str) -> None:
        text = f"{time.strftime('%H:%M:%S')} {line}\n"
        if self.file:
            self.file.write(text)
            self.file.flush()
        elif self.root:
            self.lines.append(text)

    def start(self, steps: int, dt: float) -> None:
        """Begin the progress line of ``steps`` steps of ``dt`` seconds."""
        self.dt = dt
        self.log(f"stepping: {steps} steps of {dt * 1e9:.1f} ns")
        if self.console.quiet:
            return
        self.bar = bar.Progress(
            bar.TextColumn("{task.fields[clock]}"),
            bar.BarColumn(),
            bar.TaskProgressColumn(),
            bar.TextColumn("{task.fields[rate]}"),
            bar.TimeRemainingColumn(),
            bar.TextColumn("{task.fields[note]}"),
            console=self.console,
            auto_refresh=False,
        )
        self.task = self.bar.add_task("", total=steps, clock="", rate="", note="")
        self.bar.start()
        self.began = time.perf_counter()

    def step(self, step: int) -> None:
        """Move the line on, a few times a second at most."""
        if self.bar is None or time.perf_counter() - self.shown < REFRESH:
            return
        self.shown = time.perf_counter()
        rate = step / max(self.shown - self.began, 1e-9)
        self.bar.update(
            self.task,
            completed=step,
            clock=f"t = {step * self.dt * 1e3:.3f} ms",
            rate=f"{rate:.0f} steps/s",
            note=self.note,
            refresh=True,
        )

    def output(self, model: "Model", error: float) -> None:
        """Note the state at an output: energy error, contact force and patches."""
        parts = [f"energy {error:+.1e}"]
        for name, pair in model.pairs.items():
            parts.append(f"{name} {pair.normal_force / 1e3:.1f} kN, {pair.active} nodes")
        self.note = "; ".join(parts)
        self._keep(f"t = {model.state.t * 1e3:.4f} ms, step {model.state.step}: {self.note}")

    def close(self, *_: Any) -> None:
        """End the line and the log."""
        if self.bar is not None:
            self.bar.refresh()
            self.bar.stop()
        if self.file:
            self.file.close()
