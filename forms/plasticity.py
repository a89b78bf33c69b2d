# SPDX-License-Identifier: LGPL-3.0-or-later
"""J2 plasticity with isotropic and kinematic hardening, in UFL.

Flow stress ``Y + H p + Q (1 − exp(−b p))`` (linear and Voce hardening) of the equivalent plastic
strain p; the yield surface moves with N back stresses after Armstrong and Frederick,
``Ẋ = 2/3 C ε̇_p − γ X ṗ`` (linear for γ = 0), as Chaboche combines them. Radial return; where
hardening is linear in closed form, else by Newton's method on the increment of p alone (Kobayashi
and Ohno, Int. J. Numer. Meth. Engng 53, 2002, 2217–2238):

    √(3/2) ‖s − Σ θ X‖ = Y(p + Δp) + (3 μ + Σ θ C) Δp,    θ = 1 / (1 + γ Δp).
"""

from dataclasses import dataclass
from math import prod
from typing import Any

import numpy as np
from ufl import Identity, conditional, dev, exp, gt, inner, sqrt, tr

from forms.elasticity import Elastic
from forms.materials import VOIGT, hooke_energy
from forms.memory import EQUIVALENT, PLASTIC, Memory, MemoryLaw, Variable

RECOVERED = "recovered"  # what dynamic recovery has lost [J/m³]
TINY = 1e-30  # of the modulus, squared: keeps the root of no stress away from a division by zero
ITERATIONS = 5  # of Newton's method at most; usual steps take two or three
LEFT = 1e-12  # of the yield stress: what they may leave


@dataclass(frozen=True)
class BackStress:
    """A back stress after Armstrong and Frederick.

    Attributes:
        modulus: C, its first slope [Pa].
        recall: γ; its largest value is C / γ; 0 for linear kinematic hardening [-].
    """

    modulus: float
    recall: float = 0.0


@dataclass(frozen=True)
class ElastoPlastic(Elastic):
    """Isotropic elasticity with J2 plasticity.

    Attributes:
        yield_stress: Y, the first flow stress [Pa].
        hardening_modulus: H, of linear isotropic hardening [Pa].
        saturation_stress: Q, by which Voce's hardening raises the flow stress in the end [Pa].
        saturation_rate: b, how fast [-].
        back_stresses: Kinematic hardening.

    Raises:
        ValueError: for a yield stress that is not between 0 and Young's modulus, hardening below 0
            (softening localises in one row of cells), or one of the two constants of Voce.
    """

    yield_stress: float = np.nan
    hardening_modulus: float = 0.0
    saturation_stress: float = 0.0
    saturation_rate: float = 0.0
    back_stresses: tuple[BackStress, ...] = ()

    def __post_init__(self) -> None:
        if not 0 < self.yield_stress < self.E:
            raise ValueError(
                f"yield_stress = {self.yield_stress:g} Pa: expected above 0 and less than Young's "
                f"modulus, {self.E:g} Pa"
            )
        least = min(
            self.hardening_modulus,
            self.saturation_stress,
            self.saturation_rate,
            *(b.recall for b in self.back_stresses),
        )
        if least < 0 or any(b.modulus <= 0 for b in self.back_stresses):
            raise ValueError("hardening: expected moduli and rates of at least 0; no softening")
        if (self.saturation_stress > 0) != (self.saturation_rate > 0):
            raise ValueError(
                "saturation_stress, saturation_rate: expected both above 0, or neither, got "
                f"{self.saturation_stress:g} Pa and {self.saturation_rate:g}"
            )


def history(material: ElastoPlastic) -> dict[str, Variable]:
    """Plastic strain, equivalent plastic strain, back stresses, and what their recovery lost."""
    symmetric = Variable((3, 3), symmetric=True)
    variables = {PLASTIC: symmetric, EQUIVALENT: Variable()}
    variables |= {_back(k): symmetric for k in range(len(material.back_stresses))}
    if any(b.recall for b in material.back_stresses):
        variables[RECOVERED] = Variable()
    return variables


def flow_stress(p: Any, material: ElastoPlastic) -> Any:
    """Flow stress of isotropic hardening [Pa]."""
    stress = material.yield_stress + material.hardening_modulus * p
    if material.saturation_stress:
        stress += material.saturation_stress * (1 - exp(-material.saturation_rate * p))
    return stress


def update(strain: Any, old: Memory, material: ElastoPlastic) -> tuple[Any, dict[str, Any]]:
    """Return the stress and the new history of a strain (radial return)."""
    mu, backs = material.mu, material.back_stresses
    elastic = strain - old[PLASTIC]
    mean = (material.lmbda + 2 / 3 * mu) * tr(elastic) * Identity(3)
    s = 2 * mu * dev(elastic)
    X = [old[_back(k)] for k in range(len(backs))]
    step = Return(s, X, old[EQUIVALENT], material)
    increment, share, length = step.solve()
    kept = [theta * x for theta, x in zip(share, X, strict=True)]
    xi = s - sum(kept) if X else s
    new = {PLASTIC: old[PLASTIC] + length * xi, EQUIVALENT: old[EQUIVALENT] + increment}
    for k, (b, theta) in enumerate(zip(backs, share, strict=True)):
        new[_back(k)] = kept[k] + (2 / 3 * b.modulus * theta * length) * xi
    if RECOVERED in old:
        new[RECOVERED] = old[RECOVERED] + step.recovered(increment, share, length)
    return mean + s - (2 * mu * length) * xi, new


class Return:
    """Radial return to the yield surface, in scalars: its equation holds no tensor.

    Attributes:
        p: Equivalent plastic strain before the step.
        ss, sX, XX: Products of trial stress and back stresses, by number of the latter [Pa²].
    """

    def __init__(self, s: Any, X: list[Any], p: Any, material: ElastoPlastic) -> None:
        self.p, self.material, self.backs = p, material, material.back_stresses
        self.ss, self.sX = _product(s, s), [_product(s, x) for x in X]
        self.XX = [
            [_product(X[max(i, j)], X[min(i, j)]) for j in range(len(X))] for i in range(len(X))
        ]

    def solve(self) -> tuple[Any, list[Any], Any]:
        """Return ``Δp``, the share θ kept of back stresses, and the length of the flow [1/Pa].

        The plastic strain grows by that times ``s − Σ θ X``.
        """
        material = self.material
        if not material.saturation_stress and not any(b.recall for b in self.backs):
            share = [1.0] * len(self.backs)
            size = self._size(share)
            beyond = size - flow_stress(self.p, material)
            slope = 3 * material.mu + material.hardening_modulus
            slope += sum(b.modulus for b in self.backs)
            increment = conditional(gt(beyond, 0), beyond * (1 / slope), 0.0)
            return increment, share, 1.5 * increment / size
        beyond, increment = self._newton()
        flows = gt(beyond, 0)
        increment = conditional(flows, increment, 0.0)
        share = self._shares(increment)  # the equivalent of s − Σ θ X is what resists it:
        length = conditional(flows, 1.5 * increment / self._resistance(increment, share), 0.0)
        return increment, share, length

    def _newton(self) -> tuple[Any, Any]:
        """Return by what the trial stress is beyond yield [Pa], and the increment that it takes.

        What is left after a change of the increment is less than twice the bend times its square:
        iterations that are not needed for :data:`LEFT` are left out.
        """
        material, share = self.material, [1.0] * len(self.backs)
        beyond, slope, turned, size = self._residual(0.0, share)
        change = beyond * size / slope  # Newton's; and Chebyshev's, but where it turns far:
        half = change * self._bend(turned, size) / (2 * slope)
        change *= 1 + half / (1 + 4 * half**2)
        increment = change
        enough = (LEFT * material.yield_stress / (2 * self._most())) ** 0.5
        for _ in range(ITERATIONS - 1):
            residual, slope, _, size = self._residual(increment, self._shares(increment))
            change = conditional(gt(abs(change), enough), residual * size / slope, 0.0)
            increment = increment + change
        return beyond, increment

    def _residual(self, dp: Any, share: list[Any]) -> tuple[Any, Any, Any, Any]:
        """Return the residual at an increment [Pa], and how it falls, times size [Pa²].

        Then what of that is the turn of back stresses [Pa²], and the size, its left side [Pa].
        """
        material = self.material
        size = self._size(share)
        falls = 3 * material.mu + material.hardening_modulus
        falls += sum(b.modulus * t**2 for b, t in zip(self.backs, share, strict=True))
        if material.saturation_stress:
            rate = material.saturation_rate
            falls += material.saturation_stress * rate * exp(-rate * (self.p + dp))
        turned = 1.5 * sum(
            b.recall * t**2 * (self.sX[i] - self._along(i, share))
            for i, (b, t) in enumerate(zip(self.backs, share, strict=True))
        )
        return size - self._resistance(dp, share), falls * size - turned, turned, size

    def _bend(self, turned: Any, size: Any) -> Any:
        """Return the second derivative of the residual at no increment, times size [Pa²]."""
        material, backs = self.material, list(enumerate(self.backs))
        ones = [1.0] * len(backs)
        bend = 1.5 * sum(
            2 * b.recall**2 * (self._along(i, ones) - self.sX[i])
            + sum(b.recall * c.recall * self.XX[i][j] for j, c in backs)
            for i, b in backs
        )
        bend += 2 * sum(b.modulus * b.recall for b in self.backs) * size
        if material.saturation_stress:
            rate = material.saturation_rate
            bend += material.saturation_stress * rate**2 * exp(-rate * self.p) * size
        return bend - (turned / size) ** 2 if self.backs else bend

    def _most(self) -> float:
        """Return the largest second derivative of the right side [Pa]."""
        material = self.material
        bend = material.saturation_stress * material.saturation_rate**2
        return bend + sum(b.modulus * b.recall for b in self.backs)

    def _shares(self, dp: Any) -> list[Any]:
        """Return the share of each back stress that recovery leaves, by a single division."""
        less = [1 + b.recall * dp if b.recall else 1.0 for b in self.backs]
        whole = 1 / prod(less) if any(b.recall for b in self.backs) else 1.0
        return [
            whole * prod(less[:i] + less[i + 1 :]) if b.recall else 1.0
            for i, b in enumerate(self.backs)
        ]

    def _along(self, i: int, share: list[Any]) -> Any:
        """Return the product of a back stress with all that are kept [Pa²]."""
        return sum(t * self.XX[i][j] for j, t in enumerate(share))

    def _size(self, share: list[Any]) -> Any:
        """Return the equivalent of the trial stress less what is kept of back stresses [Pa]."""
        rest = (t * (self._along(i, share) - 2 * self.sX[i]) for i, t in enumerate(share))
        return _size(self.ss + sum(rest), self.material)

    def _resistance(self, dp: Any, share: list[Any]) -> Any:
        """Return the right side of the equation, ``Y(p + Δp) + (3 μ + Σ θ C) Δp`` [Pa]."""
        hard = sum(b.modulus * t for b, t in zip(self.backs, share, strict=True))
        return flow_stress(self.p + dp, self.material) + (3 * self.material.mu + hard) * dp

    def recovered(self, dp: Any, share: list[Any], length: Any) -> Any:
        """Return the work on the back stresses less what they store of it [J/m³]."""
        total = 0.0
        for i, (b, t) in enumerate(zip(self.backs, share, strict=True)):
            if not b.recall:
                continue
            pushed = length * (self.sX[i] - self._along(i, share))  # X : Δε_p
            stored = 0.75 * b.recall / b.modulus * dp * (1 + t) * self.XX[i][i]
            total += t * ((1 - t) * pushed + b.modulus * dp**2 * (1 - t / 2) + stored)
        return total


def _product(A: Any, B: Any) -> Any:
    """Return ``A : B`` of symmetric tensors."""
    return sum(A[i, i] * B[i, i] for i in range(3)) + 2 * sum(A[e] * B[e] for e in VOIGT[3:])


def _size(square: Any, material: ElastoPlastic) -> Any:
    """Return the equivalent stress of a deviatoric stress, from its square, never 0 [Pa]."""
    return sqrt(1.5 * square + TINY * material.mu**2)


def energy(strain: Any, history: Memory, material: ElastoPlastic) -> dict[str, Any]:
    """Return elastic energy, that stored by hardening, and dissipation [J/m³].

    All work of hardening but dynamic recovery counts as stored. In a metal most of it is heat; the
    ledger does not depend on how they share it.
    """
    p = history[EQUIVALENT]
    hardening = material.hardening_modulus / 2 * p**2
    if material.saturation_stress:
        b = material.saturation_rate
        hardening += material.saturation_stress * (p + (exp(-b * p) - 1) / b)
    for k, back in enumerate(material.back_stresses):
        hardening += 3 / 4 / back.modulus * inner(history[_back(k)], history[_back(k)])
    return {
        "internal": hooke_energy(strain - history[PLASTIC], material),
        "hardening": hardening,
        "plastic_dissipation": material.yield_stress * p + history.get(RECOVERED, 0.0),
    }


def excess(strain: Any, history: Memory, material: ElastoPlastic) -> Any:
    """Return by which share of the yield stress a state is beyond the yield surface [-]."""
    s = 2 * material.mu * dev(strain - history[PLASTIC])
    backs = range(len(material.back_stresses))
    xi = s - sum(history[_back(k)] for k in backs) if backs else s
    beyond = _size(_product(xi, xi), material) - flow_stress(history[EQUIVALENT], material)
    return beyond / material.yield_stress


def _back(k: int) -> str:
    return f"back_stress_{k + 1}"


J2 = MemoryLaw(history, update, energy, excess)
MEMORY_LAWS = {"j2": J2}
