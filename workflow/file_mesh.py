# SPDX-License-Identifier: LGPL-3.0-or-later
"""The table of a scene that takes its mesh from a file."""

from pathlib import Path
from typing import TYPE_CHECKING, Literal, Self

from pydantic import field_validator, model_validator

from workflow.quantities import Length, Position
from workflow.sections import Section

if TYPE_CHECKING:
    from meshes.formats.contents import Groups


class FileMesh(Section):
    """A hexahedral mesh from a file of another program; its named groups are regions and surfaces.

    ``scale`` is the length of the file's unit. ``groups`` names the groups to use, by their name in
    the file, and what to call them here; all are used if it is left out. ``size`` is the edge of
    the cells where bodies touch, the shortest of the mesh if left out. A wheel that rolls needs
    ``wheel_centre``, a point of its axle, and ``rolling_radius`` at its first contact.
    """

    kind: Literal["file"]
    path: str
    scale: Length = 1.0
    groups: dict[str, str] | None = None
    size: Length | None = None
    wheel_centre: tuple[Position, Position, Position] | None = None
    rolling_radius: Length | None = None

    @field_validator("path")
    @classmethod
    def _absolute(cls, path: str) -> str:
        return str(Path(path).absolute())  # a result's scene.toml runs again from anywhere

    @model_validator(mode="after")
    def _has_regions(self) -> Self:
        if not self.names.regions:
            raise ValueError(
                f"mesh.path = {self.path!r}: expected named groups of hexahedra, got "
                f"{self.names.listed}"
            )
        return self

    @property
    def names(self) -> "Groups":
        """Names of the groups that are used; read from the file."""
        from meshes.formats.contents import groups

        try:
            return groups(self.path).chosen(self.groups)
        except (ValueError, OSError) as error:
            raise ValueError(f"mesh.path = {self.path!r}: {error}") from None

    @property
    def regions(self) -> tuple[str, ...]:
        """Names of the regions."""
        return self.names.regions

    @property
    def surfaces(self) -> tuple[str, ...]:
        """Names of the surfaces."""
        return self.names.surfaces
