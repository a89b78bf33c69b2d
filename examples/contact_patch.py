# SPDX-License-Identifier: LGPL-3.0-or-later
"""How even is the pressure between two meshes that do not match?

Two blocks are pressed together; the exact pressure is uniform. Nodes of the upper mesh on facets of
the lower one transfer forces, not pressure, so some error stays however fine the meshes are. The
side with the smaller cells should be the contactor, or each side once (two passes).

    python examples/contact_patch.py
"""

from mpi4py import MPI

import numpy as np

from workflow import Scene, build, rest

LOAD = 100e6  # [Pa]


def scatter(size: float, base_size: float, two_pass: bool) -> tuple[float, float]:
    """Return rms and largest error of the nodal pressures, in shares of the load."""
    keys = {"mesh.size": size, "mesh.base_size": base_size, "contacts.face.two_pass": two_pass}
    model = build(Scene.load("contact-patch", **keys), MPI.COMM_SELF)
    rest(model)
    touch = model.pairs["face"].footprint()
    off = touch.pressure / LOAD - 1
    return float(np.sqrt(touch.area @ off**2 / touch.area.sum())), float(np.abs(off).max())


if __name__ == "__main__":
    print("contactor mm  target mm  passes     rms  largest")
    for two_pass in (False, True):
        for size, base_size in ((2.5e-3, 3.1e-3), (1.25e-3, 1.55e-3), (3.1e-3, 2.5e-3)):
            rms, most = scatter(size, base_size, two_pass)
            print(f"{1e3 * size:12.2f}{1e3 * base_size:11.2f}{1 + two_pass:8}{rms:8.1%}{most:9.1%}")
    print("exact: 0")
