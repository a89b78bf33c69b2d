# SPDX-License-Identifier: LGPL-3.0-or-later
"""Node positions along a line: graded from one end, or even in a zone and growing away from it."""

import numpy as np

from meshes.arrays import Array


def positive(name: str, value: float | None) -> float:
    """Return a length.

    Raises:
        ValueError: naming it, if it is missing, not positive or not finite.
    """
    if value is None or not (np.isfinite(value) and value > 0):
        raise ValueError(f"{name}: expected a positive length [m], got {value}")
    return value


def graded(
    length: float, size: float | None = None, *, cells: int | None = None, growth: float = 1.0
) -> Array:
    """Return node positions from 0 to ``length``, finest at 0, shape ``(cells + 1,)`` [m].

    Args:
        length: Distance to divide [m].
        size: Largest first edge [m]; the number of cells follows, unless ``cells`` is given.
        cells: Number of cells.
        growth: Ratio of neighbouring edges, at least 1 [-].

    Raises:
        ValueError: if an argument is out of range.
    """
    count = graded_cells(length, size if cells is None else length, growth)
    if cells is None:
        cells = count
    elif cells < 1:
        raise ValueError(f"cells: expected at least 1 along each axis, got {cells}")
    ends = np.concatenate([[0.0], np.cumsum(growth ** np.arange(cells, dtype=float))])
    return length * (ends / ends[-1])


def graded_cells(length: float, size: float | None, growth: float = 1.0) -> int:
    """Return the number of cells that :func:`graded` makes.

    Raises:
        ValueError: if an argument is out of range.
    """
    if not (np.isfinite(growth) and growth >= 1):
        raise ValueError(f"growth: expected a finite ratio of at least 1, got {growth}")
    ratio = positive("length", length) / positive("size", size)
    if growth > 1:  # cells in a geometric series with this sum
        ratio = float(np.log1p(ratio * (growth - 1)) / np.log(growth))
    return max(1, int(np.ceil(ratio - 1e-9)))


def zoned(
    name: str,
    span: tuple[float, float],
    fine: tuple[float, float],
    size: float,
    growth: float,
    largest: float | None = None,
) -> Array:
    """Return node positions over ``span``, even inside ``fine`` and growing outside, ``(n,)`` [m].

    Args:
        name: Name of the axis for messages.
        span: First and last position [m].
        fine: Ends of the even zone [m].
        size: Largest edge in the zone [m].
        growth: Ratio of neighbouring edges outside, at least 1 [-].
        largest: Length beyond which edges do not grow [m]; None for no bound.

    Raises:
        ValueError: if the span is empty or the zone not inside of it.
    """
    (first, last), (a, b) = span, fine
    _check_zone(name, span, fine)
    inner = np.linspace(a, b, graded_cells(b - a, size) + 1)
    before, after = (_growing(length, size, growth, largest) for length in (a - first, last - b))
    stations = np.concatenate([a - before[::-1], inner, b + after])
    if largest is not None:  # sums of steps end there but for round-off
        stations[[0, -1]] = first, last
    return stations


def zoned_cells(
    name: str,
    span: tuple[float, float],
    fine: tuple[float, float],
    size: float,
    growth: float,
) -> int:
    """Return the number of cells that :func:`zoned` makes without a bound on their length.

    Raises:
        ValueError: if the span is empty or the zone not inside of it.
    """
    _check_zone(name, span, fine)
    sides = (length for length in (fine[0] - span[0], span[1] - fine[1]) if length > 0)
    inner = graded_cells(fine[1] - fine[0], size)
    return inner + sum(graded_cells(length, size * growth, growth) for length in sides)


def _check_zone(name: str, span: tuple[float, float], fine: tuple[float, float]) -> None:
    (first, last), (a, b) = span, fine
    if not first <= a < b <= last:
        raise ValueError(
            f"fine_{name}: expected a zone inside {name} = [{first}, {last}] m, got [{a}, {b}] m"
        )


def _growing(length: float, size: float, growth: float, largest: float | None) -> Array:
    """Return distances from a zone whose edges grow from ``size`` on and end at ``length`` [m]."""
    if not length > 0:
        return np.zeros(0)
    if largest is None:
        return graded(length, size * growth, growth=growth)[1:]
    steps: list[float] = []
    while sum(steps) < length - 1e-9:
        steps.append(min(size * growth ** (len(steps) + 1), largest))
    return np.cumsum(steps) * (length / sum(steps)) if steps else np.zeros(0)
