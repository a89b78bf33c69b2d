# SPDX-License-Identifier: LGPL-3.0-or-later
"""Probes of a scene: places whose motion is sampled more often than there are outputs."""

from collections.abc import Iterator
from typing import Literal, Self

from pydantic import Field, model_validator

from workflow.quantities import Position, Section


class Probe(Section):
    """A place in the material whose motion is sampled.

    ``point`` takes the nearest node, of the named ``surface`` or ``region`` if there is one.
    Without it, the mean of the surface (by area) or region (by mass: its centre of mass) is taken.
    """

    name: str = Field(pattern=r"^[\w-]+$")
    point: tuple[Position, Position, Position] | None = None
    surface: str | None = None
    region: str | None = None
    quantity: Literal["velocity", "displacement", "acceleration"] = "velocity"

    @model_validator(mode="after")
    def _one_place(self) -> Self:
        if self.surface is not None and self.region is not None:
            raise ValueError(
                f"probes.{self.name}: expected a surface or a region, got {self.surface!r} and "
                f"{self.region!r}"
            )
        if self.point is None and self.surface is None and self.region is None:
            raise ValueError(f"probes.{self.name}: expected a point, surface or region, got none")
        return self


def unfit(probes: list[Probe], regions: list[str], interval: float | None) -> Iterator[str]:
    """Yield a line for everything about probes that does not fit the rest of their scene.

    Args:
        probes: The probes.
        regions: Regions of the mesh.
        interval: ``output.sample_interval`` [s].
    """
    names = [probe.name for probe in probes]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        yield f"probes: expected each name once, got {twice} more than once"
    for i, probe in enumerate(probes):
        if probe.region is not None and probe.region.lower() not in regions:
            yield f"probes.{i}.region = {probe.region!r}: expected one of {list(regions)}"
    if probes and interval is None:
        yield "output.sample_interval: missing; probes expect an interval to sample them at [s]"
