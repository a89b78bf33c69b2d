# SPDX-License-Identifier: LGPL-3.0-or-later
"""Tables ``[mesh]`` of a scene: shapes with closed forms, wheel on rail, mesh files, gmsh."""

from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal, Self

from pydantic import (
    Field,
    field_validator,
    model_validator,
)

from workflow.scene.units import (
    Angle,
    Count,
    Distance,
    Growth,
    Length,
    Number,
    Position,
    Section,
    Slope,
)

if TYPE_CHECKING:
    from meshes.formats.contents import Groups

DRAWN = ("S1002", "54E1", "60E1")  # profiles that are no files
# keys whose value may be a file
FILES = ("mesh.path", "mesh.function", "mesh.wheel_profile", "mesh.rail_profile")
SIDES = ("xmin", "xmax", "ymin", "ymax", "zmax")  # and zmin, where nothing lies below


class BarMesh(Section):
    """A straight bar along x, one end at x = 0."""

    regions: ClassVar = ("bar",)
    surfaces: ClassVar = (*SIDES, "zmin")

    kind: Literal["bar"]
    length: Length
    width: Length
    size: Length


class BlocksMesh(Section):
    """A block lying on a base with a mesh that does not match."""

    regions: ClassVar = ("block", "base")
    surfaces: ClassVar = (*SIDES, "block_bottom", "base_bottom", "base_top")

    kind: Literal["block-on-base"]
    size: Length
    base_size: Length
    block: tuple[Length, Length, Length]
    base: tuple[Length, Length, Length]


class CapMesh(Section):
    """A quarter of a spherical cap on a quarter of a flat block, graded to the contact."""

    regions: ClassVar = ("sphere", "base")
    surfaces: ClassVar = (*SIDES, "cap", "base_bottom", "base_top")

    kind: Literal["cap-on-block"]
    radius: Length
    extent: Length
    size: Length
    growth: Growth = 1.2


Ends = tuple[Position, Position]


class CurvedMesh(Section):
    """Two curved bodies that touch at the origin, uniform cells in a zone around it.

    ``radius`` lies in the x-z plane and ``crown`` across it; one left out is flat. ``layers`` equal
    cells along y take the place of ``fine_y``, one of them makes plane strain between held sides.
    With ``rolls`` the upper body is a sector of a ring, ``x`` counted along its running circle.
    """

    regions: ClassVar = ("roller", "base")
    surfaces: ClassVar = (*SIDES, "cap", "base_bottom", "base_top")

    kind: Literal["curved-on-curved"]
    size: Length
    base_size: Length | None = None
    growth: Growth = 1.2
    x: Ends
    fine_x: Ends
    y: Ends
    fine_y: Ends | None = None
    layers: Count | None = None
    height: Length
    depth: Length
    radius: Length | None = None
    crown: Length | None = None
    base_radius: Length | None = None
    base_crown: Length | None = None
    rolls: bool = False

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if (self.fine_y is None) == (self.layers is None):
            raise ValueError("mesh: expected exactly one of fine_y and layers")
        if self.rolls and self.radius is None:
            raise ValueError("mesh.radius: missing; mesh.rolls expects the radius to roll on [m]")
        return self


class Sleepers(Section):
    """Half sleepers under the rail, boxes of a few cells from the track centre outwards.

    ``height`` is that in the middle of the rail seat, ``pad`` the gap between seat and rail.
    """

    spacing: Length
    length: Length
    width: Length
    height: Length
    pad: Length
    cells: tuple[Count, Count, Count] = (2, 6, 1)


class StripMesh(Section):
    """Narrow cells across the profiles of wheel and rail, where patches are narrow.

    ``size`` is their width along the profile. ``wheel`` and ``rail`` are the arc lengths between
    which they lie; left out, from the flange pressed into the gauge corner to the shoulder where
    the tread touches as it comes there.
    """

    size: Length
    wheel: Ends | None = None
    rail: Ends | None = None


class ProfileAxes(Section):
    """How the coordinates of a profile file are meant; what is left out is found from the points.

    ``origin`` is what lies at lateral 0, ``inner`` the side of flange or gauge face (left is the
    least lateral coordinate), ``outward`` the vertical direction away from the material, ``part``
    which profile of a file that holds several.
    """

    unit: Literal["auto", "m", "cm", "mm", "inch"] = "auto"
    origin: Literal["auto", "tape-circle", "flange-back", "rail-axis", "gauge-face"] = "auto"
    inner: Literal["auto", "left", "right"] = "auto"
    outward: Literal["auto", "up", "down"] = "auto"
    part: Count | None = None


class WheelRailMesh(Section):
    """A wheelset half on a rail in the track position, fine where it will roll.

    A profile is the name of a built-in one or of a file of points: text, MiniProf, SIMPACK; a rail
    head from a file is joined to web and foot of ``rail_base``. The tape circle lies
    ``flange_back`` from the flange back, the gauge is measured ``gauge_depth`` below the rail top.
    ``lateral_shift``, if given, takes the place of ``flange_gap``. ``roll`` is the angle by which
    the axle rises towards the field side.
    """

    kind: Literal["wheel-on-rail"]
    size: Length
    wheel_profile: str = "S1002"
    rail_profile: str = "54E1"
    rail_base: Literal["54E1", "60E1"] = "54E1"
    profile_smoothing: Distance = 0.0
    wheel_axes: ProfileAxes | None = None
    rail_axes: ProfileAxes | None = None
    wheel_design: str = "D_curved_web"
    wheel_radius: Length = 0.46
    flange_back: Length = 0.070
    back_to_back: Length = 1.360
    inclination: Slope = 1 / 40
    gauge: Length = 1.435
    gauge_depth: Length = 0.014
    rail_length: Length = 10.0
    start: Position = 0.3
    flange_gap: Length = 3e-4
    lateral_shift: Position | None = None
    roll: Angle = 0.0
    margin: Length = 0.03
    strip: StripMesh | None = None
    sleepers: Sleepers | None = None

    @field_validator("wheel_profile", "rail_profile")
    @classmethod
    def _absolute(cls, name: str) -> str:
        """Name a file so that a result's scene.toml runs again from anywhere."""
        file = name not in DRAWN and Path(name).is_file()
        return str(Path(name).absolute()) if file else name

    @property
    def regions(self) -> tuple[str, ...]:
        """Names of the regions."""
        own = ("tyre", "web", "hub", "axle", "rail_head", "rail_web", "rail_foot")
        return (*own, "sleeper") if self.sleepers else own

    @property
    def surfaces(self) -> tuple[str, ...]:
        """Names of the surfaces."""
        wheelset = ("tread", "axle_inner", "axle_outer", "journal", "wheelset_skin")
        rail = ("railhead", "foot_underside", "rail_ends", "rail_skin")
        below = ("sleeper_top", "sleeper_bottom", "sleeper_inner", "sleeper_skin")
        return (*wheelset, *rail, *(below if self.sleepers else ()))


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


class GmshMesh(Section):
    """A model of gmsh, meshed for the run; its physical groups are regions and surfaces.

    The model is a script (``path``, a ``.geo``), a function by name (``function``, ``file:name`` of
    a Python file) or one given from Python (``run(scene, out, mesh=function)``). ``parameters`` are
    variables of a script, keywords of a function; ``size``, the edge of the cells where bodies
    touch, is one more if it is told. ``regions`` and ``surfaces`` name the groups to use, in any
    case. A wheel that rolls needs ``wheel_centre`` and ``rolling_radius``, as with a mesh file.
    """

    kind: Literal["gmsh"]
    path: str | None = None
    function: str | None = None
    parameters: dict[str, int | Number | str | list[Number]] = Field(default_factory=dict)
    regions: tuple[str, ...] = Field(min_length=1)
    surfaces: tuple[str, ...] = ()
    size: Length | None = None
    wheel_centre: tuple[Position, Position, Position] | None = None
    rolling_radius: Length | None = None

    @field_validator("path", "function")
    @classmethod
    def _absolute(cls, path: str | None) -> str | None:
        return None if path is None else str(Path(path).absolute())

    @field_validator("regions", "surfaces")
    @classmethod
    def _lower(cls, names: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(name.lower() for name in names)

    @model_validator(mode="after")
    def _one_model(self) -> Self:
        if self.path is not None and self.function is not None:
            raise ValueError("mesh: expected path or function, got both")
        if self.path is not None and not self.path.lower().endswith(".geo"):
            raise ValueError(f"mesh.path = {self.path!r}: expected a script of gmsh, .geo")
        if self.function is not None and not self.file_and_name[1].isidentifier():
            raise ValueError(f"mesh.function = {self.function!r}: expected 'file:name'")
        if "size" in self.parameters:
            raise ValueError("mesh.parameters.size: expected mesh.size, which is given as size too")
        return self

    @property
    def source(self) -> str | None:
        """Which key names the model, None if none does."""
        return next((key for key in ("path", "function") if getattr(self, key)), None)

    @property
    def file_and_name(self) -> tuple[Path, str]:
        """The Python file and the name of the function in it."""
        file, _, name = (self.function or "").partition(":")
        return Path(file if file.endswith(".py") else f"{file}.py"), name


Foreign = FileMesh | GmshMesh  # meshes that other programs make
