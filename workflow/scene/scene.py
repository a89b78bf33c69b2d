# SPDX-License-Identifier: LGPL-3.0-or-later
"""Scene: the complete, checked description of a run; every number is in SI and has its unit."""

import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, ValidationError, model_validator

from workflow.scene import keys
from workflow.scene.bodies import FOLLOWING, MEMORY, Body, fit
from workflow.scene.contacts import law_of
from workflow.scene.mesh import (
    DRAWN,
    FILES,
    BarMesh,
    BlocksMesh,
    CapMesh,
    CurvedMesh,
    FileMesh,
    Foreign,
    GmshMesh,
    HollowSphereMesh,
    RailMesh,
    WheelRailMesh,
)
from workflow.scene.settings import (
    Contact,
    Driven,
    Equilibrium,
    Guards,
    Load,
    MassScaling,
    Output,
    Passes,
    Probe,
    Rolling,
    Section,
    Support,
    Time,
    unfit,
)
from workflow.scene.track import Absorbing, Spring, Track, Vehicle
from workflow.scene.units import Acceleration, Name, SceneError, explain

BUILTIN = Path(__file__).parent / "builtin"


class Scene(Section):
    """A complete run."""

    name: Name
    """Name of the scene; its results go to `runs/NAME`."""
    title: str
    """One line that says what the scene shows."""
    about: str = ""
    """Size and usual time, for `squealx scenes`."""
    mesh: Annotated[
        BarMesh
        | BlocksMesh
        | CapMesh
        | CurvedMesh
        | HollowSphereMesh
        | RailMesh
        | WheelRailMesh
        | FileMesh
        | GmshMesh,
        Field(discriminator="kind"),
    ]
    """Geometry and cells; `kind` says which."""
    bodies: dict[Name, Body] = Field(min_length=1)
    """Bodies by name: regions, material, element."""
    gravity: tuple[Acceleration, Acceleration, Acceleration] | None = None
    """Acceleration of all that has mass."""
    contacts: dict[Name, Contact] = Field(default_factory=dict)
    """Pairs of surfaces that may touch, by name."""
    supports: list[Support] = Field(default_factory=list)
    """Surfaces that are held or moved."""
    loads: list[Load] = Field(default_factory=list)
    """Surfaces under traction."""
    driven: dict[str, Driven] = Field(default_factory=dict)
    """Bodies in a prescribed rigid motion, by name of the body."""
    springs: list[Spring] = Field(default_factory=list)
    """Springs and dampers between a surface and a point."""
    absorbing: list[Absorbing] = Field(default_factory=list)
    """Surfaces that let waves out."""
    rolling: Rolling | None = None
    """A wheelset that rolls."""
    vehicle: Vehicle | None = None
    """Sprung mass and suspension on the axle box."""
    track: Track | None = None
    """Pads, sleepers and ballast under the rail."""
    equilibrium: Equilibrium | None = None
    """Rest before time zero; without it the run starts undeformed."""
    probes: list[Probe] = Field(default_factory=list)
    """Places whose motion is sampled."""
    passes: Passes | None = None
    """Runs one after the other over the same steel."""
    mass_scaling: MassScaling | None = None
    """Density added to few cells that would shorten the step."""
    time: Time
    """Duration, outputs and step."""
    guards: Guards = Guards()
    """When a run is stopped."""
    output: Output = Output()
    """What a run leaves besides its history."""

    @model_validator(mode="before")
    @classmethod
    def _kinematics_follow(cls, data: Any) -> Any:
        """Fill in kinematics that are left out: those for rotation in bodies that turn."""
        if not (isinstance(data, Mapping) and isinstance(data.get("bodies"), Mapping)):
            return data
        bodies = dict(data["bodies"])
        for name, body in bodies.items():
            if isinstance(body, Mapping) and "kinematics" not in body and turns(data, name):
                bodies[name] = {**body, "kinematics": "total-lagrangian"}
        return {**data, "bodies": bodies}

    @model_validator(mode="after")
    def _consistent(self) -> "Scene":
        if wrong := [
            *self._unknown_names(),
            *self._unfit_bodies(),
            *self._empty_loads(),
            *self._unfit_contacts(),
            *self._unfit_friction(),
            *self._unfit_step(),
        ]:
            raise ValueError("\n".join(wrong))
        if self.rolling:
            if self.rolling.body not in self.bodies:
                raise ValueError(
                    f"rolling.body = {self.rolling.body!r}: expected one of {list(self.bodies)}"
                )
            if isinstance(self.mesh, Foreign):
                both = ("wheel_centre", "rolling_radius")
                if missing := [f"mesh.{k}" for k in both if getattr(self.mesh, k) is None]:
                    raise ValueError(
                        f"{', '.join(missing)}: missing; [rolling] with mesh.kind = "
                        f"{self.mesh.kind!r} expects a point of the axle and the radius at the "
                        "first contact [m]"
                    )
            elif self.mesh.kind != "wheel-on-rail":
                raise ValueError(
                    f"mesh.kind = {self.mesh.kind!r}: rolling expects 'wheel-on-rail', 'file' or "
                    "'gmsh'"
                )
        dead = any(load.resting for load in self.loads) or any(self.gravity or ())
        if self.equilibrium and not (dead or self.driven):
            raise ValueError(
                "equilibrium: expected gravity, loads without ramp or a driven body to bring to "
                "rest, got none"
            )
        if self.equilibrium and self.equilibrium.shift and not self.rolling:
            raise ValueError("equilibrium.shift: expected a [rolling] wheelset to move, got none")
        if self.passes and (moved := [s.surface for s in self.supports if s.velocity]):
            raise ValueError(
                f"passes: expected supports at rest, got {moved} moved, which no pass moves back"
            )
        sampled = self.output.sample_interval
        if sampled is not None and sampled > self.time.end:
            raise ValueError(
                f"output.sample_interval = {sampled}: expected at most time.end = {self.time.end} s"
            )
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
            hint = isinstance(self.mesh, Foreign)
            only = "; expected all in bodies, or mesh.groups with those to use" if hint else ""
            yield f"bodies: no body has the regions {missing} of the mesh{only}"
        if self.rolling and self.rolling.driven_region.lower() not in regions:
            got = self.rolling.driven_region
            yield f"rolling.driven_region = {got!r}: expected one of {list(regions)}"
        for key, surface in self.surfaces():
            if surface.lower() not in self.mesh.surfaces:
                yield f"{key} = {surface!r}: expected one of {list(self.mesh.surfaces)}"
        for name in self.equilibrium.approach if self.equilibrium else ():
            if name not in self.bodies:
                yield f"equilibrium.approach.{name}: expected one of {list(self.bodies)}"
        for name in self.driven:
            if name not in self.bodies:
                yield f"driven.{name}: expected one of {list(self.bodies)}"
        yield from unfit(self.probes, list(regions), self.output.sample_interval)

    def _unfit_bodies(self) -> Iterator[str]:
        """Yield a line for every key of a body that does not go with its others."""
        for name, body in self.bodies.items():
            key, law = f"bodies.{name}", body.material.law
            if law in ("orthotropic", *MEMORY):
                try:
                    body.material.constants()
                except ValueError as error:
                    yield f"{key}.material: {error}"
            expected, splits = fit(law, body.kinematics)
            if body.kinematics != expected:
                yield f"{key}.kinematics = {body.kinematics!r}: {law} expects {expected!r}"
            if "selective" in body.elements and not (splits and body.kinematics == expected):
                of = "" if body.element == "selective" else "contact_zone."
                yield (
                    f"{key}.{of}element = 'selective': expected material.law = 'hooke' with "
                    "kinematics 'small-strain', 'neo-hookean' or 'j2', "
                    f"got {law!r} with {body.kinematics!r}"
                )
            if law in MEMORY:
                yield from self._unfit_memory(key, body)
            elif body.yielding is not None:
                yield f"{key}.yielding: expected material.law = 'j2', got {law!r}"
            if body.yielding is not None:
                yield from body.yielding.unfit(f"{key}.yielding")
            if body.contact_zone is not None:
                yield from self._unfit_zone(key, body)
            if body.hourglass_coefficient is not None and "one-point" not in body.elements:
                yield (
                    f"{key}.hourglass_coefficient: expected element = 'one-point', "
                    f"got {body.element!r}"
                )

    def _unfit_zone(self, key: str, body: Body) -> Iterator[str]:
        """Yield a line for what does not go with a contact zone."""
        assert body.contact_zone is not None
        yield from body.contact_zone.unfit(f"{key}.contact_zone")
        if body.element == body.near_element:
            yield (
                f"{key}.contact_zone.element = {body.near_element!r}: expected another one than "
                f"{key}.element"
            )
        if body.material.law in MEMORY and body.yielding is None:
            yield (
                f"{key}.contact_zone: all of the body may yield, and has one element; expected "
                f"{key}.yielding too, or no zone"
            )

    def _unfit_memory(self, key: str, body: Body) -> Iterator[str]:
        """Yield a line for every key that does not go with a law that has a memory."""
        law = body.material.law
        if body.stiffness_damping:
            yield (
                f"{key}.stiffness_damping = {body.stiffness_damping:g}: expected 0 with law "
                f"{law!r}; its flow dissipates, bulk_viscosity spreads shocks"
            )
        if self.time.precision != "float64":
            yield (
                f"time.precision = {self.time.precision!r}: expected 'float64' with law {law!r} "
                f"of {key}"
            )

    def _empty_loads(self) -> Iterator[str]:
        """Yield a line for every load that is none."""
        for i, load in enumerate(self.loads):
            if not {"traction", "pressure", "hammer"} & load.model_fields_set:
                yield f"loads.{i}: expected traction or pressure [Pa], or hammer, got neither"

    def _unfit_step(self) -> Iterator[str]:
        """Yield a line if the step is to follow the shape of bodies that there are not."""
        large = [b for b in self.bodies.values() if b.kinematics == "total-lagrangian"]
        if self.time.follow_shape and not any(b.material.law in MEMORY for b in large):
            yield (
                "time.follow_shape = true: expected a body with kinematics 'total-lagrangian' "
                f"whose law has a memory, {' or '.join(map(repr, MEMORY))}, got none; elastic laws "
                "stiffen and soften with their strain, which their shape does not tell"
            )

    def _unfit_contacts(self) -> Iterator[str]:
        """Yield a line for every contact of a surface with itself."""
        for name, contact in self.contacts.items():
            target = contact.target
            if isinstance(target, str) and target.lower() == contact.contactor.lower():
                yield (
                    f"contacts.{name}.target = {target!r}: expected another surface than the "
                    "contactor"
                )

    def _unfit_friction(self) -> Iterator[str]:
        """Yield a line for every friction law that cannot be used."""
        for name, contact in self.contacts.items():
            if isinstance(contact.friction, Section):
                try:
                    law_of(contact.friction)
                except ValueError as error:
                    yield f"contacts.{name}.friction: {error}"

    def surfaces(self) -> Iterator[tuple[str, str]]:
        """Yield the key and value of every surface that this scene names."""
        for name, contact in self.contacts.items():
            yield f"contacts.{name}.contactor", contact.contactor
            if isinstance(contact.target, str):
                yield f"contacts.{name}.target", contact.target
        hold = self.equilibrium.hold if self.equilibrium else []
        lists: dict[str, list[Any]]
        lists = {"supports": self.supports, "loads": self.loads, "equilibrium.hold": hold}
        lists |= {"springs": self.springs, "absorbing": self.absorbing}
        for key, entries in lists.items():
            for i, entry in enumerate(entries):
                yield f"{key}.{i}.surface", entry.surface
        for body, motion in self.driven.items():
            yield f"driven.{body}.surface", motion.surface
        for i, probe in enumerate(self.probes):
            if probe.surface is not None:
                yield f"probes.{i}.surface", probe.surface
        if self.vehicle:
            yield "vehicle.journal", self.vehicle.journal
        if self.track:
            yield "track.seat", self.track.seat
            for key in ("sleeper_top", "sleeper_bottom"):
                if (name := getattr(self.track, key)) is not None:
                    yield f"track.{key}", name
            if self.track.ends != "free":
                yield "track.end_surface", self.track.end_surface

    @staticmethod
    def load(source: str | Path, **changes: Any) -> "Scene":
        """Return the built-in scene or TOML file ``source`` with keys changed.

        Args:
            source: Name of a built-in scene, or path of a TOML file.
            changes: Values by dotted key, as in ``with_``.

        Raises:
            SceneError: naming the key, what it got and what it expects.
        """
        return Scene.check(keys.changed(read(source), changes))

    @staticmethod
    def check(data: Mapping[str, Any]) -> "Scene":
        """Return the scene described by nested tables, or raise ``SceneError``."""
        try:
            return Scene.model_validate(data)
        except ValidationError as error:
            raise SceneError("\n".join(explain(e, data, Scene) for e in error.errors())) from None

    def with_(self, **changes: Any) -> "Scene":
        """Return the scene with keys changed, e.g. ``with_(**{"mesh.size": 1e-3})``."""
        return Scene.check(keys.changed(self.tables(), changes))

    def tables(self) -> dict[str, Any]:
        """Return the fully resolved scene as nested tables without empty entries."""
        return self.model_dump(mode="json", exclude_none=True)


def turns(tables: Mapping[str, Any], body: str) -> bool:
    """Tell whether unchecked tables of a scene make a body turn whose law lets it."""
    material = tables["bodies"][body].get("material")
    if isinstance(material, Mapping) and material.get("law", "hooke") not in FOLLOWING:
        return False  # its law has kinematics of its own
    rolling, driven = tables.get("rolling"), tables.get("driven")
    if isinstance(rolling, Mapping) and rolling.get("body") == body and rolling.get("speed"):
        return True
    entry = driven.get(body) if isinstance(driven, Mapping) else None
    spin = entry.get("spin") if isinstance(entry, Mapping) else None
    return isinstance(spin, list | tuple) and any(spin)


def names() -> list[str]:
    """Return the names of the built-in scenes."""
    return sorted(p.name[:-5] for p in BUILTIN.iterdir() if p.name.endswith(".toml"))


def read(source: str | Path, above: tuple[str, ...] = ()) -> dict[str, Any]:
    """Return the tables of a built-in scene or a TOML file, unchecked.

    A file with ``base`` starts from that scene, built-in or a file beside it, and has its own keys
    put over it. Paths of meshes, models of gmsh, profiles and runs are relative to the TOML file
    that names them.

    Args:
        source: Name of a built-in scene, or path of a TOML file.
        above: Scenes that start from this one.
    """
    path = Path(source)
    try:
        tables = tomllib.loads(_text(path, str(source)))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise SceneError(f"{source}: not valid TOML: {error}") from None
    mesh, folder = tables.get("mesh"), BUILTIN if _is_name(path, str(source)) else path.parent
    if isinstance(mesh, dict):
        for key in mesh.keys() & {name.removeprefix("mesh.") for name in FILES}:
            mesh[key] = beside(folder, mesh[key])
    if isinstance(passes := tables.get("passes"), dict) and "after" in passes:
        passes["after"] = beside(folder, passes["after"])
    base, above = tables.pop("base", None), (*above, str(source))
    if base is None:
        return tables
    if not isinstance(base, str):
        raise SceneError(f"{source}: base = {base!r}: expected the name of a scene or a TOML file")
    if base not in names():
        base = str(path.parent / base)
    if base in above:
        raise SceneError(f"{source}: base = {base!r}: expected a scene that does not start from it")
    try:
        return keys.joined(read(base, above), tables)
    except SceneError as error:
        raise SceneError(f"{source}: base: {error}") from None


def beside(folder: Path, file: Any) -> Any:
    """Return a file, or several, named relative to a folder; names of drawn profiles stay."""
    if isinstance(file, list):
        return [beside(folder, entry) for entry in file]
    return str(folder / file) if isinstance(file, str) and file not in DRAWN else file


def _is_name(path: Path, source: str) -> bool:
    """Tell whether this is the name of a built-in scene."""
    return path.suffix != ".toml" and source in names()


def _text(path: Path, source: str) -> str:
    if _is_name(path, source):
        return (BUILTIN / f"{source}.toml").read_text("utf-8")
    try:
        return path.read_text("utf-8")
    except (FileNotFoundError, IsADirectoryError):
        reason = ""
    except OSError as error:
        reason = f"{error.strerror}; "
    raise SceneError(
        f"scene {source!r}: {reason}expected a TOML file or one of {', '.join(names())}"
    )
