# SPDX-License-Identifier: LGPL-3.0-or-later
"""Absorbing surfaces: viscous dashpots after Lysmer and Kuhlemeyer."""

from typing import Literal

from mpi4py import MPI

import numpy as np

from forms.elasticity import Elastic
from forms.loads import nodal_traction
from forms.springs.springs import Springs, spread
from meshes.arrays import Array, Dofs, Index


def dashpots(comm: MPI.Comm, dofs: Dofs, matrix: Array) -> Springs:
    """Return dampers from nodes to the ground with a symmetric matrix each, without springs.

    Args:
        comm: Ranks.
        dofs: Owned dof block of each node, -1 where another rank owns it, shape ``(n,)``.
        matrix: Shape ``(n, 3, 3)`` [N s/m].
    """
    return spread(comm, dofs, np.zeros((len(dofs), 3)), matrix)


def absorbing(
    points: Array, quads: Index, material: Elastic, waves: Literal["plane", "bar"] = "plane"
) -> Array:
    """Return the damping matrices of all nodes that let waves out of a surface, ``(n, 3, 3)``.

    ``ρ c`` per area along the normal and ``ρ c_s`` across it (Lysmer and Kuhlemeyer, J. Eng. Mech.
    Div. 95, 1969, 859-877, with a = b = 1). A plane wave at right angles has c = c_p, so nothing of
    it comes back; in a slender bar the stress is uniaxial and c = √(E/ρ), and dashpots with c_p
    would send back (c_p − c)/(c_p + c), 7 % at ν = 0.3.

    Args:
        points: Node positions, shape ``(n, 3)`` [m].
        quads: Facets of the surface, shape ``(q, 4)``.
        material: Of the body behind.
        waves: What the body carries, ``plane`` waves or those of a ``bar``.
    """
    lmbda, mu, rho = material.lmbda, material.mu, material.rho
    modulus = lmbda + 2 * mu if waves == "plane" else material.E
    normal, shear = np.sqrt(modulus * rho), np.sqrt(mu * rho)
    x = points[quads]
    n = np.cross(x[:, 2] - x[:, 0], x[:, 3] - x[:, 1])
    n /= np.linalg.norm(n, axis=1)[:, None]
    matrix = np.zeros((len(points), 3, 3))
    for facet, direction in zip(quads, n, strict=True):
        share = nodal_traction(points[facet], np.arange(4)[None], np.ones(3))[:, 0]
        impedance = shear * np.eye(3) + (normal - shear) * np.outer(direction, direction)
        matrix[facet] += share[:, None, None] * impedance
    return matrix
