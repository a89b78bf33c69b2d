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
    """Names this shape."""
    length: Length
    """Length along x."""
    width: Length
    """Edge of its square section."""
    size: Length
    """Longest edge of the cells."""


class BlocksMesh(Section):
    """A block lying on a base with a mesh that does not match."""

    regions: ClassVar = ("block", "base")
    surfaces: ClassVar = (*SIDES, "block_bottom", "base_bottom", "base_top")

    kind: Literal["block-on-base"]
    """Names this shape."""
    size: Length
    """Longest edge of the cells of the block."""
    base_size: Length
    """Longest edge of the cells of the base."""
    block: tuple[Length, Length, Length]
    """Length, width and height of the block."""
    base: tuple[Length, Length, Length]
    """Length, width and height of the base."""


class CapMesh(Section):
    """A quarter of a spherical cap on a quarter of a flat block, graded to the contact."""

    regions: ClassVar = ("sphere", "base")
    surfaces: ClassVar = (*SIDES, "cap", "base_bottom", "base_top")

    kind: Literal["cap-on-block"]
    """Names this shape."""
    radius: Length
    """Radius of the sphere."""
    extent: Length
    """Edge of the quarter that is modelled; also depth and height."""
    size: Length
    """Edge of the cells at the contact."""
    growth: Growth = 1.2
    """Ratio of neighbouring edges away from the contact."""


class HollowSphereMesh(Section):
    """An eighth of a hollow sphere about the origin, cut along its planes of symmetry."""

    regions: ClassVar = ("sphere",)
    surfaces: ClassVar = ("xmin", "ymin", "zmin", "inside", "outside")

    kind: Literal["hollow-sphere"]
    """Names this shape."""
    inner_radius: Length
    """Radius of the hole."""
    outer_radius: Length
    """Radius of the sphere."""
    size: Length
    """Edge along the radius of the cells at the hole."""
    growth: Growth = 1.2
    """Ratio of neighbouring edges along the radius."""
    across: Count = 6
    """Number of cells along an edge of each of the three patches that the eighth is made of."""

    @model_validator(mode="after")
    def _has_a_wall(self) -> Self:
        if not self.outer_radius > self.inner_radius:
            raise ValueError(
                f"mesh.outer_radius = {self.outer_radius}: expected more than mesh.inner_radius = "
                f"{self.inner_radius} m"
            )
        return self


Ends = tuple[Position, Position]
Place = tuple[Position, Position, Position]


class CurvedMesh(Section):
    """Two curved bodies that touch at the origin, uniform cells in a zone around it."""

    regions: ClassVar = ("roller", "base")
    surfaces: ClassVar = (*SIDES, "cap", "base_bottom", "base_top")

    kind: Literal["curved-on-curved"]
    """Names this shape."""
    size: Length
    """Edge of the cells of the upper body at the contact."""
    base_size: Length | None = None
    """The same of the lower body; `size` if left out."""
    growth: Growth = 1.2
    """Ratio of neighbouring edges outside the fine zone."""
    x: Ends
    """Ends of both bodies along x."""
    fine_x: Ends
    """Ends of the zone of uniform cells along x."""
    y: Ends
    """Ends of both bodies along y."""
    fine_y: Ends | None = None
    """Ends of the zone of uniform cells along y."""
    layers: Count | None = None
    """Number of equal cells along y in place of `fine_y`; 1 between held sides: plane strain."""
    height: Length
    """Height of the upper body."""
    depth: Length
    """Depth of the lower body."""
    radius: Length | None = None
    """Radius of the upper body in the x-z plane; flat if left out."""
    crown: Length | None = None
    """Radius of the upper body in the y-z plane; flat if left out."""
    base_radius: Length | None = Field(default=None, examples=[0.3])
    """Radius of the lower body in the x-z plane; flat if left out."""
    base_crown: Length | None = None
    """Radius of the lower body in the y-z plane; flat if left out."""
    rolls: bool = False
    """Makes the upper body a sector of a ring, `x` counted along its running circle."""

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if (self.fine_y is None) == (self.layers is None):
            raise ValueError("mesh: expected exactly one of fine_y and layers")
        if self.rolls and self.radius is None:
            raise ValueError("mesh.radius: missing; mesh.rolls expects the radius to roll on [m]")
        return self


class Sleepers(Section):
    """Half sleepers under the rail, boxes of a few cells from the track centre outwards."""

    spacing: Length
    """Distance between sleepers."""
    length: Length
    """From the track centre outwards."""
    width: Length
    """Extent along the rail."""
    height: Length
    """Height in the middle of the rail seat."""
    pad: Length
    """Gap between rail seat and rail foot, where the pad is."""
    cells: tuple[Count, Count, Count] = (2, 6, 1)
    """Numbers of cells along width (x), length (y) and height (z)."""


class StripMesh(Section):
    """Narrow cells across the profiles of wheel and rail, where patches are narrow.

    Where no arc lengths are given they reach from the flange pressed into the gauge corner to the
    shoulder where the tread touches as it comes there.
    """

    size: Length
    """Width of the cells along the profile."""
    wheel: Ends | None = Field(default=None, examples=[[0.048, 0.065]])
    """Arc lengths on the wheel profile between which they lie; found if left out."""
    rail: Ends | None = Field(default=None, examples=[[0.023, 0.036]])
    """The same on the rail profile."""


class ProfileAxes(Section):
    """Meaning of the coordinates of a profile file; found from the points where left out."""

    unit: Literal["auto", "m", "cm", "mm", "inch"] = "auto"
    """Unit of the coordinates."""
    origin: Literal["auto", "tape-circle", "flange-back", "rail-axis", "gauge-face"] = "auto"
    """What lies at lateral 0."""
    inner: Literal["auto", "left", "right"] = "auto"
    """Side of the flange or gauge face; left is the least lateral coordinate."""
    outward: Literal["auto", "up", "down"] = "auto"
    """Vertical direction away from the material."""
    part: Count | None = Field(default=None, examples=[1])
    """Which profile of a file that holds several, from 1 on."""


class WheelRailMesh(Section):
    """A wheelset half on a rail in the track position, fine where it will roll."""

    kind: Literal["wheel-on-rail"]
    """Names this mesh."""
    size: Length
    """Edge of the cells where the wheel will roll."""
    wheel_profile: str = "S1002"
    """Built-in profile or a file of points: text, MiniProf, SIMPACK."""
    rail_profile: str = "54E1"
    """Built-in profile or a file of points; a head is joined to web and foot of `rail_base`."""
    rail_base: Literal["54E1", "60E1"] = "54E1"
    """Rail whose web and foot carry a head from a file."""
    profile_smoothing: Distance = 0.0
    """Distance (rms) that the curve may keep from measured points."""
    wheel_axes: ProfileAxes | None = None
    """How the coordinates of the wheel's file are meant; found from the points if left out."""
    rail_axes: ProfileAxes | None = None
    """How the coordinates of the rail's file are meant; found from the points if left out."""
    wheel_design: str = "D_curved_web"
    """Drawing of the web and hub of the wheel."""
    wheel_radius: Length = 0.46
    """Radius at the tape circle."""
    flange_back: Length = 0.070
    """From the flange back to the tape circle."""
    back_to_back: Length = 1.360
    """Distance between the flange backs of both wheels."""
    inclination: Slope = 1 / 40
    """Inclination of the rail towards the track centre: 1/40 is 0.025."""
    gauge: Length = 1.435
    """Track gauge."""
    gauge_depth: Length = 0.014
    """The gauge is measured this far below the rail top."""
    rail_length: Length = 10.0
    """Length of rail that is modelled."""
    start: Position = 0.3
    """First contact, counted from the middle of the rail."""
    flange_gap: Length = 3e-4
    """Gap between flange and gauge corner at the start."""
    lateral_shift: Position | None = Field(default=None, examples=[-0.003])
    """Shift of the wheelset to the field side at the start, in place of `flange_gap`."""
    roll: Angle = 0.0
    """Angle by which the axle rises towards the field side."""
    margin: Length = 0.03
    """Fine mesh beyond the way rolled in `time.end`, at either end."""
    strip: StripMesh | None = None
    """Narrow cells across both profiles; none if left out."""
    sleepers: Sleepers | None = None
    """Solid sleepers under the rail; none if left out."""

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


class RailMesh(Section):
    """A rail in the track position, no wheel; its section is the same all along."""

    kind: Literal["rail"]
    """Names this mesh."""
    size: Length
    """Edge of the cells of the running surface round x = 0, 3 to 24 mm."""
    rail_profile: Literal["54E1", "60E1"] = "54E1"
    """Standard rail."""
    inclination: Slope = 1 / 40
    """Inclination of the rail towards the track centre: 1/40 is 0.025."""
    gauge: Length = 1.435
    """Track gauge."""
    gauge_depth: Length = 0.014
    """The gauge is measured this far below the rail top."""
    rail_length: Length = 10.0
    """Length of rail that is modelled."""
    start: Position = 0.3
    """Place of x = 0, counted from the middle of the rail."""
    fine_length: Length = 0.05
    """Length of rail round x = 0 with short cells."""
    longest: Length = 0.1
    """Longest cells along the rail."""
    sleepers: Sleepers | None = None
    """Solid sleepers under the rail, one under its middle; none if left out."""

    @property
    def regions(self) -> tuple[str, ...]:
        """Names of the regions."""
        own = ("rail_head", "rail_web", "rail_foot")
        return (*own, "sleeper") if self.sleepers else own

    @property
    def surfaces(self) -> tuple[str, ...]:
        """Names of the surfaces."""
        rail = ("railhead", "foot_underside", "rail_ends", "rail_skin")
        below = ("sleeper_top", "sleeper_bottom", "sleeper_inner", "sleeper_skin")
        return (*rail, *(below if self.sleepers else ()))


class FileMesh(Section):
    """A hexahedral mesh from a file of another program; its named groups are regions and surfaces.

    A wheel that rolls needs ``wheel_centre`` and ``rolling_radius``.
    """

    kind: Literal["file"]
    """Names this source."""
    path: str = Field(examples=["wheel.msh"])
    """Mesh file, from the scene's folder: gmsh, Abaqus, Salome, anything meshio reads."""
    scale: Length = 1.0
    """Length of the file's unit."""
    groups: dict[str, str] | None = Field(default=None, examples=[{"RAIL_TOP": "railhead"}])
    """Groups to use, by their name in the file, and what to call them; all if left out."""
    size: Length | None = Field(default=None, examples=[0.001])
    """Edge of the cells where bodies touch; the shortest of the mesh if left out."""
    wheel_centre: Place | None = Field(default=None, examples=[[0.0, 0.75, 0.46]])
    """A point of the axle of a wheel that rolls."""
    rolling_radius: Length | None = Field(default=None, examples=[0.46])
    """Radius of a wheel that rolls at its first contact."""

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

    The model is a script (``path``), a function by name (``function``) or one given from Python,
    ``run(scene, out, mesh=function)``. A wheel that rolls needs ``wheel_centre`` and
    ``rolling_radius``.
    """

    kind: Literal["gmsh"]
    """Names this source."""
    path: str | None = Field(default=None, examples=["ball-on-block.geo"])
    """Script of gmsh (`.geo`), from the scene's folder."""
    function: str | None = Field(default=None, examples=["ball:make"])
    """Function that builds the model: `file:name` of a Python file, from the scene's folder."""
    parameters: dict[str, int | Number | str | list[Number]] = Field(default_factory=dict)
    """Variables of the script or keywords of the function."""
    regions: tuple[str, ...] = Field(min_length=1)
    """Physical groups of hexahedra, in any case."""
    surfaces: tuple[str, ...] = ()
    """Physical groups of quadrilaterals, in any case."""
    size: Length | None = None
    """Edge of the cells where bodies touch, given to the model as `size`."""
    wheel_centre: Place | None = Field(default=None, examples=[[0.0, 0.75, 0.46]])
    """A point of the axle of a wheel that rolls."""
    rolling_radius: Length | None = Field(default=None, examples=[0.46])
    """Radius of a wheel that rolls at its first contact."""

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
