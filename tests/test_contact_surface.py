# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact surfaces of a distributed mesh; the same contact on one rank and on two."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

from mpi4py import MPI

import numpy as np
import pytest

from contact import ContactPair, rigid_plane
from contact.arrays import view
from contact.normal_law import node_foundation
from contact.surface import surface
from meshes.domain import distribute
from meshes.hexmesh import HexMesh, boundary, join
from meshes.tags import Tag

STEPS = 120


def block(n, low, high, first):
    """A block of hexahedra whose top and bottom are tagged ``first`` and ``first + 1``."""
    axes = [np.linspace(a, b, k + 1) for a, b, k in zip(low, high, n, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), 3).reshape(-1, 3)
    ids = np.arange(len(points)).reshape([k + 1 for k in n])
    i, j = slice(None, -1), slice(1, None)
    corners = [
        (i, i, i),
        (j, i, i),
        (j, j, i),
        (i, j, i),
        (i, i, j),
        (j, i, j),
        (j, j, j),
        (i, j, j),
    ]
    cells = np.stack([ids[c] for c in corners], 3).reshape(-1, 8)
    quads = boundary(cells)
    z = points[quads][:, :, 2]
    top, bottom = (z == high[2]).all(axis=1), (z == low[2]).all(axis=1)
    tags = np.concatenate([np.full(top.sum(), first), np.full(bottom.sum(), first + 1)])
    return HexMesh(
        points, cells, np.full(len(cells), Tag.BLOCK, dtype=np.int32),
        np.vstack([quads[top], quads[bottom]]), tags.astype(np.int32),
    )  # fmt: skip


def two_blocks():
    lower = block((6, 5, 2), (0, 0, -0.02), (0.06, 0.05, 0.0), 111)
    upper = block((7, 6, 2), (0.008, 0.007, 0.0), (0.05, 0.04, 0.015), 113)
    lower.points[:, 2] += 4e-5 * np.sin(100 * lower.points[:, 0])
    return join(lower, upper)


CASES = {
    "penalty": {"damping": 0.05},
    "smooth": {"damping": 0.05, "smooth": True},
    "modulus": {"damping": 0.05, "method": "modulus-penalty", "penalty": 1e-3},
    "lagrange": {"method": "lagrange"},
    "smooth lagrange": {"method": "lagrange", "smooth": True},
    "two passes": {"damping": 0.05, "two_pass": True},
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
@pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="starts mpiexec itself")
def test_two_ranks_equal_one(tmp_path):
    """Forces, energies and footprints on 1 and 2 ranks agree to round-off; ranks hold the same."""
    mpiexec = Path(sys.executable).parent / "mpiexec"
    here = Path(__file__)
    subprocess.run(
        [str(mpiexec), "-n", "2", sys.executable, str(here), str(tmp_path)],
        check=True, timeout=60, cwd=here.parents[1],
        env=os.environ | {"PYTHONPATH": str(here.parents[1])},
    )  # fmt: skip
    for case, options in CASES.items():
        serial = drive(MPI.COMM_SELF, **options)
        ranks = [np.load(tmp_path / f"{case}.{r}.npz") for r in range(2)]
        assert serial["rows"][:, -1].max() > 20 and np.abs(serial["rows"][:, 1]).max() > 0
        for name, expected in serial.items():
            assert (ranks[0][name] == ranks[1][name]).all()
            scale = np.abs(expected).max()
            assert np.abs(ranks[0][name] - expected).max() <= 1e-12 * scale, (case, name)


def test_foundation_modulus():
    """Bulk modulus over the height of the cell, also where cells are sheared and graded."""
    mesh = block((3, 2, 4), (0, 0, 0), (0.03, 0.02, 0.02), 111)
    z = mesh.points[:, 2].copy()
    mesh.points[:, 2] = 0.02 * (z / 0.02) ** 2  # top cells are 0.02 (1 - 0.75^2) high
    mesh.points[:, 0] += 0.3 * z
    domain = distribute(mesh, MPI.COMM_SELF)
    mass = np.ones(len(domain.nodes))
    top = surface(domain, 111, mass, bulk={int(Tag.BLOCK): 2.0})
    assert top.foundation == pytest.approx(np.full(6, 2.0 / (0.02 * (1 - 0.75**2))), rel=1e-12)
    assert node_foundation(top) == pytest.approx(np.full(12, top.foundation[0]), rel=1e-12)
    with pytest.raises(ValueError, match="no bulk modulus for regions"):
        surface(domain, 111, mass, bulk={int(Tag.BASE): 2.0})


def test_surface_of_a_domain():
    """Nodes ascending, facets facing outward, masses and dofs of the right nodes."""
    domain = distribute(two_blocks(), MPI.COMM_SELF)
    mass = 1.0 + domain.nodes.astype(float)
    top = surface(domain, [111], mass, name="top")
    assert (np.diff(top.nodes) > 0).all() and top.facets.dtype == np.int32
    assert (top.mass == 1.0 + top.nodes).all()
    assert (domain.nodes[top.dofs] == top.nodes).all()
    a, b, c = (top.reference[top.facets[:, k]] for k in range(3))
    assert (np.cross(b - a, c - a)[:, 2] > 0).all()
    assert len(surface(domain, (111, 114), mass).facets) == 30 + 42


def test_bad_surfaces():
    mesh = two_blocks()
    domain = distribute(mesh, MPI.COMM_SELF)
    mass = np.ones(len(domain.nodes))
    with pytest.raises(ValueError, match="no facets with tags"):
        surface(domain, 199, mass)
    with pytest.raises(ValueError, match="expected one value per local node"):
        surface(domain, 111, mass[:-1])
    with pytest.raises(ValueError, match="positive nodal masses"):
        surface(domain, 111, 0.0 * mass)
    folded = mesh.points.copy()
    folded[mesh.facets[0, 0]] = mesh.points[mesh.facets[0, 2]]
    with pytest.raises(ValueError, match="degenerate"):
        surface(replace(domain, source=mesh.moved(folded)), 111, mass)
    with pytest.raises(ValueError, match="half_width"):
        rigid_plane((0, 0, 0), (0, 0, 1), -1.0)
    with pytest.raises(ValueError, match="point and a direction"):
        rigid_plane((0, 0, 0), (0, 0, 0), 1.0)


def test_view_refuses_other_arrays():
    a = np.zeros((4, 3))
    view("x", a, (-1, 3))
    for bad, message in (
        (a.astype(np.float32), "expected float64"),
        (a[:, :2], "got float64"),
        (np.asfortranarray(np.ones((4, 3))), "C order"),
    ):
        with pytest.raises(ValueError, match=message):
            view("x", bad, (4, 3))
    a.flags.writeable = False
    with pytest.raises(ValueError, match="read-only"):
        view("x", a, (4, 3), out=True)


def test_import_is_light():
    """``import contact`` loads neither NumPy nor the kernel."""
    code = "import sys, contact; sys.exit('numpy' in sys.modules)"
    root = str(Path(__file__).parents[1])
    subprocess.run([sys.executable, "-c", code], check=True, cwd=root)


if __name__ == "__main__":
    for case, options in CASES.items():
        found = drive(MPI.COMM_WORLD, **options)
        np.savez(Path(sys.argv[1]) / f"{case}.{MPI.COMM_WORLD.rank}.npz", **found)
