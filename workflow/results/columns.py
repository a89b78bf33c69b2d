# SPDX-License-Identifier: LGPL-3.0-or-later
"""Growing columns of an HDF5 group: datasets of rows that are added at their end."""

from typing import Any

import numpy as np
import numpy.typing as npt

CHUNK = 1024  # rows that are stored together


def create(group: Any, name: str, shape: tuple[int, ...], dtype: Any, chunk: int = CHUNK) -> Any:
    """Make an empty column with rows of ``shape`` and return its dataset."""
    return group.create_dataset(
        name, (0, *shape), dtype, maxshape=(None, *shape), chunks=(chunk, *shape)
    )


def extend(
    group: Any,
    name: str,
    values: npt.ArrayLike,
    unit: str,
    about: str = "",
    chunk: int = CHUNK,
) -> Any:
    """Add rows to a column, which is made if it is not there, and return its dataset.

    Args:
        group: The group.
        name: Name of the column.
        values: Rows, shape ``(n, ...)``.
        unit: Written beside a new column.
        about: What it is, written beside a new column.
        chunk: Rows of a new column that are stored together.
    """
    rows = np.asarray(values)
    if name not in group:
        data = create(group, name, rows.shape[1:], rows.dtype, chunk)
        data.attrs["units"] = unit
        if about:
            data.attrs["about"] = about
    data, n = group[name], len(rows)
    if n:
        data.resize(len(data) + n, axis=0)
        data[-n:] = rows
    return data
