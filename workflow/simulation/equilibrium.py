# SPDX-License-Identifier: LGPL-3.0-or-later
"""Static equilibrium with frictionless contact.

The bodies yield linearly, as at the undeformed shape, to the forces out of balance and to contact
springs that push and never pull (:mod:`workflow.simulation.pressing`). That step is repeated with
the true shape, normals and places of contact until the forces balance, each time a little way
beyond what is linear. The stiffness is factorised once; where steel flows and the steps get stuck,
once more with the stiffness that is left of it (:meth:`forms.material_points.Points.softening`).
"""

import numpy as np
from dolfinx import la
from scipy.optimize import brentq

from workflow.model import Model
from workflow.model.geometry import cell_size
from workflow.simulation.at_rest import AtRest, Log, Solve
from workflow.simulation.elastic import Elastic
from workflow.simulation.guards import GuardError
from workflow.simulation.pressing import Pushing, Surfaces
from workflow.simulation.secants import Secants

ROUGH = 1e-2  # tolerance before the last increment of a shift
ROUGH_LOAD = 1e-3  # tolerance before the last increment of the loads
SMALLEST = 1 / 64  # of the loads, in an increment that was halved
PATIENCE, STUCK = 5, 0.5  # iterations with one factor; of a residual, left by a step that is stuck
LEFT = 0.3  # of the work of the forces out of balance at the end of a search, at most


def equilibrium(problem: AtRest, log: Log, pushing: Pushing | None = None) -> Solve:
    """Return the static solve of a model at rest; its factor lasts from call to call.

    Args:
        problem: The model with its loads at rest.
        log: Called with a line per iteration.
        pushing: Direction in which contacts push; along their normals if None.
    """
    solver, tolerance = Solver(problem, pushing), problem.settings.tolerance
    loaded = False

    def solve(rough: bool) -> int:
        nonlocal loaded
        last = max(ROUGH, tolerance) if rough else tolerance
        if loaded:
            problem.remember()
            used = newton(problem, solver, last, log)
        else:
            used = load(problem, solver, last, log)
        loaded = True
        if not rough:
            check_all_seen(problem.model)
        return used

    return solve


def load(problem: AtRest, solver: "Solver", tolerance: float, log: Log) -> int:
    """Bring the dead loads up in increments; return the iterations used.

    Where steel yields, an increment that does not converge is halved and tried again from the last
    state at rest, and the history goes along. All but the last are solved roughly.

    Args:
        problem: The model with its loads at rest.
        solver: Of the linear bodies in contact.
        tolerance: Largest residual over the load, at the end [-].
        log: Called with lines of progress.

    Raises:
        GuardError: if it has not converged, in a :data:`SMALLEST` part of the loads.
    """
    u, share, used = problem.model.state.u.x.array, 0.0, 0
    part = 1.0 / problem.settings.increments
    while share < 1.0:
        reached = min(share + part, 1.0) if share + part < 1.0 - SMALLEST / 2 else 1.0
        before, force = u.copy(), solver.force.copy()
        problem.bear(reached)
        try:
            wanted = tolerance if reached == 1.0 else max(ROUGH_LOAD, tolerance)
            used += newton(problem, solver, wanted, log)
        except GuardError:
            part /= 2
            if not problem.remembers or part < SMALLEST:
                problem.bear(1.0)
                raise
            u[:], solver.force[:] = before, force
            solver.secants.forget()
            log(f"equilibrium: not converged; from {share:.3g} of the loads by {part:.3g} of them")
            continue
        share = reached
        if share < 1.0:
            log(f"equilibrium: {share:.3g} of the loads")
            problem.remember()
            solver.secants.forget()
    return used


def newton(problem: AtRest, solver: "Solver", tolerance: float, log: Log) -> int:
    """Solve for rest from the present displacement, in place; return the iterations used.

    Args:
        problem: The model with its loads at rest.
        solver: Of the linear bodies in contact.
        tolerance: Largest residual over the load [-].
        log: Called with a line per iteration.

    Raises:
        GuardError: if it has not converged.
    """
    model, settings, comm = problem.model, problem.settings, problem.model.domain.msh.comm
    n = 3 * model.domain.owned
    du = la.vector(model.domain.V.dofmap.index_map, 3)
    residual, size, since = problem.out_of_balance(), np.inf, 0
    for iteration in range(settings.max_iterations + 1):
        own, before = residual.array[:n], size
        # numpy, not PETSc, whose norms are remembered while the array changes beneath
        size = float(np.sqrt(comm.allreduce(own @ own))) / problem.load_size()
        active = sum(p.active for p in model.pairs.values())
        log(f"equilibrium {iteration}: residual {size:.2e}, {active} contact nodes")
        if size <= tolerance:
            return iteration
        if not np.isfinite(size):
            break
        since += 1
        if problem.softens and since > PATIENCE and size > STUCK * before:
            log(f"equilibrium {iteration}: stiffness of the steel that flows")
            solver.soften()
            since = 0
        solver.solve(residual, du)
        share = along(problem, residual, du)
        if share < 1.0:
            log(f"equilibrium {iteration}: {share:.3f} of the step taken")
        residual = problem.model.state.a
    raise GuardError(
        f"equilibrium: residual {size:.1e} of the load after {iteration} iterations, expected "
        f"{tolerance:.0e}; is every body held or in contact? Try another equilibrium.approach or "
        "more equilibrium.hold"
    )


class Solver:
    """Step to rest of linear elastic bodies between their contact springs.

    Attributes:
        force: Of every contact spring that there can be, as the last step found it [N].
    """

    def __init__(self, problem: AtRest, pushing: Pushing | None = None) -> None:
        self.model, self._problem = problem.model, problem
        self.elastic = Elastic(problem.model, problem.held, problem.free)
        self.surfaces = Surfaces(problem.model, self.elastic, pushing)
        self.force = np.zeros(self.surfaces.count)
        self.secants = Secants(problem.model.domain.msh.comm)
        index_map = problem.model.domain.V.dofmap.index_map
        self._load, self._way = (la.vector(index_map, 3) for _ in range(2))

    def soften(self) -> None:
        """Take the stiffness that flow leaves at the present displacement."""
        problem = self._problem
        self.elastic = Elastic(problem.model, problem.held, problem.free, soft=True)
        self.surfaces.take(self.elastic)
        self.secants.forget()

    def solve(self, residual: la.Vector, du: la.Vector) -> None:
        """Set ``du`` to the step that the forces out of balance ask for, held dofs at rest.

        Stiff springs turn what a step is off by into large forces. So the bodies are loaded by
        the spring forces that balanced them last, not by those of the present overlap.
        """
        surfaces, load = self.surfaces, self._load
        springs = surfaces.springs()
        before = self.force[springs.number]
        load.array[:] = residual.array
        surfaces.push(springs, before - springs.force, load)
        self.elastic.solve(load, du)
        force = surfaces.pressed(springs, before, surfaces.read(du))
        load.array[:] = 0.0
        surfaces.push(springs, force - before, load)
        self.elastic.solve(load, self._way)
        du.array[:] += self._way.array
        if not np.array_equal(self.force[springs.number] > 0.0, force > 0.0):
            self.secants.forget()
        n = self.elastic.n
        du.array[:n] = self.secants.improved(self.model.state.u.x.array[:n], du.array[:n])
        self.force[:] = 0.0
        self.force[springs.number] = force


def along(problem: AtRest, residual: la.Vector, du: la.Vector) -> float:
    """Go along a Newton step until its forces balance roughly, in place; return how far, 0 to 1.

    The work of the forces out of balance per share of the step falls from a positive value. Where
    the whole step leaves a negative one it has gone too far, because nodes have lost or found
    contact on the way, and a share with less than :data:`LEFT` of it is looked for; a step that
    takes all contact away leaves only the small work of the loads.

    Args:
        problem: The model with its loads at rest; ``state.a`` are the forces at the end [N].
        residual: Forces out of balance at the start [N]; overwritten.
        du: The step [m].
    """
    model = problem.model
    n, comm, u = 3 * model.domain.owned, model.domain.msh.comm, model.state.u.x
    step, before = du.array[:n].copy(), u.array[:n].copy()

    def work(share: float) -> float:
        u.array[:n] = before + share * step
        u.scatter_forward()
        return float(comm.allreduce(float(problem.out_of_balance().array[:n] @ step)))

    def parted() -> bool:
        return touched and not any(pair.active for pair in model.pairs.values())

    start = float(comm.allreduce(float(residual.array[:n] @ step)))
    touched = any(pair.active for pair in model.pairs.values())
    end = work(1.0)
    if start <= 0.0 or end >= (0.0 if parted() else -LEFT * start):
        return 1.0
    known, pressed = {0.0: start, 1.0: end}, 0.0

    def left(share: float) -> float:
        nonlocal pressed
        value = known[share] if share in known else work(share)
        if value > 0.0:
            pressed = max(pressed, share)  # as far as nodes have not parted
        return 0.0 if 0.0 <= value <= LEFT * start else value  # 0 ends the search

    share = float(brentq(left, 0.0, 1.0, xtol=1e-3, disp=False))
    work(pressed or share)
    return pressed or share


def check_all_seen(model: Model) -> None:
    """Raise GuardError where bodies overlap deeper than the contact that bears the load knows.

    Contact is looked for to a depth of half a cell; a step of the solver that is longer than small
    cells can carry nodes beyond it, and rest without them is not rest.
    """
    size = cell_size(model.scene, model.domain.source)
    for name, pair in model.pairs.items():
        depth, node, place = pair.penetration(model.state, 50 * size)
        if depth > 1.01 * pair.max_penetration + 1e-9:
            x, y, z = place
            raise GuardError(
                f"equilibrium: contacts.{name}: node {node} at x = {x:.5f}, y = {y:.5f}, "
                f"z = {z:.5f} m is {depth:.2e} m deep and not in contact, whose deepest overlap is "
                f"{pair.max_penetration:.2e} m; try a smaller equilibrium.approach"
            )
