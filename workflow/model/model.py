# SPDX-License-Identifier: LGPL-3.0-or-later
"""From a scene to everything that a run steps: mesh, kernels, mass, loads, pairs, supports."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem, la

from forms.elements import Law
from forms.kernel import CellIntegral, CellKernel
from forms.loads import DeadLoad, DriveTorque, MassDamping
from forms.springs.connections import Connections
from meshes.domain import Domain
from workflow.model.bodies import Bodies, step_bound
from workflow.model.geometry import domain_of
from workflow.model.supports import Supports, attach, dead_load, supports
from workflow.model.track import connections, end_supports
from workflow.scene.scene import Scene
from workflow.simulation.progress import Clock
from workflow.simulation.stepping import State

if TYPE_CHECKING:
    from contact import ContactPair
    from contact.friction import Law as FrictionLaw
    from workflow.simulation.prescribed import Hold
    from workflow.simulation.sampling import Sampling

Array = npt.NDArray[np.float64]


@dataclass
class Model:
    """Everything that a run steps.

    Attributes:
        scene: The scene it was made from.
        domain: The distributed mesh.
        state: Displacement, velocity, acceleration.
        mass: Lumped mass of every local dof [kg].
        bodies: Materials, laws and forms of the bodies.
        internal: Kernel of minus the internal force.
        viscosity: Bulk viscosity, if a body has it.
        strain_energy, hourglass_energy: Their integrals [J].
        loads: Callables of the step, in order.
        pairs: Contact pairs by name.
        dt, dt_bound: Step and its bound [s].
        own_laws: Laws that are not the scene's: the name of each by body or contact.
    """

    scene: Scene
    domain: Domain
    state: State
    mass: la.Vector
    bodies: Bodies
    dead: DeadLoad
    dt_bound: float
    dt: float
    internal: "InternalForce"
    strain_energy: CellIntegral
    supports: Supports
    hourglass_energy: CellIntegral | None = None
    viscosity: "InternalForce | None" = None
    pairs: dict[str, "ContactPair"] = field(default_factory=dict)
    connections: Connections | None = None
    damping: MassDamping | None = None
    drive: DriveTorque | None = None
    drives: "Hold | None" = None
    sampling: "Sampling | None" = None
    placement: Any = None
    own_laws: dict[str, str] = field(default_factory=dict)

    @property
    def loads(self) -> list[Callable[[State, la.Vector], None]]:
        """The loads of a step beside the dead ones; what the scene does not name is not there."""
        pairs = (pair for pair in self.pairs.values() if not pair.last)
        named = [self.viscosity, self.damping, self.drive, self.connections, *pairs]
        return [x.add for x in (self.internal, *named) if x is not None]

    @property
    def last(self) -> list[Callable[[State, la.Vector], None]]:
        """The loads that need the sum of all others: constraints of contact, supports before them.

        What supports hold must not be foreseen to move.
        """
        pairs = [pair.add for pair in self.pairs.values() if pair.last]
        return [lambda state, force: self.supports(force), *pairs] if pairs else []

    def phase_of(self, add: Callable[..., Any]) -> str:
        """Phase of the run that a load's time counts to."""
        if add == self.internal.add or (self.viscosity and add == self.viscosity.add):
            return "internal_force"
        return "contact" if any(add == pair.add for pair in self.pairs.values()) else "update"


class InternalForce:
    """Minus the internal force as a load; counts its work only where it dissipates.

    Args:
        form: Minus the virtual work.
        space: Space of the displacement.
        damped: Whether its work is counted [J].
        precision: Type that is computed with, ``float64`` or ``float32``.
    """

    def __init__(self, form: Any, space: Any, damped: bool, precision: str) -> None:
        self.kernel = CellKernel(form, precision)
        self.work = 0.0
        index_map = space.dofmap.index_map
        self._forces = [la.vector(index_map, 3) for _ in range(2)] if damped else []  # now, before
        self._t: float | None = None

    @property
    def damped(self) -> bool:
        """Whether the work is counted."""
        return bool(self._forces)

    def add(self, state: State, force: la.Vector) -> None:
        """Add this rank's cells; the work is that of the elastic and viscous stress together."""
        if not self._forces:
            self.kernel.add(force)
            return
        self._forces.reverse()
        now, before = self._forces
        now.array[:] = 0.0
        self.kernel.add(now)
        force.array[:] += now.array
        if self._t is not None:
            v = state.v.x.array  # what the nodes moved with since then
            self.work -= (state.t - self._t) / 2 * float(now.array @ v + before.array @ v)
        self._t = state.t


def build(
    scene: Scene,
    comm: MPI.Comm = MPI.COMM_WORLD,
    log: Callable[[str], Any] = lambda line: None,
    clock: Clock | None = None,
    laws: Mapping[str, Law] | None = None,
    friction: "Mapping[str, FrictionLaw] | None" = None,
) -> Model:
    """Return the model of a scene; every check of the scene against its mesh is made here.

    Args:
        scene: The scene.
        comm: Ranks that share it.
        log: Called with lines for the log.
        clock: Collects the time of meshing and compiling.
        laws: Material laws of your own by body name, in place of the scene's.
        friction: Friction laws of your own by contact name, in place of the scene's.

    Raises:
        SceneError: naming the key that does not fit.
    """
    clock = clock or Clock()
    with clock.phase("mesh"):
        domain, placement = domain_of(scene, comm, log)
    with clock.phase("compile"):
        model = compiled(Bodies(scene, domain, laws), placement, log)
        attach(model, friction)
    model.own_laws = {
        name: name_of(law) for name, law in {**(laws or {}), **(friction or {})}.items()
    }
    for line in model.bodies.doubts():
        log(line)
    if reason := model.internal.kernel.engine.reason:
        log(f"internal force assembled by DOLFINx, several times slower: {reason}")
    log(
        f"step {model.dt * 1e9:.1f} ns, {model.dt / model.dt_bound:.2f} of the bound "
        f"{model.dt_bound * 1e9:.1f} ns"
    )
    return model


def name_of(law: Any) -> str:
    """Return module and name of a law that was given from Python."""
    law = getattr(law, "residual", law)
    named = law if hasattr(law, "__qualname__") else type(law)
    return f"{named.__module__}.{named.__qualname__}"


def compiled(bodies: Bodies, placement: Any, log: Callable[[str], Any]) -> Model:
    """Return the model with its forms compiled and its step chosen, nothing attached yet."""
    scene, domain = bodies.scene, bodies.domain
    V, comm, precision = domain.V, domain.msh.comm, scene.time.precision
    state = State(fem.Function(V), fem.Function(V), la.vector(V.dofmap.index_map, 3))
    state.a.array[:] = 0.0
    mass = la.vector(V.dofmap.index_map, 3)
    mass.array[:] = bodies.lumped_mass()
    u, v, w = state.u, state.v, ufl.TestFunction(V)
    damped = any(b.stiffness_damping for b in scene.bodies.values())
    hourglass, viscous = bodies.hourglass_energy(u), bodies.viscous_work(u, v, w)
    links = connections(scene, domain)
    held = [*scene.supports, *end_supports(scene), *(d.support for d in scene.driven.values())]
    bound = step_bound(bodies, mass.array, links, log)
    # outputs fall on steps
    per_output = np.ceil(scene.time.output_interval / (scene.time.safety * bound))
    dt = float(scene.time.output_interval / per_output)
    if links is not None:
        links.dt = dt
    return Model(
        scene=scene,
        domain=domain,
        state=state,
        mass=mass,
        bodies=bodies,
        dead=DeadLoad(comm, dead_load(scene, domain)),
        dt_bound=bound,
        dt=dt,
        internal=InternalForce(-bodies.internal_work(u, w, v), V, damped, precision),
        strain_energy=CellIntegral(bodies.strain_energy(u)),
        hourglass_energy=CellIntegral(hourglass) if hourglass is not None else None,
        viscosity=InternalForce(-viscous, V, True, precision) if viscous is not None else None,
        supports=supports(held, scene, domain),
        connections=links,
        placement=placement,
    )
