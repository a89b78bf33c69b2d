# SPDX-License-Identifier: LGPL-3.0-or-later
"""How large is the contact of a wheel on a rail, and how hard is it pressed?

Hertz (1882): an ellipse with a pressure p₀ √(1 − x²/a² − y²/b²), so that p² is linear in x² and y².
Half axes and p₀ are those of the plane through the nodal pressures.

    python examples/hertz_contact.py [SIZE in mm]
"""

import sys

from mpi4py import MPI

import numpy as np

from contact.theory import contact_modulus, hertz_ellipse
from workflow import Scene, build, rest

if __name__ == "__main__":
    size = 1e-3 * float(sys.argv[1]) if len(sys.argv) > 1 else 1e-3
    scene = Scene.load("hertz-ellipse", **{"mesh.size": size})
    model = build(scene, MPI.COMM_SELF)
    rest(model)  # the static solve; nothing is stepped

    touch = model.pairs["touch"].footprint()
    x, y = touch.position[:, 0], touch.position[:, 1]
    inner = touch.pressure > 0.1 * touch.pressure.max()
    plane = np.column_stack([np.ones(inner.sum()), -(x[inner] ** 2), -(y[inner] ** 2)])
    c, *_ = np.linalg.lstsq(plane, touch.pressure[inner] ** 2)
    p0, a, b = np.sqrt([c[0], c[0] / c[1], c[0] / c[2]])

    steel = contact_modulus(210e9, 0.3, 210e9, 0.3)
    exact = hertz_ellipse(4 * touch.normal_force.sum(), 0.46, 0.3, steel)
    for name, found, hertz, unit in (
        ("a", 1e3 * a, 1e3 * exact.a, "mm"),
        ("b", 1e3 * b, 1e3 * exact.b, "mm"),
        ("p0", p0 / 1e6, exact.p0 / 1e6, "MPa"),
    ):
        print(f"{name:3}{found:9.3f} {unit}, Hertz {hertz:9.3f} {unit}, {found / hertz - 1:+.2%}")
