# SPDX-License-Identifier: LGPL-3.0-or-later
"""Partitions against those of DOLFINx on ranks, bytes of a step, and predictions by hand."""

import json
import os
import sys
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

from meshes.shapes import blocks
from workflow.bench import machine_rates, partition, scaling
from workflow.bench.contact_share import ContactShare, contact_share
from workflow.bench.machine_rates import Rates
from workflow.bench.scaling import Load, Network, exchanged, judged, refined, row_of
from workflow.model.geometry import mesh_of
from workflow.scene import Scene

CELLS = (8, 4, 3)
NODES = 9 * 5 * 4
NETWORK = Network(latency=1e-6, bandwidth=1e9)


def block():
    """A block of 96 cells."""
    return blocks.block((0.0, 0.0, 0.0), (8.0, 4.0, 3.0), cells=CELLS)


def slabs(count):
    """The part of each cell where the block is cut into slabs across its longest edge."""
    x = block().points[block().cells].mean(axis=1)[:, 0]
    return (x * count / CELLS[0]).astype(np.int64)


def load(contact=ContactShare(), trees=0.0):
    """1 µs a cell, 0.1 µs a node, 2 µs of calls."""
    return Load(np.full(96, 1e-6), Rates({}, 1e-7, 2e-6), contact, trees)


def rows(counts, contact=ContactShare()):
    """Rows of the block in slabs."""
    cut = [partition.parts_of(block().cells, slabs(n), NODES, n) for n in counts]
    return [row_of(parts, load(contact), NETWORK) for parts in cut]


@pytest.mark.parametrize("count", [2, 4])
def test_slabs(count):
    """Even slabs: every cut has 5 × 4 nodes, each a ghost once; ends have one neighbour."""
    parts = partition.parts_of(block().cells, slabs(count), NODES, count)
    assert parts.imbalance == 1.0 and (parts.cells == 96 // count).all()
    assert parts.owned.sum() == NODES and parts.ghosts.sum() == 20 * (count - 1)
    assert (parts.neighbours == [1] + [2] * (count - 2) + [1]).all()
    held = parts.owned + parts.ghosts  # all nodes of its cells
    assert (held == (CELLS[0] // count + 1) * 20).all()
    assert parts.ghosts.sum() == parts.told.sum()


def test_corner_of_four_parts():
    """Four quarters: the nodes of the middle edge are held by four parts, three times as ghosts."""
    x = block().points[block().cells].mean(axis=1)
    of_cell = (2 * (x[:, 0] > 4) + (x[:, 1] > 2)).astype(np.int64)
    parts = partition.parts_of(block().cells, of_cell, NODES, 4)
    middle, cuts = 4, 4 * (8 + 4)  # 9 + 5 nodes along both cuts but for the middle, 4 high
    assert parts.ghosts.sum() == 3 * middle + cuts
    assert (parts.neighbours <= 3).all() and parts.neighbours.max() == 3


def test_imbalance():
    """Parts of 72 and 24 cells: the larger has 1.5 times the mean."""
    of_cell = (slabs(4) == 3).astype(np.int64)
    assert partition.parts_of(block().cells, of_cell, NODES, 2).imbalance == 1.5


def test_partitioner_balances():
    """The cut of DOLFINx's partitioner into 2 and 6: all parts within a tenth of the mean."""
    for parts in partition.cut(block(), (2, 6)):
        assert parts.cells.min() > 0 and parts.imbalance <= 1.1
        assert parts.owned.sum() == NODES


def test_bytes_of_a_step():
    """Two parts: a ghost costs 24 bytes of force one way and 48 of motion the other."""
    parts = partition.parts_of(block().cells, slabs(2), NODES, 2)
    first, second = parts.ghosts
    assert first + second == 20 and (parts.told == [second, first]).all()
    messages, sizes = exchanged(parts)
    most = max(24 * first + 48 * second, 48 * first + 24 * second)
    assert (sizes == most).all() and (messages == 3).all()


def test_step_by_hand():
    """Two slabs: 48 cells, the nodes of the larger, 3 messages, their bytes, contact, one tree."""
    nodes = np.arange(10)
    contact = ContactShare(5e-6, nodes=nodes, surface=30, gathers=2, searches=0.5)
    parts = partition.parts_of(block().cells, slabs(2), NODES, 2)
    row = row_of(parts, load(contact, trees=3.0), NETWORK)
    _, sizes = exchanged(parts)
    gathers = 2 * (1e-6 + 10 * 48 / 2 / 1e9) + 0.5 * (1e-6 + 30 * 48 / 2 / 1e9)
    expected = 48e-6 + parts.owned.max() * 1e-7 + 3e-6 + sizes[0] / 1e9
    expected += 5e-6 + 2e-6 + gathers + 3e-6
    assert row["step"] == pytest.approx(expected, rel=1e-12)
    assert row["contact_ranks"] == len(np.unique(parts.owner[nodes]))


def test_one_rank_talks_to_nobody():
    """No messages, bytes, gathers or reductions: 96 cells, their nodes, calls and contact."""
    (row,) = rows([1], ContactShare(5e-6, nodes=np.arange(10), surface=30, gathers=2, searches=0.5))
    assert row["step"] == pytest.approx(96e-6 + NODES * 1e-7 + 2e-6 + 5e-6, rel=1e-12)


def test_shared_contact_by_hand():
    """Contact of 5 µs, 3 of them shared by ranks that take 32 of 70 candidates at least."""
    nodes = np.arange(10)
    alone = ContactShare(5e-6, 0.0, 0.0, 0, nodes, surface=30, gathers=1, searches=0.5)
    both = ContactShare(5e-6, 0.0, 3e-6, 70, nodes, surface=30, gathers=1, searches=0.5)
    for count in (2, 8):
        steps = [rows([count], contact)[0]["step"] for contact in (alone, both)]
        levels = np.log2(count)
        told = 1.5 * (levels * 1e-6 + 70 * 56 * (count - 1) / count / 1e9)
        assert steps[0] - steps[1] == pytest.approx(3e-6 * (1 - 1 / 2) - told, rel=1e-9)


def test_replicated_contact_stops_the_gain():
    """Contact as long as the cells: more ranks gain less and less, and its share only grows."""
    contact = ContactShare(96e-6, nodes=np.arange(10), surface=30, gathers=1)
    found = judged(rows([1, 2, 4, 8], contact))
    shares = [row["contact_share"] for row in found["ranks"]]
    gains = [row["gain_of_doubling"] for row in found["ranks"][1:]]
    assert shares == sorted(shares) and gains == sorted(gains, reverse=True)
    assert found["contact_tenth"] == 1 and 1 < found["contact_half"] < 2
    assert found["pays_until"] == 2 and found["ranks"][-1]["largest"] == "contact"
    assert found["pays_until_without_contact"] is None
    free = judged(rows([1, 2, 4, 8]))
    assert free["contact_half"] is None and free["pays_until"] is None
    steps = [row["step"] for row in free["ranks"]]
    assert steps == sorted(steps, reverse=True)


def test_larger_mesh_by_surface_to_volume():
    """Eight times the cells: eight times the kernel, four times ghosts, bytes and contact."""
    contact = ContactShare(5e-6, nodes=np.arange(10), surface=30, gathers=1)
    row = rows([2], contact)[0]
    large = refined(row, 8)
    factors = {name: large["terms"][name] / value for name, value in row["terms"].items() if value}
    assert factors["kernel"] == pytest.approx(8) and factors["contact"] == pytest.approx(4)
    assert factors["bytes"] == pytest.approx(4) and factors["messages"] == 1
    assert large["ghosts"] == pytest.approx(4 * row["ghosts"])
    assert large["step"] == pytest.approx(sum(large["terms"].values()))


def test_contact_of_blocks():
    """The sliding block's pair: nodes of the mesh on both surfaces, and a positive time."""
    scene = Scene.load("sliding-block")
    mesh, placement = mesh_of(scene)
    found = contact_share(scene, mesh, placement)
    (entry,) = scene.contacts.values()
    contactor = np.unique(mesh.surface(mesh.tag(entry.contactor)))
    target = np.unique(mesh.surface(mesh.tag(entry.target)))
    assert found.surface == len(contactor) + len(target)
    assert np.isin(contactor, found.nodes).all()  # all of the block's sole is in reach
    assert np.isin(found.nodes, np.concatenate([contactor, target])).all()
    assert found.seconds > 0 and found.gathers == 1
    assert 0 < found.shared < found.seconds and found.tracked >= len(contactor)
    assert contact_share(Scene.load("bar-wave"), mesh, None).seconds == 0


@pytest.mark.mpi
@pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="starts mpiexec itself")
def test_ghosts_are_those_of_ranks(mpirun, tmp_path):
    """The same cut on 2 ranks: DOLFINx has as many cells, nodes of cells, and ghosts in all."""
    of_cell = partition.partition(partition.dual_graph(block()), 2)
    np.save(tmp_path / "parts.npy", of_cell)
    root = Path(__file__).parents[2]
    mpirun(2, __file__, tmp_path, cwd=root, env=os.environ | {"PYTHONPATH": str(root)})
    ranks = [json.loads((tmp_path / f"{rank}.json").read_text()) for rank in range(2)]
    parts = partition.parts_of(block().cells, of_cell, NODES, 2)
    assert [rank["cells"] for rank in ranks] == list(parts.cells)
    held = [rank["owned"] + rank["ghosts"] for rank in ranks]
    assert held == list(parts.owned + parts.ghosts)
    assert sum(rank["ghosts"] for rank in ranks) == parts.ghosts.sum() > 0


@pytest.mark.slow
def test_command(command, tmp_path, monkeypatch):
    """``squealx scaling``: rows for all ranks, one of them 1, a table and a figure."""
    monkeypatch.setattr(machine_rates, "fixed_seconds", lambda: 1e-5)  # builds a scene
    words = ("--parts", "2,8", "--cells", 10_000, "--json", "--out", tmp_path)
    found = json.loads(command("scaling", "sliding-block", *words).stdout)
    assert [row["ranks"] for row in found["ranks"]] == [1, 2, 8]
    assert found["ranks"][0]["efficiency"] == 1
    for row in found["ranks"]:
        assert row["step"] == pytest.approx(sum(row["terms"].values()))
    assert len((tmp_path / "scaling.csv").read_text().splitlines()) == 1 + 2 * 3
    assert (tmp_path / "scaling.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    assert any(isinstance(part, str) for part in scaling.printout(found))


@pytest.mark.parametrize("words", [("--parts", "0"), ("--parts", "a"), ("--bandwidth", "0")])
def test_refused(command, words):
    """Numbers that make no sense: exit code 2, before anything is measured."""
    done = command("scaling", "hertz", *words, check=False)
    assert done.returncode == 2 and "expected positive numbers" in done.stderr


def test_a_file_is_no_folder_for_results(command, tmp_path):
    """``--out`` names a file: exit code 2 with the option, before anything is measured."""
    (tmp_path / "taken").write_text("mine")
    done = command("scaling", "hertz", "--out", tmp_path / "taken", check=False)
    assert done.returncode == 2 and "--out" in done.stderr and "expected a folder" in done.stderr
    assert (tmp_path / "taken").read_text() == "mine"


if __name__ == "__main__":
    import basix.ufl
    import dolfinx
    import ufl
    from dolfinx.graph import adjacencylist

    from meshes.domain import VTK_TO_TENSOR

    folder, comm = Path(sys.argv[1]), MPI.COMM_WORLD
    of_cell = np.load(folder / "parts.npy").astype(np.int32)
    mine = np.array_split(np.arange(len(of_cell)), comm.size)[comm.rank]
    shown = np.array_split(np.arange(NODES), comm.size)[comm.rank]

    def given(comm, count, types, cells):
        """The cut of the model in place of the partitioner's."""
        return adjacencylist(of_cell[mine][:, None])._cpp_object

    msh = dolfinx.mesh.create_mesh(
        comm,
        block().cells[mine][:, VTK_TO_TENSOR],
        ufl.Mesh(basix.ufl.element("Lagrange", "hexahedron", 1, shape=(3,))),
        block().points[shown],
        given,
    )
    V = dolfinx.fem.functionspace(msh, ("Lagrange", 1, (3,)))
    nodes = V.dofmap.index_map
    held = {
        "cells": msh.topology.index_map(3).size_local,
        "owned": nodes.size_local,
        "ghosts": nodes.num_ghosts,
    }
    (folder / f"{comm.rank}.json").write_text(json.dumps(held))
