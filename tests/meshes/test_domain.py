# SPDX-License-Identifier: LGPL-3.0-or-later
"""A HexMesh as a distributed DOLFINx mesh: same nodes, cells, regions; serial and on ranks."""

from dataclasses import replace

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem

from forms.elasticity import full
from forms.kernel import CellIntegral
from meshes.domain import Domain, distribute
from meshes.hexmesh import HexMesh, join
from meshes.shapes import blocks
from meshes.tags import Tag, tag


def two() -> HexMesh:
    """A distorted block of 6 m³ and one of 1 m³ with another region, cells in random order."""
    first = blocks.block((0, 0, 0), (1, 2, 3), cells=(3, 4, 5))
    second = blocks.block((2, 0, 0), (3, 1, 1), cells=(2, 3, 2), region=Tag.BASE)
    mesh = join(blocks.distorted(first, seed=1), blocks.distorted(second, seed=2))
    order = np.random.default_rng(3).permutation(len(mesh.cells))
    return replace(mesh, cells=mesh.cells[order], regions=mesh.regions[order])


@pytest.fixture(scope="module")
def domain() -> Domain:
    return distribute(two(), MPI.COMM_WORLD)


def volume(domain: Domain, *regions: Tag) -> float:
    one = fem.Constant(domain.msh, 1.0)
    dx = full(domain.msh, domain.regions, tuple(map(int, regions)))
    return CellIntegral(one * dx(metadata={"quadrature_degree": 3}))()


def test_every_local_dof_sits_on_its_mesh_node(domain):
    """Positions of owned and ghost dofs are those of ``source.points[nodes]``."""
    x = domain.V.tabulate_dof_coordinates()
    np.testing.assert_allclose(x, domain.source.points[domain.nodes], rtol=0, atol=1e-14)


def test_every_node_is_owned_once(domain):
    """Over all ranks the owned blocks are a permutation of the mesh nodes."""
    owned = np.concatenate(domain.msh.comm.allgather(domain.nodes[: domain.owned]))
    np.testing.assert_array_equal(np.sort(owned), np.arange(len(domain.source.points)))


def test_local_dofs_find_owned_nodes_only(domain):
    """``local_dofs`` inverts ``nodes`` where this rank owns the node and says -1 elsewhere."""
    every = np.arange(len(domain.source.points))
    dofs = domain.local_dofs(every)
    mine = dofs >= 0
    assert mine.sum() == domain.owned and dofs.max() < domain.owned
    np.testing.assert_array_equal(domain.nodes[dofs[mine]], every[mine])


def test_regions_and_cells_keep_their_shape(domain):
    """Volumes 6 and 1 m³ of the two regions; every Jacobian positive (node order translated)."""
    assert volume(domain, Tag.BLOCK) == pytest.approx(6, rel=1e-13)
    assert volume(domain, Tag.BASE) == pytest.approx(1, rel=1e-13)
    points = np.array([[i, j, k] for i in (0.0, 1.0) for j in (0.0, 1.0) for k in (0.0, 1.0)])
    cells = np.arange(domain.msh.topology.index_map(3).size_local, dtype=np.int32)
    jacobian = fem.Expression(ufl.JacobianDeterminant(domain.msh), points)
    assert jacobian.eval(domain.msh, cells).min() > 0


@pytest.mark.mpi
@pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="is itself on ranks")
@pytest.mark.parametrize("ranks", [2, 3])
def test_all_this_also_holds_on_ranks(tests_on, ranks):
    """The other tests of this file under ``mpiexec``."""
    done = tests_on(ranks, __file__)
    assert done.stdout.count(" passed") == ranks


def test_tags_are_found_in_any_case_and_unknown_ones_listed():
    """``tag`` reads the scene's spelling."""
    assert tag("rail_head") is tag("Rail_Head") is Tag.RAIL_HEAD
    with pytest.raises(ValueError, match=r"'roof'; known: TYRE, WEB"):
        tag("roof")
