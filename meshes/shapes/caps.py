# SPDX-License-Identifier: LGPL-3.0-or-later
"""Two curved bodies that touch at the origin: caps, cylinders, crossed crowns, and rollers.

Tensor grids, uniform in a zone around the contact and graded outside, bent to their surfaces.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from meshes.arrays import Array
from meshes.hexmesh import HexMesh
from meshes.shapes.blocks import BASE_FACES, block, grid
from meshes.spacing import graded, graded_cells, positive, zoned, zoned_cells
from meshes.tags import Tag

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
        return x, y, graded(self.depth, self.size, growth=self.growth)

    def cells(self) -> tuple[int, int, int]:
        """Return the numbers of cells along these axes, which are not made; it raises as they."""
        x = zoned_cells("x", self.x, self.fine_x, self.size, self.growth)
        y = self.layers or zoned_cells("y", self.y, self.fine_y, self.size, self.growth)
        return x, y, graded_cells(self.depth, self.size, self.growth)


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
    x, y, _ = box.points.T
    return _bent(box, rise(x, y, radius, crown), plan.depth)


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
    x, y, _ = box.points.T
    return _bent(box, -rise(x, y, radius, crown), -plan.depth)


def sphere_cap(
    radius: float,
    extent: float,
    *,
    size: float,
    growth: float = 1.2,
    height: float | None = None,
    surfaces: Mapping[Tag, Tag] | None = None,
) -> HexMesh:
    """Return a quarter of a spherical cap that touches the plane z = 0 at the origin.

    A graded box whose underside is bent up to ``z = R - sqrt(R² - r²)``; the bending fades
    linearly to zero at the flat top. Cells are finest at the origin. The underside is ``CAP``, the
    symmetry planes are ``XMIN`` and ``YMIN``, the top is ``ZMAX``.

    Args:
        radius: Radius R of the sphere [m].
        extent: Side of the square that the quarter covers [m].
        size: Largest edge of the finest cells [m].
        growth: Ratio of neighbouring edges, at least 1 [-].
        height: Height of the flat top above the plane [m]; ``extent`` if not given.
        surfaces: New tags for some of ``XMIN … ZMAX``; ``ZMIN`` is ``CAP`` unless named here.

    Raises:
        ValueError: if a length is not positive, or the cap does not fit into sphere and height.
    """
    positive("radius", radius)
    positive("extent", extent)
    height = extent if height is None else height
    positive("height", height)
    if not np.sqrt(2) * extent < radius:
        raise ValueError(f"extent: expected < radius/sqrt(2) = {radius / np.sqrt(2)}, got {extent}")
    box = block(
        (0.0, 0.0, 0.0),
        (extent, extent, height),
        size=size,
        growth=growth,
        fine=(-1, -1, -1),
        region=Tag.SPHERE,
        surfaces={Tag.ZMIN: Tag.CAP, **(surfaces or {})},
    )
    x, y, _ = box.points.T
    return _bent(box, radius - np.sqrt(radius**2 - x**2 - y**2), height, "height")


def base(
    extent: float,
    depth: float | None = None,
    *,
    size: float,
    growth: float = 1.2,
    surfaces: Mapping[Tag, Tag] | None = BASE_FACES,
) -> HexMesh:
    """Return the quarter block below z = 0 that a :func:`sphere_cap` rests on.

    Args:
        extent: Side in x and y [m].
        depth: Extent below the plane [m]; ``extent`` if not given.
        size: Largest edge of the finest cells, which are at the origin [m].
        growth: Ratio of neighbouring edges, at least 1 [-].
        surfaces: New tags for some of ``XMIN … ZMAX``.

    Raises:
        ValueError: if a length is not positive.
    """
    depth = extent if depth is None else depth
    positive("extent", extent)
    positive("depth", depth)
    lower, upper = (0.0, 0.0, -depth), (extent, extent, 0.0)
    return block(
        lower,
        upper,
        size=size,
        growth=growth,
        fine=(-1, -1, 1),
        region=Tag.BASE,
        surfaces=surfaces,
    )


def _bent(box: HexMesh, rise: Array, height: float, name: str = "depth") -> HexMesh:
    """Return a box whose face z = 0 is moved to z = ``rise``, fading to nothing at ``height`` [m].

    Raises:
        ValueError: if the face moves over half the height, which is called ``name``.
    """
    _shallow(rise, height, name)
    x, y, z = box.points.T
    return box.moved(np.column_stack([x, y, z + rise * (1 - z / height)]))


def _shallow(rise: Array, height: float, name: str = "depth") -> None:
    most, limit = float(np.abs(rise).max()), abs(height)
    if not most < limit / 2:
        raise ValueError(f"{name}: expected > {2 * most} m (twice the rise), got {limit} m")
