# SPDX-License-Identifier: LGPL-3.0-or-later
"""Patches of a wheel on a rail, at rest or rolling, against Hertz's ellipse and half-spaces.

Both are made for each patch from the drawn profiles where wheel and rail stand in the state, and
loaded by the normal force found. How they stand is read from their running surfaces around the
patch, to each of which a rigid motion is fitted: under the load the axle bends and the rail twists,
which moves the contact by millimetres. Friction does not change the pressure between bodies of the
same material, so the same holds while they roll and slide. Where all of a patch slips, its shear is
friction times pressure along the slip: that of the rigid bodies, which elastic slip turns little.
"""

from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from contact.creepage import Motion
from contact.footprint import shear_angle
from contact.theory.closed_forms import contact_modulus
from contact.theory.wheel_on_rail import SEEK, WheelOnRail, profile_contact, with_layer
from meshes.arrays import Array
from meshes.profiles.placement import Placement
from meshes.profiles.surfaces import Surface, rail_surface, wheel_surface
from meshes.tags import Tag
from workflow.model.geometry import in_track, placement_of, profiles_of
from workflow.results.patch_nodes import STEEP, PatchNodes, patches_of
from workflow.results.record import Record
from workflow.scene.mesh import WheelRailMesh
from workflow.scene.scene import Scene
from workflow.theory import readings
from workflow.theory.assumptions import material
from workflow.theory.quantity import HALF_SPACE, STATICS, Expected

if TYPE_CHECKING:
    from workflow.model.model import Model

AROUND = (3.0, 8.0)  # nodes that show how a body stands: distance in radii of the patch
FEWEST = 6  # nodes that show it
WHEELSET = ("tread", "axle_inner", "axle_outer", "journal", "wheelset_skin")
SIDES = {"tread", "railhead"}
FEW = 6  # outputs of a run that are compared with half-spaces for its summary
ON = 2e-4  # a node nearer to the drawn surface than this is on it [m]


@dataclass(frozen=True)
class OnHalfSpaces:
    """A patch and what is expected of it.

    Attributes:
        place: Of the patch: 1 on the rail top, 2 at the gauge corner.
        patch: The nodes in contact.
        sides: Length along and across of the part of the surface that each node stands for, shape
            ``(n, 2)`` [m].
        expected: Both expectations under the same force.
        wheel, rail: Running surfaces as they stand.
        modulus: Contact modulus E* [Pa].
        overlap: Of the nodes, the largest [m].
    """

    place: int
    patch: PatchNodes
    sides: Array
    expected: WheelOnRail
    wheel: Surface
    rail: Surface
    modulus: float
    overlap: float

    @cached_property
    def softened(self) -> WheelOnRail:
        """The expectations with a layer between that gives way as the penalty does."""
        load, layer = self.patch.normal_force, self.overlap / float(self.pressure.max())
        return with_layer(self.expected, self.wheel, self.rail, load, self.modulus, layer)

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

        The expectation is averaged with the shape function of each node.
        """
        return self._off(self.expected)

    @property
    def softened_error(self) -> float:
        """The same with the layer: what is not due to the penalty."""
        return self._off(self.softened)

    def _off(self, e: WheelOnRail) -> float:
        off = self.pressure - e.pressure(self.at, self.sides)
        return float(np.sqrt(np.mean(off**2)) / e.half_space.pressure.max())

    @property
    def found(self) -> dict[str, tuple[float, float, float, float]]:
        """Largest pressure [Pa], half axes [m] and area [m2] of the nodes and as expected.

        Half axes and area are those of the ellipse of the same second moments, ``a**2 / 5`` for
        Hertz; the areas that nodes stand for reach half a cell too far on every side.
        """
        e, p = self.expected, self.expected.half_space.pressure
        axes = half_axes(self.at, self.patch.normal_forces)
        rows = {"nodes": (float(self.pressure.max()), *axes)}
        rows["half-space"] = (float(p.max()), *half_axes(e.grid, p.ravel()))
        if e.hertz:
            rows["Hertz"] = (e.hertz.p0, e.hertz.a, e.hertz.b)
        return {name: (p0, a, b, float(np.pi * a * b)) for name, (p0, a, b) in rows.items()}

    def full_slip(self, slip: Motion) -> Array:
        """Return the tangential force on the lower body if all slips, in the frame of the patch.

        Friction times the pressure of the half-spaces along the rigid slip at each place:
        longitudinal and lateral, shape ``(2,)`` [N].

        Args:
            slip: Rigid motion of the upper body against the lower one.
        """
        e, frame = self.expected, self.patch.frame
        way = slip.at(e.origin + e.grid @ e.frame[:2]) @ frame[:2].T
        way /= np.linalg.norm(way, axis=1)[:, None]
        pressure, spacing = e.half_space.pressure.ravel(), e.half_space.spacing
        return np.asarray(self.patch.mean_friction * spacing[0] * spacing[1] * (pressure @ way))

    def lines(self, when: str = "at rest") -> list[str]:
        """Return the comparison in words and numbers, a line each."""
        e, patch = self.expected, self.patch
        angle, nodes = np.degrees(patch.contact_angle), len(patch.areas)
        of = f"{when}, patch {self.place}"
        said = [
            f"{of}: {patch.normal_force / 1e3:.1f} kN at {angle:.1f}° on "
            f"{nodes} nodes; undeformed profiles touch at {e.angle:.1f}°, relative "
            f"radii {e.radii[0]:.3f} m along, {e.radii[1]:.3f} m across"
        ]
        said += [
            f"{of}, {name}: p0 {p0 / 1e6:.0f} MPa, half axes "
            f"{a * 1e3:.2f} and {b * 1e3:.2f} mm, area {area * 1e6:.1f} mm²"
            for name, (p0, a, b, area) in self.found.items()
        ]
        said += [
            f"{of}: overlap of {self.overlap * 1e6:.1f} µm in an approach of "
            f"{e.half_space.approach * 1e6:.0f} µm",
            f"{of}: nodal pressure {self.error:.1%} rms off the "
            f"half-space, {self.softened_error:.1%} off that with such a layer",
        ]
        return said


def half_axes(at: Array, force: Array) -> tuple[float, float]:
    """Return the half axes, along the axes of the frame, of the ellipse of the same moments [m]."""
    centre = force @ at / force.sum()
    return readings.half_axes(at - centre, force)


def at_rest(record: Record) -> list[OnHalfSpaces]:
    """Return the patches at rest of a run by place; none if no wheel rests on a rail there."""
    if not record.wheel_on_rail or record.checked.equilibrium is None:
        return []
    return [patch for _, patches in on_half_spaces(record, [0]) for patch in patches]


def on_half_spaces(
    record: Record, outputs: Iterable[int]
) -> Iterator[tuple[float, list[OnHalfSpaces]]]:
    """Yield the time of an output and the patches of a wheel on a rail there, by place.

    Left out are patches too large for half-spaces: a flange that lies in the gauge corner. Of a run
    without fields, nothing.

    Args:
        record: The run.
        outputs: Numbers of its outputs.
    """
    scene, body = record.checked, record.body
    if not isinstance(scene.mesh, WheelRailMesh) or not record.contacts or body is None:
        return
    name, contact = next(iter(record.contacts.items()))
    drawn, history = surfaces(scene, placement_of(scene)), record.history
    depths = history.get(f"{name}_max_penetration", np.zeros_like(history["t"]))
    tyre, head = (np.unique(body.cells[body.regions == r]) for r in (Tag.TYRE, Tag.RAIL_HEAD))
    for output in outputs:
        t = float(contact.t[output])
        u, deepest = record.displacement(t), float(depths[np.argmin(np.abs(history["t"] - t))])
        nodes = (body.points[tyre], u[tyre]), (body.points[head], u[head])
        found: list[OnHalfSpaces | None] = []
        for place, patch in contact.patches[output].items():
            with suppress(RuntimeError):  # said in the log at the start of the run
                found.append(compared(scene, drawn, place, patch, *nodes, deepest))
        yield t, [patch for patch in found if patch]


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
        if set(sides) != SIDES or not footprint.patches:
            continue
        moved = [
            (surface.reference, now[:, :3] - surface.reference)
            for surface, now in zip((pair.contactor, pair.target), pair.surfaces(u, v), strict=True)
        ]
        tyre, head = moved[:: 1 if sides[0] == "tread" else -1]
        drawn = surfaces(scene, model.placement)
        for place, patch in patches_of(vars(footprint)).items():
            overlap = pair.max_penetration
            try:
                rest = compared(scene, drawn, place, patch, tyre, head, overlap)
            except RuntimeError as error:  # the run does not hang on it
                log(f"at rest, patch {place}: {error}")
                continue
            for line in rest.lines() if rest else ():
                log(line)


def compared(
    scene: Scene,
    drawn: tuple[Surface, Surface],
    place: int,
    patch: PatchNodes,
    tyre: tuple[Array, Array],
    head: tuple[Array, Array],
    overlap: float,
) -> OnHalfSpaces | None:
    """Return a patch and what is expected of it, None if the bodies are not isotropic.

    Args:
        scene: The scene.
        drawn: Running surfaces of wheel and rail before any load.
        place: Of the patch: 1 or 2.
        patch: Its nodes.
        tyre: Undeformed positions and displacements of nodes of the tyre, ``(n, 3)`` each [m].
        head: Those of the rail head.
        overlap: Of all nodes in contact, the largest [m].

    Raises:
        RuntimeError: if the half-spaces have no contact of a size to be found.
    """
    modulus = modulus_of(scene)
    if modulus is None:
        return None
    wheel, rail = (standing(s, *nodes, patch) for s, nodes in zip(drawn, (tyre, head), strict=True))
    touching = [c.contactor for c in scene.contacts.values() if {c.contactor, c.target} == SIDES]
    points, u = tyre if touching == ["tread"] else head
    sides = sides_of(patch, points + u)
    # somewhat farther than the nodes reach, not as far as the other patch
    reach = np.minimum(SEEK, 1.4 * (np.abs(patch.local) + sides).max(axis=0))
    expected = profile_contact(wheel, rail, patch.centre, patch.normal_force, modulus, tuple(reach))
    return OnHalfSpaces(place, patch, sides, expected, wheel, rail, modulus, overlap)


def sides_of(patch: PatchNodes, nodes: Array) -> Array:
    """Return how far along and across each node of a patch stands for the surface, ``(n, 2)`` [m].

    The side towards the nearest neighbour is its distance, the other one fills the area.

    Args:
        patch: Nodes of a contactor.
        nodes: All nodes of the contactor's body as they stand, shape ``(m, 3)`` [m].
    """
    distance, nearest = KDTree(nodes).query(patch.position, k=2)
    way = np.abs((nodes[nearest[:, 1]] - patch.position) @ patch.frame[:2].T)
    near, far = distance[:, 1], patch.areas / distance[:, 1]
    across = way[:, 1] > way[:, 0]
    return np.column_stack([np.where(across, far, near), np.where(across, near, far)])


def standing(surface: Surface, points: Array, u: Array, patch: PatchNodes) -> Surface:
    """Return a surface moved as the nodes on it around a patch have moved in the mean.

    Args:
        surface: As drawn and placed.
        points: Nodes of the body, undeformed, shape ``(n, 3)`` [m].
        u: Their displacement, shape ``(n, 3)`` [m].
        patch: Where the bodies touch.

    Raises:
        RuntimeError: if there are too few nodes around it.
    """
    near, far = np.array(AROUND) * np.sqrt(patch.area / np.pi)
    now = points + u
    distance = np.linalg.norm(now - patch.centre, axis=1)
    around = np.flatnonzero((distance > near) & (distance < far))
    depth, gradient = surface.depth(points[around])
    around = around[np.abs(depth) < ON * np.linalg.norm(gradient, axis=1)]
    if len(around) < FEWEST:
        raise RuntimeError(
            f"half-space contact: expected {FEWEST} nodes of the surface or more {near:.3f} to "
            f"{far:.3f} m around the patch, got {len(around)}"
        )
    before, after = points[around].mean(axis=0), now[around].mean(axis=0)
    turn, _ = Rotation.align_vectors(now[around] - after, points[around] - before)
    return surface.moved(after - before, turn.as_rotvec(), before)


def surfaces(scene: Scene, at: Placement) -> tuple[Surface, Surface]:
    """Return the running surfaces of wheel and rail as drawn and placed, before any load."""
    mesh = scene.mesh
    assert isinstance(mesh, WheelRailMesh)
    profile, head, _ = profiles_of(mesh)
    rail = in_track(mesh, head)
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
    for rest in at_rest(record):
        yield from _off_half_spaces(f"patch {rest.place} at rest", [rest])


def wheel_rolling(record: Record) -> Iterator[Expected]:
    """Expecteds for a wheel that rolls on a rail: areas, peaks and pressures of half-spaces.

    Means over some outputs, of those at which it touches in two patches if there are any.
    """
    scene = record.checked
    if not (record.wheel_on_rail and scene.rolling and scene.rolling.speed and record.contacts):
        return
    contact = next(iter(record.contacts.values()))
    touching = [k for k, patches in enumerate(contact.patches) if k and patches]
    two = [k for k in touching if contact.two_points[k]]
    outputs = spread(two or touching, FEW)
    seen = [(t, patch) for t, patches in on_half_spaces(record, outputs) for patch in patches]
    for place in (1, 2):
        mine = [(t, patch) for t, patch in seen if patch.place == place]
        if mine:
            name = f"patch {place} rolling, mean of {len(mine)} outputs"
            yield from _off_half_spaces(name, [patch for _, patch in mine])
            yield from _in_full_slip(place, record, mine)


def rigid_slip(record: Record, t: float, place: int) -> Motion | None:
    """Return the rigid motion of the upper body against the lower one at a patch.

    None where a folder has no table of patches; of several patches of a place, the heaviest's.
    """
    table = record.patches
    if "rigid_slip" not in table:
        return None
    mine = np.isclose(table["t"], t, rtol=1e-9) & ((table["contact_angle"] >= STEEP) + 1 == place)
    if not mine.any():
        return None
    k = np.flatnonzero(mine)[np.argmax(table["normal_force"][mine])]
    along, normal = table["longitudinal"][k], table["normal"][k]
    side = np.sign(normal[2])  # the table has the contactor against the target
    slip = table["rigid_slip"][k] @ [along, np.cross(normal, along)]
    return Motion(table["centre"][k], side * slip, side * table["spin_rate"][k] * normal)


def _in_full_slip(
    place: int, record: Record, patches: list[tuple[float, OnHalfSpaces]]
) -> Iterator[Expected]:
    """Expecteds for mean shear and its angle over the outputs at which no node adheres.

    The areas that nodes stand for reach too far, so mean shear is also taken over the ellipse of
    the same second moments, on both sides.
    """
    forces: list[list[Array]] = []
    areas: list[list[list[float]]] = []
    for t, rest in patches:
        patch, slip = rest.patch, rigid_slip(record, t, place)
        if slip is not None and not patch.stick.any() and patch.mean_friction > 0:
            shear = np.array([patch.longitudinal_shear, patch.lateral_shear])
            forces.append([patch.area * shear, rest.full_slip(slip)])
            ellipses = [rest.found[of][3] for of in ("nodes", "half-space")]
            areas.append([[patch.area, rest.expected.half_space.area], ellipses])
    if not forces:
        return
    name = f"patch {place} in full slip, mean of {len(forces)} outputs"
    size = np.linalg.norm(forces, axis=2)[:, None]
    over = zip(("area of nodes", "ellipse"), np.mean(size / areas, axis=0), strict=True)
    for what, (value, exact) in over:
        quantity = f"{name}: mean shear over the {what}"
        yield Expected(quantity, "Pa", float(value), float(exact), HALF_SPACE)
    # on the lower body, which shear_angle takes on the upper one
    found, answer = (shear_angle(-force) for force in np.mean(forces, axis=0))
    yield Expected(f"{name}: angle θ of the shear", "rad", found, answer, HALF_SPACE)


def spread(items: list[int], most: int) -> list[int]:
    """Return at most so many items of a list, evenly spread, its last one among them."""
    chosen = np.unique(np.linspace(len(items) - 1, 0, min(most, len(items))).astype(int))
    return [items[k] for k in chosen]


def _off_half_spaces(name: str, patches: list[OnHalfSpaces]) -> Iterator[Expected]:
    """Expecteds for means over patches: pressures, half axes and areas of half-spaces."""
    rms = float(np.mean([patch.error for patch in patches]))
    yield Expected(
        f"{name}: nodal pressure off half-spaces, rms over p0", "1", rms, 0.0, HALF_SPACE
    )
    rows = [(patch.found["nodes"], patch.found["half-space"]) for patch in patches]
    found, answer = np.mean(rows, axis=0)
    columns = {"peak pressure": "Pa", "half axis along": "m", "half axis across": "m", "area": "m2"}
    for (what, unit), value, exact in zip(columns.items(), found, answer, strict=True):
        yield Expected(f"{name}: {what}", unit, float(value), float(exact), HALF_SPACE)
