# SPDX-License-Identifier: LGPL-3.0-or-later
"""Quadrature points of a body whose material has a memory: its forms, kernels and history.

One-point cells have a memory of their hourglass modes too. Modes are stress that varies over the
cell. Where the mean of the cell flows, all deviatoric stress shrinks by the same share, as in
radial return, and so do the forces of the modes: ``s_p ← s_p + (1 − r)(s − s_p)`` with the share
``r = q / (q + 3 μ Δp)`` of the equivalent stress q that an increment Δp leaves. A cell that only
bends does not flow.
"""

from collections.abc import Callable
from typing import Any

import basix.ufl
import numpy as np
import ufl
from ufl import as_vector, dev, inner, sqrt
from ufl.classes import Zero

from forms.cells import mean_gradient, one_point, per_point, positions, volume
from forms.elements import LAWS
from forms.hourglass import Cell
from forms.materials import VOIGT
from forms.memory import EQUIVALENT, LargeStrain, Memory, MemoryLaw, SmallStrain, Variable
from forms.simd.memory import History, MemoryKernel
from meshes.arrays import Array

HOURGLASS = "hourglass_flow"  # what the modes of a one-point cell have flowed
LOST = "hourglass_lost"  # what that has dissipated, of the whole cell [J]
CENTRE = np.array([[0.5, 0.5, 0.5]])
TINY = 1e-30  # of the modulus, squared


class Points:
    """A law with a memory at the quadrature points of a body, and the kernels made of it.

    Args:
        law: The law.
        material: Its constants.
        space: DOLFINx space of the displacement.
        dx: Volume measure of the body with full quadrature.
        rotating: Whether the strain is large.
        element: ``full``, ``one-point``, or ``selective``, where the work of the volume change is
            left to another form.
        coefficient: Hourglass coefficient; None for the physical stiffness [-].
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
        element: str = "full",
        coefficient: float | None = None,
        dtype: str = "float64",
    ) -> None:
        self.point = (LargeStrain if rotating else SmallStrain)(law, material)
        self.space, self.dtype, self.rotating = space, dtype, rotating
        self.shape, self.single = element == "selective", element == "one-point"
        self.dx = one_point(dx) if self.single else dx
        self._coefficient, self._domain = coefficient, space.mesh.ufl_domain()
        self.variables = dict(self.point.variables)
        if self.single:
            self.variables |= {HOURGLASS: Variable((12,)), LOST: Variable()}
        self.size = sum(len(v.entries) for v in self.variables.values())
        rule: dict[str, Any] = {"points": CENTRE, "weights": np.ones(1)}
        self._element = basix.ufl.quadrature_element(
            self._domain.ufl_cell().cellname,
            value_shape=(self.size,),
            **(rule if self.single else {"degree": 2}),
        )
        count = self._element.dim // self.size
        values = ufl.Coefficient(ufl.FunctionSpace(self._domain, self._element))
        self.history = History(values, count, self.size)
        self.old = self._named([values[i] for i in range(self.size)])

    def force(self, u: Any) -> MemoryKernel:
        """Return the kernel of minus the internal virtual work, which renews the history."""
        mixed = basix.ufl.mixed_element([self.space.ufl_element(), self._element])
        test = ufl.TestFunction(ufl.FunctionSpace(self._domain, mixed))
        work, numbers = self.work(u, test)
        renewed = sum(test[3 + i] * number for i, number in enumerate(numbers))
        form = (per_point(self._domain) * renewed - work) * self.dx
        start = np.concatenate([v.start for v in self.variables.values()])
        return MemoryKernel(form, self.space, self.history, start, self.dtype)

    def work(self, u: Any, w: Any) -> tuple[Any, list[Any]]:
        """Return the virtual work of the stress and the numbers of the new history, in UFL.

        Args:
            u: Displacement [m].
            w: Test function, whose first three components are the virtual displacement.
        """
        P, own, new = self.point.stress(self._gradient(u), self.old, shape=self.shape)
        if self.single:
            work = self._work(u, w, P, own, new)
        else:
            work = inner(P, ufl.grad(as_vector([w[i] for i in range(3)])))
        return work, self._numbers(new)

    def softening(self, u: Any, history: Any) -> Any:
        """Return what flow changes of the elastic stiffness at small strain, as a bilinear form.

        That of the step from the history to a displacement: the derivative of its work less that
        of the elastic law. Hourglass modes stay as stiff as they are.

        Args:
            u: Displacement, a function.
            history: Values of the history, a function of the space of quadrature points.
        """
        w, du, law = (
            ufl.TestFunction(self.space),
            ufl.TrialFunction(self.space),
            LAWS["small-strain"],
        )
        P, _, _ = self.point.stress(ufl.grad(u), self.old, shape=self.shape)
        elastic = law.shape if self.shape else law.residual
        assert elastic is not None
        change = inner(P, ufl.grad(w)) - elastic(u, w, self.point.material)
        form = ufl.replace(change, {self.history.coefficient: history}) * self.dx
        return ufl.derivative(form, u, du)

    def _gradient(self, u: Any) -> Any:
        return mean_gradient(u) if self.single else ufl.grad(u)

    def _work(self, u: Any, w: Any, P: Any, own: Any, new: dict[str, Any]) -> Any:
        """Return the virtual work of a one-point cell; put what its modes remember into ``new``."""
        cell, trial = self._modes(u)
        soft = self._softening(own, new)
        kept = {k: (1 - soft) * component for k, component in trial.items()}
        flowed = zip(range(12), trial.values(), strict=True)
        new[HOURGLASS] = as_vector([self.old[HOURGLASS][i] + soft * s for i, s in flowed])
        new[LOST] = self.old[LOST] + soft * (2 - soft) * _energy(cell, trial)
        return cell.work(cell.forces(kept), w, P)

    def _modes(self, u: Any) -> tuple[Cell, dict[Any, Any]]:
        """Return the hourglass modes of a displacement less what has flowed of them."""
        cell = Cell(u, self.point.material, self.rotating, self._coefficient)
        flowed = self.old[HOURGLASS]
        return cell, {k: s - flowed[i] for i, (k, s) in enumerate(cell.modes().items())}

    def _softening(self, stress: Any, new: Memory) -> Any:
        """Return the share of its deviatoric stress that a cell loses as it flows."""
        if EQUIVALENT not in new:
            return 0.0
        mu, s = self.point.material.mu, dev(stress)
        drop = 3 * mu * (new[EQUIVALENT] - self.old[EQUIVALENT])
        return drop / (sqrt(1.5 * inner(s, s) + TINY * mu**2) + drop)

    def densities(self, u: Any) -> dict[str, Any]:
        """Return the energy densities by term, in UFL, but for those that are zero [J/m³]."""
        given = self._evaluated(u, self.point.law.energy)
        terms = {name: ufl.as_ufl(density) for name, density in given.items()}
        if self.single:
            weight = per_point(self._domain)
            scale = volume(positions(self._domain)) * weight  # of the rule, to the cell's own
            terms = {name: density * scale for name, density in terms.items()}
            terms["hourglass"] = _energy(*self._modes(u)) * weight
            if EQUIVALENT in self.variables:
                lost = terms.get("plastic_dissipation", 0.0)
                terms["plastic_dissipation"] = lost + self.old[LOST] * weight
        return {name: d for name, d in terms.items() if not isinstance(d, Zero)}

    def beyond(self, u: Any) -> Any:
        """Return how far the state is beyond what the law admits, in UFL; None in closed form [-].

        Over the volume element: its integral over the cell is the mean over the points.
        """
        law = self.point.law
        if law.excess is None:
            return None
        excess = self._evaluated(u, law.excess)
        return ufl.conditional(ufl.gt(excess, 0), excess, 0.0) * per_point(self._domain)

    def von_mises(self, u: Any) -> Any:
        """Return von Mises' equivalent stress at the present state, in UFL [Pa].

        Over the volume element, as :meth:`stress`: its integral over the cell is the mean over the
        points.
        """
        s = dev(self._evaluated(u, lambda *state: self.point.law.update(*state)[0]))
        return sqrt(1.5 * inner(s, s)) * per_point(self._domain)

    def stress(self, u: Any) -> Any:
        """Return the six numbers of Cauchy's stress at the present state, in UFL [Pa].

        Without the pressure that ``selective`` leaves to another form.
        """
        H = self._gradient(u)
        P, own, _ = self.point.stress(H, self.old, shape=self.shape)
        F = ufl.Identity(3) + H
        cauchy = ufl.dot(P, F.T) / ufl.det(F) if self.rotating else own
        return as_vector([cauchy[entry] for entry in VOIGT]) * per_point(self._domain)

    def _evaluated(self, u: Any, function: Callable[[Any, Memory, Any], Any]) -> Any:
        """Return a function of the law at the present strain and history."""
        strain, history = self.point.strain(self._gradient(u), self.old)
        return function(dev(strain) if self.shape else strain, history, self.point.material)

    def cell_integral(self, density: Any, space: Any) -> MemoryKernel:
        """Return the kernel of the integral over each cell of a density or several; DG0."""
        form = inner(density, ufl.TestFunction(space)) * self.dx
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


def _energy(cell: Cell, s: dict[Any, Any]) -> Any:
    """Return the energy of hourglass modes [J]."""
    f = cell.forces(s)
    return sum(f[k] * s[k] for k in s) / 2
