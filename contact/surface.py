# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact surfaces as flat arrays, from tagged facets of a DOLFINx domain."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from meshes.arrays import Array
from meshes.hexmesh import FACES
from meshes.quads import area_vectors, corner_areas
from meshes.quality import cell_volumes

if TYPE_CHECKING:
    from meshes.domain import Domain
    from meshes.hexmesh import HexMesh


@dataclass(frozen=True)
class Surface:
    """A surface of bilinear facets, whole on every rank.

    Attributes:
        name: Name for messages.
        nodes: HexMesh node of each surface node, ascending, shape ``(n,)``; negative where the
            node belongs to no mesh (rigid surfaces).
        reference: Undeformed positions, shape ``(n, 3)`` [m].
        facets: Facets as indices into ``nodes``, counter-clockwise from outside, ``(q, 4)``.
        mass: Lumped mass of each node, infinite if rigid, shape ``(n,)`` [kg].
        dofs: Dof block of each node if this rank owns it, else -1, shape ``(n,)``.
        foundation: Bulk modulus times area over volume of the cell behind each facet, infinite if
            rigid, shape ``(q,)`` [Pa/m]; None where it is not known.
    """

    name: str
    nodes: npt.NDArray[np.int64]
    reference: Array
    facets: npt.NDArray[np.int32]
    mass: Array
    dofs: npt.NDArray[np.int32]
    foundation: Array | None = None

    @property
    def rigid(self) -> bool:
        """Whether no node of the surface can move."""
        return bool(np.isinf(self.mass).all())


def tributary_area(surface: Surface) -> Array:
    """Return the undeformed area that belongs to each node, shape ``(n,)`` [m2]."""
    share = corner_areas(surface.reference, surface.facets)
    area = np.bincount(surface.facets.ravel(), share.ravel(), minlength=len(surface.nodes))
    return np.asarray(area, dtype=np.float64)


def _check(
    name: str, nodes: npt.NDArray[np.int64], points: Array, facets: npt.NDArray[np.int32]
) -> None:
    """Raise ValueError if a facet is folded, has no area or repeats a node."""
    p = points[facets]
    area = area_vectors(points, facets)
    longest = np.max(np.linalg.norm(p - np.roll(p, -1, axis=1), axis=2), axis=1)
    corner = np.cross(np.roll(p, -1, axis=1) - p, np.roll(p, 1, axis=1) - p)
    folded = np.einsum("qia,qa->qi", corner, area).min(axis=1) < 0.0
    bad = np.flatnonzero(folded | ~(np.linalg.norm(area, axis=1) > 1e-9 * longest**2))
    if bad.size:
        raise ValueError(
            f"surface {name}: {bad.size} degenerate or folded facets, first one has nodes "
            f"{nodes[facets[bad[0]]].tolist()}; expected convex quads with positive area"
        )


def foundation(
    mesh: "HexMesh", quads: npt.NDArray[np.int64], bulk: Mapping[int, float], name: str
) -> Array:
    """Return bulk modulus times area over volume of the cell behind each quad, ``(q,)`` [Pa/m].

    Raises:
        ValueError: if a quad is no face of a cell, or its region has no bulk modulus.
    """
    on = np.zeros(len(mesh.points), dtype=bool)
    on[quads] = True
    behind = np.flatnonzero(on[mesh.cells].sum(axis=1) >= 4)
    faces = np.sort(mesh.cells[behind][:, FACES].reshape(-1, 4), axis=1)
    _, place = np.unique(np.vstack([np.sort(quads, axis=1), faces]), axis=0, return_inverse=True)
    place = place.ravel()
    owner = np.full(int(place.max()) + 1, -1, dtype=np.int64)
    owner[place[len(quads) :]] = np.repeat(behind, 6)
    cell = owner[place[: len(quads)]]
    if (cell < 0).any():
        raise ValueError(f"surface {name}: {(cell < 0).sum()} facets are no faces of a cell")
    regions = mesh.regions[cell]
    unknown = sorted(set(map(int, np.unique(regions))) - set(bulk))
    if unknown:
        raise ValueError(f"surface {name}: no bulk modulus for regions {unknown}")
    modulus = np.array([bulk[int(tag)] for tag in regions])
    area = np.linalg.norm(area_vectors(mesh.points, quads), axis=1)
    return np.asarray(modulus * area / cell_volumes(mesh.points, mesh.cells[cell]))


def meshed(mesh: "HexMesh", tags: int | Iterable[int], *, name: str | None = None) -> Surface:
    """Return the surface of a mesh that no rank has yet: masses are 1 kg, no node is this rank's.

    Args:
        mesh: The mesh.
        tags: One surface tag or several.
        name: Name for messages; the tags if left out.

    Raises:
        ValueError: if no facet carries the tags or a facet is degenerate.
    """
    wanted = [int(t) for t in tags] if isinstance(tags, Iterable) else [int(tags)]
    name = "+".join(str(t) for t in wanted) if name is None else name
    quads = mesh.surface(*wanted)
    if not len(quads):
        known = sorted({int(t) for t in np.unique(mesh.surfaces)})
        raise ValueError(f"surface {name}: no facets with tags {wanted}; the mesh has {known}")
    nodes, facets = np.unique(quads, return_inverse=True)
    local = facets.reshape(-1, 4).astype(np.int32)
    points = np.ascontiguousarray(mesh.points[nodes], dtype=np.float64)
    _check(name, nodes, points, local)
    nowhere = np.full(len(nodes), -1, dtype=np.int32)
    return Surface(name, nodes, points, local, np.ones(len(nodes)), nowhere)


def surface(
    domain: "Domain",
    tags: int | Iterable[int],
    mass: Array,
    *,
    name: str | None = None,
    bulk: Mapping[int, float] | None = None,
) -> Surface:
    """Return the surface of a domain that carries any of ``tags``; collective.

    Args:
        domain: The distributed mesh.
        tags: One surface tag or several.
        mass: Lumped nodal mass in the order of ``domain.nodes``, shape ``(n_local,)`` [kg].
            Values of ghosts are not read.
        name: Name for messages; the tags if left out.
        bulk: Bulk modulus by region tag [Pa]; gives the surface its ``foundation``.

    Raises:
        ValueError: if no facet carries the tags, a facet is degenerate or a mass not positive.
    """
    found = meshed(domain.source, tags, name=name)
    if mass.shape != domain.nodes.shape:
        raise ValueError(
            f"mass: expected one value per local node {domain.nodes.shape}, got {mass.shape}"
        )
    dofs = domain.local_dofs(found.nodes)
    own = np.zeros(len(found.nodes))
    own[dofs >= 0] = mass[dofs[dofs >= 0]]
    comm = domain.msh.comm
    everywhere = comm.allreduce(own) if comm.size > 1 else own
    if not (everywhere > 0.0).all():
        worst = int(np.argmin(everywhere))
        raise ValueError(
            f"surface {found.name}: expected positive nodal masses, got {everywhere[worst]:.3e} kg "
            f"at node {found.nodes[worst]}"
        )
    quads = found.nodes[found.facets]
    stiff = None if bulk is None else foundation(domain.source, quads, bulk, found.name)
    return replace(found, mass=everywhere, dofs=dofs, foundation=stiff)


def rigid_plane(
    origin: Iterable[float], normal: Iterable[float], half_width: float, *, name: str = "plane"
) -> Surface:
    """Return a fixed square, solid on the side away from ``normal``.

    Args:
        origin: Centre of the square, shape ``(3,)`` [m].
        normal: Outward normal, any length, shape ``(3,)``.
        half_width: Half the edge [m].
        name: Name for messages.
    """
    o, n = np.array([*origin], dtype=np.float64), np.array([*normal], dtype=np.float64)
    length = float(np.linalg.norm(n))
    if o.shape != (3,) or n.shape != (3,) or not length > 0.0 or not np.isfinite([*o, *n]).all():
        raise ValueError(f"rigid plane: expected a point and a direction, got {o} and {n}")
    if not (half_width > 0.0 and np.isfinite(half_width)):
        raise ValueError(f"half_width: expected a positive length, got {half_width} m")
    n /= length
    a = np.cross(n, np.eye(3)[np.argmin(np.abs(n))])
    a /= np.linalg.norm(a)
    b = np.cross(n, a)
    corners = o + half_width * np.array([-a - b, a - b, a + b, b - a])
    return Surface(
        name,
        np.arange(-4, 0, dtype=np.int64),
        corners,
        np.array([[0, 1, 2, 3]], dtype=np.int32),
        np.full(4, np.inf),
        np.full(4, -1, dtype=np.int32),
        np.full(1, np.inf),
    )
