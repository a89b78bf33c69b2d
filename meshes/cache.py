# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cache of wheel-on-rail meshes and those of gmsh on disk, by a hash of all that makes them.

They lie in ``squealx/meshes`` of the user's cache folder (``XDG_CACHE_HOME``, else ``~/.cache``).
The folder may be removed at any time. A file is written aside and renamed, so that readers never
see half of it; its checksums tell a damaged one.
"""

import hashlib
import json
import os
import tempfile
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np

from meshes.hexmesh import HexMesh
from meshes.profiles.placement import Placement

LIMIT = 2e9  # bytes of all files together
ARRAYS = ("points", "cells", "regions", "facets", "surfaces")
Placed = tuple[HexMesh, Placement | None]


def folder() -> Path:
    """Return where the meshes are kept."""
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "squealx" / "meshes"


def key(inputs: Mapping[str, Any], sources: Iterable[Path] = ()) -> str:
    """Return a hash of what a mesh is made from, and of the code and data of this package.

    Args:
        inputs: Plain tables. A text in them that is the path of a file counts with its contents.
        sources: Further files that take part.
    """
    digest = hashlib.sha256(json.dumps(inputs, sort_keys=True).encode())
    package = Path(__file__).parent
    own = (p for p in package.rglob("*") if p.is_file() and p.suffix != ".pyc")
    named = (Path(t) for t in _texts(inputs) if os.path.isfile(t))
    for path in [*sorted(own), *sources, *named]:
        digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()[:32]


def _texts(tables: Any) -> Iterable[str]:
    if isinstance(tables, str):
        yield tables
    elif isinstance(tables, Mapping):
        for name in sorted(tables):
            yield from _texts(tables[name])
    elif isinstance(tables, list | tuple):
        for entry in tables:
            yield from _texts(entry)


def cached(name: str, make: Callable[[], Placed], log: Callable[[str], Any]) -> Placed:
    """Return the mesh kept as ``name``, or make and keep it.

    A cache that cannot be read or written costs only time; it is told in the log.

    Args:
        name: Its hash, from :func:`key`.
        make: Makes the mesh.
        log: Called with a line.
    """
    try:
        path = folder() / f"{name}.npz"
        if path.exists():
            found = load(path)
            os.utime(path)
            log(f"mesh: taken from the cache, {path}")
            return found
    except Exception as error:  # a damaged file can fail in any way
        log(f"mesh: the cache cannot be read and is left aside ({type(error).__name__}: {error})")
    made = make()
    try:
        save(folder() / f"{name}.npz", *made)
        trim(folder(), LIMIT)
    except (OSError, RuntimeError) as error:  # RuntimeError: there is no home folder
        log(f"mesh: not kept for the next run ({error})")
    return made


def save(path: Path, mesh: HexMesh, placement: Placement | None) -> None:
    """Write a mesh and its placement, if it has one, all or nothing.

    Raises:
        OSError: if the folder or the file cannot be written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    told = {"names": dict(mesh.names), "placement": asdict(placement) if placement else None}
    text = json.dumps(told, default=lambda value: value.tolist())
    handle, aside = tempfile.mkstemp(dir=path.parent, suffix=".tmp")
    try:
        with os.fdopen(handle, "wb") as file:
            arrays = {name: getattr(mesh, name) for name in ARRAYS}
            np.savez(file, told=np.frombuffer(text.encode(), dtype=np.uint8), **arrays)
        os.replace(aside, path)
    except BaseException:
        os.unlink(aside)
        raise


def load(path: Path) -> Placed:
    """Return a mesh and its placement, None if it was kept without one.

    Raises:
        OSError, EOFError, ValueError, KeyError, zipfile.BadZipFile: if the file is damaged.
    """
    with np.load(path, allow_pickle=False) as data:
        arrays = {name: data[name] for name in ARRAYS}
        told = json.loads(data["told"].tobytes())
    if told["placement"] is None:
        return HexMesh(**arrays, names=told["names"]), None
    values = {f.name: told["placement"][f.name] for f in fields(Placement)}
    values = {k: np.array(v) if isinstance(v, list) else v for k, v in values.items()}
    return HexMesh(**arrays, names=told["names"]), Placement(**values)


def trim(within: Path, limit: float) -> None:
    """Remove the files used longest ago until the rest has at most ``limit`` bytes."""
    files = []
    for path in within.iterdir():
        try:
            stat = path.stat()
        except FileNotFoundError:  # another run is tidying up too
            continue
        files.append((stat.st_mtime, stat.st_size, path))
    total = sum(size for _, size, _ in files)
    for _, size, path in sorted(files)[:-1]:
        if total <= limit:
            break
        path.unlink(missing_ok=True)
        total -= size
