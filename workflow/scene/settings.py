# SPDX-License-Identifier: LGPL-3.0-or-later
"""Tables of contacts, supports, loads, motion, time, guards and output."""

from collections.abc import Iterator
from math import hypot
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Discriminator, Field, Tag, field_validator, model_validator

from workflow.scene.contacts import FrictionLaw
from workflow.scene.units import (
    Angle,
    Component,
    Count,
    Delay,
    Direction,
    Duration,
    Factor,
    Force,
    Length,
    Mass,
    Minutes,
    Position,
    Section,
    Share,
    Shrinkage,
    Speed,
    Spin,
    Step,
    Stress,
    Tolerance,
)


class RigidWall(Section):
    """A rigid plane as target."""

    origin: tuple[Position, Position, Position]
    """A point of the plane."""
    normal: tuple[Component, Component, Component]
    """Direction from the wall to the contactor."""
    half_width: Length
    """The wall reaches this far from its origin."""

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
    """Contactor nodes against target facets."""

    contactor: str
    """Surface whose nodes are kept out of the target."""
    target: Target
    """Surface, or a rigid wall as table."""
    friction: FrictionLaw = 0.0
    """Coefficient of friction, or a law as table."""
    method: Literal["penalty", "modulus-penalty", "implicit-penalty", "lagrange"] = "penalty"
    """Normal law: `penalty` has springs of `penalty` times effective mass over dt²,
    `modulus-penalty` of `penalty` times bulk modulus of the cells behind; `implicit-penalty` the
    first at the end of the step, stable at any stiffness; `lagrange` allows no penetration.
    """
    penalty: Factor = 0.2
    """Stiffness of the springs, dimensionless; explicit ones take up to 1."""
    damping: Share = 0.0
    """Share of critical damping of explicit springs."""
    two_pass: bool = False
    """Whether each of the surfaces is contactor once."""
    points: Literal["nodes", "quadrature"] = "nodes"
    """What touches: the contactor's nodes, or 2 × 2 points in each of its facets."""
    smooth: bool = False
    """Whether the target is curved by averaged normals."""
    sharp_angle: float = Field(0.7, strict=True, gt=0, lt=3.14, json_schema_extra={"unit": "rad"})
    """Edges of a smooth target that turn by more than this stay sharp."""
    initial_overlap: Literal["offset", "push"] = "offset"
    """Overlap at the start that no static solve made: left out of the gap, or it pushes."""
    offset_time: Delay = 0.0
    """Time in which an overlap that was left out fades; 0: it stays."""
    stick_tolerance: Share = 0.05
    """A node adheres where the limit exceeds its force by this share of the largest such force."""
    keep: bool = False
    """Whether a run stops where the surfaces part."""

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
    """A surface held in some directions, or moved along one; before time zero it is held."""

    surface: str
    """Surface that is held."""
    directions: list[Direction] = Field(min_length=1)
    """Directions it is held in; `axle` is the axis of the yawed wheelset."""
    velocity: Speed = 0.0
    """Speed it is moved at along its one direction; 0: it is held."""
    begin: Delay = 0.0
    """Time at which it begins to move."""
    ramp: Delay = 0.0
    """Time in which it comes to its speed, smoothly."""

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
    """A body carried by one of its surfaces in a steady rigid motion, from time zero on."""

    surface: str
    """Surface that carries the body."""
    velocity: tuple[Speed, Speed, Speed] = (0.0, 0.0, 0.0)
    """Velocity of the motion."""
    spin: tuple[Spin, Spin, Spin] = (0.0, 0.0, 0.0)
    """Angular velocity about the axes through `centre`."""
    centre: tuple[Position, Position, Position] = (0.0, 0.0, 0.0)
    """A point of the axis, in the mesh; it moves with `velocity`."""
    steady_start: bool = False
    """Whether the deformation at rest stays in place and the material flows through it, as in
    rolling.
    """
    shift: tuple[Position, Position, Position] = (0.0, 0.0, 0.0)
    """Displacement on top of the motion, from rest to rest."""
    shift_time: Delay = 0.0
    """Time in which the shift is made."""

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


class Travelling(Section):
    """A semi-ellipse along x, as Hertz's pressure, that comes, passes and goes."""

    half_width: Length = Field(examples=[0.004])
    """Half width of the semi-ellipse, whose largest value is `traction`."""
    start: Position = Field(examples=[-0.02])
    """Place of its middle along x at time zero."""
    velocity: Speed = Field(examples=[150.0])
    """Speed along x."""
    ramp: Duration = Field(examples=[2e-5])
    """Time in which it comes up, smoothly, and in which it goes."""
    until: Duration = Field(examples=[2.7e-4])
    """Time at which it has gone."""

    @model_validator(mode="after")
    def _comes_up(self) -> Self:
        if self.until < 2 * self.ramp:
            raise ValueError(
                f"loads: travelling.until = {self.until}: expected at least 2 ramps, "
                f"{2 * self.ramp} s"
            )
        return self


class Hammer(Section):
    """A blow at time zero, ``F sin²(π t / T)``, spread evenly over the facets round a point."""

    point: tuple[Position, Position, Position] = Field(examples=[[0.0, 0.7525, 0.0]])
    """Place of the surface that is hit."""
    radius: Length = Field(examples=[0.015])
    """Facets whose middles are no further from the point than this bear the force."""
    force: tuple[Force, Force, Force] = Field(examples=[[0.0, 0.0, -10e3]])
    """Largest force."""
    duration: Duration = Field(examples=[4e-4])
    """How long the blow lasts; it excites little above one over this, and nothing at twice of it.
    """


class Load(Section):
    """A dead traction, a pressure along the normal, a traction that travels, or a blow.

    They act on a surface.

    The surface is that of the undeformed body.
    """

    surface: str
    """Surface that is loaded."""
    traction: tuple[Stress, Stress, Stress] = (0.0, 0.0, 0.0)
    """Force over area of the undeformed surface; this, `pressure` or both."""
    pressure: Stress = 0.0
    """Pressure against the undeformed surface; positive pushes into the body."""
    ramp: Delay = 0.0
    """Time from zero on in which the load comes up, smoothly; 0: it acts always, at rest too."""
    travelling: Travelling | None = None
    """How its traction travels; left out, it rests on the whole surface."""
    hammer: Hammer | None = None
    """A blow at a point of the surface, in place of tractions."""

    @property
    def resting(self) -> bool:
        """Whether it acts always, at rest too."""
        return not self.ramp and self.travelling is None and self.hammer is None

    @model_validator(mode="after")
    def _strikes_alone(self) -> Self:
        others = self.travelling or self.ramp or self.pressure or any(self.traction)
        if self.hammer is not None and (others or not any(self.hammer.force)):
            raise ValueError(
                "loads: hammer: expected a force, without traction, pressure, ramp or travelling, "
                + ("got both" if others else "got none")
            )
        return self

    @model_validator(mode="after")
    def _travels_alone(self) -> Self:
        if self.travelling is not None and (self.ramp or self.pressure):
            raise ValueError(
                "loads: travelling: expected a traction, without ramp or pressure, got both"
            )
        return self


class Rolling(Section):
    """Start of rolling: travel, spin and drive of the wheelset."""

    body: str
    """Body that rolls."""
    driven_region: str
    """Region that the torque acts on."""
    speed: Speed
    """Speed of travel."""
    angle_of_attack: Angle = 0.0
    """Yaw of the wheelset against the rail."""
    travel_angle: Angle | None = Field(default=None, examples=[0.0])
    """Direction of travel against the rail; the wheel's own plane if left out."""
    traction_coefficient: Share = 0.0
    """Longitudinal force over normal force that the torque is set to."""
    torque_ramp: Delay = 0.0
    """Time in which the torque comes up."""
    steady_start: bool = True
    """Whether the wheel starts as if it had always rolled; else its deformation turns with it."""

    @property
    def travel(self) -> float:
        """Direction of travel against the rail [rad]; the wheel's own plane unless given."""
        return self.angle_of_attack if self.travel_angle is None else self.travel_angle


class Relaxation(Section):
    """Dynamic relaxation: velocities shrink at every step until nothing moves any more."""

    velocity_factor: Shrinkage | None = Field(default=None, examples=[0.995])
    """What velocities are multiplied by at every step; found from the motion if left out."""
    tolerance: Factor = 1e-8
    """Largest kinetic over internal energy at rest."""
    check_interval: Count = 250
    """Steps between two looks at the energies."""
    max_steps: Count = 100_000
    """Steps after which it gives up."""
    mass_scaling: bool = True
    """Whether each cell gets the mass that makes it as fast as the step allows."""


class Equilibrium(Section):
    """Rest before time zero."""

    method: Literal["static", "relaxation"] = "static"
    """A static solve, or dynamic relaxation."""
    relaxation: Relaxation = Relaxation()
    """Settings of dynamic relaxation."""
    tolerance: Factor = 1e-6
    """Largest residual of the static solve over the load."""
    max_iterations: Count = 40
    """Iterations of the static solve after which it gives up."""
    approach: dict[str, tuple[Position, Position, Position]] = Field(default_factory=dict)
    """Displacement of bodies into touch, as first guess."""
    hold: list[Support] = Field(default_factory=list)
    """Supports that hold only until time zero."""
    increments: Count = 1
    """Equal steps in which the static solve brings dead loads up. Steel that yields goes another
    way in one than in many; where a step does not converge, it is halved.
    """
    shift: Position = 0.0
    """Displacement of the wheelset along its axle, once at rest, to where the run starts."""
    shift_increments: Count = 5
    """Number of solves in which the shift is made."""

    @model_validator(mode="after")
    def _at_rest(self) -> Self:
        if moving := [entry.surface for entry in self.hold if entry.velocity]:
            raise ValueError(f"equilibrium.hold: expected supports at rest, got {moving} moved")
        return self


class Time(Section):
    """Duration, outputs and step of a run."""

    end: Duration
    """Duration of the run."""
    output_interval: Duration
    """Time between two outputs."""
    safety: Step = 0.9
    """Share of the stable step that is used."""
    bound: Literal["cell", "assembled"] = "assembled"
    """What the step is measured against: the assembled system with its springs, or the stiffest
    cell, 20 to 50 % shorter.
    """
    follow_shape: bool | None = Field(default=None, examples=[True])
    """Whether the step falls where cells of bodies with a memory, in large strain, are flattened;
    left out, it does where there are such bodies.
    """
    precision: Literal["float64", "float32"] = "float64"
    """Precision of the internal forces in time; all else is computed in float64."""


class Guards(Section):
    """When a run is stopped."""

    energy_error: Tolerance = 0.05
    """Largest error of the energy balance, as a share of the work that contact has done; without
    contact, of the energy exchanged.
    """
    penetration: Tolerance = 0.5
    """Deepest penetration, as a share of the contactor's cell."""
    check_interval: Count = 50
    """Steps between two looks."""


class Output(Section):
    """What a run leaves besides its history."""

    fields: bool = True
    """Whether displacement and velocity of all nodes are written at every output."""
    stress: bool = False
    """Whether fields have stress and back stress of cells that may yield, six numbers each."""
    sample_interval: Duration | None = None
    """Interval over which probes and contact forces are averaged; not sampled if left out."""
    checkpoint_minutes: Minutes = 10.0
    """Wall time between two checkpoints to go on from; 0: none."""
    checkpoint_steps: Count | None = Field(default=None, examples=[5000])
    """Steps between two checkpoints, besides."""
    log: Literal["text", "json"] = "text"
    """`json` writes `run.jsonl` besides `run.log`, one JSON object a line."""


class Passes(Section):
    """Runs one after the other over the same steel, which keeps what each has done to it."""

    number: Count = 1
    """Number of runs; each but the first begins where the one before has left the steel."""
    after: str | None = Field(default=None, examples=["runs/first"])
    """Folder of a run with `[passes]` whose steel the first one begins with."""
    section: tuple[Position, Position] | None = Field(default=None, examples=[[0.0, 0.0]])
    """x and y of the cells whose depth profile is kept; left out, where the first run strains most.
    """

    @field_validator("after")
    @classmethod
    def _absolute(cls, after: str | None) -> str | None:
        return after and str(Path(after).absolute())  # a result's scene.toml runs from anywhere


class MassScaling(Section):
    """Density added to the cells that would make the step shorter, as inertia only."""

    step: Duration
    """Step that no cell is to shorten."""
    total: Mass
    """Mass added at most; a run that would need more is refused."""
    per_region: Mass | None = Field(default=None, examples=[1.0])
    """The same in any one region."""


class Probe(Section):
    """A place in the material whose motion is sampled."""

    name: str = Field(pattern=r"^[\w-]+$")
    """Name in the results."""
    point: tuple[Position, Position, Position] | None = None
    """A place; the nearest node is taken, of the surface or region if there is one."""
    surface: str | None = Field(default=None, examples=["axle_outer"])
    """Surface whose mean motion is taken, by area, if there is no point."""
    region: str | None = None
    """Region whose centre of mass is taken if there is no point."""
    quantity: Literal["velocity", "displacement", "acceleration"] = "velocity"
    """What is sampled."""

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
