# SPDX-License-Identifier: LGPL-3.0-or-later
"""Placement of the wheel on the rail: first touch, flange gap, contact angles, rolling radius."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import brentq

from meshes.arrays import Array, Flags
from meshes.hexmesh import HexMesh
from meshes.profiles.features import flange_of
from meshes.profiles.orientation import FLANGE_BACK, GAUGE_DEPTH
from meshes.profiles.outline import SPACING, axes, contact_angle, distance, outline, seen_from_above
from meshes.profiles.profiles import Profile, inclined, rail_54e1, s1002, shifted

BACK_TO_BACK = 1.360  # distance of the flange backs of a wheelset
TAPE = BACK_TO_BACK / 2 + FLANGE_BACK  # lateral position of the tape circle
RADIUS = 0.460
GAUGE = 1.435
INCLINATION = 1 / 40
FLANK = np.radians(4.0)  # what is less steep than the flange's steepest part by this is tread
PRESSED = 1e-4  # depth of the flange in the corner, twice the approach of a loaded patch [m]
WAY = 2.2e-3  # lateral way to there on which the tread's patch is looked at [m]
TIGHT = 0.1  # relative radius across below which a patch is narrow: 6 mm under 100 kN [m]
FLANGE = (
    "flange_point",
    "flange_gap",
    "flange_angle",
    "flange_radius",
    "flange_s",
    "flange_rail_s",
)


@dataclass(frozen=True)
class Placement:
    """The wheel in the track position, its tread just touching the rail.

    Points and angles belong to the shortest distance from tread or flange to the rail. Angles are
    between the contact plane and the horizontal, positive where the wheel slopes as the flange.
    What belongs to the flange is None if the wheel has none; all of it is then tread.

    Attributes:
        shift: Lateral shift of the wheel towards the field side [m].
        yaw: Angle of attack, positive where the wheel runs towards the field side [rad].
        roll: Angle by which the axle rises towards the field side [rad].
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
    roll: float
    centre: Array
    rolling_radius: float
    tread_point: Array
    tread_angle: float
    flange_point: Array | None
    flange_gap: float | None
    flange_angle: float | None
    flange_radius: float | None
    tread_s: float
    flange_s: float | None
    tread_rail_s: float
    flange_rail_s: float | None


def rail_in_track(
    profile: Profile | None = None,
    *,
    inclination: float = INCLINATION,
    gauge: float = GAUGE,
    gauge_depth: float = GAUGE_DEPTH,
) -> Profile:
    """Return the rail profile in the track: (y, z) of the global frame.

    The rail is turned about its own axis, its highest point is put at z = 0 and its gauge face,
    ``gauge_depth`` below, at y = gauge / 2.

    Args:
        profile: Upright rail profile; 54E1 by default.
        inclination: Slope of the rail towards the track centre, 1:40.
        gauge: Distance of the gauge faces of the two rails [m].
        gauge_depth: How far below the rail top it is measured [m].
    """
    profile = inclined(rail_54e1() if profile is None else profile, inclination)
    return shifted(profile, track_offset(profile, gauge, gauge_depth))


def track_offset(
    inclined_head: Profile, gauge: float = GAUGE, gauge_depth: float = GAUGE_DEPTH
) -> Array:
    """Return how far an inclined rail head is moved into the track, shape ``(2,)`` [m].

    Raises:
        ValueError: if the head does not reach down to where the gauge is measured.
    """
    fine = inclined_head.at(np.arange(0, inclined_head.length, SPACING))
    y, z = fine.T
    top = int(np.argmax(z))
    gauge_side = slice(0, top + 1)
    if z[0] > z[top] - gauge_depth:
        raise ValueError(
            f"rail profile: expected a gauge side that reaches {gauge_depth} m below the rail top, "
            f"got {z[top] - z[0]:.4f} m"
        )
    face = np.interp(z[top] - gauge_depth, z[gauge_side], y[gauge_side])
    return np.array([gauge / 2 - face, -z[top]])


def place(
    wheel: Profile | None = None,
    rail: Profile | None = None,
    *,
    radius: float = RADIUS,
    shift: float = 0.0,
    yaw: float = 0.0,
    roll: float = 0.0,
    tape: float = TAPE,
) -> Placement:
    """Return the wheel lowered until its tread first touches the rail.

    Args:
        wheel: Wheel profile; S1002 by default.
        rail: Rail profile in the track; 54E1 at 1:40 and 1435 mm by default.
        radius: Radius of the tape circle [m].
        shift: Lateral shift of the centre of the tape circle towards the field side [m].
        yaw: Angle of attack [rad].
        roll: Angle by which the axle rises towards the field side [rad].
        tape: Lateral position of the tape circle at no shift [m].

    Raises:
        ValueError: if wheel and rail do not overlap laterally.
    """
    wheel, rail = wheel or s1002(), rail or rail_in_track()
    s = np.arange(0, wheel.length, SPACING)
    trace = outline(wheel, s, radius, yaw, roll) + np.array([0.0, tape + shift, 0.0])
    flank, tread = _parts(wheel, s)
    seen = np.isfinite(trace[:, 2])
    touch, height, rail_touch = _lower(trace, tread & seen, rail)
    trace[:, 2] += height

    def point_of(k: int) -> tuple[Array, float, float, float]:
        angle = contact_angle(wheel, float(s[k]), yaw, roll)
        return trace[k], angle, radius + float(wheel.at(s[k])[1]), float(s[k])

    flange: dict[str, Any] = dict.fromkeys(FLANGE)
    if (flank & seen).any():
        nearest, gap, rail_nearest = _nearest(trace, flank & seen, rail)
        point, *rest = point_of(nearest)
        flange = dict(zip(FLANGE, (point, gap, *rest, rail_nearest), strict=True))
    point, angle, circle, at = point_of(touch)
    return Placement(
        shift=shift,
        yaw=yaw,
        roll=roll,
        centre=np.array([0.0, tape + shift, height]),
        rolling_radius=circle,
        tread_point=point,
        tread_angle=angle,
        tread_s=at,
        tread_rail_s=rail_touch,
        **flange,
    )


def lateral_shift_for(
    wheel: Profile | None = None,
    rail: Profile | None = None,
    *,
    flange_gap: float = 3e-4,
    radius: float = RADIUS,
    yaw: float = 0.0,
    roll: float = 0.0,
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
        roll: Angle by which the axle rises towards the field side [rad].
        tape: Lateral position of the tape circle at no shift [m].
        reach: Smallest and largest lateral shift to look at [m].

    Raises:
        ValueError: if the wheel has no flange or no shift within reach leaves that gap.
    """
    wheel = s1002() if wheel is None else wheel
    rail = rail_in_track() if rail is None else rail
    if flange_of(wheel) is None:
        raise ValueError("flange_gap: expected a wheel with a flange, got a profile without one")

    def at(shift: float) -> Placement:
        return place(wheel, rail, radius=radius, shift=shift, yaw=yaw, roll=roll, tape=tape)

    def gap(shift: float) -> float:
        found = at(shift).flange_gap
        if found is None:
            raise ValueError(f"flange_gap: expected a flange that can touch at a yaw of {yaw} rad")
        return found

    gaps = [gap(shift) for shift in reach]
    if not gaps[1] <= flange_gap <= gaps[0]:
        raise ValueError(
            f"flange_gap: expected {gaps[1]:.2e} to {gaps[0]:.2e} m, which shifts of {reach[0]} to "
            f"{reach[1]} m leave, got {flange_gap:.2e} m; a thicker flange, or wheels farther "
            "apart, leave less"
        )
    return at(brentq(lambda shift: gap(shift) - flange_gap, *reach, xtol=1e-9))


def narrow_arcs(
    wheel: Profile | None = None,
    rail: Profile | None = None,
    *,
    radius: float = RADIUS,
    yaw: float = 0.0,
    roll: float = 0.0,
    tape: float = TAPE,
) -> dict[str, tuple[float, float]]:
    """Return the arc lengths on ``wheel`` and ``rail`` of narrow patches as a flange comes.

    They begin where a flange that stands :data:`PRESSED` deep in the gauge corner overlaps it, and
    end where the tread touches on its way there, over the last :data:`WAY` of it, as far as both
    profiles are curved enough there for a narrow patch (:data:`TIGHT`): on the shoulder of 54E1,
    not on its crown.

    Args:
        wheel: Wheel profile; S1002 by default.
        rail: Rail profile in the track; 54E1 at 1:40 and 1435 mm by default.
        radius: Radius of the tape circle [m].
        yaw: Angle of attack [rad].
        roll: Angle by which the axle rises towards the field side [rad].
        tape: Lateral position of the tape circle at no shift [m].

    Raises:
        ValueError: as :func:`lateral_shift_for`.
    """
    wheel, rail = wheel or s1002(), rail or rail_in_track()
    turn: dict[str, Any] = {"radius": radius, "yaw": yaw, "roll": roll, "tape": tape}
    pressed = lateral_shift_for(wheel, rail, flange_gap=-PRESSED, **turn)
    arcs = [_overlapping(wheel, rail, pressed, turn)]
    for shift in pressed.shift - np.linspace(0.0, WAY, 12):
        at = place(wheel, rail, shift=float(shift), **turn)
        if -wheel.curvature(at.tread_s) - rail.curvature(at.tread_rail_s) > 1 / TIGHT:
            arcs.append((at.tread_s, at.tread_s, at.tread_rail_s, at.tread_rail_s))
    low, high = np.min(arcs, axis=0), np.max(arcs, axis=0)
    return {
        "wheel": (float(low[0]), float(high[1])),
        "rail": (float(low[2]), float(high[3])),
    }


def _overlapping(
    wheel: Profile, rail: Profile, pressed: Placement, turn: dict[str, float]
) -> tuple[float, float, float, float]:
    """Return first and last arc length of wheel and rail that overlap round the deepest point."""
    assert pressed.flange_s is not None
    s = np.arange(0, wheel.length, SPACING)
    trace = outline(wheel, s, turn["radius"], turn["yaw"], turn["roll"]) + pressed.centre
    seen = np.isfinite(trace[:, 2])
    gap = np.full(len(s), np.inf)
    near = np.zeros(len(s))
    gap[seen], near[seen] = distance(trace[seen], rail)
    deepest = int(np.searchsorted(s, pressed.flange_s))
    apart = np.flatnonzero(gap >= 0.0)
    k = int(np.searchsorted(apart, deepest))
    first = apart[k - 1] + 1 if k else 0
    last = apart[k] - 1 if k < len(apart) else len(s) - 1
    touched = near[first : last + 1]
    return float(s[first]), float(s[last]), float(touched.min()), float(touched.max())


def placed(mesh: HexMesh, placement: Placement) -> HexMesh:
    """Return the wheelset mesh, made about (0, tape circle, 0), in the track position.

    Args:
        mesh: Wheelset in wheel axes: axle along y, tape circle at the ``tape`` of the placement.
        placement: Where the wheel stands; yaw and roll turn it about its centre.
    """
    pivot = np.array([0.0, placement.centre[1] - placement.shift, 0.0])
    axle, ahead, up = axes(placement.yaw, placement.roll)
    turn = np.column_stack([ahead, axle, up])
    return mesh.moved((mesh.points - pivot) @ turn.T + placement.centre)


def _parts(wheel: Profile, s: Array) -> tuple[Flags, Flags]:
    """Return which points belong to the flange flank and which to the tread beside it."""
    index = np.arange(len(s))
    flange = flange_of(wheel)
    if flange is None:
        return index < 0, index >= 0
    steep = -wheel.angle(s)
    tip = int(np.searchsorted(s, flange[0]))
    tape = int(np.flatnonzero(wheel.at(s)[:, 0] <= 0)[-1])  # beyond it a rim face may be steeper
    least = float(steep[tip : tape + 1].max()) - FLANK
    start = tip + int(np.argmax(steep[tip:] >= least))
    end = start + int(np.argmax(steep[start:] < least))
    return (index >= start) & (index < end), index >= end


def _lower(trace: Array, tread: Flags, rail: Profile) -> tuple[int, float, float]:
    """Return the tread's touching point, the height it is lowered to, and the rail's point."""
    y, z, s = seen_from_above(rail)
    index = np.flatnonzero(tread)
    below = np.interp(trace[index, 1], y, z, left=np.nan, right=np.nan)
    height = below - trace[index, 2]
    if np.isnan(height).all():
        raise ValueError(
            f"wheel at y = {np.nanmin(trace[index, 1]):.4f} to {np.nanmax(trace[index, 1]):.4f} m "
            f"is not above the rail at y = {y.min():.4f} to {y.max():.4f} m"
        )
    k = int(np.nanargmax(height))
    contact = int(index[k])
    return contact, float(height[k]), float(np.interp(trace[contact, 1], y, s))


def _nearest(trace: Array, part: Flags, rail: Profile) -> tuple[int, float, float]:
    """Return the point of ``part`` nearest to the rail, its signed gap, and the rail's point."""
    index = np.flatnonzero(part)
    gap, near = distance(trace[index], rail)
    k = int(np.argmin(gap))
    return int(index[k]), float(gap[k]), float(near[k])
