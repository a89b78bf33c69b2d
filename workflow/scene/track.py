# SPDX-License-Identifier: LGPL-3.0-or-later
"""Tables of springs and dampers: vehicle, track, absorbing boundaries."""

from typing import Literal, Self

from pydantic import Field, model_validator

from workflow.scene.settings import Section
from workflow.scene.units import Damping, Length, Mass, Speed, Stiffness


class Vehicle(Section):
    """Sprung mass on the vertical primary suspension of one axle box."""

    journal: str
    """Surface that carries the axle box."""
    sprung_mass: Mass
    """Mass that the spring carries."""
    suspension_stiffness: Stiffness
    """Vertical stiffness of the primary suspension."""
    suspension_damping: Damping
    """Vertical damping of the primary suspension."""


class Track(Section):
    """Pads, sleepers and ballast under the rail.

    Sleepers are solids if ``sleeper_top`` and ``sleeper_bottom`` name their surfaces, else point
    masses of ``sleeper_mass`` at every ``sleeper_spacing``.
    """

    seat: str
    """Surface of the rail that lies on the pads."""
    seat_length: Length
    """Length of the pads along the rail, one on each sleeper."""
    sleeper_top: str | None = None
    """Surface of solid sleepers under the pads."""
    sleeper_bottom: str | None = None
    """Surface of solid sleepers on the ballast."""
    sleeper_mass: Mass | None = Field(default=None, examples=[219.0])
    """Mass of each sleeper as a point mass that moves vertically."""
    sleeper_spacing: Length | None = Field(default=None, examples=[0.6])
    """Distance between sleepers as point masses."""
    pad_stiffness: tuple[Stiffness, Stiffness, Stiffness]
    """Stiffness of a pad: longitudinal, lateral, vertical."""
    pad_damping: tuple[Damping, Damping, Damping]
    """Damping of a pad: longitudinal, lateral, vertical."""
    ballast_stiffness: Stiffness
    """Vertical stiffness of the ballast under a sleeper."""
    ballast_damping: Damping
    """Vertical damping of the ballast under a sleeper."""
    ends: Literal["fixed", "free", "absorbing"] = "free"
    """The rail's ends: held along it, free, or on dashpots that let waves along the rail out."""
    end_surface: str = "rail_ends"
    """Surface of the rail's ends."""

    @model_validator(mode="after")
    def _one_kind_of_sleeper(self) -> Self:
        solid = ("sleeper_top", "sleeper_bottom")
        point = ("sleeper_mass", "sleeper_spacing")
        given = {key for key in solid + point if getattr(self, key) is not None}
        if given not in (set(solid), set(point)):
            raise ValueError(
                f"track: expected either {' and '.join(solid)} (solid sleepers) or "
                f"{' and '.join(point)} (point masses), got {', '.join(sorted(given)) or 'neither'}"
            )
        return self


class Spring(Section):
    """A spring and damper from the mean motion of a surface to a point.

    The point stands still until time zero. Bodies at their places in the mesh do not stretch it.
    """

    surface: str
    """Surface whose mean motion the spring follows."""
    stiffness: tuple[Stiffness, Stiffness, Stiffness]
    """Stiffness along x, y and z."""
    damping: tuple[Damping, Damping, Damping] = (0.0, 0.0, 0.0)
    """Damping along x, y and z."""
    velocity: tuple[Speed, Speed, Speed] = (0.0, 0.0, 0.0)
    """Velocity of the other end from time zero on."""


class Absorbing(Section):
    """A surface on dashpots that let waves out; at rest it is free."""

    surface: str = Field(examples=["xmax"])
    """Surface that lets waves out."""
    waves: Literal["plane", "bar"] = "plane"
    """Which waves: plane ones in a wide body, or those along a slender bar."""
