# SPDX-License-Identifier: LGPL-3.0-or-later
"""Deepest penetration of two surfaces, to detect bodies that overlap at the start."""

import numpy as np
import numpy.typing as npt

from contact.arrays import view
from contact.contact_state import ContactState
from contact.search import Search

Array = npt.NDArray[np.float64]


def deepest(search: Search, xv: Array, reach: float) -> tuple[float, int]:
    """Return depth [m] and contactor index of the deepest node; (0, -1) where nothing overlaps.

    Overwrites what ``search`` has chosen.

    Args:
        search: Search of the pair.
        xv: Positions and velocities of all nodes, shape ``(n, 6)``.
        reach: Depth up to which overlap is looked for [m].
    """
    probe = ContactState(search.nc)
    item = search.candidates(xv, reach, reach, probe.stiffness, probe.facet, probe.xi)
    search.neighbourhood(item)
    search.track(len(item), view("item", item, (-1,), np.int32), view("xv", xv, xv.shape), probe.c)
    if not item.size or not probe.gap[item].min() < 0.0:
        return 0.0, -1
    worst = int(item[np.argmin(probe.gap[item])])
    return float(-probe.gap[worst]), worst
