# SPDX-License-Identifier: LGPL-3.0-or-later
"""Material laws with a memory: history variables and their update in UFL.

A law is written at small strain, as three functions of UFL expressions: which history variables it
has, what stress and which new values of them follow from a strain, and what energy they hold. It is
evaluated at every quadrature point, inside the kernel that sums the forces
(:mod:`forms.material_points`).

Bodies that turn or flow use the same law at large strain: the deformation gradient is split into
``F = F_e F_p``, the plastic part ``F_p`` is kept in the memory, and the law sees the logarithmic
elastic strain ``ln(F_eᵀ F_e) / 2`` of the trial state, without plastic strain. What it adds to the
plastic strain turns into ``F_p ← exp(Δε_p) F_p``; the stress it returns is the Mandel stress
(Eterovic and Bathe, Int. J. Numer. Meth. Engng 30, 1990, 1099–1114; Weber and Anand, Comput.
Methods Appl. Mech. Engng 79, 1990, 173–202). No rotation changes anything in the memory, and the
plastic flow keeps the volume. The elastic strain must be small (:mod:`forms.logarithmic`); flow may
come to any amount.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from ufl import Identity, as_matrix, as_vector, dev, dot, sym
from ufl.classes import Zero

from forms.logarithmic import logarithm, product, pulled_back, square, symmetric
from forms.materials import VOIGT

PLASTIC = "plastic_strain"
EQUIVALENT = "equivalent_plastic_strain"
FLOW = "plastic_flow"  # F_p⁻¹ − I, in place of the plastic strain where strains are large


@dataclass(frozen=True)
class Variable:
    """A history variable at a material point: a number, several, a symmetric tensor or a tensor.

    Attributes:
        shape: ``()``, ``(n,)`` or ``(3, 3)``.
        symmetric: Whether six numbers stand for a tensor.
        initial: Its value at the start; times the identity if it is a tensor.
    """

    shape: tuple[int, ...] = ()
    symmetric: bool = False
    initial: float = 0.0

    def __post_init__(self) -> None:
        if len(self.shape) > 1 and self.shape != (3, 3):
            raise ValueError(
                f"history variable: expected shape (), (n,) or (3, 3), got {self.shape}"
            )

    @property
    def entries(self) -> tuple[tuple[int, ...], ...]:
        """Indices of the numbers that are kept."""
        if len(self.shape) < 2:
            return tuple(np.ndindex(self.shape))
        return VOIGT if self.symmetric else tuple(np.ndindex(3, 3))

    def tensor(self, numbers: list[Any]) -> Any:
        """Return the value that the kept numbers stand for."""
        if len(self.shape) < 2:
            return as_vector(numbers) if self.shape else numbers[0]
        at = dict(zip(self.entries, numbers, strict=True))
        key = (lambda i, j: (min(i, j), max(i, j))) if self.symmetric else (lambda i, j: (i, j))
        return as_matrix([[at[key(i, j)] for j in range(3)] for i in range(3)])

    def numbers(self, value: Any) -> list[Any]:
        """Return the numbers of a value that are kept.

        Raises:
            ValueError: if its shape is another.
        """
        shape = getattr(value, "ufl_shape", ())
        if shape != self.shape:
            raise ValueError(f"history variable: expected shape {self.shape}, got {shape}")
        return [value[entry] if entry else value for entry in self.entries]

    @property
    def start(self) -> list[float]:
        """Numbers of the initial value."""
        return [self.initial * float(len(set(entry)) < 2) for entry in self.entries]


Memory = Mapping[str, Any]  # values of history variables by name, in UFL
Stress = tuple[Any, Any, dict[str, Any]]


@dataclass(frozen=True)
class MemoryLaw:
    """A material law with a memory, written at small strain.

    Attributes:
        history: ``history(material)``, its variables by name. For large strain there must be a
            symmetric tensor ``plastic_strain``, seen by the law in ``strain − plastic_strain``.
        update: ``update(strain, history, material)``, the stress [Pa] and the new values of all
            history variables, by name.
        energy: ``energy(strain, history, material)``, energy densities by term of the ledger
            [J/m³] with the history of that strain: ``internal`` and what else is stored, and
            ``plastic_dissipation``, what was lost.
        excess: ``excess(strain, history, material)``, how far the state is beyond what the law
            admits, as a share [-]: a local iteration that did not converge shows there; None for
            laws in closed form.
    """

    history: Callable[[Any], dict[str, Variable]]
    update: Callable[[Any, Memory, Any], tuple[Any, dict[str, Any]]]
    energy: Callable[[Any, Memory, Any], dict[str, Any]]
    excess: Callable[[Any, Memory, Any], Any] | None = None


class SmallStrain:
    """A law at the strain of small displacements."""

    def __init__(self, law: MemoryLaw, material: Any) -> None:
        self.law, self.material = law, material
        self.variables = law.history(material)

    def strain(self, H: Any, old: Memory) -> tuple[Any, Memory]:
        """Return strain and history as the law takes them, for a displacement gradient."""
        return sym(H), old

    def stress(self, H: Any, old: Memory, *, shape: bool = False) -> Stress:
        """Return the first Piola–Kirchhoff stress, that of the law, and the new history.

        Args:
            H: Displacement gradient.
            old: History.
            shape: Whether the volume change is left out.
        """
        strain, history = self.strain(H, old)
        stress, new = self.law.update(dev(strain) if shape else strain, history, self.material)
        return stress, stress, new


class LargeStrain:
    """A law at the logarithmic elastic strain of ``F = F_e F_p``."""

    def __init__(self, law: MemoryLaw, material: Any) -> None:
        self.law, self.material = law, material
        own = law.history(material)
        if own.get(PLASTIC) != Variable((3, 3), symmetric=True):
            raise ValueError(
                f"law: expected a symmetric history variable {PLASTIC!r} for large strain, "
                f"got {sorted(own)}"
            )
        self.variables = {FLOW: Variable((3, 3))} | {k: v for k, v in own.items() if k != PLASTIC}

    def strain(self, H: Any, old: Memory) -> tuple[Any, Memory]:
        """Return elastic strain and history as the law takes them, for a displacement gradient.

        ``F_e − I = H + G + H G`` with ``G = F_p⁻¹ − I``: no difference of large numbers.
        """
        G = old[FLOW]
        elastic = logarithm(H + G + dot(H, G))
        return elastic, {PLASTIC: Zero((3, 3))} | {k: v for k, v in old.items() if k != FLOW}

    def stress(self, H: Any, old: Memory, *, shape: bool = False) -> Stress:
        """Return the first Piola–Kirchhoff stress, that of the law, and the new history.

        ``P = F F_p⁻¹ C_e⁻¹ M F_p⁻ᵀ`` with the Mandel stress M and ``C_e = exp 2 L``.
        """
        trial, history = self.strain(H, old)
        M, new = self.law.update(dev(trial) if shape else trial, history, self.material)
        flow = new.pop(PLASTIC)
        S = pulled_back(M, trial - flow)
        growth = _exponential(flow)
        G = old[FLOW] + growth + dot(old[FLOW], growth)
        GS = S + dot(G, S)
        second = symmetric(lambda i, j: GS[i, j] + sum(GS[i, k] * G[j, k] for k in range(3)))
        return dot(Identity(3) + H, second), M, {FLOW: G, **new}


def _exponential(flow: Any) -> Any:
    """Return ``exp(−flow) − I`` of a symmetric tensor, of relative error ``flow⁵ / 720``."""
    FF, one = square(flow), Identity(3)
    return product(FF, one / 2 - flow / 6 + product(FF, one / 24 - flow / 120)) - flow
