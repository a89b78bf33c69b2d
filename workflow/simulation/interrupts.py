# SPDX-License-Identifier: LGPL-3.0-or-later
"""Signals that end a command: at once, or noted where there is something to be kept first."""

import contextlib
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
ONCE = 1.0  # s within which signals are one: a group and its leader are often sent the same
POLL = 0.1  # s
AGAIN = 0.05  # s after which a signal that Python has dropped comes again
_last = -ONCE  # when one has raised, or was noted [s]


class Interrupted(BaseException):
    """A command that a signal ended; not an ``Exception``, so that nothing takes it for an error.

    Attributes:
        number: Of the signal.
        agreed: Whether all ranks raise it at the same place.
    """

    def __init__(self, message: str, number: int = signal.SIGINT) -> None:
        super().__init__(message)
        self.number, self.agreed = number, False


def another() -> bool:
    """Tell whether a signal that has just come is another one than the last, and keep its time."""
    global _last
    now = time.monotonic()
    another = now - _last >= ONCE
    if another:
        _last = now
    return another


@contextlib.contextmanager
def raised() -> Iterator[None]:
    """Have the signals that end a process raise ``Interrupted`` inside.

    One that comes twice at once raises once. What a signal raises in a callback, where Python drops
    it, comes again outside. Those that are ignored, as by ``nohup``, stay so; outside the main
    thread nothing changes.
    """

    def interrupt(number: int, _: Any) -> None:
        if another():
            raise Interrupted(f"interrupted by {signal.Signals(number).name}", number)

    with handled(interrupt), _not_dropped():
        yield


@contextlib.contextmanager
def _not_dropped() -> Iterator[None]:
    """Send a signal once more whose ``Interrupted`` came up in a finaliser or a weak reference."""
    before = sys.unraisablehook

    def dropped(found: Any) -> None:
        global _last
        if not isinstance(found.exc_value, Interrupted):
            before(found)
            return
        _last = -ONCE
        again = threading.Timer(AGAIN, os.kill, (os.getpid(), found.exc_value.number))
        again.daemon = True
        again.start()

    sys.unraisablehook = dropped
    try:
        yield
    finally:
        sys.unraisablehook = before


@contextlib.contextmanager
def noted() -> Iterator[Callable[[], int]]:
    """Have a first signal noted inside, a second raise; yield what returns its number, or 0."""
    number = 0

    def note(got: int, _: Any) -> None:
        nonlocal number
        if number and another():
            raise Interrupted(f"interrupted by {signal.Signals(got).name}, twice", got)
        if not number:
            number = got
            another()

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
