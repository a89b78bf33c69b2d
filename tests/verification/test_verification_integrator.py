# SPDX-License-Identifier: LGPL-3.0-or-later
"""Verification rows 4 and 5: bar modes and the integrator.

A clamped–free steel bar with ν = 0, whose wave speed is c = √(E/ρ).
"""

from mpi4py import MPI

import numpy as np
import pytest
import scipy.linalg
from dolfinx import la

from forms.springs.connections import Connections
from forms.springs.point_masses import PointMasses
from workflow.model.model import Model, build
from workflow.scene.scene import Scene
from workflow.simulation.stepping import central_difference

LENGTH, C = 0.1, np.sqrt(210e9 / 7800.0)


ELEMENTS = [("full", None), ("one-point", None), ("one-point", 0.1), ("selective", None)]


def bar(cells: int, nu: float = 0.0, element=ELEMENTS[0]) -> Model:
    """The bar in a single row of cubes."""
    size = LENGTH / cells
    changes = {"mesh.length": LENGTH, "mesh.width": size, "mesh.size": size}
    changes |= {"bodies.bar.material.poisson_ratio": nu, "bodies.bar.element": element[0]}
    if element[1] is not None:
        changes["bodies.bar.hourglass_coefficient"] = element[1]
    return build(Scene.load("bar-wave", **changes), MPI.COMM_SELF)


def stiffness(model: Model) -> np.ndarray:
    """Stiffness column by column from the kernel that the run steps with."""
    u = np.zeros_like(model.state.u.x.array)
    K = np.zeros((len(u), len(u)))
    for j in range(len(u)):
        u[:] = 0.0
        u[j] = 1.0
        model.state.u.x.array[:] = u
        model.internal.kernel.add(K[j])
    model.state.u.x.array[:] = 0.0
    return -(K + K.T) / 2


def free_modes(model: Model) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies and mass-normalised shapes of the held lumped system, dense."""
    x = model.domain.V.tabulate_dof_coordinates()[:, 0]
    free = np.ones(3 * len(x), dtype=bool)
    free[::3] = ~np.isclose(x, 0)
    K, m = stiffness(model)[np.ix_(free, free)], model.mass.array[free]
    squares, shapes = scipy.linalg.eigh(K / np.sqrt(np.outer(m, m)))
    full = np.zeros((len(free), len(m)))
    full[free] = shapes / np.sqrt(m)[:, None]
    return np.sqrt(np.maximum(squares, 0)), full


def longitudinal(model: Model) -> np.ndarray:
    """Frequencies of the modes in which each cross-section moves along x as one.

    With ν = 0 that motion is a subspace of its own, which is checked.
    """
    x = np.round(model.domain.V.tabulate_dof_coordinates()[:, 0] / LENGTH, 9)
    stations = np.unique(x)[1:]
    sections = np.zeros((3 * len(x), len(stations)))
    sections[::3] = x[:, None] == stations
    K, m = stiffness(model), model.mass.array
    force = K @ sections
    force[::3][x == 0] = 0.0  # reaction of the clamp
    coefficients = np.linalg.lstsq(sections * m[:, None], force, rcond=None)[0]
    residual = force - m[:, None] * sections @ coefficients
    assert np.abs(residual).max() < 1e-12 * np.abs(force).max()
    return np.sqrt(np.sort(np.linalg.eigvals(coefficients).real))


def slope(x, errors) -> float:
    return float(np.polyfit(np.log(x), np.log(errors), 1)[0])


def stepped(model: Model, dt: float, steps: int):
    """Step the model with nothing but its internal force and supports."""
    model.state.t, model.state.step = 0.0, 0
    return central_difference(
        model.state, model.mass.petsc_vec, [model.internal.add], model.supports, dt, steps * dt
    )


# row 4


@pytest.mark.parametrize("element", ELEMENTS)
def test_row_4_bar_modes_follow_the_dispersion_of_lumped_cells(element):
    """ω_h = 2c/h sin(kh/2) with k = (2j−1)π/2L for all 8 modes of 8 cells, to 1e-10."""
    k = (2 * np.arange(1, 9) - 1) * np.pi / (2 * LENGTH)
    h = LENGTH / 8
    found = longitudinal(bar(8, element=element))
    np.testing.assert_allclose(found, 2 * C / h * np.sin(k * h / 2), rtol=1e-10)


def test_row_4_bar_modes_converge_with_the_second_order_of_h():
    """f_k = (2k−1) c/4L, k = 1 … 3: the error falls with slope 2 ± 0.1 over 8, 16, 32 cells."""
    cells = np.array([8, 16, 32])
    found = np.array([longitudinal(bar(n))[:3] for n in cells]) / (2 * np.pi)
    exact = (2 * np.arange(1, 4) - 1) * C / (4 * LENGTH)
    errors = 1 - found / exact
    for mode in range(3):
        assert slope(1 / cells, errors[:, mode]) == pytest.approx(2, abs=0.1)
    assert errors[-1, 0] == pytest.approx((np.pi / 2 / 32) ** 2 / 24, rel=1e-3)


def test_row_4_stepped_bar_converges_with_the_second_order_of_h():
    """u = sin(πx/2L) sin(ωt)/ω from its initial velocity, dt = h/2c, up to ωt = 2.5: slope 2 ± 0.1.

    Largest nodal error over 1/ω; in time and space together (h/c)² (1 − 1/4)/24 ω³ t for a start.
    """
    omega = np.pi * C / (2 * LENGTH)
    cells, errors = np.array([8, 16, 32]), []
    for n in cells:
        model = bar(n)
        x = model.domain.V.tabulate_dof_coordinates()[:, 0]
        shape = np.sin(np.pi * x / (2 * LENGTH))
        model.state.v.x.array[::3] = shape
        steps = round(2.5 / omega / (LENGTH / n / (2 * C)))
        for state in stepped(model, 2.5 / omega / steps, steps):
            pass
        u = state.u.x.array.reshape(-1, 3)
        exact = np.outer(shape * np.sin(2.5) / omega, [1, 0, 0])
        errors.append(np.abs(u - exact).max() * omega)
    assert slope(1 / cells, errors) == pytest.approx(2, abs=0.1)


def test_row_4_thrown_bar_follows_dalembert():
    """Tip of the clamped bar thrown at v₀: a triangle of height v₀ L/c and period 4L/c.

    Its corners are rounded by the transit of about a cell, v₀ h/c: a hundredth of the height with
    100 cells, and growing with the cube root of the way; 1.5 % after three lengths, 0.5 % rms.
    """
    model = bar(100)
    tip = np.isclose(model.domain.V.tabulate_dof_coordinates()[:, 0], LENGTH)
    model.state.v.x.array[::3] = 1.0
    model.supports(model.state.v.x)
    steps = round(4.2 * LENGTH / C / model.dt)
    u = [s.u.x.array[::3][tip].mean() for s in stepped(model, model.dt, steps)]
    phase = np.mod(np.arange(steps + 1) * model.dt * C / (4 * LENGTH) + 0.25, 1)
    error = np.array(u) * C / LENGTH - (1 - 4 * np.abs(phase - 0.5))
    assert np.abs(error).max() < 0.015
    assert np.sqrt(np.mean(error**2)) < 0.005


# row 5


def test_row_5_oscillator_is_second_order_in_dt():
    """A point mass on a spring let go: |u − cos ωt| at ωt = 20 falls with slope 2 ± 0.1."""
    counts, errors = np.array([100, 200, 400]), []
    none, one = np.zeros((1, 3)), np.ones((1, 3))
    for n in counts:
        masses = PointMasses(np.array([2.0]), np.zeros(3), one, 2.0 * one, none)
        masses.u[0, 0] = 1.0
        load, dt = Connections(MPI.COMM_SELF, masses, [], 20 / n), 20 / n
        model = bar(2)  # at rest: it only gives the loop its arrays
        loop = central_difference(
            model.state, model.mass.petsc_vec, [load.add], model.supports, dt, 20.0, [masses]
        )
        for _ in loop:
            pass
        errors.append(abs(masses.u[0, 0] - np.cos(20)))
    assert slope(20 / counts, errors) == pytest.approx(2, abs=0.1)
    assert errors[-1] == pytest.approx(20 * 0.05**2 / 24 * np.sin(20), rel=0.02)


@pytest.mark.parametrize("element", ELEMENTS)
def test_row_5_bar_is_second_order_in_dt(element):
    """A mode of the lumped bar let go: error against φ cos ωt at ωt = 10 with slope 2 ± 0.1."""
    model = bar(4, 0.3, element)
    omega, shapes = free_modes(model)
    mode = len(omega) // 2
    counts, errors = np.array([50, 100, 200]), []
    for n in counts:
        model.state.u.x.array[:] = shapes[:, mode]
        model.state.v.x.array[:] = 0.0
        for state in stepped(model, 10 / omega[mode] / n, n):
            pass
        error = state.u.x.array - shapes[:, mode] * np.cos(10)
        errors.append(np.abs(error).max() / np.abs(shapes[:, mode]).max())
    assert slope(10 / counts, errors) == pytest.approx(2, abs=0.1)


def mass_norm(model: Model, vector: la.Vector) -> float:
    return float(np.sqrt(model.mass.array @ vector.array**2))


def throw(model: Model) -> float:
    """Give every free dof a random velocity; return its norm."""
    v = model.state.v.x
    v.array[:] = np.random.default_rng(0).standard_normal(len(v.array))
    model.supports(v)
    return mass_norm(model, v)


@pytest.mark.parametrize("element", ELEMENTS)
def test_row_5_just_below_the_limit_the_bar_stays_bounded(element):
    """ω_max dt = 2 · 0.99: for 10⁵ steps ‖v‖ ≤ ‖v₀‖ / √(1 − 0.99²), what leapfrog may reach.

    In a mode v(t + dt/2) = v₀ cos(Ω(n + ½)) / cos(Ω/2) with sin(Ω/2) = ω dt/2 (norms by mass).
    """
    model = bar(3, 0.3, element)
    dt = 2 * 0.99 / free_modes(model)[0].max()
    start, largest = throw(model), 0.0
    for i, state in enumerate(stepped(model, dt, 100_000)):
        if i > 0:
            largest = max(largest, mass_norm(model, state.v.x))
    assert state.step == 100_000
    assert start < largest <= start / np.sqrt(1 - 0.99**2) * (1 + 1e-9)


@pytest.mark.parametrize("element", ELEMENTS)
def test_row_5_just_above_the_limit_the_bar_diverges(element):
    """ω_max dt = 2 · 1.01: growth by exp(2 arcosh 1.01) = 1.33 a step, to 1 %."""
    model = bar(3, 0.3, element)
    dt = 2 * 1.01 / free_modes(model)[0].max()
    throw(model)
    norms = [mass_norm(model, state.v.x) for state in stepped(model, dt, 200)]
    rate = np.log(norms[200] / norms[100]) / 100
    assert rate == pytest.approx(2 * np.arccosh(1.01), rel=0.01)
