# SPDX-License-Identifier: LGPL-3.0-or-later
"""Profiles from points: worn, measured or drawn elsewhere, given as an array or a file.

A reading keeps what was understood of a file, how well its points resolve the curve, and what of it
a user should doubt.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from meshes.arrays import Array
from meshes.profiles.orientation import Axes, Oriented, Unit, oriented
from meshes.profiles.point_files import HUGE, Kind, PointFile, read_points
from meshes.profiles.profiles import CHORD, Profile

KINK = np.radians(30.0)  # chords that turn by more than this meet in a corner
SPAN = (
    20.0  # chords between which corners of noisy points are sought, in rms distances of smoothing
)
LONGEST_SPAN = 1e-3  # they are not longer than this, so that bends of 2 mm stay bends [m]
MOST_CORNERS = 100
FACE_WIDTH, FACE_HEIGHT = 3e-4, 3e-3  # points so near in line, over so much, are a rim face [m]
CLOSE = 1e-6  # points nearer than this to the one before are left out [m]
LONGEST = 1.0  # of a profile [m]
FEW = 40  # points
COARSE = np.radians(10.0)  # chords that turn by more than this leave the curve open
STEEPEST = 1.2  # a quarter of the turn of an arc over a chord is not counted beyond this [rad]
OPEN = 2e-5  # distance to which it may be left open without a word [m]
UNEVEN = 10.0  # curvature that scatter makes without a word [1/m]
WIDE = 0.08  # what is wider is a wheel, if nobody says what it is [m]
LEAF = 48  # chords that are compared each with each


@dataclass(frozen=True)
class Reading:
    """A profile file as it was understood.

    Attributes:
        path: The file.
        kind: What it was taken for.
        file: Its points as they stand there.
        oriented: The points used, in the axes of the profile, and how they came there.
        profile: The curve through or near them.
        smoothing: Root mean square distance that it was allowed to keep from them [m].
        left_out: Number of points left out because they repeat the one before.
        rim_face: Number of points left out because they lie on the face of a wheel's rim.
        residuals: Distance of each point from the curve, shape ``(n,)`` [m].
        scatter: Standard deviation of the points across the curve, from their differences [m].
        turns: Angle between the chords at each inner point, shape ``(n - 2,)`` [rad].
        gaps: How far from each chord the curve may be by these angles, shape ``(n - 1,)`` [m].
    """

    path: Path
    kind: Kind
    file: PointFile
    oriented: Oriented
    profile: Profile
    smoothing: float
    left_out: int
    rim_face: int
    residuals: Array
    scatter: float
    turns: Array
    gaps: Array

    @property
    def points(self) -> Array:
        """The points used, shape ``(n, 2)`` [m]."""
        return self.oriented.points

    @property
    def corners(self) -> Array:
        """Arc length of the corners [m]."""
        return self.profile.joints[1:-1]

    def in_words(self) -> str:
        """Return what was understood as a line."""
        at, read = self.oriented, self.file
        side = "flange" if self.kind == "wheel" else "gauge side"
        text = (
            f"{self.kind} of {len(self.points)} points, {read.format}, {read.encoding}, "
            f"in {at.unit}, {side} {at.inner}, outward {at.outward}, origin at the "
            f"{at.origin.replace('-', ' ')}; {len(self.corners)} corners, chords turn by up to "
            f"{np.degrees(self.turns.max()):.1f}°, largest residual "
            f"{self.residuals.max() * 1e6:.1f} µm"
        )
        return "; ".join((text, *read.notes))

    def doubts(self) -> Iterator[str]:
        """Yield what a user should know before trusting the curve, a line each."""
        if self.left_out:
            yield f"{self.left_out} points that repeat the one before are left out"
        if self.rim_face:
            yield f"{self.rim_face} points of the rim face are left out, it is no running surface"
        yield from self.oriented.assumed
        worst = int(np.argmax(self.gaps))
        if self.gaps[worst] > OPEN:
            ends = self.points[worst : worst + 2]
            turns = np.degrees(self.turns[max(worst - 1, 0) : worst + 1])
            yield (
                f"too coarse at lateral {ends[:, 0].mean() * 1e3:.1f} mm: a chord of "
                f"{np.hypot(*(ends[1] - ends[0])) * 1e3:.2g} mm meets the next at "
                f"{' and '.join(f'{turn:.0f}°' for turn in turns)}, which leaves the curve open by "
                f"up to {self.gaps[worst] * 1e3:.2g} mm"
            )
        spacing = float(np.median(np.hypot(*np.diff(self.points, axis=0).T)))
        uneven = self.scatter * np.sqrt(6.0) / spacing**2
        if not self.smoothing and uneven > UNEVEN:
            yield (
                f"the points scatter by {self.scatter * 1e6:.2g} µm at {spacing * 1e3:.2g} mm, "
                f"which makes curvatures of {uneven:.0f} 1/m; profile_smoothing = "
                f"{float(f'{self.scatter * np.sqrt(2.0):.1e}')} would take them out"
            )


def read(
    path: str | Path, kind: Kind | None = None, axes: Axes | None = None, smoothing: float = 0.0
) -> Reading:
    """Return a profile file as it is understood.

    Args:
        path: A table of text, a MiniProf or a SIMPACK file.
        kind: What it holds; by default what its header or ending says, else by flange and width.
        axes: How its coordinates are meant; by default all of it is found.
        smoothing: Root mean square distance that the curve may keep from the points [m].

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: if it cannot be read, holds something else, fewer than 4 points, or a curve that
            runs back or meets itself.
    """
    path, axes = Path(path), axes or Axes()
    try:
        return _read(path, kind, axes, smoothing)
    except FileNotFoundError as error:
        raise FileNotFoundError(f"profile {path}: {error}") from None
    except ValueError as error:
        raise ValueError(f"profile {path}: {error}") from None


def from_csv(
    path: str | Path, unit: Unit = "auto", *, kind: Kind | None = None, smoothing: float = 0.0
) -> Profile:
    """Return the profile of a file, see ``read``.

    Args:
        path: The file.
        unit: Unit of its coordinates.
        kind: What it holds.
        smoothing: Root mean square distance that the curve may keep from the points [m].
    """
    return read(path, kind, Axes(unit=unit), smoothing).profile


def _read(path: Path, kind: Kind | None, axes: Axes, smoothing: float) -> Reading:
    file = read_points(path, axes.part)
    points = file.points
    if len(points) < 4:
        raise ValueError(f"expected 4 or more points, got {len(points)}")
    if not (np.abs(points) < HUGE).all():
        raise ValueError(
            f"expected finite points, less than {HUGE:.0e}, got {np.abs(points).max()}"
        )
    if kind and file.kind and kind != file.kind:
        raise ValueError(f"expected a {kind}, got a file that is said to hold a {file.kind}")
    told = kind or file.kind
    kind = told or _kind_of(file, axes)
    at = oriented(file, kind, axes)
    kept = _apart(at.points)
    assumed = at.assumed if told else (f"a {kind}, by its width", *at.assumed)
    at = replace(at, points=at.points[kept], assumed=assumed)
    face = _rim_face(at.points) if kind == "wheel" else 0
    at = replace(at, points=at.points[: len(at.points) - face])
    if len(at.points) < 4:
        raise ValueError(f"expected 4 or more points that differ, got {len(at.points)}")
    if np.hypot(*(at.points[-1] - at.points[0])) < 0.1 * np.ptp(at.points, axis=0).max():
        raise ValueError("expected a running surface, got a closed outline: its ends meet")
    profile = _curve(at.points, smoothing)
    turns, gaps = _resolution(at.points, smoothing)
    return Reading(
        path=path,
        kind=kind,
        file=file,
        oriented=at,
        profile=profile,
        smoothing=smoothing,
        left_out=len(points) - len(kept),
        rim_face=face,
        residuals=_residuals(at.points, profile),
        scatter=_scatter(at.points),
        turns=turns,
        gaps=gaps,
    )


def _kind_of(file: PointFile, axes: Axes) -> Kind:
    """Return what points are that nobody has said: a wheel if they are as wide as one."""
    try:
        width = np.ptp(oriented(file, "rail", Axes(unit=axes.unit)).points[:, 0])
    except ValueError:
        return "rail"
    return "wheel" if width > WIDE else "rail"


def _apart(points: Array) -> list[int]:
    """Return the numbers of the points that do not repeat the one kept before."""
    if (np.hypot(*np.diff(points, axis=0).T) > CLOSE).all():
        return list(range(len(points)))
    kept = [0]
    for k in range(1, len(points)):
        if np.hypot(*(points[k] - points[kept[-1]])) > CLOSE:
            kept.append(k)
    return kept


def _rim_face(points: Array) -> int:
    """Return how many points at the end of a wheel run down the face of its rim."""
    y, z = points.T
    edge = int(np.argmax(y >= y.max() - FACE_WIDTH))
    return len(y) - 1 - edge if z[edge] - z[-1] > FACE_HEIGHT else 0


def from_points(points: Array, *, name: str = "points", smoothing: float = 0.0) -> Profile:
    """Return the profile through ``points``, shape ``(n, 2)`` [m].

    Between corners, at which the chords turn by more than 30 degrees, it is a cubic spline over
    chord length; with ``smoothing`` a cubic smoothing spline that keeps within that root mean
    square distance (P. Dierckx, Curve and Surface Fitting with Splines, 1993). Corners of points
    that are smoothed are sought with chords of 20 times that distance, so that noise makes none.

    Args:
        points: The points in the order of the curve, shape ``(n, 2)`` [m].
        name: What messages call it.
        smoothing: Root mean square distance from the points [m].

    Raises:
        ValueError: if points repeat, the curve turns back on itself or meets itself.
    """
    try:
        return _curve(points, smoothing)
    except ValueError as error:
        raise ValueError(f"profile {name}: {error}") from None


def _curve(points: Array, smoothing: float) -> Profile:
    span = min(SPAN * smoothing, LONGEST_SPAN)
    even = _averaged(points, span)
    step = np.diff(even, axis=0)
    chord = np.hypot(*step.T)
    if (chord <= 1e-9).any():
        raise ValueError(f"point {int(np.argmin(chord)) + 2} repeats the one before")
    if chord.sum() > LONGEST:
        raise ValueError(f"expected a curve of at most {LONGEST} m, got {chord.sum():.3g} m")
    cosine = np.sum(step[1:] * step[:-1], axis=1) / (chord[1:] * chord[:-1])
    if (cosine <= -0.5).any():
        k = int(np.argmin(cosine)) + 1
        raise ValueError(
            f"arc length is not monotone, the points run backwards at point {k + 1} of "
            f"{len(points)}, lateral {points[k, 0] * 1e3:.2f} mm; expected points in the order of "
            f"the curve; if they scatter, a profile_smoothing of more than {smoothing} m"
        )
    if _meets_itself(even):
        raise ValueError("the curve intersects itself")
    bounds = [0, *_corners(points, even, span), len(points) - 1]
    pieces = [_smooth(points[a : b + 1], smoothing, span) for a, b in pairwise(bounds)]
    lengths = [piece[0] for piece in pieces]
    ends = np.concatenate([[0.0], np.cumsum([s[-1] for s in lengths])])
    first = [0] + [1] * (len(pieces) - 1)  # the stored point at a corner is the first one's
    s = np.concatenate([p[0][k:] + e for p, k, e in zip(pieces, first, ends, strict=False)])
    curve, angles, curvatures = (
        np.concatenate([p[i][k:] for p, k in zip(pieces, first, strict=True)]) for i in (1, 2, 3)
    )
    return Profile(s, curve, np.unwrap(angles), curvatures, ends)


def _averaged(points: Array, span: float) -> Array:
    """Return points averaged over a span of the curve, those near the ends by a line through it."""
    from scipy.signal import savgol_filter

    spacing = float(np.median(np.hypot(*np.diff(points, axis=0).T)))
    reach = int(min(span / (2 * spacing), (len(points) - 1) // 2)) if spacing > 0 else 0
    if reach == 0:
        return points
    return np.asarray(savgol_filter(points, 2 * reach + 1, 1, axis=0, mode="interp"))


def _corners(points: Array, even: Array, span: float) -> list[int]:
    """Return the points at which the curve turns sharply, seen over a span or from chord to chord.

    Of points within a span of each other, one at most is a corner: the one that turns most.

    Raises:
        ValueError: if there are so many that they must be noise.
    """
    turn = _turning(points, even, span)
    t = _lengths(even)
    turn[(t[1:-1] < span) | (t[1:-1] > t[-1] - span)] = 0.0  # there is no span on both sides
    found: list[int] = []
    for k in np.argsort(-turn, kind="stable"):
        if turn[k] <= KINK:
            break
        if not span or (np.abs(t[k + 1] - t[found]) > span).all():
            found.append(int(k) + 1)
        if len(found) > MOST_CORNERS:
            raise ValueError(
                f"the points make more than {MOST_CORNERS} corners of {np.degrees(KINK):.0f}° and "
                "more; if they scatter, tell profile_smoothing, or more of it"
            )
    return sorted(found)


def _turning(points: Array, even: Array, span: float) -> Array:
    """Return the angle between what lies before and behind each inner point [rad]."""
    t = _lengths(even)

    def along(at: Array) -> Array:
        return np.column_stack([np.interp(at, t, column) for column in even.T])

    inner = slice(1, -1)
    before = points[inner] - along(np.minimum(t[:-2], np.maximum(t[inner] - span, t[0])))
    behind = along(np.maximum(t[2:], np.minimum(t[inner] + span, t[-1]))) - points[inner]
    return np.abs(np.arctan2(_cross(before, behind), np.sum(before * behind, axis=1)))


def _lengths(points: Array) -> Array:
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])


def _smooth(points: Array, smoothing: float, span: float) -> tuple[Array, Array, Array, Array]:
    """Return arc length, points, tangent angles and curvatures of a spline between corners."""
    from scipy.interpolate import CubicSpline, make_splprep

    t = _lengths(_averaged(points, span))
    fine = np.unique(np.concatenate([t, np.linspace(0, t[-1], int(t[-1] / CHORD) + 2)]))
    if smoothing and len(points) > 5:
        spline, _ = make_splprep(points.T, u=t, s=len(points) * smoothing**2)
        curve, first, second = (np.asarray(spline(fine, k)).T for k in (0, 1, 2))
    else:
        through = CubicSpline(t, points)
        curve, first, second = (np.asarray(through(fine, k)) for k in (0, 1, 2))
    speed = np.hypot(*first.T)
    s = np.concatenate([[0.0], np.cumsum(np.diff(fine) * (speed[1:] + speed[:-1]) / 2)])
    curvature = (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) / speed**3
    return s, curve, np.unwrap(np.arctan2(first[:, 1], first[:, 0])), curvature


def _residuals(points: Array, profile: Profile) -> Array:
    """Return the distance of points from the curve, along its normal where it has one [m]."""
    from scipy.spatial import cKDTree

    far, near = cKDTree(profile.points).query(points)
    off = np.abs(np.sum((points - profile.points[near]) * profile.normal(profile.s[near]), axis=1))
    return np.asarray(np.where(far < 2 * CHORD, off, far))


def _scatter(points: Array) -> float:
    """Return the standard deviation of points across the curve.

    It is the median distance of each point from the cubic through the two before and the two
    behind, by even spacing, over what that is for independent errors of unit size. A few points
    tell bends from scatter no longer: then it is 0.
    """
    if len(points) < FEW:
        return 0.0
    weights = np.array([-1.0, 4.0, 0.0, 4.0, -1.0]) / 6
    guess = np.column_stack([np.convolve(column, weights, "valid") for column in points.T])
    along = points[3:-1] - points[1:-3]
    across = _cross(along / np.hypot(*along.T)[:, None], points[2:-2] - guess)
    return float(np.median(np.abs(across)) / 0.6745 / np.sqrt(1 + np.sum(weights**2)))


def _resolution(points: Array, smoothing: float) -> tuple[Array, Array]:
    """Return the angle between chords at inner points, and how far from each chord a curve may be.

    That is the height of an arc that turns by the angles at both ends of the chord [m], 0 where the
    angles are small. A single large angle, whose neighbours are less than a third of it, is an edge
    that the points show, not a coarse bend.
    """
    span = min(SPAN * smoothing, LONGEST_SPAN)
    even = _averaged(points, span)
    turns = _turning(even, even, span)
    beside = np.maximum(np.append(turns[1:], 0.0), np.append(0.0, turns[:-1]))
    edge = (turns > KINK) & (beside < turns / 3)
    at = np.concatenate([[0.0], np.where(edge, 0.0, turns), [0.0]])
    chord = np.hypot(*np.diff(even, axis=0).T)
    height = chord / 2 * np.tan(np.minimum((at[1:] + at[:-1]) / 4, STEEPEST))
    return turns, np.where(np.maximum(at[1:], at[:-1]) > COARSE, height, 0.0)


def _meets_itself(points: Array) -> bool:
    """Tell whether any two chords that are not neighbours cross.

    Stretches of chords whose boxes are apart cannot; others are halved until they are short.
    """
    n = len(points) - 1
    stack = [(0, n, 0, n)]
    while stack:
        a, b, c, d = stack.pop()
        if (a, b) != (c, d) and _boxes_apart(points[a : b + 1], points[c : d + 1]):
            continue
        if b - a <= LEAF and d - c <= LEAF:
            if _cross_within(points, (a, b), (c, d)):
                return True
        elif (a, b) == (c, d):
            m = (a + b) // 2
            stack += [(a, m, a, m), (a, m, m, b), (m, b, m, b)]
        elif b - a >= d - c:
            stack += [(a, (a + b) // 2, c, d), ((a + b) // 2, b, c, d)]
        else:
            stack += [(a, b, c, (c + d) // 2), (a, b, (c + d) // 2, d)]
    return False


def _boxes_apart(first: Array, second: Array) -> bool:
    return bool(
        (first.min(axis=0) > second.max(axis=0)).any()
        or (second.min(axis=0) > first.max(axis=0)).any()
    )


def _cross_within(points: Array, first: tuple[int, int], second: tuple[int, int]) -> bool:
    """Tell whether a chord of one stretch crosses a later one of another, neighbours left out."""
    i, j = np.arange(*first), np.arange(*second)
    p, q = points[i][:, None], points[i + 1][:, None]
    c, d = points[j][None], points[j + 1][None]
    side = _cross(q - p, c - p) * _cross(q - p, d - p)
    other = _cross(d - c, p - c) * _cross(d - c, q - c)
    later = j[None] > i[:, None] + 1
    return bool(((side < 0) & (other < 0) & later).any())


def _cross(u: Array, v: Array) -> Array:
    return np.asarray(u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0])
