# SPDX-License-Identifier: LGPL-3.0-or-later
"""Profiles from points: worn, measured or drawn elsewhere, given as an array or a text file."""

from itertools import pairwise
from pathlib import Path
from typing import Literal

import numpy as np

from meshes.arrays import Array
from meshes.profiles.profiles import CHORD, MM, Profile

Kind = Literal["wheel", "rail"]

KINK = np.radians(30.0)  # chords that turn by more than this meet in a corner
WIDEST = 2.0  # a profile that spans more than this is in mm
STANDS_OUT = 0.3  # a flange rises above the tread by this share of the width of the profile
TALLEST = 0.020  # of the origin above or below the rail top [m]; farther off it is taken as foreign


def from_csv(
    path: str | Path,
    unit: Literal["auto", "mm", "m"] = "auto",
    *,
    kind: Kind | None = None,
    smoothing: float = 0.0,
) -> Profile:
    """Return a user's profile: a text file of lateral and outward coordinate, one point a line.

    Lines that are not two numbers (a header, comments) may only open the file.

    Args:
        path: File to read; separators comma, semicolon or blank.
        unit: Unit of the coordinates in the file; ``auto`` takes a profile wider than 2 for mm.
        kind: Whether the points shall be turned to the axes of a wheel or rail, see ``oriented``.
        smoothing: Root mean square distance that the curve may keep from the points [m].

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: if it holds fewer than 4 points, a repeated point, or a curve that meets itself.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"profile {path}: no such file")
    if unit not in ("auto", "mm", "m"):
        raise ValueError(f"unit: expected 'auto', 'mm' or 'm', got {unit!r}")
    points = _rows(path)
    if len(points) < 4 or not np.isfinite(points).all():
        raise ValueError(f"profile {path}: expected 4 or more finite points, got {len(points)}")
    in_mm = unit == "mm" or (unit == "auto" and float(np.ptp(points, axis=0).max()) > WIDEST)
    points = points * (MM if in_mm else 1.0)
    if kind is not None:
        points = oriented(points, kind)
    profile = from_points(points, name=str(path), smoothing=smoothing)
    width = float(np.ptp(points[:, 0]))
    if not 0.02 <= width <= 0.4:
        raise ValueError(
            f"profile {path}: expected a width of 0.02 to 0.4 m, got {width:.4g} m, taken in "
            f"{'mm' if in_mm else 'm'}"
        )
    return profile


def oriented(points: Array, kind: Kind) -> Array:
    """Return points turned to the axes of a profile: first to the field side, second outward.

    The order is turned so that points run to the field side. A rail whose ends lie above its middle
    and a wheel whose flange points inward are turned over, a wheel whose flange lies on the field
    side is mirrored. Both keep their lateral origin (rail axis, tape circle). Outward, a rail keeps
    its origin if that is within 20 mm of its top, a wheel if within 20 mm of the tread at lateral
    0; else they are moved there.

    Args:
        points: The points, shape ``(n, 2)`` [m].
        kind: What they are.

    Raises:
        ValueError: if a wheel's points leave out its tape circle, lateral 0.
    """
    y, z = points.T
    y, z = (y[::-1], z[::-1]) if y[-1] < y[0] else (y, z)
    if kind == "rail":
        if np.interp(y.mean(), y, z) < (z[0] + z[-1]) / 2:
            z = -z
        return np.column_stack([y, z - z.max() if abs(z.max()) > TALLEST else z])
    return _wheel_axes(y, z)


def _wheel_axes(y: Array, z: Array) -> Array:
    high, low, tread = z.max() - np.median(z), np.median(z) - z.min(), np.ptp(y)
    if max(high, low) > min(STANDS_OUT * tread, 0.015):  # there is a flange
        z = z if high >= low else -z
        if y[np.argmax(z)] > y.mean():
            y, z = -y[::-1], z[::-1]
    if not y.min() < 0 < y.max():
        raise ValueError(
            f"expected points on both sides of the tape circle, lateral 0, got {y.min():.4f} to "
            f"{y.max():.4f} m"
        )
    beyond = np.flatnonzero(y > 0)[0] - 1  # the flange may overhang, the tread does not
    at = float(np.interp(0.0, y[beyond : beyond + 2], z[beyond : beyond + 2]))
    return np.column_stack([y, z - at if abs(at) > TALLEST else z])


def from_points(points: Array, *, name: str = "points", smoothing: float = 0.0) -> Profile:
    """Return the profile through ``points``, shape ``(n, 2)`` [m].

    Between corners, at which the chords turn by more than 30 degrees, it is a cubic spline over
    chord length; with ``smoothing`` a cubic smoothing spline that keeps within that root mean
    square distance (P. Dierckx, Curve and Surface Fitting with Splines, 1993).

    Args:
        points: The points in the order of the curve, shape ``(n, 2)`` [m].
        name: What messages call it.
        smoothing: Root mean square distance from the points [m].

    Raises:
        ValueError: if points repeat, the curve turns back on itself or meets itself.
    """
    step = np.diff(points, axis=0)
    chord = np.hypot(*step.T)
    if (chord <= 1e-9).any():
        raise ValueError(
            f"profile {name}: point {int(np.argmin(chord)) + 2} repeats the one before"
        )
    cosine = np.sum(step[1:] * step[:-1], axis=1) / (chord[1:] * chord[:-1])
    if (cosine <= -0.5).any():
        raise ValueError(
            f"profile {name}: arc length is not monotone, the points run backwards at point "
            f"{int(np.argmin(cosine)) + 2} of {len(points)}"
        )
    if _meets_itself(points):
        raise ValueError(f"profile {name}: the curve intersects itself")
    corners = np.flatnonzero(cosine < np.cos(KINK)) + 1
    bounds = [0, *corners, len(points) - 1]
    pieces = [_smooth(points[a : b + 1], smoothing) for a, b in pairwise(bounds)]
    lengths = [piece[0] for piece in pieces]
    ends = np.concatenate([[0.0], np.cumsum([s[-1] for s in lengths])])
    first = [0] + [1] * (len(pieces) - 1)  # the stored point at a corner is the first one's
    s = np.concatenate([p[0][k:] + e for p, k, e in zip(pieces, first, ends, strict=False)])
    curve, angles, curvatures = (
        np.concatenate([p[i][k:] for p, k in zip(pieces, first, strict=True)]) for i in (1, 2, 3)
    )
    return Profile(s, curve, np.unwrap(angles), curvatures, ends)


def _smooth(points: Array, smoothing: float) -> tuple[Array, Array, Array, Array]:
    """Return arc length, points, tangent angles and curvatures of a spline between corners."""
    from scipy.interpolate import CubicSpline, make_splprep

    t = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
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


def _rows(path: Path) -> Array:
    rows: list[list[float]] = []
    for line in path.read_text(encoding="utf-8").splitlines():
        words = line.replace(",", " ").replace(";", " ").split()
        try:
            rows.append([float(word) for word in words[:2]])
        except ValueError:
            if rows:
                raise ValueError(f"profile {path}: expected two numbers, got {line!r}") from None
        else:
            if len(words) < 2:
                rows.pop()
    return np.array(rows, dtype=np.float64).reshape(-1, 2)


def _meets_itself(points: Array) -> bool:
    """Tell whether any two chords that are not neighbours cross (all pairs, in blocks)."""
    a, b = points[:-1], points[1:]
    n = len(a)
    for i in range(n - 2):
        p, q, c, d = a[i], b[i], a[i + 2 :], b[i + 2 :]
        side = _cross(q - p, c - p) * _cross(q - p, d - p)
        other = _cross(d - c, p - c) * _cross(d - c, q - c)
        if ((side < 0) & (other < 0)).any():
            return True
    return False


def _cross(u: Array, v: Array) -> Array:
    return np.asarray(u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0])
