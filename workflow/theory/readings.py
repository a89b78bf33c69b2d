# SPDX-License-Identifier: LGPL-3.0-or-later
"""Readings of a result folder that closed forms are compared with: forces and motion of bodies."""

from typing import TYPE_CHECKING

import numpy as np

from meshes.arrays import Array
from meshes.quality import cell_volumes
from workflow.results.record import Record

if TYPE_CHECKING:
    from workflow.results.patch_nodes import PatchNodes


def forces(record: Record) -> tuple[Array, Array, Array]:
    """Times [s], normal [N] and tangential force ``(k, 3)`` [N] on the contactor of the first pair.

    Those sampled at ``output.sample_interval``, at the outputs without.
    """
    pair = next(iter(record.scene["contacts"]))
    if record.checked.output.sample_interval is not None:
        from workflow.results.samples import read  # a run that samples nothing does not need it

        samples = read(record.folder)
        if samples is not None and pair in samples.pairs:
            found = samples.pairs[pair]
            return samples.t, np.linalg.norm(found.normal, axis=1), found.tangential
    history = record.history
    parts = [history[f"{pair}_tangential_{axis}_force"] for axis in "xyz"]
    return history["t"], history[f"{pair}_normal_force"], np.column_stack(parts)


def until(record: Record) -> float:
    """Time of the last output [s]; before time zero if there is none."""
    t = record.history.get("t", np.zeros(0))
    return float(t[-1]) if len(t) else -1.0


def patch_at_end(record: Record) -> "PatchNodes | None":
    """Patch with most force of the first pair at the last output, None if nothing touches there."""
    patches = record.patches_at(next(iter(record.scene["contacts"])), -1).values()
    return max(patches, key=lambda p: p.normal_force, default=None)


def crossings(t: Array, values: Array, level: float) -> Array:
    """Return the times at which values between their samples pass a level [s]."""
    above = values - level
    k = np.flatnonzero((above[:-1] > 0) != (above[1:] > 0))
    return np.asarray(t[k] + above[k] / (above[k] - above[k + 1]) * (t[k + 1] - t[k]))


def half_axes(at: Array, force: Array, moment: float = 5.0) -> tuple[float, float]:
    """Return the half axes, along the axes of the frame, of the ellipse of the same moments [m].

    Args:
        at: Positions from the centre, shape ``(n, 2)`` [m].
        force: Forces there, shape ``(n,)`` [N].
        moment: Square of a half axis over the mean square of its coordinate: 5 for the pressure
            of Hertz on an ellipse, 4 on a strip.
    """
    a, b = np.sqrt(moment * (force @ at**2) / force.sum())
    return float(a), float(b)


def volumes(record: Record, region: str) -> Array | None:
    """Volume of a region at each node, an eighth of each cell, shape ``(n,)`` [m3].

    None where a run wrote no fields.
    """
    body = record.body
    if body is None:
        return None
    numbers = {name: number for number, name in body.names.items()}
    cells = body.cells[body.regions == numbers[region]]
    share = np.repeat(cell_volumes(body.points, cells) / 8, 8)
    total = np.bincount(cells.ravel(), share, minlength=len(body.points))
    return np.asarray(total, dtype=np.float64)


def moved(record: Record, region: str, name: str = "displacement") -> tuple[Array, Array] | None:
    """Output times and mean of a field over a region, by volume, shape ``(k, 3)``.

    None where a run wrote no fields.
    """
    weight = volumes(record, region)
    if weight is None:
        return None
    rows = [(t, weight @ values / weight.sum()) for t, values in record.series(name)]
    t, means = zip(*rows, strict=True)
    return np.array(t), np.array(means)


def velocity_at_end(record: Record, region: str) -> Array | None:
    """Mean velocity of a region at the last output, shape ``(3,)`` [m/s]; None without fields."""
    weight = volumes(record, region)
    if weight is None:
        return None
    return np.asarray(weight @ record.velocity(until(record)) / weight.sum())
