# SPDX-License-Identifier: LGPL-3.0-or-later
"""Normal laws of contact and their demands on the time step.

``penalty``
    A spring of ``penalty * m_eff / dt^2``: stable by construction, softer at a longer step.
``modulus-penalty``
    A spring of ``penalty * K A^2 / V`` of the cell behind (LS-DYNA theory manual, R14, eq. 29.11:
    bulk modulus, area of the facet, volume of the cell), with the softer of both sides as there.
    A is the tributary area of the node or that of the target there, whichever is smaller. The
    spring does not depend on the step, which it may shorten.
``implicit-penalty``
    The spring of ``penalty``, with the gap at t + dt (:mod:`contact.implicit`): stable at any
    stiffness, so that ``penalty`` may be 10 or 100 and the step stays as it is.
``lagrange``
    Forces that close the gap at t + dt, the same without give.
"""

import numpy as np

from contact.surface import Surface, tributary_area
from meshes.arrays import Array
from meshes.quads import corner_areas


def node_foundation(surface: Surface) -> Array:
    """Return the foundation modulus of each node, the mean of its facets, ``(n,)`` [Pa/m].

    Raises:
        ValueError: if the surface does not know its own.
    """
    facet = surface.foundation
    if facet is None:
        raise ValueError(f"surface {surface.name}: expected bulk moduli for modulus-penalty")
    share = corner_areas(surface.reference, surface.facets)
    total = np.bincount(
        surface.facets.ravel(), (share * facet[:, None]).ravel(), minlength=len(surface.nodes)
    )
    return np.asarray(total / tributary_area(surface))


def largest_rates(
    contactor: Surface, target: Surface, penalty: float, damping: float
) -> tuple[float, float]:
    """Return bounds of K/M [1/s2] and C/M [1/s] of the springs of ``modulus-penalty``.

    The area of a spring is the smaller one of both sides and its modulus that of the softer, so
    each side has a bound of its own; that of the contactor counts once, that of the target with
    all springs that share a node.
    """
    area, facing = tributary_area(contactor), tributary_area(target)[target.facets].max(axis=1)
    assert target.foundation is not None
    lightest = target.mass[target.facets].min(axis=1)
    mine = np.max(node_foundation(contactor) * area / contactor.mass)
    other = np.max(
        np.divide(
            target.foundation * facing,
            lightest,
            out=np.zeros(len(lightest)),
            where=np.isfinite(lightest),
        )
    )
    square = float(penalty * (mine + other))
    return square, 2 * damping * square**0.5
