# SPDX-License-Identifier: LGPL-3.0-or-later
"""Critical time step, penalty and damping from the eigenvalues of the current state.

Central difference with damping lagged by half a step is stable while ``dt²/4 K + dt/2 C < M``.
The largest eigenvalue of the left side over M is the *demand* of the model on the 1 that there is.
K and C are those of bodies, connections and contact together, with a spring at every node that
can touch soon. The step of a run rests on bounds of the parts instead, which may add up to more.
Springs at the end of the step, and constraints, ask for nothing: they are stable at any stiffness.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
import scipy.sparse
import ufl
from dolfinx import fem, la
from scipy.optimize import brentq

from contact.options import IMPLICIT
from contact.springs import Springs, springs
from forms.kernel import CellKernel
from forms.springs.step_bound import NONE, as_springs, attached, joined
from forms.time_step import largest_eigenvalue
from meshes.arrays import Array
from workflow.model.bodies import Bodies
from workflow.model.contacts import contact_surfaces
from workflow.model.model import Model
from workflow.model.step import step_bound
from workflow.scene.settings import Contact

# of the frequency, upwards: what is asked is overstated by at most twice as much
TOLERANCE, ROUGH, LARGE = 2e-3, 5e-3, 100_000  # rough from so many dofs on
FACTORS = (1e-4, 1e4)  # within which a limit is looked for, over the present value


@dataclass(frozen=True)
class PassSprings:
    """One pass of a contact with springs.

    Attributes:
        name: Contact of the scene.
        springs: Its springs.
        penalty, damping: Factor and share of critical damping of the pass [-].
        tangential: Tangential over normal stiffness, 0 without friction [-].
        fixed: Whether the springs do not follow the step, as those of ``modulus-penalty``.
        implicit: Whether they act by the gap at the end of the step, and limit nothing.
    """

    name: str
    springs: Springs
    penalty: float
    damping: float
    tangential: float
    fixed: bool
    implicit: bool

    def stiffness(self, dt: float, penalty: float, damping: float) -> tuple[Array, Array]:
        """Return normal springs, dampers as springs in them, and tangential ones [N/m].

        Args:
            dt: Step [s].
            penalty: Times the scene's own [-].
            damping: Share of critical damping of the pass [-].
        """
        s, p = self.springs, penalty * self.penalty
        fixed = self.fixed
        k = p * s.foundation if fixed else p / dt**2 * s.mass
        dampers = 4 * damping / dt * np.sqrt(k * s.mass)  # 2/dt times 2 damping √(k m)
        return k + dampers, self.tangential * k


class Limits:
    """The operator ``K + 2/dt C + contact`` over M of a model in its present state.

    Args:
        model: The model, at rest for springs where its contact will be.

    Attributes:
        springs: Passes of each contact that have springs, by its name.
        passes: Those of them that limit the step.
    """

    def __init__(self, model: Model) -> None:
        self.model, V = model, model.domain.V
        u, w = model.state.u, ufl.TestFunction(V)
        self._q = fem.Function(V)
        self._elastic = CellKernel(ufl.derivative(model.bodies.internal_work(u, w), u, self._q))
        rest = fem.Function(V)
        work = model.bodies.damping_work(rest, w)
        self._viscous = CellKernel(ufl.derivative(work, rest, self._q)) if work else None
        self._out = la.vector(V.dofmap.index_map, 3)
        self._n = 3 * model.domain.owned
        large = 3 * len(model.domain.source.points) > LARGE
        self._tolerance = ROUGH if large else TOLERANCE
        self._scale = 1 / np.sqrt(model.mass.array[: self._n])
        self._attached = NONE, NONE
        if model.connections is not None:
            parts = model.connections.masses, model.connections.links
            self._attached = attached(model.connections.comm, *parts, model.mass.array)
        self.springs = {name: _passes(model, name) for name in model.pairs}
        self.passes = [t for some in self.springs.values() for t in some if not t.implicit]
        nodes = [t.springs.nodes.ravel() for t in self.passes]
        self._nodes = np.unique(np.concatenate([n[n >= 0] for n in nodes] or [np.zeros(0, int)]))
        self._local = model.domain.local_dofs(self._nodes)

    def demand(
        self, dt: float, *, penalty: float = 1.0, damping: float | None = None, contact: bool = True
    ) -> float:
        """Return what the model asks of the 1 that a stable step has; collective.

        Args:
            dt: Step [s].
            penalty: Times the penalties of the scene [-].
            damping: Share of critical contact damping, that of the scene if None [-].
            contact: Whether contacts are counted.
        """
        springs, dampers = self._attached
        lagged = as_springs(springs, dampers, dt)
        matrix = self._contact(dt, penalty, damping) if contact else None
        mass_damping = max(b.mass_damping for b in self.model.scene.bodies.values())

        def apply(q: Array) -> Array:
            return self._apply(q, dt, lagged.nodal, matrix) + 2 / dt * mass_damping * q

        value, _ = largest_eigenvalue(self.model.domain.V, apply, tolerance=self._tolerance)
        return dt**2 / 4 * joined(value, lagged, held=True)

    def _apply(self, q: Array, dt: float, nodal: Array, matrix: Any) -> Array:
        """Return the scaled operator times ``q`` without what supports hold."""
        n, x, out = self._n, self._q.x, self._out
        x.array[:n] = self._scale * q
        self.model.supports(x)
        x.scatter_forward()
        out.array[:] = 0.0
        if self._viscous is not None:
            self._viscous.add(out)
            out.array[:] *= 2 / dt
        self._elastic.add(out)
        out.scatter_reverse(la.InsertMode.add)
        if len(nodal):
            out.array[:n] += nodal[:n] * x.array[:n]
        if matrix is not None:
            self._touch(matrix, x.array, out.array)
        self.model.supports(out)
        return np.asarray(self._scale * out.array[:n])

    def _touch(self, matrix: Any, x: npt.NDArray[Any], out: npt.NDArray[Any]) -> None:
        """Add the contact springs; every rank knows the few nodes they join."""
        mine = self._local >= 0
        every = np.zeros((len(self._nodes), 3))
        every[mine] = x.reshape(-1, 3)[self._local[mine]]
        self.model.domain.msh.comm.Allreduce(MPI.IN_PLACE, every)
        force = (matrix @ every.ravel()).reshape(-1, 3)
        out.reshape(-1, 3)[self._local[mine]] += force[mine]

    def _contact(self, dt: float, penalty: float, damping: float | None) -> Any:
        """Return the stiffness of all contact springs on their nodes, dampers as springs."""
        size = 3 * len(self._nodes)
        total = scipy.sparse.csr_matrix((size, size))
        for touch in self.passes:
            share = touch.damping if damping is None else damping
            row, column, blocks = touch.springs.blocks(*touch.stiffness(dt, penalty, share))
            row, column = (np.searchsorted(self._nodes, a) for a in (row, column))
            i = 3 * row[:, None, None] + np.arange(3)[:, None]
            j = 3 * column[:, None, None] + np.arange(3)
            i, j = (np.broadcast_to(a, blocks.shape).ravel() for a in (i, j))
            total += scipy.sparse.coo_matrix((blocks.ravel(), (i, j)), (size, size)).tocsr()
        return total if self.passes else None

    def step(self, contact: bool = True) -> float:
        """Return the largest stable step, with contact springs that follow it or without [s]."""
        dt = self.model.dt
        alone = self.demand(dt, contact=False)
        left = max(1 - self.share(dt), 0.1) if contact else 1.0
        bracket = (left / alone) ** 0.5, (1 / alone) ** 0.5
        return dt * _root(lambda f: self.demand(f * dt, contact=contact), bracket)

    def penalty(self, dt: float) -> float:
        """Return the factor on all penalties that is the largest stable one at a step [-]."""
        alone, share = self.demand(dt, contact=False), self.share(dt)
        if alone >= 1 or not share:
            return 0.0 if share else np.inf
        return _root(lambda f: self.demand(dt, penalty=f), ((1 - alone) / share, 1 / share))

    def damping(self, dt: float) -> float:
        """Return the largest stable share of critical contact damping, 0 if none is [-]."""
        if not self.passes or self.demand(dt, damping=0.0) >= 1:
            return 0.0 if self.passes else np.inf
        return _root(lambda z: self.demand(dt, damping=z), (0.25, 2.0))

    def share(self, dt: float) -> float:
        """Return what the contacts ask of the 1, bodies and connections aside [-]."""
        matrix = self._contact(dt, 1.0, None)
        if matrix is None:
            return 0.0
        n = self._n

        def apply(q: Array) -> Array:
            out: Array = np.zeros(n)
            scaled: Array = self._scale * q
            self._touch(matrix, scaled, out)
            return np.asarray(self._scale * out)

        value, _ = largest_eigenvalue(self.model.domain.V, apply, tolerance=self._tolerance)
        return dt**2 / 4 * value


def _passes(model: Model, name: str) -> list[PassSprings]:
    """Return the passes of a contact that have springs."""
    contact = model.scene.contacts[name]
    if contact.method == "lagrange":
        return []
    rough, fixed = contact.friction != 0.0, contact.method == "modulus-penalty"
    implicit = contact.method in IMPLICIT
    ends = contact_surfaces(model.bodies, as_modulus(contact), model.mass.array[::3])
    passes = []
    for side, beds in zip(model.pairs[name].passes, (ends, ends[::-1]), strict=False):
        found = springs(side, model.state, beds)
        tangential = side.options.tangential * rough
        o = side.options
        passes.append(PassSprings(name, found, o.penalty, o.damping, tangential, fixed, implicit))
    return passes


def as_modulus(contact: Contact) -> Contact:
    """Return the entry as one whose surfaces know the moduli behind them."""
    return contact.model_copy(update={"method": "modulus-penalty"})


def _root(demand: Callable[[float], float], bracket: tuple[float, float]) -> float:
    """Return where a growing function crosses 1, infinite or 0 beyond :data:`FACTORS`."""
    low, high = 0.98 * bracket[0], 1.02 * bracket[1]
    while demand(high) < 1:
        low, high = high, 2 * high
        if high > FACTORS[1]:
            return np.inf
    while demand(low) >= 1:
        low, high = low / 2, low
        if low < FACTORS[0]:
            return 0.0
    return float(brentq(lambda f: demand(f) - 1, low, high, rtol=2e-3, xtol=1e-9))


def critical_penalty(model: Model, limits: Limits) -> float:
    """Return the factor on all penalties above which a run at the scene's safety blows up [-].

    While springs in proportion to m/dt² leave room, the step gives way to them and any safety up
    to 1 is stable. Beyond that the step is that of the stiffest cell.
    """
    scene = model.scene
    following = {k: c for k, c in scene.contacts.items() if c.method == "penalty"}
    if not following:
        return np.inf
    if scene.time.bound == "cell" or any(b.bulk_viscosity for b in scene.bodies.values()):
        return limits.penalty(model.dt)

    def room(f: float) -> float:
        parts = [(f * c.penalty, c.damping) for c in following.values()]
        return 1 - sum(p / 4 + z * p**0.5 for p, z in parts)

    high = 4 / sum(c.penalty for c in following.values())
    last = float(brentq(room, 0.0, high * (1 + 1e-9)))
    keys = {f"contacts.{k}.penalty": last * c.penalty * 1.001 for k, c in following.items()}
    bodies = Bodies(scene.with_(**keys), model.domain, model.bodies.laws)
    bound = step_bound(bodies, model.mass.array, model.connections, lambda line: None)
    return max(last, limits.penalty(scene.time.safety * bound))
