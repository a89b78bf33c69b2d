# SPDX-License-Identifier: LGPL-3.0-or-later
"""Forms as native code over batches of cells add what ``dolfinx.fem.assemble_vector`` adds."""

import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from mpi4py import MPI

import basix.ufl
import dolfinx
import numpy as np
import pytest
import ufl
from dolfinx import fem
from hypothesis import given, settings
from hypothesis import strategies as st
from ufl import (
    Identity,
    SpatialCoordinate,
    TestFunction,
    atan2,
    conditional,
    cos,
    det,
    dot,
    exp,
    grad,
    inner,
    ln,
    max_value,
    min_value,
    sin,
    sqrt,
    tr,
)

from forms.cells import one_point as one_point_measure
from forms.elasticity import Elastic, full, small_strain, st_venant_kirchhoff
from forms.hourglass import one_point_residual
from forms.kernel import AssembledKernel, CellKernel
from forms.simd.native import NativeKernel, Unsupported, this_host
from meshes.domain import Domain, distribute
from meshes.shapes import blocks

STEEL = Elastic(210.0, 0.3, 7.8)
COMM = MPI.COMM_WORLD if MPI.COMM_WORLD.size > 1 else MPI.COMM_SELF


def box(cells: tuple[int, int, int], seed: int = 1) -> tuple[Domain, Any]:
    """A distorted unit cube with its cells tagged 1, 2, 3 in turn."""
    cube = blocks.block((0, 0, 0), (1, 1, 1), cells=cells)
    domain = distribute(blocks.distorted(cube, amplitude=0.3, seed=seed), COMM)
    imap = domain.msh.topology.index_map(3)
    local = np.arange(imap.size_local + imap.num_ghosts, dtype=np.int32)
    tags = (domain.msh.topology.original_cell_index % 3 + 1).astype(np.int32)
    return domain, dolfinx.mesh.meshtags(domain.msh, 3, local, tags)


def field(domain: Domain, element: Any, seed: int, *, offset: float = 0.0) -> fem.Function:
    """A random field that does not depend on the partition: smooth in the coordinates."""
    f = fem.Function(fem.functionspace(domain.msh, element))
    k = np.random.default_rng(seed).uniform(-4, 4, (f.function_space.dofmap.bs, 3))
    f.interpolate(lambda x: offset + 0.1 * np.sin(k @ x))
    return f


P1, P2, DG0, DG1 = ("Lagrange", 1), ("Lagrange", 2), ("DG", 0), ("DG", 1, (3,))
VECTOR = ("Lagrange", 1, (3,))


def tags_and_degrees(domain: Domain, tags: Any, seed: int) -> Any:
    """Several tags, tag sets, everywhere, and quadrature degrees in one form."""
    u, v, w = field(domain, VECTOR, seed), field(domain, VECTOR, seed + 1), TestFunction(domain.V)
    soft = Elastic(70.0, 0.2, 2.7, damping=0.1)
    dx, g = full(domain.msh, tags), fem.Constant(domain.msh, np.array([0.1, -0.2, -9.81]))
    return (
        st_venant_kirchhoff(u, w, soft, v) * dx(1)
        + small_strain(u, w, STEEL) * dx((2, 3))
        + 7.8 * inner(g, w) * dx(metadata={"quadrature_degree": 3})((1, 3))
        + inner(u, w) * dx(metadata={"quadrature_degree": 1})
    )


def neo_hookean(domain: Domain, tags: Any, seed: int) -> Any:
    """Derivative of an energy with constants, a logarithm and powers of the determinant."""
    u, w = field(domain, VECTOR, seed), TestFunction(domain.V)
    mu, lmbda = fem.Constant(domain.msh, 80.0 + seed), fem.Constant(domain.msh, 120.0)
    F = Identity(3) + grad(u)
    J = det(F)
    energy = mu / 2 * (J ** (-2 / 3) * inner(F, F) - 3) - mu * ln(J) + lmbda / 2 * ln(J) ** 2
    return ufl.derivative(energy * full(domain.msh, tags)(2), u, w)


def functions(domain: Domain, tags: Any, seed: int) -> Any:
    """Scalar P1 and DG0 coefficients, the coordinates, conditionals and elementary functions."""
    p, q, w = field(domain, P1, seed), field(domain, DG0, seed, offset=1.5), TestFunction(domain.V)
    x, one = SpatialCoordinate(domain.msh), fem.Constant(domain.msh, 1.0)
    plastic = conditional(ufl.And(p > 0, ufl.Not(q < 1.5)), sqrt(q), exp(-p))
    angle = atan2(x[1] + 1, p + 2) * sin(x[0]) + cos(3 * p) ** 3 + abs(p) + q**1.7 + 2**p
    ends = max_value(p, 0.01) * min_value(q, 1.5) + conditional(ufl.le(one, 2 * one), 1, 0) / q**2
    other = conditional(ufl.Or(ufl.eq(q, p), ufl.ne(one, 1)), 2 * p, ufl.tanh(p) + ufl.erf(q))
    return (plastic * w[0] + angle * w[1] + (ends + other) * w[2]) * full(domain.msh)


def quadrature_history(domain: Domain, tags: Any, seed: int) -> Any:
    """A stress that is kept at the quadrature points, with a second rule on one tag."""
    kept = basix.ufl.quadrature_element("hexahedron", value_shape=(3, 3), degree=2)
    stress = fem.Function(fem.functionspace(domain.msh, kept))
    stress.x.array[:] = np.resize(np.random.default_rng(seed).random(9), stress.x.array.shape)
    w = TestFunction(domain.V)
    return inner(stress, grad(w)) * full(domain.msh) + w[1] * full(domain.msh, tags)(
        1, metadata={"quadrature_degree": 5}
    )


def broken_stiffness(domain: Domain, tags: Any, seed: int) -> Any:
    """A column of the tangent on a discontinuous space, as the step bound takes it."""
    u, du = field(domain, DG1, seed), field(domain, DG1, seed + 1)
    w = TestFunction(u.function_space)
    return ufl.derivative(st_venant_kirchhoff(u, w, STEEL) * full(domain.msh), u, du)


def scalar_diffusion(domain: Domain, tags: Any, seed: int) -> Any:
    """A scalar test function of degree 2 and its coefficient: tables without factors."""
    p = field(domain, P2, seed)
    k, w = field(domain, DG0, seed, offset=1.0), TestFunction(p.function_space)
    return (
        k * dot(grad(p), grad(w)) * ufl.dx + (tr(grad(SpatialCoordinate(domain.msh)))) * w * ufl.dx
    )


def one_point(domain: Domain, tags: Any, seed: int) -> Any:
    """One quadrature point, and second derivatives on the reference cell."""
    u, w = field(domain, VECTOR, seed), TestFunction(domain.V)
    dx = ufl.dx(domain=domain.msh, metadata={"quadrature_degree": 1})
    hourglass = inner(grad(grad(u)), grad(grad(w)))
    return small_strain(u, w, STEEL) * dx + hourglass * dx


def hourglass_control(domain: Domain, tags: Any, seed: int) -> Any:
    """One point with damping and both kinds of control, on parts of the mesh."""
    u, v, w = field(domain, VECTOR, seed), field(domain, VECTOR, seed + 1), TestFunction(domain.V)
    soft, dx = Elastic(70.0, 0.2, 2.7, damping=0.1), one_point_measure(full(domain.msh, tags))
    fraction = one_point_residual(small_strain, rotating=False, coefficient=0.1)
    return one_point_residual(st_venant_kirchhoff)(u, w, soft, v) * dx(1) + fraction(
        u, w, STEEL
    ) * dx((2, 3))


FAMILY: list[Callable[[Domain, Any, int], Any]] = [
    tags_and_degrees,
    neo_hookean,
    functions,
    quadrature_history,
    broken_stiffness,
    scalar_diffusion,
    one_point,
    hourglass_control,
]


def assembled(form: Any) -> np.ndarray:
    """What DOLFINx assembles on this rank's cells."""
    return fem.assemble_vector(fem.form(form)).array


def difference(form: Any, dtype: Any = np.float64) -> float:
    """Largest difference between native and assembled entries over the largest entry."""
    expected = assembled(form)
    out = np.zeros_like(expected)
    NativeKernel(form, dtype).add(out)
    return float(np.abs(out - expected).max() / (np.abs(expected).max() or 1.0))


@pytest.mark.parametrize("form", FAMILY)
def test_agrees_with_dolfinx_to_round_off(form):
    """Random fields on random meshes, whose numbers of cells fill the lanes or do not."""

    @settings(max_examples=8, deadline=None, derandomize=True)
    @given(st.tuples(*[st.integers(1, 4)] * 3), st.integers(0, 1000))
    def agrees(cells, seed):
        domain, tags = box(cells, seed)
        assert difference(form(domain, tags, seed)) < 1e-13

    agrees()


@pytest.mark.parametrize("form", [tags_and_degrees, functions])
def test_single_precision_agrees_to_its_own_round_off(form):
    """The arrays stay in double precision; the error is that of the arithmetic."""
    domain, tags = box((3, 3, 3))
    assert 1e-9 < difference(form(domain, tags, 3), np.float32) < 1e-5


@pytest.mark.parametrize("form", [st_venant_kirchhoff, one_point_residual(st_venant_kirchhoff)])
def test_single_precision_far_from_the_origin_and_displaced(form):
    """Cells of 1 mm, 5 m away, moved by 0.2 m: strains of 1e-4 as near the origin, 1e-6.

    Absolute positions and displacements in single precision would be off by 1e-1.
    """
    cube = blocks.block((0, 0, 0), (6e-3,) * 3, cells=(6, 6, 6))
    domain = distribute(blocks.distorted(cube, amplitude=0.3, seed=1), COMM)
    u, w = fem.Function(domain.V), TestFunction(domain.V)
    k = 600 * np.random.default_rng(1).uniform(-1, 1, (3, 3))
    u.interpolate(lambda x: np.array([[0.2], [-0.1], [0.06]]) + 2e-7 * np.sin(k @ x))
    domain.msh.geometry.x[:] += np.array([5.0, 3.5, -2.0])
    full_points = form is st_venant_kirchhoff
    dx = full(domain.msh) if full_points else one_point_measure(full(domain.msh))
    assert 1e-9 < difference(form(u, w, STEEL) * dx, np.float32) < 1e-6


def test_single_precision_keeps_values_that_are_used_themselves():
    """A form of u, ∇p, x: u and x stay what they are; near the origin all are right to 1e-6."""
    domain, _ = box((3, 3, 3))
    u, p = field(domain, VECTOR, 1, offset=2.0), field(domain, P1, 2, offset=30.0)
    w, x = TestFunction(domain.V), SpatialCoordinate(domain.msh)
    form = (inner(u + x, w) + dot(grad(p), w) + inner(grad(u), grad(w))) * full(domain.msh)
    assert 1e-9 < difference(form, np.float32) < 1e-6


@pytest.mark.parametrize("width", [16, 32, 64])
@pytest.mark.parametrize("dtype, tolerance", [(np.float64, 1e-13), (np.float32, 1e-5)])
def test_registers_of_any_width(monkeypatch, width, dtype, tolerance):
    """Lanes of SSE2 and NEON, AVX2, and AVX-512: the compiler splits what the machine lacks."""
    host = replace(this_host(), vector_bytes=width)
    monkeypatch.setattr("forms.simd.native.this_host", lambda: host)
    domain, tags = box((3, 3, 3))
    assert difference(tags_and_degrees(domain, tags, 3), dtype) < tolerance


def test_one_cell_that_has_no_tag_of_the_form():
    """A batch with one cell; an integral without cells adds nothing."""
    domain, _ = box((1, 1, 1))
    tags = dolfinx.mesh.meshtags(domain.msh, 3, np.array([0], np.int32), np.array([7], np.int32))
    w = TestFunction(domain.V)
    dx = full(domain.msh, tags)
    assert difference(w[0] * dx(7)) < 1e-13
    out = np.zeros(24)
    NativeKernel(w[0] * dx(5)).add(out)
    np.testing.assert_array_equal(out, 0.0)


def test_new_values_of_coefficients_constants_and_coordinates_are_seen():
    """∫ c p over a unit cube, whose constant, coefficient and coordinates change."""
    domain, _ = box((2, 2, 2))
    p, c = field(domain, P1, 0), fem.Constant(domain.msh, 2.0)
    kernel = NativeKernel(c * p * TestFunction(p.function_space) * ufl.dx)
    for value, size in ((3.0, 1.0), (5.0, 1.0), (5.0, 2.0)):
        p.x.array[:] = value
        c.value = value
        domain.msh.geometry.x[:] *= size
        out = np.zeros_like(p.x.array)
        kernel.add(out)
        np.testing.assert_allclose(out.sum(), value**2 * size**3, rtol=1e-13)


def test_values_come_in_order_as_arrays_functions_or_their_own():
    """∫ (2 a + 3 b) for constant a and b; what was given is kept."""
    domain, _ = box((2, 2, 2))
    a, b, w = fem.Function(domain.V), fem.Function(domain.V), TestFunction(domain.V)
    kernel = NativeKernel(inner(2 * a + 3 * b, w) * full(domain.msh))
    other = fem.Function(domain.V)
    other.x.array[:] = 10.0
    out = dolfinx.la.vector(domain.V.dofmap.index_map, 3)
    ones = np.ones_like(out.array)
    for values, expected in (((1.0, other), 32), ((other, ones), 23), ((), 23), ((a, b), 23)):
        out.array[:] = 1.0
        kernel.add(*values, out)
        total = (out.array - 1).reshape(-1, 3).sum(axis=0)
        np.testing.assert_allclose(total, [expected] * 3, rtol=1e-12)
    with pytest.raises(ValueError, match="expected none or 2, got 1"):
        kernel.add(a, out)


@pytest.mark.parametrize("out", [np.zeros(81, np.float32), np.zeros(80), np.zeros((27, 3))])
def test_an_array_that_does_not_fit_is_refused(out):
    """Nothing is written through a wrong pointer."""
    domain, _ = box((2, 2, 2))
    kernel = NativeKernel(TestFunction(domain.V)[0] * full(domain.msh))
    with pytest.raises(ValueError, match=r"out: expected float64 \(81,\), got"):
        kernel.add(out)


GUARDED = """
import ctypes, mmap, sys
sys.path.insert(0, {root!r})
from tests.forms.test_native import *
domain, _ = box((3, 3, 3))
u, w = field(domain, VECTOR, 1), TestFunction(domain.V)
form = st_venant_kirchhoff(u, w, STEEL) * full(domain.msh)
out, expected = np.zeros(u.x.array.shape), assembled(form)
kernel = NativeKernel(form, np.{dtype})
addresses, kept = kernel._keep[-1], []
libc = ctypes.CDLL(None, use_errno=True)
for entry, array in ((2, domain.msh.geometry.x.ravel()), (5, u.x.array)):
    pages = -(-array.nbytes // mmap.PAGESIZE)
    memory = mmap.mmap(-1, (pages + 1) * mmap.PAGESIZE)
    start = ctypes.addressof(ctypes.c_char.from_buffer(memory))
    guard = start + pages * mmap.PAGESIZE
    assert libc.mprotect(ctypes.c_void_p(guard), mmap.PAGESIZE, 0) == 0  # PROT_NONE
    copy = np.frombuffer(memory, np.float64, array.size, pages * mmap.PAGESIZE - array.nbytes)
    copy[:] = array
    assert addresses[entry] == array.ctypes.data and guard == copy.ctypes.data + copy.nbytes
    addresses[entry] = copy.ctypes.data
    kept += [memory, copy]
kernel.add(out)
assert np.abs(out - expected).max() < 1e-5 * np.abs(expected).max()
print("read what is there", flush=True)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="protects a page of memory")
@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_nothing_behind_an_array_is_read(dtype):
    """Coordinates and displacement end where a forbidden page begins: no fault."""
    code = GUARDED.format(root=str(Path(__file__).parents[2]), dtype=dtype)
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert "read what is there" in done.stdout, done.stderr


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_nan_reaches_the_force_of_its_own_node_and_no_far_one(bad):
    """Fast-math, but the guards that look for NaN still find it."""
    domain, tags = box((3, 3, 3))
    form = tags_and_degrees(domain, tags, 1)
    (u, _) = form.coefficients()
    along = domain.V.tabulate_dof_coordinates().sum(axis=1)
    corner, far = int(np.argmin(along)), int(np.argmax(along))
    u.x.array[3 * corner] = bad
    out = np.zeros_like(u.x.array)
    NativeKernel(form).add(out)
    assert not np.isfinite(out[3 * corner])
    assert np.isfinite(out.reshape(-1, 3)[far]).all()


def test_compiled_once(monkeypatch):
    """The second kernel of a form comes from the cache on disk."""
    domain, tags = box((2, 2, 2))
    NativeKernel(tags_and_degrees(domain, tags, 0))
    monkeypatch.setattr("ffcx.codegeneration.jit._compile_objects", None)
    NativeKernel(tags_and_degrees(domain, tags, 5))


def test_what_is_beyond_the_engine_is_refused():
    """Each with its reason, and as a ValueError."""
    domain, _ = box((2, 2, 2))
    w, edge = TestFunction(domain.V), fem.functionspace(domain.msh, ("N1curl", 1))
    tets = dolfinx.mesh.create_unit_cube(COMM, 1, 1, 1)
    plain = ufl.Coefficient(domain.V)
    for form, reason in (
        (w[0] * ufl.dx + w[0] * ufl.ds, r"cell integrals only, got \['cell', 'exterior_facet'\]"),
        (inner(ufl.TrialFunction(domain.V), w) * ufl.dx, "rank 1 .* got rank 2"),
        (fem.Function(domain.V)[0] * ufl.dx, "rank 1 .* got rank 0"),
        (TestFunction(edge)[0] * ufl.dx, "plain dofs"),
        (TestFunction(fem.functionspace(tets, P1)) * ufl.dx, "hexahedra, got 1 of tetrahedron"),
        (plain[0] * w[0] * ufl.dx, "expected a Function"),
    ):
        with pytest.raises(Unsupported, match=reason):
            NativeKernel(form)
    with pytest.raises(Unsupported, match="float64 or float32, got complex128"):
        NativeKernel(w[0] * ufl.dx, np.complex128)


def test_the_engine_says_why_another_was_taken():
    """Tetrahedra are assembled by DOLFINx; hexahedra need no reason."""
    tets = dolfinx.mesh.create_unit_cube(COMM, 2, 2, 2)
    refused = CellKernel(TestFunction(fem.functionspace(tets, P1)) * ufl.dx)
    assert isinstance(refused.engine, AssembledKernel)
    assert "hexahedra, got 1 of tetrahedron" in str(refused.engine.reason)
    taken = CellKernel(TestFunction(box((2, 2, 2))[0].V)[0] * ufl.dx)
    assert isinstance(taken.engine, NativeKernel) and taken.engine.reason is None


def test_sum_over_ranks_after_reverse_scatter():
    """Force resultants and norm do not depend on the partition (numbers of a serial run)."""
    domain, _ = box((4, 4, 4), seed=7)
    u, w = field(domain, VECTOR, 2), TestFunction(domain.V)
    out = dolfinx.la.vector(domain.V.dofmap.index_map, 3)
    out.array[:] = 0.0
    NativeKernel(st_venant_kirchhoff(u, w, STEEL) * full(domain.msh)).add(out)
    out.scatter_reverse(dolfinx.la.InsertMode.add)
    owned = out.array[: 3 * domain.owned]
    serial = fem.form(_on_one_rank(u_seed=2), dtype=np.float64)
    vector = fem.assemble_vector(serial).array
    norm = np.sqrt(COMM.allreduce(float(owned @ owned)))
    np.testing.assert_allclose(norm, np.linalg.norm(vector), rtol=1e-12)
    nodes = domain.nodes[: domain.owned]
    np.testing.assert_allclose(
        owned.reshape(-1, 3), _by_node(vector)[nodes], atol=1e-13 * np.abs(vector).max()
    )


def _alone() -> Domain:
    """The mesh of the test above on every rank by itself."""
    cube = blocks.block((0, 0, 0), (1, 1, 1), cells=(4, 4, 4))
    return distribute(blocks.distorted(cube, amplitude=0.3, seed=7), MPI.COMM_SELF)


def _on_one_rank(u_seed: int) -> Any:
    domain = _alone()
    u, w = field(domain, VECTOR, u_seed), TestFunction(domain.V)
    return st_venant_kirchhoff(u, w, STEEL) * full(domain.msh)


def _by_node(vector: np.ndarray) -> np.ndarray:
    domain = _alone()
    ordered = np.empty((len(domain.nodes), 3))
    ordered[domain.nodes] = vector.reshape(-1, 3)
    return ordered


@pytest.mark.mpi
@pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="is itself on ranks")
def test_sums_and_domains_also_hold_on_ranks(tests_on):
    """Tests of this file under ``mpiexec``: each rank adds its own cells, ghosts not."""
    tests_on(2, __file__, "-k", "ranks or single_precision or compiled_once")
