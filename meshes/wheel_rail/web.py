# SPDX-License-Identifier: LGPL-3.0-or-later
"""Wheel designs: measures, and web and hub as blocks of the section (y along the axle, radius)."""

import numpy as np

from meshes.arrays import Array
from meshes.generate.section import coons, spaced, straight
from meshes.profiles.profiles import MM, drawing

LEAST_RIM = 0.045  # thickness of the rim under the tape circle


def wheel_design(name: str, radius: float) -> dict[str, Array]:
    """Return the measures of a wheel of ``wheel_ns_intercity.json`` [m].

    Args:
        name: Its name.
        radius: Radius of the tape circle [m].

    Raises:
        ValueError: if there is no such wheel, or its rim does not fit under the tape circle.
    """
    designs = drawing("wheel_ns_intercity")["candidates"]
    if name not in designs:
        raise ValueError(f"design: expected one of {', '.join(designs)}, got {name!r}")
    wheel = {key: np.array(value) * MM for key, value in designs[name].items()}
    if radius < wheel["rim_ir"] + LEAST_RIM:
        raise ValueError(
            f"radius: expected {wheel['rim_ir'] + LEAST_RIM:.3f} m or more for a rim round "
            f"{wheel['rim_ir']:.3f} m, got {radius}"
        )
    return wheel


def web_ends(wheel: dict[str, Array]) -> tuple[float, float]:
    """Return the radii between which the web's block lies, half-way round its fillets [m]."""
    reach = 1 - np.sqrt(0.5)
    low = wheel["hub_or"] + reach * wheel["fil_hub"]
    return float(low), float(wheel["rim_ir"] - reach * wheel["fil_rim"])


def web_block(wheel: dict[str, Array], rows: int, columns: int) -> Array:
    """Return the block of the web, shape ``(rows + 1, columns + 1, 2)`` [m].

    Args:
        wheel: Measures of the design [m].
        rows: Cells along the radius.
        columns: Cells across the web.
    """
    low, high = wheel["hub_or"], wheel["rim_ir"]
    r = np.linspace(*web_ends(wheel), rows + 1)
    share = (r - low) / (high - low)
    centre = wheel["xw_hub"] + (wheel["xw_rim"] - wheel["xw_hub"]) * share
    centre = centre + wheel.get("bow", np.array(0.0)) * np.sin(np.pi * share)
    half = (wheel["t_hub"] + (wheel["t_rim"] - wheel["t_hub"]) * share) / 2
    half = half + _widening(r - low, wheel["fil_hub"]) + _widening(high - r, wheel["fil_rim"])
    y = centre[:, None] + half[:, None] * np.linspace(-1, 1, columns + 1)
    return np.stack([y, np.repeat(r[:, None], columns + 1, axis=1)], axis=2)


def _widening(distance: Array, fillet: Array) -> Array:
    """Return how far a fillet stands off the web at some distance from the flat it runs into."""
    inside = np.clip(fillet - distance, 0, None)
    return np.asarray(fillet - np.sqrt(fillet**2 - inside**2))


def filleted(corner: Array, web: Array, cells: int) -> Array:
    """Return points from the corner of rim or hub along its flat and half a fillet to the web.

    Args:
        corner: Corner, shape ``(2,)`` [m].
        web: End of the web's block, shape ``(2,)`` [m].
        cells: Edges between them.
    """
    offset = abs(web[1] - corner[1])
    fillet = offset / (1 - np.sqrt(0.5))
    side = np.sign(web - corner)
    angle = np.linspace(0, np.pi / 4, 20)[:, None]
    turn = np.hstack([np.sin(angle), 1 - np.cos(angle)]) * fillet * side
    start = web - turn[-1]
    return spaced(np.vstack([corner, start + turn]), np.linspace(0, 1, cells + 1))


def hub_blocks(wheel: dict[str, Array], web: Array, rows: int, size: float) -> list[Array]:
    """Return the blocks of the hub: below the web, towards the track centre, to the field side.

    Args:
        wheel: Measures of the design [m].
        web: Block of the web.
        rows: Cells along the radius.
        size: Length of cells along the axle beside the web [m].
    """
    bore, top = float(wheel["bore"]), float(wheel["hub_or"])
    across, ends = web.shape[1] - 1, (web[0, 0], web[0, -1])
    feet = [np.array([0.9 * end[0] + 0.1 * web[0, :, 0].mean(), bore]) for end in ends]
    inner = [straight(foot, end, rows) for foot, end in zip(feet, ends, strict=True)]
    blocks = [coons(straight(feet[0], feet[1], across), inner[1], web[0], inner[0])]
    for side in range(2):
        edge = wheel["hub_x"][side]
        columns = max(2, round(float(abs(edge - feet[side][0])) / size))
        face = straight([edge, bore], [edge, top], rows)
        over = filleted(face[-1], ends[side], columns)
        below = straight(face[0], feet[side], columns)
        if side == 0:
            blocks.append(coons(below, inner[0], over, face))
        else:
            blocks.append(coons(below[::-1], face, over[::-1], inner[1]))
    return blocks
