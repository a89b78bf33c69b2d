# SPDX-License-Identifier: LGPL-3.0-or-later
"""The same contact on one rank and on more: forces, energies, footprints."""

import os
import sys
from pathlib import Path
from types import SimpleNamespace

from mpi4py import MPI

import numpy as np
import pytest

from contact import ContactPair, sharing
from contact.surface import surface
from meshes.domain import distribute
from meshes.tags import Tag
from tests.stacks import two_blocks

STEPS = 120
CASES = {
    "penalty": {"damping": 0.05},
    "smooth": {"damping": 0.05, "smooth": True},
    "modulus": {"damping": 0.05, "method": "modulus-penalty", "penalty": 1e-3},
    "lagrange": {"method": "lagrange"},
    "smooth lagrange": {"method": "lagrange", "smooth": True},
    "two passes": {"damping": 0.05, "two_pass": True},
    "points": {"damping": 0.05, "points": "quadrature"},
    "implicit points": {
        "method": "implicit-penalty",
        "penalty": 30.0,
        "points": "quadrature",
        "smooth": True,
    },
}


def drive(comm, **options):
    """Two blocks that slide and spin on each other; the history of forces, as HexMesh arrays."""
    domain = distribute(two_blocks() if comm.rank == 0 else None, comm)
    mass, bulk = np.full(len(domain.nodes), 1e-3), {int(Tag.BLOCK): 1.7e11}
    pair = ContactPair(
        surface(domain, 114, mass, bulk=bulk), surface(domain, [111], mass, bulk=bulk), comm=comm,
        dt=1e-6, friction=0.3, **options,
    )  # fmt: skip
    X = domain.source.points[domain.nodes]
    above = domain.nodes >= 7 * 6 * 3
    u, v = np.zeros_like(X), np.zeros_like(X)
    u[above, 2] = -1e-5
    force = SimpleNamespace(array=np.zeros(X.size))
    total, rows = np.zeros((len(domain.source.points), 3)), []
    for k in range(STEPS):
        t = k * 1e-6
        v[:] = 0.5 * np.sin(200 * X + 3e4 * t)
        v[above] += [20 * np.cos(1e4 * t), 8.0, -3.0 * np.sin(4e4 * t)]
        u += 1e-6 * v
        state = SimpleNamespace(
            u=SimpleNamespace(x=SimpleNamespace(array=u.reshape(-1))),
            v=SimpleNamespace(x=SimpleNamespace(array=v.reshape(-1))), t=t,
        )  # fmt: skip
        force.array[:] = 0.0
        pair.add(state, force, friction=k > 0)
        rows.append([pair.normal_force, *pair.tangential_force, pair.friction_dissipation,
                     pair.stored_energy, pair.active])  # fmt: skip
        total[domain.nodes[: domain.owned]] += force.array.reshape(-1, 3)[: domain.owned]
    foot = pair.footprint()
    depth, node, place = pair.penetration(state)
    return {
        "rows": np.array(rows), "total": comm.allreduce(total), "node": foot.node,
        "traction": foot.tangential_force, "position": foot.position,
        "deepest": np.array([depth, node, *place]),
    }  # fmt: skip


@pytest.mark.mpi
@pytest.mark.parametrize("count", [2, 3])
@pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="starts mpiexec itself")
def test_ranks_equal_one(mpirun, tmp_path, count):
    """Forces, energies, footprints on 1, 2, 3 ranks agree to round-off; ranks hold the same.

    There is so little in touch that ranks would not share the search: they are told to.
    """
    root = Path(__file__).parents[2]
    path = os.environ | {"PYTHONPATH": str(root)}
    mpirun(count, __file__, tmp_path, cwd=root, env=path)
    for case, options in CASES.items():
        serial = drive(MPI.COMM_SELF, **options)
        ranks = [np.load(tmp_path / f"{case}.{r}.npz") for r in range(count)]
        assert serial["rows"][:, -1].max() > 20 and np.abs(serial["rows"][:, 1]).max() > 0
        for name, expected in serial.items():
            assert all((rank[name] == ranks[0][name]).all() for rank in ranks)
            scale = np.abs(expected).max()
            assert np.abs(ranks[0][name] - expected).max() <= 1e-12 * scale, (case, name)


if __name__ == "__main__":
    sharing.LEAST = 3
    for case, options in CASES.items():
        found = drive(MPI.COMM_WORLD, **options)
        np.savez(Path(sys.argv[1]) / f"{case}.{MPI.COMM_WORLD.rank}.npz", **found)
