# SPDX-License-Identifier: LGPL-3.0-or-later
"""From a scene to everything that a run steps: mesh, kernels, mass, loads, pairs, supports."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem, la

from forms.connections import Connections
from forms.elasticity import ENERGIES, RESIDUALS, Elastic, exact, full
from forms.inertia import lumped_mass
from forms.kernel import CellIntegral, CellKernel
from forms.loads import DeadLoad, DriveTorque, MassDamping
from forms.stability import assembled_frequency, cell_frequency, stable_step
from meshes.domain import Domain
from workflow.attachments import Supports, attach, dead_load, nodes_of, supports
from workflow.clock import Clock
from workflow.geometry import domain_of
from workflow.scene import Scene
from workflow.sections import Body
from workflow.stepping import State

if TYPE_CHECKING:
    from contact import ContactPair

Array = npt.NDArray[np.float64]


@dataclass
class Model:
    """Everything that a run steps.

    Attributes:
        scene: The scene it was made from.
        domain: The distributed mesh.
        state: Displacement, velocity, acceleration.
        mass: Lumped mass of every local dof [kg].
        materials: Material by body name.
        internal: Kernel of minus the internal force.
        loads: Callables of the step, in order.
        pairs: Contact pairs by name.
        dt, dt_bound: Step and its bound [s].
    """

    scene: Scene
    domain: Domain
    state: State
    mass: la.Vector
    materials: dict[str, Elastic]
    dead: DeadLoad
    dt_bound: float
    dt: float
    internal: "InternalForce"
    strain_energy: CellIntegral
    supports: Supports
    pairs: dict[str, "ContactPair"] = field(default_factory=dict)
    connections: Connections | None = None
    damping: MassDamping | None = None
    drive: DriveTorque | None = None
    placement: Any = None

    @property
    def loads(self) -> list[Callable[[State, la.Vector], None]]:
        """The loads of a step; what the scene does not name is not there."""
        optional = [self.damping, self.drive, self.connections, *self.pairs.values()]
        return [x.add for x in (self.internal, self.dead, *optional) if x is not None]

    def phase_of(self, add: Callable[..., Any]) -> str:
        """Phase of the run that a load's time counts to."""
        if add == self.internal.add:
            return "internal_force"
        return "contact" if any(add == pair.add for pair in self.pairs.values()) else "update"

    def body_dofs(self, body: str) -> npt.NDArray[np.int32]:
        """Return the owned dof blocks of a body."""
        return nodes_of(self.domain, self.scene.bodies[body].regions)


class InternalForce:
    """Minus the internal force as a load; counts its work only where a material damps."""

    def __init__(self, form: Any, damped: bool) -> None:
        self.kernel = CellKernel(form)
        self.damped = damped
        self.work = 0.0
        self._last: tuple[Array, Array] | None = None

    def add(self, state: State, force: la.Vector) -> None:
        """Add this rank's cells; the work is that of the elastic and viscous stress together."""
        self.kernel.add(force)
        if self.damped:
            u, f = state.u.x.array.copy(), force.array.copy()
            if self._last is not None:
                u0, f0 = self._last
                self.work -= float((f0 + f) @ (u - u0)) / 2
            self._last = (u, f)


def build(
    scene: Scene,
    comm: MPI.Comm = MPI.COMM_WORLD,
    log: Callable[[str], Any] = lambda line: None,
    clock: Clock | None = None,
) -> Model:
    """Return the model of a scene; every check of the scene against its mesh is made here.

    Raises:
        SceneError: naming the key that does not fit.
    """
    clock = clock or Clock()
    with clock.phase("mesh"):
        domain, placement = domain_of(scene, comm, log)
    with clock.phase("compile"):
        model = compiled(scene, domain, placement)
        attach(model)
    log(
        f"step {model.dt * 1e9:.1f} ns, {model.dt / model.dt_bound:.2f} of the bound "
        f"{model.dt_bound * 1e9:.1f} ns"
    )
    return model


def compiled(scene: Scene, domain: Domain, placement: Any) -> Model:
    """Return the model with its forms compiled and its step chosen, nothing attached yet."""
    V, comm = domain.V, domain.msh.comm
    state = State(fem.Function(V), fem.Function(V), la.vector(V.dofmap.index_map, 3))
    state.a.array[:] = 0.0
    materials = {name: material(body) for name, body in scene.bodies.items()}
    dx = full(domain.msh, domain.regions)
    densities = {body.tags: materials[name].rho for name, body in scene.bodies.items()}
    mass = la.vector(V.dofmap.index_map, 3)
    mass.array[:] = lumped_mass(V, dx, densities)
    w = ufl.TestFunction(V)
    damped = any(b.stiffness_damping for b in scene.bodies.values())
    bound = step_bound(scene, domain, materials, mass.array)
    # outputs fall on steps
    per_output = np.ceil(scene.time.output_interval / (scene.time.safety * bound))
    return Model(
        scene=scene,
        domain=domain,
        state=state,
        mass=mass,
        materials=materials,
        dead=DeadLoad(comm, dead_load(scene, domain)),
        dt_bound=bound,
        dt=float(scene.time.output_interval / per_output),
        internal=InternalForce(-residual(scene, materials, dx, state.u, w, state.v), damped),
        strain_energy=CellIntegral(strain_energy(scene, materials, dx, state.u)),
        supports=supports(scene.supports, scene, domain),
        placement=placement,
    )


def residual(
    scene: Scene, materials: dict[str, Elastic], dx: Any, u: Any, w: Any, v: Any = None
) -> Any:
    """Return the form of the internal virtual work of all bodies."""
    return sum(
        RESIDUALS[body.kinematics](u, w, materials[name], v if body.stiffness_damping else None)
        * dx(body.tags)
        for name, body in scene.bodies.items()
    )


def strain_energy(scene: Scene, materials: dict[str, Elastic], dx: Any, u: Any) -> Any:
    """Return the form of the strain energy of all bodies."""
    return sum(
        ENERGIES[body.kinematics](u, materials[name]) * dx(body.tags)
        for name, body in scene.bodies.items()
    )


def step_bound(scene: Scene, domain: Domain, materials: dict[str, Elastic], mass: Array) -> float:
    """Return the largest stable step [s]: of the cells, or of the assembled system with contact.

    A contact spring is ``penalty * m_eff / dt²``, so the pairs of a scene add at most the sum of
    their penalties to ``(ω dt)²``; the cell bound has that much in hand.
    """
    dx = full(domain.msh, domain.regions)
    bodies = scene.bodies.values()
    damping = max(b.stiffness_damping for b in bodies), max(b.mass_damping for b in bodies)

    def stiffness(u: Any, w: Any) -> Any:
        return residual(scene, materials, dx, u, w)

    if scene.time.bound == "assembled":
        frequency, converged = assembled_frequency(domain.V, stiffness, mass)
        springs = sum(contact.penalty for contact in scene.contacts.values())
        if converged and springs < 4 * scene.time.safety**2:
            share = np.sqrt(1 - springs / (2 * scene.time.safety) ** 2)
            return float(share * stable_step(frequency, *damping))
    ones = ufl.as_vector([1.0, 1.0, 1.0])

    def inertia(w: Any) -> Any:
        dm = exact(domain.msh, domain.regions)
        return sum(
            materials[name].rho * ufl.inner(ones, w) * dm(body.tags)
            for name, body in scene.bodies.items()
        )

    return stable_step(cell_frequency(domain.V, stiffness, inertia), *damping)


def material(body: Body) -> Elastic:
    """Material of a body, with its stiffness-proportional damping."""
    m = body.material
    return Elastic(m.youngs_modulus, m.poisson_ratio, m.density, body.stiffness_damping)
