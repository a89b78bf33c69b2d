# SPDX-License-Identifier: LGPL-3.0-or-later
"""Tables of contacts, supports, loads, motion, time, guards and output."""

from collections.abc import Iterator
from math import hypot
from typing import Annotated, Any, Literal, Self

from pydantic import Discriminator, Field, Tag, model_validator

from workflow.scene.contacts import FrictionLaw
from workflow.scene.units import (
    Angle,
    Component,
    Count,
    Delay,
    Direction,
    Duration,
    Factor,
    Length,
    Mass,
    Minutes,
    Position,
    Section,
    Share,
    Speed,
    Spin,
    Step,
    Stress,
    Tolerance,
)


class RigidWall(Section):
    """A rigid plane as target."""

    origin: tuple[Position, Position, Position]
    normal: tuple[Component, Component, Component]
    half_width: Length

    @model_validator(mode="after")
    def _has_a_side(self) -> Self:
        if not hypot(*self.normal) > 1e-9:
            raise ValueError(
                f"contacts: target.normal = {list(self.normal)}: expected a direction, the one "
                "from the wall to the contactor"
            )
        return self


def _target(value: Any) -> str | None:
    """Return which kind of target is meant, None if it is none."""
    if isinstance(value, str):
        return "surface"
    return "wall" if isinstance(value, dict | RigidWall) else None


Target = Annotated[
    Annotated[str, Tag("surface")] | Annotated[RigidWall, Tag("wall")],
    Discriminator(
        _target,
        custom_error_type="target",
        custom_error_message="the name of a surface, or a table with origin, normal, half_width",
    ),
]


class Contact(Section):
    """Contactor nodes against target facets; with ``keep`` a run stops where they part.

    ``method`` is ``penalty`` (springs of ``penalty`` times effective mass over dt²),
    ``modulus-penalty`` (``penalty`` times bulk modulus, area and area over volume of the cells
    behind), ``implicit-penalty`` (the springs of ``penalty`` at the end of the step, at any
    ``penalty``) or ``lagrange`` (no penetration). In ``two_pass`` each surface is contactor once. A
    ``smooth`` target is curved by averaged normals but for edges over ``sharp_angle``. What touches
    are the contactor's nodes or, with ``points = "quadrature"``, points in its facets.
    ``initial_overlap`` that no static solve has made is left out of the gap (``offset``), for good
    or fading over ``offset_time``, or pushes the bodies apart (``push``).
    """

    contactor: str
    target: Target
    friction: FrictionLaw = 0.0
    method: Literal["penalty", "modulus-penalty", "implicit-penalty", "lagrange"] = "penalty"
    penalty: Factor = 0.2
    damping: Share = 0.0
    two_pass: bool = False
    points: Literal["nodes", "quadrature"] = "nodes"
    smooth: bool = False
    sharp_angle: float = Field(0.7, strict=True, gt=0, lt=3.14, json_schema_extra={"unit": "rad"})
    initial_overlap: Literal["offset", "push"] = "offset"
    offset_time: Delay = 0.0
    stick_tolerance: Share = 0.05
    keep: bool = False

    @model_validator(mode="after")
    def _method_fits(self) -> Self:
        implicit = self.method in ("implicit-penalty", "lagrange")
        if implicit and self.damping:
            raise ValueError(
                f"contacts: damping = {self.damping}: expected 0 with method = {self.method!r}, "
                "whose impacts are plastic"
            )
        if self.points == "quadrature" and (
            self.two_pass or self.method in ("modulus-penalty", "lagrange")
        ):
            raise ValueError(
                "contacts: points = 'quadrature': expected method = 'penalty' or "
                f"'implicit-penalty' and no two_pass, got method = {self.method!r}, "
                f"two_pass = {str(self.two_pass).lower()}"
            )
        if self.two_pass and (implicit or isinstance(self.target, RigidWall)):
            raise ValueError(
                "contacts: two_pass = true: expected a penalty method, 'penalty' or "
                "'modulus-penalty', and two deformable surfaces"
            )
        return self


class Support(Section):
    """A surface held in some directions; ``axle`` is the axis of the yawed wheelset.

    With ``velocity`` it is moved along its one direction: its speed goes smoothly from 0 to that
    within ``ramp`` from ``begin`` on. At rest before time zero it is held.
    """

    surface: str
    directions: list[Direction] = Field(min_length=1)
    velocity: Speed = 0.0
    begin: Delay = 0.0
    ramp: Delay = 0.0

    @model_validator(mode="after")
    def _moves_one_way(self) -> Self:
        if bool(self.velocity) != bool(self.ramp) or (self.begin and not self.velocity):
            raise ValueError(
                "supports: expected velocity and ramp together (and begin with them only), got "
                f"velocity = {self.velocity} m/s, ramp = {self.ramp} s, begin = {self.begin} s"
            )
        if self.velocity and len(self.directions) != 1:
            raise ValueError(
                f"supports: velocity = {self.velocity}: expected one direction to move along, got "
                f"{self.directions}"
            )
        return self


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

    @model_validator(mode="after")
    def _at_rest(self) -> Self:
        if moving := [entry.surface for entry in self.hold if entry.velocity]:
            raise ValueError(f"equilibrium.hold: expected supports at rest, got {moving} moved")
        return self


class Time(Section):
    """Duration, outputs and step of a run.

    ``bound`` is what the step is measured against: the ``assembled`` system with its contact and
    other springs, or the stiffest ``cell``, 20 to 50 % shorter. ``precision`` is that of the
    internal forces in time, those of turning bodies in frames that turn with them; all else, and
    all statics, is computed in float64.
    """

    end: Duration
    output_interval: Duration
    safety: Step = 0.9
    bound: Literal["cell", "assembled"] = "assembled"
    precision: Literal["float64", "float32"] = "float64"


class Guards(Section):
    """When a run is stopped.

    ``energy_error`` is a share of the work that contact has done, without contact of the energy
    exchanged; ``penetration`` is a share of the contactor's cell at the node.
    """

    energy_error: Tolerance = 0.05
    penetration: Tolerance = 0.5
    check_interval: Count = 50


class Output(Section):
    """What a run leaves besides its history.

    A checkpoint to go on from is written every ``checkpoint_minutes`` of wall time, or every so
    many steps, and at the end; 0 minutes: none. Probes and contact forces are sampled, averaged
    over it, at every ``sample_interval``; none: they are not. With ``log = "json"`` what goes to
    ``run.log`` goes to ``run.jsonl`` as well, one JSON object a line.
    """

    fields: bool = True
    sample_interval: Duration | None = None
    checkpoint_minutes: Minutes = 10.0
    checkpoint_steps: Count | None = None
    log: Literal["text", "json"] = "text"


class MassScaling(Section):
    """Density added to the cells that would make the step shorter than ``step``, as inertia only.

    A run is refused that would need more than ``total``, or more than ``per_region`` in a region.
    """

    step: Duration
    total: Mass
    per_region: Mass | None = None


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
