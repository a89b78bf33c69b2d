# SPDX-License-Identifier: LGPL-3.0-or-later
"""Why does a door creak? What is pulled through a spring over a dry plane sticks and jumps.

The spring winds up until it has the friction at rest, and the block jumps ahead on the lower
friction in slip, from rest to rest: a half swing of the mass on its spring and a little more.
With the pull k V t and the drop of friction D the time between two jumps is

    2 D/(k V) + 2 (π − arctan(D ω/(k V)))/ω,  ω = √(k/m).

    python examples/stick_slip.py
"""

import tempfile
from pathlib import Path

import numpy as np

from contact.theory import stick_slip_period
from workflow import Scene, run

if __name__ == "__main__":
    rows = []

    def watch(model):
        """Keep what every step is judged by."""
        spring, state = model.connections.links[0], model.state
        stretch = spring.stretch(state.u.x.array, model.connections.masses.u)
        pull = -(spring.stiffness * stretch)[0, 0]
        rows.append((state.t, pull, model.mass.array[::3].sum()))

    scene = Scene.load("stick-slip", **{"output.fields": False})
    with tempfile.TemporaryDirectory() as folder:
        result = run(scene, Path(folder) / "run", watch=watch, quiet=True)
        balance = np.abs(result.history["balance_error"]).max()
    t, pull, mass = np.array(rows).T
    law, spring, mesh = scene.contacts["sole"].friction, scene.springs[0], scene.mesh
    press = -scene.loads[0].traction[2] * mesh.length * mesh.width
    middle, drop = law.kinetic * press, (law.static - law.kinetic) * press
    up = np.flatnonzero((pull[:-1] < middle) & (pull[1:] >= middle))
    found = np.diff([np.interp(middle, pull[i : i + 2], t[i : i + 2]) for i in up])
    exact = stick_slip_period(spring.velocity[0], spring.stiffness[0], mass[0], drop)
    print(f"pull {pull.min():.1f} to {pull.max():.1f} N about {middle:.1f} N")
    print(f"energy balance {balance:.1e}")
    for period in found:
        print(
            f"period {1e3 * period:.3f} ms, exact {1e3 * exact:.3f} ms, {period / exact - 1:+.2%}"
        )
