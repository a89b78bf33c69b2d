# SPDX-License-Identifier: LGPL-3.0-or-later
"""Model of a scene: mesh, mass, items that act in a step, supports, and the step."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

import ufl
from dolfinx import fem, la

from forms.elements import Law
from forms.simd.native import host_of
from forms.springs.connections import Connections
from meshes.domain import Domain
from meshes.hexmesh import HexMesh
from workflow.model.advice import doubts
from workflow.model.bodies import Bodies, InternalForce
from workflow.model.checks import check, check_room, check_step
from workflow.model.geometry import domain_of, on_root
from workflow.model.loads import (
    carried_mass,
    dead_load,
    drive_torque,
    mass_damping,
    timed_loads,
    travelling_loads,
)
from workflow.model.state import Item, State
from workflow.model.step import first_step, step_bound
from workflow.model.supports import Supports, supports
from workflow.model.track import connections, end_supports
from workflow.scene import Scene, SceneError
from workflow.scene.mesh import Foreign

if TYPE_CHECKING:
    from contact import ContactPair
    from contact.friction import Law as FrictionLaw
    from forms.memory import MemoryLaw
    from workflow.model.mass_scaling import AddedMass

Log = Callable[[str], Any]


@dataclass
class Model:
    """Everything that a run steps.

    Attributes:
        scene: The scene it was made from.
        domain: The distributed mesh.
        state: Displacement, velocity, acceleration.
        mass: Lumped mass of every local dof [kg].
        bodies: Materials, laws and forms of the bodies.
        items: What acts in a step, in order, the internal force first
            (:class:`workflow.model.state.Item`); what the scene does not name is not there.
        supports: Held directions.
        hold: What imposes them and prescribed motion on an acceleration; the supports, or more.
        dt, dt_bound: Step and its bound [s].
        span: Time between two looks at the shape of cells, which the step follows [s]; None where
            the step stays.
        placement: Where wheel and rail stand, if the scene has them.
        added_mass: What mass scaling has added, if the scene asks for it.
        doubts: What is likely to go wrong with its settings, in words.
        left: Displacement without loads that earlier passes have left, if there were any.
        own_laws: Laws and items that are not the scene's: the name of each by body, contact or
            place in the list.
    """

    scene: Scene
    domain: Domain
    state: State
    mass: la.Vector
    bodies: Bodies
    items: list[Any]
    supports: Supports
    hold: Callable[[la.Vector], None]
    dt: float
    dt_bound: float
    span: float | None = None
    placement: Any = None
    added_mass: "AddedMass | None" = None
    doubts: list[str] = field(default_factory=list)
    left: fem.Function | None = None
    own_laws: dict[str, str] = field(default_factory=dict)

    @property
    def internal(self) -> InternalForce | None:
        """The internal force of the cells without memory, None if all have one."""
        return next((item for item in self.items if isinstance(item, InternalForce)), None)

    @property
    def connections(self) -> Connections | None:
        """Springs, dampers and point masses, if there are such."""
        return next((item for item in self.items if isinstance(item, Connections)), None)

    @property
    def pairs(self) -> dict[str, "ContactPair"]:
        """Contact pairs by name."""
        return {item.name: item for item in self.items if hasattr(item, "footprint")}


def build(
    scene: Scene,
    comm: MPI.Comm = MPI.COMM_WORLD,
    log: Log = lambda line: None,
    phase: Callable[[str], AbstractContextManager[Any]] = nullcontext,
    laws: "Mapping[str, Law | MemoryLaw] | None" = None,
    friction: "Mapping[str, FrictionLaw] | None" = None,
    items: Iterable[Callable[[Model], Item]] = (),
    mesh: Callable[..., Any] | None = None,
    out: Path | None = None,
) -> Model:
    """Return the model of a scene; every check of the scene against its mesh is made here.

    Args:
        scene: The scene.
        comm: Ranks that share it.
        log: Called with lines for the log.
        phase: Called with ``mesh`` and ``compile``: a context that takes their time.
        laws: Material laws of your own by body name, in place of the scene's; those with a memory
            (:class:`forms.memory.MemoryLaw`) too.
        friction: Friction laws of your own by contact name, in place of the scene's.
        items: What acts besides, of your own: each is called with the model and returns an item.
        mesh: Builds a model of gmsh from ``mesh.parameters``, called on one rank.
        out: Folder whose disk is to have room for the results.

    Raises:
        SceneError: naming the key that does not fit.
        CompilerError: if this machine cannot compile forms; before the mesh is made.
    """
    host_of(comm)
    doubtful = (
        [] if (read := isinstance(scene.mesh, Foreign)) else told(scene, None, comm, log, out)
    )
    with phase("mesh"):
        domain, placement = domain_of(scene, comm, log, mesh)
    if read:
        doubtful = told(scene, domain.source, comm, log, out)
    with phase("compile"):
        model = compiled(Bodies(scene, domain, laws), placement, log)
        model.doubts += doubtful
        check_step(scene, model.dt)
        attach(model, friction, log)
        items = tuple(items)
        for make in items:
            model.items.append(make(model))
    model.own_laws = names_of_own(laws, friction, items)
    if model.internal is not None and (reason := model.internal.kernel.engine.reason):
        log(f"internal force assembled by DOLFINx, several times slower: {reason}")
    log(
        f"step {model.dt * 1e9:.1f} ns, {model.dt / model.dt_bound:.2f} of the bound "
        f"{model.dt_bound * 1e9:.1f} ns"
    )
    return model


def told(
    scene: Scene, mesh: HexMesh | None, comm: MPI.Comm, log: Log, out: Path | None
) -> list[str]:
    """Check a scene, log what it costs and what is doubtful, and return the latter; collective.

    Raises:
        SceneError: on all ranks.
    """

    def work() -> list[str]:
        cost = check(scene, mesh)
        log(f"cost: {cost}")
        room = check_room(scene, cost, out) if out is not None else ()
        return [*doubts(scene, cost), *room]

    found: list[str] = comm.bcast(on_root(comm, work))
    for line in found:
        log(f"doubt: {line}")
    return found


def names_of_own(
    laws: Mapping[str, Any] | None, friction: Mapping[str, Any] | None, items: Iterable[Any]
) -> dict[str, str]:
    """Return the names of laws and items that were given from Python, see ``Model.own_laws``."""
    own = {**(laws or {}), **(friction or {})}
    own |= {f"item {k}": make for k, make in enumerate(items, 1)}
    return {name: name_of(law) for name, law in own.items()}


def name_of(law: Any) -> str:
    """Return module and name of a law or item that was given from Python."""
    law = getattr(law, "residual", getattr(law, "update", law))
    named = law if hasattr(law, "__qualname__") else type(law)
    return f"{named.__module__}.{named.__qualname__}"


def compiled(bodies: Bodies, placement: Any, log: Log) -> Model:
    """Return the model with its forms compiled and its step chosen; contact is attached later."""
    scene, domain = bodies.scene, bodies.domain
    V = domain.V
    state = State(fem.Function(V), fem.Function(V), la.vector(V.dofmap.index_map, 3))
    state.a.array[:] = 0.0
    links, added = connections(scene, domain), None
    if scene.mass_scaling is not None:
        from workflow.model.mass_scaling import scale_masses

        added = scale_masses(bodies, scene.mass_scaling, links, log)
    mass = la.vector(V.dofmap.index_map, 3)
    mass.array[:] = bodies.lumped_mass()
    bound = step_bound(bodies, mass.array, links, log) if added is None else added.step
    dt, span = first_step(bodies, bound)
    held = supports(
        [*scene.supports, *end_supports(scene), *(d.support for d in scene.driven.values())],
        scene,
        domain,
    )
    items: list[Any] = [*internal_forces(bodies, state, log)]
    if scene.gravity is not None or any(load.resting for load in scene.loads):
        items.insert(1, dead_load(scene, domain))
    items += timed_loads(scene, domain)
    items += travelling_loads(scene, domain, dt)
    if any(b.mass_damping for b in scene.bodies.values()):
        items.append(mass_damping(bodies, mass.array, dt))
    if scene.rolling is not None and scene.rolling.traction_coefficient > 0:
        items.append(drive_torque(scene, domain, mass.array))
    if added is not None and scene.rolling is not None and scene.rolling.speed > 0:
        items.append(carried_mass(bodies, mass.array))
    if links is not None:
        links.dt = dt
        items.append(links)
    model = Model(scene, domain, state, mass, bodies, items, held, held, dt, bound, span, placement)
    model.added_mass = added
    return model


def internal_forces(bodies: Bodies, state: State, log: Log) -> Iterator[Any]:
    """Yield the internal force of the bodies, that of each with a memory, and bulk viscosity."""
    u, v, w = state.u, state.v, ufl.TestFunction(bodies.domain.V)
    V, precision = bodies.domain.V, bodies.scene.time.precision
    if bodies.without_memory:
        yield elastic_force(bodies, state)
    if bodies.memory_laws:
        from workflow.model.memory import MemoryForce

        for name in bodies.memory_laws:
            force = MemoryForce(bodies, name, u, precision)
            log(force.size)
            yield force
    if (viscous := bodies.viscous_work(u, v, w)) is not None:
        yield InternalForce(-viscous, V, precision, damped=True, stored={})


def elastic_force(bodies: Bodies, state: State) -> InternalForce:
    """Return the internal force of the cells without memory."""
    u, v, w = state.u, state.v, ufl.TestFunction(bodies.domain.V)
    V, parts, precision = bodies.domain.V, bodies.without_memory, bodies.scene.time.precision
    stored = {"internal": bodies.strain_energy(u)}
    if (control := bodies.hourglass_energy(u)) is not None:
        stored["hourglass"] = control
    damped = any(b.stiffness_damping for b in bodies.scene.bodies.values())
    single = precision == "float32"
    frames = bodies.turning_frames() if single else None
    seen = (u, v) if frames is None else (frames.relative, frames.velocity)
    return InternalForce(
        -bodies.internal_work(seen[0], w, seen[1], parts=parts),
        V,
        precision,
        damped=damped,
        stored=stored,
        frames=frames,
        at_rest=-bodies.internal_work(u, w) if single else None,
    )


def attach(
    model: Model,
    friction: "Mapping[str, FrictionLaw] | None" = None,
    log: Log = lambda line: None,
) -> None:
    """Attach the contact pairs that the scene names; ``friction`` laws by pair in place of its own.

    The contact package is imported here, for scenes that have contact.

    Raises:
        SceneError: if surfaces overlap at the start, or cannot meet.
    """
    contacts, own = model.scene.contacts, dict(friction or {})
    if unknown := sorted(own.keys() - contacts):
        raise SceneError(f"friction = {unknown}: expected contacts of {list(contacts)}")
    if not contacts:
        return
    from workflow.model.contacts import checked_pair

    for name in contacts:
        law = own.get(name)
        pair, doubtful = checked_pair(model.bodies, name, model.mass.array, model.dt, law)
        model.items.append(pair)
        model.doubts += doubtful
        for line in doubtful:
            log(f"doubt: {line}")
