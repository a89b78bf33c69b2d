# SPDX-License-Identifier: LGPL-3.0-or-later
"""A wheel at rest on the rail against two expectations: Hertz's ellipse and half-spaces.

Both are made from the drawn profiles where wheel and rail stand in the state, and loaded by the
normal force found. How they stand is read from their running surfaces around the patch, to each of
which a rigid motion is fitted: under the load the axle bends and the rail twists, which moves the
contact by millimetres.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from contact.creepage import rigid_motion
from contact.theory.closed_forms import contact_modulus
from contact.theory.wheel_on_rail import WheelOnRail, profile_contact, with_layer
from meshes.arrays import Array
from meshes.profiles.placement import Placement, rail_in_track
from meshes.profiles.surfaces import Surface, rail_surface, wheel_surface
from meshes.tags import Tag
from workflow.model.geometry import placement_of, profiles_of
from workflow.results.patch_nodes import PatchNodes, patches_of
from workflow.results.record import Record
from workflow.scene.mesh import WheelRailMesh
from workflow.scene.scene import Scene
from workflow.theory import readings
from workflow.theory.assumptions import material
from workflow.theory.quantity import HALF_SPACE, STATICS, Expected

if TYPE_CHECKING:
    from workflow.model.model import Model

AROUND = (3.0, 8.0)  # nodes that show how a body stands: distance in radii of the patch
WHEELSET = ("tread", "axle_inner", "axle_outer", "journal", "wheelset_skin")
ON = 2e-4  # a node nearer to the drawn surface than this is on it [m]


@dataclass(frozen=True)
class AtRest:
    """Contact at rest and what is expected of it.

    Attributes:
        patch: The nodes in contact.
        expected: Both expectations under the same force.
        softened: The same with a layer between the half-spaces that gives way as the penalty does.
        overlap: Of the nodes, the largest [m].
    """

    patch: PatchNodes
    expected: WheelOnRail
    softened: WheelOnRail
    overlap: float

    @property
    def at(self) -> Array:
        """Longitudinal and lateral coordinates of the nodes, shape ``(n, 2)`` [m]."""
        return self.expected.local(self.patch.position)

    @property
    def pressure(self) -> Array:
        """Nodal pressures, shape ``(n,)`` [Pa]."""
        return np.asarray(self.patch.pressure)

    @property
    def error(self) -> float:
        """Error of the nodal pressures, rms over the largest pressure of the half-spaces.

        A node stands for its area, over which the expectation is averaged.
        """
        return self._off(self.expected)

    @property
    def softened_error(self) -> float:
        """The same with the layer: what is not due to the penalty."""
        return self._off(self.softened)

    def _off(self, e: WheelOnRail) -> float:
        off = self.pressure - e.pressure(self.at, self.patch.areas)
        return float(np.sqrt(np.mean(off**2)) / e.half_space.pressure.max())

    @property
    def found(self) -> dict[str, tuple[float, float, float, float]]:
        """Largest pressure [Pa], half axes [m] and area [m2] of the nodes and as expected.

        The half axes are those of the ellipse of the same second moments: ``a**2 / 5`` for Hertz.
        """
        e, nodes = self.expected, self.patch
        axes = half_axes(self.at, nodes.normal_forces)
        rows = {"nodes": (float(self.pressure.max()), *axes, nodes.area)}
        for name, there in (("half-space", e), ("half-space with layer", self.softened)):
            p = there.half_space.pressure
            rows[name] = (float(p.max()), *half_axes(there.grid, p.ravel()), there.half_space.area)
        if e.hertz:
            rows["Hertz"] = (e.hertz.p0, e.hertz.a, e.hertz.b, np.pi * e.hertz.a * e.hertz.b)
        return rows

    def lines(self) -> list[str]:
        """Return the comparison in words and numbers, a line each."""
        e, patch = self.expected, self.patch
        angle, nodes = np.degrees(patch.contact_angle), len(patch.areas)
        said = [
            f"at rest: {patch.normal_force / 1e3:.1f} kN at {angle:.1f}° on "
            f"{nodes} nodes; undeformed profiles touch at {e.angle:.1f}°, relative "
            f"radii {e.radii[0]:.3f} m along, {e.radii[1]:.3f} m across"
        ]
        said += [
            f"at rest, {name}: p0 {p0 / 1e6:.0f} MPa, half axes {a * 1e3:.2f} and {b * 1e3:.2f} mm,"
            f" area {area * 1e6:.0f} mm²"
            for name, (p0, a, b, area) in self.found.items()
        ]
        said += [
            f"at rest: penalty springs give way by {self.overlap * 1e6:.1f} µm, a layer in an "
            f"approach of {e.half_space.approach * 1e6:.0f} µm",
            f"at rest: nodal pressure {self.error:.1%} rms off the half-space, "
            f"{self.softened_error:.1%} off that with such a layer",
        ]
        return said


def half_axes(at: Array, force: Array) -> tuple[float, float]:
    """Return the half axes, along the axes of the frame, of the ellipse of the same moments [m]."""
    centre = force @ at / force.sum()
    return readings.half_axes(at - centre, force)


def at_rest(record: Record) -> AtRest | None:
    """Return the contact at the first output of a run, None if no wheel rests on a rail there."""
    if not record.wheel_on_rail or record.body is None or not record.contacts:
        return None
    scene, (name, contact) = record.checked, next(iter(record.contacts.items()))
    if scene.equilibrium is None or not contact.patches[0]:
        return None
    u, points = record.displacement(float(contact.t[0])), record.body.points
    cells, regions = record.body.cells, record.body.regions
    tyre, head = (np.unique(cells[regions == r]) for r in (Tag.TYRE, Tag.RAIL_HEAD))
    patch = whole(list(contact.patches[0].values()))
    nodes = (points[tyre], u[tyre]), (points[head], u[head])
    overlap = float(record.history.get(f"{name}_max_penetration", np.zeros(1))[0])
    return compared(scene, placement_of(scene), patch, *nodes, overlap)


def tell(model: "Model", log: Callable[[str], Any]) -> None:
    """Log how a wheel that has been brought to rest on a rail presses on it; collective.

    Args:
        model: The model after its equilibrium.
        log: Called with each line, on every rank.
    """
    scene, u, v = model.scene, model.state.u.x.array, model.state.v.x.array
    if not isinstance(scene.mesh, WheelRailMesh) or scene.equilibrium is None:
        return
    for name, pair in model.pairs.items():
        contact, footprint = scene.contacts[name], pair.footprint()
        sides = (contact.contactor, contact.target)
        if set(sides) != {"tread", "railhead"} or not footprint.patches:
            continue
        patch = whole(list(patches_of(vars(footprint)).values()))
        moved = [
            (surface.reference, now[:, :3] - surface.reference)
            for surface, now in zip((pair.contactor, pair.target), pair.surfaces(u, v), strict=True)
        ]
        tyre, head = moved[:: 1 if sides[0] == "tread" else -1]
        try:
            rest = compared(scene, model.placement, patch, tyre, head, pair.max_penetration)
        except RuntimeError as error:  # the run does not hang on it
            log(f"at rest: {error}")
            continue
        for line in rest.lines() if rest else ():
            log(line)


def compared(
    scene: Scene,
    at: Placement,
    patch: PatchNodes,
    tyre: tuple[Array, Array],
    head: tuple[Array, Array],
    overlap: float,
) -> AtRest | None:
    """Return a patch and what is expected of it, None if the bodies are not isotropic.

    Args:
        scene: The scene.
        at: Where the wheel stood before any load.
        patch: All nodes in contact.
        tyre: Undeformed positions and displacements of nodes of the tyre, ``(n, 3)`` each [m].
        head: Those of the rail head.
        overlap: Of the nodes, the largest [m].

    Raises:
        RuntimeError: if the half-spaces have no contact of a size to be found.
    """
    modulus = modulus_of(scene)
    if modulus is None:
        return None
    drawn = surfaces(scene, at)
    wheel, rail = (standing(s, *nodes, patch) for s, nodes in zip(drawn, (tyre, head), strict=True))
    load = patch.normal_force
    hard = profile_contact(wheel, rail, patch.centre, load, modulus)
    layer = overlap / float(patch.pressure.max())
    return AtRest(patch, hard, with_layer(hard, wheel, rail, load, modulus, layer), overlap)


def standing(surface: Surface, points: Array, u: Array, patch: PatchNodes) -> Surface:
    """Return a surface moved as the nodes on it around a patch have moved in the mean.

    Args:
        surface: As drawn and placed.
        points: Nodes of the body, undeformed, shape ``(n, 3)`` [m].
        u: Their displacement, shape ``(n, 3)`` [m].
        patch: Where the bodies touch.
    """
    near, far = np.array(AROUND) * np.sqrt(patch.area / np.pi)
    distance = np.linalg.norm(points - patch.centre, axis=1)
    around = np.flatnonzero((distance > near) & (distance < far))
    depth, gradient = surface.depth(points[around])
    around = around[np.abs(depth) < ON * np.linalg.norm(gradient, axis=1)]
    moved = rigid_motion(points[around], u[around], patch.centre)
    return surface.moved(moved.velocity, moved.spin, patch.centre)


def whole(patches: list[PatchNodes]) -> PatchNodes:
    """Return the nodes of all patches as one."""
    return PatchNodes(*(np.concatenate([vars(p)[k] for p in patches]) for k in vars(patches[0])))


def surfaces(scene: Scene, at: Placement) -> tuple[Surface, Surface]:
    """Return the running surfaces of wheel and rail as drawn and placed, before any load."""
    mesh = scene.mesh
    assert isinstance(mesh, WheelRailMesh)
    profile, head, _ = profiles_of(mesh)
    rail = rail_in_track(head, inclination=mesh.inclination, gauge=mesh.gauge)
    wheel = wheel_surface(profile, mesh.wheel_radius, at.centre, at.yaw, at.roll)
    return wheel, rail_surface(rail)


def modulus_of(scene: Scene) -> float | None:
    """Return the contact modulus E* of tyre and rail head [Pa], None if they are not isotropic."""
    tyre, head = material(scene, "tyre"), material(scene, "rail_head")
    if tyre is None or head is None:
        return None
    wheel, rail = ((m.youngs_modulus, m.poisson_ratio) for m in (tyre, head))
    return contact_modulus(*wheel, *rail)


def weight_on_rail(record: Record) -> float | None:
    """Return the weight that a wheelset with its vehicle puts on the rail [N], None if unknown.

    Assumes gravity along z. The mesh is needed: None for a run without fields.
    """
    scene = record.checked
    if not (record.wheel_on_rail and scene.rolling and scene.gravity):
        return None
    wheelset = scene.bodies[scene.rolling.body]
    parts = [readings.volumes(record, region.lower()) for region in wheelset.regions]
    volume = sum(float(part.sum()) for part in parts if part is not None)
    mass = scene.vehicle.sprung_mass if scene.vehicle else 0.0
    return -scene.gravity[2] * (mass + wheelset.material.density * volume) if volume else None


def wheel_at_rest(record: Record) -> Iterator[Expected]:
    """Expecteds for a wheel at rest on a rail at the first output: weight, and half-spaces.

    Assumes an axle that is level and not held upwards, and isotropic tyre and rail head. None
    of half-spaces where the patch is too large for them: a flange that lies in the gauge corner.
    """
    scene = record.checked
    mesh = scene.mesh
    if not isinstance(mesh, WheelRailMesh) or scene.equilibrium is None or not scene.contacts:
        return
    first = record.patches_at(next(iter(scene.contacts)), 0)
    weight, gravity = weight_on_rail(record), scene.gravity or (0.0, 0.0, 0.0)
    holds = [s for s in (*scene.supports, *scene.equilibrium.hold) if s.surface in WHEELSET]
    free = all(set(s.directions) <= {"axle", "x"} for s in holds)
    if weight is not None and first and free and not mesh.roll and not any(gravity[:2]):
        vertical = sum(patch.vertical_force for patch in first.values())
        yield Expected("vertical force at rest, weight", "N", vertical, weight, STATICS)
    try:
        rest = at_rest(record)
    except RuntimeError:  # said in the log at the start of the run
        return
    if rest is None:
        return
    name = "nodal pressure at rest off half-spaces, rms over p0"
    yield Expected(name, "1", rest.error, 0.0, HALF_SPACE)
    yield Expected("the same with the penalty's layer", "1", rest.softened_error, 0.0, HALF_SPACE)
    k = int(np.argmax(rest.pressure))
    exact = rest.expected.pressure(rest.at[[k]], rest.patch.areas[[k]])[0]
    name = "largest nodal pressure at rest, mean over its area"
    yield Expected(name, "Pa", float(rest.pressure[k]), float(exact), HALF_SPACE)
    _, *found, _ = rest.found["nodes"]
    _, *axes, _ = rest.found["half-space"]
    for way, value, answer in zip(("along", "across"), found, axes, strict=True):
        yield Expected(f"half axis at rest {way}, from moments", "m", value, answer, HALF_SPACE)
