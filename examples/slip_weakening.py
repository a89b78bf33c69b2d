# SPDX-License-Identifier: LGPL-3.0-or-later
"""Does the answer depend on the time step? Where friction falls with the slip rate, it does.

Shear the sole of a bar by 0.3 of what friction at rest can bear and let go: it must stay. A
contact takes up its load within a step, at a speed that goes with the step; friction that falls
with that speed lets go. Friction that needs a slip of d_c to fall does not. Under 1.5 of what
friction at rest can bear the bar slides off alike for any step and mesh. After a slip x the heat
per area is

    p (f_k x + (f_s − f_k) d_c (1 − exp(−x/d_c))).

    python examples/slip_weakening.py
"""

import tempfile
from pathlib import Path

import numpy as np

from workflow import Scene, run

SIZE, SAFETY, PRESSURE = 2.5e-3, 0.45, 20e6


def slipped(shear: float, size: float, safety: float, memory: bool) -> tuple[float, float]:
    """Return slip of the sole [m] and heat [J] after 0.1 ms under a shear stress [Pa]."""
    keys = {"mesh.size": size, "time.safety": safety, "output.fields": False}
    keys["loads"] = [{"surface": "zmax", "traction": [shear, 0.0, -PRESSURE]}]
    if not memory:
        keys["contacts.sole.friction.memory"] = None
    kept = []

    def watch(model):
        """Keep the model, and where its sole is at the start."""
        if not kept:
            z = model.domain.V.tabulate_dof_coordinates()[: model.domain.owned, 2]
            sole = np.flatnonzero(z < z.min() + 1e-6)
            kept.extend([model, sole, model.state.u.x.array[3 * sole].mean()])

    with tempfile.TemporaryDirectory() as folder:
        scene = Scene.load("slip-weakening", **keys)
        run(scene, Path(folder) / "run", watch=watch, quiet=True)
    model, sole, before = kept
    slip = model.state.u.x.array[3 * sole].mean() - before
    return float(slip), model.pairs["sole"].friction_dissipation


if __name__ == "__main__":
    law = Scene.load("slip-weakening").contacts["sole"].friction
    weak, strong = 0.3 * law.static * PRESSURE, 1.5 * law.static * PRESSURE
    coarse, fine = (SIZE, SAFETY), (SIZE, SAFETY / 8)
    for memory in (False, True):
        stays = [1e6 * slipped(weak, *at, memory)[0] for at in (coarse, fine)]
        name = "with memory" if memory else "without memory"
        print(f"stays {name}: {stays[0]:.3f} um, at an eighth of the step {stays[1]:.3f} um")
    found = [slipped(strong, *at, True) for at in (coarse, fine, (SIZE / 2, SAFETY))]
    for name, (slip, heat) in zip(("", ", dt/8", ", h/2"), found, strict=True):
        print(f"slides{name}: {1e6 * slip:.1f} um, {heat:.4f} J")
    spread = np.ptp(found, axis=0) / np.min(found, axis=0)
    print(f"spread {spread[0]:.1%} of the slip, {spread[1]:.1%} of the heat")
    slip, heat = found[1]
    part = (law.static - law.kinetic) * law.memory.length * -np.expm1(-slip / law.memory.length)
    exact = PRESSURE * (law.kinetic * slip + part) * 0.1 * 0.01
    print(f"heat {heat:.4f} J, closed form {exact:.4f} J, {heat / exact - 1:+.2%}")
