# SPDX-License-Identifier: LGPL-3.0-or-later
"""Normal laws of contact, and what each asks of the time step.

``penalty``
    A spring of ``penalty * m_eff / dt^2``: stable by construction, softer at a longer step.
``modulus-penalty``
    A spring of ``penalty * K A^2 / V`` of the cell behind (LS-DYNA theory manual, R14, eq. 29.11:
    bulk modulus, area of the facet, volume of the cell), with the softer of both sides as there;
    per area, so that a uniform pressure gives a uniform penetration. It does not depend on the
    step, which it may shorten.
``lagrange``
    Forces that close the gap at t + dt (:mod:`contact.lagrange`). The step stays as it is.
"""

import numpy as np
import numpy.typing as npt

from contact.surface import Surface, corner_areas, tributary_area

Array = npt.NDArray[np.float64]

METHODS = ("penalty", "modulus-penalty", "lagrange")


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


def share_of_step(method: str, penalty: float, damping: float) -> float:
    r"""Return what springs in proportion to m/dt^2 take of the 1 in ``dt²/4 K + dt/2 C < M``.

    A spring :math:`p\,m/dt^2` takes p/4, its damper :math:`2 \zeta \sqrt{k m}`, which sees the
    velocity half a step back, :math:`\zeta \sqrt p`.
    """
    return penalty / 4 + damping * penalty**0.5 if method == "penalty" else 0.0


def largest_rates(
    contactor: Surface, target: Surface, penalty: float, damping: float
) -> tuple[float, float]:
    """Return bounds of K/M [1/s2] and C/M [1/s] of the springs of ``modulus-penalty``.

    Each contactor node is taken to meet the lightest and the widest node of the target.
    """
    area, facing = tributary_area(contactor), tributary_area(target)
    assert target.foundation is not None
    bed = np.minimum(node_foundation(contactor), target.foundation.max())
    behind = np.maximum(np.max(1 / target.mass), np.max(facing / target.mass) / area)
    square = float(np.max(penalty * area * bed * (1 / contactor.mass + behind)))
    return square, 2 * damping * square**0.5
