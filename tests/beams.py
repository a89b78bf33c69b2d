# SPDX-License-Identifier: LGPL-3.0-or-later
"""A body as a beam: properties of its section, and closed forms to hold three dimensions against.

A section lies in a plane of coordinates (y, z), z up; bending is vertical unless said.
"""

from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import basix.ufl
import dolfinx
import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from scipy.sparse.linalg import spsolve

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class BeamSection:
    """Properties of a section.

    Attributes:
        area: Area [m²].
        centroid: Its centroid, shape ``(2,)`` [m].
        vertical: Second moment about the lateral axis through the centroid [m⁴].
        lateral: Second moment about the vertical axis through the centroid [m⁴].
        torsion: Torsion constant of St. Venant [m⁴].
        shear: Part of the area that carries vertical shear, Timoshenko's κ [-].
    """

    area: float
    centroid: Array
    vertical: float
    lateral: float
    torsion: float
    shear: float


def beam_section(points: Array, quads: npt.NDArray[Any], degree: int = 2) -> BeamSection:
    """Return the properties of a meshed section without holes.

    The torsion constant is ``2 ∫ φ`` of Prandtl's stress function, ``-∇²φ = 2`` and zero on the
    outline. The shear factor equates energies: the shear stress that balances the bending stress
    ``z Q / I`` is ``∇ψ``, ``-∇²ψ = z Q / I`` without flux through the outline, and
    ``1 / κ = A / Q² ∫ |∇ψ|²`` (Pilkey, *Analysis and Design of Elastic Beams*, chapter 6, ν = 0).

    Args:
        points: Nodes, shape ``(n, 2)`` [m].
        quads: Nodes of each quad, counter-clockwise, shape ``(q, 4)``.
        degree: Degree of the finite elements.
    """
    plane = ufl.Mesh(basix.ufl.element("Lagrange", "quadrilateral", 1, shape=(2,)))
    cells = np.asarray(quads, dtype=np.int64)[:, [0, 1, 3, 2]]
    msh = dolfinx.mesh.create_mesh(MPI.COMM_SELF, cells, plane, np.ascontiguousarray(points))
    x, dx = ufl.SpatialCoordinate(msh), ufl.Measure("dx", msh)

    def integral(f: Any) -> float:
        return float(np.real(fem.assemble_scalar(fem.form(f * dx))))

    area = integral(fem.Constant(msh, 1.0))
    y, z = (integral(x[k]) / area for k in range(2))
    vertical, lateral = integral((x[1] - z) ** 2), integral((x[0] - y) ** 2)
    V = fem.functionspace(msh, ("Lagrange", degree))
    msh.topology.create_connectivity(1, 2)
    rim = fem.locate_dofs_topological(V, 1, dolfinx.mesh.exterior_facet_indices(msh.topology))
    phi = poisson(V, fem.Constant(msh, 2.0), rim)
    psi = poisson(V, (x[1] - z) / vertical, np.zeros(1, dtype=np.int32))
    energy = integral(ufl.inner(ufl.grad(psi), ufl.grad(psi)))
    return BeamSection(
        area, np.array([y, z]), vertical, lateral, 2 * integral(phi), 1 / (area * energy)
    )


def poisson(V: Any, source: Any, fixed: npt.NDArray[np.int32]) -> Any:
    """Return the solution of ``-∇²u = source``, zero at the dofs ``fixed``, no flux elsewhere."""
    u, v = ufl.TrialFunction(V), ufl.TestFunction(V)
    A = fem.assemble_matrix(fem.form(ufl.inner(ufl.grad(u), ufl.grad(v)) * ufl.dx)).to_scipy()
    b = fem.assemble_vector(fem.form(source * v * ufl.dx)).array
    free = np.setdiff1d(np.arange(len(b)), fixed)
    out = fem.Function(V)
    out.x.array[:] = 0.0
    out.x.array[free] = spsolve(A.tocsr()[free][:, free].tocsc(), b[free])
    return out


def pinned_frequency(
    section: BeamSection,
    youngs_modulus: float,
    poisson_ratio: float,
    density: float,
    half_wave: float,
) -> float:
    """Return the lowest frequency of a Timoshenko beam whose supports are nodes of a sine [Hz].

    The smaller root ω² of ``E I k⁴ - (ρ A + ρ I (1 + E / κ G) k²) ω² + ρ² I / (κ G) ω⁴ = 0`` with
    ``k = π / half_wave`` (Timoshenko, *Vibration Problems in Engineering*, section on shear and
    rotatory inertia).

    Args:
        section: The section.
        youngs_modulus: E [Pa].
        poisson_ratio: ν [-].
        density: ρ [kg/m³].
        half_wave: Distance of the supports [m].
    """
    k2 = (np.pi / half_wave) ** 2
    E, inertia, A = youngs_modulus, section.vertical, section.area
    kG = section.shear * E / (2 * (1 + poisson_ratio))
    a = density**2 * inertia / kG
    b = density * A + density * inertia * (1 + E / kG) * k2
    c = E * inertia * k2**2
    return float(np.sqrt(2 * c / (b + np.sqrt(b**2 - 4 * a * c))) / (2 * np.pi))


def foundation_deflection(
    force: float, stiffness: float, bending: float, shearing: float = np.inf
) -> float:
    """Return the deflection under a force on an endless beam on an elastic foundation [m].

    The integral over all wave numbers ``w = F/π ∫ dq / (k + (1 / (E I q⁴) + 1 / (κ G A q²))⁻¹)``,
    which for a rigid shear stiffness is Winkler's ``F β / 2k`` with ``β⁴ = k / 4 E I``.

    Args:
        force: F [N].
        stiffness: k of the foundation per length of beam [N/m²].
        bending: E I [N m²].
        shearing: κ G A [N].
    """
    s = bending / shearing
    root = np.sqrt(stiffness * s + 2 * np.sqrt(bending * stiffness))
    return float(force / (2 * root) * (1 / np.sqrt(stiffness) + s / np.sqrt(bending)))
