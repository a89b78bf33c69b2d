# SPDX-License-Identifier: LGPL-3.0-or-later
"""Lock of a result folder: one run or study is at work in it at a time.

The lock is the kernel's, which lets it go when the last process that holds it ends. It does not
always reach other machines that share the disk, so the file tells who holds it: machine, process
and time. A clean end removes the file.
"""

import contextlib
import fcntl
import json
import os
import platform
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TextIO

from workflow.scene.units import SceneError

NAME = ".lock"


@contextlib.contextmanager
def locked(folder: Path, who: str) -> Iterator[TextIO]:
    """Hold a folder, which is made if missing and goes again if nothing was put into it.

    Args:
        folder: The folder.
        who: What is at work, for the message of whoever comes second.

    Yields:
        The open lock; a child that has it inherited holds the folder too.

    Raises:
        SceneError: if somebody is at work here, or if the folder cannot be written.
    """
    path, made = folder / NAME, [p for p in (folder, *folder.parents) if not p.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        file = _taken(path)
    except OSError as error:
        raise SceneError(
            f"out = {str(folder)!r}: expected a folder that can be written ({error.strerror})"
        ) from None
    with file:
        about = {"who": who, "host": platform.node(), "process": os.getpid()}
        about["since"] = time.strftime("%Y-%m-%d %H:%M:%S")
        file.seek(0)
        file.truncate()
        file.write(json.dumps(about) + "\n")
        file.flush()
        try:
            yield file
        finally:
            with contextlib.suppress(OSError):
                path.unlink()
                for above in made:
                    above.rmdir()


def _taken(path: Path) -> TextIO:
    """Return the lock, taken; raise ``SceneError`` if somebody else has it."""
    while True:
        file = path.open("a+", encoding="utf-8")
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            alone = True
        except BlockingIOError:
            _refuse(path, "expected to be started when it has ended, or another folder")
        except OSError:  # a disk without locks
            alone = False
        with contextlib.suppress(FileNotFoundError):
            if os.path.samestat(os.fstat(file.fileno()), path.stat()):
                break
        file.close()  # its holder has just ended and removed it
    about = _read(path)
    if about.get("host", platform.node()) != platform.node():
        _refuse(path, f"if that has ended, remove {str(path)!r} and start again")
    if not alone and _alive(int(about.get("process", 0))):
        _refuse(path, "expected to be started when it has ended, or another folder")
    return file


def _refuse(path: Path, expected: str) -> None:
    about = _read(path)
    told = "process {process} on {host}, since {since}".format_map(about) if about else "just begun"
    raise SceneError(
        f"out = {str(path.parent)!r}: another {about.get('who', 'squealx')} is at work here "
        f"({told}); {expected}"
    )


def _read(path: Path) -> dict[str, str]:
    """Return who holds a lock; nothing of one that nobody has signed, or not whole."""
    with contextlib.suppress(OSError, ValueError, TypeError):
        about = dict(json.loads(path.read_text("utf-8")))
        if about.keys() >= {"who", "host", "process", "since"}:
            return {key: str(value) for key, value in about.items()}
    return {}


def _alive(process: int) -> bool:
    if process <= 0:
        return False
    with contextlib.suppress(OSError):
        os.kill(process, 0)
        return process != os.getpid()
    return False
