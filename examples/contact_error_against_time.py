# SPDX-License-Identifier: LGPL-3.0-or-later
"""Which mesh, element, contact and precision give the least error in a given time?

Four closed forms: how long a bar stays at a wall (row 8 of the verification), Hertz's pressure of
a wheel on a rail crown (13), the shear of Cattaneo and Mindlin (14), the creepage of Carter (15).
Each scene is run as shipped, then with one thing changed at a time. Runs that no other beats in
both time and error make the Pareto front. Times are those of the processor, so that other work on
the machine hardly counts.

    python examples/contact_error_against_time.py [FOLDER] [--quick]
"""

import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from contact.closed_forms import (
    bar_impact,
    carter_creepage,
    cattaneo_mindlin,
    contact_modulus,
    hertz_ellipse,
    hertz_line,
    hertz_sphere,
)
from workflow import Scene, run

E, RHO, FRICTION = 210e9, 7800.0, 0.3
STEEL = contact_modulus(E, 0.3, E, 0.3)


def stepped(scene: Scene, probe=None):
    """Run a scene; return its only pair, what ``probe`` saw at each step, and cells times steps."""
    rows, kept = [], []

    def watch(model):
        kept[:] = model.pairs.values()
        if probe:
            rows.append(probe(model, kept[0]))

    with tempfile.TemporaryDirectory() as folder:
        summary = run(scene, Path(folder) / "run", watch=watch, quiet=True).summary
    return kept[0], np.array(rows), summary["cells"] * summary["steps"]


def bar(scene: Scene) -> tuple[float, float]:
    """Contact time against 2 L/c, and cells times steps."""
    _, rows, work = stepped(scene, lambda model, pair: (model.state.t, pair.normal_force))
    force, stay = bar_impact(1.0, E, RHO, scene.mesh.width**2, scene.mesh.length)
    touching = rows[rows[:, 1] > force / 2, 0]
    return abs(np.ptp(touching) / stay - 1), work


def hertz(scene: Scene) -> tuple[float, float]:
    """Pressure inside 0.7 of Hertz's ellipse, rms over p₀, and cells times steps."""
    pair, _, work = stepped(scene)
    touch = pair.footprint()
    exact = hertz_ellipse(4 * touch.normal_force.sum(), 0.46, 0.3, STEEL)
    x, y = touch.position[:, :2].T
    off = (touch.pressure - exact.pressure(x, y))[np.hypot(x / exact.a, y / exact.b) < 0.7]
    return float(np.sqrt((off**2).mean())) / exact.p0, work


def shear(scene: Scene) -> tuple[float, float]:
    """Shear traction of Cattaneo and Mindlin, rms over its peak, and cells times steps."""
    pair, _, work = stepped(scene)
    touch, P, Q = pair.footprint(), 2 * pair.normal_force, -2 * pair.tangential_force[0]
    r = np.hypot(touch.position[:, 0], touch.position[:, 1])
    exact = cattaneo_mindlin(r, hertz_sphere(P, 0.1, STEEL), Q, P, FRICTION)
    off = -touch.tangential_force[:, 0] / touch.area - exact
    return float(np.sqrt((off**2).mean())) / exact.max(), work


def carter(scene: Scene) -> tuple[float, float]:
    """Creepage against Carter's for the traction, and cells times steps."""
    _, rows, work = stepped(scene, lambda m, pair: (pair.normal_force, pair.tangential_force[0]))
    P, Q = rows[-len(rows) // 10 :].mean(axis=0) / scene.mesh.y[1]
    exact = carter_creepage(Q, P, FRICTION, hertz_line(P, 0.46, STEEL).a, 0.46)
    speed = -scene.driven["block"].velocity[0]
    return abs((1 - scene.driven["roller"].spin[1] * 0.46 / speed) / exact - 1), work


# scene, its bodies, its contact, its sizes [m] (the shipped one first)
CASES = {
    bar: ("bar-impact", ["bar"], "wall", [1.25e-3, 2.5e-3, 6.25e-4]),
    hertz: ("hertz-ellipse", ["wheel", "rail"], "touch", [7e-4, 1.4e-3, 1e-3]),
    shear: ("cattaneo-mindlin", ["sphere", "flat"], "touch", [2.5e-4, 3.6e-4, 3e-4]),
    carter: ("carter", ["roller", "block"], "touch", [3e-4, 4.5e-4, 2.3e-4]),
}


def settings(case, quick: bool) -> dict[str, dict]:
    """Return changed keys by name: sizes, then one change at a time at the shipped size."""
    _, bodies, pair, sizes = CASES[case]
    found = {f"{1e3 * size:.3g} mm": {"mesh.size": size} for size in sizes}
    if quick:
        return dict(list(found.items())[:2])
    contact = f"contacts.{pair}"
    found["one point"] = {f"bodies.{body}.element": "one-point" for body in bodies}
    at_rest = {} if case is bar else {"equilibrium.tolerance": 1e-4}  # rounding is above 1e-6
    found["float32"] = {"time.precision": "float32", **at_rest}
    found["safety 0.9"] = {"time.safety": 0.9}
    found["safety 0.2"] = {"time.safety": 0.2}
    found["penalty 0.2"] = {f"{contact}.penalty": 0.2}
    found["modulus penalty"] = {
        f"{contact}.method": "modulus-penalty",
        f"{contact}.penalty": 5.0,
        "time.safety": 0.6,
    }
    if case is bar:
        found["lagrange"] = {f"{contact}.method": "lagrange", "time.safety": 0.9}
    else:
        smooth = Scene.load(CASES[case][0]).contacts[pair].smooth
        found["faceted" if smooth else "smooth"] = {
            f"{contact}.smooth": not smooth,
            "equilibrium.tolerance": 1e-3,
        }
    return found


def table(quick: bool = False) -> list[tuple]:
    """Print and return case, setting, error, seconds, and cells times steps of every run."""
    rows = []
    print("case    setting            error   cpu s  cells x steps")
    for case in list(CASES)[: 2 if quick else None]:
        for name, keys in settings(case, quick).items():
            began = time.process_time()
            try:
                scene = Scene.load(CASES[case][0], **{"output.fields": False}, **keys)
                error, work = case(scene)
            except (RuntimeError, ValueError) as stopped:
                print(f"{case.__name__:8}{name:17} {str(stopped).splitlines()[0][:80]}")
                continue
            rows.append((case.__name__, name, error, time.process_time() - began, work))
            print(
                f"{case.__name__:8}{name:17}{error:7.2%}{rows[-1][3]:8.1f}{work:15.1e}", flush=True
            )
    return rows


def front(rows: list[tuple]) -> list[tuple]:
    """Return the runs that no other of the same case beats in time and error, fastest first."""
    ahead = [r for r in rows if not any(o[2] < r[2] and o[3] < r[3] for o in rows)]
    return sorted(ahead, key=lambda row: row[3])


def figure(rows: list[tuple], path: Path) -> None:
    """Save error against processor time, a panel for each case, its front drawn."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import LogLocator, NullFormatter

    cases = list(dict.fromkeys(row[0] for row in rows))
    columns = min(2, len(cases))
    fig = Figure(figsize=(5.5 * columns, 3.6 * -(-len(cases) // columns)), layout="constrained")
    axes = np.atleast_1d(fig.subplots(-(-len(cases) // columns), columns)).ravel()
    names = list(dict.fromkeys(row[1] for row in rows if not row[1].endswith(" mm")))
    for ax, case in zip(axes, cases, strict=False):
        own = [row for row in rows if row[0] == case]
        best = front(own)
        ax.loglog([r[3] for r in best], [100 * r[2] for r in best], "-", color="0.7", lw=3)
        for k, (_, name, error, seconds, _) in enumerate(own):
            at = names.index(name) if name in names else None
            look = (
                {"marker": "o", "ms": 10 - 2 * k} if at is None else {"marker": "svD<P*X^>"[at % 9]}
            )
            colour = "k" if at is None else f"C{at}"
            ax.plot(seconds, 100 * error, ls="", color=colour, label=name, **look)
        for axis in (ax.xaxis, ax.yaxis):
            axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
            axis.set_major_formatter("{x:g}")
            axis.set_minor_formatter(NullFormatter())
        title = next(solve.__doc__ for solve in CASES if solve.__name__ == case)
        ax.set(xlabel="processor time [s]", ylabel="error [%]")
        ax.set_title(title.split(",")[0].split(" and cells")[0], fontsize=10)
        ax.grid(True, which="major", lw=0.3)
        ax.legend(fontsize=7, loc="center left", bbox_to_anchor=(1, 0.5))
    path.parent.mkdir(parents=True, exist_ok=True)
    fig.savefig(path, dpi=150)


if __name__ == "__main__":
    words = [word for word in sys.argv[1:] if word != "--quick"]
    found = table("--quick" in sys.argv)
    for case in dict.fromkeys(row[0] for row in found):
        best = front([row for row in found if row[0] == case])
        print(f"front of {case}: {', '.join(row[1] for row in best)}")
    target = Path(words[0]) if words else Path(__file__).parent
    figure(found, target / "contact_error_against_time.png")
