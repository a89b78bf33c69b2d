# SPDX-License-Identifier: LGPL-3.0-or-later
"""Files that survive a kill: whole ones replaced at once, HDF5 files changed all or nothing.

An HDF5 file that is being changed is broken until the last of its metadata is written. Changes are
therefore held back: new data goes behind the old end of the file, where nothing points to it yet,
and what overwrites old bytes goes to a journal first. Once that is whole it is applied; whoever is
killed meanwhile leaves a journal from which the next one finishes.
"""

import contextlib
import json
import os
import re
import shutil
import sys
import time
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import h5py

# Power cuts: a change waits for the disk only if the last one that did is this long ago, so that
# scenes of a second do not spend it waiting. A kill loses nothing in either case.
SYNC_INTERVAL = 1.0  # s
_synced: dict[Path, float] = {}


def why(error: OSError) -> str:
    """Return why a file could not be written in the words of the system, of HDF5 too."""
    found = re.search(r"errno = (\d+)", str(error))
    return os.strerror(int(found[1])) if found else error.strerror or str(error)


def replace(path: Path, content: bytes, *, sync: bool = True) -> None:
    """Replace a file at once: readers see the old content or the new one, on disk on return.

    Args:
        path: The file.
        content: What it is to hold.
        sync: Wait until it is on disk.
    """
    new = path.with_name(path.name + ".new")
    try:
        with new.open("wb") as file:
            file.write(content)
            file.flush()
            if sync:
                os.fsync(file.fileno())
        os.replace(new, path)
    except OSError:
        with contextlib.suppress(OSError):
            new.unlink()
        raise
    if sync:
        _sync_folder(path.parent)


def copy(source: Path, target: Path) -> None:
    """Copy a file; ``target`` is replaced at once."""
    new = target.with_name(target.name + ".new")
    try:
        shutil.copyfile(source, new)
        with new.open("rb") as file:
            os.fsync(file.fileno())
        os.replace(new, target)
    except OSError:
        with contextlib.suppress(OSError):
            new.unlink()
        raise
    _sync_folder(target.parent)


def _sync_folder(folder: Path) -> None:
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


@contextlib.contextmanager
def changing(path: Path) -> Iterator[h5py.File]:
    """Open an existing HDF5 file to change it; all changes reach it on leaving, or none.

    Raises:
        OSError: if the file is broken or there is no room; it is then as it was.
    """
    finish(path)
    now = time.monotonic()
    sync = now - _synced.get(path, -SYNC_INTERVAL) >= SYNC_INTERVAL
    with path.open("r+b") as raw:
        pending = Pending(raw)
        try:
            with h5py.File(pending, "r+") as file:
                yield file
            if pending.error is not None:
                raise pending.error
            if sync:
                os.fsync(raw.fileno())  # new data first: the journal makes it part of the file
            _keep(path, pending, sync)
        except BaseException as failure:
            with contextlib.suppress(OSError):
                journal_of(path).unlink(missing_ok=True)
                raw.truncate(pending.size)
            if pending.error is not None:
                raise pending.error from failure
            raise
    _apply(path, pending.writes, pending.end, sync)
    if sync:
        _synced[path] = now


class Pending:
    """A file for h5py whose old bytes stay as they are; what replaces them is held back.

    Args:
        raw: The file.
        whole: Hold back new data too: nothing of the file changes.

    Attributes:
        size: Length of the file before [bytes].
        writes: Offset and bytes of what is to replace old bytes, in order.
        end: Length of the file after [bytes].
        error: Why new data could not be written; HDF5 takes no exception from here.
    """

    def __init__(self, raw: BinaryIO, *, whole: bool = False) -> None:
        self._raw = raw
        self.size = self.end = raw.seek(0, os.SEEK_END)
        self._held = sys.maxsize if whole else self.size
        self.writes: list[tuple[int, bytes]] = []
        self.error: OSError | None = None
        self._at = 0

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Move to an offset from the start, from here or from the end."""
        self._at = offset + (0, self._at, self.end)[whence]
        return self._at

    def tell(self) -> int:
        """Return the offset."""
        return self._at

    def read(self, size: int = -1) -> bytes:
        """Return the next bytes as they will be, fewer at the end."""
        size = max(self.end - self._at, 0) if size < 0 else size
        data = bytearray(size)
        return bytes(data[: self.readinto(data)])

    def readinto(self, out: bytearray | memoryview) -> int:
        """Read the next bytes as they will be into ``out``; return how many there were."""
        view, start = memoryview(out).cast("B"), self._at
        found = os.preadv(self._raw.fileno(), [view], start)
        if self._held > self.size:  # data beyond the end is held back
            whole = max(found, min(len(view), self.end - start))
            view[found:whole] = bytes(whole - found)
            found = whole
        for offset, data in self.writes:
            first, last = max(offset, start), min(offset + len(data), start + len(view))
            if first < last:
                view[first - start : last - start] = data[first - offset : last - offset]
        self._at += found
        return found

    def write(self, data: bytes | memoryview) -> int:
        """Write behind the old end at once, and keep the rest back."""
        view, start = memoryview(data).cast("B"), self._at
        old = max(0, min(self._held - start, len(view)))
        if old:
            self.writes.append((start, bytes(view[:old])))
        done = old
        while done < len(view) and self.error is None:
            try:
                done += os.pwrite(self._raw.fileno(), view[done:], start + done)
            except OSError as error:
                self.error = error
        self._at = start + len(view)
        self.end = max(self.end, self._at)
        return len(view)

    def truncate(self, size: int | None = None) -> int:
        """Note the length that the file will have."""
        self.end = self._at if size is None else size
        return self.end

    def flush(self) -> None:
        """Nothing is held back but what must be."""


def journal_of(path: Path) -> Path:
    """Return where the changes of a file wait."""
    return path.with_name(path.name + ".journal")


def _keep(path: Path, pending: Pending, sync: bool) -> None:
    """Write the journal: a line of JSON with lengths and check sum, and the bytes."""
    body = b"".join(data for _, data in pending.writes)
    head = {
        "end": pending.end,
        "writes": [[offset, len(data)] for offset, data in pending.writes],
        "crc": zlib.crc32(body),
    }
    replace(journal_of(path), json.dumps(head).encode() + b"\n" + body, sync=sync)


def finish(path: Path) -> None:
    """Apply the journal that a killed process left of a file, if there is one, and remove it."""
    journal = journal_of(path)
    try:
        content = journal.read_bytes()
    except FileNotFoundError:
        return
    found = _changes(content)
    if found is None:  # of a disk that lost power: it was never applied
        journal.unlink()
    else:
        _apply(path, *found, sync=True)


def _changes(content: bytes) -> tuple[list[tuple[int, bytes]], int] | None:
    """Return the writes of a journal and the end of the file after them; None if it is broken."""
    line, _, body = content.partition(b"\n")
    writes, at = [], 0
    try:
        head = json.loads(line)
        if zlib.crc32(body) != head["crc"]:
            return None
        for offset, length in head["writes"]:
            writes.append((int(offset), body[at : at + length]))
            at += length
        return writes, int(head["end"])
    except (ValueError, KeyError, TypeError):
        return None


def _apply(path: Path, writes: list[tuple[int, bytes]], end: int, sync: bool) -> None:
    """Make the changes of a journal and remove it; done twice they come to the same."""
    with path.open("r+b") as raw:
        for offset, data in writes:
            os.pwrite(raw.fileno(), data, offset)
        raw.truncate(end)
        if sync:
            os.fsync(raw.fileno())
    journal_of(path).unlink()
