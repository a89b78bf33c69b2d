# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cache folders of compiled forms, each with a lock against killed compilations.

FFCx opens ``NAME.c`` before it generates code and writes ``NAME.c.cached`` when the library is
there; who finds the first without the second waits for it. If the compiling process was killed,
that is in vain. Here every form has a folder with a file that its compiler locks: the operating
system takes the lock away with the process, so whoever gets it knows that nobody compiles there.
"""

import atexit
import fcntl
import hashlib
import logging
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import IO, Any

from cffi import VerificationError
from dolfinx import jit

LOCK = "lock"
POLL = 0.05  # between two tries for the lock [s]
NEEDED = (
    "expected a C compiler and the headers of Python (Debian: apt install gcc libc6-dev "
    "python3-dev; the variable CC names another compiler)"
)


class CompilerError(RuntimeError):
    """Forms cannot be compiled on this machine; the message says what is missing."""


@contextmanager
def compiling(comm: Any, form: Any, key: str, timeout: float) -> Iterator[Path]:
    """Yield the folder of a form for compilation, rid of leftovers; collective.

    Args:
        comm: Ranks that take part; the first compiles and holds the lock.
        form: UFL form.
        key: What the compiled code depends on beside the form.
        timeout: Longest wait for another process that compiles the same [s].

    Raises:
        CompilerError: on all ranks, if the form cannot be compiled inside.
    """
    name = hashlib.sha256(f"{form.signature()}{key}".encode()).hexdigest()[:32]
    lock, folder = _opened(f"squealx_{name}") if comm.rank == 0 else (None, None)
    folder = comm.bcast(folder, root=0)
    try:
        if lock is not None and _locked(lock, timeout):
            sweep(folder)
        yield folder
    except (VerificationError, OSError, ImportError) as error:
        raise CompilerError(f"a form cannot be compiled in {folder}: {error}; {NEEDED}") from error
    except RuntimeError as error:
        if "just-in-time" not in str(error):  # DOLFINx says so on all ranks but the first
            raise
        raise CompilerError(f"a form cannot be compiled in {folder}: {error}; {NEEDED}") from error
    finally:
        if lock is not None:
            lock.close()  # gives it back


def _opened(name: str) -> tuple[IO[str], Path]:
    """Return the open lock file of a form and its folder, which is made.

    Raises:
        CompilerError: if no folder can be written at all.
    """
    usual = Path(jit.get_options(None)["cache_dir"])
    try:
        return _file(usual / name)
    except OSError as error:
        reason = f"{usual}: {error.strerror}"
    try:
        return _file(_while_it_lasts(reason) / name)
    except OSError as error:
        raise CompilerError(
            f"compiled forms cannot be written ({reason}; {error}); expected XDG_CACHE_HOME or "
            "TMPDIR to name a folder with room and permission"
        ) from error


def _file(folder: Path) -> tuple[IO[str], Path]:
    folder.mkdir(parents=True, exist_ok=True)
    return (folder / LOCK).open("a"), folder


@cache
def _while_it_lasts(reason: str) -> Path:
    """Return a folder for compiled forms that goes with this process; say why they are not kept."""
    folder = Path(tempfile.mkdtemp(prefix="squealx-forms-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    logging.getLogger("squealx").warning("compiled forms are not kept for the next run: %s", reason)
    return folder


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
