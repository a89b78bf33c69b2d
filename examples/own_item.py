# SPDX-License-Identifier: LGPL-3.0-or-later
"""How do I add a force of my own, with its energy in the ledger and its memory in the checkpoint?

An air spring carries a steel bar: a bellows of stiffness k, and behind an orifice c a reservoir of
stiffness k_r whose air follows late, c ẇ = k_r (x − w). The library knows nothing of it: an *item*
is a class with ``add``, and may tell its ``energy`` and its ``memory``. A bar that is thrown at it
swings with the roots s of (M s² + k) (c s + k_r) + k_r c s = 0: a frequency between those of an
open and a shut orifice, and a decay. Half way the run stops and goes on from its checkpoint.

    python examples/own_item.py
"""

import tempfile
from pathlib import Path

import numpy as np

from workflow import Scene, read_run, run

BELLOWS, RESERVOIR, ORIFICE = 1e6, 1e6, 80.0  # [N/m], [N/m], [N s/m]
SPEED, END = 1.0, 2e-3  # [m/s], [s]


class AirSpring:
    """The item: a force on the mean displacement x of the bar along its axis."""

    def __init__(self, model):
        self.comm, self.dt = model.domain.msh.comm, model.dt
        dofs = model.bodies.dofs("bar")
        mass = model.mass.array[::3][dofs]
        self.index, self.share = 3 * dofs, mass / self.comm.allreduce(mass.sum())
        self.x = self.w = self.lost = 0.0  # displacement, air that has followed, heat

    def add(self, state, force):
        """Let the air follow over the last step (midpoint rule), then press on the bar."""
        x = self.comm.allreduce(float(self.share @ state.u.x.array[self.index]))
        rate, behind = ORIFICE / self.dt, self.x - self.w
        w = (rate * self.w + RESERVOIR / 2 * (behind + x)) / (rate + RESERVOIR / 2)
        self.lost += RESERVOIR * (behind + x - w) / 2 * (w - self.w)
        self.x, self.w = x, w
        force.array[self.index] -= self.share * (BELLOWS * x + RESERVOIR * (x - w))

    def energy(self, state):
        """Return what the air stores and what the orifice has taken [J]."""
        stored = BELLOWS * self.x**2 + RESERVOIR * (self.x - self.w) ** 2
        return {"air_spring_energy": stored / 2, "orifice_energy": self.lost}

    def memory(self):
        """Return all that the next step depends on."""
        return {"air": np.array([self.x, self.w, self.lost])}

    def restore(self, memory):
        """Go on from it."""
        self.x, self.w, self.lost = map(float, memory["air"])


def roots(mass: float) -> np.ndarray:
    """Return the roots of the mass on its air spring [1/s]."""
    both = BELLOWS + RESERVOIR
    return np.roots([mass * ORIFICE, mass * RESERVOIR, both * ORIFICE, BELLOWS * RESERVOIR])


def swing(mass: float, t: np.ndarray) -> np.ndarray:
    """Return the displacement of a mass thrown at the air spring with SPEED [m]."""
    s = roots(mass)
    # x = Σ a e^(s t) with x = 0, x' = SPEED and x'' = 0 at the start
    a = np.linalg.solve(np.vander(s, increasing=True).T, [0.0, SPEED, 0.0])
    return np.real(np.exp(np.outer(t, s)) @ a)


if __name__ == "__main__":
    scene = Scene.load(
        "bar-wave",
        **{"mesh.size": 5e-3, "supports": [], "bodies.bar.velocity": [SPEED, 0.0, 0.0]},
        **{"output.fields": False, "time.output_interval": END / 100, "time.end": END},
    )
    rows = []

    def watch(model):
        """Keep mass and mean displacement of the bar at every step."""
        rows.append((model.state.t, model.items[-1].x))

    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder)
        whole = run(scene, out / "whole", items=[AirSpring], watch=watch, quiet=True).history
        half = scene.with_(**{"time.end": END / 2})
        run(half, out / "parts", items=[AirSpring], quiet=True)
        run(scene, out / "parts", items=[AirSpring], quiet=True, resume=True)
        parts = read_run(out / "parts").history

    mass = scene.bodies["bar"].material.density * scene.mesh.length * scene.mesh.width**2
    t, x = np.array(rows).T
    exact = swing(mass, t)
    s = max(roots(mass), key=np.imag)
    print(f"swings at {s.imag / 2 / np.pi:.0f} Hz, decays with {-s.real:.0f} 1/s")
    print(f"displacement: error {np.abs(x - exact).max() / np.abs(exact).max():.1e} of the largest")
    heat = whole["orifice_energy"][-1] / (mass * SPEED**2 / 2)
    print(f"heat in the orifice {heat:.3f} of the energy of the throw")
    print(f"ledger: balance error {np.abs(whole['balance_error']).max():.1e}")
    gone = max(np.abs(whole[name] - parts[name]).max() for name in whole)
    print(f"resumed half way: histories differ by {gone:.1e}")
