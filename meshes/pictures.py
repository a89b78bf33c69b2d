# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pictures of a placement and of a mesh, drawn off screen."""

from pathlib import Path

import numpy as np

from meshes.placement import RADIUS, Placement, outline, rail_in_track
from meshes.profiles import Profile, s1002


def draw_placement(
    path: str | Path,
    placement: Placement,
    wheel: Profile | None = None,
    rail: Profile | None = None,
    *,
    radius: float = RADIUS,
) -> None:
    """Draw the wheel's outline on the rail in the track position, with a window on each contact."""
    from matplotlib.figure import Figure

    wheel = s1002() if wheel is None else wheel
    rail = rail_in_track() if rail is None else rail
    trace = outline(wheel, np.arange(0, wheel.length, 1e-4), radius, placement.yaw)
    trace = (trace + placement.centre) * 1e3
    points = rail.points * 1e3
    figure = Figure(figsize=(15, 5), layout="constrained")
    centres = [None, placement.tread_point, placement.flange_point]
    for axes, centre in zip(figure.subplots(1, 3), centres, strict=True):
        axes.plot(*trace[:, 1:].T, label="wheel")
        axes.plot(*points.T, label="rail")
        for point in centres[1:]:
            axes.plot(*point[1:] * 1e3, "k+")  # type: ignore[index]
        axes.set(xlabel="y [mm]", ylabel="z [mm]", aspect="equal")
        if centre is not None:
            y, z = centre[1:] * 1e3
            axes.set(xlim=(y - 5, y + 5), ylim=(z - 5, z + 5))
    figure.axes[0].legend()
    figure.suptitle(
        f"shift {placement.shift * 1e3:.3f} mm, flange gap {placement.flange_gap * 1e3:.3f} mm, "
        f"flange angle {np.degrees(placement.flange_angle):.1f}°"
    )
    figure.savefig(path, dpi=100)
