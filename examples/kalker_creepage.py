# SPDX-License-Identifier: LGPL-3.0-or-later
"""Which force steers a wheelset? That of a creepage of parts per thousand.

Kalker (1967): F = −c₁₁ G a b ξ for a small longitudinal creepage ξ, the coefficient from his table
for the shape of the ellipse. A wheel rolls on a rail crown with its rim a little too fast.

    python examples/kalker_creepage.py
"""

import tempfile
from pathlib import Path

import numpy as np

from contact.theory import contact_modulus, creep_force, hertz_ellipse, kalker
from workflow import Scene, run

E, NU, RADIUS, CROWN = 210e9, 0.3, 0.46, 0.3

if __name__ == "__main__":
    rows = []

    def watch(model):
        """Keep what every step is judged by."""
        pair = model.pairs["touch"]
        rows.append((pair.normal_force, pair.tangential_force[0]))

    scene = Scene.load("kalker-creepage", **{"output.fields": False})
    with tempfile.TemporaryDirectory() as folder:
        run(scene, Path(folder) / "run", watch=watch, quiet=True)
    P, F = 2 * np.mean(rows[-len(rows) // 5 :], axis=0)  # half of the contact is modelled

    hertz = hertz_ellipse(P, RADIUS, CROWN, contact_modulus(E, NU, E, NU))
    speed, G = -scene.driven["rail"].velocity[0], E / (2 * (1 + NU))
    creepage = 1 - scene.driven["wheel"].spin[1] * RADIUS / speed
    linear = creep_force((creepage, 0.0, 0.0), (hertz.a, hertz.b), G, NU)[0]
    c11 = kalker.coefficient("c11", hertz.a / hertz.b, NU)
    print(f"creepage {creepage:.2e}, force {F:.0f} N, linear theory {linear:.0f} N")
    print(f"c11 {c11 * F / linear:.3f}, Kalker {c11:.3f}, {F / linear - 1:+.1%}")
