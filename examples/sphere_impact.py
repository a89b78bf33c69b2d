# SPDX-License-Identifier: LGPL-3.0-or-later
"""How long do two bodies touch when they collide slowly? Much longer than a wave runs through them.

Hertz: the contact is a spring F = 4/3 E* √R δ^1.5, and the bodies part after
2.87 (m² / (R E*² v))^(1/5) with the speed they came with.

    python examples/sphere_impact.py
"""

import tempfile
from pathlib import Path

import numpy as np

from contact.theory import contact_modulus, sphere_impact_time
from workflow import Scene, run

if __name__ == "__main__":
    rows = []

    def watch(model):
        """Keep what every step is judged by."""
        dofs = model.bodies.dofs("ram")
        mass, v = model.mass.array[::3][dofs], model.state.v.x.array.reshape(-1, 3)[dofs, 2]
        rows.append((model.state.t, model.pairs["touch"].normal_force, mass @ v, mass.sum()))

    scene = Scene.load("sphere-impact", **{"output.fields": False})
    with tempfile.TemporaryDirectory() as folder:
        run(scene, Path(folder) / "run", watch=watch, quiet=True)
    t, force, momentum, mass = np.array(rows).T
    speed, radius = -scene.bodies["ram"].velocity[2], scene.mesh.radius
    print(f"restitution {momentum[-1] / (mass[0] * speed):.4f}, closed form 1")
    steel = contact_modulus(210e9, 0.3, 210e9, 0.3)
    exact = sphere_impact_time(4 * mass[0], radius, steel, speed)  # a quarter is modelled
    found = np.ptp(t[force > 0])
    print(f"contact {found * 1e6:.2f} us, Hertz {exact * 1e6:.2f} us, {found / exact - 1:+.2%}")
