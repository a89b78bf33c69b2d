# SPDX-License-Identifier: LGPL-3.0-or-later
"""Footprints in ``results.h5``: contact of a pair at an output, on the facets of both bodies.

``/surfaces/PAIR/contactor`` and ``target`` hold nodes, their areas and facets of both surfaces
once; a rigid one is left out. ``/contact/PAIR/K`` has the nodes of the contactor that bear forces
and, as rows of ``target``, those of the target with the reactions; its attribute ``columns`` names
the columns. ``contactor_position`` and ``target_position`` are where the nodes of all facets round
these are, ascending.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from meshes.arrays import Array, Index
from workflow.results.batch import opened
from workflow.results.columns import Item, whole
from workflow.results.patches import creepages
from workflow.scene import Scene, SceneError

if TYPE_CHECKING:
    from contact.creepage import Creepage
    from contact.footprint import Footprint
    from contact.surface import Surface

# Of each node; forces act on the body that the node belongs to.
UNITS = {
    "node": "1",
    "position": "m",
    "normal": "1",
    "normal_force": "N",
    "tangential_force": "N",
    "area": "m^2",
    "slip_velocity": "m/s",
    "stick": "1",
    "patch": "1",
    "friction": "1",
    "friction_power": "W",
}
# Columns of the rows of the target, and how many each has: one dataset costs a ninth of nine.
REACTIONS = {
    "node": 1,
    "normal": 3,
    "normal_force": 1,
    "tangential_force": 3,
    "slip_velocity": 3,
    "friction_power": 1,
    "stick": 1,
    "patch": 1,
}
HEADS = " ".join(name if n == 1 else f"{name}:{n}" for name, n in REACTIONS.items())


@dataclass(frozen=True)
class Side:
    """Contact on one body of a pair.

    Attributes:
        surface: The whole surface.
        foot: Its nodes that bear forces.
        position: Current positions of all its nodes, shape ``(n, 3)`` [m].
    """

    surface: "Surface"
    foot: "Footprint"
    position: Array


@dataclass(frozen=True)
class Touch:
    """Contact of a pair at one output.

    Attributes:
        foot: The contactor's nodes that bear forces, with their patches.
        motion: Creepage at each patch.
        sides: Both bodies by name, a rigid one left out; nothing where nothing touches.
    """

    foot: "Footprint"
    motion: "tuple[Creepage, ...]"
    sides: dict[str, Side]


def touch(pair: Any, u: Array, v: Array, scene: Scene) -> Touch:
    """Return the contact of a pair; collective.

    Args:
        pair: The contact pair, after its step.
        u: Displacement of that step, flat, owned dofs first [m].
        v: Velocity at the same time [m/s].
        scene: What tells how contact travels and when a node adheres.
    """
    tolerance = scene.contacts[pair.name].stick_tolerance
    foot = pair.footprint(stick_tolerance=tolerance)
    if not foot.patches:
        return Touch(foot, (), {})
    contactor, target = pair.surfaces(u, v)
    sides = {"contactor": Side(pair.contactor, foot, contactor[:, :3])}
    if not pair.target.rigid:
        reactions = pair.target_footprint(foot, tolerance)
        sides["target"] = Side(pair.target, reactions, target[:, :3])
    return Touch(foot, creepages(contactor, target, foot, scene), sides)


def items(group: str, touch: Touch, identity: Index) -> Iterator[Item]:
    """Yield the contact of a pair at one output.

    Args:
        group: Where in the file.
        touch: The contact.
        identity: Identity of each patch, shape ``(p,)``.
    """
    foot = touch.foot
    for name, unit in UNITS.items():
        yield whole(f"{group}/{name}", _values(foot, name, identity), units=unit)
    for name, side in touch.sides.items():
        surface = side.surface
        around = _around(surface.facets, np.searchsorted(surface.nodes, side.foot.node))
        corners = np.unique(surface.facets[around])
        yield whole(f"{group}/{name}_position", side.position[corners], units="m")
    if "target" in touch.sides:
        reactions = touch.sides["target"].foot
        rows = np.column_stack([_values(reactions, name, identity) for name in REACTIONS])
        yield whole(f"{group}/target", rows, columns=HEADS)


def _values(foot: "Footprint", name: str, identity: Index) -> npt.NDArray[Any]:
    return np.asarray(identity[foot.patch] if name == "patch" else getattr(foot, name))


def _around(facets: npt.NDArray[Any], nodes: Index) -> npt.NDArray[np.bool_]:
    """Return which facets have one of the nodes."""
    on = np.zeros(int(facets.max()) + 1, dtype=bool)
    on[nodes] = True
    return np.asarray(on[facets].any(axis=1))


def surface_items(pair: str, sides: dict[str, Side]) -> Iterator[Item]:
    """Yield the surfaces of a pair."""
    from contact.surface import tributary_area

    for name, side in sides.items():
        group, surface = f"surfaces/{pair}/{name}", side.surface
        yield whole(f"{group}/node", surface.nodes, units="1")
        yield whole(f"{group}/area", tributary_area(surface), units="m^2")
        yield whole(f"{group}/facet", surface.facets, units="1")


@dataclass(frozen=True)
class Facets:
    """Contact on one body at one output, read back: its facets there, and what their nodes bear.

    Nodes that bear nothing have zeros, and -1 as patch.

    Attributes:
        t: Time [s].
        pair: Name of the pair.
        side: ``contactor`` or ``target``.
        node: Mesh node of each, ascending, shape ``(n,)``.
        position: Current positions, shape ``(n, 3)`` [m].
        facets: As indices of these nodes, shape ``(q, 4)``.
        nodal: Values of the nodes by name, shape ``(n, ...)``, in SI units; vectors in the axes of
            the track, forces and stresses on this body.
    """

    t: float
    pair: str
    side: str
    node: Index
    position: Array
    facets: Index
    nodal: dict[str, npt.NDArray[Any]]


def read(folder: Path) -> Iterator[list[Facets]]:
    """Yield for each output the contact on both bodies of every pair that ever touched.

    Raises:
        SceneError: if the folder has no footprints with facets.
    """
    with opened(folder / "results.h5") as file:
        found = file.get("surfaces", {})
        surfaces = [(p, side, group) for p in found for side, group in found[p].items()]
        if not surfaces:
            raise SceneError(
                f"folder = {str(folder)!r}: expected a run whose bodies have touched, with facets "
                "in results.h5, as it is since they are kept; found none"
            )
        for k in sorted(file[f"contact/{surfaces[0][0]}"], key=int):
            if "friction_power" not in file[f"contact/{surfaces[0][0]}/{k}"]:
                raise SceneError(
                    f"folder = {str(folder)!r}: expected facets at every output, but output {k} "
                    "was written before they were kept; run it again from the start"
                )
            yield [_facets(file[f"contact/{p}/{k}"], p, *rest) for p, *rest in surfaces]


def _facets(group: Any, pair: str, side: str, surface: Any) -> Facets:
    """Return the contact on one body from the group of an output."""
    t, node = float(group.attrs["t"]), surface["node"][:]
    # where nothing touches only the contactor's arrays are there, and empty
    if side == "target" and "target" in group:
        parts = np.split(group["target"][:], np.cumsum([*REACTIONS.values()])[:-1], axis=1)
        named = zip(REACTIONS.items(), parts, strict=True)
        arrays = {name: part if n > 1 else part[:, 0] for (name, n), part in named}
    else:
        arrays = {name: group[name][:] for name in REACTIONS}
    bears = np.searchsorted(node, arrays["node"])
    facet = surface["facet"][:]
    corners, facets = np.unique(facet[_around(facet, bears)], return_inverse=True)
    position = group[f"{side}_position"][:] if len(bears) else np.zeros((0, 3))
    nodal = nodal_values(arrays, surface["area"][:][bears])
    whole_nodal, at = {}, np.searchsorted(corners, bears)
    for name, array in nodal.items():
        none = -1 if name == "patch" else 0
        whole_nodal[name] = np.full((len(corners), *array.shape[1:]), none, array.dtype)
        whole_nodal[name][at] = array
    return Facets(t, pair, side, node[corners], position, facets.reshape(-1, 4), whole_nodal)


def nodal_values(foot: dict[str, npt.NDArray[Any]], area: Array) -> dict[str, npt.NDArray[Any]]:
    """Return what nodes bear, by name, from their forces [N] and areas [m2]."""
    return {
        "pressure": foot["normal_force"] / area,
        "shear": foot["tangential_force"] / area[:, None],
        "slip_velocity": foot["slip_velocity"],
        "friction_power_density": foot["friction_power"] / area,
        "stick": foot["stick"].astype(np.uint8),
        "patch": foot["patch"].astype(np.int32),
        "normal": foot["normal"],
        "area": area,
    }
