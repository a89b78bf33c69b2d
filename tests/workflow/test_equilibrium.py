# SPDX-License-Identifier: LGPL-3.0-or-later
"""The static solve: contact forces on the compliance, secants, one factorisation."""

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem, la, mesh

from forms.elasticity import full
from forms.elements import LAWS
from forms.material_points import Points
from forms.plasticity import J2, BackStress, ElastoPlastic
from workflow import Scene
from workflow.model import build
from workflow.scene.settings import Equilibrium
from workflow.simulation import elastic
from workflow.simulation.at_rest import AtRest, move
from workflow.simulation.equilibrium import Solver
from workflow.simulation.guards import GuardError
from workflow.simulation.initial import rest
from workflow.simulation.secants import DEPTH, Secants


def test_secants_end_an_affine_map_in_as_many_steps_as_it_has_slow_motions():
    """Steps ``b − A u`` of a map with three eigenvalues far from 1: exact after three secants."""
    rng = np.random.default_rng(2)
    A, b = np.eye(40), rng.normal(size=40)
    Q = np.linalg.qr(rng.normal(size=(40, 3)))[0]
    A += Q @ np.diag([-0.9, -0.5, 0.4]) @ Q.T
    secants, u, sizes = Secants(MPI.COMM_SELF), np.zeros(40), []
    for _ in range(DEPTH + 2):
        step = b - A @ u
        sizes.append(np.linalg.norm(step))
        u = u + secants.improved(u, step)
    assert sizes[2] > 1e-3 * sizes[0] and sizes[-1] < 1e-10 * sizes[0]


@pytest.fixture
def solver() -> Solver:
    """Two bodies that overlap, before the first step."""
    model = build(Scene.load("hertz", **{"mesh.size": 1e-3}), MPI.COMM_SELF)
    settings = model.scene.equilibrium or Equilibrium()
    for body, approach in settings.approach.items():
        move(model, body, np.array(approach))
    return Solver(AtRest(model, settings, np.zeros(0)))


def test_pressed_springs_push_and_never_pull(solver):
    """Forces are those of the gaps that they leave behind; all gaps without force are open."""
    surfaces, springs = solver.surfaces, solver.surfaces.springs()
    none, load = np.zeros(len(springs.gap)), la.vector(solver._load.index_map, 3)
    way = np.zeros(3 * len(surfaces.nodes))
    force = surfaces.pressed(springs, none, way)
    load.array[:] = 0.0
    surfaces.push(springs, force, load)
    u = la.vector(solver._load.index_map, 3)
    solver.elastic.solve(load, u)
    gap = springs.gap + springs.B @ surfaces.read(u)
    assert (force >= 0.0).all() and 0 < (force > 0.0).sum() <= (springs.gap < 0.0).sum()
    exact = springs.stiffness * np.maximum(0.0, -gap)
    np.testing.assert_allclose(force, exact, atol=1e-6 * force.max())


def test_the_stiffness_is_factorised_once(monkeypatch):
    """However many iterations and nodes that come and go."""
    made: list[int] = []
    whole = elastic.cholesky

    def counted(K):
        made.append(1)
        return whole(K)

    monkeypatch.setattr(elastic, "cholesky", counted)
    model = build(Scene.load("hertz", **{"mesh.size": 1e-3}), MPI.COMM_SELF)
    assert rest(model) > 1 and len(made) == 1


def pressed(increments=1, **keys):
    """A ball that yields far around its contact, brought to rest; the model and its log."""
    steel = {"law": "j2", "youngs_modulus": 210e9, "poisson_ratio": 0.3, "density": 7800.0}
    steel |= {"yield_stress": 294e6, "hardening_modulus": 2e9}  # a fifth of Hertz's pressure
    steel |= {name: keys.pop(name) for name in list(keys) if name in steel}
    keys |= {f"bodies.{name}.material": steel for name in ("sphere", "flat")}
    keys = {"mesh.size": 1e-3, "equilibrium.increments": increments} | keys
    model, lines = build(Scene.load("hertz", **keys), MPI.COMM_SELF), []
    nodal = [item.nodal.copy() for item in model.items if hasattr(item, "nodal")]
    rest(model, lines.append)
    now = [item.nodal for item in model.items if hasattr(item, "nodal")]
    np.testing.assert_array_equal(now, nodal)
    return model, lines


def strained(model):
    """Take the history to the present state; the largest plastic strain, and what is off then."""
    problem = AtRest(model, Equilibrium(), np.zeros(0))
    before = problem.out_of_balance().array.copy()
    problem.remember()
    after = problem.out_of_balance().array
    np.testing.assert_allclose(after, before, rtol=0, atol=1e-9 * problem.load_size())
    strain = [item.cell_means("equivalent_plastic_strain") for item in problem._remembering]
    return float(np.max(strain))


def test_loads_in_increments_take_the_history_along():
    """In one step and in 4 the strain is 3 and 0.4 % off that in 8; the start does not jump.

    Renewing the history at rest changes no force.
    """
    found = {n: strained(pressed(n)[0]) for n in (1, 4, 8)}
    assert 0.01 < found[1] / found[8] - 1 < 0.06
    assert abs(found[4] / found[8] - 1) < 0.01


def test_steel_that_flows_far_comes_to_rest_at_once():
    """A tenth of Hertz's pressure, no hardening: in one step with the stiffness that flow leaves.

    In 8 increments the largest plastic strain is the same within 10 %.
    """
    keys = {"mesh.size": 5e-4, "yield_stress": 147e6, "hardening_modulus": 0.0}
    model, lines = pressed(**keys)
    assert sum("stiffness of the steel" in line for line in lines) in (1, 2)
    assert sum("residual" in line for line in lines) < 30
    assert not any("not converged" in line for line in lines)
    assert strained(model) == pytest.approx(strained(pressed(8, **keys)[0]), rel=0.1)


@pytest.mark.parametrize("element", ["full", "selective", "one-point"])
def test_softening_is_the_derivative_of_the_force(element):
    """Of a cube strained beyond yield, two back stresses: by differences, to 1e-6."""
    msh = mesh.create_unit_cube(MPI.COMM_SELF, 1, 1, 1, mesh.CellType.hexahedron)
    V = fem.functionspace(msh, ("Lagrange", 1, (3,)))
    backs = (BackStress(60e9, 400.0), BackStress(8e9, 30.0))
    material = ElastoPlastic(210e9, 0.3, 7800.0, yield_stress=3e8, back_stresses=backs)
    u = fem.Function(V)
    points = Points(J2, material, V, full(msh), rotating=False, element=element)
    kernel = points.force(u)
    held = fem.Function(fem.functionspace(msh, points.history.coefficient.ufl_element()))
    K = fem.assemble_matrix(fem.form(points.softening(u, held))).to_dense()
    np.testing.assert_allclose(K, 0, atol=1e-9 * 210e9)  # nothing flows
    X, A = V.tabulate_dof_coordinates(), 4e-3 * np.array([[1, 2, 0], [0, -0.5, 0.7], [0.3, 0, 0.4]])
    u.x.array[:] = (X @ A.T).ravel()
    K = fem.assemble_matrix(fem.form(points.softening(u, held))).to_dense()
    law = LAWS["small-strain"]
    elastic = (law.shape if element == "selective" else law.residual)(
        u, ufl.TestFunction(V), material
    )
    K += fem.assemble_matrix(
        fem.form(ufl.derivative(elastic * points.dx, u, ufl.TrialFunction(V)))
    ).to_dense()
    way = (X @ np.array([[0.2, 1.0, -0.4], [0.0, 0.5, 0.1], [0.7, -0.3, -0.6]]).T).ravel()
    ends, h = [], 1e-8
    for sign in (1, -1):
        u.x.array[:] = (X @ A.T).ravel() + sign * h * way
        force = np.zeros(24)
        kernel.add(force)
        ends.append(-force)
    slope = (ends[0] - ends[1]) / (2 * h)
    np.testing.assert_allclose(K @ way, slope, rtol=0, atol=1e-6 * np.abs(slope).max())
    np.testing.assert_allclose(K, K.T, atol=1e-9 * np.abs(K).max())


def test_an_increment_that_does_not_converge_is_halved():
    """With 8 iterations at most a whole step needs 9: it is halved, and comes to rest."""
    model, lines = pressed(**{"equilibrium.max_iterations": 8})
    assert "equilibrium: not converged; from 0 of the loads by 0.5 of them" in lines
    assert strained(model) == pytest.approx(strained(pressed(4)[0]), rel=0.02)


def test_elastic_loads_are_not_halved():
    """A body that nothing holds is told at once, as before: no second try."""
    model = build(Scene.load("hertz", **{"mesh.size": 1e-3}), MPI.COMM_SELF)
    scene = model.scene.with_(**{"equilibrium.max_iterations": 2})
    model.scene, lines = scene, []
    with pytest.raises(GuardError, match="after 2 iterations"):
        rest(model, lines.append)
    assert not any("not converged" in line for line in lines)
