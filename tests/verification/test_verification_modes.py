# SPDX-License-Identifier: LGPL-3.0-or-later
"""Verification rows 20 and 21: rail as a beam, modes of the wheel; frequencies of row 4."""

import functools

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest

from forms.elasticity import Elastic, full
from forms.elements import LAWS, internal_work
from forms.kernel import compiled
from forms.mass import lumped_mass
from meshes.domain import Domain, distribute
from meshes.generate.sweep import extrude
from meshes.hexmesh import HexMesh, boundary
from meshes.shapes.blocks import block
from meshes.tags import Tag
from meshes.wheel_rail.rail_section import rail_section
from tests.beams import beam_section, foundation_deflection, pinned_frequency
from workflow import Scene
from workflow.modes.modes import modes
from workflow.modes.solve import spectrum

STEEL = Elastic(210e9, 0.3, 7800.0)
SPAN = 0.6  # of sleepers [m]


def rail_of(stations: np.ndarray) -> tuple[HexMesh, object]:
    """An upright 54E1 rail with its top at z = 0 and nodes at some stations, and its section."""
    section = rail_section(4e-3, 1)[0]
    swept = extrude(section, stations)
    points = swept.params[:, [2, 0, 1]]  # x, y, z
    facets = boundary(swept.cells)
    tags = np.full(len(facets), Tag.RAIL_SKIN, dtype=np.int32)
    regions = np.full(len(swept.cells), Tag.RAIL_HEAD, dtype=np.int32)
    mesh = HexMesh(np.ascontiguousarray(points), swept.cells, regions, facets, tags)
    return mesh, beam_section(section.points, section.quads)


def assembled(domain: Domain, element: str) -> tuple[PETSc.Mat, np.ndarray]:
    """Stiffness of steel, and lumped mass of the nodes."""
    import ufl
    from dolfinx import fem
    from dolfinx.fem.petsc import assemble_matrix

    u, w, dx = fem.Function(domain.V), ufl.TestFunction(domain.V), full(domain.msh, domain.regions)
    work = internal_work(element, LAWS["small-strain"], u, w, STEEL, dx)
    K = assemble_matrix(compiled(ufl.derivative(work, u, ufl.TrialFunction(domain.V))))
    K.assemble()
    tags = tuple(np.unique(domain.source.regions).tolist())
    return K, lumped_mass(domain.V, dx, {tags: STEEL.rho})[::3]


def test_section_of_a_rectangle():
    """20 x 50 mm: area, b h³/12, h b³/12, torsion 0.2493 h b³ (Timoshenko, h/b = 2.5), κ = 5/6."""
    b, h = 0.02, 0.05
    box = block((0, 0, 0), (1, b, h), cells=(1, 8, 8))
    start = box.points[:, 0] == 0
    number = np.cumsum(start) - 1
    quads = boundary(box.cells)
    quads = number[quads[start[quads].all(axis=1)]][:, ::-1]  # seen from +x
    s = beam_section(box.points[start][:, 1:], quads)
    got = s.area, s.vertical, s.lateral, s.torsion, s.shear
    want = b * h, b * h**3 / 12, h * b**3 / 12, 0.2493 * h * b**3, 5 / 6
    np.testing.assert_allclose(got, want, rtol=5e-4)


def test_section_of_the_rail():
    """54E1 of EN 13674-1: 69.77 cm², 2337.9 and 419.2 cm⁴; κ of rails 0.34 to 0.41 (literature)."""
    _, s = rail_of(np.array([0.0, 1.0]))
    want = 69.77e-4, 2337.9e-8, 419.2e-8
    np.testing.assert_allclose((s.area, s.vertical, s.lateral), want, rtol=1e-2)
    assert 0.34 < s.shear < 0.41


@pytest.mark.slow
@pytest.mark.parametrize("element", ["full", "one-point"])
def test_row_20_pinned_pinned_mode_of_a_span(element):
    """A rail whose supports are nodes of a sine: a Timoshenko beam of the same section.

    Antisymmetry about the sections over the sleepers: they move along the rail only.
    """
    mesh, section = rail_of(np.linspace(0, SPAN, 21))
    domain = distribute(mesh, MPI.COMM_SELF)
    K, mass = assembled(domain, element)
    x = domain.V.tabulate_dof_coordinates()
    ends = np.flatnonzero((x[:, 0] < 1e-9) | (x[:, 0] > SPAN - 1e-9))
    held = np.concatenate([3 * ends + 1, 3 * ends + 2])
    found = spectrum(domain, K, mass, held, 1500.0, 50)
    share = np.einsum("kni,n->ki", found.shapes**2, mass)
    vertical = found.frequencies[np.argmax(share[:, 2] / share.sum(axis=1))]
    beam = pinned_frequency(section, STEEL.E, STEEL.nu, STEEL.rho, SPAN)
    assert abs(vertical / beam - 1) < 0.02
    assert 950 < beam < 1100


@pytest.mark.slow
def test_row_20_pinned_pinned_mode_on_the_sleepers():
    """Four spans held by lines of the foot, the rail going on beyond: supports are nodes, 2 %.

    Among the modes that bend between the sleepers it is the one nearest to ``sin πx/0.6``.
    """
    spans = 4
    mesh, section = rail_of(np.linspace(0, spans * SPAN, 20 * spans + 1))
    domain = distribute(mesh, MPI.COMM_SELF)
    K, mass = assembled(domain, "one-point")
    x = domain.V.tabulate_dof_coordinates()
    over = np.abs(x[:, 0] / SPAN - np.round(x[:, 0] / SPAN)) < 1e-9
    ends = np.flatnonzero((x[:, 0] < 1e-9) | (x[:, 0] > spans * SPAN - 1e-9))
    feet = np.flatnonzero(over & (x[:, 2] < x[:, 2].min() + 1e-9))
    held = np.unique(np.concatenate([3 * ends + 1, 3 * ends + 2, 3 * feet + 2]))
    found = spectrum(domain, K, mass, held, 1300.0, 100)
    wave = np.sin(np.pi * x[:, 0] / SPAN) * mass
    like = np.abs(found.shapes[:, :, 2] @ wave) / np.sqrt(wave @ np.sin(np.pi * x[:, 0] / SPAN))
    k = int(np.argmax(like))
    beam = pinned_frequency(section, STEEL.E, STEEL.nu, STEEL.rho, SPAN)
    assert like[k] > 0.8
    assert abs(found.frequencies[k] / beam - 1) < 0.02


@pytest.mark.slow
@pytest.mark.parametrize("seats", [False, pytest.param(True, marks=pytest.mark.long)])
def test_row_20_deflection_on_a_foundation(seats):
    """10 m of rail on springs of the track, 100 kN in the middle: an endless beam, 3 %.

    Springs under the whole foot, or on seats of 0.15 m every 0.6 m, the force then averaged over
    above a sleeper and between two.
    """
    stiffness = 1 / (1 / 1300e6 + 1 / 45e6) / SPAN
    places = (0.0, SPAN / 2) if seats else (0.0,)
    got = [deflection(stiffness, seats, force_at) for force_at in places]
    _, section = rail_of(np.array([0.0, 1.0]))
    bending, shearing = STEEL.E * section.vertical, section.shear * STEEL.mu * section.area
    assert abs(np.mean(got) / foundation_deflection(1e5, stiffness, bending, shearing) - 1) < 0.03


def deflection(stiffness: float, seats: bool, force_at: float) -> float:
    """Mean deflection of the loaded section of 10 m of rail on springs [m]."""
    near = np.linspace(0, 0.45, 19)
    far = np.linspace(0.45, 5.0, 92)[1:]
    half = np.concatenate([near, far]) if not seats else np.arange(0, 5.0001, 0.025)
    mesh, _ = rail_of(np.concatenate([-half[:0:-1], half]))
    domain = distribute(mesh, MPI.COMM_SELF)
    K, mass = assembled(domain, "one-point")
    x = domain.V.tabulate_dof_coordinates()
    foot = np.flatnonzero(x[:, 2] < x[:, 2].min() + 1e-9)
    along, column = np.unique(np.round(x[foot, 0], 9), return_inverse=True)
    per = stiffness * np.gradient(along)  # of each row of nodes
    per[[0, -1]] /= 2
    if seats:
        from_seat = np.abs(along - SPAN * np.round(along / SPAN))
        per = np.where(from_seat < 0.0751, 1.0, 0.0)
        sleeper = np.round(along / SPAN).astype(int)
        sleeper -= sleeper.min()
        per *= (stiffness * SPAN / np.bincount(sleeper, per))[sleeper]
    nodes = np.bincount(column)
    diagonal = K.getDiagonal()
    diagonal.array[3 * foot + 2] += (per / nodes)[column]
    diagonal.array[3 * foot] += 1e3  # no rigid motion
    diagonal.array[3 * foot + 1] += 1e3
    K.setDiagonal(diagonal)
    loaded = np.abs(x[:, 0] - force_at) < 1e-9
    b, u = K.createVecLeft(), K.createVecRight()
    b.array[3 * np.flatnonzero(loaded) + 2] = -1e5 * mass[loaded] / mass[loaded].sum()
    ksp = PETSc.KSP().create(MPI.COMM_SELF)
    ksp.setOperators(K)
    ksp.setType("preonly")
    ksp.pc.setType("cholesky")
    ksp.pc.setFactorSolverType("mumps")
    ksp.solve(b, u)
    assert ksp.is_converged
    return -float(u.array[2::3][loaded] @ mass[loaded] / mass[loaded].sum())


def test_row_4_bar_frequencies():
    """``bar-wave``: the axial modes are ``(2k - 1) c / 4L``, lower by the cells of second order."""
    found = modes(Scene.load("bar-wave"), comm=MPI.COMM_SELF, top=70e3)
    axial = [m.frequency for m in found.modes if m.kind == "along x" and m.shares["x"] > 0.99]
    c = np.sqrt(210e9 / 7800)
    np.testing.assert_allclose(axial, (2 * np.arange(1, 4) - 1) * c / 0.4, rtol=2e-3)
    assert [m.kind for m in found.modes[:4]].count("rigid") == 3


@functools.cache
def wheel(layers: int, top: float, **changes):
    """Modes of the wheel of ``flange-transition`` with so many cells across its web."""
    keys = {"bodies.wheelset.element": "one-point"}
    scene = Scene.load("flange-transition", **keys)
    return modes(scene, comm=MPI.COMM_SELF, top=top, size=0.026 / layers, **changes)


@pytest.mark.long
@pytest.mark.slow
def test_row_21_clamped_wheel():
    """Bore clamped, up to 2.6 kHz, 2 and 3 cells across the web, order 2 in their size.

    What they lead to is within 1 % of the independent axisymmetric Fourier elements, mode by mode
    of the same nodal diameters and the same motion of the rim; the finer mesh is within 1.5 %.
    """
    coarse, fine = (wheel(layers, 2600.0) for layers in (2, 3))
    assert [m.diameters for m in coarse.modes[:20]] == [m.diameters for m in fine.modes[:20]]
    expected = dict.fromkeys(m.number for m in fine.modes)
    expected |= {row["number"]: row["independent"] for row in fine.summary["modes"]}
    rim = {f: kind for _, f, kind in fine.reference}
    for a, b in zip(coarse.modes[:20], fine.modes[:20], strict=True):
        limit = b.frequency + (b.frequency - a.frequency) / (3**2 / 2**2 - 1)
        assert abs(limit / expected[b.number] - 1) < 0.01, (a, b)
        assert abs(b.frequency / limit - 1) < 0.015, (a, b)
        assert b.kind == rim[expected[b.number]], b
        assert b.purity > 0.999, b


def test_row_21_pairs_of_the_wheel():
    """All modes with n > 0 come in pairs, split by less than 0.1 %; by nothing if all is even."""
    found = wheel(2, 1000.0).modes
    assert [m.diameters for m in found] == [1, 1, 0, 2, 2, 0, 3, 3]
    assert [m.circles for m in found if m.kind == "axial"] == [0] * 7
    for mode in found:
        assert (mode.partner is not None) == (mode.diameters > 0)
        assert mode.partner is None or (mode.split < 1e-8)


def test_row_21_free_wheel():
    """Six motions at rest; then (2, 0) near that of the clamped wheel: a mode of the rim alone."""
    found = wheel(2, 500.0, held="free").modes
    assert [m.kind for m in found].count("rigid") == 6 == sum(m.frequency < 0.1 for m in found)
    free = next(m for m in found if m.diameters == 2)
    clamped = next(m for m in wheel(2, 1000.0).modes if m.diameters == 2)
    assert abs(free.frequency / clamped.frequency - 1) < 0.02
