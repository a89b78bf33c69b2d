# SPDX-License-Identifier: LGPL-3.0-or-later
"""Is the patch of a wheel on a rail an ellipse? Hertz says so, the drawn profiles do not.

A S1002 wheel is set on a 54E1 rail further and further towards the gauge face, and pressed on it
with 84 kN. Hertz knows the two curvatures where they first touch; half-spaces take the distance of
the profiles as it is. Where the curvature jumps, from R300 to R80 of the rail head, they differ.
With the folder of a run of flange-transition its patches at rest are put beside both.

    python examples/patch_at_rest.py [RUN_FOLDER] [--out FIGURE.png]
"""

import argparse
from pathlib import Path

import numpy as np

from contact.theory import contact_modulus, profile_contact
from meshes.profiles import RADIUS, place, rail_in_track, rail_surface, s1002, wheel_surface
from workflow import at_rest, half_axes, read_run

LOAD, MODULUS = 84e3, contact_modulus(210e9, 0.3, 210e9, 0.3)
SHIFTS = 1e-3 * np.array([0.0, 1.0, 2.0, 3.0, 4.0, 5.0])  # towards the gauge face [m]


def pressed(shift: float):
    """Return what is expected of the wheel at a lateral shift."""
    at = place(shift=shift)
    wheel, rail = wheel_surface(s1002(), RADIUS, at.centre), rail_surface(rail_in_track())
    return profile_contact(wheel, rail, at.tread_point, LOAD, MODULUS)


def figure(path, found):
    """Save the pressures on the rail at all shifts, Hertz's ellipses over them."""
    from matplotlib.figure import Figure

    fig = Figure(figsize=(7.2, 2.4), layout="constrained")
    panels = fig.subplots(1, len(found), sharex=True, sharey=True)
    top = max(e.half_space.pressure.max() for e in found) / 1e6
    turn = np.linspace(0, 2 * np.pi, 200)
    for ax, shift, e in zip(panels, SHIFTS, found, strict=True):
        p = np.where(e.half_space.pressure > 0, e.half_space.pressure / 1e6, np.nan)
        y = 1e3 * (e.origin[1] + e.y)  # the frame is all but level
        drawn = ax.pcolormesh(1e3 * e.x, y, p.T, cmap="magma_r", vmin=0, vmax=top)
        if e.hertz:
            ring = e.hertz.a * np.cos(turn), e.origin[1] + e.hertz.b * np.sin(turn)
            ax.plot(1e3 * ring[0], 1e3 * ring[1], "--", color="0.5", lw=1)
        ax.set(title=f"{1e3 * shift:.0f} mm", xlabel="x [mm]", aspect="equal")
    panels[0].set_ylabel("lateral y [mm]")
    fig.colorbar(drawn, ax=panels, label="pressure [MPa]", shrink=0.8)
    fig.savefig(path, dpi=150)


if __name__ == "__main__":
    words = argparse.ArgumentParser()
    words.add_argument("run", type=Path, nargs="?")
    words.add_argument("--out", type=Path)
    asked = words.parse_args()

    found = [pressed(shift) for shift in SHIFTS]
    print("shift angle  Hertz: a   b    p0    half-spaces: a   b    p0")
    for shift, e in zip(SHIFTS, found, strict=True):
        p, h = e.half_space.pressure, e.hertz
        ellipse = f"{1e3 * h.a:5.2f} {1e3 * h.b:5.2f} {h.p0 / 1e6:5.0f}" if h else "hollow"
        a, b = half_axes(e.grid, p.ravel())
        print(
            f"{1e3 * shift:3.0f} mm {e.angle:4.1f}°  {ellipse:>17}  "
            f"{1e3 * a:13.2f} {1e3 * b:5.2f} {p.max() / 1e6:5.0f}"
        )
    if asked.out:
        figure(asked.out, found)
    for rest in at_rest(read_run(asked.run).record) if asked.run else ():
        print(*rest.lines(), sep="\n")
