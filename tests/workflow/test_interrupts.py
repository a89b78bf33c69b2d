# SPDX-License-Identifier: LGPL-3.0-or-later
"""Signals that end a command: raised once, noted first, and never dropped."""

import os
import signal
import time
import weakref

import pytest

from workflow.simulation import interrupts


@pytest.fixture(autouse=True)
def quiet(monkeypatch):
    """No signal has come lately."""
    monkeypatch.setattr(interrupts, "_last", -interrupts.ONCE)


def send(number=signal.SIGTERM):
    os.kill(os.getpid(), number)


def test_a_signal_in_a_callback_is_not_dropped():
    """Python prints and forgets what a weak reference raises: the signal comes again outside."""

    class Thing:
        pass

    thing = Thing()
    kept = weakref.ref(thing, lambda _: send())
    with pytest.raises(interrupts.Interrupted, match="SIGTERM"), interrupts.raised():
        del thing
        time.sleep(20 * interrupts.AGAIN)
        pytest.fail("the signal was lost")
    assert kept() is None


def test_other_errors_in_callbacks_are_told_as_ever(monkeypatch):
    """The hook that was there gets what is no signal."""
    told = []
    monkeypatch.setattr("sys.unraisablehook", lambda found: told.append(str(found.exc_value)))

    class Thing:
        def __del__(self):
            raise ValueError("of a finaliser")

    with interrupts.raised():
        Thing()
    assert told == ["of a finaliser"]


def test_the_same_signal_twice_at_once_raises_once():
    """A group and its leader are sent the same: the second does not break into the ending."""
    with interrupts.raised():
        with pytest.raises(interrupts.Interrupted):
            send()
        send()
        send(signal.SIGINT)


def test_a_noted_signal_raises_nothing_until_another_comes(monkeypatch):
    """The first is told by number; within a second more are the same, later ones raise."""
    with interrupts.raised(), interrupts.noted() as asked:
        assert asked() == 0
        send(signal.SIGHUP)
        send()
        assert asked() == signal.SIGHUP
        monkeypatch.setattr(interrupts, "ONCE", 0.0)
        with pytest.raises(interrupts.Interrupted, match="SIGTERM, twice"):
            send()
