# SPDX-License-Identifier: LGPL-3.0-or-later
"""Columns of nodes along a running surface, found from its slope and curvature."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from meshes.generate.sweep import columns_for
from meshes.profiles.profiles import Array, Profile

ROUND = 1 / 0.050  # a surface more curved than this is a bend [1/m]
WINDOW = 2e-3  # over which slopes are compared; finer features are roughness [m]
TURN = np.radians(20.0)  # least turn of a bend
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


def bends(profile: Profile) -> list[tuple[float, float]]:
    """Return the stretches in which a profile is round: radius below 50 mm, turn above 20 degrees.

    Ends that lie near a joint of the drawing are moved there; a bend shorter than two windows is a
    corner, returned with equal ends.
    """
    s = np.arange(WINDOW / 2, profile.length - WINDOW / 2, 1e-4)
    rate = (profile.angle(s + WINDOW / 2) - profile.angle(s - WINDOW / 2)) / WINDOW
    sign = np.where(np.abs(rate) > ROUND, np.sign(rate), 0.0)
    change = np.flatnonzero(np.diff(sign)) + 1
    found = []
    for run in np.split(np.arange(len(s)), change):
        turn = abs(float(rate[run].sum())) * 1e-4
        if sign[run[0]] and turn > TURN:
            a, b = float(s[run[0]]), float(s[run[-1]])
            if b - a < 2 * WINDOW:
                found.append(((a + b) / 2,) * 2)
            else:
                found.append((_snapped(profile, a), _snapped(profile, b)))
    return found


def flange_of(profile: Profile) -> tuple[float, float] | None:
    """Return the tip of the flange of a wheel and where its flank begins to be steepest [m].

    None if the wheel has no flange: nothing beyond 10 mm above the tape circle and 45 degrees.
    """
    s = np.arange(0.0, profile.length, 1e-4)
    y, r = profile.at(s).T
    steep = -_slope(profile, s)
    tip = int(np.argmax(r))
    tread = float(r[np.argmin(np.abs(y))])
    if r[tip] - tread < 0.010 or y[tip] > 0 or steep[tip:].max() < np.radians(45.0):
        return None
    flank = tip + int(np.argmax(steep[tip:] > 0.985 * steep[tip:].max()))
    return float(s[tip]), float(s[flank])


def gauge_corner_of(profile: Profile) -> tuple[float, float] | None:
    """Return the bend between gauge face and rail top, if the rail has one [m]."""
    top = float(profile.s[np.argmax(profile.points[:, 1])])
    for a, b in bends(profile):
        turn = float(profile.angle(a) - profile.angle(b))
        if b > a and b < top and turn > np.radians(40.0):
            return a, b
    return None


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


def _slope(profile: Profile, s: Array) -> npt.NDArray[np.float64]:
    """Return the direction of the chord over a window about ``s``."""
    ahead = profile.at(np.minimum(s + WINDOW / 2, profile.length))
    behind = profile.at(np.maximum(s - WINDOW / 2, 0.0))
    return np.asarray(np.arctan2(*(ahead - behind).T[::-1]))


def _snapped(profile: Profile, s: float) -> float:
    joint = float(profile.joints[np.argmin(np.abs(profile.joints - s))])
    return joint if abs(joint - s) < WINDOW else s
