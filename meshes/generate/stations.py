# SPDX-License-Identifier: LGPL-3.0-or-later
"""Columns of nodes along a running surface, placed by its bends, flange and gauge corner."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from meshes.arrays import Array
from meshes.generate.sweep import columns_for
from meshes.profiles.features import ROUND, TURN, bends, flange_of, gauge_corner_of
from meshes.profiles.profiles import Profile

COARSEST = 0.014  # longest column where the surface is not refined [m]
SHARPEST = np.radians(25.0)  # largest turn of a column there
APART = 5e-3  # breaks nearer than this are one [m]
REACH = 0.012  # of the fine surface on either side of a touching point [m]
ALONE = 0.020  # of the fine surface about the middle if nothing else is known [m]
TREAD = 0.008  # the fine tread ends this far on the field side of the tape circle
CROWN = 0.010  # the fine rail top ends this far on the field side of the rail axis
FLANK = 3e-3  # of the flange above its steepest part that is fine


@dataclass(frozen=True)
class Stations:
    """Columns of nodes of a band.

    Attributes:
        s: Arc length of the columns, shape ``(m,)`` [m].
        first, last: Columns between which the surface is to be refined.
    """

    s: Array
    first: int
    last: int


def stations(
    profile: Profile,
    start: float,
    end: float,
    fine: tuple[float, float],
    size: float,
    levels: int,
    *,
    even: bool = False,
) -> Stations:
    """Return columns from ``start`` to ``end`` whose 3:1 refinement makes edges of ``size``.

    Bends get at least eight edges where the surface is fine and a column for every 25 degrees
    elsewhere. Two columns or more stay on either side of the fine part.

    Args:
        profile: The running surface.
        start: Arc length of the first column [m].
        end: Arc length of the last column [m].
        fine: Arc length between which the surface is fine [m].
        size: Wanted length of edges there [m].
        levels: Number of 3:1 refinements.
        even: Make the number of columns even.

    Raises:
        ValueError: if the fine part leaves no room for coarser columns beside it.
    """
    room = 0.1 * (end - start)
    low, high = max(fine[0], start + room / 2), min(fine[1], end - room / 2)
    if high - low < 2 * size:
        raise ValueError(
            f"profile: expected a contact away from its ends, got a fine surface from "
            f"{fine[0]:.4f} to {fine[1]:.4f} m of arc length {start:.4f} to {end:.4f} m"
        )
    marks = [s for bend in bends(profile) for s in bend]
    parts = []
    for a, b in ((start, low), (low, high), (high, end)):
        inside = [s for s in marks if a + APART < s < b - APART]
        ends = np.array([a, *(s for k, s in enumerate(inside) if not k or s > inside[k - 1]), b])
        parts.append(list(pairwise(ends)))
    counts = [
        [_coarse(profile, *piece) for piece in parts[0]],
        [_fine(profile, *piece, size, levels) for piece in parts[1]],
        [_coarse(profile, *piece) for piece in parts[2]],
    ]
    for k in (0, 2):
        while sum(counts[k]) < 2 or (k == 2 and even and sum(map(sum, counts)) % 2):
            longest = np.argmax(
                [(b - a) / n for (a, b), n in zip(parts[k], counts[k], strict=True)]
            )
            counts[k][longest] += 1
    pieces = [
        (*p, n) for part, c in zip(parts, counts, strict=True) for p, n in zip(part, c, strict=True)
    ]
    s = np.concatenate([np.linspace(a, b, n + 1)[:-1] for a, b, n in pieces] + [[end]])
    return Stations(s, sum(counts[0]), sum(counts[0]) + sum(counts[1]))


def fine_tread(profile: Profile, touch: float | None) -> tuple[float, float]:
    """Return the arc length between which a tread shall be fine: flank to tread, and the touch."""
    flange = flange_of(profile)
    middle = float(profile.s[np.argmin(np.abs(profile.points[:, 0]))])
    if flange is None:
        at = middle if touch is None else touch
        return at - ALONE, at + ALONE
    after = profile.s > flange[1]
    inner = float(np.interp(TREAD, profile.points[after, 0], profile.s[after]))
    return _with_touch((flange[1] - FLANK, inner), touch)


def fine_railhead(profile: Profile, touch: float | None) -> tuple[float, float]:
    """Return the arc length between which a head shall be fine: corner to top, and the touch."""
    corner = gauge_corner_of(profile)
    top = float(profile.s[np.argmax(profile.points[:, 1])])
    if corner is None:
        at = top if touch is None else touch
        return at - ALONE, at + ALONE
    after = profile.s > corner[1]
    field = float(np.interp(CROWN, profile.points[after, 0], profile.s[after]))
    return _with_touch((corner[0], field), touch)


def _with_touch(fine: tuple[float, float], touch: float | None) -> tuple[float, float]:
    if touch is None or fine[0] + REACH < touch < fine[1] - REACH / 2:
        return fine
    return min(fine[0], touch - REACH), max(fine[1], touch + REACH)


def _coarse(profile: Profile, a: float, b: float) -> int:
    turn = abs(float(profile.angle(b - 1e-4) - profile.angle(a + 1e-4)))  # corners left out
    return max(1, int(np.ceil((b - a) / COARSEST - 1e-9)), int(np.ceil(turn / SHARPEST - 1e-9)))


def _fine(profile: Profile, a: float, b: float, size: float, levels: int) -> int:
    turn = abs(float(profile.angle(b) - profile.angle(a)))
    coarse = min(COARSEST, size * 3**levels)
    if turn > TURN and turn > ROUND * (b - a):
        least = int(np.ceil(turn / SHARPEST / 1.2))
        return columns_for(b - a, size, levels, curved=True, least=least)
    if b - a < 1.5 * coarse:
        return columns_for(b - a, size, levels)
    return round((b - a) / coarse)
