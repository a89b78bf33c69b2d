# SPDX-License-Identifier: LGPL-3.0-or-later
"""The solid half axle, an O-grid swept through the bore of the wheel."""

from dataclasses import dataclass

import numpy as np

from meshes.arrays import Array, Index
from meshes.generate.section import coons, numbered
from meshes.generate.sweep import Swept, X, Y, Z

AXLE_SPACING = 0.035
AXLE_BLOCK = 5


@dataclass(frozen=True)
class Axle:
    """Measures of the half axle; lateral positions in the global frame [m].

    Attributes:
        inner: Inner end, the track centre.
        outer: Outer end, behind the journal.
        body: Radius between the wheels.
        journal: Radius outside the wheel.
        taper: Length over which the radius changes beside the hub.
    """

    inner: float = 0.0
    outer: float = 1.1
    body: float = 0.080
    journal: float = 0.065
    taper: float = 0.040


def with_axle(wheel: Swept, axle: Axle, bore: float, tape: float) -> Swept:
    """Return the wheel with the axle in its bore; they share the nodes of the seat.

    Args:
        wheel: The revolved wheel, its first node of each sector at the angle of the sector.
        axle: Measures of the axle.
        bore: Radius of the bore [m].
        tape: Lateral position of the tape circle [m].

    Raises:
        ValueError: if the axle ends within the wheel.
    """
    on_bore = np.flatnonzero(wheel.params[:, Z] < bore + 1e-9)
    sectors = int(np.sum(wheel.params[on_bore, Y] == wheel.params[on_bore[0], Y]))
    seat = on_bore.reshape(sectors, -1)
    seat = seat[:, np.argsort(wheel.params[seat[0], Y])]
    y, radii, first = _axle_stations(wheel.params[seat[0], Y], axle, bore, tape)
    disc, quads, rim = _disc(sectors)
    r, angle = np.hypot(*disc.T), np.arctan2(disc[:, 0], -disc[:, 1])
    n = len(disc)
    params = np.full((len(y) * n, 5), np.nan)
    params[:, Y] = np.repeat(y, n)
    params[:, Z] = np.outer(radii, r).ravel()
    params[:, X] = np.tile(angle, len(y))
    start = n * np.arange(len(y) - 1)[:, None, None]
    cells = np.concatenate([quads + start + n, quads + start], axis=2).reshape(-1, 8)
    number = len(wheel.params) + np.arange(len(params))
    for k in range(seat.shape[1]):
        number[(first + k) * n + rim] = seat[:, k]
    kept, inverse = np.unique(
        np.concatenate([np.arange(len(wheel.params)), number]), return_inverse=True
    )
    cells = np.vstack([wheel.cells, inverse[len(wheel.params) + cells]])
    blocks = np.concatenate([wheel.blocks, np.full(len(cells) - len(wheel.blocks), AXLE_BLOCK)])
    return Swept(np.vstack([wheel.params, params])[kept], cells, blocks, wheel.period)


def _axle_stations(seat: Array, axle: Axle, bore: float, tape: float) -> tuple[Array, Array, int]:
    """Return lateral stations of the axle, the radius at each, and the first one of the seat."""
    start, end = axle.inner - tape, axle.outer - tape
    low, high = seat[0] - axle.taper, seat[-1] + axle.taper
    if not (start < low and high < end):
        raise ValueError(
            f"axle: expected ends beyond {low + tape:.3f} and {high + tape:.3f} m, got "
            f"{axle.inner} and {axle.outer} m"
        )
    inside = np.linspace(start, low, round((low - start) / AXLE_SPACING) + 1)
    outside = np.linspace(high, end, round((end - high) / AXLE_SPACING) + 1)
    middle = [(low + seat[0]) / 2], seat, [(high + seat[-1]) / 2]
    y = np.concatenate([inside, *middle, outside])
    radii = np.interp(y, [low, seat[0], seat[-1], high], [axle.body, bore, bore, axle.journal])
    return y, radii, len(inside) + 1


def _disc(sectors: int, rings: int = 2, core: float = 0.58) -> tuple[Array, Index, Index]:
    """Return an O-grid of the unit disc (x, z): nodes, quads, and the rim's nodes by angle.

    The rim's first node is at the bottom, the others follow towards +x.
    """
    side = sectors // 4
    angle = 2 * np.pi * np.arange(sectors + 1) / sectors
    circle = np.column_stack([np.sin(angle), -np.cos(angle)])
    share = np.linspace(0, 1, side + 1)[:-1, None]
    corner = circle[::side]
    square = np.vstack([(1 - share) * corner[k] + share * corner[k + 1] for k in range(4)])
    edge = core * (0.6 * np.vstack([square, square[:1]]) + 0.4 * circle)
    a, b, c, d = (edge[k * side : (k + 1) * side + 1] for k in range(4))
    inside = coons(a, b, c[::-1], d[::-1])
    layers = [(1 - t) * edge + t * circle for t in np.linspace(0, 1, rings + 1)]
    blocks = [inside, np.stack(layers[::-1])]
    raw = np.vstack([block.reshape(-1, 2) for block in blocks])
    _, first, inverse = np.unique(
        np.round(raw / 1e-8).astype(np.int64), axis=0, return_index=True, return_inverse=True
    )
    core_numbers = inverse[: (side + 1) ** 2].reshape(side + 1, side + 1)
    ring_numbers = inverse[(side + 1) ** 2 :].reshape(rings + 1, sectors + 1)
    quads = np.vstack([numbered(core_numbers), numbered(ring_numbers)])
    return raw[first], quads, ring_numbers[0, :-1]
