# SPDX-License-Identifier: LGPL-3.0-or-later
"""Wheel and rail profiles: plane curves by arc length, with exact normals and curvature.

A profile is drawn in its own axes: first lateral (to the field side), second away from the
material. Running along increasing arc length the material lies on the right. The drawings are in
mm, everything else in m.
"""

import json
from dataclasses import dataclass
from importlib.resources import files
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from meshes.arrays import Array, Index

MM = 1e-3
RAILS = {"54E1": "rail_54e1", "60E1": "rail_60e1"}
CHORD = 0.05 * MM  # spacing of the stored points; Hermite interpolation adds < 1e-12 m


@dataclass(frozen=True)
class Profile:
    """A smooth plane curve, stored densely and interpolated by cubic Hermite polynomials.

    Attributes:
        s: Arc length of the stored points, increasing from 0, shape ``(n,)`` [m].
        points: Lateral and outward coordinate, shape ``(n, 2)`` [m].
        angles: Direction of the tangent, continuous along the curve, shape ``(n,)`` [rad].
        curvatures: Turning rate of the tangent, negative where convex, shape ``(n,)`` [1/m].
        joints: Arc length at which the pieces of the drawing meet, ends included [m].
    """

    s: Array
    points: Array
    angles: Array
    curvatures: Array
    joints: Array

    @property
    def length(self) -> float:
        """Total arc length [m]."""
        return float(self.s[-1])

    def at(self, s: npt.ArrayLike) -> Array:
        """Return the points at arc length ``s`` [m], shape ``(..., 2)`` [m]."""
        k, t, h = self._interval(s)
        p, q = self.points[k], self.points[k + 1]
        m, n = (h[..., None] * _direction(self.angles[i]) for i in (k, k + 1))
        t = t[..., None]
        return (
            p * (1 + 2 * t) * (1 - t) ** 2
            + m * t * (1 - t) ** 2
            + q * t**2 * (3 - 2 * t)
            - n * t**2 * (1 - t)
        )

    def angle(self, s: npt.ArrayLike) -> Array:
        """Return the direction of the tangent at arc length ``s`` [m], shape ``(...)`` [rad]."""
        return np.asarray(np.interp(np.asarray(s), self.s, self.angles))

    def normal(self, s: npt.ArrayLike) -> Array:
        """Return the outward unit normals at arc length ``s`` [m], shape ``(..., 2)``."""
        return _direction(self.angle(s) + np.pi / 2)

    def curvature(self, s: npt.ArrayLike) -> Array:
        """Return the curvature at arc length ``s`` [m], negative where convex [1/m]."""
        k, t, _ = self._interval(s)
        return np.asarray(np.where(t < 0.5, self.curvatures[k], self.curvatures[k + 1]))

    def _interval(self, s: npt.ArrayLike) -> tuple[Index, Array, Array]:
        s = np.asarray(s, dtype=np.float64)
        k = np.clip(np.searchsorted(self.s, s, side="right") - 1, 0, len(self.s) - 2)
        h = self.s[k + 1] - self.s[k]
        return k, (s - self.s[k]) / h, h


def s1002(chamfer: bool = True) -> Profile:
    """Return the S1002 wheel profile from the flange back to the field side.

    Lateral 0 is the tape circle (70 mm from the flange back), outward 0 its radius; the flange tip
    is 28 mm outward.

    Args:
        chamfer: Add the 5 mm chamfer of a 135 mm wide rim.
    """
    pieces = []
    for section in reversed(drawing("s1002")["sections"]):
        low, high = section["y_range"]
        if section["type"] == "polynomial":
            poly = np.polynomial.Polynomial(section["coef_ascending"])
            pieces.append(_graph(poly, low, high))
        else:
            centre = np.array([section["yc"], section["z0"]])
            pieces.append(_arc(centre, section["R"], *_graph_ends(section)))
    if chamfer:
        end = pieces[-1][0][-1]
        pieces.append(_line(end, end + np.array([5.0, -5.0])))
    return _joined(pieces)


def rail_54e1(part: Literal["head", "outline"] = "head") -> Profile:
    """Return the 54E1 rail profile, upright, with the top of the rail at (0, 0); see ``rail``."""
    return rail("54E1", part)


def rail(design: str, part: Literal["head", "outline"] = "head") -> Profile:
    """Return the profile of a standard rail, upright, with the top of the rail at (0, 0).

    Args:
        design: One of ``RAILS``.
        part: ``head`` for the running surface, from the lower end of the gauge-side flank over the
            rail top to that of the field side; ``outline`` for the closed section, clockwise from
            the middle of the rail top.
    """
    if design not in RAILS:
        raise ValueError(f"rail design: expected one of {', '.join(RAILS)}, got {design!r}")
    drawn = drawing(RAILS[design])
    data = drawn["segments"]
    half = [_segment(segment) for segment in (data[:4] if part == "head" else data)]
    mirrored = [_mirrored(piece) for piece in reversed(half)]
    pieces = [*half, *mirrored] if part == "outline" else [*mirrored, *half]
    return _joined(pieces, offset=np.array([0.0, -drawn["segments"][0]["start"][1]]))


def inclined(profile: Profile, slope: float = 1 / 40) -> Profile:
    """Return the profile turned about its origin by ``atan(slope)`` towards -lateral.

    A rail so turned leans towards the track centre.
    """
    turn = np.arctan(slope)
    c, s = np.cos(turn), np.sin(turn)
    points = profile.points @ np.array([[c, s], [-s, c]])
    return Profile(profile.s, points, profile.angles + turn, profile.curvatures, profile.joints)


def shifted(profile: Profile, offset: npt.ArrayLike) -> Profile:
    """Return the profile moved by ``offset``, shape ``(2,)`` [m]."""
    points = profile.points + np.asarray(offset)
    return Profile(profile.s, points, profile.angles, profile.curvatures, profile.joints)


def drawing(name: str) -> dict[str, Any]:
    """Return the drawing data called ``name`` that come with the package."""
    text = files("meshes").joinpath(f"data/{name}.json").read_text(encoding="utf-8")
    data: dict[str, Any] = json.loads(text)
    return data


# A piece of a drawing: points (n, 2) [mm], tangent angles (n,) [rad], curvatures (n,) [1/mm].
Piece = tuple[Array, Array, Array]


def _direction(angle: Array) -> Array:
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def _count(length: float) -> int:
    return max(2, int(np.ceil(length * MM / CHORD)) + 1)


def _graph(poly: np.polynomial.Polynomial, low: float, high: float) -> Piece:
    y = np.linspace(low, high, _count(high - low))
    first, second = poly.deriv()(y), poly.deriv(2)(y)
    return np.column_stack([y, poly(y)]), np.arctan(first), second / (1 + first**2) ** 1.5


def _line(start: Array, end: Array) -> Piece:
    t = np.linspace(0, 1, _count(float(np.hypot(*(end - start)))))
    angle = np.arctan2(end[1] - start[1], end[0] - start[0])
    return start + t[:, None] * (end - start), np.full(len(t), angle), np.zeros(len(t))


def _arc(centre: Array, radius: float, start: float, end: float) -> Piece:
    """Return an arc between two polar angles [rad] about ``centre``."""
    angle = np.linspace(start, end, _count(radius * abs(end - start)))
    turn = np.sign(end - start)
    points = centre + radius * _direction(angle)
    return points, angle + turn * np.pi / 2, np.full(len(angle), turn / radius)


def _graph_ends(section: dict[str, Any]) -> tuple[float, float]:
    """Return the polar angles at the ends of an arc that is drawn as a graph over y."""
    ends = np.clip((np.array(section["y_range"]) - section["yc"]) / section["R"], -1, 1)
    first, last = section["sign"] * np.arccos(ends)
    return float(first), float(last)


def _segment(segment: dict[str, Any]) -> Piece:
    start, end = np.array(segment["start"]), np.array(segment["end"])
    if segment["type"] == "line":
        return _line(start, end)
    centre = np.array(segment["centre"])
    first, last = (np.arctan2(*(p - centre)[::-1]) for p in (start, end))
    sense = -1 if segment["sense"] == "cw" else 1
    turn = sense * ((sense * (last - first)) % (2 * np.pi))
    return _arc(centre, segment["radius"], first, first + turn)


def _mirrored(piece: Piece) -> Piece:
    points, angles, curvatures = piece
    return points[::-1] * [-1, 1], -angles[::-1], curvatures[::-1]


def _joined(pieces: list[Piece], offset: npt.ArrayLike = (0.0, 0.0)) -> Profile:
    """Return the pieces strung together, in m; the stored point at a joint is the first one's."""
    lengths = [np.hypot(*np.diff(p, axis=0).T) / _sinc(np.diff(a) / 2) for p, a, _ in pieces]
    joints = np.cumsum([0.0, *(ds.sum() for ds in lengths)])
    s = np.concatenate([[0.0], np.cumsum(np.concatenate(lengths))])
    points, angles, curvatures = (
        np.concatenate([piece[i][min(k, 1) :] for k, piece in enumerate(pieces)]) for i in range(3)
    )
    points = (points + np.asarray(offset)) * MM
    return Profile(s * MM, points, np.unwrap(angles), curvatures / MM, joints * MM)


def _sinc(half_turn: Array) -> Array:
    """Return chord over arc for arcs that turn by twice ``half_turn``."""
    return np.sinc(half_turn / np.pi)
