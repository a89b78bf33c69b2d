# SPDX-License-Identifier: LGPL-3.0-or-later
"""Features of a profile, found from its slope and curvature: bends, flange, gauge corner."""

import numpy as np

from meshes.arrays import Array
from meshes.profiles.profiles import Profile

ROUND = 1 / 0.050  # a surface more curved than this is a bend [1/m]
WINDOW = 2e-3  # over which slopes are compared; finer features are roughness [m]
TURN = np.radians(20.0)  # least turn of a bend


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
    if r[tip] - tread < 0.010 or y[tip] > 0:
        return None
    before = steep[tip:][y[tip:] < 0]  # beyond the tape circle a rim face may be steeper
    if before.max(initial=0.0) < np.radians(45.0):
        return None
    flank = tip + int(np.argmax(before > 0.985 * before.max()))
    return float(s[tip]), float(s[flank])


def gauge_corner_of(profile: Profile) -> tuple[float, float] | None:
    """Return the bend between gauge face and rail top, if the rail has one [m]."""
    top = float(profile.s[np.argmax(profile.points[:, 1])])
    for a, b in bends(profile):
        turn = float(profile.angle(a) - profile.angle(b))
        if b > a and b < top and turn > np.radians(40.0):
            return a, b
    return None


def _slope(profile: Profile, s: Array) -> Array:
    """Return the direction of the chord over a window about ``s``."""
    ahead = profile.at(np.minimum(s + WINDOW / 2, profile.length))
    behind = profile.at(np.maximum(s - WINDOW / 2, 0.0))
    return np.asarray(np.arctan2(*(ahead - behind).T[::-1]))


def _snapped(profile: Profile, s: float) -> float:
    joint = float(profile.joints[np.argmin(np.abs(profile.joints - s))])
    return joint if abs(joint - s) < WINDOW else s
