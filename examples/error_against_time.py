# SPDX-License-Identifier: LGPL-3.0-or-later
"""How much error does a second of computing buy? Mesh size and contact spring of two closed forms.

A bar hits a wall (impulse 2 m v), a sphere is pressed on a flat (Hertz's pressure, rms inside 0.7
of his radius). A small ``time.safety`` makes the contact spring ``penalty · m / dt²`` stiff.

    python examples/error_against_time.py [FOLDER] [--quick]
"""

import sys
import tempfile
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from contact.closed_forms import bar_impact, contact_modulus, hertz_sphere
from workflow import Scene, run
from workflow.recorded import Record

E, RHO = 210e9, 7800.0  # steel [Pa], [kg/m³]
SIZES = {"bar": [2.5e-3, 1.25e-3, 6.25e-4], "sphere": [1e-3, 5e-4, 2.5e-4]}
SAFETIES = {"bar": [0.9, 0.5], "sphere": [0.5, 0.25, 0.1]}


def bar(folder: Path, changes: dict) -> tuple[float, dict]:
    """Error of the impulse, and the summary of the run."""
    pushes: list[float] = []

    def watch(model):
        pushes.append(model.pairs["wall"].normal_force * model.dt)

    summary = run(Scene.load("bar-impact", **changes), folder, watch=watch, quiet=True).summary
    return abs(sum(pushes) / np.prod(bar_impact(1.0, E, RHO, 0.005**2, 0.1)) - 1), summary


def sphere(folder: Path, changes: dict) -> tuple[float, dict]:
    """Error of the pressure inside 0.7 of Hertz's radius, and the summary of the run."""
    summary = run(Scene.load("hertz", **changes), folder, quiet=True).summary
    hertz = hertz_sphere(7.69e6 * 0.04**2, 0.1, contact_modulus(E, 0.3, E, 0.3))
    patch = Record(folder).contacts["touch"].patches[0][1]  # of the state at rest
    r = np.hypot(*patch.position[:, :2].T)
    off = (patch.pressing / patch.areas - hertz.pressure(r))[r < 0.7 * hertz.a]
    return float(np.sqrt(np.mean(off**2))) / hertz.p0, summary


def table(quick: bool = False) -> list[tuple]:
    """Print and return scene, size, safety, error, wall seconds, and cells times steps."""
    rows = []
    print("scene   size mm  safety    error   wall s   cells x steps")
    for solve in (bar, sphere):
        for safety in SAFETIES[solve.__name__]:
            for size in SIZES[solve.__name__][: 2 if quick else 3]:
                keys = {"mesh.size": size, "time.safety": safety, "output.fields": False}
                with tempfile.TemporaryDirectory() as folder:
                    error, s = solve(Path(folder), keys)
                cost = s["wall_seconds"], s["cells"] * s["steps"]
                rows.append((solve.__name__, size, safety, error, *cost))
                name, *n = rows[-1]
                print(f"{name:7}{1e3 * n[0]:8.3f}{n[1]:8}{n[2]:9.2%}{n[3]:9.1f}{n[4]:16.1e}")
    return rows


def figure(rows: list[tuple], path: Path) -> None:
    """Save error against wall time, a line for each scene and safety."""
    fig = Figure(figsize=(7, 4), layout="constrained")
    ax = fig.subplots()
    for name, safety in sorted({(row[0], row[2]) for row in rows}):
        points = [(row[4], row[3]) for row in rows if (row[0], row[2]) == (name, safety)]
        ax.semilogy(*zip(*points, strict=True), "o-", label=f"{name}, safety {safety}")
    ax.set(xlabel="wall time [s]", ylabel="error against the closed form")
    fig.legend(loc="outside right upper")
    path.parent.mkdir(parents=True, exist_ok=True)
    fig.savefig(path, dpi=150)


if __name__ == "__main__":
    target = Path(next((a for a in sys.argv[1:] if a != "--quick"), Path(__file__).parent))
    figure(table("--quick" in sys.argv), target / "error_against_time.png")
