# SPDX-License-Identifier: LGPL-3.0-or-later
"""Orientation of measured points: outward side, flange or gauge side, lateral and vertical origin.

What shows the outward side of a wheel is its flange, the one end or crest that stands out and is
level there, and else its faces, which run inward from the running surface. A rail is convex. What
the points do not show stays as the file has it, and is told.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from meshes.arrays import Array
from meshes.profiles.point_files import UNITS, Kind, PointFile

Unit = Literal["auto", "m", "cm", "mm", "inch"]
Origin = Literal["auto", "tape-circle", "flange-back", "rail-axis", "gauge-face"]
Inner = Literal["auto", "left", "right"]
Outward = Literal["auto", "up", "down"]

ORIGINS = {"wheel": ("tape-circle", "flange-back"), "rail": ("rail-axis", "gauge-face")}
FLANGE_BACK = 0.070  # from the flange back to the tape circle [m]
GAUGE_DEPTH = 0.014  # the gauge is measured this far below the rail top [m]
WIDTHS = (0.02, 0.4)  # of a running surface [m]
FARTHEST = 10.0  # of a point from the origin [m]
SPACING = 1e-3  # of the chords whose directions are looked at [m]
FLANGE = 0.010  # a flange stands out by more than this over the tread [m]
LEVEL = np.radians(20.0)  # the tread is less steep
CREST = np.radians(45.0)  # the tip of a flange is less steep
STEEP = np.radians(50.0)  # as steep as this are flanks and faces
BESIDE = 15  # chords from the tip of a flange within which it has a flank or a face
FACE = np.radians(80.0)  # as steep as this a face, which no flank is
TALLEST = 0.020  # of the origin above or below the rail top or tread [m]; farther off it is moved
TIP = 0.015  # from the flange back to the tip of the flange [m]
NEAR = 0.028  # the tip may lie so far from where an origin would have it [m]
ALIKE = 2e-4  # a rail whose sides differ by less is symmetric [m]
AT_FACE = 0.003  # a gauge face so near to the lateral origin makes it the origin [m]


@dataclass(frozen=True)
class Axes:
    """How the coordinates of a profile file are meant; ``auto`` is found from the points.

    Attributes:
        unit: Unit of the coordinates.
        origin: What lies at lateral 0.
        inner: Where the flange or the gauge side lies, left at the least lateral coordinate.
        outward: Whether the vertical coordinate rises away from the material or into it.
        part: Which profile of a file that holds several, from 1.
        flange_back: Lateral distance from the flange back to the tape circle [m].
        gauge_depth: How far below the rail top the gauge is measured [m].
    """

    unit: Unit = "auto"
    origin: Origin = "auto"
    inner: Inner = "auto"
    outward: Outward = "auto"
    part: int | None = None
    flange_back: float = FLANGE_BACK
    gauge_depth: float = GAUGE_DEPTH


@dataclass(frozen=True)
class Oriented:
    """Points in the axes of a profile, and how they came there.

    Attributes:
        points: First to the field side, second outward, shape ``(n, 2)`` [m].
        unit: Unit of the file.
        origin: What the file has at lateral 0, one of ``ORIGINS``.
        inner: Where the file has the flange or the gauge side, ``left`` or ``right``.
        outward: Where the file has the outside, ``up`` or ``down``.
        shift: By how much the points were moved, shape ``(2,)`` [m].
        assumed: What of this the points do not show, in words.
    """

    points: Array
    unit: str
    origin: str
    inner: str
    outward: str
    shift: Array
    assumed: tuple[str, ...]


def oriented(file: PointFile, kind: Kind, axes: Axes) -> Oriented:
    """Return the points of a file turned to the axes of a profile.

    Raises:
        ValueError: if the size of the points fits no unit, or their lateral origin cannot be told.
    """
    if axes.origin not in ("auto", *ORIGINS[kind]):
        expected = " or ".join(repr(origin) for origin in ORIGINS[kind])
        raise ValueError(f"origin = {axes.origin!r}: expected {expected} for a {kind}")
    scale, unit = _unit(file, axes)
    y, z = (file.points * scale).T
    y, z = (y[::-1], z[::-1]) if y[-1] < y[0] else (y, z)
    find = _wheel_sides if kind == "wheel" else _rail_sides
    sign, mirror, assumed = find(y, z, file.outward, axes)
    if axes.outward != "auto":
        sign = 1 if axes.outward == "up" else -1
    if axes.inner != "auto":
        mirror = axes.inner == "right"
    z = sign * z
    if mirror:
        y, z = -y[::-1], z[::-1]
    origin, shift = (_wheel_origin if kind == "wheel" else _rail_origin)(y, z, axes)
    return Oriented(
        np.column_stack([y, z]) + shift,
        unit,
        origin,
        inner="right" if mirror else "left",
        outward="up" if sign > 0 else "down",
        shift=shift,
        assumed=tuple(assumed),
    )


def _unit(file: PointFile, axes: Axes) -> tuple[float, str]:
    """Return metres per unit of the file and what it is: as asked, as told, or by the width."""
    width = float(np.ptp(file.points[:, 0]))
    unit = file.unit if axes.unit == "auto" else axes.unit
    if not unit:
        unit = "mm" if width > 2.0 else "m"
    low, high = WIDTHS
    scale = UNITS[unit]
    if not low <= width * scale <= high:
        fits = [name for name, size in UNITS.items() if low <= width * size <= high]
        raise ValueError(
            f"expected a width of {low} to {high} m, got {width * scale:.4g} m, taken in {unit}"
            + (f"; it would fit in {' or '.join(fits)}" if fits else "")
        )
    if np.abs(file.points).max() * scale > FARTHEST:
        raise ValueError(
            f"expected points within {FARTHEST} m of the origin, got "
            f"{np.abs(file.points).max() * scale:.4g} m, taken in {unit}"
        )
    return scale, unit


def _even(y: Array, z: Array) -> tuple[Array, Array, Array]:
    """Return points at even chords of the curve and the direction there [rad]."""
    t = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(y), np.diff(z)))])
    even = np.linspace(0.0, t[-1], int(min(t[-1], 2.0) / SPACING) + 8)
    y, z = np.interp(even, t, y), np.interp(even, t, z)
    ahead = np.minimum(np.arange(len(y)) + 2, len(y) - 1)
    behind = np.maximum(np.arange(len(y)) - 2, 0)
    return y, z, np.arctan2(z[ahead] - z[behind], y[ahead] - y[behind])


def _slope(angle: Array) -> Array:
    """Return how steep a direction is, 0 to 90 degrees [rad]."""
    return np.asarray(np.arctan2(np.abs(np.sin(angle)), np.abs(np.cos(angle))))


def _wheel_sides(y: Array, z: Array, convention: int, axes: Axes) -> tuple[int, bool, list[str]]:
    """Return the sign of outward, whether the flange lies right, and what is assumed."""
    y, z, angle = _even(y, z)
    steep = _slope(angle)
    level = steep < LEVEL
    if not level.any():
        level = steep <= steep.min()
    tread, middle = np.median(z[level]), np.median(y[level])
    tips = {}
    for sign in (1, -1):
        tip = int(np.argmax(sign * z))
        beside = steep[max(tip - BESIDE, 0) : tip + BESIDE + 1]
        if sign * (z[tip] - tread) > FLANGE and steep[tip] < CREST and beside.max() > STEEP:
            tips[sign] = tip
    if tips:
        sign = max(tips, key=lambda s: abs(z[tips[s]] - tread))
        return sign, bool(y[tips[sign]] > middle), []
    ends = {k: float(steep[part].max()) for k, part in ((0, slice(3)), (-1, slice(-3, None)))}
    end = max(ends, key=lambda k: ends[k])
    toward = int(np.sign(z[end] - tread)) or 1
    if ends[end] > FACE and abs(z[end] - tread) > SPACING:
        sign, shows = -toward, True
        other = -1 - end
        flank = ends[other] > STEEP and sign * (z[other] - tread) > FLANGE
        end = other if flank else end
    elif ends[end] > STEEP and abs(z[end] - tread) > FLANGE:
        sign, shows, flank = toward, True, True
    else:
        sign, shows, flank = convention or 1, False, False
    assumed = []
    if not shows and axes.outward == "auto":
        assumed.append(f"outward is {'up' if sign > 0 else 'down'}: no flange or face shows it")
    if not flank and axes.inner == "auto":
        assumed.append("the flange side is left: there is no flange")
    return sign, flank and end == -1, assumed


def _rail_sides(y: Array, z: Array, convention: int, axes: Axes) -> tuple[int, bool, list[str]]:
    """Return the sign of upward, whether the gauge side lies right, and what is assumed.

    Over the chord of its ends a rail head is convex. The gauge side must reach down to where the
    gauge is measured: if only one side does, it is that.
    """
    over = z - np.interp(y, (y[0], y[-1]), (z[0], z[-1]))
    area = float(np.sum((over[1:] + over[:-1]) * np.diff(y)) / 2)
    width = float(np.ptp(y))
    sign = int(np.sign(area)) or 1
    assumed = []
    if abs(area) < 1e-3 * width**2:
        sign = convention or 1
        if axes.outward == "auto":
            assumed.append(f"outward is {'up' if sign > 0 else 'down'}: the points are almost flat")
    z = sign * z
    left, right = (float(z.max() - z[k]) >= axes.gauge_depth for k in (0, -1))
    if left == right and axes.inner == "auto" and not _symmetric(y, z, axes.gauge_depth):
        assumed.append("the gauge side is left: both sides reach down alike")
    return sign, right and not left, assumed


def _symmetric(y: Array, z: Array, depth: float) -> bool:
    """Tell whether a rail head is the same seen from both sides, down to a depth or its ends."""
    top = int(np.argmax(z))
    down = z[top] - min(depth, z[top] - max(z[0], z[-1]))
    left, right = reached(y[top::-1], z[top::-1], down), reached(y[top:], z[top:], down)
    if left is None or right is None or right <= left:
        return False
    middle, u = (left + right) / 2, np.linspace(0.0, 0.45, 50) * (right - left)
    rising = np.concatenate([[True], np.diff(np.maximum.accumulate(y)) > 0])
    both = (np.interp(middle + side * u, y[rising], z[rising]) for side in (1, -1))
    return bool(np.ptp(list(both), axis=0).max() < ALIKE)


def _wheel_origin(y: Array, z: Array, axes: Axes) -> tuple[str, Array]:
    """Return what lies at lateral 0 of a wheel, and the shift to tape circle and tread."""
    origin: str = axes.origin
    even, height, angle = _even(y, z)
    level = _slope(angle) < LEVEL
    tread = np.median(height[level]) if level.any() else np.median(height)
    tip = int(np.argmax(height))
    flange = height[tip] - tread > FLANGE and even[tip] < even.mean()
    if origin == "auto" and flange:
        places = {"flange-back": TIP, "tape-circle": TIP - axes.flange_back}
        far = {name: abs(even[tip] - place) for name, place in places.items()}
        origin = min(far, key=lambda name: far[name])
        if far[origin] > NEAR:
            raise ValueError(
                f"the flange has its tip at lateral {even[tip]:.4f} m; expected about {TIP} m, the "
                f"origin at the flange back, or {TIP - axes.flange_back:.3f} m, at the tape circle;"
                " tell the origin"
            )
    across = -axes.flange_back if origin == "flange-back" else 0.0
    y = y + across
    if not y.min() < 0 < y.max():
        raise ValueError(
            f"expected points on both sides of the tape circle, lateral 0, got {y.min():.4f} to "
            f"{y.max():.4f} m"
        )
    beyond = np.flatnonzero(y <= 0)[-1]  # the flange may overhang, the tread does not
    at = float(np.interp(0.0, y[beyond : beyond + 2], z[beyond : beyond + 2]))
    shift = np.array([across, -at if abs(at) > TALLEST else 0.0])
    return "tape-circle" if origin == "auto" else origin, shift


def _rail_origin(y: Array, z: Array, axes: Axes) -> tuple[str, Array]:
    """Return what lies at lateral 0 of a rail, and the shift to the middle of its head."""
    top = int(np.argmax(z))
    depth = z[top] - axes.gauge_depth
    face, far = reached(y[top::-1], z[top::-1], depth), reached(y[top:], z[top:], depth)
    origin: str = axes.origin
    if origin == "auto":
        origin = "gauge-face" if face is not None and abs(face) < AT_FACE else "rail-axis"
    across = 0.0
    if origin == "gauge-face":
        if face is None or far is None:
            raise ValueError(
                f"lateral 0 lies at the gauge face; expected a head that reaches {axes.gauge_depth}"
                " m down on both sides to find its axis, or the rail's axis at lateral 0"
            )
        across = -(face + far) / 2
    return origin, np.array([across, -z[top] if abs(z[top]) > TALLEST else 0.0])


def reached(y: Array, z: Array, depth: float) -> float | None:
    """Return where points that run down first reach a height; None if they do not."""
    below = np.flatnonzero(z <= depth)
    if not len(below):
        return None
    k = slice(max(below[0] - 1, 0), below[0] + 1)
    return float(np.interp(-depth, -z[k], y[k]))
