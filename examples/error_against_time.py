# SPDX-License-Identifier: LGPL-3.0-or-later
"""How much error does a second of computing buy? Mesh size and contact spring of two closed forms.

A bar stays at a wall for 2 L/c, a sphere is pressed on a flat (Hertz's pressure, rms inside 0.7 of
his radius). A small ``time.safety`` makes the contact spring ``penalty · m / dt²`` stiff. More
scenes, elements, precision and contact: ``squealx study error-vs-runtime``.

    python examples/error_against_time.py [FOLDER] [--quick]
"""

import sys
import tempfile
from pathlib import Path

from matplotlib.figure import Figure

from workflow import Scene, run

SCENES = {"bar": "bar-impact", "sphere": "hertz"}
SIZES = {"bar": [2.5e-3, 1.25e-3, 6.25e-4], "sphere": [1e-3, 5e-4, 2.5e-4]}
SAFETIES = {"bar": [0.9, 0.5], "sphere": [0.5, 0.25, 0.1]}
EVERY_STEP = 1e-9  # s, shorter than any step


def table(quick: bool = False) -> list[tuple]:
    """Print and return scene, size, safety, error, wall seconds, and cells times steps."""
    rows = []
    print("scene   size mm  safety    error   wall s   cells x steps")
    for name, scene in SCENES.items():
        for safety in SAFETIES[name]:
            for size in SIZES[name][: 2 if quick else 3]:
                keys = {"mesh.size": size, "time.safety": safety}
                keys |= {"output.fields": False, "output.sample_interval": EVERY_STEP}
                with tempfile.TemporaryDirectory() as folder:
                    s = run(Scene.load(scene, **keys), folder, quiet=True).summary
                    error = abs(s["expected"][0]["error"])
                rows.append((name, size, safety, error, s["wall_seconds"], s["cells"] * s["steps"]))
                _, *n = rows[-1]
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
