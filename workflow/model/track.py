# SPDX-License-Identifier: LGPL-3.0-or-later
"""Track and suspension of a scene: springs, dampers, dashpots and point masses."""

import numpy as np

from forms.springs.connections import Connections
from forms.springs.dashpots import absorbing, dashpots
from forms.springs.point_masses import PointMasses
from forms.springs.springs import Springs, mean, node_to_facet, spread
from meshes.arrays import Array, Index
from meshes.domain import Domain
from meshes.formats.conform import faces_on
from meshes.quads import area_shares
from meshes.wheel_rail import seats, sleepers
from workflow.model.regions import facets, owners, surface_nodes
from workflow.scene.scene import Scene, SceneError
from workflow.scene.settings import Support
from workflow.scene.track import Absorbing, Track

Seat = tuple[Index, Array]

UP = np.array([0.0, 0.0, 1.0])
ANCHOR = 1e-9  # mass of a point at a given speed [kg]: it does not matter, but is divided by


def connections(scene: Scene, domain: Domain) -> Connections | None:
    """Return springs, mass on its suspension, rail on pads, sleepers and ballast; or nothing.

    Their step is set when it is known: the springs have a part in it.

    Raises:
        SceneError: naming the key of the track that does not fit its mesh.
    """
    track, vehicle = scene.track, scene.vehicle
    if not (vehicle or track or scene.absorbing or scene.springs):
        return None
    links: list[Springs] = []
    names: list[str] = []
    under: list[Seat] = []
    if track is not None and track.sleeper_top is None:
        under = seats_of_points(track, domain)
    masses = point_masses(scene, len(under))
    if track is not None and track.sleeper_top is None:
        links.append(pads_on_points(track, domain, under))
        names.append("pads")
    elif track is not None:
        links += [pads_on_solids(track, domain), ballast(track, domain)]
        names += ["pads", "ballast"]
    boundaries = scene.absorbing
    if track is not None and track.ends == "absorbing":
        boundaries = [*boundaries, Absorbing(surface=track.end_surface, waves="bar")]
    links += [absorbing_surface(scene, domain, entry) for entry in boundaries]
    names += [f"absorbing_{entry.surface}" for entry in boundaries]
    first = len(masses.mass) - len(scene.springs)
    for point, spring in enumerate(scene.springs, first):
        stiffness, damping = np.array(spring.stiffness), np.array(spring.damping)
        links.append(mean_of_surface(domain, spring.surface, stiffness, damping, point))
        names.append(f"spring_{spring.surface}")
    if vehicle is not None:
        k, c = UP * vehicle.suspension_stiffness, UP * vehicle.suspension_damping
        links.append(mean_of_surface(domain, vehicle.journal, k, c, first - 1))
        names.append("suspension")
    return Connections(domain.msh.comm, masses, links, 0.0, names)


def end_supports(scene: Scene) -> list[Support]:
    """Return the supports of the rail's ends, if the track has them fixed."""
    track = scene.track
    if track is None or track.ends != "fixed":
        return []
    return [Support(surface=track.end_surface, directions=["x"])]


def point_masses(scene: Scene, seated: int) -> PointMasses:
    """Return sleepers that are point masses on their ballast, the sprung mass, ends of springs."""
    track = scene.track
    mass = np.full(seated, track.sleeper_mass if track and seated else 0.0)
    k = np.outer(np.full(seated, track.ballast_stiffness if track else 0.0), UP)
    c = np.outer(np.full(seated, track.ballast_damping if track else 0.0), UP)
    if scene.vehicle:
        mass = np.append(mass, scene.vehicle.sprung_mass)
        k, c = np.vstack([k, np.zeros(3)]), np.vstack([c, np.zeros(3)])
    gravity, ends = np.array(scene.gravity or (0.0, 0.0, 0.0)), np.zeros((len(scene.springs), 3))
    free = np.vstack([np.outer(np.ones(len(mass)), UP), ends])
    mass = np.append(mass, np.full(len(ends), ANCHOR))
    masses = PointMasses(mass, gravity, free, np.vstack([k, ends]), np.vstack([c, ends]))
    masses.v[len(mass) - len(ends) :] = [s.velocity for s in scene.springs] or ends
    return masses


def mean_of_surface(
    domain: Domain, surface: str, stiffness: Array, damping: Array, point: int
) -> Springs:
    """Return a spring and damper between the mean motion of a surface and a point mass."""
    nodes, share = area_shares(domain.source.points, facets(domain, surface))
    return mean(domain.msh.comm, domain.local_dofs(nodes), share, stiffness, damping, point)


def seat(track: Track, domain: Domain, centre: float) -> Seat:
    """Return nodes and shares of the rail's foot over the sleeper at x = ``centre`` [m]."""
    half = track.seat_length / 2
    try:
        quads = facets(domain, track.seat)
        return seats.shares(domain.source.points, quads, centre - half, centre + half)
    except ValueError as error:
        raise SceneError(f"track.seat_length = {track.seat_length}: {error}") from None


def middle(corners: Array) -> float:
    """Return the middle of a sleeper along the rail [m], from points of shape ``(q, 4, 3)``."""
    return float(corners[..., 0].min() + corners[..., 0].max()) / 2


def seats_of_points(track: Track, domain: Domain) -> list[Seat]:
    """Return the seats over sleepers that are point masses, from the middle of the rail."""
    assert track.sleeper_spacing is not None
    x = domain.source.points[surface_nodes(domain, track.seat), 0]
    places = sleepers.places(float(x.min()), float(x.max()), track.sleeper_spacing)
    return [seat(track, domain, float(centre)) for centre in places]


def pads_on_points(track: Track, domain: Domain, under: list[Seat]) -> Springs:
    """Return the pads as springs and dampers spread over each seat in proportion to area."""
    nodes, share = (np.concatenate(x) for x in zip(*under, strict=True))
    point = np.repeat(np.arange(len(under), dtype=np.int32), [len(nodes) for nodes, _ in under])
    k, c = np.outer(share, track.pad_stiffness), np.outer(share, track.pad_damping)
    return spread(domain.msh.comm, domain.local_dofs(nodes), k, c, point)


def pads_on_solids(track: Track, domain: Domain) -> Springs:
    """Return the pads as springs and dampers between foot and sleepers, in proportion to area.

    Each goes from a node of the foot to the point of the sleeper straight below it. Vertical forces
    therefore have no moment; shear forces have that of the pad's thickness.

    Raises:
        SceneError: if a sleeper has no rail over it.
    """
    assert track.sleeper_top is not None
    points, found = domain.source.points, []
    for top in seats.parts(facets(domain, track.sleeper_top)):
        nodes, share = seat(track, domain, middle(points[top]))
        try:
            facet, weights = seats.below(points, top, points[nodes])
        except ValueError as error:
            raise SceneError(f"track.sleeper_top = {track.sleeper_top!r}: {error}") from None
        found.append((nodes, share, facet, weights))
    nodes, share, facet, weights = (np.concatenate(x) for x in zip(*found, strict=True))
    return node_to_facet(
        domain.msh.comm,
        domain.local_dofs(nodes),
        (domain.local_dofs(facet), weights),
        np.outer(share, track.pad_stiffness),
        np.outer(share, track.pad_damping),
    )


def ballast(track: Track, domain: Domain) -> Springs:
    """Return the ballast as vertical springs and dampers over the underside of each sleeper."""
    assert track.sleeper_bottom is not None
    below = [
        area_shares(domain.source.points, part)
        for part in seats.parts(facets(domain, track.sleeper_bottom))
    ]
    nodes, share = (np.concatenate(x) for x in zip(*below, strict=True))
    k, c = (np.outer(share, UP * x) for x in (track.ballast_stiffness, track.ballast_damping))
    return spread(domain.msh.comm, domain.local_dofs(nodes), k, c)


def absorbing_surface(scene: Scene, domain: Domain, entry: Absorbing) -> Springs:
    """Return the dashpots of an absorbing surface, of the materials behind it."""
    mesh, quads = domain.source, facets(domain, entry.surface)
    matrix = np.zeros((len(mesh.points), 3, 3))
    for body in scene.bodies.values():
        own = mesh.cells[np.isin(mesh.regions, mesh.tags(body.regions))]
        faces = faces_on(own, np.unique(quads))
        both = np.sort(np.vstack([faces, quads]), axis=1)
        _, number = np.unique(both, axis=0, return_inverse=True)
        mine = np.isin(number.ravel()[len(faces) :], number.ravel()[: len(faces)])
        constants = body.material.constants()
        material = getattr(constants, "isotropic", constants)
        matrix += absorbing(mesh.points, quads[mine], material, entry.waves)
    nodes = np.unique(quads)
    return dashpots(domain.msh.comm, domain.local_dofs(nodes), matrix[nodes])


def sleeper_bodies(scene: Scene, domain: Domain) -> set[str]:
    """Return the names of the bodies that are solid sleepers."""
    if scene.track is None or scene.track.sleeper_top is None:
        return set()
    mesh, on = domain.source, np.zeros(len(domain.source.points), dtype=bool)
    on[surface_nodes(domain, scene.track.sleeper_top)] = True
    regions, body_of = np.unique(mesh.regions[on[mesh.cells].any(axis=1)]), owners(scene)
    return {body_of[mesh.name(int(tag))] for tag in regions}
