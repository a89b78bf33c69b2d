# SPDX-License-Identifier: LGPL-3.0-or-later
"""How much faster than the rail does the rim of a driven wheel run? Carter's answer of 1926.

In plane strain the traction Q needs the creepage −(friction a/R)(1 − √(1 − Q/(friction P))). The
leading part of the contact sticks, over the share √(1 − Q/(friction P)) of its width.

    python examples/carter.py [CREEPAGE ...] [FIGURE.png]
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

from contact.theory import (
    carter_creepage,
    carter_stick_ratio,
    carter_traction,
    contact_modulus,
    hertz_line,
)
from workflow import Scene, run

FRICTION, RADIUS, SPEED = 0.3, 0.46, 80.0  # [-], [m], [m/s]


def rolled(creepage: float):
    """Return the footprint at the end, its cell size, and P and Q per length of the last tenth."""
    spin = [0.0, SPEED * (1 + creepage) / RADIUS, 0.0]
    scene = Scene.load("carter", **{"driven.roller.spin": spin, "output.fields": False})
    rows, kept = [], []

    def watch(model):
        kept[:] = [model.pairs["touch"]]
        rows.append((kept[0].normal_force, kept[0].tangential_force[0]))

    with tempfile.TemporaryDirectory() as folder:
        run(scene, Path(folder) / "run", watch=watch, quiet=True)
    P, Q = np.mean(rows[-len(rows) // 10 :], axis=0) / scene.mesh.y[1]
    return kept[0].footprint(stick_tolerance=0.02), scene.mesh.size, P, Q


def figure(path, touch, hertz, ratio):
    """Save the traction over the contact, Carter's behind it."""
    from matplotlib.figure import Figure

    fig = Figure(figsize=(5, 3.2), layout="constrained")
    ax, line = fig.subplots(), np.linspace(-hertz.a, hertz.a, 400)
    exact = carter_traction(line, hertz, ratio, FRICTION)
    ax.plot(line * 1e3, exact / 1e6, lw=3, color="0.7", label="Carter")
    ax.plot(
        line * 1e3, FRICTION * hertz.pressure(line) / 1e6, "--", color="0.5", label="friction p"
    )
    traction = np.abs(touch.tangential_force[:, 0]) / touch.area
    ax.plot(touch.position[:, 0] * 1e3, traction / 1e6, ".", ms=4, label="contact nodes")
    ax.set(xlabel="along the rail, rolling to the right [mm]", ylabel="shear traction [MPa]")
    ax.set_ylim(bottom=0)
    ax.legend()
    fig.savefig(path, dpi=150)


if __name__ == "__main__":
    words = sys.argv[1:]
    path = words.pop() if words and words[-1].endswith(".png") else None
    for creepage in [float(word) for word in words] or [7.6e-4]:
        touch, size, P, Q = rolled(creepage)
        hertz = hertz_line(P, RADIUS, contact_modulus(210e9, 0.3, 210e9, 0.3))
        ratio = carter_stick_ratio(Q, P, FRICTION)
        width = np.ptp(touch.position[touch.stick, 0]) + size
        exact = -carter_creepage(Q, P, FRICTION, hertz.a, RADIUS)
        print(f"Q/(friction P) {abs(Q) / (FRICTION * P):.3f}")
        print(f"stick width {1e3 * width:.2f} mm, closed form {2e3 * ratio * hertz.a:.2f} mm")
        print(f"creepage {creepage:.3e}, closed form {exact:.3e}, {creepage / exact - 1:+.1%}")
    if path:
        figure(path, touch, hertz, ratio)
