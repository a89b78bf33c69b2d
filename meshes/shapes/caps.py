# SPDX-License-Identifier: LGPL-3.0-or-later
"""Two curved bodies that touch at the origin: caps, cylinders, crossed crowns, and rollers.

Tensor grids, uniform in a zone around the contact and graded outside, bent to their surfaces.
"""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from meshes.hexmesh import HexMesh
from meshes.shapes.blocks import BASE_FACES, grid, spacing
from meshes.tags import Tag

Array = npt.NDArray[np.float64]
Span = tuple[float, float]


@dataclass(frozen=True)
class Footing:
    """The plan of a curved body: where it lies, where it is fine, how deep it is.

    Attributes:
        x, y: Ends of the body along each axis [m].
        fine_x, fine_y: Ends of the zone of uniform cells, inside ``x`` and ``y`` [m].
        depth: Extent away from the contact [m].
        size: Largest edge in the uniform zone and of the cells at the surface [m].
        growth: Ratio of neighbouring edges outside of it, at least 1 [-].
        layers: Number of equal cells along y in place of ``fine_y``; 1 for plane strain.
    """

    x: Span
    y: Span
    fine_x: Span
    fine_y: Span
    depth: float
    size: float
    growth: float = 1.2
    layers: int | None = None

    def axes(self) -> tuple[Array, Array, Array]:
        """Return node positions along x, y and away from the contact [m].

        Raises:
            ValueError: if a span is empty or a uniform zone is not inside of it.
        """
        x = zoned("x", self.x, self.fine_x, self.size, self.growth)
        if self.layers is None:
            y = zoned("y", self.y, self.fine_y, self.size, self.growth)
        else:
            y = np.linspace(*self.y, self.layers + 1)
        return x, y, spacing(self.depth, self.size, growth=self.growth)


def zoned(name: str, span: Span, fine: Span, size: float, growth: float) -> Array:
    """Return positions over ``span``, uniform inside ``fine`` and growing outside, ``(n,)`` [m].

    Args:
        name: Name of the axis for messages.
        span: First and last position [m].
        fine: Ends of the uniform zone [m].
        size: Largest edge in the zone, and of the first cells outside of it [m].
        growth: Ratio of neighbouring edges outside, at least 1 [-].

    Raises:
        ValueError: if the span is empty or the zone not inside of it.
    """
    (first, last), (a, b) = span, fine
    if not first <= a < b <= last:
        raise ValueError(
            f"fine_{name}: expected a zone inside {name} = [{first}, {last}] m, got [{a}, {b}] m"
        )
    inner = np.linspace(a, b, max(1, int(np.ceil((b - a) / size - 1e-9))) + 1)
    before, after = np.zeros(0), np.zeros(0)
    if a > first:
        before = a - spacing(a - first, size * growth, growth=growth)[:0:-1]
    if last > b:
        after = b + spacing(last - b, size * growth, growth=growth)[1:]
    return np.concatenate([before, inner, after])


def rise(x: Array, y: Array, radius: float | None, crown: float | None) -> Array:
    """Return how far a surface has left the plane that it touches at the origin [m].

    A surface of revolution about an axle along y, ``radius`` above: its profile is an arc of radius
    ``crown``. Equal radii make a sphere; None is flat.

    Raises:
        ValueError: if a point lies outside of the surface.
    """
    for name, value, reach in (("radius", radius, x), ("crown", crown, y)):
        if value is not None and not np.abs(reach).max() < value:
            raise ValueError(f"{name}: expected > {np.abs(reach).max()} (the extent), got {value}")
    side = np.zeros_like(y) if crown is None else crown - np.sqrt(crown**2 - y**2)
    if radius is None:
        return side
    inner = (radius - side) ** 2 - x**2
    if not inner.min() > 0:
        raise ValueError(f"radius: expected the extent inside of the surface, got {radius}")
    return np.asarray(radius - np.sqrt(inner))


def cap(plan: Footing, *, radius: float | None = None, crown: float | None = None) -> HexMesh:
    """Return the upper body with a flat top; its underside ``CAP`` touches z = 0 at the origin.

    Args:
        plan: Where it lies and how fine it is.
        radius: Radius of the surface in the x-z plane [m]; flat if None.
        crown: Radius in the y-z plane [m]; flat if None.

    Raises:
        ValueError: if the body is empty or the surface rises over half its depth.
    """
    box = grid(*plan.axes(), region=Tag.ROLLER, surfaces={Tag.ZMIN: Tag.CAP})
    x, y, z = box.points.T
    bend = rise(x, y, radius, crown)
    _shallow(bend, plan.depth)
    return box.moved(np.column_stack([x, y, z + bend * (1 - z / plan.depth)]))


def roller(plan: Footing, *, radius: float, crown: float | None = None) -> HexMesh:
    """Return a sector of a ring that can roll: its top ``ZMAX`` is an arc about the axle.

    ``plan.x`` is counted along the running circle. The axle is the line x = 0, z = ``radius``.

    Raises:
        ValueError: if the body is empty, deeper than its radius or turned over half a circle.
    """
    if not plan.depth < radius:
        raise ValueError(f"height: expected < radius = {radius} m, got {plan.depth} m")
    if not max(map(abs, plan.x)) < np.pi / 2 * radius:
        raise ValueError(f"x: expected within a quarter of the circle of {radius} m, got {plan.x}")
    box = grid(*plan.axes(), region=Tag.ROLLER, surfaces={Tag.ZMIN: Tag.CAP})
    s, y, z = box.points.T
    side = rise(np.zeros_like(s), y, None, crown)
    _shallow(side, plan.depth)
    r = radius - z - side * (1 - z / plan.depth)
    angle = s / radius
    return box.moved(np.column_stack([r * np.sin(angle), y, radius - r * np.cos(angle)]))


def below(plan: Footing, *, radius: float | None = None, crown: float | None = None) -> HexMesh:
    """Return the lower body, the mirror image of a :func:`cap` in z = 0; its top is ``BASE_TOP``.

    Arguments and errors as in :func:`cap`.
    """
    x, y, z = plan.axes()
    box = grid(x, y, -z[::-1], region=Tag.BASE, surfaces=BASE_FACES)
    x, y, z = box.points.T
    bend = rise(x, y, radius, crown)
    _shallow(bend, plan.depth)
    return replace(box, points=np.column_stack([x, y, z - bend * (1 + z / plan.depth)]))


def _shallow(bend: Array, depth: float) -> None:
    if not bend.max() < depth / 2:
        raise ValueError(f"depth: expected > {2 * bend.max()} m (twice the rise), got {depth} m")
