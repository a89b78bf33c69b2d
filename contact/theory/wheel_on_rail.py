# SPDX-License-Identifier: LGPL-3.0-or-later
"""Half-space contact of a wheel on a rail: by Hertz, and with the true shape of both.

Hertz takes the curvatures of the undeformed surfaces where they first touch. The numerical solution
takes the distance between them, normal to the tangent plane there, wherever it is small.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from contact.footprint import frame_of
from contact.theory.closed_forms import Hertz, hertz_ellipse
from contact.theory.half_space import HalfSpaceContact, half_space_contact
from meshes.arrays import Array
from meshes.profiles.surfaces import Surface

SEEK = (0.020, 0.020)  # how far along and across from a point near it a patch is sought [m]
CLOSE = 20  # times narrower is the grid on which the first touch is found at last
APART = 0.01  # distance where there is no rail or no wheel [m]
CELLS = 64  # of the grid of the half-spaces, each way
ROUNDS = 8  # in which the grid is fitted to the patch


@dataclass(frozen=True)
class WheelOnRail:
    """Half-space contact of a wheel pressed on a rail where they stand.

    Attributes:
        origin: First touch of the undeformed surfaces, shape ``(3,)`` [m].
        frame: Longitudinal, lateral and normal direction there as rows, shape ``(3, 3)``.
        reach: How far along and across from there was looked, shape ``(2,)`` [m].
        radii: Of the relative curvature there, along and across; negative where hollow [m].
        hertz: The contact of such radii, None where they are hollow.
        x, y: Middles of the grid along the first axes of the frame, shape ``(n,)`` each [m].
        half_space: The contact on that grid.
    """

    origin: Array
    frame: Array
    reach: Array
    radii: tuple[float, float]
    hertz: Hertz | None
    x: Array
    y: Array
    half_space: HalfSpaceContact

    @property
    def angle(self) -> float:
        """Contact angle at the first touch [degrees]."""
        _, y, z = np.abs(self.frame[2])
        return float(np.degrees(np.arctan2(y, z)))

    @cached_property
    def grid(self) -> Array:
        """Longitudinal and lateral coordinate of all middles of the grid, shape ``(n, 2)`` [m]."""
        return _grid(self.x, self.y)

    def local(self, position: Array) -> Array:
        """Return longitudinal and lateral coordinates of positions, shape ``(n, 2)`` [m]."""
        return np.asarray((position - self.origin) @ self.frame[:2].T)

    def pressure(self, at: Array, sides: Array | float = 0.0) -> Array:
        """Return the pressure of the half-spaces, shape ``(n,)`` [Pa].

        Args:
            at: Longitudinal and lateral coordinates, shape ``(n, 2)`` [m].
            sides: Lengths of cells along and across, shape ``(n, 2)`` [m]: the mean is taken that
                a node's force over its area is, weighted with its shape function over four cells.
        """
        from scipy.interpolate import RegularGridInterpolator

        axes, values = (self.x, self.y), self.half_space.pressure
        p = RegularGridInterpolator(axes, values, bounds_error=False, fill_value=0.0)
        share = np.linspace(-1.0, 1.0, 19)[1:-1]
        ways, hat = _grid(share, share), 1 - np.abs(share)
        weights = np.outer(hat, hat).ravel() / hat.sum() ** 2
        around = [w * p(at + sides * way) for w, way in zip(weights, ways, strict=True)]
        return np.asarray(np.sum(around, axis=0))


def profile_contact(
    wheel: Surface,
    rail: Surface,
    near: Array,
    load: float,
    modulus: float,
    reach: tuple[float, float] = SEEK,
) -> WheelOnRail:
    """Return the half-space contact of a wheel pressed on a rail.

    Args:
        wheel: Running surface of the wheel where it stands.
        rail: That of the rail.
        near: A point by which they touch, shape ``(3,)`` [m].
        load: Normal force [N].
        modulus: Contact modulus E* [Pa].
        reach: How far along and across from there to look, not as far as another patch [m].

    Raises:
        RuntimeError: if the patch is not within reach.
    """
    frame = frame_of(rail.normal(near))
    half = np.array(reach)
    origin = _touch(wheel, rail, near, frame, half)
    for part in (half, half / CLOSE):  # once more from the tangent plane found
        frame = frame_of(rail.normal(origin))
        origin = _touch(wheel, rail, origin, frame, part)
    frame = frame_of(rail.normal(origin))
    along, across = np.sum([s.curvatures(origin) for s in (wheel, rail)], axis=0)
    radii = (float(1 / along), float(1 / across) if across else np.inf)
    hertz = None
    if min(radii) > 0 and np.isfinite(radii[1]):
        hertz = hertz_ellipse(load, *radii, modulus)
    x, y, found = _pressed(wheel, rail, origin, frame, half, load, modulus, 0.0)
    return WheelOnRail(origin, frame, half, radii, hertz, x, y, found)


def with_layer(
    hard: WheelOnRail, wheel: Surface, rail: Surface, load: float, modulus: float, layer: float
) -> WheelOnRail:
    """Return the contact with a soft layer between the surfaces, as penalty springs are.

    Args:
        hard: The contact without it.
        wheel: Running surface of the wheel where it stands.
        rail: That of the rail.
        load: Normal force [N].
        modulus: Contact modulus E* [Pa].
        layer: How much it gives way under a unit pressure [m/Pa].
    """
    x, y, found = _pressed(wheel, rail, hard.origin, hard.frame, hard.reach, load, modulus, layer)
    return replace(hard, x=x, y=y, half_space=found)


def gap(wheel: Surface, rail: Surface, origin: Array, frame: Array, at: Array) -> Array:
    """Return the distance of wheel and rail along the normal of a plane, shape ``(n,)`` [m].

    ``APART`` beside one of them, where they cannot touch.

    Args:
        wheel: Running surface of the wheel.
        rail: That of the rail.
        origin: A point of the plane, shape ``(3,)`` [m].
        frame: Longitudinal, lateral and normal direction as rows, shape ``(3, 3)``.
        at: Longitudinal and lateral coordinates, shape ``(n, 2)`` [m].
    """
    plane = origin + at @ frame[:2]
    distance = wheel.heights(plane, frame[2]) - rail.heights(plane, frame[2])
    return np.where(np.isfinite(distance), distance, APART)


def _grid(x: Array, y: Array) -> Array:
    return np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)


def _touch(wheel: Surface, rail: Surface, origin: Array, frame: Array, half: Array) -> Array:
    """Return the point of the rail on a grid about the origin that is nearest to the wheel."""
    at = half * _grid(*[np.linspace(-1.0, 1.0, 61)] * 2)
    nearest = at[[np.argmin(gap(wheel, rail, origin, frame, at))]]
    plane = origin + nearest @ frame[:2]
    return np.asarray(plane[0] + rail.heights(plane, frame[2]) * frame[2])


def _pressed(
    wheel: Surface,
    rail: Surface,
    origin: Array,
    frame: Array,
    reach: Array,
    load: float,
    modulus: float,
    layer: float,
) -> tuple[Array, Array, HalfSpaceContact]:
    """Return a grid that just holds the patch, and the contact on it.

    Half-spaces touch only where the undeformed surfaces overlap at their approach.
    """
    wide = reach * _grid(*[np.linspace(-1.0, 1.0, 81)] * 2)
    margin = reach / 40
    apart = gap(wheel, rail, origin, frame, wide)
    apart -= apart.min()
    approach = 1e-4
    for _ in range(ROUNDS):
        overlap = wide[apart < approach]
        low, high = overlap.min(axis=0) - margin, overlap.max(axis=0) + margin
        sides = (high - low) / CELLS
        x, y = (a + s * (np.arange(CELLS) + 0.5) for a, s in zip(low, sides, strict=True))
        distance = gap(wheel, rail, origin, frame, _grid(x, y)).reshape(CELLS, CELLS)
        distance -= distance.min()
        spacing = float(sides[0]), float(sides[1])
        found = half_space_contact(distance, spacing, load, modulus, layer)
        if found.approach <= approach <= 1.1 * found.approach and not found.reaches_the_edge:
            return x, y, found
        approach = 1.05 * found.approach
    raise RuntimeError(
        f"half-space contact: expected a patch within {reach[0]:.4f} m along and {reach[1]:.4f} m "
        f"across of y = {origin[1]:.4f} m, got one that reaches farther"
    )
