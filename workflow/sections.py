# SPDX-License-Identifier: LGPL-3.0-or-later
"""The tables that a scene is made of: shapes, bodies, contacts, supports, loads, motion, time."""

from functools import partial
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import (
    Discriminator,
    Field,
    Tag,
    field_validator,
    model_validator,
)

from workflow.friction_tables import FrictionLaw
from workflow.quantities import (
    Angle,
    Component,
    Count,
    Delay,
    Density,
    Direction,
    Distance,
    Duration,
    Factor,
    Growth,
    Length,
    Minutes,
    Modulus,
    Position,
    Rate,
    Ratio,
    Section,
    Share,
    Slope,
    Speed,
    Spin,
    Step,
    Stress,
)

Axis = tuple[Component, Component, Component]
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


class WheelRailMesh(Section):
    """A wheelset half on a rail in the track position, fine where it will roll.

    A profile is the name of a built-in one or of a CSV file; a rail head from a file is joined to
    web and foot of ``rail_base``. ``lateral_shift``, if given, takes the place of ``flange_gap``.
    """

    kind: Literal["wheel-on-rail"]
    size: Length
    wheel_profile: str = "S1002"
    rail_profile: str = "54E1"
    rail_base: Literal["54E1", "60E1"] = "54E1"
    profile_smoothing: Distance = 0.0
    wheel_design: str = "D_curved_web"
    wheel_radius: Length = 0.46
    inclination: Slope = 1 / 40
    gauge: Length = 1.435
    rail_length: Length = 10.0
    start: Position = 0.3
    flange_gap: Length = 3e-4
    lateral_shift: Position | None = None
    margin: Length = 0.03
    sleepers: Sleepers | None = None

    @field_validator("rail_profile", "rail_base", mode="before")
    @classmethod
    def _named(cls, name: Any) -> Any:
        """Take 54E1 and 60E1 as names though ``--set`` reads them as numbers."""
        return {54e1: "54E1", 60e1: "60E1"}.get(name, name) if isinstance(name, float) else name

    @field_validator("wheel_profile", "rail_profile")
    @classmethod
    def _absolute(cls, name: str) -> str:
        """Name a file so that a result's scene.toml runs again from anywhere."""
        return str(Path(name).absolute()) if Path(name).is_file() else name

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


class Isotropic(Section):
    """Isotropic elastic material; ``hooke`` in total Lagrangian form is St. Venant-Kirchhoff's."""

    law: Literal["hooke", "neo-hookean"] = "hooke"
    youngs_modulus: Modulus
    poisson_ratio: Ratio
    density: Density

    def constants(self, damping: float = 0.0) -> Any:
        """Return the elastic constants as the forms take them."""
        from forms.elasticity import Elastic

        return Elastic(self.youngs_modulus, self.poisson_ratio, self.density, damping)


class Orthotropic(Section):
    """Linear material with three planes of symmetry; pairs of axes in the order 12, 13, 23."""

    law: Literal["orthotropic"]
    youngs_moduli: tuple[Modulus, Modulus, Modulus]
    poisson_ratios: tuple[Component, Component, Component]
    shear_moduli: tuple[Modulus, Modulus, Modulus]
    axes: tuple[Axis, Axis, Axis] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    density: Density

    def constants(self, damping: float = 0.0) -> Any:
        """Return the elastic constants as the forms take them.

        Raises:
            ValueError: if the axes are not orthonormal or an energy is not positive.
        """
        from forms import materials

        moduli, ratios, shear = self.youngs_moduli, self.poisson_ratios, self.shear_moduli
        return materials.Orthotropic(moduli, ratios, shear, self.density, damping, self.axes)


def law_of(material: Any) -> str:
    """Return which table of a material is meant, ``orthotropic`` or ``isotropic``."""
    get = material.get if isinstance(material, dict) else partial(getattr, material)
    return "orthotropic" if get("law", "hooke") == "orthotropic" else "isotropic"


Material = Annotated[
    Annotated[Isotropic, Tag("isotropic")] | Annotated[Orthotropic, Tag("orthotropic")],
    Discriminator(law_of),
]


class BulkViscosity(Section):
    """Pressure against fast compression, which spreads shocks over a few cells."""

    linear: Share = 0.06
    quadratic: Share = 1.5


class Body(Section):
    """Regions of the mesh that share a material, an element and kinematics.

    ``element`` is ``full`` (2x2x2 points), ``one-point`` with hourglass control (its stiffness from
    the material unless ``hourglass_coefficient`` is given) or ``selective``, which does not lock at
    Poisson ratios near 1/2.
    """

    regions: list[str] = Field(min_length=1)
    material: Material
    kinematics: Literal["small-strain", "total-lagrangian"] = "small-strain"
    element: Literal["full", "one-point", "selective"] = "full"
    hourglass_coefficient: Factor | None = None
    stiffness_damping: Delay = 0.0
    mass_damping: Rate = 0.0
    bulk_viscosity: BulkViscosity | None = None
    velocity: tuple[Speed, Speed, Speed] | None = None


class RigidWall(Section):
    """A rigid plane as target."""

    origin: tuple[Position, Position, Position]
    normal: tuple[Component, Component, Component]
    half_width: Length


class Contact(Section):
    """Contactor nodes against target facets; with ``keep`` a run stops where they part.

    ``method`` is ``penalty`` (springs of ``penalty`` times effective mass over dt²),
    ``modulus-penalty`` (``penalty`` times bulk modulus, area and area over volume of the cells
    behind) or ``lagrange`` (no penetration). In ``two_pass`` each surface is contactor once. A
    ``smooth`` target is curved by averaged normals but for edges over ``sharp_angle``.
    ``initial_overlap`` that no static solve has made is left out of the gap (``offset``), for good
    or fading over ``offset_time``, or pushes the bodies apart (``push``).
    """

    contactor: str
    target: str | RigidWall
    friction: FrictionLaw = 0.0
    method: Literal["penalty", "modulus-penalty", "lagrange"] = "penalty"
    penalty: Factor = 0.2
    damping: Share = 0.0
    two_pass: bool = False
    smooth: bool = False
    sharp_angle: float = Field(0.7, strict=True, gt=0, lt=3.14, json_schema_extra={"unit": "rad"})
    initial_overlap: Literal["offset", "push"] = "offset"
    offset_time: Delay = 0.0
    stick_tolerance: Share = 0.05
    keep: bool = False

    @model_validator(mode="after")
    def _method_fits(self) -> Self:
        if self.method == "lagrange" and self.damping:
            raise ValueError(
                f"contacts: damping = {self.damping}: expected 0 with method = 'lagrange', whose "
                "impacts are plastic"
            )
        if self.two_pass and (self.method == "lagrange" or isinstance(self.target, RigidWall)):
            raise ValueError(
                "contacts: two_pass = true: expected a penalty method and two deformable surfaces"
            )
        return self


class Support(Section):
    """A surface held in some directions; ``axle`` is the axis of the yawed wheelset."""

    surface: str
    directions: list[Direction] = Field(min_length=1)


class Driven(Section):
    """A body carried by one of its surfaces in a steady rigid motion, from time zero on.

    ``spin`` turns it about an axis through ``centre`` of the mesh, which moves with ``velocity``.
    With ``steady_start`` the pattern of deformation at rest stays where it is and the material
    flows through it, as in rolling; without, the pattern is carried along. ``shift`` is moved on
    top of that within ``shift_time``, from rest to rest.
    """

    surface: str
    velocity: tuple[Speed, Speed, Speed] = (0.0, 0.0, 0.0)
    spin: tuple[Spin, Spin, Spin] = (0.0, 0.0, 0.0)
    centre: tuple[Position, Position, Position] = (0.0, 0.0, 0.0)
    steady_start: bool = False
    shift: tuple[Position, Position, Position] = (0.0, 0.0, 0.0)
    shift_time: Delay = 0.0

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if any(self.shift) != (self.shift_time > 0):
            raise ValueError(
                f"driven: expected shift and shift_time together, got {self.shift} m in "
                f"{self.shift_time} s"
            )
        return self

    @property
    def support(self) -> Support:
        """The support that the surface is while the bodies are brought to rest."""
        return Support(surface=self.surface, directions=["x", "y", "z"])


class Load(Section):
    """A dead traction on a surface."""

    surface: str
    traction: tuple[Stress, Stress, Stress]


class Rolling(Section):
    """Start of rolling: travel, spin and drive of the wheelset."""

    body: str
    driven_region: str
    speed: Speed
    angle_of_attack: Angle = 0.0
    travel_angle: Angle | None = None
    traction_coefficient: Share = 0.0
    torque_ramp: Delay = 0.0
    steady_start: bool = True

    @property
    def travel(self) -> float:
        """Direction of travel against the rail [rad]; the wheel's own plane unless given."""
        return self.angle_of_attack if self.travel_angle is None else self.travel_angle


class Relaxation(Section):
    """Dynamic relaxation: velocities shrink at every step until nothing moves any more.

    ``velocity_factor`` is what they are multiplied by; left out, it is found from the lowest
    frequency that is seen in the motion. At rest the largest kinetic over internal energy of
    ``check_interval`` steps is below ``tolerance``. With ``mass_scaling`` each cell gets the mass
    that makes it as fast as the step allows: masses do not matter at rest.
    """

    velocity_factor: Annotated[float, Field(gt=0, lt=1)] | None = None
    tolerance: Factor = 1e-8
    check_interval: Count = 250
    max_steps: Count = 100_000
    mass_scaling: bool = True


class Equilibrium(Section):
    """Rest before time zero; ``approach`` moves a body into touch as first guess.

    ``shift`` then moves the wheelset along its axle, to where the run is to start. ``tolerance``
    and ``max_iterations`` are those of the static solve, ``relaxation`` is the other method.
    """

    method: Literal["static", "relaxation"] = "static"
    relaxation: Relaxation = Relaxation()
    tolerance: Factor = 1e-6
    max_iterations: Count = 40
    approach: dict[str, tuple[Position, Position, Position]] = Field(default_factory=dict)
    hold: list[Support] = Field(default_factory=list)
    shift: Position = 0.0
    shift_increments: Count = 5


class Time(Section):
    """Duration, outputs and step of a run.

    ``bound`` is what the step is measured against: the ``assembled`` system with its contact and
    other springs, or the stiffest ``cell``, 20 to 50 % shorter. ``precision`` is that of the
    internal forces; all else is computed in float64.
    """

    end: Duration
    output_interval: Duration
    safety: Step = 0.9
    bound: Literal["cell", "assembled"] = "assembled"
    precision: Literal["float64", "float32"] = "float64"


class Guards(Section):
    """When a run is stopped; ``penetration`` is a share of the contactor's cell at the node."""

    energy_error: Factor = 0.05
    penetration: Factor = 0.5
    check_interval: Count = 50


class Output(Section):
    """What a run leaves besides its history.

    A checkpoint to go on from is written every ``checkpoint_minutes`` of wall time, or every so
    many steps, and at the end; 0 minutes: none.
    """

    fields: bool = True
    checkpoint_minutes: Minutes = 10.0
    checkpoint_steps: Count | None = None
