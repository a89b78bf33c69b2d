# SPDX-License-Identifier: LGPL-3.0-or-later
"""Profile report: what is understood of a profile file, its shape, its resolution, its doubts."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from meshes.arrays import Flags
from meshes.profiles.features import flange_of
from meshes.profiles.measured import Reading, read
from meshes.profiles.orientation import Axes, reached
from meshes.profiles.point_files import Kind
from workflow.results.table import PAIRS, Table
from workflow.scene.scene import SceneError

CROWN = 0.010  # half the chord over the rail top whose slope is told [m]
THICK = 0.010  # a flange is measured this far outside the tape circle [m]
EDGE = 1e-3  # stretch beside corners and ends whose curvature is not told [m]


def axes(words: dict[str, Any], part: int | None, flange_back: float, gauge_depth: float) -> Axes:
    """Return how the coordinates of a file are meant, from the words of a command."""
    return Axes(**words, part=part, flange_back=flange_back, gauge_depth=gauge_depth)


def reading(file: Path, kind: Kind | None, axes: Axes, smoothing: float) -> Reading:
    """Return a profile file as understood.

    Raises:
        SceneError: if it cannot be used.
    """
    try:
        return read(file, kind, axes, smoothing)
    except ValueError as error:
        raise SceneError(str(error)) from None
    except OSError as error:
        raise SceneError(f"{error}; expected a file of points: text, MiniProf or SIMPACK") from None


def summary(found: Reading, axes: Axes) -> dict[str, Any]:
    """Return what was understood, as JSON has it, in SI units."""
    at, profile, points = found.oriented, found.profile, found.points
    chords = np.hypot(*np.diff(points, axis=0).T)
    worst, turned = int(np.argmax(found.gaps)), int(np.argmax(found.turns))
    where = profile.at(found.corners).reshape(-1, 2)
    return {
        "file": str(found.path),
        "kind": found.kind,
        "format": found.file.format,
        "encoding": found.file.encoding,
        "notes": list(found.file.notes),
        "unit": at.unit,
        "origin": at.origin,
        "inner": at.inner,
        "outward": at.outward,
        "shift": [float(x) for x in at.shift],
        "points": len(points),
        "left_out": found.left_out,
        "lateral": [float(points[:, 0].min()), float(points[:, 0].max())],
        "height": [float(points[:, 1].min()), float(points[:, 1].max())],
        "length": profile.length,
        "shape": _wheel(found, axes) if found.kind == "wheel" else _rail(found, axes),
        "smallest_radius": _radii(found),
        "corners": [{"lateral": float(y), "height": float(z)} for y, z in where],
        "smoothing": found.smoothing,
        "largest_residual": float(found.residuals.max()),
        "rms_residual": float(np.sqrt(np.mean(found.residuals**2))),
        "scatter": found.scatter,
        "spacing": {"median": float(np.median(chords)), "largest": float(chords.max())},
        "largest_chord_angle": {
            "angle": float(found.turns[turned]),
            "lateral": float(points[turned + 1, 0]),
        },
        "left_open": {
            "distance": float(found.gaps[worst]),
            "lateral": float(points[worst : worst + 2, 0].mean()),
        },
        "doubts": list(found.doubts()),
    }


def _wheel(found: Reading, axes: Axes) -> dict[str, float | None]:
    """Return conicity at the tape circle, height, thickness and angle of the flange."""
    profile = found.profile
    y, r = profile.points.T
    tape = int(np.flatnonzero(y <= 0)[-1])
    height = float(np.interp(0.0, y[tape : tape + 2], r[tape : tape + 2]))
    told: dict[str, float | None] = {"conicity": float(-np.tan(profile.angles[tape]))}
    flange = flange_of(profile)
    if flange is None:
        return told | dict.fromkeys(("flange_height", "flange_thickness", "flange_angle"))
    tip = int(np.searchsorted(profile.s, flange[0]))
    flank = reached(y[tip : tape + 1], r[tip : tape + 1], height + THICK)
    return told | {
        "flange_height": float(r[tip]) - height,
        "flange_thickness": None if flank is None else flank + axes.flange_back,
        "flange_angle": float(-profile.angles[tip:tape].min()),
    }


def _rail(found: Reading, axes: Axes) -> dict[str, float | None]:
    """Return slope of the crown, lateral place of the gauge face and width of the head there."""
    y, z = found.profile.points.T
    top = int(np.argmax(z))
    depth = float(z[top]) - axes.gauge_depth
    face, far = reached(y[top::-1], z[top::-1], depth), reached(y[top:], z[top:], depth)
    width = None if face is None or far is None else far - face
    middle = float(y[top]) if face is None or width is None else face + width / 2
    rising = np.concatenate([[True], np.diff(np.maximum.accumulate(y)) > 0])
    ends = np.interp([middle - CROWN, middle + CROWN], y[rising], z[rising])
    slope = float((ends[1] - ends[0]) / (2 * CROWN))
    return {"crown_slope": slope, "gauge_face": face, "head_width": width}


def smooth_part(found: Reading) -> Flags:
    """Return which stored points of the curve lie off its corners and ends."""
    s = found.profile.s
    apart = np.abs(s[:, None] - found.profile.joints[None]).min(axis=1)
    return np.asarray(apart > min(EDGE, 0.02 * s[-1]))


def _radii(found: Reading) -> dict[str, float | None]:
    """Return the smallest radius where the curve is convex and where it is hollow [m]."""
    curvature = found.profile.curvatures[smooth_part(found)]
    round_, hollow = float(-curvature.min(initial=0.0)), float(curvature.max(initial=0.0))
    return {
        "convex": 1 / round_ if round_ > 0.01 else None,
        "hollow": 1 / hollow if hollow > 0.01 else None,
    }


def printout(found: dict[str, Any]) -> Iterator[str | Table]:
    """Yield the table of a summary and its doubts."""
    yield Table(found["file"], PAIRS, list(_rows(found)))
    yield from (f"doubt: {line}" for line in found["doubts"])


def _rows(found: dict[str, Any]) -> Iterator[tuple[str, str]]:
    side = "flange" if found["kind"] == "wheel" else "gauge side"
    shift = found["shift"]
    moved = f", moved by {shift[0] * 1e3:.2f}, {shift[1] * 1e3:.2f} mm" if any(shift) else ""
    yield "taken for", f"a {found['kind']}: {found['format']}, {found['encoding']}"
    if found["notes"]:
        yield "the file says", "\n".join(found["notes"])
    yield "points, unit", f"{found['points']}, in {found['unit']}"
    yield "in the file", f"{side} {found['inner']}, outward {found['outward']}"
    yield "origin", f"{found['origin'].replace('-', ' ')}{moved}"
    low, high = (np.array(found[key]) * 1e3 for key in ("lateral", "height"))
    yield "lateral, height", f"{low[0]:.2f} to {low[1]:.2f}, {high[0]:.2f} to {high[1]:.2f} mm"
    yield from _shape(found["shape"])
    radii = found["smallest_radius"]
    told = (f"{name} {r * 1e3:.4g} mm" for name, r in radii.items() if r is not None)
    yield "smallest radius", ", ".join(told) or "flat"
    corners = ", ".join(f"{corner['lateral'] * 1e3:.2f}" for corner in found["corners"][:8])
    more = ", ..." if len(found["corners"]) > 8 else ""
    at = f" at lateral {corners}{more} mm" if corners else ""
    yield "corners", f"{len(found['corners'])}{at}"
    turn = found["largest_chord_angle"]
    yield (
        "largest chord angle",
        f"{np.degrees(turn['angle']):.1f}° at lateral {turn['lateral'] * 1e3:.1f} mm",
    )
    spacing = found["spacing"]
    yield (
        "spacing",
        f"{spacing['median'] * 1e3:.3g} mm, the largest {spacing['largest'] * 1e3:.3g} mm",
    )
    yield (
        "residual",
        f"{found['rms_residual'] * 1e6:.1f} µm rms, the largest "
        f"{found['largest_residual'] * 1e6:.1f} µm (smoothing {found['smoothing'] * 1e6:.3g} µm)",
    )
    yield "scatter of the points", f"{found['scatter'] * 1e6:.2g} µm"


def _shape(shape: dict[str, float | None]) -> Iterator[tuple[str, str]]:
    for name, value in shape.items():
        if value is None:
            text = "none"
        elif name == "flange_angle":
            text = f"{np.degrees(value):.1f}°"
        elif name in ("conicity", "crown_slope"):
            text = f"{value:.4f}" + (f", 1:{1 / abs(value):.0f}" if abs(value) > 2e-3 else "")
        else:
            text = f"{value * 1e3:.2f} mm"
        yield name.replace("_", " "), text


def write(found: Reading, path: Path) -> Path:
    """Write the curve at the points of a file, lateral and outward in mm, and return the path.

    Raises:
        SceneError: if it is the file itself, or cannot be written.
    """
    if path.exists() and path.samefile(found.path):
        raise SceneError(f"--out {str(path)!r}: expected another file than the one that is read")
    rows = "".join(f"{y * 1e3:.7f},{z * 1e3:.7f}\n" for y, z in _on_curve(found))
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"y [mm],z [mm]\n{rows}", encoding="utf-8")
    except OSError as error:
        raise SceneError(
            f"--out {str(path)!r}: expected a file to write: {error.strerror}"
        ) from None
    return path


def _on_curve(found: Reading) -> Any:
    """Return the points moved to the curve, which they are on unless it was smoothed."""
    if not found.smoothing:
        return found.points
    from scipy.spatial import cKDTree

    return found.profile.points[cKDTree(found.profile.points).query(found.points)[1]]
