# SPDX-License-Identifier: LGPL-3.0-or-later
"""Batches of an HDF5 file: what is added often is written seldom, and not lost meanwhile.

A change of an HDF5 file that is whole or not there (:mod:`workflow.results.atomic`) costs some
milliseconds, more than the physics of a small scene. Records that come faster than one a second
therefore wait in memory, and in a file ``NAME.waiting`` beside the HDF5 file: there a record is one
write at the end. A killed process leaves that file; whoever opens the results to read takes it in,
and whoever goes on with the run writes it where it belongs.
"""

import contextlib
import json
import os
import time
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from workflow.results import atomic
from workflow.results.columns import Item, write

MOST = 8 * 2**20  # bytes that wait at most
COUNT = "records"  # attribute of the file: records that are in it


def waiting_of(path: Path) -> Path:
    """Return where the records of an HDF5 file wait."""
    return path.with_name(path.name + ".waiting")


class Batch:
    """Adds records to an HDF5 file that is there.

    Attributes:
        path: The file.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        with h5py.File(path, "r", locking=False) as file:
            self._count = int(file.attrs.get(COUNT, 0))
        self._items: list[Item] = []
        self._bytes, self._flushed = 0, time.monotonic()

    def add(self, items: Sequence[Item]) -> None:
        """Add a record, all of it or nothing; it may wait for later ones.

        Raises:
            OSError: if it can be kept nowhere.
        """
        self._items += items
        self._count += 1
        content = packed(self._count, items)
        self._bytes += len(content)
        late = time.monotonic() - self._flushed >= atomic.SYNC_INTERVAL
        if late or self._bytes > MOST:
            self.flush()
        else:
            append(waiting_of(self.path), content)

    def flush(self) -> None:
        """Write all that waits.

        Raises:
            OSError: if there is no room; the file is then as it was, and what waits still does.
        """
        if not self._items:
            return
        with atomic.changing(self.path) as file:
            write(file, self._items)
            file.attrs[COUNT] = self._count
        waiting_of(self.path).unlink(missing_ok=True)
        self._items, self._bytes, self._flushed = [], 0, time.monotonic()


def append(path: Path, content: bytes) -> None:
    """Add bytes to the end of a file, all or none."""
    with path.open("ab", buffering=0) as file:
        size = file.seek(0, os.SEEK_END)
        try:
            done = 0
            while done < len(content):
                done += file.write(content[done:])
        except OSError:
            with contextlib.suppress(OSError):
                file.truncate(size)
            raise


def packed(number: int, items: Sequence[Item]) -> bytes:
    """Return a record: a line of JSON (the kind of each item, a check sum), then its bytes."""
    parts = [b"" if item.values is None else item.values.tobytes() for item in items]
    body = b"".join(parts)
    kinds = [[item.name, *_kind(item.values), item.attrs, item.chunk] for item in items]
    head = {"number": number, "bytes": len(body), "crc": zlib.crc32(body), "items": kinds}
    return json.dumps(head).encode() + b"\n" + body


def _kind(values: Any) -> tuple[Any, Any]:
    return (None, None) if values is None else (values.dtype.str, values.shape)


def records(path: Path) -> Iterator[tuple[int, list[Item]]]:
    """Yield number and items of the whole records in a file; one cut off by a kill is left out."""
    content, at = path.read_bytes(), 0
    while (end := content.find(b"\n", at)) >= 0:
        head = json.loads(content[at:end])
        at = end + 1 + head["bytes"]
        body = content[end + 1 : at]
        if len(body) < head["bytes"] or zlib.crc32(body) != head["crc"]:
            return
        items, start = [], 0
        for name, dtype, shape, attrs, chunk in head["items"]:
            values = None
            if dtype is not None:
                n = int(np.prod(shape))
                values = np.frombuffer(body, dtype, n, start).reshape(shape)
                start += values.nbytes
            items.append(Item(name, values, attrs, chunk))
        yield head["number"], items


def take_in(file: h5py.File, path: Path) -> None:
    """Write the records that wait for ``path`` into ``file``, those that it does not hold yet."""
    with contextlib.suppress(FileNotFoundError):  # just written by the run, if it goes on
        count = int(file.attrs.get(COUNT, 0))
        new = [(number, items) for number, items in records(waiting_of(path)) if number > count]
        if new and new[0][0] == count + 1:  # else the run has written since the file was opened
            write(file, [item for _, items in new for item in items])
            file.attrs[COUNT] = new[-1][0]


def finish(path: Path) -> None:
    """Write what a killed process left waiting of a file, if anything."""
    atomic.finish(path)
    if waiting_of(path).exists():
        with atomic.changing(path) as file:
            take_in(file, path)
        waiting_of(path).unlink()


def drop(path: Path) -> None:
    """Forget what a killed process left of a file that is to be replaced."""
    waiting_of(path).unlink(missing_ok=True)
    atomic.journal_of(path).unlink(missing_ok=True)


@contextlib.contextmanager
def opened(path: Path) -> Iterator[h5py.File]:
    """Open an HDF5 file to read, what waits for it taken in; nothing in the folder is changed."""
    if not waiting_of(path).exists():
        with h5py.File(path, "r", locking=False) as file:
            yield file
        return
    with path.open("rb") as raw:
        with h5py.File(atomic.Pending(raw, whole=True), "r+") as file:
            take_in(file, path)
            yield file
