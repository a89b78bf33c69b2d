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
        Owned cells of each id in the order of the mesh, which is already local.
    """
    msh = form.ufl_domain().ufl_cargo()
    ((data, *_),) = (kinds["cell"] for kinds in form.subdomain_data().values())
    tagged = [i for i in ids if i != -1]
    domains = dict(get_integration_domains(fem.IntegralType.cell, data, tagged))
    everywhere = np.arange(msh.topology.index_map(msh.topology.dim).size_local, dtype=np.int32)
    none = np.empty(0, dtype=np.int32)
    return [
        everywhere if i == -1 else np.asarray(domains.get(i, none), dtype=np.int32) for i in ids
    ]


def by_lane(dofmap: Indices, cells: Indices, lanes: int) -> Indices:
    """Return the dofs of the cells in batches of ``lanes``, shape ``(batches, dofs, lanes)``.

    The last batch is filled up with its last cell; the kernel scatters no lane beyond the cells.

    Args:
        dofmap: Dofs of every cell of the mesh, shape ``(n_cells, dofs)``.
        cells: Cells of the integral, shape ``(n,)``.
        lanes: Number of cells that are computed at once.
    """
    padded = np.pad(cells, (0, -len(cells) % lanes), mode="edge") if len(cells) else cells
    batches = dofmap[padded].reshape(-1, lanes, dofmap.shape[1])
    return np.ascontiguousarray(batches.transpose(0, 2, 1), dtype=np.int32)
