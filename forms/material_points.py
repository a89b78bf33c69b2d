# SPDX-License-Identifier: LGPL-3.0-or-later
"""Quadrature points of a body whose material has a memory: its forms, kernels and history."""

from typing import Any

import basix.ufl
import numpy as np
import ufl
from ufl import dev, inner
from ufl.classes import Zero

from forms.cells import per_point
from forms.memory import LargeStrain, Memory, MemoryLaw, SmallStrain
from forms.simd.memory import History, MemoryKernel
from meshes.arrays import Array


class Points:
    """A law with a memory at the quadrature points of a body, and the kernels made of it.

    Args:
        law: The law.
        material: Its constants.
        space: DOLFINx space of the displacement.
        dx: Volume measure of the body with full quadrature.
        rotating: Whether the strain is large.
        shape: Whether the work of the volume change is left to another form (element
            ``selective``).
        dtype: Type that is computed with.
    """

    def __init__(
        self,
        law: MemoryLaw,
        material: Any,
        space: Any,
        dx: Any,
        *,
        rotating: bool,
        shape: bool = False,
        dtype: str = "float64",
    ) -> None:
        self.point = (LargeStrain if rotating else SmallStrain)(law, material)
        self.space, self.dx, self.shape, self.dtype = space, dx, shape, dtype
        self.variables = self.point.variables
        self.size = sum(len(v.entries) for v in self.variables.values())
        self._domain = space.mesh.ufl_domain()
        cell = self._domain.ufl_cell().cellname
        self._element = basix.ufl.quadrature_element(cell, value_shape=(self.size,), degree=2)
        count = self._element.dim // self.size
        coefficient = ufl.Coefficient(ufl.FunctionSpace(self._domain, self._element))
        self.history = History(coefficient, count, self.size)
        self.old = self._named([coefficient[i] for i in range(self.size)])

    def force(self, u: Any) -> MemoryKernel:
        """Return the kernel of minus the internal virtual work, which renews the history."""
        mixed = basix.ufl.mixed_element([self.space.ufl_element(), self._element])
        w, q = ufl.TestFunctions(ufl.FunctionSpace(self._domain, mixed))
        P, new = self.point.stress(ufl.grad(u), self.old, shape=self.shape)
        numbers = self._numbers(new)
        renewed = sum(q[i] * number for i, number in enumerate(numbers))
        form = (per_point(self._domain) * renewed - inner(P, ufl.grad(w))) * self.dx
        start = np.concatenate([v.start for v in self.variables.values()])
        return MemoryKernel(form, self.space, self.history, start, self.dtype)

    def densities(self, u: Any) -> dict[str, Any]:
        """Return the energy densities by term, in UFL, but for those that are zero [J/m³]."""
        strain, history = self.point.strain(ufl.grad(u), self.old)
        law = self.point.law
        terms = law.energy(dev(strain) if self.shape else strain, history, self.point.material)
        densities = {name: ufl.as_ufl(density) for name, density in terms.items()}
        return {name: d for name, d in densities.items() if not isinstance(d, Zero)}

    def beyond(self, u: Any) -> Any:
        """Return how far the state is beyond what the law admits, in UFL; None in closed form [-].

        Over the volume element: its integral over the cell is the mean over the points.
        """
        law = self.point.law
        if law.excess is None:
            return None
        strain, history = self.point.strain(ufl.grad(u), self.old)
        excess = law.excess(dev(strain) if self.shape else strain, history, self.point.material)
        return ufl.conditional(ufl.gt(excess, 0), excess, 0.0) * per_point(self._domain)

    def cell_integral(self, density: Any, space: Any) -> MemoryKernel:
        """Return the kernel of a density's integral over each cell; ``space`` is DG0."""
        form = density * ufl.TestFunction(space) * self.dx
        return MemoryKernel(form, space, self.history, dtype=self.dtype)

    def values(self) -> dict[str, Array]:
        """Return each variable at the points of this rank's cells, ``(n, points, numbers)``."""
        sizes = [len(v.entries) for v in self.variables.values()]
        parts = np.split(self.history.values(), np.cumsum(sizes)[:-1], axis=2)
        return dict(zip(self.variables, parts, strict=True))

    def _named(self, numbers: list[Any]) -> dict[str, Any]:
        """Return the values of the variables from their numbers."""
        named, first = {}, 0
        for name, variable in self.variables.items():
            count = len(variable.entries)
            named[name] = variable.tensor(numbers[first : first + count])
            first += count
        return named

    def _numbers(self, new: Memory) -> list[Any]:
        """Return the numbers of new values in the order that they are kept.

        Raises:
            ValueError: if the law returns other variables than it has.
        """
        if new.keys() != self.variables.keys():
            raise ValueError(
                f"law: expected new values of {sorted(self.variables)}, got {sorted(new)}"
            )
        return [n for name, v in self.variables.items() for n in v.numbers(new[name])]
