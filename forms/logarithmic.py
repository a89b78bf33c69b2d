# SPDX-License-Identifier: LGPL-3.0-or-later
"""Logarithmic elastic strain and its stress: Hencky's law, in UFL.

The strain ``ln(Fᵀ F) / 2`` is good to 1e-9 at strains of 6 % and to 1e-6 at 20 %, at rotations of
any size. The law is that of Hooke for this strain and the Mandel stress: what laws with a memory
have at large strain before anything has yielded.
"""

from collections.abc import Callable
from typing import Any

from ufl import Identity, as_matrix, dev, dot, grad, inner, sym

from forms.elasticity import Elastic
from forms.materials import VOIGT, hooke_energy


def logarithm(A: Any) -> Any:
    """Return ``ln(Fᵀ F) / 2`` for ``F = I + A``."""
    return half_logarithm(sym(A) + dot(A.T, A) / 2)


def half_logarithm(E: Any) -> Any:
    """Return ``ln(I + 2 E) / 2`` of a symmetric tensor, of relative error ``E⁶ / 44``.

    Padé's approximant of degree three over three: an impact strains a cell by several per cent in
    one step, of which a series of as many products would leave 1e-4 of the flow stress.
    """
    EE = square(E)
    EEE = product(EE, E)
    above = E + 2 * EE + 11 / 15 * EEE
    below = Identity(3) + 3 * E + 12 / 5 * EE + 2 / 5 * EEE
    return product(above, inverse(below))


def inverse(A: Any) -> Any:
    """Return the inverse of a symmetric tensor."""
    cofactors = symmetric(
        lambda i, j: (
            A[(i + 1) % 3, (j + 1) % 3] * A[(i + 2) % 3, (j + 2) % 3]
            - A[(i + 1) % 3, (j + 2) % 3] * A[(i + 2) % 3, (j + 1) % 3]
        )
    )
    return cofactors / sum(A[0, k] * cofactors[0, k] for k in range(3))


def pulled_back(M: Any, L: Any) -> Any:
    """Return ``C⁻¹ M`` with ``C = exp 2 L``, the second Piola–Kirchhoff stress of a Mandel stress.

    Args:
        M: Mandel stress, which commutes with L [Pa].
        L: Logarithmic strain.
    """
    LL = square(L)
    return M - 2 * product(L - LL + 2 / 3 * product(LL, L), M)


def hencky(u: Any, w: Any, material: Elastic, v: Any = None) -> Any:
    """Internal virtual work of Hooke's law for the logarithmic strain.

    The damping stress is that of :func:`forms.elasticity.st_venant_kirchhoff`.
    """
    return _work(u, w, material, v, lambda strain: strain)


def shape_hencky(u: Any, w: Any, material: Elastic, v: Any = None) -> Any:
    """The same with the volume change left out, for the full measure."""
    return _work(u, w, material, v, dev)


def hencky_energy(u: Any, material: Elastic) -> Any:
    """Energy density of the logarithmic strain [J/m³]."""
    return hooke_energy(logarithm(grad(u)), material)


def shape_hencky_energy(u: Any, material: Elastic) -> Any:
    """Energy density of its deviator [J/m³]."""
    return hooke_energy(dev(logarithm(grad(u))), material)


def _work(u: Any, w: Any, material: Elastic, v: Any, part: Callable[[Any], Any]) -> Any:
    """Virtual work of the stress of a part of the strain."""
    F, L = Identity(3) + grad(u), logarithm(grad(u))
    P = dot(F, pulled_back(material.stress(part(L)), L))
    if v is not None:
        P += material.damping * dot(F, material.stress(part(sym(dot(F.T, grad(v))))))
    return inner(P, grad(w))


def product(A: Any, B: Any) -> Any:
    """Return the symmetric part of ``A B`` of symmetric tensors, which is all if they commute."""
    return symmetric(lambda i, j: sum(A[i, k] * B[k, j] for k in range(3)))


def symmetric(entry: Callable[[int, int], Any]) -> Any:
    """Return a symmetric tensor, of which only six entries are computed."""
    entries = {key: entry(*key) for key in VOIGT}
    return as_matrix([[entries[min(i, j), max(i, j)] for j in range(3)] for i in range(3)])


def square(A: Any) -> Any:
    """Return ``A A`` of a symmetric tensor."""
    return product(A, A)
