# SPDX-License-Identifier: LGPL-3.0-or-later
"""Signals that end a command: at once, or noted where there is something to be kept first."""

import contextlib
import signal
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
ONCE = 1.0  # s within which signals are one: a group and its leader are often sent the same
POLL = 0.1  # s


class Interrupted(BaseException):
    """A command that a signal ended; not an ``Exception``, so that nothing takes it for an error.

    Attributes:
        agreed: Whether all ranks raise it at the same place.
    """

    agreed = False


@contextlib.contextmanager
def raised() -> Iterator[None]:
    """Have the signals that end a process raise ``Interrupted`` inside.

    Those that are ignored, as by ``nohup``, stay so; outside the main thread nothing changes.
    """

    def interrupt(number: int, _: Any) -> None:
        raise Interrupted(f"interrupted by {signal.Signals(number).name}")

    with handled(interrupt):
        yield


@contextlib.contextmanager
def noted() -> Iterator[Callable[[], int]]:
    """Have a first signal noted inside, a second raise; yield what returns its number, or 0."""
    number, first = 0, 0.0

    def note(got: int, _: Any) -> None:
        nonlocal number, first
        if number and time.monotonic() - first > ONCE:
            raise Interrupted(f"interrupted by {signal.Signals(got).name}, twice")
        if not number:
            number, first = got, time.monotonic()

    with handled(note):
        yield lambda: number


@contextlib.contextmanager
def handled(handler: Callable[[int, Any], None]) -> Iterator[None]:
    """Have a handler take the signals that end a process inside."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {s: signal.getsignal(s) for s in SIGNALS if signal.getsignal(s) != signal.SIG_IGN}
    for number in before:
        signal.signal(number, handler)
    try:
        yield
    finally:
        for number, old in before.items():
            # None is a handler of C, as PETSc's: it would print a text of its own
            signal.signal(number, signal.SIG_DFL if old is None else old)
