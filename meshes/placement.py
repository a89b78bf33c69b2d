# SPDX-License-Identifier: LGPL-3.0-or-later
"""Where the wheel stands on the rail: first touch, flange gap, contact angles, rolling radius.

The rail is a prism along x and the wheel a surface of revolution about the yawed axle. Their
shortest distance is normal to x, so it is met on the wheel where the normal has no x component:
``sin(theta) = tan(yaw) n_y / n_r`` on the parallel circle with profile normal ``(n_y, n_r)``. This
trace, seen along x, is the wheel's outline, and contact in space becomes contact of plane curves.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq
from scipy.spatial import cKDTree

from meshes.hexmesh import HexMesh
from meshes.profiles import Array, Profile, inclined, rail_54e1, s1002, shifted

TAPE = 0.750  # lateral position of the tape circle: half of 1360 mm flange back distance + 70 mm
RADIUS = 0.460
GAUGE = 1.435
GAUGE_DEPTH = 0.014  # the gauge is measured this far below the rail top
INCLINATION = 1 / 40
SPACING = 1e-5  # of the points that are compared; the gap is then exact to 1e-9 m


@dataclass(frozen=True)
class Placement:
    """The wheel in the track position, its tread just touching the rail.

    Points and angles belong to the shortest distance from tread or flange to the rail. Angles are
    between the contact plane and the horizontal, positive where the wheel slopes as the flange.

    Attributes:
        shift: Lateral shift of the wheel towards the field side [m].
        yaw: Angle of attack, positive where the wheel runs towards the field side [rad].
        centre: Centre of the tape circle, shape ``(3,)`` [m].
        rolling_radius: Radius of the wheel at the tread contact [m].
        tread_point: Contact point on the tread, shape ``(3,)`` [m].
        tread_angle: Contact angle on the tread [rad].
        flange_point: Point of the flange nearest to the rail, shape ``(3,)`` [m].
        flange_gap: Normal gap from there to the gauge corner, negative if it penetrates [m].
        flange_angle: Contact angle there [rad].
        flange_radius: Radius of the wheel there [m].
        tread_s, flange_s: Arc length of both points on the wheel profile [m].
        tread_rail_s, flange_rail_s: Arc length of the nearest points on the rail profile [m].
    """

    shift: float
    yaw: float
    centre: Array
    rolling_radius: float
    tread_point: Array
    tread_angle: float
    flange_point: Array
    flange_gap: float
    flange_angle: float
    flange_radius: float
    tread_s: float
    flange_s: float
    tread_rail_s: float
    flange_rail_s: float


def rail_in_track(
    profile: Profile | None = None, *, inclination: float = INCLINATION, gauge: float = GAUGE
) -> Profile:
    """Return the rail profile in the track: (y, z) of the global frame.

    The rail is turned about its own axis, its highest point is put at z = 0 and its gauge face,
    14 mm below, at y = gauge / 2.

    Args:
        profile: Upright rail profile; 54E1 by default.
        inclination: Slope of the rail towards the track centre, 1:40.
        gauge: Distance of the gauge faces of the two rails [m].
    """
    profile = inclined(rail_54e1() if profile is None else profile, inclination)
    return shifted(profile, track_offset(profile, gauge))


def track_offset(inclined_head: Profile, gauge: float = GAUGE) -> Array:
    """Return how far an inclined rail head is moved into the track, shape ``(2,)`` [m].

    Raises:
        ValueError: if the head does not reach down to where the gauge is measured.
    """
    fine = inclined_head.at(np.arange(0, inclined_head.length, SPACING))
    y, z = fine.T
    top = int(np.argmax(z))
    gauge_side = slice(0, top + 1)
    if z[0] > z[top] - GAUGE_DEPTH:
        raise ValueError(
            f"rail profile: expected a gauge side that reaches {GAUGE_DEPTH} m below the rail top, "
            f"got {z[top] - z[0]:.4f} m"
        )
    face = np.interp(z[top] - GAUGE_DEPTH, z[gauge_side], y[gauge_side])
    return np.array([gauge / 2 - face, -z[top]])


def outline(wheel: Profile, s: Array, radius: float, yaw: float) -> Array:
    """Return the points of the wheel that can touch a prism along x, shape ``(n, 3)`` [m].

    Where the profile is too steep for the yaw no such point exists and NaN stands in its place.

    Args:
        wheel: Wheel profile.
        s: Arc length on it, shape ``(n,)`` [m].
        radius: Radius of the tape circle [m].
        yaw: Angle of attack [rad].
    """
    (eta, r), (n_y, n_r) = wheel.at(s).T, wheel.normal(s).T
    r = r + radius
    with np.errstate(invalid="ignore", divide="ignore"):
        sine = np.tan(yaw) * n_y / n_r
        cosine = np.where(n_r > 0, np.sqrt(1 - sine**2), np.nan)
    axle, ahead = np.array([-np.sin(yaw), np.cos(yaw)]), np.array([np.cos(yaw), np.sin(yaw)])
    xy = eta[:, None] * axle + (r * sine)[:, None] * ahead
    return np.column_stack([xy, -r * cosine])


def place(
    wheel: Profile | None = None,
    rail: Profile | None = None,
    *,
    radius: float = RADIUS,
    shift: float = 0.0,
    yaw: float = 0.0,
    tape: float = TAPE,
    flange_from: float = np.radians(66.0),
) -> Placement:
    """Return the wheel lowered until its tread first touches the rail.

    Args:
        wheel: Wheel profile; S1002 by default.
        rail: Rail profile in the track; 54E1 at 1:40 and 1435 mm by default.
        radius: Radius of the tape circle [m].
        shift: Lateral shift of the wheel towards the field side [m].
        yaw: Angle of attack [rad].
        tape: Lateral position of the tape circle at no shift [m].
        flange_from: Profile angle from which on the wheel counts as flange [rad].

    Raises:
        ValueError: if wheel and rail do not overlap laterally or the wheel has no flange.
    """
    wheel = s1002() if wheel is None else wheel
    rail = rail_in_track() if rail is None else rail
    s = np.arange(0, wheel.length, SPACING)
    trace = outline(wheel, s, radius, yaw) + np.array([0.0, tape + shift, 0.0])
    steep = -wheel.angle(s)
    flank, tread = _parts(wheel, s, steep, flange_from)
    seen = np.isfinite(trace[:, 2])
    touch, height, rail_touch = _lower(trace, tread & seen, rail)
    trace[:, 2] += height
    nearest, gap, rail_nearest = _normal_gap(trace, flank & seen, rail)
    return Placement(
        shift=shift,
        yaw=yaw,
        centre=np.array([0.0, tape + shift, height]),
        rolling_radius=radius + float(wheel.at(s[touch])[1]),
        tread_point=trace[touch],
        tread_angle=float(steep[touch]),
        flange_point=trace[nearest],
        flange_gap=gap,
        flange_angle=float(steep[nearest]),
        flange_radius=radius + float(wheel.at(s[nearest])[1]),
        tread_s=float(s[touch]),
        flange_s=float(s[nearest]),
        tread_rail_s=rail_touch,
        flange_rail_s=rail_nearest,
    )


def lateral_shift_for(
    wheel: Profile | None = None,
    rail: Profile | None = None,
    *,
    flange_gap: float = 3e-4,
    radius: float = RADIUS,
    yaw: float = 0.0,
    tape: float = TAPE,
    reach: tuple[float, float] = (0.0, 0.012),
) -> Placement:
    """Return the placement whose flange stands ``flange_gap`` off the gauge corner.

    Args:
        wheel: Wheel profile; S1002 by default.
        rail: Rail profile in the track; 54E1 at 1:40 and 1435 mm by default.
        flange_gap: Normal gap between flange and gauge corner, the tread touching [m].
        radius: Radius of the tape circle [m].
        yaw: Angle of attack [rad].
        tape: Lateral position of the tape circle at no shift [m].
        reach: Smallest and largest lateral shift to look at [m].

    Raises:
        ValueError: if no shift within reach leaves that gap.
    """
    wheel = s1002() if wheel is None else wheel
    rail = rail_in_track() if rail is None else rail

    def at(shift: float) -> Placement:
        return place(wheel, rail, radius=radius, shift=shift, yaw=yaw, tape=tape)

    gaps = [at(shift).flange_gap for shift in reach]
    if not gaps[1] <= flange_gap <= gaps[0]:
        raise ValueError(
            f"flange_gap: expected {gaps[1]:.2e} to {gaps[0]:.2e} m, which shifts of {reach[0]} to "
            f"{reach[1]} m leave, got {flange_gap:.2e} m"
        )
    return at(brentq(lambda shift: at(shift).flange_gap - flange_gap, *reach, xtol=1e-9))


def placed(mesh: HexMesh, placement: Placement) -> HexMesh:
    """Return the wheelset mesh, made about (0, tape circle, 0), in the track position.

    Args:
        mesh: Wheelset in wheel axes: axle along y, tape circle at the ``tape`` of the placement.
        placement: Where the wheel stands; the yaw turns it about the vertical through its centre.
    """
    pivot = np.array([0.0, placement.centre[1] - placement.shift, 0.0])
    c, s = np.cos(placement.yaw), np.sin(placement.yaw)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return mesh.moved((mesh.points - pivot) @ turn.T + placement.centre)


def _parts(
    wheel: Profile, s: Array, steep: Array, flange_from: float
) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_]]:
    """Return which points belong to the flange flank and which to the tread beside it."""
    tip = int(np.argmax(wheel.at(s)[:, 1]))
    start = tip + int(np.argmax(steep[tip:] >= flange_from))
    if steep[start] < flange_from:
        raise ValueError(f"wheel profile: no flange steeper than {np.degrees(flange_from):.1f}°")
    end = start + int(np.argmax(steep[start:] < flange_from))
    index = np.arange(len(s))
    return (index >= start) & (index < end), index >= end


def _lower(trace: Array, tread: npt.NDArray[np.bool_], rail: Profile) -> tuple[int, float, float]:
    """Return the tread's touching point, the height it is lowered to, and the rail's point."""
    s = np.arange(0, rail.length, SPACING)
    y, z = rail.at(s).T
    top = (np.diff(y, append=y[-1] + 1) > 0).nonzero()[0]  # the part that is seen from above
    index = np.flatnonzero(tread)
    below = np.interp(trace[index, 1], y[top], z[top], left=np.nan, right=np.nan)
    height = below - trace[index, 2]
    if np.isnan(height).all():
        raise ValueError(
            f"wheel at y = {np.nanmin(trace[index, 1]):.4f} to {np.nanmax(trace[index, 1]):.4f} m "
            f"is not above the rail at y = {y.min():.4f} to {y.max():.4f} m"
        )
    k = int(np.nanargmax(height))
    contact = int(index[k])
    return contact, float(height[k]), float(np.interp(trace[contact, 1], y[top], s[top]))


def _normal_gap(
    trace: Array, part: npt.NDArray[np.bool_], rail: Profile
) -> tuple[int, float, float]:
    """Return the point of ``part`` nearest to the rail, its signed gap, and the rail's point."""
    s = np.arange(0, rail.length, SPACING)
    points, normals = rail.at(s), rail.normal(s)
    index = np.flatnonzero(part)
    _, near = cKDTree(points).query(trace[index, 1:])
    gap = np.sum((trace[index, 1:] - points[near]) * normals[near], axis=1)
    k = int(np.argmin(gap))
    return int(index[k]), float(gap[k]), float(s[near[k]])
