# SPDX-License-Identifier: LGPL-3.0-or-later
"""Where does a driven wheel stick to the rail, and where does it slip? Ask CONTACT.

Under 100 kN a wheel of 460 mm touches a rail crown of 300 mm in an ellipse of 14 by 11 mm. The
half-space code CONTACT gives its creepage, its stick zone and the shear on the centre line; here
the wheel is rolled with that creepage. Finite elements know its radius: it rolls as if that were
less by a third of what the wheel is pressed in, so a driven one pulls a little less, a braked one a
little more.

    python examples/tread_rolling.py [--case 1..5] [--braked] [--out FIGURE.png]
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np

from workflow import Scene, run

DATA = Path(__file__).parent.parent / "tests" / "data"
RADIUS, SPEED = 0.46, 40.0  # [m], [m/s]


def contact(case: int):
    """Return row and centre line of a case as CONTACT found them."""
    tables = [
        np.genfromtxt(DATA / f"contact_tread_{name}.csv", delimiter=",", skip_header=1, names=True)
        for name in ("rolling_summary", "rolling_centreline")
    ]
    row, line = (table[table["case"] == case] for table in tables)
    return row[0], line


def rolled(creepage: float, friction: float, shift: float):
    """Return the footprint at the end, and normal and tangential force of the last tenth [N]."""
    changes = {
        "driven.wheel.spin": [0.0, SPEED * (1 + creepage) / RADIUS, 0.0],
        "driven.wheel.shift": [-shift, 0.0, 0.0],
        "contacts.touch.friction": friction,
        "output.fields": False,
    }
    rows, kept = [], []

    def watch(model):
        kept[:] = [model.pairs["touch"]]
        rows.append((kept[0].normal_force, kept[0].tangential_force[0]))

    with tempfile.TemporaryDirectory() as folder:
        run(Scene.load("tread-rolling", **changes), Path(folder) / "run", watch=watch, quiet=True)
    P, Q = 2 * np.mean(rows[-len(rows) // 10 :], axis=0)  # half of the contact is modelled
    return kept[0].footprint(stick_tolerance=0.02), P, Q


def figure(path, x, p, q, stick, line, friction):
    """Save pressure and shear on the centre line, those of CONTACT behind."""
    from matplotlib.figure import Figure

    fig = Figure(figsize=(5, 3.2), layout="constrained")
    ax = fig.subplots()
    ax.plot(line["x_mm"], line["p_MPa"], lw=3, color="0.85", label="pressure, CONTACT")
    ax.plot(line["x_mm"], friction * line["p_MPa"], "--", color="0.5", label="friction p")
    ax.plot(line["x_mm"], line["q_x_MPa"], lw=3, color="0.65", label="shear, CONTACT")
    ax.plot(1e3 * x, p / 1e6, ".", color="C0", label="pressure, nodes")
    for sticks, mark, name in ((True, "o", "shear, nodes that stick"), (False, "^", "and slip")):
        here = stick == sticks
        ax.plot(1e3 * x[here], q[here] / 1e6, mark, color="C1", ms=4, label=name)
    ax.set(xlabel="along the rail, rolling to the right [mm]", ylabel="stress [MPa]")
    ax.set_ylim(0, 1.4 * p.max() / 1e6)
    ax.legend(ncols=2, fontsize="small", frameon=False, loc="upper center")
    fig.savefig(path, dpi=150)


if __name__ == "__main__":
    words = argparse.ArgumentParser()
    words.add_argument("--case", type=int, choices=range(1, 6), default=2)
    words.add_argument("--braked", action="store_true")
    words.add_argument("--out", type=Path)
    asked = words.parse_args()

    exact, line = contact(asked.case)
    way = -1 if asked.braked else 1
    shift = way * 5e-5 * exact["traction_coeff"]  # what the traction shears both bodies [m]
    touch, P, Q = rolled(way * exact["creepage_cksi"], exact["mu"], shift)
    middle = touch.position[:, 1] < 1e-9
    share = np.where(middle, 1, 2) * touch.area  # half of the contact is modelled
    stick = share[touch.stick].sum() / share.sum()
    centre = touch.normal_force @ touch.position[:, 0] / touch.normal_force.sum()
    x, p = touch.position[middle, 0] - centre, touch.pressure[middle]
    q = way * touch.tangential_force[middle, 0] / touch.area[middle]

    told = exact["traction_coeff"]
    print(f"creepage {-way * exact['creepage_cksi']:.3e}, load {P / 1e3:.1f} kN")
    print(f"traction/load {way * Q / P:.4f}, CONTACT {told:.4f}, {way * Q / P / told - 1:+.1%}")
    print(f"stick area {stick:.3f}, CONTACT {exact['stick_area_fraction']:.3f}")
    print(f"largest pressure {p.max() / 1e6:.0f} MPa, CONTACT {exact['p0_MPa_CONTACT']:.0f} MPa")
    if asked.out:
        figure(asked.out, x, p, q, touch.stick[middle], line, exact["mu"])
