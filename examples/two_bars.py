# SPDX-License-Identifier: LGPL-3.0-or-later
"""What happens between two bars that collide? A wave of stress runs into each of them.

Behind it the material moves with the mean of the two speeds: the stress is ρ c v/2, whatever the
bars are made of in the middle. It comes back from the free ends after 2L/c, and the bars part with
their speeds exchanged.

    python examples/two_bars.py
"""

import tempfile
from pathlib import Path

import numpy as np

from workflow import Scene, run

RHO, SPEED = 7800.0, 1.0  # [kg/m³], [m/s]
C = np.sqrt(210e9 / RHO)  # of a wave in a bar [m/s]

if __name__ == "__main__":
    rows = []

    def watch(model):
        """Keep what every step is judged by."""
        v = model.state.v.x.array.reshape(-1, 3)[model.bodies.dofs("base"), 2]
        rows.append((model.state.t, model.pairs["face"].normal_force, v.mean()))

    scene = Scene.load("two-bars", **{"output.fields": False})
    with tempfile.TemporaryDirectory() as folder:
        run(scene, Path(folder) / "run", watch=watch, quiet=True)
    t, force, speed = np.array(rows).T
    width, _, length = scene.mesh.block
    stay = 2 * length / C
    stress = force[(t > 0.3 * stay) & (t < 0.7 * stay)].mean() / width**2
    exact = RHO * C * SPEED / 2
    print(f"contact {np.ptp(t[force > 0]) * 1e6:.2f} us, 2L/c {stay * 1e6:.2f} us")
    print(f"speed of the struck bar {-speed[-1]:.3f} m/s, of the other before {SPEED:.3f} m/s")
    print(f"stress {stress:.4g} Pa, ρ c v/2 = {exact:.4g} Pa, error {stress / exact - 1:+.1e}")
