# SPDX-License-Identifier: LGPL-3.0-or-later
"""Scenes: what a run is made of, as checked models. Every number is in SI and carries its unit."""

import tomllib
from collections.abc import Iterator, Mapping
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from workflow.quantities import (
    Acceleration,
    Angle,
    Component,
    Count,
    Damping,
    Delay,
    Density,
    Direction,
    Duration,
    Factor,
    Friction,
    Growth,
    Length,
    Mass,
    Modulus,
    Position,
    Rate,
    Ratio,
    Share,
    Slope,
    Speed,
    Step,
    Stiffness,
    Stress,
    explain,
)


class SceneError(ValueError):
    """A scene that cannot be run: the message names the key, what it got and what it expects."""


class Section(BaseModel):
    """A table of a scene; unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)


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


class WheelRailMesh(Section):
    """A wheelset half on a rail in the track position, fine where it will roll."""

    regions: ClassVar = ("tyre", "web", "hub", "axle", "rail_head", "rail_web", "rail_foot")
    surfaces: ClassVar = (
        *("tread", "axle_inner", "axle_outer", "journal"),
        *("railhead", "foot_underside", "rail_ends"),
    )

    kind: Literal["wheel-on-rail"]
    size: Length
    wheel_profile: str = "S1002"
    rail_profile: str = "54E1"
    wheel_design: str = "D_curved_web"
    wheel_radius: Length = 0.46
    inclination: Slope = 1 / 40
    gauge: Length = 1.435
    rail_length: Length = 10.0
    start: Position = 0.3
    flange_gap: Length = 3e-4
    margin: Length = 0.03


class Material(Section):
    """Isotropic elastic material."""

    youngs_modulus: Modulus
    poisson_ratio: Ratio
    density: Density


class Body(Section):
    """Regions of the mesh that share a material and kinematics."""

    regions: list[str] = Field(min_length=1)
    material: Material
    kinematics: Literal["small-strain", "total-lagrangian"] = "small-strain"
    stiffness_damping: Delay = 0.0
    mass_damping: Rate = 0.0
    velocity: tuple[Speed, Speed, Speed] | None = None


class RigidWall(Section):
    """A rigid plane as target."""

    origin: tuple[Position, Position, Position]
    normal: tuple[Component, Component, Component]
    half_width: Length


class Contact(Section):
    """Contactor nodes against target facets."""

    contactor: str
    target: str | RigidWall
    friction: Friction = 0.0
    penalty: Factor = 0.2
    damping: Share = 0.0
    stick_tolerance: Share = 0.05


class Support(Section):
    """A surface held in some directions; ``axle`` is the axis of the yawed wheelset."""

    surface: str
    directions: list[Direction] = Field(min_length=1)


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


class Vehicle(Section):
    """Sprung mass on the vertical primary suspension of one axle box."""

    journal: str
    sprung_mass: Mass
    suspension_stiffness: Stiffness
    suspension_damping: Damping


class Track(Section):
    """Pads, sleepers and ballast under the rail; pads as (longitudinal, lateral, vertical)."""

    seat: str
    sleeper_spacing: Length
    seat_length: Length
    sleeper_mass: Mass
    pad_stiffness: tuple[Stiffness, Stiffness, Stiffness]
    pad_damping: tuple[Damping, Damping, Damping]
    ballast_stiffness: Stiffness
    ballast_damping: Damping


class Equilibrium(Section):
    """Static solve before time zero; ``approach`` moves a body into touch as first guess.

    ``shift`` then moves the wheelset along its axle, to where the run is to start.
    """

    tolerance: Factor = 1e-6
    max_iterations: Count = 40
    approach: dict[str, tuple[Position, Position, Position]] = {}
    hold: list[Support] = []
    shift: Position = 0.0
    shift_increments: Count = 5


class Time(Section):
    """Duration, outputs and step of a run."""

    end: Duration
    output_interval: Duration
    safety: Step = 0.9


class Guards(Section):
    """When a run is stopped."""

    energy_error: Factor = 0.05
    check_interval: Count = 50


class Output(Section):
    """What a run leaves besides its history."""

    fields: bool = True


class Scene(Section):
    """A complete run."""

    name: str
    title: str
    about: str = ""
    mesh: Annotated[BarMesh | BlocksMesh | CapMesh | WheelRailMesh, Field(discriminator="kind")]
    bodies: dict[str, Body] = Field(min_length=1)
    gravity: tuple[Acceleration, Acceleration, Acceleration] | None = None
    contacts: dict[str, Contact] = {}
    supports: list[Support] = []
    loads: list[Load] = []
    rolling: Rolling | None = None
    vehicle: Vehicle | None = None
    track: Track | None = None
    equilibrium: Equilibrium | None = None
    time: Time
    guards: Guards = Guards()
    output: Output = Output()

    @model_validator(mode="after")
    def _consistent(self) -> "Scene":
        if wrong := list(self._unknown_names()):
            raise ValueError("\n".join(wrong))
        if self.rolling:
            if self.rolling.body not in self.bodies:
                raise ValueError(
                    f"rolling.body = {self.rolling.body!r}: expected one of {list(self.bodies)}"
                )
            if self.mesh.kind != "wheel-on-rail":
                raise ValueError(f"mesh.kind = {self.mesh.kind!r}: rolling expects 'wheel-on-rail'")
        if self.equilibrium and self.equilibrium.shift and not self.rolling:
            raise ValueError("equilibrium.shift: expected a [rolling] wheelset to move, got none")
        if self.time.output_interval > self.time.end:
            raise ValueError(
                f"time.output_interval = {self.time.output_interval}: "
                f"expected at most time.end = {self.time.end} s"
            )
        return self

    def _unknown_names(self) -> Iterator[str]:
        """Yield a line for every body, region and surface that this scene does not have."""
        regions, owner = self.mesh.regions, dict[str, str]()
        for name, body in self.bodies.items():
            for region in (r.lower() for r in body.regions):
                if region not in regions:
                    yield f"bodies.{name}.regions = {region!r}: expected one of {list(regions)}"
                elif region in owner:
                    yield f"bodies.{name}.regions = {region!r}: in body {owner[region]!r} already"
                owner[region] = name
        if missing := [r for r in regions if r not in owner]:
            yield f"bodies: no body has the regions {missing} of the mesh"
        if self.rolling and self.rolling.driven_region.lower() not in regions:
            got = self.rolling.driven_region
            yield f"rolling.driven_region = {got!r}: expected one of {list(regions)}"
        for key, surface in self._surfaces():
            if surface.lower() not in self.mesh.surfaces:
                yield f"{key} = {surface!r}: expected one of {list(self.mesh.surfaces)}"
        for name in self.equilibrium.approach if self.equilibrium else ():
            if name not in self.bodies:
                yield f"equilibrium.approach.{name}: expected one of {list(self.bodies)}"

    def _surfaces(self) -> Iterator[tuple[str, str]]:
        """Yield the key and value of every surface that this scene names."""
        for name, contact in self.contacts.items():
            yield f"contacts.{name}.contactor", contact.contactor
            if isinstance(contact.target, str):
                yield f"contacts.{name}.target", contact.target
        hold = self.equilibrium.hold if self.equilibrium else []
        lists: dict[str, list[Any]]
        lists = {"supports": self.supports, "loads": self.loads, "equilibrium.hold": hold}
        for key, entries in lists.items():
            for i, entry in enumerate(entries):
                yield f"{key}.{i}.surface", entry.surface
        if self.vehicle:
            yield "vehicle.journal", self.vehicle.journal
        if self.track:
            yield "track.seat", self.track.seat

    @staticmethod
    def load(source: str | Path, **changes: Any) -> "Scene":
        """Return the built-in scene or TOML file ``source`` with keys changed.

        Args:
            source: Name of a built-in scene, or path of a TOML file.
            changes: Values by dotted key, as in ``with_``.

        Raises:
            SceneError: naming the key, what it got and what it expects.
        """
        return Scene.check(_merged(read(source), changes))

    @staticmethod
    def check(data: Mapping[str, Any]) -> "Scene":
        """Return the scene described by nested tables, or raise ``SceneError``."""
        try:
            return Scene.model_validate(data)
        except ValidationError as error:
            raise SceneError("\n".join(explain(e, data, Scene) for e in error.errors())) from None

    def with_(self, **changes: Any) -> "Scene":
        """Return the scene with keys changed, e.g. ``with_(**{"mesh.size": 1e-3})``."""
        return Scene.check(_merged(self.tables(), changes))

    def tables(self) -> dict[str, Any]:
        """Return the fully resolved scene as nested tables without empty entries."""
        return self.model_dump(mode="json", exclude_none=True)


def names() -> list[str]:
    """Return the names of the built-in scenes."""
    folder = resources.files("workflow") / "scenes"
    return sorted(p.name[:-5] for p in folder.iterdir() if p.name.endswith(".toml"))


def read(source: str | Path) -> dict[str, Any]:
    """Return the tables of a built-in scene or a TOML file, unchecked."""
    path = Path(source)
    try:
        return tomllib.loads(_text(path, str(source)))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise SceneError(f"{source}: not valid TOML: {error}") from None


def _text(path: Path, source: str) -> str:
    if path.suffix != ".toml" and source in names():
        return (resources.files("workflow") / "scenes" / f"{source}.toml").read_text("utf-8")
    if path.is_file():
        return path.read_text("utf-8")
    raise SceneError(f"scene {source!r}: expected a TOML file or one of {', '.join(names())}")


def _merged(data: dict[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    merged = dict(data)
    for key, value in changes.items():
        *tables, last = key.split(".")
        inner = merged
        for depth, table in enumerate(tables, 1):
            below = inner.get(table, {})
            if not isinstance(below, dict):
                path = ".".join(tables[:depth])
                raise SceneError(f"{key}: expected a key of the scene, but {path} is not a table")
            inner[table] = dict(below)
            inner = inner[table]
        inner[last] = value
    return merged
