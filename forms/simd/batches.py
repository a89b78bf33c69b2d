# SPDX-License-Identifier: LGPL-3.0-or-later
"""Batches of cells, one per lane: the cells of each integral and their dofs by lane."""

from typing import Any

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from dolfinx.fem.forms import get_integration_domains

Indices = npt.NDArray[np.int32]
Entries = npt.NDArray[np.uint32]


def integral_cells(form: Any, ids: list[int]) -> list[Indices]:
    """Return this rank's cells of each integral id as DOLFINx takes them.

    Args:
        form: UFL form of cell integrals over one mesh.
        ids: Subdomain ids of the compiled integrals; -1 is everywhere.

    Returns:
        Owned cells of each id.

    Raises:
        ValueError: if measures of one form have different tags, which DOLFINx refuses too.
    """
    msh = form.ufl_domain().ufl_cargo()
    ((given,),) = (kinds.values() for kinds in form.subdomain_data().values())
    data = next((d for d in given if d is not None), None)
    if any(d is not None and d is not data for d in given):
        raise ValueError("subdomain_data: expected the same tags in all measures")
    tagged = [i for i in ids if i != -1]
    domains = dict(get_integration_domains(fem.IntegralType.cell, data, tagged))
    everywhere = np.arange(msh.topology.index_map(msh.topology.dim).size_local, dtype=np.int32)
    none = np.empty(0, dtype=np.int32)
    return [
        everywhere if i == -1 else np.asarray(domains.get(i, none), dtype=np.int32) for i in ids
    ]


def batches(dofmaps: list[tuple[Indices, int]], cells: Indices, lanes: int) -> list[Entries]:
    """Return where the dofs of the cells begin in their arrays, by lane; one array for equal ones.

    Args:
        dofmaps: Dofs of every cell of the mesh, each of shape ``(n_cells, dofs)``, and the number
            of entries that each dof has.
        cells: Cells of the integral, shape ``(n,)``.
        lanes: Number of cells that are computed at once.

    Returns:
        Numbers of first entries in batches, each of shape ``(n_batches, dofs, lanes)``.
    """
    result: list[Entries] = []
    for i, (dofmap, size) in enumerate(dofmaps):
        same = (
            j for j, d in enumerate(dofmaps[:i]) if d[1] == size and np.array_equal(d[0], dofmap)
        )
        first = next(same, None)
        new = by_lane(dofmap, cells, lanes, size) if first is None else result[first]
        result.append(new)
    return result


def by_lane(dofmap: Indices, cells: Indices, lanes: int, size: int = 1) -> Entries:
    """Return ``size`` times the dofs of the cells in batches, shape ``(n_batches, dofs, lanes)``.

    The last batch is filled up with its last cell; the kernel scatters no lane beyond the cells.
    Neighbouring cells of the mesh, numbered by DOLFINx for locality, share a batch.
    """
    padded = np.pad(cells, (0, -len(cells) % lanes), mode="edge") if len(cells) else cells
    blocks = dofmap[padded].reshape(-1, lanes, dofmap.shape[1]).astype(np.uint32)
    return np.ascontiguousarray(size * blocks.transpose(0, 2, 1), dtype=np.uint32)


def last_to_the_end(
    dofmaps: list[tuple[Indices, int]], cells: Indices, lanes: int
) -> tuple[Indices, int]:
    """Return the cells, those with the last dof of an array at the end, batches without.

    Behind the three numbers of any other dof there is a fourth that may be read
    (forms/simd/nodes.py).

    Args:
        dofmaps: Dofs of every cell of the mesh, each of shape ``(n_cells, dofs)``, and the number
            of dofs in the array.
        cells: Cells of the integral, shape ``(n,)``.
        lanes: Number of cells that are computed at once.
    """
    last = _at_the_end(dofmaps, cells)
    return np.concatenate([cells[~last], cells[last]]), int((~last).sum()) // lanes


def batches_before_the_end(dofmaps: list[tuple[Indices, int]], cells: Indices, lanes: int) -> int:
    """Return how many batches of cells in a given order come before the last dof of an array."""
    last = _at_the_end(dofmaps, cells)
    return (int(np.argmax(last)) if last.any() else len(cells)) // lanes


def _at_the_end(dofmaps: list[tuple[Indices, int]], cells: Indices) -> npt.NDArray[np.bool_]:
    """Return which cells have the last dof of an array."""
    last = np.zeros(len(cells), dtype=bool)
    for dofmap, number in dofmaps:
        last |= (dofmap[cells] == number - 1).any(axis=1)
    return last
