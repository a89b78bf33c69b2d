# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cache folders of compiled forms, each with a lock against killed compilations.

FFCx opens ``NAME.c`` before it generates code and writes ``NAME.c.cached`` when the library is
there; who finds the first without the second waits for it. If the compiling process was killed,
that is in vain. Here every form has a folder with a file that its compiler locks: the operating
system takes the lock away with the process, so whoever gets it knows that nobody compiles there.
"""

import fcntl
import hashlib
import logging
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from dolfinx import jit

LOCK = "lock"
POLL = 0.05  # between two tries for the lock [s]


@contextmanager
def compiling(comm: Any, form: Any, key: str, timeout: float) -> Iterator[Path]:
    """Yield the folder of a form for compilation, rid of leftovers; collective.

    Args:
        comm: Ranks that take part; the first compiles and holds the lock.
        form: UFL form.
        key: What the compiled code depends on beside the form.
        timeout: Longest wait for another process that compiles the same [s].
    """
    name = hashlib.sha256(f"{form.signature()}{key}".encode()).hexdigest()[:32]
    folder = Path(jit.get_options(None)["cache_dir"]) / f"squealx_{name}"
    folder = comm.bcast(folder if comm.rank == 0 else None, root=0)
    if comm.rank > 0:
        yield folder
        return
    lock = _file(folder)
    if lock is None:
        yield folder
        return
    with lock:  # closing the file gives the lock back
        if _locked(lock, timeout):
            sweep(folder)
        yield folder


def _file(folder: Path) -> Any:
    """Return the open lock file, or None: then FFCx says what is wrong on all ranks."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        return (folder / LOCK).open("a")
    except OSError:
        return None


def _locked(lock: Any, timeout: float) -> bool:
    """Return whether the lock was got; not on file systems that have none."""
    until = time.monotonic() + timeout
    while True:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return True
        except BlockingIOError:
            if time.monotonic() > until:
                return False
            time.sleep(POLL)
        except OSError:
            return False


def sweep(folder: Path) -> None:
    """Remove what an unfinished compilation left in a folder where nobody compiles, and say so."""
    for source in folder.glob("libffcx_*.c"):
        if source.with_suffix(".c.cached").exists():
            continue
        for path in folder.glob(f"{source.stem}*"):
            path.unlink()
        logging.getLogger("squealx").warning(
            "cache: removed %s, left by a compilation that was killed", source
        )
