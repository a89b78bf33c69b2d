# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cells of a form in batches of lanes: which cells each integral has, and their dofs by lane."""

from typing import Any

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from dolfinx.fem.forms import get_integration_domains

Indices = npt.NDArray[np.int32]


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


def batches(dofmaps: list[Indices], cells: Indices, lanes: int) -> list[Indices]:
    """Return the dofs of the cells by lane, one array for equal dofmaps.

    Args:
        dofmaps: Dofs of every cell of the mesh, each of shape ``(n_cells, dofs)``.
        cells: Cells of the integral, shape ``(n,)``.
        lanes: Number of cells that are computed at once.

    Returns:
        Dofs in batches, each of shape ``(n_batches, dofs, lanes)``.
    """
    result: list[Indices] = []
    for i, dofmap in enumerate(dofmaps):
        same = (j for j in range(i) if np.array_equal(dofmaps[j], dofmap))
        first = next(same, None)
        result.append(by_lane(dofmap, cells, lanes) if first is None else result[first])
    return result


def by_lane(dofmap: Indices, cells: Indices, lanes: int) -> Indices:
    """Return the dofs of the cells in batches of ``lanes``, shape ``(n_batches, dofs, lanes)``.

    The last batch is filled up with its last cell; the kernel scatters no lane beyond the cells.
    Neighbouring cells of the mesh, numbered by DOLFINx for locality, share a batch.
    """
    padded = np.pad(cells, (0, -len(cells) % lanes), mode="edge") if len(cells) else cells
    blocks = dofmap[padded].reshape(-1, lanes, dofmap.shape[1])
    return np.ascontiguousarray(blocks.transpose(0, 2, 1), dtype=np.int32)
