# SPDX-License-Identifier: LGPL-3.0-or-later
"""Where the wall time of a run goes."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

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
