# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact surfaces without a mesh beneath them: grids of quads with a mass per area."""

from types import SimpleNamespace

import numpy as np

from contact import ContactPair, Surface, rigid_plane
from contact.tangent import stiffness_blocks

RHO_H = 8.0  # mass per area of the test skins [kg/m2]


def skin(nx, ny, lx, ly, height, *, up, origin=(0.0, 0.0), first=0, noise=0.0, seed=0, dof=0):
    """A grid of quads ``z = height(x, y)`` that faces up or down; every node has a dof."""
    x, y = np.meshgrid(
        origin[0] + np.linspace(0, lx, nx + 1), origin[1] + np.linspace(0, ly, ny + 1),
        indexing="ij",
    )  # fmt: skip
    rng = np.random.default_rng(seed)
    x = x + noise * lx / nx * rng.uniform(-0.3, 0.3, x.shape)
    y = y + noise * ly / ny * rng.uniform(-0.3, 0.3, y.shape)
    points = np.stack([x, y, height(x, y)], axis=2).reshape(-1, 3)
    ids = np.arange(points.shape[0]).reshape(nx + 1, ny + 1)
    quads = np.stack([ids[:-1, :-1], ids[1:, :-1], ids[1:, 1:], ids[:-1, 1:]], axis=2)
    quads = quads.reshape(-1, 4).astype(np.int32)
    if not up:
        quads = np.ascontiguousarray(quads[:, ::-1])
    mass = RHO_H * lx * ly / (nx * ny) * np.bincount(quads.ravel()) / 4.0
    n = len(points)
    dofs = np.arange(dof, dof + n, dtype=np.int32)
    return Surface("up" if up else "down", np.arange(first, first + n), points, quads, mass, dofs)


def stacked(lower, upper):
    """Flat reference positions in dof order, and a State at rest."""
    X = np.vstack([lower.reference, upper.reference])
    return X, state_of(np.zeros(X.size), np.zeros(X.size))


def state_of(u, v, t=0.0):
    def wrap(a):
        return SimpleNamespace(x=SimpleNamespace(array=np.ascontiguousarray(a, dtype=float)))

    return SimpleNamespace(u=wrap(u), v=wrap(v), t=t)


def evaluate(pair, state, **options):
    force = SimpleNamespace(array=np.zeros_like(state.u.x.array))
    pair.add(state, force, **options)
    return force.array.reshape(-1, 3)


def two_skins(**target):
    """A bumpy lower skin and a finer, non-matching one above it."""
    lower = skin(6, 5, 0.06, 0.05, lambda x, y: 1e-3 * np.sin(90 * x + 50 * y), up=True,
                 noise=0.8, **target)  # fmt: skip
    upper = skin(7, 6, 0.045, 0.037, lambda x, y: 0 * x + 1.1e-3, up=False, origin=(0.006, 0.005),
                 first=100, noise=0.8, seed=1, dof=len(lower.nodes))  # fmt: skip
    return lower, upper


def plate_on_plane(friction, **options):
    plate = skin(4, 4, 0.04, 0.04, lambda x, y: 0 * x - 1e-6, up=False, origin=(-0.02, -0.02))
    plane = rigid_plane((0, 0, 0), (0, 0, 1), 1.0)
    pair = ContactPair(plate, plane, dt=1e-6, friction=friction, **options)
    n = 3 * len(plate.nodes)
    return plate, pair, state_of(np.zeros(n), np.zeros(n))


def tangent_of(pair, state, *skins):
    """Tangent of a pair over the dofs of its skins, dense and symmetric, shape ``(3 n, 3 n)``."""
    n = sum(len(s.nodes) for s in skins)
    K = np.zeros((n, 3, n, 3))
    dof = {int(a): int(b) for s in skins for a, b in zip(s.nodes, s.dofs, strict=True)}
    for springs in pair.springs_at_rest(state):
        touch = springs.gap < 0.0
        i, j, blocks = stiffness_blocks(
            springs.nodes[touch],
            springs.weight[touch],
            springs.normal[touch],
            springs.stiffness[touch],
            0.0,
        )
        row, column = [dof[int(a)] for a in i], [dof[int(a)] for a in j]
        np.add.at(K, (row, slice(None), column), blocks)
    K = K.reshape(3 * n, 3 * n)
    assert np.abs(K - K.T).max() <= 1e-12 * np.abs(K).max()
    return K
