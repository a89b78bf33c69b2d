# SPDX-License-Identifier: LGPL-3.0-or-later
"""What goes into an HDF5 file: rows at the end of growing columns, whole datasets, attributes.

They are values first, so that those of many outputs can be written at once, or kept elsewhere until
then. h5py's low-level calls write them: its objects cost more than the few numbers of an output.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import h5py
import numpy as np
import numpy.typing as npt

CHUNK = 1024  # rows that are stored together
WHOLE = 0  # in place of a chunk: a dataset of its own, which does not grow


@dataclass(frozen=True)
class Item:
    """Something to write.

    Attributes:
        name: Path in the file.
        values: Rows of a column, a whole dataset, or None for attributes of a group.
        attrs: Numbers, text or lists; beside a column where it is new.
        chunk: Rows of a new column that are stored together, or ``WHOLE``.
    """

    name: str
    values: npt.NDArray[Any] | None
    attrs: dict[str, Any] = field(default_factory=dict)
    chunk: int = CHUNK


def rows(
    name: str, values: npt.ArrayLike, unit: str, about: str = "", chunk: int = CHUNK, **attrs: Any
) -> Item:
    """Return rows for the end of a column, which is made if it is not there.

    Args:
        name: Path of the column.
        values: Rows, shape ``(n, ...)``, of the same type each time.
        unit: Written beside a new column.
        about: What it is, written beside a new column.
        chunk: Rows of a new column that are stored together.
        attrs: What else is written beside it.
    """
    attrs = {"units": unit} | ({"about": about} if about else {}) | attrs
    return Item(name, np.asarray(values), attrs, chunk)


def whole(name: str, values: npt.ArrayLike, **attrs: Any) -> Item:
    """Return a dataset that is written once."""
    return Item(name, np.asarray(values), attrs, WHOLE)


def note(group: str, **attrs: Any) -> Item:
    """Return attributes of a group, which is made if it is not there."""
    return Item(group, None, attrs)


def write(file: h5py.File, items: Iterable[Item]) -> None:
    """Write items in their order, the rows of each column all at once where they come last."""
    columns: dict[str, list[Item]] = {}
    notes: dict[str, dict[str, Any]] = {}
    for item in items:
        if item.values is None:
            notes.setdefault(item.name, {}).update(item.attrs)
        elif item.chunk == WHOLE:
            _put(file, item)
        else:
            columns.setdefault(item.name, []).append(item)
    for parts in columns.values():
        _extend(file, parts)
    for name, attrs in notes.items():
        group = file.require_group(name)
        for key, value in attrs.items():
            group.attrs[key] = value


def _put(file: h5py.File, item: Item) -> None:
    """Make a dataset and write its values; one that a killed run has left is replaced."""
    values = np.asarray(item.values, order="C")  # keeps the shape of a scalar
    space = h5py.h5s.create_simple(values.shape)
    try:
        data = _create(file, item, space, PLAIN)
    except ValueError:
        del file[item.name]
        data = _create(file, item, space, PLAIN)
    if values.size:
        data.write(h5py.h5s.ALL, h5py.h5s.ALL, values)


def _extend(file: h5py.File, parts: list[Item]) -> None:
    """Add rows to a column, which is made if it is not there."""
    first = parts[0]
    values = np.concatenate([part.values for part in parts if part.values is not None])
    shape = values.shape[1:]
    try:
        data = h5py.h5d.open(file.id, first.name.encode())
    except KeyError:
        chunks = _plain()
        chunks.set_chunk((first.chunk, *shape))
        space = h5py.h5s.create_simple((0, *shape), (h5py.h5s.UNLIMITED, *shape))
        data = _create(file, first, space, chunks)
    if len(values):
        n = data.shape[0]
        data.set_extent((n + len(values), *shape))
        target = data.get_space()
        target.select_hyperslab((n, *(0 for _ in shape)), values.shape)
        data.write(h5py.h5s.create_simple(values.shape), target, np.ascontiguousarray(values))


def _create(file: h5py.File, item: Item, space: Any, plan: Any) -> Any:
    """Make a dataset, the groups above it and its attributes."""
    assert item.values is not None
    kind = h5py.h5t.py_create(item.values.dtype, logical=True)
    data = h5py.h5d.create(file.id, item.name.encode(), kind, space, plan, ABOVE)
    for key, value in item.attrs.items():
        if isinstance(value, str):
            attr = h5py.h5a.create(data, key.encode(), TEXT, SCALAR)
            attr.write(np.array(value, dtype=h5py.string_dtype()))
        else:
            h5py.AttributeManager(h5py.Dataset(data))[key] = value
    return data


def _plain() -> Any:
    """Return the plan of a dataset without times, so that the same run gives the same file."""
    plan = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    plan.set_obj_track_times(False)
    return plan


def _above() -> Any:
    """Return the plan of a link: the groups above it are made."""
    plan = h5py.h5p.create(h5py.h5p.LINK_CREATE)
    plan.set_create_intermediate_group(True)
    return plan


PLAIN, ABOVE = _plain(), _above()
TEXT = h5py.h5t.py_create(h5py.string_dtype(), logical=True)
SCALAR = h5py.h5s.create(h5py.h5s.SCALAR)
