# SPDX-License-Identifier: LGPL-3.0-or-later
"""Where the growth of a mode comes from.

With unit mass the product of the equation of motion with the mode is ``λ² + λ c + k = 0``, whose
imaginary part gives the growth rate ``σ = -(Im k + Im (λ c)) / 2ω``, part by part: k is complex
where friction feeds normal into tangential motion, c comes from dampers and from the slope and the
turning of friction.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np

from workflow.squeal.pencil import Complex, Pencil, rows_of
from workflow.squeal.sliding import Face
from workflow.squeal.solve import Eigen


def fed(pencil: Pencil, eigen: Eigen) -> tuple[list[dict[str, Any]], Complex]:
    """Return what feeds each mode, and on rank 0 their shapes by HexMesh node ``(k, n, 3)``.

    Each row has ``fed_by``, the growth rate that each patch brings [1/s], the rest of the growth
    rate as ``damping`` [1/s], and the ``residual``.
    """
    shapes = np.array([pencil.shape(y) for y in eigen.shapes])
    rows: list[dict[str, Any]] = []
    if pencil.comm.rank == 0:
        for value, shape, residual in zip(eigen.values, shapes, eigen.residuals, strict=True):
            by: dict[str, float] = {}
            for face in pencil.faces:
                for name, rate in patches(face, value, shape):
                    by[name] = by.get(name, 0.0) + rate
            left = float(value.real) - sum(by.values())
            rows.append({"fed_by": by, "damping": left, "residual": float(residual)})
    return pencil.comm.bcast(rows), shapes


def patches(face: Face, value: complex, shape: Complex) -> Iterator[tuple[str, float]]:
    """Yield each patch of a face and the growth rate that friction brings there [1/s].

    Args:
        face: The face.
        value: λ [1/s].
        shape: The mode by HexMesh node, shape ``(n, 3)``.
    """
    c = face.contacts
    nodes = np.unique(c.nodes[c.nodes >= 0])
    n, t, b = (rows @ shape[nodes].ravel() for rows in rows_of(face, nodes))
    force = -c.steepness * (c.stiffness + value * c.damper) * n
    force = force + value * c.normal_force * c.slope * t
    work = np.conj(t) * force + value * c.turning * np.abs(b) ** 2
    if value.imag > 0.0:
        rate = -work.imag / (2 * value.imag)
    else:  # without frequency λ² + λ c + k = 0 is real
        rate = -work.real / (2 * abs(value))
    for k in range(face.patches):
        name = face.name if face.patches == 1 else f"{face.name} {k + 1}"
        yield name, float(rate[face.patch == k].sum())
