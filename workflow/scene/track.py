# SPDX-License-Identifier: LGPL-3.0-or-later
"""Tables of springs and dampers: vehicle, track, absorbing boundaries."""

from typing import Literal, Self

from pydantic import model_validator

from workflow.scene.settings import Section
from workflow.scene.units import Damping, Length, Mass, Speed, Stiffness


class Vehicle(Section):
    """Sprung mass on the vertical primary suspension of one axle box."""

    journal: str
    sprung_mass: Mass
    suspension_stiffness: Stiffness
    suspension_damping: Damping


class Track(Section):
    """Pads, sleepers and ballast under the rail; pads as (longitudinal, lateral, vertical).

    Pads lie over ``seat_length`` on each sleeper. Sleepers are solids if ``sleeper_top`` and
    ``sleeper_bottom`` name their surfaces, else point masses of ``sleeper_mass`` at every
    ``sleeper_spacing`` that move vertically. ``ends`` says what becomes of the rail's ends: held
    along it, free, or on dashpots that let waves along the rail out.
    """

    seat: str
    seat_length: Length
    sleeper_top: str | None = None
    sleeper_bottom: str | None = None
    sleeper_mass: Mass | None = None
    sleeper_spacing: Length | None = None
    pad_stiffness: tuple[Stiffness, Stiffness, Stiffness]
    pad_damping: tuple[Damping, Damping, Damping]
    ballast_stiffness: Stiffness
    ballast_damping: Damping
    ends: Literal["fixed", "free", "absorbing"] = "free"
    end_surface: str = "rail_ends"

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

    The point stands still until time zero and moves with ``velocity`` from then on. Stiffness and
    damping are those along x, y and z; bodies at their places in the mesh do not stretch it.
    """

    surface: str
    stiffness: tuple[Stiffness, Stiffness, Stiffness]
    damping: tuple[Damping, Damping, Damping] = (0.0, 0.0, 0.0)
    velocity: tuple[Speed, Speed, Speed] = (0.0, 0.0, 0.0)


class Absorbing(Section):
    """A surface on dashpots that let waves out; at rest it is free.

    ``waves`` are ``plane`` ones in a wide body, or those along a slender ``bar``.
    """

    surface: str
    waves: Literal["plane", "bar"] = "plane"
