# SPDX-License-Identifier: LGPL-3.0-or-later
"""How far does a block slide that friction alone slows down?

Pressed with a pressure p it loses friction p/(ρ h) of speed in a second, whatever its mass, stops
after v²/2a and stays. The coefficient comes back twice: from the slope of the speed, and as lost
momentum over the impulse of the normal force that was there at each step.

    python examples/sliding_block.py
"""

import tempfile
from pathlib import Path

import numpy as np

from contact.theory import sliding_stop
from workflow import Scene, run

SPEED, FRICTION, PRESSURE, RHO = 2.0, 0.3, 10e6, 7800.0  # [m/s], [-], [Pa], [kg/m³]
SLIDING = (5e-6, 45e-6)  # after the first waves, before the stop [s]

if __name__ == "__main__":
    rows = []

    def watch(model):
        """Keep what every step is judged by: time, motion of the block, normal force."""
        dofs = model.bodies.dofs("block")
        m = model.mass.array[::3][dofs]
        # v is half a step back
        v = model.state.v.x.array + model.dt / 2 * model.state.a.array
        v, u = (a.reshape(-1, 3)[dofs, 0] for a in (v, model.state.u.x.array))
        rows.append((model.state.t, m @ u / m.sum(), m @ v, model.pairs["face"].normal_force))

    scene = Scene.load("sliding-block", **{"output.fields": False})
    with tempfile.TemporaryDirectory() as folder:
        run(scene, Path(folder) / "run", watch=watch, quiet=True)
    t, way, momentum, normal = np.array(rows).T
    length, width, height = scene.mesh.block
    mass = RHO * length * width * height
    slowed = FRICTION * PRESSURE / (RHO * height)  # [m/s²]
    far, _ = sliding_stop(SPEED, FRICTION, slowed / FRICTION)
    stop = int(np.argmax(momentum <= 0))
    print(f"stops after {(way[stop] - way[0]) * 1e6:.2f} um, v²/2a = {far * 1e6:.2f} um")
    s = (t > SLIDING[0]) & (t < SLIDING[1])
    slope = -np.polyfit(t[s], momentum[s] / mass, 1)[0] * FRICTION / slowed
    impulse = (momentum[s][0] - momentum[s][-1]) / np.trapezoid(normal[s], t[s])
    for name, found in (("slope", slope), ("impulse", impulse)):
        error = found / FRICTION - 1
        print(f"friction from {name} {found:.5f}, given {FRICTION}, error {error:+.2%}")
