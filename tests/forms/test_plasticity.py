# SPDX-License-Identifier: LGPL-3.0-or-later
"""J2 plasticity at a material point: closed forms, an independent integration, rotation, energy."""

from collections.abc import Callable
from itertools import pairwise

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem, mesh
from scipy.linalg import expm, logm
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from forms.elasticity import full
from forms.logarithmic import half_logarithm
from forms.material_points import Points
from forms.materials import VOIGT
from forms.memory import EQUIVALENT, FLOW, MemoryLaw, Variable, _exponential
from forms.plasticity import J2, BackStress, ElastoPlastic, flow_stress

E, NU, RHO, Y = 210e9, 0.3, 7800.0, 500e6
G = E / (2 * (1 + NU))


def steel(**constants: object) -> ElastoPlastic:
    return ElastoPlastic(E, NU, RHO, yield_stress=Y, **constants)  # type: ignore[arg-type]


class Point:
    """One cube whose displacement gradient is given: a material point of eight equal ones."""

    def __init__(
        self, material: ElastoPlastic, *, rotating: bool = False, element: str = "full"
    ) -> None:
        msh = mesh.create_unit_cube(MPI.COMM_SELF, 1, 1, 1, mesh.CellType.hexahedron)
        V = fem.functionspace(msh, ("Lagrange", 1, (3,)))
        self.u = fem.Function(V)
        self.points = Points(J2, material, V, full(msh), rotating=rotating, element=element)
        self.kernel = self.points.force(self.u)
        Q = fem.functionspace(msh, ("DG", 0))
        densities = self.points.densities(self.u).items()
        self.terms = {k: self.points.cell_integral(d, Q) for k, d in densities}
        self.X = V.tabulate_dof_coordinates()

    def stress(self, H: np.ndarray, *, renew: bool = True) -> np.ndarray:
        """First Piola–Kirchhoff stress of a displacement gradient [Pa]."""
        self.u.x.array.reshape(-1, 3)[:] = self.X @ np.asarray(H).T
        force = np.zeros(self.u.x.array.size)
        self.kernel.add(force, renew=renew)
        return -force.reshape(-1, 3).T @ (self.X - 0.5)

    def value(self, name: str) -> np.ndarray:
        """A history variable, the same at all points."""
        values = self.points.values()[name][0]
        assert np.allclose(values, values[0], rtol=1e-9, atol=1e-15)
        return values[0]

    def energies(self) -> dict[str, float]:
        out = {}
        for name, kernel in self.terms.items():
            cell = np.zeros(1)
            kernel.add(cell)
            out[name] = float(cell[0])
        return out


def shear(gamma: float) -> np.ndarray:
    H = np.zeros((3, 3))
    H[0, 1] = gamma
    return H


def uniaxial(point: Point, axial: float, gamma: float = 0.0) -> np.ndarray:
    """Stress under an axial strain and a shear, free of lateral stress."""

    def gradient(lateral: float) -> np.ndarray:
        H = np.diag([axial, lateral, lateral])
        H[0, 1] = H[1, 0] = gamma / 2
        return H

    bound = abs(axial) + 0.01
    lateral = brentq(
        lambda e: point.stress(gradient(e), renew=False)[2, 2], -bound, bound, xtol=1e-16
    )
    return point.stress(gradient(lateral))


@pytest.mark.parametrize("hardening", ["isotropic", "kinematic"])
def test_row_30_tension(hardening: str) -> None:
    """Bilinear tension: σ = Y + E_t (ε − Y/E), E_t = E H / (E + H), by either hardening; 1e-6."""
    H = 21e9
    backs = {"back_stresses": (BackStress(H),)}
    point = Point(steel(**({"hardening_modulus": H} if hardening == "isotropic" else backs)))
    for axial in np.linspace(0, 0.01, 6)[1:]:
        stress = uniaxial(point, axial)[0, 0]
        exact = min(E * axial, Y + E * H / (E + H) * (axial - Y / E))
        assert stress == pytest.approx(exact, rel=1e-9)


def test_row_30_shear_with_voce_hardening() -> None:
    """Shear: √3 τ = Y + H p + Q (1 − exp(−b p)) with √3 p = γ − τ/G."""
    material = steel(hardening_modulus=1e9, saturation_stress=200e6, saturation_rate=60.0)
    for steps in (50, 200):
        point = Point(material)
        for gamma in np.linspace(0, 0.03, steps + 1)[1:]:
            tau = point.stress(shear(gamma))[0, 1]
        p = float(point.value(EQUIVALENT)[0])
        assert p == pytest.approx((0.03 - tau / G) / 3**0.5, rel=1e-9)
        exact = Y + 1e9 * p + 200e6 * (1 - np.exp(-60 * p))
        assert 3**0.5 * tau == pytest.approx(exact, rel=1e-9)


def test_row_30_tension_then_torsion() -> None:
    """Tube at first yield, length held, twisted: σ = Y cos θ, √3 τ = Y sin θ; first order in steps.

    ``√3 γ / Y = sin θ / G + 3/E (ln (sec θ + tan θ) − sin θ)`` from dε = 0 and the flow rule.
    """
    theta = 1.0
    logarithm = np.log(1 / np.cos(theta) + np.tan(theta))
    gamma = Y / 3**0.5 * (np.sin(theta) / G + 3 / E * (logarithm - np.sin(theta)))
    errors = []
    for steps in (100, 200, 400):
        point = Point(steel())
        uniaxial(point, Y / E)
        for twist in np.linspace(0, gamma, steps + 1)[1:]:
            stress = uniaxial(point, Y / E, twist)
        errors.append(stress[0, 0] / (Y * np.cos(theta)) - 1)
        assert stress[0, 0] ** 2 + 3 * stress[0, 1] ** 2 == pytest.approx(Y**2, rel=1e-9)
    assert errors[0] / errors[1] == pytest.approx(2, rel=0.02)
    first = [2 * b - a for a, b in pairwise(errors)]
    assert (4 * first[1] - first[0]) / 3 == pytest.approx(0, abs=1e-6)


def test_row_30_cycles_with_recall() -> None:
    """Armstrong–Frederick in cycles: half range Y + (C/γ) tanh(γ Δε_p / 2); first order."""
    C, recall, size = 60e9, 300.0, 0.008
    errors = []
    for steps in (50, 100, 200):
        point = Point(steel(back_stresses=(BackStress(C, recall),)))
        ends = []
        for sign in (1, -1, 1, -1, 1, -1, 1):
            start = -sign * size if ends else 0.0
            for axial in np.linspace(start, sign * size, steps + 1)[1:]:
                stress = uniaxial(point, axial)[0, 0]
            ends.append((stress, sign * size - stress / E))
        (low, before), (high, after) = ends[-2:]
        exact = Y + C / recall * np.tanh(recall * (after - before) / 2)
        errors.append((high - low) / 2 / exact - 1)
    assert errors[0] / errors[1] == pytest.approx(2, rel=0.05)
    first = [2 * b - a for a, b in pairwise(errors)]
    assert (4 * first[1] - first[0]) / 3 == pytest.approx(0, abs=1e-6)


MATERIALS = {
    "isotropic": {"hardening_modulus": 5e9},
    "voce": {"hardening_modulus": 1e9, "saturation_stress": 150e6, "saturation_rate": 40.0},
    "chaboche": {
        "saturation_stress": 100e6,
        "saturation_rate": 50.0,
        "back_stresses": (BackStress(60e9, 400.0), BackStress(8e9, 30.0)),
    },
}


def rates(material: ElastoPlastic, path: Callable[[float], np.ndarray], steps: int) -> np.ndarray:
    """Stress at the end of a strain path by the rate equations, without any return mapping."""
    plastic, p = np.zeros((3, 3)), 0.0
    X = [np.zeros((3, 3)) for _ in material.back_stresses]
    before = path(0.0)
    for t in np.linspace(0, 1, steps + 1)[1:]:
        now = path(t)
        s = 2 * material.mu * (before - plastic)
        xi = s - np.trace(s) / 3 * np.eye(3) - sum(X)
        size = np.sqrt(1.5 * np.sum(xi * xi))
        direction = 1.5 * xi / max(size, 1e-300)
        hard = material.hardening_modulus
        hard += (
            material.saturation_stress
            * material.saturation_rate
            * np.exp(-material.saturation_rate * p)
        )
        for b, x in zip(material.back_stresses, X, strict=True):
            hard += b.modulus - b.recall * np.sum(direction * x)
        beyond = size - float(flow_limit(p, material))  # a little: what the last step left
        loading = 2 * material.mu * np.sum(direction * (now - before)) + beyond
        dp = max(loading, 0.0) / (3 * material.mu + hard) if beyond > -1e-6 * Y else 0.0
        for k, b in enumerate(material.back_stresses):
            X[k] = X[k] + dp * (2 / 3 * b.modulus * direction - b.recall * X[k])
        plastic, p, before = plastic + dp * direction, p + dp, now
    elastic = before - plastic
    return material.lmbda * np.trace(elastic) * np.eye(3) + 2 * material.mu * elastic


def flow_limit(p: float, material: ElastoPlastic) -> float:
    Q, b = material.saturation_stress, material.saturation_rate
    return material.yield_stress + material.hardening_modulus * p + Q * (1 - np.exp(-b * p))


@pytest.mark.parametrize("kind", MATERIALS)
def test_random_strain_path_as_by_the_rate_equations(kind: str) -> None:
    """A crooked path of strain: the rate equations in 20 000 small steps give the same stress."""
    material = steel(**MATERIALS[kind])
    rng = np.random.default_rng(5)
    corners = [np.zeros((3, 3))]
    for _ in range(4):
        step = rng.standard_normal((3, 3)) * 2e-3
        corners.append(corners[-1] + (step + step.T) / 2)

    def path(t: float) -> np.ndarray:
        k = min(int(4 * t), 3)
        return corners[k] + (4 * t - k) * (corners[k + 1] - corners[k])

    exact = rates(material, path, 20_000)
    found = []
    for steps in (400, 800):
        point = Point(material)
        for t in np.linspace(0, 1, steps + 1)[1:]:
            stress = point.stress(path(t))
        found.append(stress)
    error = [np.linalg.norm(stress - exact) / np.linalg.norm(exact) for stress in found]
    better = 2 * found[1] - found[0]
    assert error[1] < 0.6 * error[0] < 2e-3
    assert np.linalg.norm(better - exact) < 2e-4 * np.linalg.norm(exact)


@pytest.mark.parametrize("size", [1e-3, 0.03, 0.06, 0.1])
def test_logarithm_and_exponential_of_an_increment(size: float) -> None:
    """Of symmetric tensors of strains up to 10 %: those of scipy, to E⁶ / 20 and flow⁵ / 700."""
    A = np.random.default_rng(3).standard_normal((3, 3))
    A = (A + A.T) * size / np.abs(np.linalg.eigvalsh(A + A.T)).max()
    given = ufl.as_matrix(A.tolist())
    for found, exact, error in (
        (half_logarithm(given), np.real(logm(np.eye(3) + 2 * A)) / 2, size**6 / 20),
        (_exponential(given), expm(-A) - np.eye(3), size**5 / 700),
    ):
        value = np.array([[float(found[i, j](())) for j in range(3)] for i in range(3)])
        assert np.allclose(value, exact, rtol=0, atol=size * (error + 1e-12))


@pytest.mark.slow
def test_large_strain_by_the_exponential_map() -> None:
    """Shear of 2 with stretch: exact logarithms and exponentials in numpy give the same stress."""
    H = 1e9
    point = Point(steel(hardening_modulus=H), rotating=True)
    Fp, p, mu, steps = np.eye(3), 0.0, G, 400
    bulk = E / (3 * (1 - 2 * NU))
    for t in np.linspace(0, 1, steps + 1)[1:]:
        F = np.eye(3) + shear(2 * t) + np.diag([0.3 * t, -0.1 * t, 0.0])
        F *= (1 + 0.01 * t) / np.linalg.det(F) ** (1 / 3)  # 3 % of volume
        P = point.stress(F - np.eye(3))
        Fe = F @ np.linalg.inv(Fp)
        L = np.real(logm(Fe.T @ Fe)) / 2
        s = 2 * mu * (L - np.trace(L) / 3 * np.eye(3))
        size = np.sqrt(1.5 * np.sum(s * s))
        dp = max(size - Y - H * p, 0) / (3 * mu + H)
        flow = 1.5 * dp * s / size
        p, Fp = p + dp, expm(flow) @ Fp
        Fe = F @ np.linalg.inv(Fp)
        M = s - 2 * mu * flow + bulk * np.trace(L) * np.eye(3)
        exact = np.linalg.inv(Fe).T @ M @ np.linalg.inv(Fp).T
    assert point.value(EQUIVALENT)[0] == pytest.approx(p, rel=1e-9)
    assert np.allclose(P, exact, rtol=0, atol=3e-8 * np.abs(exact).max())
    found = np.eye(3) + point.value(FLOW).reshape(3, 3)
    assert np.linalg.det(found) == pytest.approx(1, abs=2e-9)  # flow keeps the volume


@pytest.mark.slow
def test_row_36_a_thousand_degrees_leave_plastic_steel_as_it_is() -> None:
    """Rotation by 1 000° in steps of 0.1°: stress turns along to 1e-9, no bit of history changes.

    Of a state on the yield surface, where round-off is flow, 1e-7 in these 10 000 steps.
    """
    backs = (BackStress(60e9, 400.0),)
    point = Point(steel(hardening_modulus=1e9, back_stresses=backs), rotating=True)
    for gamma in np.linspace(0, 0.05, 101):
        P = point.stress(shear(gamma))
    axis = np.array([1.0, 2.0, -1.5]) / np.linalg.norm([1.0, 2.0, -1.5])
    for gamma, tolerance in ((0.05, 1e-6), (0.0495, 1e-9)):
        P, F = point.stress(shear(gamma)), np.eye(3) + shear(gamma)
        kept = point.points.history.values()
        for degrees in np.arange(0.1, 1000.05, 0.1):
            R = Rotation.from_rotvec(np.radians(degrees) * axis).as_matrix()
            turned = point.stress(R @ F - np.eye(3))
        assert np.allclose(turned, R @ P, rtol=0, atol=tolerance * np.abs(P).max())
        assert np.allclose(point.points.history.values(), kept, rtol=0, atol=1e-8)
    assert np.array_equal(point.points.history.values(), kept)


@pytest.mark.parametrize("rotating", [False, True], ids=["small", "large"])
@pytest.mark.parametrize("kind", MATERIALS)
def test_work_is_stored_or_dissipated(kind: str, rotating: bool) -> None:
    """Shear there and back: work = elastic + hardening + dissipation, to first order."""
    errors = []
    for steps in (200, 400):
        point, work = Point(steel(**MATERIALS[kind]), rotating=rotating), 0.0
        path = np.linspace(0, 0.04, steps + 1)
        P, before = point.stress(shear(0.0)), 0.0
        for gamma in [*path[1:], *path[::-1][1:]]:
            new = point.stress(shear(gamma))
            work += (new + P)[0, 1] / 2 * (gamma - before)
            P, before = new, gamma
        energies = point.energies()
        errors.append(sum(energies.values()) / work - 1)
        assert energies["plastic_dissipation"] > 0.5 * work
    assert abs(errors[1]) < 0.6 * abs(errors[0]) < 2e-3


@pytest.mark.parametrize("kind", ["voce", "chaboche"])
def test_any_increment_ends_on_the_yield_surface(kind: str) -> None:
    """One step of 1e-6 to 0.1 from a state with back stresses: within 1e-11 of the yield stress.

    Steps of usual size take two iterations, these up to five; none takes fewer than it needs.
    """
    material = steel(**MATERIALS[kind])
    point = Point(material)
    for gamma in np.linspace(0, 0.02, 21):
        point.stress(shear(gamma))
    turned = shear(0.02) + np.diag([1.0, -0.4, -0.6])
    kept = point.points.history.values()
    Q = fem.functionspace(point.u.function_space.mesh, ("DG", 0))
    beyond = point.points.cell_integral(point.points.beyond(point.u), Q)
    for size in np.logspace(-6, -1, 26):
        point.points.history.set(kept)
        point.stress(shear(0.02) + size * (turned - shear(0.02)))
        cell = np.zeros(1)
        beyond.add(cell)
        assert cell[0] < 1e-11
        sizes = [np.abs(values).max() for values in point.points.values().values()]
        assert np.isfinite(sizes).all()
    assert float(point.value(EQUIVALENT)[0]) > 0.05


def test_cells_that_flow_do_not_touch_their_neighbours() -> None:
    """Two cells of one batch, one far in yield and one elastic: each as it is alone, to the bit."""
    material = steel(**MATERIALS["chaboche"])
    msh = mesh.create_box(
        MPI.COMM_SELF, [[0, 0, 0], [3, 1, 1]], [3, 1, 1], mesh.CellType.hexahedron
    )
    V = fem.functionspace(msh, ("Lagrange", 1, (3,)))
    found = []
    for both in (True, False):
        u = fem.Function(V)
        points = Points(J2, material, V, full(msh), rotating=False)
        kernel = points.force(u)
        X = V.tabulate_dof_coordinates()
        u.x.array.reshape(-1, 3)[:, 1] = 1e-3 * np.minimum(X[:, 0], 1.0)
        if both:
            u.x.array.reshape(-1, 3)[:, 1] += 0.02 * np.maximum(X[:, 0] - 2.0, 0.0)
        kernel.add(np.zeros(u.x.array.size), renew=True)
        order = np.argsort(mesh.compute_midpoints(msh, 3, points.history.cells)[:, 0])
        found.append(points.history.values()[order])
    assert np.array_equal(found[0][:2], found[1][:2])
    strains = found[0][:, :, list(points.variables).index(EQUIVALENT) + 5]
    assert (strains[:2] == 0).all() and (strains[2] > 0).all()


def test_elastic_steps_keep_the_memory_to_the_last_bit() -> None:
    """Steps below the flow stress change no bit of the history, at either strain."""
    for rotating in (False, True):
        point = Point(steel(**MATERIALS["chaboche"]), rotating=rotating)
        for gamma in np.linspace(0, 0.02, 21):
            point.stress(shear(gamma))
        kept = point.points.history.values()
        for gamma in np.linspace(0.0199, 0.0185, 15):
            point.stress(shear(gamma))
        assert np.array_equal(point.points.history.values(), kept)


def test_constants_of_no_steel_are_refused() -> None:
    """Yield stress 0 or above the modulus, softening, half of Voce: got and expected."""
    for constants, words in (
        ({"yield_stress": 0.0}, "expected above 0"),
        ({"yield_stress": 3e11}, "less than Young's modulus"),
        ({"yield_stress": Y, "hardening_modulus": -1e9}, "no softening"),
        ({"yield_stress": Y, "saturation_stress": 1e8}, "both above 0, or neither"),
        ({"yield_stress": Y, "back_stresses": (BackStress(1e9, -1.0),)}, "no softening"),
    ):
        with pytest.raises(ValueError, match=words):
            ElastoPlastic(E, NU, RHO, **constants)  # type: ignore[arg-type]


def test_laws_that_forget_a_variable_are_refused() -> None:
    """New values of other names or shapes, and large strain without plastic strain: said so."""
    msh = mesh.create_unit_cube(MPI.COMM_SELF, 1, 1, 1, mesh.CellType.hexahedron)
    V = fem.functionspace(msh, ("Lagrange", 1, (3,)))
    material = steel()

    def law(new: dict[str, object]) -> MemoryLaw:
        return MemoryLaw(
            lambda m: {"damage": Variable()},
            lambda strain, old, m: (m.stress(strain), new),
            lambda strain, old, m: {"internal": 0.0},
        )

    for new, words in (
        ({"harm": 0.0}, "expected new values"),
        ({"damage": ufl.Identity(3)}, "shape"),
    ):
        with pytest.raises(ValueError, match=words):
            Points(law(new), material, V, full(msh), rotating=False).force(fem.Function(V))
    with pytest.raises(ValueError, match="plastic_strain"):
        Points(law({}), material, V, full(msh), rotating=True)
    with pytest.raises(ValueError, match="shape"):
        Variable((2, 2))
    assert float(flow_stress(0.0, material)) == Y


@pytest.mark.parametrize("rotating", [False, True], ids=["small", "large"])
def test_one_point_cell_is_the_same_point(rotating: bool) -> None:
    """Uniform strain: stress, history and energies of one point are those of eight, in 160 byte."""
    material = steel(hardening_modulus=5e9)
    one, eight = (Point(material, rotating=rotating, element=e) for e in ("one-point", "full"))
    for gamma in np.linspace(0, 0.02, 21):
        P, exact = one.stress(shear(gamma)), eight.stress(shear(gamma))
        assert np.allclose(P, exact, rtol=0, atol=1e-9 * Y)
    p = one.points.values()[EQUIVALENT][0, 0, 0]
    assert p == pytest.approx(eight.value(EQUIVALENT)[0], rel=1e-12)
    energies, answer = one.energies(), eight.energies()
    for name, energy in answer.items():
        assert energies[name] == pytest.approx(energy, rel=1e-9)
    assert abs(energies["hourglass"]) < 1e-12 * answer["internal"]
    assert one.points.size == (20 if not rotating else 23)


@pytest.mark.parametrize("rotating", [False, True], ids=["small", "large"])
def test_hourglass_forces_shrink_as_their_cell_flows(rotating: bool) -> None:
    """A cell that bends and is sheared far: work = energies, and the modes keep a small share.

    Bending alone leaves the mean of the cell at rest: its modes stay elastic, and no work is lost.
    """
    point = Point(steel(hardening_modulus=1e9), rotating=rotating, element="one-point")
    bent = np.zeros_like(point.X)
    bent[:, 0] = 1e-3 * (2 * point.X[:, 1] - 1) * (2 * point.X[:, 2] - 1)
    errors, work, before, last = [], 0.0, None, None
    for k in range(2001):
        t = min(k / 200, 1.0), max(k - 200, 0) / 1800
        point.u.x.array.reshape(-1, 3)[:] = point.X @ shear(0.03 * t[1]).T + t[0] * bent
        force = np.zeros(point.u.x.array.size)
        point.kernel.add(force, renew=True)
        if before is not None:
            work -= (force + last) @ (point.u.x.array - before) / 2
        before, last = point.u.x.array.copy(), force
        if k == 200:
            bending = point.energies()
            assert bending["hourglass"] == pytest.approx(work, rel=1e-6)
            assert bending["plastic_dissipation"] == 0.0
    end = point.energies()
    assert end["hourglass"] < 0.05 * bending["hourglass"]
    errors.append(sum(end.values()) / work - 1)
    assert abs(errors[0]) < 1e-3


@pytest.mark.parametrize(
    ("element", "rotating"), [("full", False), ("selective", True), ("one-point", True)]
)
def test_mean_stress_of_a_cell_is_that_of_its_forces(element: str, rotating: bool) -> None:
    """Sheared and stretched beyond yield: Cauchy's ``P Fᵀ / J``, with P from the nodal forces.

    A selective cell leaves the pressure to another form. To 1e-9; to 1e-5 at large strain, where
    ``C_e⁻¹`` is a series.
    """
    point = Point(steel(hardening_modulus=10e9), rotating=rotating, element=element)
    H = 4e-3 * np.array([[1.0, 2.0, 0.0], [0.0, -0.5, 0.7], [0.3, 0.0, 0.4]])
    if rotating:
        turn = Rotation.from_rotvec([0.3, -0.5, 0.2]).as_matrix()
        H = turn @ (np.eye(3) + H) - np.eye(3)
    P = point.stress(H)
    assert point.value(EQUIVALENT)[0] > 1e-3
    F = np.eye(3) + H
    expected = P @ F.T / np.linalg.det(F) if rotating else P
    Q = fem.functionspace(point.u.function_space.mesh, ("DG", 0, (6,)))
    found = np.zeros(6)
    point.points.cell_integral(point.points.stress(point.u), Q).add(found)
    stress = [expected[entry] for entry in VOIGT]
    np.testing.assert_allclose(found, stress, rtol=1e-5 if rotating else 1e-9, atol=1.0)
