# SPDX-License-Identifier: LGPL-3.0-or-later
"""Does a pressed sphere slip when it is pulled sideways with less than friction allows? At its rim.

The pressure falls to zero at the rim, so some annulus slips under any pull Q. Cattaneo (1938) and
Mindlin (1949): the circle that sticks has the radius c = a (1 − Q/(friction P))^(1/3).

    python examples/cattaneo_mindlin.py [SIZE in mm] [FIGURE.png]
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

from contact.theory import (
    cattaneo_mindlin,
    contact_modulus,
    hertz_sphere,
    stick_radius_ratio,
)
from workflow import Scene, run

FRICTION, RADIUS = 0.3, 0.1


def sheared(size: float):
    """Return the footprint at the end and the forces P and Q of both halves [N]."""
    kept = []
    scene = Scene.load("cattaneo-mindlin", **{"mesh.size": size, "output.fields": False})
    with tempfile.TemporaryDirectory() as folder:
        run(scene, Path(folder) / "run", watch=lambda m: kept or kept.append(m), quiet=True)
    pair = kept[0].pairs["touch"]
    return (
        pair.footprint(stick_tolerance=0.02),
        2 * pair.normal_force,
        -2 * pair.tangential_force[0],
    )


def figure(path, r, q, hertz, P, Q):
    """Save the shear traction over the radius, the closed form behind it."""
    from matplotlib.figure import Figure

    fig = Figure(figsize=(5, 3.2), layout="constrained")
    ax, line = fig.subplots(), np.linspace(0, hertz.a, 400)
    exact = cattaneo_mindlin(line, hertz, Q, P, FRICTION)
    ax.plot(line * 1e3, exact / 1e6, lw=3, color="0.7", label="Cattaneo, Mindlin")
    ax.plot(
        line * 1e3, FRICTION * hertz.pressure(line) / 1e6, "--", color="0.5", label="friction p"
    )
    ax.plot(r * 1e3, q / 1e6, ".", ms=4, label="contact nodes")
    ax.set(xlabel="distance from the centre [mm]", ylabel="shear traction [MPa]", ylim=(0, None))
    ax.legend()
    fig.savefig(path, dpi=150)


if __name__ == "__main__":
    touch, P, Q = sheared(1e-3 * float(sys.argv[1]) if len(sys.argv) > 1 else 2.5e-4)
    hertz = hertz_sphere(P, RADIUS, contact_modulus(210e9, 0.3, 210e9, 0.3))
    r = np.hypot(touch.position[:, 0], touch.position[:, 1])
    q = -touch.tangential_force[:, 0] / touch.area
    if len(sys.argv) > 2:
        figure(sys.argv[2], r, q, hertz, P, Q)
    off = q - cattaneo_mindlin(r, hertz, Q, P, FRICTION)
    found = np.sqrt(2 * touch.area[touch.stick].sum() / np.pi)  # half of the circle is modelled
    exact = stick_radius_ratio(Q, P, FRICTION) * hertz.a
    print(f"Q/(friction P) {Q / (FRICTION * P):.3f}")
    print(f"traction {np.sqrt((off**2).mean()) / q.max():.1%} rms of its peak off")
    print(f"stick radius {found * 1e3:.3f} mm, closed form {exact * 1e3:.3f} mm")
