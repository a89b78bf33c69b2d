# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact surfaces of a distributed mesh: nodes, facets, masses, moduli, refusals."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

from contact import rigid_plane
from contact.arrays import view
from contact.normal_law import node_foundation
from contact.surface import surface
from meshes.domain import distribute
from meshes.tags import Tag
from tests.stacks import block, two_blocks


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
    root = str(Path(__file__).parents[2])
    subprocess.run([sys.executable, "-c", code], check=True, cwd=root)
